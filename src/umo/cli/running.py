"""The stations that run now, as `umo ps`, `umo watch` and `umo why` find them."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.errors import FramesError, PathError, UmoError
from umo.frames import Reader, rings
from umo.system.hold import is_held
from umo.system.record import Ended, all_standing
from umo.text import cause_of, did_you_mean, printable
from umo.wiring.patterns import ANY

from .console import err, out
from .folding import chosen


def ps(as_json: bool) -> None:
    """List what runs, and the devices that stand stopped."""
    found = [_line(reader) for reader in readers()]
    stopped = standing()
    if as_json:
        out.print_json(json.dumps({"running": found, "stopped": [vars(ended) for ended in stopped]}))
        return
    if found:
        out.print(_table(found))
    else:
        out.print("no station is running")
    for ended in stopped:
        out.print(f"stands stopped: {ended} (start it with --acknowledge)")


def frames_at(path: Path) -> Reader:
    """The frames of a ring or a black box; FramesError whatever is wrong with the file."""
    if not path.is_file():
        raise FramesError(f"{path} is not a file" if path.exists() else f"no frames at {path}: no such file")
    with reading(path):
        return Reader(path)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise any error of reading a damaged file as FramesError."""
    try:
        yield
    except UmoError:
        raise
    except Exception as error:  # of json, struct, numpy, mmap: whatever a damaged file leads to
        raise FramesError(
            f"{path} cannot be read: it is damaged or was written by another version of umo ({cause_of(error)})"
        ) from error


def attach(name: str | None) -> Reader:
    """The frames of one running station, by name or pid; FramesError lists those that run."""
    found = readers()
    wanted = None if name is None else station_name(name)
    fitting = [r for r in found if name is None or r.about["station"] in (name, wanted) or str(r.about["pid"]) == name]
    if len(fitting) == 1:
        return fitting[0]
    names = [str(reader.about["station"]) for reader in found]
    if not found:
        raise FramesError(f"no station is running{_others()}; start one in real time with `umo run STATION`")
    if not fitting:
        raise FramesError(f"{name!r} is not running{did_you_mean(str(name), names)}; running: {', '.join(names)}")
    pids = ", ".join(f"{reader.about['station']} (pid {reader.about['pid']})" for reader in fitting)
    raise FramesError(f"several stations are running; give a name or a pid: {pids}")


def attach_first(words: list[str]) -> tuple[Reader, list[str]]:
    """The station that the first word names and the words after it; else the only one that runs, and all the words."""
    try:
        return attach(words[0] if words else None), words[1:]
    except FramesError:
        found = readers()
        if len(found) == 1 and any(_names(found[0], word) for word in words[:1]):
            return found[0], words
        raise


def station_name(text: str) -> str:
    """Of a folder, also where it is a link that leads nowhere."""
    return os.path.basename(os.path.realpath(text))


def _names(reader: Reader, word: str) -> bool:
    """Whether a word names objects, compounds or signals, or is a pattern."""
    if ANY in word:
        return True
    try:
        return bool(chosen(reader.paths + reader.signals, [word], ""))
    except PathError:
        return False


def readers() -> list[Reader]:
    """One for each living ring; one that cannot be attached to is named."""
    found = []
    for path in rings():
        try:
            found.append(frames_at(path))
        except FramesError as error:
            err.print(f"umo: {error}", soft_wrap=True)
    return found


def standing() -> list[Ended]:
    """The machines that stand stopped, or whose processes are all gone."""
    return [ended for ended in all_standing() if ended.state != "running" or not is_held(ended.device)]


def _line(reader: Reader) -> dict[str, Any]:
    about, frame = reader.about, reader.latest()
    return {
        "station": about["station"],
        "wiring": about["wiring"],
        "pid": about["pid"],
        "since": about["started"],
        "state": reader.state.name.lower(),
        "progress": "" if frame is None else printable(frame["progress"].decode(errors="replace")),
        "period_s": about["period"],
        "periods": reader.head,
        "missed": reader.missed,
    }


def _table(found: list[dict[str, Any]]) -> Table:
    table = Table("station", "pid", "since", "state", "period", "periods", "missed", "progress", header_style="bold")
    for line in found:
        since = time.strftime("%H:%M:%S", time.localtime(line["since"]))
        name = f"{line['station']} ({line['wiring']})" if line["wiring"] else line["station"]
        table.add_row(
            name,
            str(line["pid"]),
            f"{since} ({lasting(time.time() - line['since'])})",
            line["state"],
            f"{line['period_s'] * 1e3:g} ms",
            f"{line['periods']:,}",
            f"{line['missed']:,}",
            line["progress"],
        )
    return table


def lasting(seconds: float) -> str:
    """`12 s`, `3 min`, `2 h 05 min`, `3 d 4 h`."""
    minutes, hours, days = seconds / 60, seconds / 3600, seconds / 86400
    if minutes < 2:
        return f"{seconds:.0f} s"
    if hours < 1:
        return f"{minutes:.0f} min"
    if days < 2:
        return f"{int(hours)} h {int(minutes) % 60:02d} min"
    return f"{int(days)} d {int(hours) % 24} h"


def _others() -> str:
    """A hint for the message if another user has a folder of frames."""
    folders = [path for path in Path("/dev/shm").glob("umo-*") if path.is_dir()] if Path("/dev/shm").is_dir() else []
    own = f"umo-{os.getuid()}" if hasattr(os, "getuid") else ""
    return " for this user; stations of another user cannot be watched" if any(p.name != own for p in folders) else ""
