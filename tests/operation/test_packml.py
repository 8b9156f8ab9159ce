"""States of a part after PackML and ISA-88: every transition of the standard, faults, holds, modes.

The oracle is OPC 30050's NodeSet2, from which `tools/packml_transitions.py` made `helpers/packml_opc30050.json`.
"""

from __future__ import annotations

import json
from collections import deque
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, sensor, timer, wired
from helpers.operator import Operator
from helpers.tiers import budget, first
from umo import Compound, DigitalActuator, DigitalSensor, Number, connect, published
from umo.control import next_period, until, wait
from umo.cycle.events import CommandState
from umo.cycle.showing import frame_of
from umo.errors import CommandRefused, DeclarationError, EquipmentFault, TaskFailed
from umo.objects import action, actions_of
from umo.operation import PackML, PackMLState, Procedure, ProcedureState, UnitMode
from umo.operation.commands.client_commands import Mode
from umo.operation.model import sequence_name
from umo.operation.packml import PACKML
from umo.testing import Scripted, periods

S = PackMLState
ORACLE = json.loads((Path(__file__).parents[1] / "helpers" / "packml_opc30050.json").read_text())
ACTING = ("resetting", "starting", "completing", "holding", "unholding", "suspending", "unsuspending", "stopping")
"""The acting states whose ends the tests decide on; `execute`, `aborting` and `clearing` too."""
COMMANDS = {"ToComplete": "complete"}
SUPER = {"Running", "Cleared"}
"""States of the standard that contain others."""


def inside(name: str) -> list[str]:
    """The states that a state of the standard contains, or itself."""
    leaves = {each for source, target, _ in ORACLE for each in (source, target)} - SUPER
    outside = {
        "Running": {"Stopped", "Stopping", "Clearing", "Aborting", "Aborted"},
        "Cleared": {"Aborting", "Aborted"},
    }
    return sorted(leaves - outside[name]) if name in SUPER else [name]


ENTERED = {"Running": "Resetting", "Cleared": "Clearing"}
"""The state in which a state that contains others begins."""


def state(name: str) -> PackMLState:
    return S[name.upper()]


AS_THE_STANDARD_SAYS = {
    (state(each), COMMANDS.get(cause, cause.lower())): state(ENTERED.get(target, target))
    for source, target, cause in ORACLE
    for each in inside(source)
}
"""Where a command, or the end of a sequence (""), leads."""


class Gated(PackML):
    """Each sequence ends when the test lets it."""

    part: Unit

    async def _gate(self, name: str) -> None:
        self.part.begun.append(name)
        try:
            await until(lambda: name in self.part.open)
        finally:
            self.part.ended.append(name)

    async def execute(self) -> None:
        await self._gate("execute")

    async def resetting(self) -> None:
        await self._gate("resetting")

    async def starting(self) -> None:
        await self._gate("starting")

    async def completing(self) -> None:
        await self._gate("completing")

    async def holding(self) -> None:
        await self._gate("holding")

    async def unholding(self) -> None:
        await self._gate("unholding")

    async def suspending(self) -> None:
        await self._gate("suspending")

    async def unsuspending(self) -> None:
        await self._gate("unsuspending")

    async def stopping(self) -> None:
        await self._gate("stopping")

    async def aborting(self) -> None:
        await self._gate("aborting")

    async def clearing(self) -> None:
        await self._gate("clearing")


class Unit(Compound, equipment=True):
    motor: DigitalActuator
    level: DigitalSensor
    states: Any = Gated
    beside: Any = None
    odd = False

    def setup(self) -> None:
        self.unit = self.states(self)
        self.open: set[str] = set()
        """The names of the sequences that may end."""
        self.begun: list[str] = []
        self.ended: list[str] = []


class Plant(Compound):
    filler: Unit
    timer: DigitalSensor


def plant(states: Any = Gated) -> Plant:
    return Plant(filler=Unit(motor=actuator(), level=sensor(), states=states), timer=timer())


class running:
    """A connected plant."""

    def __init__(self, states: Any = Gated) -> None:
        self.box = Scripted()
        machine = plant(states)
        self.connection = connect(machine, wired(machine, self.box))

    def __enter__(self) -> tuple[Any, Any]:
        self.m = self.connection.__enter__()
        periods(self.m)
        return self.m, self.m.filler.unit

    def __exit__(self, *error: Any) -> None:
        self.box.broken = None
        self.connection.__exit__(*error)


def finish(m: Any) -> None:
    """Let the sequence of the present state end."""
    name = m.filler.unit.state.name.lower()
    periods(m, 2)
    m.filler.open.add(name)
    periods(m, 2)
    m.filler.open.discard(name)


def lead_to(m: Any, wanted: PackMLState) -> None:
    """Bring a stopped unit into a state, by the shortest way of the standard."""
    ways: dict[PackMLState, list[str]] = {S.STOPPED: []}
    queue = deque([S.STOPPED])
    while queue:
        at = queue.popleft()
        for (source, cause), target in AS_THE_STANDARD_SAYS.items():
            if source is at and target not in ways:
                ways[target] = [*ways[at], cause]
                queue.append(target)
    for cause in ways[wanted]:
        if cause:
            m.filler.unit.command(cause)
            periods(m)
        else:
            finish(m)
    assert m.filler.unit.state is wanted


def test_the_model_is_that_of_the_standard() -> None:
    known = {(each, name): then for name, targets in PACKML.commands.items() for each, then in targets.items()}
    assert known | {(each, ""): then for each, then in PACKML.acting.items() if each is not S.EXECUTE} == {
        key: then for key, then in AS_THE_STANDARD_SAYS.items() if key[1] or key[0] is not S.EXECUTE
    }
    assert PACKML.acting[S.EXECUTE] is S.COMPLETING


@pytest.mark.parametrize("at", list(S), ids=lambda each: each.name.lower())
def test_each_command_is_accepted_or_refused_as_the_standard_says(at: PackMLState) -> None:
    for command in PACKML.commands:
        with running() as (m, unit):
            lead_to(m, at)
            target = AS_THE_STANDARD_SAYS.get((at, command))
            if target is None:
                with pytest.raises(CommandRefused, match=f"{command} is not possible in the state {at.name.lower()}"):
                    unit.command(command)
                assert unit.state is at
                assert command not in unit.possible
            else:
                assert command in unit.possible
                assert unit.command(command) == target.name.lower()
                assert unit.state is target


@pytest.mark.parametrize("at", list(PACKML.acting), ids=lambda each: each.name.lower())
def test_the_end_of_a_sequence_leads_where_the_standard_says(at: PackMLState) -> None:
    with running() as (m, unit):
        lead_to(m, at)
        periods(m, 5)
        assert unit.state is at
        finish(m)
        assert unit.state is (S.COMPLETING if at is S.EXECUTE else AS_THE_STANDARD_SAYS[at, ""])


def test_execute_waits_while_the_part_is_held_and_goes_on_from_where_it_was() -> None:
    class Counting(PackML):
        async def execute(self) -> None:
            while True:
                await wait("3 ms")
                self.produced += 1

    with running(Counting) as (m, unit):
        for command in ("reset", "start"):
            unit.command(command)
            periods(m, 3)
        periods(m, 31)
        assert unit.state is S.EXECUTE
        made = unit.produced
        assert made >= 9
        unit.hold()
        periods(m, 300)
        assert (unit.state, unit.produced) == (S.HELD, made)
        unit.unhold()
        periods(m, 31)
        assert unit.state is S.EXECUTE
        assert made + 9 <= unit.produced <= made + 11


def test_a_stop_cancels_what_is_under_way_and_its_cleaning_up_is_done() -> None:
    with running() as (m, unit):
        lead_to(m, S.EXECUTE)
        periods(m, 2)
        unit.stop()
        assert m.filler.ended[-1] == "execute"
        periods(m, 2)
        assert m.filler.begun[-1] == "stopping"


def test_what_is_held_begins_anew_after_a_stop() -> None:
    with running() as (m, unit):
        lead_to(m, S.HELD)
        unit.stop()
        finish(m)
        begun = m.filler.begun.count("execute")
        lead_to(m, S.EXECUTE)
        periods(m, 2)
        assert m.filler.begun.count("execute") == begun + 1


def test_acting_states_without_a_sequence_are_passed_in_the_same_period() -> None:
    with running(PackML) as (m, unit):
        unit.reset()
        periods(m)
        assert unit.state is S.IDLE
        unit.start()
        periods(m)
        assert unit.state is S.EXECUTE
        periods(m, 100)
        assert unit.state is S.EXECUTE  # by default it does not end


def test_an_error_in_a_sequence_aborts_and_the_machine_goes_on() -> None:
    class Failing(PackML):
        async def execute(self) -> None:
            self.part.motor.write(5.0)  # type: ignore[attr-defined]
            await wait("10 ms")
            raise TaskFailed("the bottle is missing")

    with running(Failing) as (m, unit):
        unit.reset()
        periods(m)
        unit.start()
        periods(m, 5)
        assert m.filler.motor.read() == 5.0
        periods(m, 10)
        assert unit.state is S.ABORTED
        assert m.filler.motor.read() == 0.0
        assert m.filler.cycle.fault == "the bottle is missing"
        assert m.cycle.running
        unit.clear()
        periods(m, 2)
        assert unit.state is S.STOPPED


def test_a_fault_of_the_equipment_is_aborted_and_its_clearing_leads_to_stopped() -> None:
    case = running()
    with case as (m, unit):
        lead_to(m, S.EXECUTE)
        case.box.broken = OSError("cut")
        m.timer.read()
        m.sample()
        assert unit.state is S.ABORTED  # in the same period, whoever asks
        case.box.broken = None
        with pytest.raises(CommandRefused, match="possible: clear"):
            unit.start()
        periods(m, 2)
        m.filler.cycle.clear()  # by any way
        m.filler.open.add("clearing")
        periods(m, 3)
        assert unit.state is S.STOPPED


class Fragile(Unit):
    """It fails in its law when it is told to."""

    broken = False

    def control(self) -> None:
        if self.broken:
            self.broken = False
            raise ValueError("broken")


@pytest.mark.parametrize("at", [S.IDLE, S.EXECUTE, S.HELD, S.HOLDING], ids=lambda each: each.name.lower())
def test_a_fault_that_is_cleared_before_the_next_period_is_aborted_all_the_same(at: PackMLState) -> None:
    machine = Plant(filler=Fragile(motor=actuator(), level=sensor()), timer=timer())
    with connect(machine, wired(machine, Scripted())) as m:
        periods(m)
        lead_to(m, at)
        ann = Operator(m)
        ann.do("lease", seconds=5.0)
        m.filler.broken = True
        ann.run()
        assert m.filler.unit.state is S.ABORTED
        ann.do("clear")  # taken before the states are looked at
        assert m.filler.unit.state is S.CLEARING
        assert "state: aborted" in ann.notes
        finish(m)
        assert m.filler.unit.state is S.STOPPED
        assert m.filler.begun.count("execute") == m.filler.ended.count("execute")


def test_an_error_in_supervise_is_a_fault_of_its_part_and_told_once() -> None:
    class Odd(PackML):
        async def execute(self) -> None:
            self.part.motor.write(5.0)  # type: ignore[attr-defined]
            await super().execute()

        def supervise(self) -> None:
            super().supervise()
            if self.part.open:  # type: ignore[attr-defined]
                raise ValueError("odd")

    case = running(Odd)
    with case as (m, unit):
        unit.reset()
        periods(m)
        unit.start()
        periods(m, 3)
        assert m.filler.motor.read() == 5.0
        m.filler.open = {"x"}
        periods(m, 20)
        assert (unit.state, m.filler.motor.read()) == (S.ABORTED, 0.0)
        assert sum("odd" in event.text for event in case.connection.machine.events) == 1


def test_a_fault_that_cannot_be_cleared_stays() -> None:
    case = running()
    with case as (m, unit):
        case.box.broken = OSError("cut")
        periods(m, 2)
        with pytest.raises(EquipmentFault, match="cannot be cleared"):
            unit.clear()
        periods(m)
        assert unit.state is S.ABORTED


def test_abort_brings_outputs_to_their_defaults_until_it_is_cleared() -> None:
    with running(PackML) as (m, unit):
        m.filler.motor.write(5.0)
        periods(m)
        unit.abort()
        periods(m, 2)
        assert (unit.state, m.filler.motor.read()) == (S.ABORTED, 0.0)
        assert not m.filler.motor.write(5.0)
        assert m.filler.cycle.fault == "aborted by a command"


def test_a_refusal_of_the_part_is_an_interlock_on_a_transition() -> None:
    class Guarded(PackML):
        def refusal(self, command: str) -> str | None:
            return "the guard is open" if command == "start" else None

    with running(Guarded) as (m, unit):
        unit.reset()
        periods(m)
        assert "start" not in unit.possible
        with pytest.raises(CommandRefused, match="the guard is open"):
            unit.start()
        assert unit.state is S.IDLE


@pytest.mark.parametrize("wrong", [lambda: 1 / 0, lambda: False])
def test_a_refusal_that_fails_refuses_all_but_stop_and_abort(wrong: Any) -> None:
    class Guarded(PackML):
        def refusal(self, command: str) -> str | None:
            return wrong() if command != "reset" else None

    with running(Guarded) as (m, unit):
        unit.reset()
        periods(m)
        assert unit.possible == ["stop", "abort"]
        with pytest.raises(CommandRefused, match="it is unknown whether start is possible: "):
            unit.start()
        unit.abort()
        periods(m)
        assert unit.state is S.ABORTED


def test_a_mode_without_a_state_refuses_the_command_that_leads_there_and_passes_acting_states() -> None:
    class Serviced(PackML):
        excluded = {UnitMode.MAINTENANCE: [S.SUSPENDING, S.STARTING]}

        async def starting(self) -> None:
            raise AssertionError("this mode does not have it")

    with running(Serviced) as (m, unit):
        unit.change_mode(UnitMode.MAINTENANCE)
        unit.reset()
        periods(m)
        with pytest.raises(CommandRefused, match="start is not possible in the mode maintenance"):
            unit.start()
        unit.change_mode(UnitMode.PRODUCTION)
        assert "start" in unit.possible
        unit.stop()
        periods(m)
        assert unit.state is S.STOPPED


def test_no_command_leads_to_a_state_that_the_mode_does_not_have_also_not_by_an_acting_one() -> None:
    class Serviced(PackML):
        excluded = {UnitMode.MAINTENANCE: [S.HELD, S.COMPLETE]}

    with running(Serviced) as (m, unit):
        unit.change_mode(UnitMode.MAINTENANCE)
        for command in ("reset", "start"):
            unit.command(command)
            periods(m, 2)
        assert unit.possible == ["suspend", "stop", "abort"]
        with pytest.raises(CommandRefused, match="hold is not possible in the mode maintenance"):
            unit.hold()


@pytest.mark.parametrize(
    ("model", "excluded", "words"),
    [
        (PackML, {UnitMode.MANUAL: [S.ABORTING]}, "every mode has the state aborting"),
        (PackML, {UnitMode.MANUAL: [S.STOPPING]}, "every mode has the state stopping"),
        (PackML, {UnitMode.MANUAL: (S.CLEARING,)}, "every mode has the state clearing"),
        (Procedure, {UnitMode.MANUAL: [ProcedureState.STOPPED]}, "every mode has the state stopped"),
        (Procedure, {UnitMode.MANUAL: [S.HELD]}, "HELD: 11> is not a state of ISA-88"),
        (PackML, {UnitMode.MANUAL: S.HELD}, "a UnitMode with a list of states"),
        (PackML, {"manual": [S.HELD]}, "a UnitMode with a list of states"),
    ],
)
def test_what_a_mode_cannot_lack_is_refused(model: Any, excluded: Any, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        type("Odd", (model,), {"excluded": excluded})


def test_the_mode_is_changed_only_where_the_unit_stands_still() -> None:
    with running(PackML) as (m, unit):
        for command in ("reset", "start"):
            unit.command(command)
            periods(m)
        with pytest.raises(CommandRefused, match="the mode can be changed in the states stopped, idle, aborted"):
            unit.change_mode(UnitMode.MANUAL)
        assert unit.mode is UnitMode.PRODUCTION


# Clients and modes --------------------------------------------------------------------------------------


def test_a_client_operates_the_unit_in_automatic_mode_and_what_it_starts_outlives_its_lease() -> None:
    with running(PackML) as (m, unit):
        ann = Operator(m)
        ann.do("lease", seconds=5.0)
        assert ann.call("filler.unit.reset").state is CommandState.DONE
        ann.run(2)
        assert ann.call("filler.unit.start").text == '"starting"'
        refused = ann.call("filler.unit.start")
        assert refused.state is CommandState.REFUSED
        assert "start is not possible in the state execute" in refused.text
        ann.do("give back")
        ann.run(20)
        assert unit.state is S.EXECUTE
        assert "state: execute" in ann.notes


@pytest.mark.parametrize("kind", [PackML, Procedure])
@pytest.mark.parametrize("name", ["clear", "reset"])
def test_the_help_of_an_action_after_which_an_application_may_continue_warns(kind: Any, name: str) -> None:
    with running(kind) as (m, _):
        help = actions_of(m)[f"filler.unit.{name}"].help
        assert help.endswith("An application that waits for this continues immediately: the machine may move.")


def test_in_manual_mode_the_states_wait_but_abort_is_possible() -> None:
    with running() as (m, unit):
        lead_to(m, S.EXECUTE)
        ann = Operator(m)
        ann.do("lease", seconds=5.0)
        ann.mode("manual")
        m.filler.open.add("execute")
        ann.run(20)
        assert unit.state is S.EXECUTE
        assert unit.possible == ["abort"]  # `stopping` is a sequence, which would wait
        assert "manual mode" in ann.call("filler.unit.hold").text
        assert ann.call("filler.unit.abort").state is CommandState.DONE
        assert unit.state is S.ABORTED
        assert m.filler.cycle.fault == "aborted by a command"


@pytest.mark.parametrize("end", ["stop", "abort", "a client's action"])
def test_what_a_sequence_closes_that_was_ended_in_manual_mode_is_not_driven_again(end: str) -> None:
    class Driving(PackML):
        async def execute(self) -> None:
            await self.part.beside.cycle.start(self.drive())  # type: ignore[attr-defined]

        async def drive(self) -> None:
            self.part.motor.write(5.0)
            self.part.beside.motor.write(4.0)  # type: ignore[attr-defined]
            try:
                await super().execute()
            finally:
                self.part.motor.write(0.0)
                self.part.beside.motor.write(0.0)

        @action
        def drop(self) -> None:
            assert self._work is not None
            self._work.cancel()

    class Pair(Plant):
        beside: Unit

    filler, beside = (Unit(motor=actuator(), level=sensor(), states=each) for each in (Driving, PackML))
    machine = Pair(filler=filler, timer=timer(), beside=beside)
    with connect(machine, wired(machine, Scripted())) as m:
        filler.beside = beside
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        for command in ("reset", "start"):
            ann.call(f"filler.unit.{command}")
            ann.run(3)
        motors = filler.motor, beside.motor
        assert [each.read() for each in motors] == [5.0, 4.0]
        ann.mode("manual")
        ann.run(3)
        ann.call("filler.unit.drop" if end == "a client's action" else f"filler.unit.{end}")
        ann.run(3)
        ann.mode("automatic")
        ann.run(5)
        assert ann.clients.mode is Mode.AUTOMATIC
        assert [each.read() for each in motors] == [0.0, 0.0]


def test_actions_of_a_unit_are_described_in_the_order_of_their_declaration() -> None:
    case = running()
    with case:
        names = [path.rpartition(".")[2] for path in case.connection.machine.directory.actions]
    assert names[:7] == ["stop", "abort", "clear", "change_mode", "reset_counters", "reset", "start"]


# What is shown ------------------------------------------------------------------------------------------


def test_the_state_is_a_signal_with_names() -> None:
    case = running()
    with case as (m, unit):
        signals = {each.path: each for each in frame_of(case.connection.machine).signals}
        assert signals["filler.unit.state"].states[int(S.EXECUTE)] == "execute"
        seen = []
        case.connection.machine.observers.append(
            lambda frame: seen.append(dict(zip(signals, frame.signal_values, strict=True))["filler.unit.state"])
        )
        unit.reset()
        periods(m)
        assert seen[-1] == S.RESETTING


def test_a_subclass_adds_its_numbers_to_those_of_every_unit() -> None:
    class Fast(PackML):
        numbers = {"speed": Number("rpm", 0.0, 9.0, shown=True)}
        speed = 3.0

    case = running(Fast)
    with case:
        shown = [each.path.rpartition(".")[2] for each in frame_of(case.connection.machine).signals]
        assert shown == ["state", "mode", "produced", "rejected", "speed"]


# Declarations -------------------------------------------------------------------------------------------


def test_a_misspelt_sequence_is_refused_as_it_would_never_be_called() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.holdng is not a state of PackML.*did you mean 'holding'"):

        class Odd(PackML):
            async def holdng(self) -> None: ...


def test_a_sequence_that_is_none_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.holding must be a sequence"):

        class Odd(PackML):
            def holding(self) -> None: ...


def test_states_belong_to_equipment() -> None:
    class Plain(Compound):
        timer: DigitalSensor

        def setup(self) -> None:
            self.unit = PackML(self)

    machine = Plain(timer=timer())
    with pytest.raises(DeclarationError, match="unit: only a part that is equipment can have states"), connect(machine):
        pass


def test_umo_ps_tells_the_states_of_parts(umo: Any) -> None:
    rig = running()
    with rig as (m, _), published(rig.connection, "line"):
        periods(m)
        assert "line: states: filler.unit stopped\n" in umo("show", "stations").stdout
        lead_to(m, S.IDLE)
        (told,) = json.loads(umo("show", "stations", "--json").stdout)["running"]
        assert told["states"] == {"filler.unit": "idle"}


def test_a_law_of_the_users_own_may_have_a_method_supervise() -> None:
    class Watcher:
        def supervise(self, somebody: str) -> None:
            raise AssertionError("it is not umo's")

    class Watched(Compound):
        timer: DigitalSensor

        def setup(self) -> None:
            self.watcher = Watcher()

    with connect(Watched(timer=timer())) as m:
        periods(m, 3)


# What is accepted happens ---------------------------------------------------------------------------------


def gated(base: Any, every: bool = True) -> Any:
    """States with a sequence for each acting state (or for that of the work alone), which ends when the test lets
    it."""

    def gate(name: str) -> Any:
        async def sequence(self: Any) -> None:
            await until(lambda: name in self.part.open)

        return sequence

    names = [sequence_name(base.model, each) for each in base.model.acting if every or each is base.model.execute]
    return type(f"{'All' if every else 'Work'}Of{base.__name__}", (base,), {name: gate(name) for name in names})


KINDS = [gated(base, every) for base in (PackML, Procedure) for every in (False, True)]


def reachable(kind: Any) -> list[Any]:
    """The states in which a unit can stay: acting ones where it has something to do."""
    names = {name for name in vars(kind) if not name.startswith("_")}
    return [
        each
        for each in type(kind.model.first)
        if each not in kind.model.acting or sequence_name(kind.model, each) in names
    ]


def lead(m: Any, wanted: Any) -> None:
    """Bring a unit into a state, by commands and ends of sequences."""
    unit = m.filler.unit
    steps = [(at, name, then) for name, targets in unit.model.commands.items() for at, then in targets.items()]
    steps += [(at, "", then) for at, then in unit.model.acting.items()]
    ways: dict[Any, list[tuple[str, Any]]] = {unit.model.first: []}
    queue = deque(ways)
    while queue:
        state = queue.popleft()
        for at, cause, then in steps:
            if at is state and then not in ways:
                ways[then] = [*ways[at], (cause, then)]
                queue.append(then)
    for cause, then in ways[wanted]:
        if cause:
            unit.command(cause)
            periods(m)
        elif unit.state is not then:  # an acting state in which there is something to do
            name = sequence_name(unit.model, unit.state)
            periods(m, 2)
            m.filler.open.add(name)
            periods(m, 2)
            m.filler.open.discard(name)
    assert unit.state is wanted


def where_it_leads(model: Any, command: str, at: Any) -> Any:
    """The state that a command reaches in the end, when what there is to do has been done."""
    then = model.commands[command][at]
    while then in model.acting and then is not model.execute:
        then = model.acting[then]
    return then


@pytest.mark.parametrize("mode", first(1, ["automatic", "manual"]))
@pytest.mark.parametrize(
    ("kind", "at"),
    [pytest.param(kind, at, id=f"{kind.__name__}-{at.name.lower()}") for kind in KINDS for at in reachable(kind)],
)
def test_a_command_is_refused_or_what_it_says_happens(kind: Any, at: Any, mode: str) -> None:
    """`stop` was answered as done in manual mode, and the unit stayed in Stopping: its sequence waited. Those that are
    refused are given one after the other."""
    sequences = {sequence_name(kind.model, each) for each in kind.model.acting} - {"execute"}
    before = kind.model.aborted if (mode, at) == ("manual", kind.model.aborting) else at
    left = list(kind.model.commands)
    while left:
        with running(kind) as (m, unit):
            lead(m, at)
            ann = Operator(m)
            ann.do("lease", seconds=60.0)
            ann.mode(mode)
            ann.run(2)
            assert unit.state is before
            possible = unit.possible
            left.sort(key=lambda command: command in possible)
            answered = CommandState.REFUSED
            while left and answered is CommandState.REFUSED:
                command = left.pop(0)
                answer = ann.call(f"filler.unit.{command}")
                answered = answer.state
                if answered is not CommandState.DONE:
                    assert (answered, command in possible) == (CommandState.REFUSED, False)
                    assert f"{command} is not possible" in answer.text
                    assert unit.state is before
            m.filler.open |= sequences
            ann.run(5)
            if answered is CommandState.DONE:
                assert command in possible
                assert unit.state is where_it_leads(kind.model, command, before)
            else:
                assert mode == "automatic" or unit.state is before


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_a_unit_does_it_can_be_brought_to_a_standstill_in_manual_mode(kind: Any) -> None:
    for at in reachable(kind):
        if at in (kind.model.aborting, kind.model.aborted):
            continue
        with running(kind) as (m, unit):
            lead(m, at)
            ann = Operator(m)
            ann.do("lease", seconds=60.0)
            ann.mode("manual")
            answers = [ann.call(f"filler.unit.{each}") for each in ("stop", "abort")]
            assert CommandState.DONE in {each.state for each in answers}
            assert unit.state in (kind.model.aborted, kind.model.stopped)
            if answers[0].state is CommandState.REFUSED and "manual" in answers[0].text:
                assert answers[0].text.endswith("change the mode (`umo do STATION mode automatic`), or abort it")


# ISA-88 -------------------------------------------------------------------------------------------------


def test_a_batch_has_the_states_of_isa_88() -> None:
    class Batch(Procedure):
        async def execute(self) -> None:
            for _ in range(20):
                await next_period()
            self.produced += 1

    with running(Batch) as (m, unit):
        assert unit.state is ProcedureState.IDLE
        unit.start()
        periods(m, 5)
        unit.hold()
        periods(m, 50)
        assert unit.state is ProcedureState.HELD
        unit.restart()
        periods(m, 2)
        unit.pause()
        periods(m, 2)
        assert unit.state is ProcedureState.PAUSED
        unit.resume()
        periods(m, 30)
        assert (unit.state, unit.produced) == (ProcedureState.COMPLETE, 1)
        unit.reset()
        assert unit.state is ProcedureState.IDLE


def test_the_work_of_a_procedure_is_execute() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.running is not a state of ISA-88.*did you mean 'execute'"):

        class Odd(Procedure):
            async def running(self) -> None: ...


# Anything at random -------------------------------------------------------------------------------------


@budget(20, 60)
@given(
    st.lists(
        st.sampled_from([*PACKML.commands, "open", "close", "law", "clear it", "automatic", "manual", "odd", "wait"]),
        max_size=40,
    )
)
def test_what_clients_faults_and_modes_do_together_leaves_nothing_driven_and_can_be_ended(steps: list[str]) -> None:
    class Driving(Gated):
        async def execute(self) -> None:
            self.part.motor.write(5.0)
            try:
                await self._gate("execute")
            finally:
                odd, self.part.odd = self.part.odd, False
                if odd:
                    raise ValueError("while cleaning up")

    machine = Plant(filler=Fragile(motor=actuator(), level=sensor(), states=Driving), timer=timer())
    with connect(machine, wired(machine, Scripted())) as m:
        part, unit, ann = m.filler, m.filler.unit, Operator(m)
        ann.do("lease", seconds=60.0)
        sequences = {sequence_name(PACKML, each) for each in PACKML.acting}
        part.odd = False
        for step in steps:
            match step:
                case "open" | "close":
                    part.open = sequences if step == "open" else set()
                case "law":
                    part.broken = True
                case "odd":
                    part.odd = True
                case "clear it":
                    ann.send("clear")
                case "automatic" | "manual":
                    ann.send("mode", value=step)
                case "wait":
                    pass
                case _:
                    ann.send("call", f"filler.unit.{step}")
            before = part.cycle.fault
            ann.run()
            if before is not None and part.cycle.fault is None:
                assert unit.state in (S.CLEARING, S.STOPPED)
            if part.cycle.fault is not None:
                assert (unit.state, part.motor.read(), unit._work) == (S.ABORTED, 0.0, None)
            assert unit._work is None or unit.state in (S.EXECUTE, *PACKML.waiting)
        part.open, part.odd = sequences, False
        ann.mode("automatic")
        for _ in range(3):
            ann.run(3)
            part.cycle.clear()
        ann.run(3)
        if "stop" in unit.possible:
            unit.stop()
            ann.run(3)
        assert unit.state is S.STOPPED
        assert len(part.begun) == len(part.ended)


@budget(20, 60)
@given(st.lists(st.sampled_from([*PACKML.commands, "finish", "fault", "clear it", "wait"]), max_size=30))
def test_the_state_shown_is_the_state_that_is_whatever_happens(steps: list[str]) -> None:
    case = running()
    with case as (m, unit):
        expected = S.STOPPED
        for step in steps:
            if step == "finish":
                finish(m)
                if (expected, "") in AS_THE_STANDARD_SAYS or expected is S.EXECUTE:
                    expected = AS_THE_STANDARD_SAYS.get((expected, ""), S.COMPLETING)
            elif step == "fault":
                case.box.broken = OSError("cut")
                periods(m)
                case.box.broken = None
                periods(m, 2)
                expected = S.ABORTED
            elif step == "clear it":
                m.filler.cycle.clear()
                periods(m, 2)
                expected = S.CLEARING if expected is S.ABORTED else expected
            elif step != "wait":
                target = AS_THE_STANDARD_SAYS.get((expected, step))
                if target is None:
                    with pytest.raises(CommandRefused):
                        unit.command(step)
                else:
                    unit.command(step)
                    expected = target
            periods(m)
            assert unit.state is expected
            assert (m.filler.cycle.fault is not None) is (expected is S.ABORTED)
            assert unit._work is None or unit._work.done or unit._work.paused is (expected in PACKML.waiting)
