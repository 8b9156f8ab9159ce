"""The theta axis of z-theta on a controller: a program of this computer with a stepper motor behind it, which keeps a
record of its outputs. Between it and its host a line may lose, repeat, delay and damage what it carries."""

from __future__ import annotations

import os
import re
import select
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from random import Random
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from helpers.boards import need
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.objects import atoms
from umo.process.station import find
from umo.split.part_generator import part_files

PEERS = Path(__file__).parent / "peers" / "controllers"
COUNTS_PER_STEP = 425
DEFAULTS = [0, 1, 0]
"""Step, direction and encoder_zero at their defaults, as raw integers."""
HOST_GONE, BRAKING = 3, 4
PERIOD, HOST_TIMEOUT, TIMEOUT_PERIODS = "2 ms", "300 ms", 150
"""Longer than the default: other tests may load the computer."""
BRAKING_PERIODS = 500
"""The braking timeout, 1 s by default."""


def theta_wiring(port: int | None, **options: Any) -> dict[str, Any]:
    """Theta on a controller, all else simulated."""
    others = [each.path for each in atoms(find("ztheta").machine()) if not each.path.startswith("theta.")]
    wire: dict[str, Any] = {path: {"driver": "simulated"} for path in others}
    wire["timer"] = {"driver": "timerfd", "period": PERIOD}
    wire["theta"] = {"controller": "drive"}
    return {
        "drivers": {
            "drive": {
                "type": "umo.split.controller_driver:Controller",
                "host_timeout": HOST_TIMEOUT,
                "port": port,
                **options,
            }
        },
        "wire": wire,
    }


def theta_program(folder: Path) -> Path:
    """The controller's program. Warnings are errors."""
    write_folder(part_files(find("ztheta").machine(), theta_wiring(1), "drive", target_of("host")), folder)
    _with_board(folder, "stepper_board.c", "record_stdout.c")
    cc = f"CC=cc -Werror -DCOUNTS_PER_STEP={COUNTS_PER_STEP}"
    subprocess.run(["make", "-s", "-C", folder, "BOARD=stepper_board.c record_stdout.c", cc], check=True)
    return folder / "machine"


def _with_board(folder: Path, *files: str) -> None:
    for each in files:
        shutil.copy(PEERS / each, folder)


def theta_firmware(folder: Path) -> Path:
    """The same for an emulated Cortex-M3. Raises CannotRun."""
    need("arm-none-eabi-gcc", "qemu-system-arm", "make")
    write_folder(part_files(find("ztheta").machine(), theta_wiring(1), "drive", target_of("cortex-m")), folder)
    _with_board(folder, "stepper_board.c", "stepper_mps2.c")
    (folder / "stepper_board.c").replace(folder / "io_board.c")
    (folder / "stepper_mps2.c").replace(folder / "io_link.c")
    cc = f"CC=arm-none-eabi-gcc -Werror -DCOUNTS_PER_STEP={COUNTS_PER_STEP}"
    subprocess.run(["make", "-s", "-C", folder, "machine.elf", cc], check=True)
    return folder / "machine.elf"


class Recorded(NamedTuple):
    """A line of the controller's record: in its own period something changed. `silent` are the periods since it has
    heard its host, as its board counts them."""

    period: int
    mode: int
    silent: int
    outputs: list[int]


class ThetaController:
    """A controller that runs. `port` is where its host finds it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        assert process.stdout is not None
        self._lines = process.stdout
        self.port = int(self._lines.readline())

    def recorded(self) -> Iterator[Recorded]:
        """The record, line by line; each is waited for."""
        for line in self._lines:
            period, mode, silent, *outputs = map(int, line.split())
            yield Recorded(period, mode, silent, outputs)


@contextmanager
def theta_controller(program: Path) -> Iterator[ThetaController]:
    environment = {**os.environ, "UMO_LINK": "0"}
    with subprocess.Popen([program], stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield ThetaController(process)
        finally:
            process.kill()


class EmulatedTheta(ThetaController):
    """The same on an emulated board. `serial` is where its host finds it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        assert process.stdout is not None
        self._lines = process.stdout
        self.serial = re.search(r"/dev/pts/\d+", self._lines.readline())[0]  # type: ignore[index]


@contextmanager
def emulated_theta(elf: Path) -> Iterator[EmulatedTheta]:
    ports = ["-display", "none", "-monitor", "none", "-serial", "pty", "-serial", "stdio"]
    command = ["qemu-system-arm", "-M", "mps2-an385", *ports, "-kernel", elf]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield EmulatedTheta(process)
        finally:
            process.kill()


class BadLine(Thread):
    """A line between host and controller that treats each piece of data badly, by chance. `treated` counts it."""

    def __init__(self, port: int, seed: int, share: float) -> None:
        super().__init__(daemon=True)
        self._random, self._share, self._to = Random(seed), share, port
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.treated = dict.fromkeys(("lost", "repeated", "damaged", "late", "cut"), 0)
        self._ends = False

    def run(self) -> None:
        while not self._ends:
            with suppress(OSError):
                near, _ = self._listening.accept()
                with near, socket.create_connection(("127.0.0.1", self._to)) as far:
                    self._carry(near, far)

    def close(self) -> None:
        self._ends = True
        self._listening.close()

    def _carry(self, near: socket.socket, far: socket.socket) -> None:
        late: list[tuple[float, socket.socket, bytes]] = []
        while not self._ends:
            found, _, _ = select.select([near, far], [], [], 0.005)
            for to, data in [(to, data) for due, to, data in late if due <= monotonic()]:
                to.sendall(data)
            late = [each for each in late if each[0] > monotonic()]
            for one in found:
                data, to = one.recv(4096), far if one is near else near
                if not data:
                    return
                for due, piece in self._treat(data):
                    if due:
                        late.append((monotonic() + due, to, piece))
                    else:
                        to.sendall(piece)

    def _treat(self, data: bytes) -> list[tuple[float, bytes]]:
        if self._random.random() > self._share:
            return [(0.0, data)]
        how = self._random.choice(list(self.treated))
        self.treated[how] += 1
        if how == "lost":
            return []
        if how == "repeated":
            return [(0.0, data), (0.0, data), (0.02, data)]
        if how == "late":
            return [(self._random.uniform(0.0, 0.06), data)]
        at = self._random.randrange(len(data))
        if how == "cut":
            return [(0.0, data[:at])]
        return [(0.0, data[:at] + bytes((data[at] ^ 1 << self._random.randrange(8),)) + data[at + 1 :])]
