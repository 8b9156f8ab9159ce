"""The batch plant in virtual time: recipes side by side, interlocks, and parts that fail alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from random import Random
from types import MappingProxyType
from typing import Any

import pytest
from typer.testing import Result

import umo
from helpers.batch_plant import boxes
from helpers.operator import Operator
from helpers.tiers import first, some
from umo.control import until, wait
from umo.cycle.restoring import NAME
from umo.drivers import Direction
from umo.errors import ChannelError, DriverError, EquipmentFault
from umo.operation import ProcedureState
from umo.process.station import find
from umo.states import OpenClosed
from umo.stations.batch.application import main
from umo.stations.batch.batch_recipes import BOOK
from umo.stations.batch.control import BatchPlant, Reactor
from umo.stations.batch.errors import BatchesLost
from umo.stations.batch.objects import machine
from umo.stations.batch.plant import CHANNELS, Plant
from umo.stations.batch.vessel import Vessel
from umo.testing import periods, put

STATION = find("batch")
SIMULATED = STATION.wirings["simulated"]
OPEN, CLOSED = OpenClosed.OPEN, OpenClosed.CLOSED
OUTPUTS = [text for text, channel in CHANNELS.items() if channel.direction is Direction.OUTPUT]
AT_THE_SCALE = {"weighing", "charging"}


class Run:
    """One run: its result or error, and what was seen of it. After `repair_time` s the operator clears a fault, and
    tries again every 10 s; None: there is no operator."""

    def __init__(
        self,
        *,
        wired: Any = SIMULATED,
        fault: Sequence[str] = (),
        repair_time: float | None = 30.0,
        disturb: Callable[[BatchPlant], Any] | None = None,
        seed: int | None = None,
        kept: Mapping[str, Any] = MappingProxyType({}),
        **options: Any,
    ) -> None:
        self.machine = machine()
        self.result: dict[str, Any] = {}
        self.error: BatchesLost | None = None
        self.faults: list[tuple[str, str]] = []
        """Equipment and reason of each."""
        self.phases: list[list[tuple[float, str]]] = [[], []]
        """Of each reactor: since when, and what."""
        self.levels: list[tuple[float, dict[str, int], list[bool]]] = []
        """Each period: time, levels of the plant's outputs, and which reactor is in fault."""
        self._repair_time, self._disturb = repair_time, disturb
        given = {} if seed is None else {"seed": seed}
        connection = umo.connect(self.machine, wired, fault=list(fault), **given)
        connection.kept = kept
        with connection as m:
            plant = connection.driver("plant")
            assert isinstance(plant, Plant)
            self.plant = plant
            connection.machine.observers.append(self._observe)
            try:
                self.result = umo.drive(m, lambda m: self._application(m, options))
            except BatchesLost as error:
                self.error = error
            self.time = m.now
        assert [text for text in OUTPUTS if plant.levels[text]] == []

    async def _application(self, m: BatchPlant, options: dict[str, Any]) -> Any:
        if self._repair_time is not None:
            for equipment in (*m.reactors, m.line):
                m.cycle.start(self._operate(equipment, self._repair_time))
        if self._disturb is not None:
            m.cycle.start(self._disturb(m))
        return await main(m, **options)

    async def _operate(self, equipment: Any, repair_time: float) -> None:
        while True:
            await until(lambda: equipment.cycle.fault is not None)
            self.faults.append((equipment._path, equipment.cycle.fault))
            await wait(repair_time)
            while equipment.cycle.fault is not None:
                try:
                    equipment.cycle.clear()
                except (EquipmentFault, DriverError):
                    await wait("10 s")

    def _observe(self, frame: umo.Frame) -> None:
        for reactor, phases in zip(self.machine.reactors, self.phases, strict=True):
            if not phases or phases[-1][1] != reactor.phase:
                phases.append((round(frame.time, 3), reactor.phase))
        faults = [reactor.cycle.fault is not None for reactor in self.machine.reactors]
        self.levels.append((frame.time, {text: self.plant.levels[text] for text in OUTPUTS}, faults))

    @property
    def report(self) -> dict[str, Any]:
        return self.plant.report()

    def assert_made(self, made: str, *, dumped: int = 0) -> None:
        """What the run claims, and the plant knows."""
        assert self.error is None
        assert (self.result["made"], self.result["batches_dumped"]) == (made, dumped)
        assert self.report["good"] == made
        assert self.report["batches_wrong"] <= dumped

    def driven_in_fault(self, reactor: int, after: float = 0.0) -> set[str]:
        """The outputs of a reactor that were not at their defaults after the period in which its fault began, and after
        a time in s."""
        own = [text for text in OUTPUTS if text in (f"feed:{reactor}", f"drain:{reactor}", f"heater:{reactor}")]
        return {
            text
            for (_, _, before), (time, levels, now) in pairwise(self.levels)
            if before[reactor] and now[reactor] and time > after
            for text in [*own, f"stirrer:{reactor}"]
            if levels[text]
        }


# Good runs -------------------------------------------------------------------------------------------


@pytest.mark.full
def test_both_reactors_work_through_their_recipes_and_the_plant_agrees() -> None:
    run = Run()
    run.assert_made("glue 2, soap 2")
    assert run.result["batches_made"] == run.report["batches_good"] == 4
    assert run.report["largest_deviation_kg"] <= 0.5
    assert run.report["wasted_kg"] == 0.0
    phases = [name for _, name in run.phases[0]]
    one = ["weighing", "charging", "heating", "holding", "draining", "idle"]
    assert [name for name in phases if name != "waiting for the scale"] == ["idle", *one, *one]
    assert run.plant.good[0] == (0, BOOK["glue"])
    assert 480.0 < run.time < 720.0


def test_the_scale_is_used_by_one_reactor_at_a_time(undisturbed: Run) -> None:
    (began, ended), (other_began, _) = (_stay(phases, AT_THE_SCALE) for phases in undisturbed.phases)
    assert began < other_began
    assert other_began == pytest.approx(ended, abs=0.11)
    assert "waiting for the scale" in [name for _, name in undisturbed.phases[1]]


def _stay(phases: list[tuple[float, str]], names: set[str]) -> tuple[float, float]:
    """From when to when the first stay in these phases was."""
    begin = next(number for number, (_, name) in enumerate(phases) if name in names)
    end = next(number for number in range(begin, len(phases)) if phases[number][1] not in names)
    return phases[begin][0], phases[end][0]


@pytest.mark.parametrize(("given", "made"), [({}, "paint 2"), ({"recipe": ["soap"]}, "soap 2")])
def test_recipes_that_are_given_replace_one_that_a_client_chose_in_an_earlier_run(
    given: dict[str, Any], made: str
) -> None:
    kept = {"book.choice": {"value": "paint", "unit": "", "type": NAME}}
    assert Run(kept=kept, batches=1, **given).result["made"] == made


@pytest.mark.parametrize("seed", first(1, range(1, 21)))
@pytest.mark.full
def test_batches_are_good_whatever_the_noise_and_the_flows(seed: int) -> None:
    run = Run(seed=seed, recipe=["glue", "paint", "soap"], batches=3)
    run.assert_made("glue 2, paint 2, soap 2")


@pytest.mark.full
def test_the_line_learns_how_much_flows_after_the_command_to_close() -> None:
    run = Run(seed=3, recipe=["glue"], batches=3)
    run.assert_made("glue 6")
    assert run.machine.line.overruns != [run.machine.line.overrun] * 2


@pytest.mark.full
def test_the_same_seed_gives_the_same_run() -> None:
    one, again, other = (Run(seed=seed, batches=1) for seed in (1, 1, 2))
    assert one.phases == again.phases != other.phases


@pytest.mark.full
def test_the_same_machine_makes_batches_again_in_another_connection() -> None:
    m = machine()
    for _ in range(2):
        with umo.connect(m, SIMULATED) as connected:
            assert umo.drive(connected, main, batches=1)["made"] == "glue 1, soap 1"


@pytest.mark.full
def test_what_a_run_that_was_stopped_has_left_is_dumped_by_the_next_one() -> None:
    """It is stopped while a batch that is made drains, and another one is charged."""
    m, plant = machine(), Plant()
    wired = boxes(plant)

    async def stopped(m: BatchPlant) -> None:
        m.cycle.start(main(m))
        await until(lambda: m.reactors[0].phase == "draining" and m.reactors[0].level.read() < 30.0)

    with umo.connect(m, wired):
        umo.drive(m, stopped)
    with umo.connect(m, wired):
        result = umo.drive(m, main, batches=1)
    used = {key.split()[0]: entry["batches"] for key, entry in result.pop("recipes").items()}
    assert used == {"glue": 1, "soap": 1}
    assert result == {"batches_made": 2, "made": "glue 1, soap 1", "batches_dumped": 2}
    assert len(plant.good) == 3  # the first one had been made, and nobody claims it


# Operated ---------------------------------------------------------------------------------------------


PHASES = ["weighing", "charging", "heating", "holding", "draining"]


def held(phase: str, command: str, back: str, seconds: float, after: float = 1.0) -> Callable[[BatchPlant], Any]:
    """An operator who holds the first reactor in a phase, for so long."""

    async def operate(m: BatchPlant) -> None:
        reactor = m.reactors[0]
        await until(lambda: reactor.phase == phase)
        await wait(after)
        reactor.unit.command(command)
        await wait(2.0)
        assert reactor.activity == ("held" if command == "hold" else "paused")
        valves = [reactor.feed, reactor.drain]
        level = reactor.level.read()
        await wait(seconds)
        assert [valve.read() for valve in valves] == [CLOSED] * 2
        assert reactor.level.read() == pytest.approx(level, abs=1.0)
        reactor.unit.command(back)

    return operate


@pytest.mark.parametrize("phase", some(lambda phase: phase == "heating", PHASES))
@pytest.mark.parametrize(("command", "back"), first(1, [("hold", "restart"), ("pause", "resume")]))
def test_a_batch_that_is_held_in_any_phase_goes_on_and_is_good(phase: str, command: str, back: str) -> None:
    run = Run(batches=1, disturb=held(phase, command, back, 90.0))
    run.assert_made("glue 1, soap 1")
    assert run.report["wasted_kg"] == 0.0
    assert not run.faults


@pytest.mark.parametrize("seed", first(0, range(40)))
def test_a_batch_that_is_held_at_any_moment_goes_on_and_is_good(seed: int) -> None:
    chance = Random(seed)

    async def operate(m: BatchPlant) -> None:
        while True:
            await wait(chance.uniform(1.0, 80.0))
            unit = chance.choice(m.reactors).unit
            for command in ("hold", "restart"):
                if command in unit.possible:
                    unit.command(command)
                    await wait(chance.uniform(0.1, 60.0))

    Run(batches=2, seed=seed, patience=1e6, disturb=operate).assert_made("glue 2, soap 2")


@pytest.mark.full
def test_the_other_reactor_goes_on_while_one_is_held() -> None:
    run = Run(batches=1, disturb=held("heating", "hold", "restart", 900.0))
    run.assert_made("glue 1, soap 1")
    assert run.phases[1][-1][0] < 800.0 < run.phases[0][-1][0]


def test_a_batch_that_an_operator_stops_is_dumped_and_made_again_once_the_reactor_is_reset() -> None:
    async def operate(m: BatchPlant) -> None:
        reactor = m.reactors[0]
        await until(lambda: reactor.phase == "heating")
        reactor.unit.stop()
        await wait(60.0)
        assert reactor.unit.state is ProcedureState.STOPPED
        assert reactor.heater.read() == 0.0
        reactor.unit.reset()

    Run(batches=1, disturb=operate).assert_made("glue 1, soap 1", dumped=1)


@pytest.mark.full
def test_a_batch_that_an_operator_aborts_is_made_again_once_the_fault_is_cleared() -> None:
    async def operate(m: BatchPlant) -> None:
        await until(lambda: m.reactors[0].phase == "heating")
        m.reactors[0].unit.abort()

    run = Run(batches=1, repair_time=30.0, disturb=operate)
    run.assert_made("glue 1, soap 1", dumped=1)
    assert run.faults == [("reactors.0", "aborted by a command")]


# Interlocks ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def undisturbed() -> Run:
    """A batch of each reactor."""
    return Run(batches=1)


@pytest.fixture
def idle() -> Iterator[BatchPlant]:
    """The machine on simulated channels: a reactor half full and warm, an empty hopper."""
    with umo.connect(machine()) as m:
        put(m.reactors[0].level, 60.0)
        put(m.reactors[0].temperature, 50.0)
        periods(m, 2)
        yield m


def inhibited(m: BatchPlant, actuator: Any, value: Any) -> str | None:
    """Why the actuator is inhibited after a write; None if it takes the value."""
    actuator.write(value)
    periods(m, 1)
    assert actuator.inhibited is not None or actuator.read() == value
    return actuator.inhibited


def test_the_heater_is_on_only_when_it_is_covered_and_not_too_hot(idle: BatchPlant) -> None:
    reactor = idle.reactors[0]
    assert inhibited(idle, reactor.heater, 50.0) is None
    put(reactor.level, 19.0)
    assert inhibited(idle, reactor.heater, 50.0) == "the level is low"
    put(reactor.level, 60.0)
    put(reactor.temperature, 101.0)
    assert inhibited(idle, reactor.heater, 50.0) == "too hot"
    assert reactor.heater.read() == 0.0


def test_the_drain_stays_closed_while_the_feed_is_open_and_the_other_way_round(idle: BatchPlant) -> None:
    reactor = idle.reactors[0]
    assert inhibited(idle, reactor.feed, OPEN) is None
    periods(idle, 1)
    assert inhibited(idle, reactor.drain, OPEN) == "the feed valve is open"
    reactor.feed.write(CLOSED)
    periods(idle, 2)
    assert inhibited(idle, reactor.drain, OPEN) is None
    periods(idle, 1)
    assert inhibited(idle, reactor.feed, OPEN) == "the drain valve is open"


def test_nothing_is_fed_into_a_full_reactor_or_weighed_into_a_full_or_open_hopper(idle: BatchPlant) -> None:
    put(idle.reactors[0].level, 151.0)
    put(idle.line.scale, 101.0)
    periods(idle, 1)
    assert inhibited(idle, idle.reactors[0].feed, OPEN) == "the reactor is full"
    assert inhibited(idle, idle.line.inlets[1], OPEN) == "the hopper is full"
    put(idle.line.scale, 10.0)
    periods(idle, 1)
    assert inhibited(idle, idle.line.inlets[1], OPEN) is None
    assert inhibited(idle, idle.line.waste, OPEN) is None
    periods(idle, 1)
    assert inhibited(idle, idle.line.inlets[1], OPEN) == "the hopper is being emptied"


# Parts that fail -------------------------------------------------------------------------------------


def raise_while_heating(m: BatchPlant) -> Any:
    async def spoil() -> None:
        reactor: Any = m.reactors[0]
        await until(lambda: m.now >= 120.0)
        reactor._is_off = lambda: 1 / 0
        await wait("1 s")
        del reactor._is_off

    return spoil()


FAILURES: dict[str, dict[str, Any]] = {
    "its thermometer breaks": {"fault": ["reactors.0.temperature disconnect at 120 s for 20 s"]},
    "its box is away for 2 s": {"fault": ["box_0 disconnect at 120 s for 2 s"], "wired": boxes},
    "its phase raises": {"disturb": raise_while_heating},
}
REASONS = {
    "its thermometer breaks": "could not be read: plant: disconnected",
    "its box is away for 2 s": "could not be read: box_0: the driver is away: disconnected",
    "its phase raises": "ZeroDivisionError: division by zero",
}


@pytest.mark.parametrize("what", first(1, FAILURES))
def test_a_reactor_fails_alone_the_other_completes_and_the_broken_one_goes_on_after_clear(
    what: str, undisturbed: Run
) -> None:
    given = {key: value() if key == "wired" else value for key, value in FAILURES[what].items()}
    run = Run(batches=1, **given)
    run.assert_made("glue 1, soap 1", dumped=1)
    assert run.report["batches_wrong"] == 1
    ((equipment, reason),) = run.faults
    assert equipment == "reactors.0"
    assert REASONS[what] in reason
    assert run.phases[1] == undisturbed.phases[1]
    back = 124.0 if what == "its box is away for 2 s" else 0.0  # it is looked for at growing intervals
    assert run.driven_in_fault(0, after=back) == set()
    assert "dumping" in [name for _, name in run.phases[0]]


@pytest.mark.full
def test_a_reactor_that_fails_while_it_is_charged_gives_the_scale_back_and_the_rest_goes_to_the_waste(
    undisturbed: Run,
) -> None:
    run = Run(batches=1, fault=["reactors.0.level disconnect at 45 s for 2 s"])
    run.assert_made("glue 1, soap 1", dumped=1)
    assert [equipment for equipment, _ in run.faults] == ["reactors.0"]
    assert 20.0 < run.report["wasted_kg"] < 50.0
    assert _stay(run.phases[1], AT_THE_SCALE)[0] < _stay(undisturbed.phases[1], AT_THE_SCALE)[0]


@pytest.mark.full
def test_a_batch_that_is_made_is_not_dumped_when_the_reactor_fails_while_it_drains() -> None:
    run = Run(batches=1, fault=["reactors.0.level disconnect at 240 s for 2 s"])
    assert [equipment for equipment, _ in run.faults] == ["reactors.0"]
    run.assert_made("glue 1, soap 1", dumped=0)


@pytest.mark.full
def test_a_line_that_fails_breaks_the_batch_of_the_reactor_that_used_it() -> None:
    run = Run(fault=["line.scale disconnect at 60 s for 2 s"])
    run.assert_made("glue 2, soap 2", dumped=0)
    assert [equipment for equipment, _ in run.faults] == ["line", "reactors.1"]
    assert "line is in fault: could not be read" in run.faults[1][1]


@pytest.mark.full
def test_a_batch_that_waits_for_the_scale_of_a_line_in_fault_is_not_broken() -> None:
    run = Run(batches=1, fault=["line.scale disconnect at 10 s for 20 s"])
    run.assert_made("glue 1, soap 1", dumped=0)
    assert [equipment for equipment, _ in run.faults] == ["line", "reactors.0"]


@pytest.mark.full
def test_a_batch_waits_for_a_line_in_fault_for_so_long_and_no_longer() -> None:
    run = Run(batches=2, fault=["line.scale disconnect at 60 s"], repair_time=None, patience=60.0)
    assert "reactor 0: 1 of 2 batches not made: the charging line was in fault for 600 s" in str(run.error)
    assert run.report["good"] == "glue 1"


PATHS = ["line.scale", "reactors.0.heater", "reactors.0.temperature", "reactors.1.stirrer"]


@pytest.mark.parametrize("path", first(2, PATHS))
@pytest.mark.full
def test_lost_answers_cost_nothing(path: str) -> None:
    run = Run(batches=1, fault=[f"{path} disconnect at {at} s for 0.4 s" for at in range(7, 330, 13)])
    run.assert_made("glue 1, soap 1", dumped=0)
    assert run.faults == []


@pytest.mark.full
def test_a_fault_that_nobody_clears_costs_the_batches_of_its_reactor_and_no_other() -> None:
    run = Run(fault=["reactors.0.temperature disconnect at 120 s"], repair_time=None, patience=60.0)
    assert run.error is not None
    assert str(run.error).startswith("reactor 0: 2 of 2 batches not made: could not be read: plant: disconnected")
    assert run.report["good"] == "glue 1, soap 1"
    assert {number for number, _ in run.plant.good} == {1}


@pytest.mark.parametrize("valve", first(1, ["reactors.0.feed", "reactors.0.drain", "line.outlets.0"]))
@pytest.mark.full
def test_a_valve_that_is_away_for_2_s_costs_nothing(valve: str) -> None:
    """It is away every 26 s, also when it is to open; what is sent to it is sent again."""
    run = Run(batches=1, fault=[f"{valve} disconnect at {at} s for 2 s" for at in range(9, 330, 26)])
    run.assert_made("glue 1, soap 1", dumped=0)
    assert run.faults == []


@pytest.mark.full
def test_an_amount_that_is_wrong_since_its_inlet_was_away_goes_to_the_waste_and_into_no_batch() -> None:
    run = Run(batches=1, fault=["line.inlets.1 disconnect at 35 s for 2 s"])
    run.assert_made("glue 1, soap 1", dumped=0)
    assert "kg of raw material B instead of 20 kg" in run.faults[0][1]
    assert run.report["wasted_kg"] > 60.0


@pytest.mark.full
def test_a_valve_that_is_away_for_longer_is_a_fault_of_its_reactor() -> None:
    run = Run(batches=1, fault=["reactors.0.drain disconnect at 240 s for 20 s"])
    run.assert_made("glue 1, soap 1", dumped=0)
    ((equipment, reason),) = run.faults
    assert equipment == "reactors.0"
    assert "could not be written" in reason


@pytest.mark.full
@pytest.mark.parametrize(
    ("fault", "equipment", "reason"),
    first(
        1,
        [
            ("reactors.0.heater stuck 0 at 100 s for 60 s", "reactors.0", "the temperature does not reach 60 degC"),
            (
                "reactors.0.temperature stuck 35 degC at 90 s for 120 s",
                "reactors.0",
                "the temperature does not reach 60",
            ),
            ("reactors.0.drain stuck CLOSED at 230 s for 140 s", "reactors.0", " l left after 120 s of draining"),
            (
                "line.inlets.0 stuck CLOSED at 5 s for 20 s",
                "line",
                "raw material A does not flow through line.inlets.0",
            ),
            ("line.inlets.1 stuck OPEN at 30 s for 20 s", "line", "raw material B instead of 20 kg"),
            ("line.outlets.0 stuck CLOSED at 30 s for 20 s", "line", "the hopper's load does not flow through"),
        ],
    ),
)
def test_what_does_not_act_as_it_should_is_a_fault_in_words(fault: str, equipment: str, reason: str) -> None:
    run = Run(batches=1, fault=[fault])
    assert run.faults[0][0] == equipment
    assert reason in run.faults[0][1]
    assert run.error is None
    assert run.report["good"] == run.result["made"] == "glue 1, soap 1"


@pytest.mark.full
def test_without_a_thermometer_that_moves_the_heater_is_not_on_for_long() -> None:
    run = Run(
        batches=1, fault=["reactors.0.temperature stuck 22 degC at 60 s for 300 s"], repair_time=None, patience=1.0
    )
    assert run.error is not None
    assert run.plant.vessels[0].temperature < 70.0


@pytest.mark.parametrize("moment", first(1, [100.0, 46.0, 240.0, 10.0, 35.0, 54.0, 200.0, 250.0]))
@pytest.mark.full
def test_manual_mode_in_the_middle_of_a_batch_costs_time_only(moment: float) -> None:
    m = machine()
    connection = umo.connect(m, SIMULATED)
    with connection:
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        task = m.cycle.start(main(m, batches=1))
        ann.run(round(10 * (moment - m.now)))
        ann.mode("manual")
        ann.run(200)
        valves = [*m.line.inlets, *m.line.outlets, m.line.waste, *(v for r in m.reactors for v in (r.feed, r.drain))]
        assert {valve.read() for valve in valves} == {CLOSED}
        ann.mode("automatic")
        ann.run(3500)
        assert task.done
        plant: Any = connection.driver("plant")
        assert plant.report()["good"] == task.result["made"] == "glue 1, soap 1"
        assert plant.report()["batches_wrong"] == 0


# The plant -------------------------------------------------------------------------------------------


def batch(amounts: Sequence[float], temperature: float, speed: float, time: float) -> Vessel:
    """A vessel whose content was kept so."""
    vessel = Vessel(power=120.0)
    vessel.charge(amounts)
    vessel.temperature, vessel.speed = temperature, speed
    for _ in range(round(time / 0.1)):
        vessel.warm(0.1)
        vessel.temperature = temperature
    return vessel


@pytest.mark.parametrize(
    ("given", "good"),
    [
        (((40.0, 20.0), 60.0, 90.0, 61.0), True),
        (((40.4, 19.6), 61.9, 94.0, 61.0), True),
        (((40.6, 20.0), 60.0, 90.0, 61.0), False),
        (((40.0, 20.0), 62.1, 90.0, 61.0), False),
        (((40.0, 20.0), 60.0, 0.0, 61.0), False),
        (((40.0, 20.0), 60.0, 90.0, 59.0), False),
    ],
)
def test_a_batch_is_good_if_its_amounts_are_right_and_it_was_kept_warm_and_stirred(given: Any, good: bool) -> None:
    assert batch(*given).made() is (BOOK["glue"] if good else None)


def test_the_plant_keeps_its_content_when_it_is_opened_again() -> None:
    plant = Plant()
    plant.write(plant.channel("inlet:0"), 1)
    for _ in range(50):
        plant.read(plant.channel("tick"))
    load = plant.read(plant.channel("scale"))
    assert load == pytest.approx(900, abs=100)
    plant.close()
    plant.open()
    assert plant.read(plant.channel("scale")) == load


def test_nothing_flows_into_a_reactor_whose_feed_is_closed() -> None:
    plant = Plant()
    plant.hopper = [10.0, 0.0]
    plant.write(plant.channel("outlet:1"), 1)
    plant.advance(50)
    assert sum(plant.hopper) == pytest.approx(10.0, abs=0.1)
    plant.write(plant.channel("feed:1"), 1)
    plant.advance(50)
    assert plant.vessels[1].content == pytest.approx(10.0, abs=0.1)


def test_a_channel_that_is_none_and_a_write_to_an_input_are_refused() -> None:
    plant = Plant()
    with pytest.raises(ChannelError, match="did you mean 'heater:1'"):
        plant.channel("heatr:1")
    with pytest.raises(DriverError, match="scale is an input"):
        plant.write(plant.channel("scale"), 1)


# The station -----------------------------------------------------------------------------------------


def test_both_wirings_fit_and_each_reactor_has_a_box_of_its_own() -> None:
    for wiring in STATION.wirings.values():
        assert umo.check(machine(), wiring) == []
    text = STATION.wirings["modbus"].read_text("utf-8")
    for number in (0, 1):
        lines = [line for line in text.splitlines() if line.startswith(f'"reactors.{number}.')]
        assert len(lines) == 6
        assert all(f'driver = "reactor_{number}"' in line for line in lines)


def test_the_default_values_are_safe() -> None:
    reactor: Reactor = machine().reactors[0]
    assert (reactor.heater.default, reactor.stirrer.default) == (0.0, 0.0)
    assert (reactor.feed.default, reactor.drain.default) == (CLOSED, CLOSED)


def test_umo_run_takes_the_recipes_and_shows_the_results(umo: Callable[..., Result], tmp_path: Path) -> None:
    result = umo(
        "run", "batch", "--no-plot", "--recipe", "paint", "--batches", "1", "--seed", "4", "--summary", "summary.json"
    )
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    used = summary["result"].pop("recipes")
    assert summary["result"] == {"batches_made": 2, "made": "paint 2", "batches_dumped": 0}
    paint = BOOK["paint"]
    assert used == {f"paint {paint.hash}": {"batches": 2, "values": paint.values}}
    assert summary["reports"]["plant"]["good"] == "paint 2"
    assert summary["progress"]["done"] == summary["progress"]["total"] == 2


def test_an_unknown_recipe_is_refused_in_a_line(umo: Callable[..., Result]) -> None:
    result = umo("run", "batch", "--recipe", "sope")
    assert result.exit_code == 2
    assert "'sope' is not one of 'glue', 'paint', 'soap'. (did you mean 'soap'?)" in " ".join(
        (result.output + result.stderr).split()
    )
