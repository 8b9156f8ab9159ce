"""The states of an axis in PLCopen's words, and its description in frames."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest

import umo
from helpers.axis_rig import Machine, index_pulse, machine, run, wiring
from helpers.slide import INDEX, LOW, Slide, encoder, servo
from helpers.tiers import some
from umo import published
from umo.control import EndStop, ServoAxis, next_period, wait
from umo.control.axis_state import FOLLOWED_BY, AxisState
from umo.errors import AxisError, BadInput, Busy, EquipmentFault, HomingError, TaskFailed, UmoError
from umo.process.frames import Reader
from umo.process.frames.machine_items import declaration_of


def changes(work: Any, slide: Slide | None = None, **options: Any) -> list[AxisState]:
    """The states of the axis one after the other while it does the work."""
    found: list[AxisState] = []

    def watch(m: Machine) -> None:
        if not found or found[-1] is not m.x.state:
            found.append(m.x.state)

    async def referenced(m: Machine) -> None:
        await next_period()
        m.x.encoder.referenced(at=40.0)
        await work(m)

    run(machine(servo(**options)), slide or Slide(), referenced, watch)
    return found


def test_a_motion_to_a_position_ends_at_standstill() -> None:
    async def work(m: Machine) -> None:
        await m.x.move_to(50.0)
        await next_period()
        m.x.disable()
        await next_period()

    S = AxisState
    assert changes(work) == [S.DISABLED, S.DISCRETE_MOTION, S.STANDSTILL, S.DISABLED]


def test_a_jog_decelerates_before_it_stands() -> None:
    async def work(m: Machine) -> None:
        m.x.jog(50.0)
        await wait(0.3)
        m.x.halt()
        await wait(0.5)

    S = AxisState
    assert changes(work) == [S.DISABLED, S.CONTINUOUS_MOTION, S.STOPPING, S.STANDSTILL]


def test_homing_is_a_state_of_its_own() -> None:
    m = machine(servo(encoder=encoder(zero_offset=INDEX)))
    m.x.homing = index_pulse(m)
    found: set[AxisState] = set()
    run(m, Slide(), lambda m: m.x.home(), lambda m: found.add(m.x.state))
    assert AxisState.HOMING in found


def test_an_axis_in_fault_is_in_error_stop() -> None:
    class Own(ServoAxis, equipment=True):
        pass

    slide = Slide()
    axis = servo()
    axis.__class__ = Own
    seen: list[AxisState] = []

    async def work(m: Machine) -> None:
        await next_period()
        m.x.encoder.referenced(at=40.0)
        slide.stuck = True
        with pytest.raises(EquipmentFault):
            await m.x.move_to(60.0)
        await next_period()
        seen.append(m.x.state)

    run(machine(axis), slide, work)
    assert seen == [AxisState.ERROR_STOP]


async def tried(motion: Any) -> None:
    with suppress(UmoError):
        await motion


class LostItsSwitch:
    async def find(self, axis: Any) -> None:
        await next_period()
        axis.disable()
        raise HomingError("x: no switch")


class NotReady(ServoAxis, equipment=True):
    def enable(self) -> None:
        raise AxisError("x: the drive is not ready")


class DriveFault(ServoAxis, equipment=True):
    async def travel(self, position: float, **keys: Any) -> None:
        await wait(0.05)
        self.disable()
        raise AxisError("x: the drive has reported E42")


class HomedEquipment(ServoAxis, equipment=True):
    pass


@pytest.mark.parametrize(
    ("kind", "error"),
    [(HomedEquipment, "no switch"), (NotReady, "the drive is not ready"), (DriveFault, "the drive has reported E42")],
)
def test_an_axis_of_equipment_that_fails_is_in_fault_though_it_is_not_enabled(kind: Any, error: str) -> None:
    axis = servo()
    axis.__class__ = kind
    axis.homing = LostItsSwitch()
    seen: list[Any] = []

    async def work(m: Machine) -> None:
        await next_period()
        m.x.encoder.referenced(at=40.0)
        with pytest.raises((AxisError, HomingError, EquipmentFault), match=error):
            await (m.x.home() if kind is HomedEquipment else m.x.move_to(60.0))
        seen.append((m.x.state, error in str(m.x.cycle.fault)))

    run(machine(axis), Slide(), work)
    assert seen == [(AxisState.ERROR_STOP, True)]


def test_an_axis_of_equipment_that_others_disable_is_in_no_fault_nor_is_one_that_is_busy() -> None:
    axis = servo()
    axis.__class__ = HomedEquipment

    async def work(m: Machine) -> None:
        await next_period()
        m.x.encoder.referenced(at=40.0)
        motion = m.cycle.start(tried(m.x.move_to(60.0)))
        await wait(0.05)
        with pytest.raises(Busy):
            await m.x.move_to(50.0)
        m.x.disable()
        await motion
        assert (m.x.state, m.x.cycle.fault) == (AxisState.DISABLED, None)

    run(machine(axis), Slide(), work)


def test_an_axis_that_is_disabled_while_homing_accepts_no_more_than_any_other() -> None:
    class Search:
        async def find(self, axis: Any) -> None:
            await axis.search(5.0)

    async def work(m: Machine) -> None:
        m.x.homing = Search()
        motion = m.cycle.start(tried(m.x.home()))
        await wait(0.1)
        m.x.disable()
        with pytest.raises(BadInput):
            m.x.enable()
        await motion

    run(machine(servo()), Slide(), work)


def test_a_motion_ends_with_the_axis_disabled_although_it_is_enabled_again_in_the_same_period() -> None:
    async def work(m: Machine) -> None:
        motion = m.x.cycle.start(m.x.move_to(60.0))
        await wait(0.1)
        m.x.disable()
        m.x.enable()
        m.x.jog(5.0)  # it is free
        with pytest.raises(TaskFailed, match="x was disabled during its motion"):
            await motion
        await wait(0.1)
        assert m.x.state is AxisState.CONTINUOUS_MOTION

    changes(work)


class Watched(ServoAxis):
    """It notes which state follows which."""

    def setup(self) -> None:
        super().setup()
        self.passed: set[tuple[AxisState, AxisState]] = set()

    def _enter(self, state: AxisState) -> None:
        self.passed.add((self._state, state))
        super()._enter(state)


@pytest.mark.parametrize("seed", some(lambda seed: seed < 2, range(10)))
def test_states_follow_one_another_as_the_table_says(seed: int) -> None:
    random, slide = Random(seed), Slide()
    m = machine(servo(following_error=1e9))
    m.x.__class__ = Watched
    m.x.setup()
    m.x.homing = EndStop(position=LOW, clearance=10.0)
    calls: list[Any] = [
        lambda: m.x.jog(random.uniform(-50.0, 50.0)),
        lambda: m.cycle.start(tried(m.x.move_to(random.uniform(20.0, 60.0)))),
        lambda: m.cycle.start(tried(m.x.home())),
        lambda: m.x.halt(),
        lambda: m.x.enable(),
        lambda: m.x.disable(),
    ]

    async def work(m: Machine) -> None:
        await next_period()
        started: list[Any] = []
        for _ in range(100):
            with suppress(UmoError):
                started.append(random.choice(calls)())
            if random.random() < 0.3 and started and (last := started.pop()) is not None:
                last.cancel()
            await wait(random.choice((0.001, 0.01, 0.2)))

    run(m, slide, work)
    passed = {each for each in m.x.passed if each[0] is not each[1]}
    assert len(passed) > 6
    assert [each for each in passed if each[1] not in FOLLOWED_BY[each[0]]] == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
def test_frames_describe_the_axis_and_have_its_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path))
    m = machine(servo())
    connection = umo.connect(m, wiring(m, Slide()))
    with connection, published(connection, "slide") as ring, Reader(ring.path) as reader:
        (axis,) = reader.layout.axes
        state = declaration_of(reader).by_name["axis:x"]

        async def work(m: Machine) -> None:
            await next_period()
            m.x.encoder.referenced(at=40.0)
            m.x.jog(10.0)
            await next_period()
            await next_period()

        umo.drive(m, work)
        frame = reader.latest()
    assert frame is not None
    assert axis["states"][frame["axes"][0]] == "continuous_motion"
    assert (axis["path"], axis["position"], axis["units"]) == ("x", "x.encoder", "mm")
    assert {axis[name] for name in ("move", "jog", "disable")} <= {each["path"] for each in reader.layout.actions}
    assert (state.minimum, state.maximum) == (None, None)  # a state has no range
    assert axis["home"] is None
    assert axis["velocity"] in {each["path"] for each in reader.layout.tunables}
    assert {axis["setpoint"], axis["error"]} <= set(reader.signals)
