"""How a run is found by its socket, and what other processes can do to it: nothing that costs it anything."""

from __future__ import annotations

import errno
import gc
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.machines import bench, wired
from helpers.publishing import running, writer
from helpers.waiting import until
from umo import connect, published
from umo.errors import FramesError
from umo.process.frames import Reader, Stage, frame_server, publish, rings
from umo.process.frames.frame_server import MAX_WAITING, FrameServer, folder, is_served, new_path, receive
from umo.process.frames.memory import RunDescriptors
from umo.system import processes
from umo.testing import Scripted, VirtualTimer, periods

LISTER = """
import sys
from umo.process.frames import rings
print(flush=True)
while True:
    rings()
"""


@contextmanager
def process(code: str, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Another process, once it has printed a line."""
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout is not None
            other.stdout.readline()
            yield other
        finally:
            other.kill()


def test_a_reader_that_nobody_closes_gives_its_descriptors_back() -> None:
    with running() as (_, ring, _connection):
        before = len(os.listdir("/proc/self/fd"))
        reader = Reader(ring.path)
        del reader
        gc.collect()
        until(lambda: len(os.listdir("/proc/self/fd")) <= before)  # the server's thread closes its own end in its time


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_a_process_that_the_program_forked_does_not_hide_the_end_of_the_run() -> None:
    held, release = os.pipe()
    with running() as (_, ring, _connection):
        reader = Reader(ring.path)
        pid = os.fork()
        if pid == 0:
            os.close(release)
            os.read(held, 1)
            os._exit(0)
    try:
        assert not reader.alive
    finally:
        os.close(release)
        os.waitpid(pid, 0)
        os.close(held)
        reader.close()


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_a_process_that_a_forked_process_forked_keeps_its_files(tmp_path: Path) -> None:
    with running(), (tmp_path / "own").open("wb") as own:
        *_, pipe = publish._pipes.values()
        pid = os.fork()
        if pid == 0:
            os.dup2(own.fileno(), pipe)  # the number of the pipe is that of another file now
            if (child := os.fork()) == 0:
                os.write(pipe, b"kept")
                os._exit(0)
            os.waitpid(child, 0)
            os._exit(0)
        os.waitpid(pid, 0)
    assert (tmp_path / "own").read_bytes() == b"kept"


@pytest.mark.full
def test_rings_can_be_made_while_others_list_them() -> None:
    with process(LISTER) as lister:
        for _ in range(50):
            with running() as (_, ring, _connection):
                assert rings() == [ring.path]
        assert lister.poll() is None
    assert list(folder().iterdir()) == []


def test_a_socket_can_be_removed_by_nobody_while_its_run_lives() -> None:
    """At every call of the operating system on the way: a lister finds nothing, or a run that lives."""
    calls = 0

    def list_at(frame: Any, event: str, argument: Any) -> None:
        nonlocal calls
        if event == "c_call" and argument.__name__ not in ("setprofile",):
            sys.setprofile(None)
            calls += 1
            assert len(rings()) <= 1
            sys.setprofile(list_at)

    path, (ends, readers) = new_path("bench"), RunDescriptors.pair()
    sys.setprofile(list_at)
    try:
        server = FrameServer(path, readers)
        server.listen()
    finally:
        sys.setprofile(None)
    assert calls > 5
    assert rings() == [path]
    server.close()
    assert rings() == []
    ends.close()
    readers.close()


def test_what_is_not_a_socket_of_umo_is_left_alone(tmp_path: Path) -> None:
    place = folder()
    (tmp_path / "file").write_bytes(bytes(5000))
    (place / "link-1-ff.sock").symlink_to(tmp_path / "file")
    (place / "mine-1-ff.sock").write_text("not umo's")
    os.mkfifo(place / "pipe-1-ff.sock")
    (place / "folder-1-ff.sock").mkdir()
    others = [socket.socket(socket.AF_UNIX, kind) for kind in (socket.SOCK_SEQPACKET, socket.SOCK_STREAM)]
    for other, name in zip(others, ("others.sock", "stream-1-ff.sock"), strict=True):
        other.bind(str(place / name))
    others[1].listen()
    before = sorted(place.iterdir())
    assert rings() == []
    assert sorted(place.iterdir()) == before
    for other in others:
        other.close()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a file away")
def test_another_users_socket_is_not_removed() -> None:
    path = folder() / "theirs-1-ff.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(path))
    os.chown(path, 65534, -1)
    assert rings() == []
    assert path.exists()


def test_what_a_process_left_behind_that_died_before_its_socket_had_a_name_is_removed() -> None:
    with process("import os; print(os.getpid(), flush=True); input()") as other:
        path = folder() / f".{other.pid}-ff.sock"
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
            dead.bind(str(path))
        rings()
        assert path.exists()  # it may be about to listen
        other.kill()
        other.wait()
        rings()
        assert not path.exists()


def test_the_socket_of_a_killed_process_makes_way_for_a_new_one() -> None:
    with writer("slow") as (process, path):
        process.kill()
        process.wait()
        assert path.exists()
        with running() as (_, ring, _connection):
            assert [path.name for path in folder().iterdir()] == [ring.path.name]


def test_a_long_path_of_the_folder_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The address of a socket has room for 107 bytes."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / ("x" * 120)))
    m = bench()
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "a station with a long name " * 10) as ring:
        assert rings() == [ring.path]
        with Reader(ring.path) as reader:
            assert reader.state is Stage.RUNNING


# What other processes can do to a run -------------------------------------------------------------------

HOSTILE = """
import errno, fcntl, mmap, os, sys
from pathlib import Path
from umo.process.frames import Reader
print(flush=True)
reader = Reader(Path(sys.argv[1]))
frames, cells, _ = reader.ends
size = os.fstat(frames).st_size
tries = {
    "cut the frames": lambda: os.ftruncate(frames, 0),
    "grow the frames": lambda: os.ftruncate(frames, 2 * size),
    "write the frames": lambda: os.pwrite(frames, bytes(64), 0),
    "punch a hole into the frames": lambda: fallocate(frames, 3, 0, size),
    "map the frames for writing": lambda: mmap.mmap(frames, size),
    "open the frames anew and write": lambda: os.pwrite(os.open(f"/proc/self/fd/{frames}", os.O_RDWR), bytes(8), 64),
    "cut the cells": lambda: os.ftruncate(cells, 0),
    "grow the cells": lambda: os.ftruncate(cells, 1 << 20),
    "unseal": lambda: fcntl.fcntl(frames, 1033, 0x8),
}

def fallocate(*arguments):
    import ctypes
    libc = ctypes.CDLL(None, use_errno=True)
    libc.fallocate.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_long, ctypes.c_long]
    if libc.fallocate(*arguments) < 0:
        raise OSError(ctypes.get_errno(), "fallocate")

for what, attempt in tries.items():
    try:
        attempt()
    except OSError as error:
        assert error.errno in (errno.EPERM, errno.EACCES), (what, error)
    else:
        print(what, "was possible")
"""


def test_no_other_process_can_cut_write_or_unseal_the_frames() -> None:
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 3)
        found = subprocess.run([sys.executable, "-c", HOSTILE, str(ring.path)], capture_output=True, text=True)
        assert (found.stdout, found.stderr) == ("\n", "")
        periods(m, 3)
        assert reader.read()["number"].tolist() == [1, 2, 3, 4, 5, 6]


def test_a_kernel_without_the_seal_against_writing_has_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.process.frames.memory.FUTURE_WRITE", 1 << 14)
    with running() as (m, ring, _), Reader(ring.path) as reader:
        assert reader.ends is not None
        periods(m, 3)
        for size in (0, 1 << 30):
            with pytest.raises(PermissionError):
                os.ftruncate(reader.ends.frames, size)
        assert len(reader.read()) == 3


def test_memory_that_can_be_cut_is_not_read() -> None:
    ends, readers = RunDescriptors.pair()
    os.write(ends.frames, bytes(8192))
    with pytest.raises(FramesError, match="not sealed"):
        Reader("bench", readers)
    ends.close()


def test_a_server_that_does_not_answer_costs_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.process.frames.frame_server.ANSWER_TIMEOUT", 0.01)
    ends, readers = RunDescriptors.pair()
    server = FrameServer(new_path("bench"), readers)
    server.listen()
    with pytest.raises(FramesError, match=rf"run \(pid {os.getpid()}\) has not answered for 0.01 s"):
        Reader(server.path)
    server.close()
    ends.close()
    readers.close()


@pytest.mark.parametrize(
    ("state", "is_waited_for"), [("S", True), ("R", True), ("D", True), ("T", False), ("X", False)]
)
def test_who_answers_late_on_a_busy_computer_is_waited_for_and_who_is_stopped_is_not(
    monkeypatch: pytest.MonkeyPatch, state: str, is_waited_for: bool
) -> None:
    """The guardian of a run that had just begun on a busy computer was told as perhaps stopped after 1 s."""
    monkeypatch.setattr(frame_server, "STOPPED_TIMEOUT", 1e-9)
    monkeypatch.setattr(frame_server, "ANSWER_LOOK_INTERVAL", 0.001)
    ends, readers = RunDescriptors.pair()
    server = FrameServer(new_path("bench"), readers)
    server.listen()
    looks: list[int] = []

    def look(pid: int) -> str:
        looks.append(pid)
        if len(looks) == 20:
            server.look()
        return state

    monkeypatch.setattr(processes, "state", look)
    monkeypatch.setattr(processes, "parent_of", lambda pid: 4711)
    monkeypatch.setattr(processes, "name_of", lambda pid: "umo guardian" if pid == 4711 else "")
    if is_waited_for:
        receive(server.path).close()
        assert looks == [4711] * 20
    else:
        with pytest.raises(FramesError, match=r"the guardian of this run (is stopped|has ended) .* \(pid 4711"):
            receive(server.path)
        assert len(looks) < 20
    server.close()
    ends.close()
    readers.close()


def test_a_client_waits_for_its_turn_while_many_others_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    ends, readers = RunDescriptors.pair()
    server = FrameServer(new_path("bench"), readers)
    server.listen()
    for _ in range(MAX_WAITING + 2):  # they have asked, and left again
        assert is_served(server.path)
    answering: list[None] = []
    monkeypatch.setattr(
        "umo.process.frames.frame_server.time.sleep", lambda s: answering or answering.append(server.start())
    )
    receive(server.path).close()
    assert answering
    server.close()
    ends.close()
    readers.close()


def test_a_server_without_a_free_descriptor_answers_as_soon_as_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    accept, failures = socket.socket.accept, [OSError(errno.EMFILE, "Too many open files")]

    def accepted(self: socket.socket) -> Any:
        if failures:
            raise failures.pop()
        return accept(self)

    monkeypatch.setattr(socket.socket, "accept", accepted)
    with running() as (_, ring, _connection), Reader(ring.path) as reader:
        assert reader.alive
    assert not failures


def test_a_server_gives_nothing_to_another_user(monkeypatch: pytest.MonkeyPatch) -> None:
    with running() as (_, ring, _connection):
        monkeypatch.setattr("umo.process.frames.frame_server._maker_and_user", lambda connection: (0, os.getuid() + 1))
        monkeypatch.setattr("umo.process.frames.frame_server.ROOT", -1)
        with pytest.raises(FramesError, match=r"belongs to another user \(uid "):
            Reader(ring.path)
        monkeypatch.setattr("umo.process.frames.frame_server.ROOT", os.getuid())
        monkeypatch.setattr(
            "umo.process.frames.frame_server._maker_and_user",
            lambda connection: (0, 0 if connection.getsockname() == "" else 7),
        )
        with pytest.raises(FramesError, match="another version of umo, or to another user"):
            Reader(ring.path)
