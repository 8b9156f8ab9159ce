"""The furnace: many zones under PI, each with its own interlock and its own fault, in virtual time."""

from __future__ import annotations

from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
import pytest

import umo
from helpers.tiers import first
from umo import Quality, Thermocouple
from umo.errors import DeclarationError, DriverError, RangeError, WiringError
from umo.objects import atoms
from umo.process.job import Job, Plan
from umo.process.station import find
from umo.states import OnOff
from umo.stations.furnace.application import main
from umo.stations.furnace.errors import HeatingError, OverTemperature, TooManyFaults
from umo.stations.furnace.objects import machine
from umo.stations.furnace.plant import FAULTS, Plant
from umo.testing import periods
from umo_command.station_options import options_of, parse

STATION = find("furnace")
SIMULATED = STATION.wirings["simulated"]


class Run:
    """One run: its result or error, and what was seen of it."""

    def __init__(self, zones: int = 12, *, peak: float = 850.0, soak: float = 5.0, **options: Any) -> None:
        self.machine = machine(zones)
        self.result: Any = None
        self.error: umo.TaskFailed | None = None
        self.phases: list[tuple[float, str]] = []
        self.states: list[tuple[float, list[int], list[float], list[float]]] = []
        """Each period: time, qualities, heaters and fans."""
        connection = umo.connect(self.machine, SIMULATED, **options)
        with connection as m:
            plant = connection.driver("plant")
            assert isinstance(plant, Plant)
            self.plant = plant
            connection.machine.observers.append(self.observe)
            try:
                self.result = umo.drive(m, lambda m: main(m, peak=peak, soak=soak))
            except umo.TaskFailed as error:
                self.error = error
            self.last = plant.temperatures
        self.events = [event.text for event in connection.machine.events]

    def observe(self, frame: umo.Frame) -> None:
        m = self.machine
        if not self.phases or self.phases[-1][1] != frame.progress.text:
            self.phases.append((frame.time, frame.progress.text))
        quality = m.temperatures.quality.tolist()
        self.states.append((frame.time, quality, m.heaters.read().tolist(), m.fans.read().tolist()))


# A good run ------------------------------------------------------------------------------------------


@pytest.mark.full
def test_the_tunnel_follows_its_profile_and_soaks() -> None:
    run = Run(12, soak=30.0)
    assert run.result["zones_good"] == 12
    assert run.result["zones_faulted"] == "none"
    assert max(run.result["soak_errors_K"]) <= 5.0
    assert [text for _, text in run.phases] == ["heating up", "soaking", "done"]
    expected = 850.0 * np.interp(np.linspace(0, 1, 12), (0.0, 0.35, 0.75, 1.0), (0.4, 1.0, 1.0, 0.35))
    assert run.last == pytest.approx(expected, abs=5.0)  # the plant's truth
    assert run.plant.report()["highest_degC"] < 870.0
    assert run.states[-1][0] < 600.0


def test_the_setpoint_rises_by_the_ramp() -> None:
    m = machine(3)
    with umo.connect(m, SIMULATED):
        m.cycle.start(m.heat_up(500.0, 2.0))
        seen = []
        for _ in range(20):
            periods(m)
            seen.append(m.setpoint)
    assert [b - a for a, b in pairwise(seen)] == pytest.approx([0.2] * 19)


@pytest.mark.full
def test_a_thousand_zones_run() -> None:
    run = Run(1000, peak=120.0, soak=2.0)
    assert run.result["zones_faulted"] == "none"
    assert run.result["zones_good"] > 950
    assert len(run.result["soak_errors_K"]) == 1000


# Faults ----------------------------------------------------------------------------------------------


def test_a_broken_thermocouple_is_held_and_then_its_zone_is_faulted_while_the_others_go_on() -> None:
    run = Run(4, faults=["broken-thermocouple:2@30"])
    assert run.result["zones_faulted"] == "zone 2"
    assert run.result["zones_good"] == 3
    assert run.result["soak_errors_K"][2] is None
    assert [text for _, text in run.phases][:2] == ["heating up", "heating up, zone 2 faulted"]
    held = [time for time, quality, *_ in run.states if quality[2] == Quality.STALE]
    assert (held[0], held[-1]) == pytest.approx((30.1, 32.0), abs=0.11)
    bad = [(heaters[2], fans[2]) for time, quality, heaters, fans in run.states if quality[2] == Quality.BAD]
    assert set(bad) == {(0.0, 1.0)}
    assert all(fans[1] == 0.0 for time, _, _, fans in run.states if time > 1.0)
    assert run.last[2] < 300.0


def test_a_loose_thermocouple_is_ridden_over() -> None:
    run = Run(6, peak=300.0, faults=["loose-thermocouple:2@10"])
    assert run.result["zones_good"] == 6
    assert {quality[2] for _, quality, *_ in run.states} == {Quality.GOOD, Quality.STALE}


@pytest.mark.full
def test_a_zone_whose_temperature_stands_still_is_faulted_after_300_equal_readings() -> None:
    run = Run(soak=60.0, fault="zones.3.temperature stuck at 310 s")
    assert run.error is None
    assert run.result["zones_faulted"] == "zone 3"
    begin = next(time for time, text in run.phases if "zone 3 faulted" in text)
    assert begin == pytest.approx(340.0, abs=0.5)
    _, _, heaters, fans = run.states[-1]
    assert (heaters[3], fans[3]) == (0.0, 1.0)


@pytest.mark.parametrize("kind", first(1, ["out of range", "stuck 32000", "stuck -5000"]))
def test_a_reading_beyond_the_range_of_the_thermocouple_is_a_fault_of_its_zone_and_not_of_its_heater(kind: str) -> None:
    run = Run(12, peak=200.0, fault=f"zones.3.temperature {kind} at 30 s")
    assert run.error is None
    assert (run.result["zones_good"], run.result["zones_faulted"]) == (11, "zone 3")
    _, _, heaters, fans = run.states[-1]
    assert (heaters[3], fans[3]) == (0.0, 1.0)


@pytest.mark.full
def test_a_soak_by_a_clock_that_is_wrong_by_hours_is_refused() -> None:
    with pytest.raises(DriverError, match="outside its range"):
        Run(fault="timer out of range at 300 s")


@pytest.mark.full
@pytest.mark.parametrize(
    ("zones", "faults", "error", "message"),
    [
        (6, ["stuck-heater:2@20"], OverTemperature, r"zone 2: 10\d\d degC, the heater does not switch off"),
        (6, ["dead-heater:2@20"], HeatingError, "zone 2: 60 K below the setpoint"),
        (6, ["shorted-thermocouple:2@40"], HeatingError, r"zone 2: 1\d\d K below the setpoint"),
        (
            19,
            ["broken-thermocouple:1@20", "broken-thermocouple:18@30"],
            TooManyFaults,
            "2 of 19 zones are faulted: zones 1, 18",
        ),
        (1, ["broken-thermocouple:0"], TooManyFaults, "1 of 1 zones are faulted: zone 0"),
    ],
)
def test_each_end_is_a_clear_end(zones: int, faults: list[str], error: type[Exception], message: str) -> None:
    run = Run(zones, faults=faults)
    assert isinstance(run.error, error)
    with pytest.raises(error, match=message):
        raise run.error
    assert run.plant._levels[0].tolist() == [0] * zones
    if error is OverTemperature:
        assert run.events == ["inhibited: over-temperature"]
        assert [fans[2] for *_, fans in run.states[-20:]] == [1.0] * 20


@pytest.mark.full
def test_a_second_run_of_the_same_machine_begins_anew() -> None:
    m, runs = machine(4), []
    for faults in (["broken-thermocouple:1@20"], []):
        phases = []
        connection = umo.connect(m, SIMULATED, faults=faults)
        with connection:
            connection.machine.observers.append(lambda frame, phases=phases: phases.append(frame.progress.text))
            runs.append(umo.drive(m, lambda m: main(m, peak=200.0, soak=2.0)))
    assert [run["zones_faulted"] for run in runs] == ["zone 1", "none"]
    assert runs[1]["zones_good"] == 4
    assert not any("faulted" in text for text in phases)
    alone = Run(4, peak=200.0, soak=2.0)
    assert runs[1] == alone.result


@pytest.mark.full
def test_a_tenth_of_the_zones_may_be_faulted() -> None:
    run = Run(20, peak=200.0, faults=["broken-thermocouple:1@20", "broken-thermocouple:18@30"])
    assert run.result["zones_faulted"] == "zones 1, 18"


def test_a_zone_that_does_not_arrive_in_time_ends_the_run() -> None:
    m = machine(3)
    m.following_error = inf
    m.heating.gain = 1e-6
    with (
        umo.connect(m, SIMULATED),
        pytest.raises(HeatingError, match="zones 0, 1, 2 not within 5 K in time"),
    ):
        umo.drive(m, lambda m: main(m, peak=120.0, ramp=4.0))


@pytest.mark.parametrize("options", [{"peak": 976.0}, {"peak": 99.0}, {"peak": float("nan")}])
def test_a_peak_near_the_limit_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(RangeError, match="peak must be 100 to 975 degC"):
        Run(3, **options)


# The plant -------------------------------------------------------------------------------------------


@pytest.mark.full
def test_the_same_seed_gives_the_same_run() -> None:
    first, second, third = (Run(3, peak=100.0, seed=seed) for seed in (1, 1, 2))
    assert first.last.tolist() == second.last.tolist() != third.last.tolist()


def test_the_plant_is_as_large_as_its_wiring_and_keeps_its_heat() -> None:
    plant = Plant()
    heater, sensor, tick = (plant.channel(text) for text in ("heater:2", "thermocouple:2", "tick"))
    plant.open()
    assert len(plant.temperatures) == 3
    plant.write(heater, 1000)
    for _ in range(100):
        assert plant.read(tick) == 0
    hot = plant.temperatures[2]
    assert hot > 80.0
    assert Thermocouple("K").to_value(plant.read(sensor) * 0.002) == pytest.approx(hot, abs=15.0)  # it lags
    plant.close()
    plant.open()
    assert plant.temperatures[2] == hot
    for wrong, call in ((heater, plant.read), (sensor, lambda channel: plant.write(channel, 1))):
        with pytest.raises(DriverError, match="and cannot be"):
            call(wrong)


@pytest.mark.parametrize("text", ["heater:", "heater:-1", "heater:01", "oven:1", "fan", "heater:100000"])
def test_an_unknown_channel_is_refused(text: str) -> None:
    with pytest.raises(umo.errors.ChannelError, match="the forms are: heater:N, fan:N, thermocouple:N, tick"):
        Plant().channel(text)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("broken-thermocople:7", "did you mean 'broken-thermocouple'"),
        ("stuck-heater", "fault 'stuck-heater' is not KIND:ZONE or KIND:ZONE@SECONDS, such as stuck-heater:7@90"),
        ("stuck-heater:x", "is not KIND:ZONE"),
    ],
)
def test_a_fault_that_is_none_is_refused(fault: str, message: str) -> None:
    with pytest.raises(WiringError, match=message):
        Plant(faults=[fault])


def test_a_fault_of_a_zone_that_is_missing_is_refused() -> None:
    assert all(Plant(faults=[f"{fault}:1"]) for fault in FAULTS)
    with pytest.raises(DriverError, match="fault dead-heater:3: the furnace has 3 zones"):
        Run(3, faults=["dead-heater:3"])


# The station -----------------------------------------------------------------------------------------


def test_the_number_of_zones_is_an_option_of_the_machine() -> None:
    options = {option.name: option.taker for option in options_of(STATION, None)}
    assert options["zones"] == "machine"
    assert {"peak", "soak", "ramp"} <= options.keys()
    given = parse(STATION, None, ["--zones", "7", "--peak", "300", "--faults", "stuck-heater:3"])
    plan = Plan(Job("furnace", options=given))
    assert len(list(atoms(plan.machine))) == 3 * 7 + 1
    for wrong in (0, 5001):
        with pytest.raises(DeclarationError, match=f"a tunnel has 1 to 5000 zones, not {wrong}"):
            machine(wrong)


@pytest.mark.parametrize("zones", [1, 1000])
@pytest.mark.parametrize("name", ["simulated", "modbus"])
def test_both_wirings_fit_any_number_of_zones(name: str, zones: int) -> None:
    assert umo.check(machine(zones), STATION.wirings[name]) == []


def test_the_default_values_are_safe() -> None:
    zone = machine(1).zones[0]
    assert (zone.heater.default, zone.fan.default) == (0.0, OnOff.ON)


@pytest.mark.full
def test_it_runs_in_real_time_with_its_own_options(umo: Any) -> None:
    result = umo("run", "furnace", "--realtime", "--zones", "2", "--peak", "100", "--soak", "1", "--ramp", "4")
    assert result.exit_code == 0, result.stderr
    assert "zones good" in result.output


def test_umo_run_shows_the_results(umo: Any) -> None:
    options = "--zones 3 --peak 100 --soak 1 --faults broken-thermocouple:1@5"
    result = umo("run", "furnace", "--no-plot", *options.split())
    assert result.exit_code == 0, result.stderr
    assert "zones faulted" in result.output
    assert "zone 1" in result.output
