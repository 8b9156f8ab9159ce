"""The states of an axis in PLCopen's words, and its description in frames."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers.axis_rig import Machine, index_pulse, machine, run, wiring
from helpers.slide import INDEX, Slide, encoder, servo
from umo import published
from umo.control import ServoAxis, next_period, wait
from umo.control.axis_state import AxisState
from umo.errors import EquipmentFault
from umo.faces.face_declaration import declaration_of
from umo.frames import Reader


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
