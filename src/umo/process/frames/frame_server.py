"""The server of a run's frames, a Unix socket at which clients get the descriptors of the run's memory, and the folder
of these sockets. Each user has a folder, in shared memory if there is any.

Only processes of the same user, and root, get the descriptors: both ends ask the kernel for the identity of the other
end (SO_PEERCRED, unix(7)). A socket without a listener belongs to a dead process; any process that finds such a socket
removes it.
"""

from __future__ import annotations

import os
import re
import select
import socket
import stat
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from umo.errors import FramesError
from umo.process.frames.memory import RunDescriptors
from umo.system import calls, folders, processes
from umo.system.folders import is_own, remove
from umo.system.processes import is_used

GREETING = b"umo frames 6"
MAX_ADDRESS_BYTES = 107
"""The size of a socket's address in bytes (unix(7), sun_path)."""
MAX_WAITING = 64
"""The largest number of clients that wait for an answer simultaneously."""
ANSWER_TIMEOUT = 10.0
"""The time in s for which a client waits for the descriptors of a living process, which may answer late on a busy
computer."""
STOPPED_TIMEOUT = 1.0
"""The time in s for which a client waits for a process that was stopped by a signal, and for a process that has
ended."""
CONNECT_PAUSE = 0.005
"""The time in s until the next attempt of a client while too many clients wait."""
ANSWER_LOOK_INTERVAL = 0.1
"""The time in s between two checks of the process that must answer."""
GUARDIAN_NAMES = ("umo guardian", "umo standby")
"""The names of the processes that answer for their child process, which has made the socket."""
ACCEPT_PAUSE = 0.1
"""The time in s until the next client is accepted after a failure, in a thread."""
ROOT = 0
SUFFIX = ".sock"
FOLDER_VARIABLE = "UMO_FRAMES"
"""Environment variable that names another folder, for containers and tests."""
SHARED_MEMORY = Path("/dev/shm")
MAX_NAME_LENGTH = 40
"""Largest number of characters of a station's name in the name of a socket, whose address is short."""
_HIDDEN = re.compile(rf"\.(\d+)-[0-9a-f]+{re.escape(SUFFIX)}")
_OPEN = re.compile(rf"[\w-]+-\d+-[0-9a-f]+{re.escape(SUFFIX)}", re.ASCII)


def folder() -> Path:
    """Return the user's folder, which is made if needed. Raises FramesError if this fails."""
    try:
        if given := os.environ.get(FOLDER_VARIABLE):
            return folders.checked(Path(given))
        return folders.own(folders.first_writable([SHARED_MEMORY]))
    except OSError as error:
        raise FramesError(f"the folder for frames cannot be used: {error}") from None


def new_path(station: str) -> Path:
    """Return the path of a socket for a new run, in the user's folder. Files that dead processes left there are
    removed."""
    rings()
    name = re.sub(r"[^\w-]", "_", station, flags=re.ASCII)[:MAX_NAME_LENGTH]
    return folder() / f"{name}-{os.getpid()}-{time.monotonic_ns():x}{SUFFIX}"


def sockets() -> list[Path]:
    """Return the sockets with a station's name, of living or dead processes. Nothing is removed."""
    place = folder()
    try:
        return [place / name for name in os.listdir(place) if _OPEN.fullmatch(name)]
    except OSError as error:
        raise FramesError(f"the folder for frames cannot be used: {error}") from None


def rings() -> list[Path]:
    """Return the sockets of running stations, oldest first. The sockets of dead processes are removed; other files are
    not."""
    place = folder()
    try:
        names = os.listdir(place)
    except OSError as error:
        raise FramesError(f"the folder for frames cannot be used: {error}") from None
    for name in names:
        if (hidden := _HIDDEN.fullmatch(name)) and not is_used(int(hidden[1])):  # it died before it got its name
            remove(place / name)
    found = sorted((place / name for name in names if _OPEN.fullmatch(name)), key=_made)
    return [path for path in found if is_living(path)]


def is_living(path: Path) -> bool:
    """Return True if this is the socket of a living process. The socket of a dead process is removed; any other file is
    not changed."""
    served = is_served(path) if is_socket(path) else None
    if served is False:
        remove(path)
    return bool(served)


def _made(path: Path) -> int:
    """Return the time of creation in ns of CLOCK_MONOTONIC, from the name that `new_path` has given."""
    return int(path.stem.rpartition("-")[2], 16)


class FrameServer:
    """The server that gives the descriptors `ends` to clients that connect at `path`. Raises OSError if the socket
    cannot be made. A forked process inherits the server: one of the two processes may call `listen` when the memory is
    complete, and the other one answers.
    """

    def __init__(self, path: Path, ends: RunDescriptors) -> None:
        self.path = path
        self.ends = ends
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)

    def listen(self) -> None:
        """Make the run visible: the socket gets its name when it already listens. Raises FramesError if the name cannot
        be used."""
        hidden = self.path.with_name(f".{os.getpid()}-{time.monotonic_ns():x}{self.path.suffix}")
        try:
            with _address(hidden) as address:
                self._socket.bind(address)
            self._socket.listen(MAX_WAITING)
            hidden.rename(self.path)
        except OSError as error:
            remove(hidden)
            raise FramesError(
                f"the socket for frames {self.path} cannot be created: {error.strerror or error}"
            ) from None

    def leave(self) -> None:
        """Stop answering in this process, because the other process answers."""
        self._socket.close()

    @property
    def is_closed(self) -> bool:
        """True if the run cannot be found any more."""
        return self._closed.is_set()

    def look(self) -> None:
        """Answer the waiting clients. Never blocks or raises."""
        with suppress(OSError):  # nobody waits, or no descriptor is free
            for _ in range(MAX_WAITING):
                self._answer(self._socket.accept()[0])

    def start(self) -> None:
        """Answer in a thread, for a process that cannot call `look`."""
        self._socket.setblocking(True)
        self._thread = threading.Thread(target=self._serve, name="umo frames", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._closed.is_set():
            try:
                self._answer(self._socket.accept()[0])
            except OSError:  # it was closed, or no descriptor is free
                self._closed.wait(ACCEPT_PAUSE)

    def _answer(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            if _maker_and_user(client)[1] in (ROOT, os.getuid()):
                calls.send_message(client, GREETING, self.ends)

    def close(self) -> None:
        """Close the server: from now on the run cannot be found. Processes that have the memory of the run keep it."""
        self._closed.set()
        remove(self.path)
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self._thread is not None:
            self._thread.join()
        self._socket.close()


def receive(path: Path) -> RunDescriptors:
    """Return the descriptors of the run whose socket this is. Raises FramesError if they cannot be received."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as here:
        here.settimeout(STOPPED_TIMEOUT)
        try:
            with _address(path) as address:
                _connect(here, address)
            maker, user = _maker_and_user(here)
            if user not in (ROOT, os.getuid()) and os.getuid() != ROOT:
                raise FramesError(f"{path} belongs to another user (uid {user})")
            _wait_for_answer(here, path, maker)
            data, files = calls.receive_message(here, len(GREETING) + 1, len(RunDescriptors._fields))
        except TimeoutError:
            raise FramesError(
                f"{path}: too many programs wait for an answer of this run; its guardian may have been stopped"
            ) from None
        except OSError as error:
            raise FramesError(f"there are no frames at {path}: {error.strerror or error}") from None
    if data != GREETING or len(files) != len(RunDescriptors._fields):
        for file in files:
            os.close(file)
        raise FramesError(f"{path} belongs to another version of umo, or to another user")
    return RunDescriptors(*files)


def _connect(here: socket.socket, address: str) -> None:
    """Connect within `STOPPED_TIMEOUT`. While too many clients wait, the kernel refuses the connection immediately
    (unix(7), EAGAIN); then try again."""
    until = time.monotonic() + STOPPED_TIMEOUT
    while True:
        try:
            return here.connect(address)
        except BlockingIOError:
            if time.monotonic() > until:
                raise TimeoutError from None
            time.sleep(CONNECT_PAUSE)


def _wait_for_answer(here: socket.socket, path: Path, maker: int) -> None:
    """Wait for the answer of a process that lives. Raises FramesError if it was stopped, has ended, or does not answer
    in time. `maker`: the process that has made the socket, 0 if it is unknown."""
    ready = select.poll()
    ready.register(here, select.POLLIN)
    begun = heard = time.monotonic()
    while not ready.poll(ANSWER_LOOK_INTERVAL * 1e3):
        now = time.monotonic()
        title, pid = _asked(maker)
        state = processes.state(pid) if pid else ""
        if state not in processes.STOPPED + processes.ENDED:
            heard = now
        elif now - heard > STOPPED_TIMEOUT:
            what = "has ended" if state in processes.ENDED else "is stopped"
            raise FramesError(f"{path}: the {title} of this run {what} and does not answer (pid {pid})")
        if now - begun > ANSWER_TIMEOUT:
            of = f" (pid {pid})" if pid else ""
            raise FramesError(f"{path}: the {title} of this run{of} has not answered for {ANSWER_TIMEOUT:g} s")


def _asked(maker: int) -> tuple[str, int]:
    """Return the process that answers clients, as text and by its pid. This is the guardian of the process that has
    made the socket, or else that process itself. The pid is 0 if it is unknown."""
    guardian = processes.parent_of(maker) if maker else 0
    if guardian and processes.name_of(guardian) in GUARDIAN_NAMES:
        return "guardian", guardian
    return "process", maker


def is_socket(path: Path) -> bool:
    """Return True if this is a socket of this user, and not a link to one."""
    return is_own(path, stat.S_ISSOCK)


def is_served(path: Path) -> bool | None:
    """Return whether there is a listener, or None if this is unknown. The function does not wait for a stopped
    process."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as here, _address(path) as address:
            here.setblocking(False)
            here.connect(address)
    except BlockingIOError:  # too many wait already
        return True
    except ConnectionRefusedError:
        return False
    except OSError:
        return None
    return True


@contextmanager
def _address(path: Path) -> Iterator[str]:
    """Return a context with the path. If the path is too long for an address, the context has a shorter path through a
    descriptor of the folder."""
    if len(os.fsencode(path)) <= MAX_ADDRESS_BYTES:
        yield str(path)
        return
    place = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{place}/{path.name}"
    finally:
        os.close(place)


def _maker_and_user(connection: socket.socket) -> tuple[int, int]:
    """Return the pid and the user of the process at the other end, as known to the kernel. That process may have left
    the socket to another process since."""
    pid, user, _ = struct.unpack("iII", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return int(pid), int(user)
