"""Parts with states under anything at random: commands, ends and errors of sequences, faults, modes.

In each period: the state in the frame is the one that the standard leads to, and the one whose sequence runs; counts
are right; what is in fault is at its defaults.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Sequence
from enum import IntEnum
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from helpers.machines import actuator, sensor, timer, wired
from helpers.operator import Operator
from helpers.tiers import budget
from umo import Compound, DigitalActuator, DigitalSensor, Frame, connect, published
from umo.control import next_period
from umo.cycle.events import CommandState
from umo.cycle.showing import frame_of
from umo.errors import CommandRefused, TaskFailed
from umo.operation import PackML, PackMLState, Procedure, ProcedureState, UnitMode
from umo.operation.model import title
from umo.operation.unit_states import UnitStates
from umo.process.frames import Reader
from umo.testing import Scripted

# The standards ------------------------------------------------------------------------------------------

PACKML = {
    (source.upper(), "complete" if cause == "ToComplete" else cause.lower()): target.upper()
    for source, target, cause in json.loads((Path(__file__).parents[1] / "helpers/packml_opc30050.json").read_text())
}
"""OPC 30050: where a command, or the end of a sequence (""), leads; some of its states contain others."""
RUNNING, CLEARED = ("STOPPED", "STOPPING", "CLEARING", "ABORTING", "ABORTED"), ("ABORTING", "ABORTED")
for state in PackMLState:
    if state.name not in RUNNING:
        PACKML[state.name, "stop"] = "STOPPING"
    if state.name not in CLEARED:
        PACKML[state.name, "abort"] = "ABORTING"
PACKML = {
    (source, cause): {"RUNNING": "RESETTING", "CLEARED": "CLEARING"}.get(target, target)
    for (source, cause), target in PACKML.items()
    if source not in ("RUNNING", "CLEARED")
} | {("EXECUTE", ""): "COMPLETING"}
AT_WORK = ("RUNNING", "PAUSING", "PAUSED", "HOLDING", "HELD", "RESTARTING")
ISA_88: dict[tuple[str, str], str] = {
    ("IDLE", "start"): "RUNNING",
    ("RUNNING", ""): "COMPLETE",
    ("COMPLETE", "reset"): "IDLE",
    ("STOPPED", "reset"): "IDLE",
    ("RUNNING", "pause"): "PAUSING",
    ("PAUSING", ""): "PAUSED",
    ("PAUSED", "resume"): "RUNNING",
    ("HOLDING", ""): "HELD",
    ("HELD", "restart"): "RESTARTING",
    ("RESTARTING", ""): "RUNNING",
    ("STOPPING", ""): "STOPPED",
    ("ABORTING", ""): "ABORTED",
    ("ABORTED", "clear"): "STOPPED",
    **{(each, "hold"): "HOLDING" for each in ("RUNNING", "PAUSING", "PAUSED", "RESTARTING")},
    **{(each, "stop"): "STOPPING" for each in AT_WORK},
    **{(each.name, "abort"): "ABORTING" for each in ProcedureState if each.name not in CLEARED},
}
"""ISA-88, section 6.3; `clear` is PackML's."""
WAITING = ("HOLDING", "HELD", "UNHOLDING", "SUSPENDING", "SUSPENDED", "UNSUSPENDING", "PAUSING", "PAUSED", "RESTARTING")


# The part -----------------------------------------------------------------------------------------------


class Traced(UnitStates):
    """Each sequence runs until it is let, or made to fail; it tells that it runs."""

    part: Part

    async def _trace(self, name: str) -> None:
        part = self.part
        part.alive[name] += 1
        try:
            while name not in part.may_end:
                if name in part.must_fail:
                    raise TaskFailed("it has failed")
                await next_period()
        finally:
            part.alive[name] -= 1

    async def execute(self) -> None:
        part = self.part
        part.calls += 1
        part.alive["execute"] += 1
        try:
            while "execute" not in part.may_end:
                if "execute" in part.must_fail:
                    raise TaskFailed("it has failed")
                part.motor.write(5.0)
                part.steps += 1
                self.produced += 1
                if part.steps % 3 == 0:
                    part.rejected += 1
                    self.rejected += 1
                await next_period()
        finally:
            part.alive["execute"] -= 1


def traced(base: type[UnitStates], names: Sequence[str], **settings: Any) -> Any:
    """A class with a sequence for each of these states."""

    def sequence(name: str) -> Any:
        async def run(self: Traced) -> None:
            await self._trace(name)

        return run

    return type("States", (Traced, base), {name: sequence(name) for name in names} | settings)


class Part(Compound, equipment=True):
    motor: DigitalActuator
    level: DigitalSensor
    states: Any = None

    def setup(self) -> None:
        self.unit = self.states(self)
        self.alive: Counter[str] = Counter()
        """The sequences that run."""
        self.may_end: set[str] = set()
        self.must_fail: set[str] = set()
        self.calls = self.steps = self.rejected = 0
        """The calls of `execute`, the periods in which it was at work, and its bad products."""


class Plant(Compound):
    part: Part
    timer: DigitalSensor


_P, _I = PackMLState, ProcedureState
SEQUENCES = {
    PackML: [
        "resetting", "starting", "completing", "holding", "unholding", "suspending", "unsuspending", "stopping",
        "aborting", "clearing",
    ],
    Procedure: ["pausing", "holding", "restarting", "stopping", "aborting"],
}  # fmt: skip
EXCLUDED: dict[Any, Sequence[IntEnum]] = {
    PackML: (_P.SUSPENDING, _P.COMPLETING),
    Procedure: (_I.PAUSING,),
}
"""The states that a unit does not have in maintenance."""
COMMANDS: dict[Any, list[str]] = {
    PackML: sorted({cause for _, cause in PACKML if cause}),
    Procedure: sorted({cause for _, cause in ISA_88 if cause}),
}
MODE_CHANGES = {PackML: ("STOPPED", "IDLE", "ABORTED"), Procedure: ("IDLE", "COMPLETE", "STOPPED", "ABORTED")}


class Case:
    """A running plant, and the state in which its part has to be."""

    def __init__(self, base: Any) -> None:
        self.base, self.table = base, PACKML if base is PackML else ISA_88
        self.names: Any = PackMLState if base is PackML else ProcedureState
        self.box = Scripted()
        states = traced(base, SEQUENCES[base], excluded={UnitMode.MAINTENANCE: EXCLUDED[base]})
        machine = Plant(part=Part(motor=actuator(), level=sensor(), states=states), timer=timer())
        self.connection = connect(machine, wired(machine, self.box))
        self.expected = "STOPPED" if base is PackML else "IDLE"
        self.mode, self.manual = UnitMode.PRODUCTION, False
        self.counted = (0, 0)
        """The steps, and the products rejected, when the counts were last set to 0."""
        self.seen = 0
        """The steps of the period before."""
        self.call = 0
        """The call of `execute` that was under way then; 0: none."""
        self.wrong: list[str] = []

    def __enter__(self) -> Case:
        m = self.connection.__enter__()
        self.part, self.unit = m.part, m.part.unit
        self.ring = published(self.connection, "random")
        self.reader = Reader(self.ring.__enter__().path)
        self.signals = [each.path for each in frame_of(self.connection.machine).signals]
        self.ann = Operator(m)
        self.ann.do("lease", seconds=5.0)
        self.connection.machine.observers.append(self.look)
        return self

    def __exit__(self, *error: Any) -> None:
        self.box.broken = None
        self.reader.close()
        self.ring.__exit__(*error)
        self.connection.__exit__(*error)

    # In each period --------------------------------------------------------------------------------------

    def look(self, frame: Frame) -> None:
        """An observer that raises would only be taken off."""
        try:
            self.assert_shown(frame)
        except Exception as error:
            self.wrong.append(f"{frame.time:g} s, {self.expected}: {error!r}")

    def assert_shown(self, frame: Frame) -> None:
        """What is shown is what is."""
        part, unit = self.part, self.unit
        shown = dict(zip(self.signals, frame.signal_values, strict=True))
        state = self.names(int(shown["part.unit.state"]))
        published_frame = self.reader.latest()
        assert published_frame is not None
        assert published_frame["signals"].tolist() == frame.signal_values
        assert unit.state is state
        assert shown["part.unit.mode"] == unit.mode
        assert (part.cycle.fault is not None) is (state.name == "ABORTED")
        running = +part.alive
        works = state.name in ("EXECUTE", "RUNNING")
        assert set(running) <= {
            "execute" if works else state.name.lower(),
            *(["execute"] if state.name in WAITING else []),
        }
        assert set(running.values()) <= {1}
        if self.call and (works or state.name in WAITING):
            assert part.calls == self.call
            assert running["execute"] or "execute" in part.may_end | part.must_fail
        self.call = part.calls if running["execute"] else 0
        worked = part.steps - self.seen
        self.seen = part.steps
        assert worked == 0 or (worked == 1 and works and not self.manual)
        assert (shown["part.unit.produced"], shown["part.unit.rejected"]) == (
            part.steps - self.counted[0],
            part.rejected - self.counted[1],
        )
        if state.name == "ABORTED" and self.box.broken is None:
            assert (part.motor.read(), self.box.get("part.motor")) == (0.0, 0)

    def settle(self, count: int = 3) -> None:
        """Let periods pass: the part is where it has to be, and does what belongs to that."""
        self.ann.run(count)
        assert self.wrong == []
        assert self.unit.state is self.names[self.expected]
        shown = self.unit.describe()["states"][str(int(self.unit.state))]
        assert shown == title(self.unit.state) == self.expected.lower()
        assert set(self.unit.possible) == {each for each in COMMANDS[self.base] if self.target(each)}
        if not self.manual and (name := self.sequence()):
            assert self.part.alive[name] == 1

    # Where it has to be ----------------------------------------------------------------------------------

    def target(self, cause: str) -> str | None:
        """Where a command leads; None: it is refused. An end ("") leads past states that the mode does not have."""
        then = self.table.get((self.expected, cause))
        excluded = EXCLUDED[self.base] if self.mode is UnitMode.MAINTENANCE else ()
        if then is None or (cause and self.manual and not self.acts_in_manual(cause, then, excluded)):
            return None
        if self.names[then] in excluded:
            return None if cause else self.table[then, ""]
        return then

    def acts_in_manual(self, cause: str, then: str, excluded: Collection[IntEnum]) -> bool:
        """Whether a command needs no sequence, which would wait with the application."""
        leads_to_one = then.lower() in SEQUENCES[self.base] and self.names[then] not in excluded
        return cause == "abort" or (cause in ("stop", "clear") and not leads_to_one)

    def sequence(self) -> str:
        """The sequence of the present state; "": it has none."""
        name = self.expected.lower()
        if name in ("execute", "running"):
            return "execute"
        return name if name in SEQUENCES[self.base] else ""

    # What happens ----------------------------------------------------------------------------------------

    def command(self, name: str, by_client: bool) -> None:
        then = self.target(name)
        if by_client:
            event = self.ann.call(f"part.unit.{name}")
            assert event.state is (CommandState.REFUSED if then is None else CommandState.DONE), event.text
        elif then is None:
            with pytest.raises(CommandRefused):
                self.unit.command(name)
        else:
            assert self.unit.command(name) == then.lower()
            assert self.unit.state is self.names[then]
        self.expected = then or self.expected
        if by_client or self.manual:
            self.abort_without_a_sequence()

    def abort_without_a_sequence(self) -> None:
        """In manual mode no sequence runs: what is being aborted is."""
        if self.manual and self.expected == "ABORTING":
            self.ann.run()
            self.expected = "ABORTED"

    def let(self, name: str, gate: set[str], then: str | None) -> None:
        """Let a sequence end, or fail; in manual mode none goes on, and `execute` waits while the part is held."""
        self.settle()
        gate.add(name)
        if name and not self.manual and name == self.sequence():
            self.expected = then or self.expected
        self.settle()
        gate.discard(name)

    def fault(self) -> None:
        self.box.broken = OSError("cut")
        self.expected = "ABORTED"
        self.settle()
        self.box.broken = None
        self.settle()  # it can be cleared as soon as its sensor was read again

    def clear_it(self) -> None:
        """By another way than the unit's own command."""
        self.part.cycle.clear()
        self.ann.run()
        if self.expected == "ABORTED":
            self.expected = self.table["ABORTED", "clear"]

    def change_mode(self) -> None:
        other = UnitMode.MAINTENANCE if self.mode is UnitMode.PRODUCTION else UnitMode.PRODUCTION
        if self.expected in MODE_CHANGES[self.base]:
            self.unit.change_mode(other)
            self.mode = other
        else:
            with pytest.raises(CommandRefused):
                self.unit.change_mode(other)

    def change_machine(self) -> None:
        """From automatic to manual mode, or back."""
        self.settle()
        if not self.manual and self.expected == "ABORTING":
            self.expected = "ABORTED"
        self.manual = not self.manual
        assert self.ann.mode("manual" if self.manual else "automatic").state is CommandState.DONE

    def reset_counters(self) -> None:
        self.unit.reset_counters()
        self.counted = (self.part.steps, self.part.rejected)

    def do(self, step: str, by_client: bool) -> None:
        part = self.part
        others = {
            "end": lambda: self.let(self.sequence(), part.may_end, self.target("")),
            "end of execute": lambda: self.let("execute", part.may_end, self.target("")),
            "error": lambda: self.let(self.sequence(), part.must_fail, "ABORTED"),
            "error of execute": lambda: self.let("execute", part.must_fail, "ABORTED"),
            "fault": self.fault,
            "clear it": self.clear_it,
            "change mode": self.change_mode,
            "manual or automatic": self.change_machine,
            "reset counters": self.reset_counters,
            "wait": self.settle,
        }
        possible = [each for each in COMMANDS[self.base] if self.target(each) and each not in ("stop", "abort")]
        if step in others:
            others[step]()
        elif step == "go on" and self.manual:
            self.change_machine()
        elif step in ("go", "go on"):
            self.command((possible or ["stop"])[-1 if step == "go" else 0], by_client)
        else:
            self.command(step, by_client)


OTHERS = (
    *["go", "go on", "end"] * 12, "end of execute", "error", "error of execute", "fault", "clear it", "change mode",
    "manual or automatic", "reset counters", "wait",
)  # fmt: skip


def check(base: Any, steps: Sequence[tuple[str, bool]]) -> None:
    """Carry out the steps, by a client or the program; then stop in the midst of it."""
    with Case(base) as case:
        for step, by_client in steps:
            case.do(step, by_client)
        case.settle()
    assert (case.box.get("part.motor"), +case.part.alive) == (0, Counter())


def steps_of(base: Any) -> Any:
    step = some.sampled_from([*COMMANDS[base], *OTHERS])
    return some.lists(some.tuples(step, some.booleans()), min_size=20, max_size=60)


@budget(8, 20)
@given(steps_of(PackML))
def test_the_state_of_packml_that_is_shown_is_the_one_that_is(steps: list[tuple[str, bool]]) -> None:
    check(PackML, steps)


@pytest.mark.full
@settings(max_examples=20, deadline=None)
@given(steps_of(Procedure))
def test_the_state_of_a_procedure_that_is_shown_is_the_one_that_is(steps: list[tuple[str, bool]]) -> None:
    check(Procedure, steps)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("base", [PackML, Procedure], ids=["packml", "isa-88"])
def test_over_a_long_time_too(base: Any, seed: int) -> None:
    chance = Random(seed)
    check(base, [(chance.choice([*COMMANDS[base], *OTHERS]), chance.random() < 0.5) for _ in range(400)])
