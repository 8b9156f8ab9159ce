"""The box of box.c: compiled, started, read and disturbed through the file that it maps."""

from __future__ import annotations

import hashlib
import mmap
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from functools import cache
from math import inf
from pathlib import Path
from time import monotonic, monotonic_ns, sleep

from bench.kills.station.cells import CELLS, FAULT, MET, NAME, OUTPUT, PORT, REQUESTS, UNTIL, VALUE

SOURCE = Path(__file__).with_name("box.c")
OUTPUTS = 12
LONGEST_NAME = 31
START_LIMIT = 5.0
"""s."""


@cache
def missing() -> str | None:
    """Why there cannot be such a box here, if so."""
    if not sys.platform.startswith("linux"):
        return "processes of their own need Linux"
    if shutil.which("gcc") is None or shutil.which("pkg-config") is None:
        return "the box needs gcc and pkg-config"
    if subprocess.run(["pkg-config", "--exists", "libmodbus"], check=False).returncode:
        return "the box needs libmodbus (Debian's libmodbus-dev)"
    return None


@cache
def program() -> Path:
    """The compiled box, kept in the user's cache under the name of its source's hash."""
    name = f"box-{hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]}"
    target = _cache() / name
    if not target.exists():
        flags = subprocess.run(["pkg-config", "--cflags", "--libs", "libmodbus"], capture_output=True, text=True)
        new = target.with_name(f"{name}.{threading.get_native_id()}")  # the first tries begin at once
        subprocess.run(["gcc", "-O2", "-Wall", "-o", str(new), str(SOURCE), *flags.stdout.split()], check=True)
        new.replace(target)
    return target


def _cache() -> Path:
    path = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "umo-bench"
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="umo-bench-"))
    return path


class Box:
    """One running box. Start it in the main thread: it dies with the thread that started it."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "box.cells"
        self.file.write_bytes(bytes(8 * CELLS))
        with self.file.open("r+b") as opened:
            self._map = mmap.mmap(opened.fileno(), 8 * CELLS)
        self.cells = memoryview(self._map).cast("q")
        self._process = subprocess.Popen([str(program()), str(self.file)])
        until = monotonic() + START_LIMIT
        while not self.cells[PORT]:
            if self._process.poll() is not None or monotonic() > until:
                self.close()
                raise RuntimeError("the box did not start")
            sleep(0.001)

    @property
    def port(self) -> int:
        return self.cells[PORT]

    @property
    def requests(self) -> int:
        return self.cells[REQUESTS]

    @property
    def met(self) -> int:
        """How many requests or connections met a fault."""
        return self.cells[MET]

    @property
    def values(self) -> list[int]:
        """Levels of the outputs: 10 coils, 2 registers. 0 is the default of each."""
        return [self.cells[OUTPUT + 3 * i] for i in range(OUTPUTS)]

    @property
    def since(self) -> int:
        """Time at which the last output came to its default, ns of CLOCK_MONOTONIC; 0 while one is not there."""
        moments = [self.cells[OUTPUT + 3 * i + 1] for i in range(OUTPUTS)]
        return max(moments) if all(moments) else 0

    @property
    def left(self) -> int:
        """How often an output left its default, all together."""
        return sum(self.cells[OUTPUT + 3 * i + 2] for i in range(OUTPUTS))

    @property
    def faulty(self) -> bool:
        """A fault is switched on, and its time has not ended."""
        until = self.cells[UNTIL]
        return bool(self.cells[FAULT]) and (not until or monotonic_ns() < until)

    @property
    def answers_for(self) -> float:
        """s since the end of a fault whose time has ended; below 0: it lasts. Infinite without a fault."""
        until = self.cells[UNTIL] if self.cells[FAULT] else 0
        return (monotonic_ns() - until) * 1e-9 if until else inf

    def fault(self, name: str, value: int = 0, seconds: float = 0.0) -> None:
        """Switch a fault of box.c on, for so many seconds (0: until `heal`)."""
        self.cells[FAULT] = 0
        self.cells[VALUE] = value
        self.cells[UNTIL] = monotonic_ns() + round(seconds * 1e9) if seconds else 0
        self._map[8 * NAME : 8 * NAME + LONGEST_NAME + 1] = name.encode().ljust(LONGEST_NAME + 1, b"\0")
        self.cells[FAULT] = 1

    def heal(self) -> None:
        self.cells[FAULT] = 0

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self.cells.release()
        self._map.close()
