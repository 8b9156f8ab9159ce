"""Locks on devices: among all stations, wirings, programs and users, one process at a time uses a device.

On Linux a device is held by an abstract Unix socket of its name (unix(7)). Binding the socket is atomic and system-wide
(within one network namespace), and needs neither a folder nor a permission. The kernel removes the socket when the last
process that has it ends, and can name this process. On other systems no device is held: real time needs Linux.
"""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from umo.errors import DeviceHeld, UmoError
from umo.system import calls
from umo.system.processes import STOPPED, first_with, state
from umo.text import printable, time_of_day

LINUX = sys.platform.startswith("linux")
MAX_NAME_BYTES = 107
"""The largest number of bytes of a socket's name."""
BACKLOG = 4096
SOCKET_TABLE = Path("/proc/net/unix")


class DeviceLock:
    """A lock on devices. This process, and every process that it forks from now on, holds the devices until all of
    these processes have ended or released them. Raises DeviceHeld, which names the owner of a device and the start
    time, if another process holds one of the devices; then this process holds none."""

    def __init__(self, devices: Iterable[str], purpose: str) -> None:
        self.devices = sorted(set(devices))
        self._told = f"{calls.wall_time():.0f} {printable(purpose).encode('ascii', 'replace').decode()}"
        self._sockets: list[calls.Socket] = []
        """One socket for each device, until the device is released."""
        self._notes: list[calls.Socket] = []
        if not LINUX:
            return
        try:
            for device in self.devices:
                self._bind(device)
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        for sockets in (self._notes, self._sockets):
            while sockets:
                sockets.pop().close()

    def used_here(self) -> None:
        """Make `holder` return this process, which has inherited the devices: the kernel names the process that has
        called listen last."""
        with suppress(OSError):  # it is only told
            for device, taken in zip(self.devices, self._sockets, strict=False):
                self._listen(device, taken)

    def _bind(self, device: str) -> None:
        try:
            taken = calls.take_name(_name(device), calls.STREAM)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise UmoError(f"{device} cannot be held: {error.strerror}") from None
            raise DeviceHeld(f"{device} is held by {holder(device)}") from None
        self._sockets.append(taken)
        self._listen(device, taken)

    def _listen(self, device: str, taken: calls.Socket) -> None:
        calls.listen(taken, BACKLOG)
        note = f"\0{_note(device, os.getpid())}{self._told}".encode()[:MAX_NAME_BYTES]
        with suppress(OSError):  # this process has left it before
            self._notes.append(calls.take_name(note, calls.DATAGRAM))  # others read its name in /proc/net/unix


def is_held(device: str) -> bool:
    return LINUX and calls.listener(_name(device)) is not None


def holder(device: str) -> str:
    """Return the owner of a device, its purpose and start time, if the kernel knows them. For a machine with several
    processes, the owner is the pid that `umo show stations` shows. These texts may come from other users."""
    pid, uid = calls.listener(_name(device)) or (0, 0)
    if not pid:
        return "another process"
    what, since = _noted(device, pid)
    who = "this program itself" if pid == os.getpid() else f"pid {pid} of {_user(uid)}"
    if not Path(f"/proc/{pid}").exists():
        who += f", which has ended; {_heir(device)} still holds it"
    when = "" if since is None else f", since {time_of_day(since)}"
    return printable(f"{who}{f' ({what})' if what else ''}{when}")


def _heir(device: str) -> str:
    """Return a living process that has inherited the device, if this user may see the descriptors of the process."""
    name = _name(device).decode().replace("\0", "@")
    with suppress(OSError):
        rows = (line.split(maxsplit=7) for line in SOCKET_TABLE.read_text(errors="replace").splitlines())
        sockets = {f"socket:[{row[6]}]" for row in rows if row[7:] == [name]}
        if (pid := first_with(sockets)) is not None:
            stopped = " (stopped by a signal)" if state(pid) in STOPPED else ""
            return f"pid {pid}{stopped}, which that process has started,"
    return "another process of that program"


def _noted(device: str, pid: int) -> tuple[str, float | None]:
    """Return the holder's note about itself: purpose and start time."""
    start = f"@{_note(device, pid)}"
    with suppress(OSError, ValueError):
        for line in SOCKET_TABLE.read_text(errors="replace").splitlines():
            _, found, rest = line.partition(start)
            if found:
                since, _, purpose = rest.partition(" ")
                return purpose, float(since)
    return "", None


def _name(device: str) -> bytes:
    return f"\0umo device {_digest(device)}".encode()


def _note(device: str, pid: int) -> str:
    return f"umo holds {_digest(device)} {pid} "


def _digest(device: str) -> str:
    return hashlib.sha256(device.encode(errors="surrogateescape")).hexdigest()[:24]


def _user(uid: int) -> str:
    with suppress(ImportError, KeyError):
        import pwd

        return f"user {pwd.getpwuid(uid).pw_name}"
    return f"user {uid}"
