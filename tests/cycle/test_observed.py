"""A run is the same whether somebody looks or not: what is called only for observers cannot change or end it."""

from __future__ import annotations

from enum import Enum
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, Number, connect
from umo.control import ServoAxis, wait
from umo.control.axis_state import AxisState
from umo.testing import Scripted, VirtualTimer, periods


class Odd(BaseException):
    """An error that no `except Exception` catches."""


class Colour(Enum):
    RED = 1


class Hostile:
    """Nothing that is done with it goes well."""

    def __float__(self) -> float:
        raise Odd

    def __index__(self) -> int:
        raise Odd

    def __repr__(self) -> str:
        raise Odd


def recursion() -> Any:
    return recursion()


def raising(error: BaseException) -> Any:
    def call() -> Any:
        raise error

    return call


ANSWERS: dict[str, Any] = {
    "an error": raising(ValueError("shown")),
    "exit": raising(SystemExit(0)),
    "interrupt": raising(KeyboardInterrupt()),
    "base": raising(Odd()),
    "stop": raising(StopIteration()),
    "recursion": recursion,
    "a text": lambda: "x",
    "nothing": lambda: None,
    "a large number": lambda: 10**400,
    "negative": lambda: -1,
    "300": lambda: 300,
    "hostile": Hostile,
    "another Enum": lambda: Colour.RED,
}
"""What user code may answer where it is asked only while somebody looks."""


class Slide(ServoAxis):
    answer: Any = None

    @property
    def state(self) -> Any:
        return self.answer()


class Machine(Compound, numbers={"load": Number("kN", shown=True), "phase": Number(shown=True)}):
    timer: DigitalSensor
    heater: DigitalActuator
    door: DigitalSensor
    z: Slide
    answer: Any = None

    @property
    def load(self) -> Any:
        return self.answer()

    @property
    def phase(self) -> Colour:
        found: Colour = self.answer()
        return found

    def control(self) -> None:
        self.heater.write(min(self.heater.pending + 0.5, 5.0))


def machine(answer: Any) -> Machine:
    axis = Slide(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp"),
        encoder=DigitalSensor("mm", minimum=-100.0, maximum=100.0, resolution=0.01),
        gain=1.0,
        velocity=10.0,
        acceleration=100.0,
        jerk=1000.0,
        window=1.0,
        following_error=50.0,
        answer=answer,
    )
    return Machine(timer=timer(), heater=actuator(), door=sensor(), z=axis, answer=answer)


def looks(frame: Any) -> None:
    assert len(frame.values) == len(frame.items)


def raises(frame: Any) -> None:
    raise Odd


def run_of(answer: Any, observers: list[Any], count: int = 6) -> tuple[Any, ...]:
    """Every call of the driver, the events, the result."""

    async def main(m: Any) -> str:
        m.z.enable()
        await wait("3 ms")
        return "ended"

    m, box = machine(answer), Scripted()
    connection = connect(m, wired(m, box, clock=VirtualTimer()))
    with connection:
        connection.machine.observers.extend(observers)
        task = m.cycle.start(main(m))
        periods(m, count)
        shown = connection.machine.image.columns.axes.tolist()
    return box.calls, list(connection.machine.events), task.result, shown


@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
def test_what_is_asked_for_observers_changes_no_run(answer: Any) -> None:
    """`axis.state` was asked unguarded, and only if somebody looked: an observer ended the run."""
    calls, events, result, _ = run_of(answer, [])
    for observers in ([looks], [raises], [raises, looks]):
        seen = run_of(answer, observers)
        assert (seen[0], seen[1], seen[2]) == (calls, events, "ended")
        assert result == "ended"


@settings(deadline=None, max_examples=20)
@given(st.lists(st.sampled_from(list(ANSWERS)), min_size=1, max_size=6))
def test_answers_that_change_from_period_to_period_change_no_run(names: list[str]) -> None:
    def changing() -> Any:
        state["asked"] += 1
        return ANSWERS[names[state["asked"] % len(names)]]()

    runs = []
    for observers in ([], [looks]):
        state = {"asked": 0}
        runs.append(run_of(changing, observers)[:3])
    assert runs[0] == runs[1]


def test_frames_show_the_state_of_the_axis_itself() -> None:
    shown = run_of(ANSWERS["an error"], [looks])[3]
    assert shown == [AxisState.STANDSTILL]


def test_an_axis_whose_profile_is_none_is_shown_as_an_error() -> None:
    m = machine(lambda: 0)
    with connect(m, wired(m, Scripted(), clock=VirtualTimer())):
        m.z.enable()
        m.z.profile = None  # type: ignore[assignment]
        assert m.z.shown_state() is AxisState.ERROR_STOP


class Asked(Compound, numbers={"load": Number(shown=True)}):
    timer: DigitalSensor
    asked = 0

    @property
    def load(self) -> float:
        self.asked += 1
        return 0.5


def test_a_signal_is_read_once_in_a_period_in_which_an_observer_asks_for_signals_and_else_never() -> None:
    machine = Asked(timer=timer())
    seen: list[list[float]] = []

    def asks(frame: Any) -> None:
        if frame.number % 2:
            seen.extend([frame.signal_values, frame.signal_values])

    connection = connect(machine, wired(machine, Scripted(), clock=VirtualTimer()))
    with connection as m:
        connection.machine.observers.append(asks)
        before = machine.asked
        periods(m, 6)
        assert machine.asked == before + 3
    assert seen == [[0.5]] * 6
