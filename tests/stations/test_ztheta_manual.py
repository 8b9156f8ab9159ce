"""The z-theta station in manual mode: a part in the air is held, the arm does not sink, and the part is placed."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from typing import Any

import pytest

import umo
from helpers.operator import Operator
from helpers.tiers import first
from tools.command_line import leaves
from umo.control.axis_state import AxisState
from umo.cycle.events import CommandState, Event
from umo.objects.units import convert
from umo.operation.commands.client_commands import Mode
from umo.states import OnOff
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine

pytest.importorskip("mujoco")

SECONDS = 1_000
"""Periods of a second."""


class Station(Operator):
    """An operator of the station; its plant."""

    def __init__(self, machine: Any, plant: Any) -> None:
        super().__init__(machine)
        self.plant: Any = plant
        self.m: Any = machine
        self.task = machine.cycle.start(main(machine, parts=1))
        self.do("lease", seconds=60.0)

    def until(self, condition: Callable[[], bool], most: int = 40 * SECONDS) -> None:
        for _ in range(most):
            if condition():
                return
            self.run()
        raise AssertionError("it did not come true")

    def last(self, number: int) -> Event:
        return [event for event in self.events if event.command == number][-1]

    def at(self, phase: str) -> None:
        self.until(lambda: phase in self.machine.progress.text)

    @property
    def holds_part(self) -> bool:
        return bool(self.m.gripper.sealed and self.m.gripper.vacuum.read() is OnOff.ON)

    def assert_placed(self) -> None:
        self.until(lambda: self.task.done)
        assert self.plant.truth().placed == 1, self.plant.truth()


@contextmanager
def station() -> Iterator[Station]:
    text = files("umo.stations.ztheta").joinpath("wiring/simulated.toml").read_text("utf-8")
    connection = umo.connect(machine(), tomllib.loads(text), parts=1, seed=3)
    with connection as m:
        yield Station(m, connection.driver("plant"))


@pytest.mark.slow
def test_the_examples_of_umo_do_work_in_their_order_from_the_start_of_a_run_in_manual_mode() -> None:
    (about,) = (each.epilog for name, each in leaves() if name == "do")
    examples = (shlex.split(each)[3:] for each in about.partition("\n\n")[0].split("  |  "))
    calls = [each[1:] for each in examples if each[:1] == ["call"]]
    assert [path for path, *_ in calls] == ["home", "z.move_to", "z.jog"]
    with station() as ann:
        ann.mode("manual")
        for path, *words in calls:
            given = dict(each.split("=") for each in words if "=" in each)
            ann.call(path, **{name: in_micrometres(text) for name, text in given.items()})
            number = ann.number
            if path == "z.jog":
                assert ann.answer(number).state is CommandState.DONE, ann.answer(number).text
                continue
            ann.until(lambda number=number: ann.last(number).state is not CommandState.BEGUN)
            assert ann.last(number).state is CommandState.DONE, ann.last(number).text


def in_micrometres(text: str) -> float:
    number, _, unit = text.partition(" ")
    return convert(float(number), unit, "um") if unit else float(number)


@pytest.mark.full
def test_a_part_in_the_air_is_held_in_manual_mode_and_placed_afterwards() -> None:
    with station() as ann:
        ann.at("turning")
        ann.run(SECONDS // 2)  # it turns
        ann.mode("manual")
        ann.run(SECONDS // 2)
        z, theta = ann.plant.z_um, ann.m.theta.encoder.read()
        ann.run(5 * SECONDS)
        assert ann.holds_part
        assert abs(ann.plant.z_um - z) < 1_000.0
        assert ann.m.theta.encoder.read() == pytest.approx(theta, abs=0.5)
        assert "gripper.vacuum ON (held, or its law)" in ann.driven

        assert ann.call("z.jog", velocity=5_000.0).state is CommandState.DONE
        ann.run(SECONDS)
        ann.do("let go", "z.jog")
        ann.run(SECONDS // 2)
        assert ann.plant.z_um > z + 4_000.0 and ann.holds_part
        refused = ann.mode("automatic")
        assert refused.state is CommandState.REFUSED
        assert "the application left it at 80000 µm; move it back (`z.move_to`)" in refused.text
        assert ann.call("z.move_to", position=80_000.0).state is CommandState.BEGUN
        ann.until(lambda: ann.m.z.state is AxisState.STANDSTILL)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.assert_placed()


@pytest.mark.full
def test_a_part_stays_held_when_nobody_has_the_lease_any_longer() -> None:
    with station() as ann:
        ann.at("placing")
        ann.run(SECONDS // 10)
        ann.mode("manual")
        ann.do("give back")
        ann.run(SECONDS // 5)
        z = ann.plant.z_um
        ann.run(3 * SECONDS)
        assert ann.holds_part and abs(ann.plant.z_um - z) < 1_000.0
        ann.do("lease", seconds=60.0)
        ann.mode("automatic")
        ann.assert_placed()


@pytest.mark.full
@pytest.mark.parametrize("after", first(1, [1_600, 4_400, 150, 700, 2_900]))
def test_manual_mode_at_any_moment_changes_no_result(after: int) -> None:
    """Also in homing, and while a part is gripped or blown off."""
    with station() as ann:
        ann.run(after)
        while not ann.task.done:
            ann.mode("manual")
            ann.run(300)
            assert ann.mode("automatic").state is CommandState.DONE, ann.events[-1]
            for _ in range(2_311):
                ann.run()
                if ann.task.done:
                    break
        ann.assert_placed()
        assert ann.clients.mode is Mode.AUTOMATIC
