"""The z-theta station in virtual time: the paper's machine at its task, and every way in which it can fail."""

from __future__ import annotations

import random
import tomllib
from importlib.resources import files
from typing import Any

import pytest

import umo
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, TaskFailed
from umo.cycle.stage import Progress
from umo.errors import AxisError, HomingError
from umo.objects import Atomic, atoms, walk
from umo.stations.ztheta.application import main
from umo.stations.ztheta.control import Manipulator
from umo.stations.ztheta.errors import GripError
from umo.stations.ztheta.objects import machine

pytest.importorskip("mujoco")

from umo.stations.ztheta.plant import Plant


def wiring(name: str = "simulated", **parameters: float) -> dict[str, Any]:
    text = files("umo.stations.ztheta").joinpath(f"wiring/{name}.toml").read_text("utf-8")
    return tomllib.loads(text) | ({"parameters": parameters} if parameters else {})


class Run:
    """One run of the station: its plant afterwards, and where it was when the machine was left."""

    def __init__(self, wired: dict[str, Any], *, parts: int = 3, stop_at: int | None = None, **options: Any) -> None:
        self.machine = machine()
        self.connection = umo.connect(self.machine, wired, parts=parts, **options)
        self.stop_at = stop_at
        self.error: TaskFailed | None = None
        self.progress = Progress()

        async def application(m: Manipulator) -> None:
            await main(m, parts=parts)

        try:
            with self.connection as m:
                self.plant = self.connection.driver("plant")
                assert isinstance(self.plant, Plant)
                self.connection.machine.observers.append(self.observe)
                umo.drive(m, application)
                self.z_um = self.plant.z_um
        except TaskFailed as error:
            self.error = error
            self.z_um = self.plant.z_um

    def observe(self, frame: umo.Frame) -> None:
        self.progress = frame.progress
        if self.stop_at is not None and frame.number >= self.stop_at:
            self.connection.stop.request()

    def assert_safe(self) -> None:
        """Every actuator at its default, and z within 1 mm two seconds later."""
        levels = dict(zip(OUTPUTS, self.plant._levels, strict=False))
        assert levels == {text: int(text == "dio:direction") for text in OUTPUTS}
        self.plant.advance(2000)
        assert abs(self.plant.z_um - self.z_um) < 1_000.0


OUTPUTS = ["dac:z", "pwm:z", *(f"dio:{line}" for line in ("step", "direction", "z_index", "theta_index"))]
OUTPUTS += [f"dio:{line}" for line in ("counterweight", "vacuum", "pressure")]


@pytest.mark.parametrize(("seed", "parts"), first(1, [(0, 2), *((seed, 3) for seed in range(6))]))
def test_all_parts_are_placed_wherever_everything_starts(seed: int, parts: int) -> None:
    run = Run(wiring(), seed=seed, parts=parts)
    assert run.error is None
    report = run.plant.truth()
    assert report.placed == parts, report
    assert run.progress == ("done", parts, parts)
    run.assert_safe()


@pytest.mark.full
def test_the_drive_of_the_second_generation_does_the_same_work() -> None:
    """The paper's section 2.1: another converter, scale and polarity; only the wiring differs."""
    assert Run(wiring("second_generation"), parts=1, seed=3).plant.truth().placed == 1


@pytest.mark.full
def test_the_same_code_runs_at_a_longer_period_with_the_gains_of_that_circuit() -> None:
    slow = wiring(**wiring("modbus")["parameters"])
    slow["wire"]["timer"]["period"] = "5 ms"
    run = Run(slow, parts=1, seed=3)
    assert run.plant.truth().placed == 1


@pytest.mark.full
def test_the_same_code_runs_with_outputs_at_the_next_tick() -> None:
    run = Run(wiring() | {"process": {"outputs": "at next tick"}}, parts=1, seed=3)
    assert run.plant.truth().placed == 1
    run.assert_safe()


@pytest.mark.parametrize("period", first(1, random.Random(1998).sample(range(1, 16_000), 10)))
def test_stopped_at_any_period_the_arm_stays_where_it_is(period: int) -> None:
    run = Run(wiring(), parts=1, seed=period % 7, stop_at=period)
    assert run.progress.done == 0 or run.progress.text == "done"
    run.assert_safe()


FAILURES = {
    "no-part": (GripError, "no part was gripped in 2 tries"),
    "no-courier": (GripError, "no part was gripped in 2 tries"),
    "leaky-cup": (GripError, "no part was gripped in 2 tries"),
    "dropped-part": (GripError, "the part was lost"),
    "stalled-theta": (HomingError, "theta does not move"),
    "dead-theta-encoder": (HomingError, "theta does not move, or its encoder is dead"),
    "dead-z-encoder": (HomingError, "z does not move, or its encoder is dead"),
}


@pytest.mark.full
@pytest.mark.parametrize("fault", first(1, FAILURES))
@pytest.mark.parametrize("seed", first(1, [2, 1, 3]))
def test_every_fault_ends_in_its_own_clear_failure(fault: str, seed: int) -> None:
    kind, message = FAILURES[fault]
    run = Run(wiring(), parts=2, seed=seed, faults=[fault])
    assert type(run.error) is kind
    assert message in str(run.error)
    assert run.plant.truth().placed < 2
    run.assert_safe()


def test_an_over_driven_stepper_is_found_by_the_encoder() -> None:
    run = Run(wiring(**{"theta.acceleration": 1e6, "theta.jerk": 1e10}), seed=3)
    assert isinstance(run.error, AxisError)
    assert "theta lost steps" in str(run.error)
    run.assert_safe()


@pytest.mark.full
def test_a_part_that_comes_late_is_gripped_at_the_second_try() -> None:
    run = Run(wiring(courier_time=0.0, transit_height=100_100.0), parts=1, seed=1)
    assert run.plant.truth().placed == 1


@pytest.mark.full
def test_homing_succeeds_when_the_counters_are_known_from_a_run_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control ended and begins again while the circuits stayed on: crossing the index changes nothing."""
    plant = Plant(seed=3, parts=1)
    wired = wiring()
    wired["drivers"]["plant"] = plant

    async def one(m: Manipulator) -> None:
        await main(m, parts=1)

    umo.run(machine(), wired, Manipulator.home)
    monkeypatch.setattr("umo.stations.ztheta.physics.Physics.power_up", lambda self: None)
    umo.run(machine(), wired, one)
    assert plant.truth().placed == 1


def test_the_tree_is_that_of_figure_4() -> None:
    m = machine()
    compounds = [m, *(node for node in walk(m) if isinstance(node, Compound))]
    assert [type(node).__name__ for node in compounds] == [
        "Manipulator",
        "ZAxis",
        "ThetaAxis",
        "Counterweight",
        "Gripper",
    ]
    assert {item.path for item in atoms(m)} == {
        "z.motor",
        "z.encoder",
        "z.encoder_zero",
        "theta.step",
        "theta.direction",
        "theta.encoder",
        "theta.encoder_zero",
        "counterweight.vacuum",
        "counterweight.pressure",
        "gripper.vacuum",
        "gripper.pressure",
        "pressure_solenoid",
        "timer",
    }
    asynchronous: list[Atomic] = [item for item in atoms(m) if not item.synchronous]
    assert [item.path for item in asynchronous] == ["z.encoder_zero", "timer"]


def test_the_numbers_are_those_of_listing_5() -> None:
    m = machine()
    assert isinstance(m.z.motor, DigitalActuator)
    assert m.z.motor.calibration[:4] == (-10.0, 10.0, 10.0 / 2047, 0.0)
    assert m.z.encoder.calibration[:4] == (55_000.0, 129_000.0, 4.64357, -147_871.0)
    assert m.theta.encoder.calibration[:4] == (-270.0, 270.0, 0.000529483, 227.4438)
    assert m.counterweight.pressure.calibration[:4] == (0.0, 1000.0, 1.0, 0.0)
    assert isinstance(m.pressure_solenoid, BinaryActuator)
    assert (m.z.motor.units, m.z.encoder.units, m.theta.encoder.units) == ("V", "um", "deg")
