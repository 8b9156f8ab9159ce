"""The record on disk of the end of the last run on a device. It survives the processes and a restart of the computer.

A record with the state "running" is written before a device is used, and removed at a safe end. If there is a record
while no process holds the device, the last run ended unsafely: the next run must acknowledge this. Each user has
separate records. All users may read a record, only its owner can change it. A record of another user, or a record that
cannot be read, is reported and can be acknowledged, but is not removed.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import os
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from umo.errors import AcknowledgeRequired, UmoError
from umo.system import calls, folders
from umo.system.device_lock import DeviceLock, is_held
from umo.text import printable, some, time_of_day

FOLDER = "devices"
SUFFIX = ".json"
INSPECT = (
    "inspect the machine, then start it with --acknowledge (acknowledge=True), or use `umo do STATION acknowledge`"
)
"""The advice after an unsafe end."""
MAX_RECORD_BYTES = 1 << 20
MAX_TEXT_LENGTH = 2000
"""The largest number of bytes of a record, and of characters of a text in it."""
STICKY_MODE = 0o1644
"""The mode of a record. Because of the sticky bit, systemd-tmpfiles does not remove an old file (tmpfiles.d(5))."""


def state_folder() -> Path:
    """Return this user's folder for data that outlive a run. Raises OSError if there is none."""
    return folders.own(folders.lasting(), 0o755)


@dataclass
class Ended:
    """The content of a record."""

    device: str
    station: str
    wiring: str
    state: str
    """`running` or `stopped`."""
    when: float
    """Time at which the record was written, s since 1970."""
    what: str = ""
    unreached: list[str] = field(default_factory=list)
    id: str = ""
    """A text that is different in each record."""
    seen: list[str] = field(default_factory=list)
    """Records of other users that the writer has acknowledged."""
    user: str = ""
    """The user who wrote the record, if it was another user."""
    mine: bool = True
    began: float = 0.0
    """Time at which the run took its devices, s since 1970."""
    launch: str = ""
    """A text that is the same for each start of the same station, wiring and options."""

    def __str__(self) -> str:
        return printable(self._text())

    @property
    def brief(self) -> str:
        """A short line with the most important facts first: machine, actuators not reached, device, time."""
        name = f"{self.station} ({self.wiring})" if self.wiring else self.station
        if self.state not in ("running", "stopped"):
            return printable(f"{self.device}, whose last run ended in an unknown way")
        reached = f"not reached: {some(self.unreached)}" if self.unreached else "every actuator was reset"
        state = "ended without a report" if self.state == "running" else reached
        when = time_of_day(self.when, "%Y-%m-%d %H:%M")
        return printable(", ".join(filter(None, [name, state, self.device, when, self.user])))

    def _text(self) -> str:
        when = time_of_day(self.when)
        name = f"{self.station} ({self.wiring})" if self.wiring else self.station
        name = f"{name} on {self.device}"
        by = f" by {self.user}" if self.user else ""
        if self.state == "running":
            return (
                f"{name} was started{by} at {when}, and all of its processes ended without a report "
                "(they were killed, or the computer went down); "
                "only watchdogs of the circuits, and worker processes, can have reset its outputs"
            )
        if self.state != "stopped":
            return f"how the last run on {self.device}{by} ended is unknown: {self.what}"
        reached = f"not reached: {', '.join(self.unreached)}" if self.unreached else "every actuator was reset"
        return f"{name} was stopped{by} at {when}: {self.what}; {reached}"


class DeviceRecord:
    """The record of one run, on each of its devices."""

    def __init__(self, devices: Iterable[str], station: str, wiring: str, launch: str = "") -> None:
        self._devices = sorted(set(devices))
        self._station, self._wiring, self._launch = station, wiring, launch
        self._began = calls.wall_time()
        self._seen: dict[str, list[str]] = {}
        self._former: dict[str, Ended] = {}
        """The records of this user that the record of this run replaces."""
        self._elsewhere: list[Ended] = []
        """The unsafe ends of the same launch on devices with other names."""

    def begin(self, acknowledged: bool) -> None:
        """Record the start of a run. Raises AcknowledgeRequired if the last run on a device ended unsafely and was not
        acknowledged. Raises UmoError if the record cannot be written, because an unsafe end would then look like a safe
        one."""
        try:
            found = {device: standing(device) for device in self._devices}
            for device, ended in found.items():
                self._note(device, ended)
            self._elsewhere = self._find_elsewhere()
        except OSError as error:
            text = f"the records of earlier runs cannot be read: {error.filename}: {error.strerror or error}"
            raise UmoError(text) from None
        before = [*(each for ended in found.values() for each in ended), *self._elsewhere]
        if before and not acknowledged:
            told = "\n".join(dict.fromkeys(f"{ended}." for ended in before))
            raise AcknowledgeRequired(f"{told}\n{INSPECT[0].upper()}{INSPECT[1:]}")
        try:
            for device in self._devices:
                self._write(device, "running")
        except BaseException as error:  # a signal too, which ends a start that waits for its disk
            self.abandon()
            if isinstance(error, OSError):
                raise UmoError(f"the start of the run could not be recorded: {error.strerror or error}") from None
            raise

    def _find_elsewhere(self) -> list[Ended]:
        """Return the unsafe ends of the same launch on devices that the wiring no longer names. This is possible if a
        link in /dev or the name of a host leads to another device file or address after a restart. A device that is
        held belongs to another run."""
        if not (self._launch and self._devices):
            return []
        mine = [ended for ended in _all(f"*{SUFFIX}") if ended.mine and ended.launch == self._launch]
        others = [each for each in mine if each.device not in self._devices and each.state in ("running", "stopped")]
        return [each for each in others if not is_held(each.device)]

    def _note(self, device: str, before: Iterable[Ended]) -> None:
        """Remember the records of a device, and which of them this run acknowledges."""
        mine = _own(device)
        self._seen[device] = [*(mine.seen if mine else []), *(ended.id for ended in before if not ended.mine)]
        if mine:
            self._former[device] = mine

    def finish(self) -> None:
        """Record that the run ended safely."""
        for device in self._devices:
            with suppress(OSError):
                if self._seen[device]:
                    self._write(device, "ended")
                else:
                    calls.unlink(_folder() / _file(device))
        self._remove_elsewhere()

    def _remove_elsewhere(self) -> None:
        """Remove the records that were acknowledged, because this run's own records say how it ended."""
        for ended in self._elsewhere:
            with suppress(OSError):
                now = _own(ended.device)
                if now is not None and now.id == ended.id:
                    calls.unlink(_folder() / _file(ended.device))

    def abandon(self) -> None:
        """Restore the earlier records, acknowledged or not, because the machine was not driven."""
        for device in self._devices:
            with suppress(OSError):
                path = _folder() / _file(device)
                if device in self._former:
                    _replace(path, asdict(self._former[device]))
                else:
                    calls.unlink(path)

    def stopped(self, what: str, unreached: list[str]) -> None:
        """Record that the run ended unsafely and the devices are locked. Raises OSError if the record cannot be
        written."""
        for device in self._devices:
            self._write(device, "stopped", what, unreached)
        self._remove_elsewhere()

    def _write(self, device: str, state: str, what: str = "", unreached: Sequence[str] = ()) -> None:
        now, what = calls.wall_time(), what[:MAX_TEXT_LENGTH]
        ended = Ended(device, self._station, self._wiring, state, now, what, list(unreached))
        ended.id, ended.seen, ended.began = secrets.token_hex(8), self._seen[device], self._began
        ended.launch = self._launch
        _replace(_folder() / _file(device), asdict(ended))


def standing(device: str) -> list[Ended]:
    """Return the unsafe ends of the last runs on a device: the unsafe ends of this user, and those of other users that
    were not acknowledged yet."""
    mine = _own(device)
    seen = [] if mine is None else mine.seen
    return [ended for ended in _all(_file(device)) if ended.state != "ended" and (ended.mine or ended.id not in seen)]


def left_by(about: Mapping[str, Any]) -> list[Ended]:
    """Return the records that the run with these facts, and not a later run, has on its devices: `running` while it has
    them, and `stopped` after an unsafe end. Empty after a safe end. Raises OSError if the records cannot be read."""
    station, started = about.get("station"), float(about.get("started", 0.0))
    found = [ended for device in about.get("devices", ()) for ended in standing(str(device))]
    own = [ended for ended in found if ended.station == station and ended.began <= started]
    return [ended for ended in own if ended.state == "running" or started <= ended.when]


def all_standing() -> list[Ended]:
    """Return every record of every user without a safe end, including the records of running machines."""
    return [ended for ended in _all(f"*{SUFFIX}") if ended.state != "ended"]


def _own(device: str) -> Ended | None:
    return next((ended for ended in _all(_file(device)) if ended.mine), None)


def _all(pattern: str) -> Iterator[Ended]:
    for folder, status in folders.folders(folders.lasting()):
        devices = folder / FOLDER
        try:
            names = sorted(os.listdir(devices))
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            yield _unknown("an unknown device", devices, status.st_uid, error.strerror or str(error))
            continue
        for name in fnmatch.filter(names, pattern):
            ended = _read(devices / name, status.st_uid)
            if ended is not None:
                yield ended


def _read(path: Path, owner: int) -> Ended | None:
    """Return a record, or None if there is none that belongs to the folder's owner."""
    try:
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        return None
    except OSError as error:
        return _unknown(f"the device of {path}", path, owner, error.strerror or str(error))
    with open(file, "rb") as opened:
        status = os.fstat(file)
        if status.st_uid != owner or not stat.S_ISREG(status.st_mode):
            return None
        try:
            ended = Ended(**json.loads(opened.read(MAX_RECORD_BYTES)))
            texts = [ended.device, ended.station, ended.wiring, ended.state, ended.what, ended.id, ended.launch]
            if not all(isinstance(text, str) for text in [*texts, *ended.unreached, *ended.seen]):
                raise TypeError("texts")
            for moment in (ended.when, ended.began):
                time.localtime(float(moment))
        except (OSError, ValueError, TypeError, OverflowError, RecursionError):
            return _unknown(f"the device of {path}", path, owner, "its record cannot be read")
    ended.mine = not hasattr(os, "getuid") or owner == os.getuid()
    ended.user = "" if ended.mine else f"user {owner}"
    ended.id = ended.id or _id_of(path)
    return ended


def _unknown(device: str, path: Path, owner: int, why: str) -> Ended:
    mine = not hasattr(os, "getuid") or owner == os.getuid()
    user = "" if mine else f"user {owner}"
    return Ended(device, "", "", "unknown", 0.0, why, id=_id_of(path), user=user, mine=mine)


def _id_of(path: Path) -> str:
    """Return an id for a record that contains none. The id changes when the file is written again."""
    written = 0
    with suppress(OSError):
        written = path.lstat().st_mtime_ns
    return hashlib.sha256(f"{path} {written}".encode(errors="surrogateescape")).hexdigest()[:16]


def _folder() -> Path:
    path = state_folder() / FOLDER
    path.mkdir(mode=0o755, exist_ok=True)
    path.chmod(0o755)
    return path


def _file(device: str) -> str:
    return hashlib.sha256(device.encode(errors="surrogateescape")).hexdigest()[:24] + SUFFIX


def _replace(path: Path, content: dict[str, Any]) -> None:
    with folders.written(path, STICKY_MODE, to_disk=True) as stream:
        stream.write(json.dumps(content).encode())


class DeviceClaim:
    """The claim to the devices of a run, created before a driver is opened. Raises DeviceHeld if another process holds
    a device, and AcknowledgeRequired if an unsafe end was not acknowledged (`acknowledge`). Each method of the claim
    ends it. If the process ends before that, its record shows an unsafe end.
    """

    def __init__(
        self, devices: Iterable[str], station: str, wiring: str = "", *, acknowledge: bool = False, launch: str = ""
    ) -> None:
        """`launch`: a text that is the same for each start of the same station, wiring and options, or "" if it is
        unknown."""
        self._devices = devices = tuple(devices)
        self.hold = DeviceLock(devices, f"{station}, {wiring}" if wiring else station)
        self._record = DeviceRecord(devices, station, wiring, launch)
        try:
            self._record.begin(acknowledge)
        except BaseException:
            self.hold.release()
            raise

    def finish(self) -> None:
        """Record that every actuator is at its default, after an ordinary end."""
        self._record.finish()
        self.hold.release()

    def abandon(self) -> None:
        """Record that the machine was not connected: an earlier unsafe end still has to be acknowledged."""
        self._record.abandon()
        self.hold.release()

    def stopped(self, what: str, unreached: list[str]) -> str:
        """Record that the devices are locked until somebody acknowledges this. Return a text that says what could not
        be recorded and gives advice; empty if no device was driven."""
        if not self._devices:
            return ""
        try:
            self._record.stopped(what, unreached)
        except OSError as error:  # the record of the start stands all the same
            return f"this could not be recorded: {error.strerror or error}; {INSPECT}"
        finally:
            self.hold.release()
        return INSPECT
