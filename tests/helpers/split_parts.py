"""Parts of stations on controllers: the theta axis of z-theta and a zone of the furnace. A controller is a program of
this computer or an emulated board, with a plant behind it, and keeps a record of its outputs. Between it and its host
a line may lose, repeat, delay and damage what it carries."""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import socket
import subprocess
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from helpers.boards import need
from helpers.peers.text_devices import emulator
from helpers.runs import Run
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.generate.split.part_generator import part_files
from umo.objects import atoms
from umo.process.station import find
from umo.stations.furnace.objects import machine as furnace

PEERS = Path(__file__).parent / "peers" / "controllers"
HOST_GONE, BRAKING = 3, 4
CONTROLLER = "umo.generate.split.controller_driver:Controller"
PERIOD, HOST_TIMEOUT, TIMEOUT_PERIODS = "2 ms", "300 ms", 150
"""Longer than the default: other tests may load the computer."""
BRAKING_PERIODS = 500
"""The braking timeout, 1 s by default."""


@dataclass(frozen=True)
class EmulatedBoard:
    """A board that is emulated. `options`: of its controller in a wiring. `command` runs a firmware."""

    target: str
    tools: Sequence[str]
    files: Mapping[str, str]
    variables: Sequence[str]
    options: Mapping[str, Any]
    timeout_periods: int
    braking_periods: int
    command: Callable[[Path], list[str | Path]]


def _arm(elf: Path) -> list[str | Path]:
    ports = ["-display", "none", "-monitor", "none", "-serial", "pty", "-serial", "stdio"]
    return ["qemu-system-arm", "-M", "mps2-an385", *ports, "-kernel", elf]


ARM = EmulatedBoard(
    "cortex-m",
    ("arm-none-eabi-gcc", "qemu-system-arm", "make"),
    {"recorded_board.c": "io_board.c", "link_mps2.c": "io_link.c"},
    ["CC=arm-none-eabi-gcc -Werror"],
    {},
    TIMEOUT_PERIODS,
    BRAKING_PERIODS,
    _arm,
)
"""A Cortex-M3."""
AVR = EmulatedBoard(
    "avr",
    ("avr-gcc", "make"),
    {"recorded_board.c": "io_board.c", "tick_avr.c": "umo_tick.c"},
    ["MCU=atmega2560", "CC=avr-gcc -Werror -DBAUD=500000UL"],
    {"real": "float", "cycle": "3 ms"},
    100,
    333,
    lambda elf: [emulator(), elf, "atmega2560"],
)
"""An ATmega2560 with floats and a period of its own. Its end of the line is the io_link.c that is generated."""


@dataclass(frozen=True)
class SplitPart:
    """A part of a station that runs on a controller. `defaults`: of its outputs, as raw integers."""

    machine: Callable[[], Any]
    path: str
    plant: str
    defaults: Sequence[int]

    def wiring(self, port: int | None, **options: Any) -> dict[str, Any]:
        """The part on a controller, all else simulated."""
        others = [each.path for each in atoms(self.machine()) if not each.path.startswith(f"{self.path}.")]
        wire: dict[str, Any] = {path: {"driver": "simulated"} for path in others}
        wire["timer"] = {"driver": "timerfd", "period": PERIOD}
        wire[self.path] = {"controller": "drive"}
        drive = {"type": CONTROLLER, "host_timeout": HOST_TIMEOUT, "port": port, **options}
        return {"drivers": {"drive": drive}, "wire": wire}

    def _folder(self, folder: Path, target: str, **options: Any) -> None:
        write_folder(part_files(self.machine(), self.wiring(1, **options), "drive", target_of(target)), folder)
        shutil.copy(PEERS / self.plant, folder / "umo_plant.c")

    def program(self, folder: Path, **options: Any) -> Path:
        """The controller's program. Warnings are errors."""
        self._folder(folder, "host", **options)
        return program_of(folder)

    def firmware(self, folder: Path, board: EmulatedBoard) -> Path:
        """The same for an emulated board. Raises CannotRun."""
        need(*board.tools)
        self._folder(folder, board.target, **board.options)
        for source, name in board.files.items():
            shutil.copy(PEERS / source, folder / name)
        subprocess.run(["make", "-s", "-C", folder, "machine.elf", *board.variables], check=True)
        return folder / "machine.elf"


def program_of(folder: Path) -> Path:
    """The program of a generated folder that has a plant, with a record. Warnings are errors."""
    for each in ("recorded_board.c", "record_stdout.c"):
        shutil.copy(PEERS / each, folder)
    made = ["BOARD=recorded_board.c record_stdout.c", "CC=cc -Werror"]
    subprocess.run(["make", "-s", "-C", folder, *made], check=True)
    return folder / "machine"


COUNTS_PER_STEP = 425
THETA = SplitPart(find("ztheta").machine, "theta", "stepper_plant.c", [0, 1, 0])
ZONE = SplitPart(partial(furnace, 1, 1), "zones.0", "zone_plant.c", [0, 1])


def machine() -> Any:
    """The furnace with one zone, for a run with processes of its own."""
    return ZONE.machine()


async def heat_zone(m: Any) -> None:
    """Its application."""
    m.frozen_after = 10_000  # readings of 2 ms, and not of 100 ms
    await m.heat_up(110.0, 4.0)


class Recorded(NamedTuple):
    """A line of the controller's record: in its own period something changed. `silent` are the periods since it has
    heard its host, as its board counts them."""

    period: int
    mode: int
    silent: int
    outputs: list[int]


class RunningController:
    """A controller that runs. `port` is where its host finds it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self._output, self._rest = process.stdout, b""
        self.pid = process.pid
        self.port = int(self._output.readline())

    def recorded(self, run: Run | None = None) -> Iterator[Recorded]:
        """The record, line by line; each is waited for. It is an error if `run` ends first."""
        while True:
            while b"\n" in self._rest:
                line, _, self._rest = self._rest.partition(b"\n")
                period, mode, silent, *outputs = map(int, line.split())
                yield Recorded(period, mode, silent, outputs)
            if run is not None:
                run.goes_on_until(self._output.fileno())
            data = os.read(self._output.fileno(), 4096)
            if not data:
                return
            self._rest += data


@contextmanager
def controller_of(program: Path, stderr: int | None = None) -> Iterator[RunningController]:
    environment = {**os.environ, "UMO_LINK": "0"}
    pipe = subprocess.PIPE
    with subprocess.Popen([program], bufsize=0, stdout=pipe, stderr=stderr, env=environment) as process:
        try:
            yield RunningController(process)
        finally:
            process.kill()


class EmulatedController(RunningController):
    """The same on an emulated board. `serial` is where its host finds it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self._output, self._rest = process.stdout, b""
        self.pid = process.pid
        found = (re.search(rb"/dev/pts/\d+", line) for line in self._output)
        self.serial = next(each[0].decode() for each in found if each)


@contextmanager
def emulated_controller(board: EmulatedBoard, elf: Path) -> Iterator[EmulatedController]:
    pipe = subprocess.PIPE
    with subprocess.Popen(board.command(elf), bufsize=0, stdin=pipe, stdout=pipe) as process:
        try:
            yield EmulatedController(process)
        finally:
            process.kill()


def _run_host(host: Callable[[], object], controller: RunningController) -> None:
    """Until it is killed: a host that fails, as on a busy computer, begins anew. If it fails again and again, its
    controller ends."""
    try:
        for _ in range(5):
            try:
                host()
            except Exception:
                traceback.print_exc()
    finally:
        os.kill(controller.pid, signal.SIGKILL)
        os._exit(1)


@contextmanager
def host_beside(host: Callable[[], object], controller: RunningController) -> Iterator[None]:
    """A host in a process of its own, which is killed at the end."""
    process = os.fork()
    if not process:
        _run_host(host, controller)
    try:
        yield
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


def kill_hosts(
    times: int, host: Callable[[int], object], acts: Callable[[Recorded], bool], controller: RunningController
) -> list[list[Recorded]]:
    """Let a host run in a process of its own and kill it while it acts, so many times. For each, what the controller
    recorded afterwards, up to where its outputs are at their defaults because the host is gone."""
    found, record = list[list[Recorded]](), controller.recorded()
    for number in range(times):
        with host_beside(partial(host, number), controller):
            left = 5 + number % 7 * 11
            while left:
                left -= acts(next(record))
        found.append([])
        while not found[-1] or found[-1][-1].mode != HOST_GONE:
            found[-1].append(next(record))
    return found


class BadLine(Thread):
    """A line between host and controller that treats each piece of data badly, by chance. `treated` counts it. While it
    is `away` it carries nothing, and takes no connection."""

    def __init__(self, port: int, seed: int, share: float) -> None:
        super().__init__(daemon=True)
        self._random, self._share, self._to = Random(seed), share, port
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.treated = dict.fromkeys(("lost", "repeated", "damaged", "late", "cut"), 0)
        self.away = self._ends = False

    def run(self) -> None:
        while not self._ends:
            with suppress(OSError):
                near, _ = self._listening.accept()
                if self.away:
                    near.close()
                    continue
                with near, socket.create_connection(("127.0.0.1", self._to)) as far:
                    self._carry(near, far)

    def close(self) -> None:
        self._ends = True
        self._listening.shutdown(socket.SHUT_RDWR)  # or it waits for a connection for ever
        self._listening.close()
        self.join(10)

    def _carry(self, near: socket.socket, far: socket.socket) -> None:
        late: list[tuple[float, socket.socket, bytes]] = []
        while not (self._ends or self.away):
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
