"""Holding devices: one process at a time uses a device, for all stations, wirings, programs and users.

On Linux a device is held by an abstract Unix socket of its name (unix(7)). Binding it is atomic and system-wide (within
one network namespace), needs neither a folder nor a right, and the kernel ends it with the last process that has it
and tells everybody which one that is. Elsewhere nothing is held: real time is for Linux.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from umo.errors import DeviceHeld, UmoError
from umo.text import printable, time_of_day

LINUX = sys.platform.startswith("linux")
MAX_NAME_BYTES = 107
"""Bytes of a socket's name."""
BACKLOG = 4096
SOCKET_TABLE = Path("/proc/net/unix")


class DeviceLock:
    """Devices held by this process and by every process that it forks from now on, until all of them have ended or
    released them. DeviceHeld names the owner of a device and the start time; then no device is held."""

    def __init__(self, devices: Iterable[str], purpose: str) -> None:
        self.devices = sorted(set(devices))
        self._told = f"{time.time():.0f} {printable(purpose).encode('ascii', 'replace').decode()}"
        self._sockets: list[socket.socket] = []
        """One for each device, until it is released."""
        self._notes: list[socket.socket] = []
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
        """Have `holder` name this process, which has inherited the devices: the kernel names the last that listened."""
        with suppress(OSError):  # it is only told
            for device, taken in zip(self.devices, self._sockets, strict=False):
                self._listen(device, taken)

    def _bind(self, device: str) -> None:
        taken = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._sockets.append(taken)
        try:
            taken.bind(_name(device))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise UmoError(f"{device} cannot be held: {error.strerror}") from None
            raise DeviceHeld(f"{device} is held by {holder(device)}") from None
        self._listen(device, taken)

    def _listen(self, device: str, taken: socket.socket) -> None:
        taken.listen(BACKLOG)
        note = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)  # its name is what others read in /proc/net/unix
        try:
            note.bind(f"\0{_note(device, os.getpid())}{self._told}".encode()[:MAX_NAME_BYTES])
            self._notes.append(note)
        except OSError:  # this process has left it before
            note.close()


def is_held(device: str) -> bool:
    return LINUX and _peer(device) is not None


def holder(device: str) -> str:
    """The owner of a device, its purpose and start time, as far as the kernel tells; of a machine in processes of its
    own the pid that `umo ps` shows. Other users choose these texts."""
    pid, uid = _peer(device) or (0, 0)
    if not pid:
        return "another process"
    what, since = _noted(device, pid)
    who = "this program itself" if pid == os.getpid() else f"pid {pid} of {_user(uid)}"
    if not Path(f"/proc/{pid}").exists():
        who += ", which has ended; another process of that program still holds it"
    when = "" if since is None else f", since {time_of_day(since)}"
    return printable(f"{who}{f' ({what})' if what else ''}{when}")


def _peer(device: str) -> tuple[int, int] | None:
    """Pid and user of who listens there, by the kernel; None: nobody; 0: it cannot be asked, as too many have asked."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(_name(device))
            pid, uid, _ = struct.unpack("3i", probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        except ConnectionRefusedError:
            return None
        except OSError:
            return 0, 0
    return pid, uid


def _noted(device: str, pid: int) -> tuple[str, float | None]:
    """The note of the holder about itself: purpose and start time."""
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
