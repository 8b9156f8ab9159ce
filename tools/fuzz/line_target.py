"""A part of the machine on a controller, and its host at the other end of a line, period by period."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from ctypes import c_int32, c_uint8, c_void_p
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

from tools.compiled_machine import CompiledMachine, compiled
from tools.fuzz.host_target import HostBeside
from tools.fuzz.machine import Side
from tools.fuzz.program import Program
from tools.fuzz.stimuli import Stimulus, ticks
from tools.fuzz.target import Beside, Refused, Target
from tools.fuzz.verdict import same
from umo.generate.controller_folder import RUNTIME, TARGETS, NotTranslated, write_folder
from umo.generate.split import part_plan
from umo.generate.split.controller_driver import Controller
from umo.generate.split.part_generator import files_of_plan
from umo.generate.split.part_plan import PartPlan
from umo.generate.struct_memory import StructMemory

LOCKSTEP = Path(__file__).with_name("lockstep.c")
ROOM = 1 << 16
PUMPED = 20
"""Periods within which a controller answers a greeting."""


class LineTarget(Target):
    name = "line"
    clears, restores, early = False, False, 1

    def fit(self, program: Program) -> Program:
        """Interlocks are asked by the host, too, a period later."""
        return program.without_interlocks()

    def stimulus(self, given: Stimulus) -> Stimulus:
        return replace(given, failed=[False] * len(given.failed), deaf=[False] * len(given.deaf))

    def beside(self, python: Side, programs: Sequence[Program], stack: ExitStack) -> Beside:
        controller = Controller(port=1, host_timeout="100 s")
        line = Line(controller, self._compiled)
        controller.place = line  # type: ignore[assignment]
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(part_plan, "settings_of", lambda *_: [])  # this tool sets what it likes
        host = Side([each.loaded() for each in programs], [0, *ticks(self._periods)], controller)
        try:
            stack.enter_context(host)
        except NotTranslated as error:
            raise Refused(programs, error.reasons) from None
        return LineBeside(python, host, line)

    def _compiled(self, plan: PartPlan) -> LockstepMachine:
        folder = self.new_folder()
        files = files_of_plan(replace(plan, target=TARGETS["host"]))
        files |= {"host_access.c": (RUNTIME / "host_access.c").read_text("utf-8")}
        files |= {"umo_fields.c": files["machine_link.c"], "umo_lockstep.c": LOCKSTEP.read_text("utf-8")}
        write_folder(files, folder)
        return LockstepMachine(compiled(folder, *self._flags), plan)


class LockstepMachine(CompiledMachine):
    """A controller with a line, in a library."""

    def __init__(self, library: Path, plan: PartPlan) -> None:
        super().__init__(library, plan.model.inputs, len(plan.model.outputs))
        self._library.lockstep_machine.restype = c_void_p
        self._library.lockstep_period.restype = c_int32
        self._library.lockstep_take.restype = c_int32
        self._machine = c_void_p(self._library.lockstep_machine())  # type: ignore[assignment]
        self.plan = plan
        self._library.lockstep_begin()

    def give(self, data: bytes) -> None:
        self._library.lockstep_give(data, c_int32(len(data)))

    def take(self) -> bytes:
        out = (c_uint8 * ROOM)()
        return bytes(out[: self._library.lockstep_take(out)])

    def period(self, ticks: int, raws: Sequence[int], failed: Sequence[bool], deaf: Sequence[bool]) -> int:
        self._give(raws, failed)
        self._failed_out[: self._outputs] = [int(each) for each in deaf]
        return int(
            self._library.lockstep_period(c_int32(ticks), self._in, self._failed_in, self._failed_out, self._out)
        )


class Line:
    """The line of a controller that is made when its host connects: a place, its dial, and the stream."""

    def __init__(self, controller: Controller, make: Callable[[PartPlan], LockstepMachine]) -> None:
        self._controller, self._make = controller, make
        self._waiting = b""
        self.started = 0
        """Periods in which the laws were called while the host connected."""

    def devices(self) -> Sequence[str]:
        return ()

    def prepared(self) -> bool:
        return True

    def dial(self) -> Line:
        return self

    def __call__(self, deadline: float) -> Line:
        return self

    def without_waiting(self, deadline: float) -> Iterator[Line]:
        yield self

    def close(self) -> None:
        """Nothing."""

    @cached_property
    def c(self) -> LockstepMachine:
        assert self._controller._plan is not None
        return self._make(self._controller._plan)

    def idle(self) -> bool:
        self._waiting += self.c.take()
        return not self._waiting

    def waiting(self) -> bytes:
        self._waiting, found = b"", self._waiting + self.c.take()
        return found

    def receive(self, deadline: float) -> bytes:
        inputs, outputs = self.c._inputs, self.c._outputs
        for _ in range(PUMPED):
            if not self.idle():
                return self.waiting()
            self.started += self.c.period(1, [0] * inputs, [False] * inputs, [False] * outputs) == 0
        raise AssertionError("the controller does not answer")

    def give(self, data: bytes) -> int:
        self.c.give(data)
        return len(data)

    def send(self, data: bytes, deadline: float) -> None:
        self.c.give(data)


class LineBeside(HostBeside):
    """The host acts between its reading and its answer, which the controller has before its period. What is in fault is
    over: the host hears of it a period later, so that its own clearing and inhibiting come later, too."""

    def __init__(self, python: Side, host: Side, line: Line) -> None:
        self._host, self._line, self._machine = host, line, line.c
        super().__init__(python, line.c.plan.model, line.c.plan.translation, line.c)

    def begin(self) -> None:
        """The period in which the controller was started is one of the machine in Python, too."""
        assert self._line.started == LineTarget.early
        self._hear()
        self._python.step()
        self.limited = {n for n, fault in enumerate(self._faults()) if self._kinds[fault] == "ControllerLimit"}

    def place(self, memory: StructMemory) -> tuple[int, str]:
        return self._host.place(memory._struct.owner, memory.path)

    def owner(self, memory: StructMemory) -> Any:
        number, inner = self.place(memory)
        return self._python.at(f"parts.{number}.{inner}") if number >= 0 else None

    def set(self, number: int, name: str, value: Any) -> bool:
        if name not in self._fields[number]:
            return False
        self._host.set(number, name, self._host.own(number, value))
        return True

    def acknowledge(self) -> None:
        self._host.m.acknowledge()

    def period(self, ticks: int, raws: Sequence[int], failed: Sequence[bool], deaf: Sequence[bool]) -> int:
        self._host.m.control()
        self._host.m.update()
        fault = self._machine.period(ticks, raws, failed, deaf)
        self._hear()
        return fault

    def _hear(self) -> None:
        self._host.m.timer.read()
        self._host.m.sample()

    def difference(self, number: int) -> str:
        return super().difference(number) or next(self._not_heard(number), "")

    def _not_heard(self, number: int) -> Iterator[str]:
        """Fields that the host has otherwise than the controller."""
        for memory, _ in self._memories[number]:
            for name in memory.fields:
                host, c = getattr(memory._struct.owner, name), memory.read(name)
                if not same(host, c):
                    yield f"{memory.path}.{name}: the host {host!r}, C {c!r}"
