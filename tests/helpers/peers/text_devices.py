"""Devices that speak in lines: a power supply in POSIX shell behind socat (text_supply.sh), and an emulated AVR with
firmware in C (text_avr/). Both are built or started when they are asked for."""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

PEERS = Path(__file__).parent
PATIENT = 30.0
"""s: for calls that are to succeed, on however busy a machine."""
_kept: list[tempfile.TemporaryDirectory[str]] = []  # removed when the program ends


class CannotRun(Exception):
    """The device cannot be made here; says why in one sentence."""


@dataclass
class Supply:
    """A running supply on a port of 127.0.0.1."""

    port: int
    folder: Path
    process: subprocess.Popen[bytes]

    def lines(self) -> list[str]:
        """What it got so far."""
        log = self.folder / "log"
        return log.read_text().splitlines() if log.exists() else []


@contextmanager
def supply(port: int = 0, folder: Path | None = None) -> Iterator[Supply]:
    """Raises CannotRun."""
    if shutil.which("socat") is None:
        raise CannotRun("the SCPI supply needs Debian's socat")
    with tempfile.TemporaryDirectory(prefix="umo-supply-") as made:
        place = folder or Path(made)
        listen = f"TCP-LISTEN:{port},bind=127.0.0.1,reuseaddr,fork,nodelay"
        command = ["socat", "-d", "-d", listen, f"EXEC:sh {PEERS / 'text_supply.sh'} {place}"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, bufsize=0, start_new_session=True) as process:
            assert process.stderr is not None
            log = threading.Thread(target=process.stderr.read, daemon=True)
            try:
                said = _wait_for(process.stderr, r"listening on .*:(\d+)")
                log.start()  # a full pipe would stop socat
                yield Supply(int(said[1]), place, process)
            finally:
                os.killpg(process.pid, signal.SIGTERM)  # socat makes a process for each connection
                if log.is_alive():
                    log.join(PATIENT)


def simavr_flags() -> list[str]:
    """The compiler's, for a program that emulates an AVR. Raises CannotRun."""
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "simavr"], capture_output=True, text=True)
    if flags.returncode:  # Debian's libsimavr-dev requires libelf.pc, and does not depend on its package
        raise CannotRun("the emulated AVR needs Debian's libsimavr-dev and libelf-dev")
    return flags.stdout.split()


@cache
def emulator() -> Path:
    """The program that emulates an AVR, made here. Raises CannotRun."""
    for tool, package in (("avr-gcc", "gcc-avr and avr-libc"), ("cc", "gcc"), ("pkg-config", "pkg-config")):
        if shutil.which(tool) is None:
            raise CannotRun(f"the emulated AVR needs Debian's {package}")
    flags = simavr_flags()
    _kept.append(tempfile.TemporaryDirectory(prefix="umo-avr-"))
    folder = Path(_kept[-1].name)
    board = folder / "board"
    warnings = ["-Wall", "-Wextra", "-Werror"]
    source = str(PEERS / "text_avr" / "board.c")
    subprocess.run(["cc", "-O2", *warnings, "-o", board, source, *flags, "-lutil"], check=True)
    return board


@cache
def built(source: Path, *options: str) -> Path:
    """The firmware made of a C or C++ source. Raises CannotRun."""
    emulator()
    target = Path(_kept[-1].name) / f"{source.stem}.elf"
    compiler = "avr-gcc" if source.suffix == ".c" else "avr-g++"
    machine = ["-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os"]
    subprocess.run([compiler, *machine, *options, "-o", target, source], check=True)
    return target


@contextmanager
def avr(elf: Path | None = None) -> Iterator[str]:
    """The path of the board's serial line; it has said "ready". Raises CannotRun."""
    firmware = elf or built(PEERS / "text_avr" / "instrument.c", "-Wall", "-Wextra", "-Werror")
    with subprocess.Popen([emulator(), firmware], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        assert process.stdin is not None and process.stdout is not None
        try:
            yield _wait_for(process.stdout, r"pty (/\S+)")[1]
        finally:
            process.stdin.close()


@contextmanager
def quick() -> Iterator[int]:
    """The port of the device of the bench (text_bench.c). Raises CannotRun."""
    if shutil.which("cc") is None:
        raise CannotRun("the device of the bench needs a C compiler")
    with tempfile.TemporaryDirectory(prefix="umo-lines-") as folder:
        program = Path(folder) / "text_bench"
        subprocess.run(["cc", "-O2", "-Wall", "-o", program, PEERS / "text_bench.c"], check=True)
        with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
            assert process.stdin is not None and process.stdout is not None
            try:
                yield int(_wait_for(process.stdout, r"port (\d+)")[1])
            finally:
                process.terminate()


def _wait_for(output: IO[bytes], pattern: str) -> re.Match[str]:
    """The first line that holds the pattern; `output` is not buffered, so `select` sees what is left."""
    while select.select([output], [], [], PATIENT)[0]:
        line = output.readline().decode()
        if found := re.search(pattern, line):
            return found
        assert line, "the device ended"
    raise AssertionError(f"the device did not say {pattern}")
