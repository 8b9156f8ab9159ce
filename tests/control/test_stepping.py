"""The edges that a step and direction drive sees."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from umo import BinaryActuator, Compound, connect
from umo.control import STEPS_PER_PERIOD, Stepping
from umo.states import Rotation, UpDown


class Stepper(Compound):
    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]


def stepper() -> Stepper:
    return Stepper(
        step=BinaryActuator(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
    )


def drive(targets: list[float]) -> tuple[Stepping, list[tuple[UpDown, Rotation]]]:
    """The levels at the hardware after each period."""
    levels = []
    with connect(stepper()) as m:
        law = Stepping(m.step, m.direction)
        for target in targets:
            law.control(target)
            m.update()
            levels.append((m.step.read(), m.direction.read()))
    return law, levels


def counted(levels: list[tuple[UpDown, Rotation]]) -> int:
    """What an independent drive makes of the levels: a step on each rising edge, as the direction stood before."""
    position, before = 0, (UpDown.DOWN, Rotation.CW)
    for now in levels:
        if now[0] is UpDown.UP and before[0] is UpDown.DOWN:
            assert now[1] is before[1], "the direction changed together with UP"
            position += 1 if before[1] is Rotation.CW else -1
        before = now
    return position


@given(st.lists(st.floats(-20, 20), min_size=1, max_size=6))
def test_the_drive_counts_what_was_sent_and_ends_within_half_a_step(ends: list[float]) -> None:
    law, levels = drive([end for end in ends for _ in range(130)])
    assert counted(levels) == law.count
    assert abs(law.count - ends[-1]) <= 0.5


def test_up_and_down_last_a_period_each() -> None:
    _, levels = drive([3.0] * 12)
    shown = [level is UpDown.UP for level, _ in levels]
    assert shown[:6] == [True, False, True, False, True, False]
    assert not any(shown[6:])


def test_a_reversal_waits_until_the_direction_has_stood_for_a_period() -> None:
    _, levels = drive([1.0] * 2 + [0.0] * 4)
    assert levels[2] == (UpDown.DOWN, Rotation.CCW)
    assert levels[3] == (UpDown.UP, Rotation.CCW)


def test_a_direction_that_has_not_reached_the_hardware_is_waited_for() -> None:
    with connect(stepper()) as m:
        law = Stepping(m.step, m.direction)
        for _ in range(3):  # no update in between
            assert law.control(-1.0) is False
            assert m.step.pending is UpDown.DOWN
        m.update()
        law.control(-1.0)
        assert (m.step.pending, law.count) == (UpDown.UP, -1)


def test_half_a_step_is_not_worth_one() -> None:
    with connect(stepper()) as m:
        law = Stepping(m.step, m.direction)
        for position in (0.5, -0.5):
            assert law.control(position) is True
            assert m.step.pending is UpDown.DOWN
        assert law.control(0.51) is False
        assert law.count == 1


def test_a_ramp_at_the_stated_rate_never_falls_behind() -> None:
    ramp = [i * STEPS_PER_PERIOD for i in range(500)]
    with connect(stepper()) as m:
        law = Stepping(m.step, m.direction)
        for target in ramp:
            law.control(target)
            m.update()
            assert abs(target - law.count) < 2.0


def test_done_is_said_within_half_a_step_with_the_output_down() -> None:
    with connect(stepper()) as m:
        law = Stepping(m.step, m.direction)
        said = []
        for _ in range(3):
            said.append(law.control(1.0))
            m.update()
        assert said == [False, False, True]


class Inhibited(BinaryActuator[UpDown]):
    """Takes nothing: as while an interlock holds it at its default."""

    __slots__ = ()

    def write(self, value: UpDown) -> bool:
        return False


def test_a_step_that_was_not_taken_is_not_counted() -> None:
    machine = Stepper(
        step=Inhibited(UpDown, one=UpDown.UP, default=UpDown.DOWN),
        direction=BinaryActuator(Rotation, one=Rotation.CW, default=Rotation.CW),
    )
    with connect(machine) as m:
        law = Stepping(m.step, m.direction)
        for _ in range(5):
            assert law.control(3.0) is False
            m.update()
        assert law.count == 0
