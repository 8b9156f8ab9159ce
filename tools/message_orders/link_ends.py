"""Both ends of a link on a line of a schedule: the generated program of the controller, and the driver of the host."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import CDLL, c_int, c_int16, c_int32, c_uint8, c_uint16, c_void_p, string_at
from pathlib import Path
from typing import Any, ClassVar
from unittest.mock import patch

from tools.message_orders.line import Line
from umo.drivers.streams import TimedOut
from umo.drivers.streams.stream import Dial, Stream
from umo.generate.c_compiler import FLAGS, compiler
from umo.generate.split.controller_driver import Controller
from umo.generate.split.link_bodies import ControllerState
from umo.generate.split.part_plan import PartPlan
from umo.objects import Compound
from umo.system import calls
from umo.wiring.wired import Wired

TO_CONTROLLER, TO_HOST = 0, 1
BOARD = Path(__file__).with_name("link_board.c")
LOOP = ("main_link.c", "link_host.c", "io_board.c")


class ControllerProgram:
    """The program of a generated folder, whose periods are calls."""

    def __init__(self, library: Path, outputs: int) -> None:
        self._lib: Any = CDLL(str(library))
        self._lib.orders_field.restype = c_void_p
        self._sent = c_int32.in_dll(self._lib, "orders_sent")
        self._line = (c_uint8 * 1).in_dll(self._lib, "orders_line")
        self._outputs = (c_int32 * outputs).in_dll(self._lib, "orders_outputs")

    def power_up(self) -> None:
        self._lib.orders_power_up()

    def period(self, raws: Sequence[int], data: bytes, ticks: int = 1) -> bytes:
        """One period: what the controller says in it."""
        self._lib.orders_period(c_int32(ticks), (c_int32 * len(raws))(*raws), data, c_int32(len(data)))
        return string_at(self._line, self._sent.value) if self._sent.value else b""

    @property
    def outputs(self) -> list[int]:
        return list(self._outputs)

    @property
    def mode(self) -> int:
        return int(self._lib.orders_mode())

    @property
    def session(self) -> int:
        return int(self._lib.orders_session())

    @property
    def heard(self) -> int:
        return int(self._lib.orders_heard())

    @property
    def silent(self) -> int:
        """Periods since the last frame of the host that it has carried out."""
        return int(self._lib.orders_silent())

    def fault(self, equipment: int) -> int:
        return int(self._lib.orders_fault(c_int16(equipment)))

    def number(self, field: int) -> int:
        """A field that is an integer."""
        return c_int.from_address(self._lib.orders_field(c_uint16(field))).value


def compiled(folder: Path) -> Path:
    """The library of a generated folder, with its own loop and a board of the schedules."""
    shutil.copy(BOARD, folder)
    library, loop = folder / "orders.so", folder / "loop.o"
    cc = compiler()
    assert cc is not None
    common = [cc, *FLAGS, "-fPIC", f"-I{folder}"]
    subprocess.run([*common, "-Dmain=controller_main", "-c", "-o", loop, folder / "main_link.c"], check=True)
    sources = [*folder.glob("umo_*.c"), *(folder / name for name in ("machine.c", "machine_link.c", BOARD.name))]
    subprocess.run([*common, "-shared", "-o", library, loop, *sources, "-lm"], check=True)
    return library


class LineWorld:
    """Who lets the virtual time of a line pass while an end waits."""

    line: Line

    def advance(self, until: float) -> None:
        """Let time pass up to `until` at most."""
        raise NotImplementedError

    def plan(self, plan: PartPlan) -> None:
        """The host knows the plan of the part."""
        raise NotImplementedError

    def told(self, state: ControllerState) -> None:
        """The host takes this for the state of the controller."""
        raise NotImplementedError


class LineStream(Stream):
    """The host's end of a line, in place of a serial line. What is under way while it is closed comes all the same."""

    def __init__(self, world: LineWorld) -> None:
        self._world, self._line = world, world.line

    def close(self) -> None:
        pass

    def idle(self) -> bool:
        return not self._line.has_come(TO_HOST)

    def waiting(self) -> bytes:
        return self._line.arrived(TO_HOST)

    def receive(self, deadline: float) -> bytes:
        while self.idle():
            if self._line.now >= deadline:
                raise TimedOut
            self._world.advance(deadline)
        return self.waiting()

    def give(self, data: bytes) -> int:
        self._line.send(TO_CONTROLLER, data)
        return len(data)

    def send(self, data: bytes, deadline: float) -> None:
        self.give(data)


class LineDial(Dial):
    def __call__(self, deadline: float) -> Stream:
        return LineStream(LineController.world)

    def without_waiting(self, deadline: float) -> Iterator[Stream | None]:
        yield self(deadline)


class LineController(Controller):
    """The driver of the host on the line of the schedule that is under way."""

    world: ClassVar[LineWorld]

    def open(self) -> None:
        self.place = _Here()  # type: ignore[assignment]
        super().open()

    def devices(self) -> Sequence[str]:
        return ()

    def take_part(self, part: Compound, wired: Wired) -> PartPlan:
        plan = super().take_part(part, wired)
        if hasattr(LineController, "world"):
            self.world.plan(plan)
        return plan

    def _heard(self) -> ControllerState:
        state = super()._heard()
        self.world.told(state)
        return state


class _Here:
    """Where the controller is."""

    def devices(self) -> Sequence[str]:
        return ()

    def dial(self) -> Dial:
        return LineDial()


@contextmanager
def virtual_time(world: LineWorld) -> Iterator[None]:
    """The clock of the line in place of the computer's."""
    line = world.line
    LineController.world = world

    def sleep(seconds: float) -> None:
        until = line.now + seconds
        while line.now < until:
            world.advance(until)

    with patch.multiple(calls, now=lambda: line.now, sleep=sleep):
        yield
