"""A running modbus_peer (modbus_peer.c, on libmodbus), compiled when it is first asked for."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).with_name("modbus_peer.c")
PATIENT = 30.0
"""s: the timeout of calls that are to succeed, on however busy a machine."""


class Missing(Exception):
    """The peer cannot be made here; says why in one sentence."""


@cache
def program() -> Path:
    """The compiled peer. Raises Missing."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or shutil.which("pkg-config") is None:
        raise Missing("the libmodbus peer needs a C compiler and pkg-config")
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "libmodbus"], capture_output=True, text=True)
    if flags.returncode:
        raise Missing("the libmodbus peer needs Debian's libmodbus-dev")
    _folder.append(tempfile.TemporaryDirectory(prefix="umo-peer-"))
    target = Path(_folder[0].name) / "modbus_peer"
    subprocess.run([compiler, "-O1", "-o", target, SOURCE, *flags.stdout.split()], check=True)
    return target


_folder: list[tempfile.TemporaryDirectory[str]] = []  # removed when the program ends


class Peer:
    """A running modbus_peer and what it logged. `place` is a port number of TCP (0: a free one), or "rtu"."""

    def __init__(self, place: int | str = 0, faults: Sequence[str] = ()) -> None:
        self.process = subprocess.Popen([program(), str(place), *faults], stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        self._pipe = self.process.stdout.fileno()
        self._text = ""
        try:
            at = self.wait_for("port").split()[1]
        except BaseException:
            self.stop()
            raise
        self.path = at if at.startswith("/") else ""
        """The pseudo-terminal; empty on TCP."""
        self.port = 0 if self.path else int(at)

    def wait_for(self, word: str) -> str:
        """The first line that begins with the word; waits until it is there."""
        while True:
            for line in self._text.split("\n")[:-1]:
                if line.startswith(word):
                    return line
            self._take(PATIENT)

    def requests(self) -> list[tuple[int, ...]]:
        """All requests so far: function, address, count and the values of a write."""
        return [tuple(map(int, (words[0].rpartition(":")[2], *words[1:]))) for words in self._logged()]

    def floats(self) -> list[list[float]]:
        """What libmodbus reads of each write of two registers, in the orders ABCD, CDAB, BADC, DCBA."""
        self.requests()
        return [[*map(float, line.split()[1:])] for line in self._text.split("\n")[:-1] if line.startswith("floats")]

    def units(self) -> list[int]:
        """The units that these requests were for, on a serial line."""
        return [int(words[0].partition(":")[0]) for words in self._logged()]

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def _logged(self) -> list[list[str]]:
        while self._take(0.0):
            pass
        lines = (line.split() for line in self._text.split("\n")[:-1])
        return [words for first, *words in lines if first == "request"]

    def _stands(self) -> str:
        """Where the process stands: what runs in it, its state, the kernel's call, its class of scheduling."""
        place = Path(f"/proc/{self.process.pid}")
        told = [(place / name).read_text().strip() for name in ("comm", "wchan", "schedstat", "stat")]
        return f"{told}, {os.sched_getscheduler(self.process.pid)}, {os.sched_getaffinity(self.process.pid)}"

    def _take(self, timeout: float) -> bool:
        if not select.select([self._pipe], [], [], timeout)[0]:
            assert timeout == 0.0, f"the peer said no more than {self._text!r}: {self._stands()}"
            return False
        data = os.read(self._pipe, 65536)
        assert data or timeout == 0.0, f"the peer ended after {self._text!r}"
        self._text += data.decode()
        return bool(data)


@contextmanager
def device(place: int | str = 0, *faults: str) -> Iterator[Peer]:
    """A peer that runs meanwhile."""
    peer = Peer(place, faults)
    try:
        yield peer
    finally:
        peer.stop()


@contextmanager
def running(place: int | str = 0, *faults: str) -> Iterator[Peer]:
    """The same for tests: skipped if the peer cannot be made here."""
    import pytest

    try:
        program()
    except Missing as missing:
        pytest.skip(str(missing))
    with device(place, *faults) as peer:
        yield peer
