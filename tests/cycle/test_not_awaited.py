"""A sequence that was called and that nobody awaits is an error where it stands, not a warning."""

from __future__ import annotations

import contextlib
import gc
import inspect
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.machines import Bench, actuator, bench, relay, sensor, timer
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, connect, run
from umo.control import ServoAxis, first, move_together, next_period, together, unless, until, wait
from umo.cycle.not_awaited import hear
from umo.errors import NotAwaited
from umo.states import OnOff
from umo.testing import periods

Sequence = Callable[[Any], Any]


class Tank(Bench):
    """Sequences to forget."""

    async def fill(self) -> float:
        await wait("1 ms")
        return 1.0

    async def full(self) -> bool:
        return True


async def never_called(m: Any) -> None:
    """What is given to another sequence."""


class Slide(Compound):
    timer: DigitalSensor
    axis: ServoAxis


def slide() -> Slide:
    numbers = {"gain": 1.0, "velocity": 10.0, "acceleration": 100.0, "jerk": 1000.0, "window": 1.0}
    motor = actuator(limits="clamp")
    return Slide(timer=timer(), axis=ServoAxis(motor=motor, encoder=sensor(), following_error=50.0, **numbers))


def line_with(function: Callable[..., Any], text: str) -> int:
    """The number of the only line of a function that has this text."""
    lines, start = inspect.getsourcelines(function)
    (found,) = [number for number, line in enumerate(lines, start) if text in line]
    return found


INSTEAD = {
    "control": "write `cycle.start(...)` around it",
    "<lambda>": "a `lambda` does not wait: await it in a sequence",
}
"""What to write in a function that is no sequence: only what applies there."""


def refused(machine: Any, application: Sequence | None, call: str, name: str = "") -> str:
    """The error of a run that this call ends: it names the call, its line and what to write."""
    with pytest.raises(NotAwaited) as caught:
        run(machine, None, application)
    text = str(caught.value)
    place, _, rest = text.partition(": ")
    assert "test_not_awaited.py:" in place
    instead = INSTEAD.get(name, "write `await` before it")
    assert rest == f"nobody awaits `{call}`, so it does not run; {instead}"
    assert place.endswith(f" in {name or (application and application.__name__)}")
    return place


# umo's own and the user's ----------------------------------------------------------------------------


async def forgets_wait(m: Any) -> None:
    wait("1 s")


async def forgets_next_period(m: Any) -> None:
    next_period()


async def forgets_until(m: Any) -> None:
    until(lambda: False)


async def forgets_together(m: Any) -> None:
    together(never_called(m), never_called(m))


async def forgets_first(m: Any) -> None:
    first(never_called(m), wait("1 s"))


async def forgets_unless(m: Any) -> None:
    unless(lambda: False, never_called(m))


async def forgets_own(m: Any) -> None:
    m.fill()


async def forgets_function(m: Any) -> None:
    never_called(m)


FORGETFUL = [
    (forgets_wait, 'wait("1 s")'),
    (forgets_next_period, "next_period()"),
    (forgets_until, "until(lambda: False)"),
    (forgets_together, "together(never_called(m), never_called(m))"),
    (forgets_first, 'first(never_called(m), wait("1 s"))'),
    (forgets_unless, "unless(lambda: False, never_called(m))"),
    (forgets_own, "m.fill()"),
    (forgets_function, "never_called(m)"),
]


@pytest.mark.parametrize(("application", "call"), FORGETFUL, ids=lambda each: getattr(each, "__name__", ""))
def test_each_awaitable_that_is_forgotten_ends_the_run_at_its_line(application: Sequence, call: str):
    place = refused(bench(Tank), application, call)
    assert f":{line_with(application, call)} " in place


@pytest.mark.parametrize("motion", ["move_to(80.0)", "home()", "travel(80.0)", "search(1, 5.0)"])
def test_a_motion_that_is_forgotten_ends_the_run(motion: str):
    names: dict[str, Any] = {}
    source = f"async def main(m):\n    m.axis.{motion}\n"
    exec(compile(source, "of_a_user.py", "exec"), names)
    with pytest.raises(NotAwaited, match=rf"^of_a_user.py:2 in main: nobody awaits `{motion.split('(')[0]}\(...\)`"):
        run(slide(), None, names["main"])


async def forgets_both(m: Any) -> None:
    move_together((m.axis, 80.0))


def test_motions_together_that_are_forgotten_end_the_run():
    refused(slide(), forgets_both, "move_together((m.axis, 80.0))")


# Wherever it stands ----------------------------------------------------------------------------------


async def turns_for_ever(m: Any) -> None:
    while m.now >= 0.0:
        wait("10 ms")


async def asks_it(m: Any) -> None:
    while not m.full():
        await wait("1 ms")


async def compares_it(m: Any) -> None:
    m.motor.write(1.0 if m.full() == 1 else 2.0)


async def keeps_it(m: Any) -> None:
    filled = m.fill()
    await wait("2 ms")
    m.motor.write(3.0 if filled else 4.0)


async def overwrites_it(m: Any) -> None:
    last = None
    for _ in range(2):
        last = m.fill()
    await last  # type: ignore[misc]


async def gives_it_away(m: Any) -> None:
    str(m.fill())


async def in_another(m: Any) -> None:
    async def inner() -> None:
        kept = m.fill()
        await wait("2 ms")
        del kept

    await inner()


async def is_cleaning_up(m: Any) -> None:
    try:
        await wait("1 ms")
    finally:
        m.fill()


async def handles_an_error(m: Any) -> None:
    with contextlib.suppress(ValueError):
        try:
            raise ValueError
        except ValueError:
            m.fill()


async def handles_two_errors(m: Any) -> None:
    try:
        raise KeyError
    except KeyError:
        try:
            raise ValueError
        except ValueError:
            m.fill()
        await wait("1 ms")


async def in_a_condition(m: Any) -> None:
    await until(lambda: m.full())


ELSEWHERE = [
    (turns_for_ever, 'wait("10 ms")', "turns_for_ever"),
    (asks_it, "m.full()", "asks_it"),
    (compares_it, "m.full()", "compares_it"),
    (keeps_it, "m.fill()", "keeps_it"),
    (overwrites_it, "m.fill()", "overwrites_it"),
    (gives_it_away, "m.fill()", "gives_it_away"),
    (in_another, "m.fill()", "inner"),
    (is_cleaning_up, "m.fill()", "is_cleaning_up"),
    (handles_an_error, "m.fill()", "handles_an_error"),
    (handles_two_errors, "m.fill()", "handles_two_errors"),
    (in_a_condition, "m.full()", "<lambda>"),
]


@pytest.mark.parametrize(("application", "call", "name"), ELSEWHERE, ids=[each[2] for each in ELSEWHERE])
@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_it_is_an_error_wherever_it_stands(application: Sequence, call: str, name: str):
    place = refused(bench(Tank), application, call, name)
    assert f":{line_with(application, call)} " in place
    gc.collect()  # what the error has kept


def test_of_two_in_a_line_the_first_is_told():
    names: dict[str, Any] = {}
    exec(compile("async def main(m):\n    m.full(); m.fill()\n", "of_a_user.py", "exec"), names)
    with pytest.raises(NotAwaited, match=r"nobody awaits `full\(...\)`"):
        run(bench(Tank), None, names["main"])


def test_what_a_hook_returns_to_umo_is_told_where_the_user_has_called_umo():
    class Returned(Tank):
        def setup(self) -> Any:  # type: ignore[override]
            return self.fill()

    with (
        connect(bench(Tank)),
        pytest.raises(NotAwaited, match=r"in setup: nobody awaits `self.fill.*; nothing runs yet in `setup`"),
    ):
        bench(Returned)


class Calls(Tank):
    def control(self) -> None:
        self.motor.write(5.0)
        self.fill()


class Returns(Tank):
    def control(self) -> Any:
        return self.fill()


class Keeps(Tank):
    def control(self) -> None:
        filled = self.fill()
        self.motor.write(5.0 if filled else 4.0)


@pytest.mark.parametrize("kind", [Calls, Returns, Keeps])
def test_a_law_that_forgets_to_start_a_sequence_ends_the_run(kind: type[Tank]):
    place = refused(bench(kind), None, "self.fill()", "control")
    assert f":{line_with(kind.control, 'self.fill()')} " in place


def test_an_observer_that_makes_a_sequence_is_disabled_and_told(caplog: pytest.LogCaptureFixture):
    with (connection := connect(bench(Tank))) as m:
        connection.machine.observers.append(lambda frame: m.fill())
        periods(m, 3)
        assert connection.machine.observers == []
    assert "the observer is a sequence, and nothing awaits it: an observer must be a plain function" in caplog.text


# What becomes of the run -----------------------------------------------------------------------------


def test_nothing_of_its_period_is_sent_and_the_outputs_are_at_their_defaults():
    sent: list[float] = []

    async def application(m: Any) -> None:
        m.motor.write(2.0)
        await wait("2 ms")
        m.motor.write(7.0)
        m.fill()
        m.motor.write(8.0)
        await wait("2 ms")

    machine = bench(Tank)
    with pytest.raises(NotAwaited) as caught:
        run(
            machine,
            None,
            application,
            observers=[lambda frame: sent.append(frame.values[frame.items.index(machine.motor)])],
        )
    assert set(sent) == {2.0, 0.0}
    assert sent[-1] == 0.0
    assert caught.value.__notes__ == ["at 0.003 s"]


class Zone(Compound, equipment=True):
    lamp: BinaryActuator[OnOff]
    forgets: bool = False

    async def blink(self) -> None:
        await wait("1 ms")

    async def forgetful(self) -> None:
        self.lamp.write(OnOff.ON)
        await wait("2 ms")
        self.blink()

    def control(self) -> None:
        if self.forgets:
            self.blink()


class Zones(Compound):
    timer: DigitalSensor
    motor: DigitalActuator
    zone: Zone


def zones() -> Zones:
    return Zones(timer=timer(), motor=actuator(), zone=Zone(lamp=relay()))


@pytest.mark.parametrize("place", ["law", "sequence"])
def test_equipment_contains_it_and_the_rest_goes_on(place: str):
    with connect(zones()) as m:
        m.motor.write(3.0)
        if place == "law":
            m.zone.forgets = True
        else:
            m.zone.cycle.start(m.zone.forgetful())
        periods(m, 6)
        assert "nobody awaits `self.blink()`" in (m.zone.cycle.fault or "")
        assert (m.zone.lamp.read(), m.motor.read()) == (OnOff.OFF, 3.0)
        m.zone.forgets = False
        m.zone.cycle.clear()
        periods(m, 3)
        assert m.zone.cycle.fault is None


def test_whoever_awaits_a_sequence_gets_its_error():
    async def application(m: Any) -> str:
        try:
            await m.fill_wrongly()
        except NotAwaited as error:
            return str(error)
        return ""

    class Wrong(Tank):
        async def fill_wrongly(self) -> None:
            self.fill()

    assert "nobody awaits `self.fill()`" in run(bench(Wrong), None, application)


# What is no mistake ----------------------------------------------------------------------------------


async def stores_and_awaits(m: Any) -> Any:
    filling = m.fill()
    await wait("1 ms")
    return await filling


async def gathers(m: Any) -> Any:
    each = [m.fill() for _ in range(3)]
    return sum(await together(*each))


async def starts(m: Any) -> Any:
    m.cycle.start(m.fill())
    await wait("3 ms")
    return 1


async def fails_before_it_awaits(m: Any) -> Any:
    def fails() -> Any:
        raise ValueError

    with contextlib.suppress(ValueError):
        await together(m.fill(), fails())
    await wait("1 ms")
    return 1


async def catches_the_error(m: Any) -> Any:
    def fails() -> Any:
        raise ValueError

    try:
        await together(m.fill(), fails())
    except ValueError:
        await wait("1 ms")
    return 1


async def fails_before_another_awaits(m: Any) -> Any:
    def fails() -> Any:
        raise ValueError

    async def inner() -> None:
        await together(m.fill(), fails())

    try:
        await inner()
    except ValueError:
        await wait("1 ms")
    return 1


async def keeps_the_error(m: Any) -> Any:
    def fails() -> None:
        filling = m.fill()
        raise ValueError(filling is None)

    kept = None
    try:
        fails()
    except ValueError as error:
        kept = error
    await wait("1 ms")
    kept = None
    await wait("1 ms")
    return 1 if kept is None else 0


async def fails_in_another(m: Any) -> Any:
    async def inner() -> None:
        filling = m.fill()
        raise ValueError(filling)

    try:
        await inner()
    except ValueError:
        await wait("1 ms")
    return 1


async def cancels(m: Any) -> Any:
    async def inner() -> None:
        filling = m.fill()
        await wait("1 s")
        await filling

    task = m.cycle.start(inner())
    m.cycle.start(inner())  # the end of the run cancels it
    await wait("2 ms")
    task.cancel()
    await wait("2 ms")
    return 1


async def fails_beside_it(m: Any) -> Any:
    filling = m.fill()
    try:
        m.motor.write(1.0 / m.motor.pending)
        await filling
    except ZeroDivisionError:
        await wait("1 ms")
    return 1


async def need_not_await_it(m: Any) -> Any:
    filling = m.fill()
    if m.now < 0.0:
        await filling
    return 1


async def is_not_begun(m: Any) -> Any:
    await unless(lambda: True, m.fill())
    return 1


RIGHT = [stores_and_awaits, gathers, starts, is_not_begun]
INTERRUPTED = [
    fails_before_it_awaits,
    catches_the_error,
    fails_before_another_awaits,
    keeps_the_error,
    fails_in_another,
    cancels,
    fails_beside_it,
    need_not_await_it,
]


@pytest.mark.parametrize("application", RIGHT, ids=lambda each: each.__name__)
def test_what_is_awaited_or_started_later_is_no_mistake(application: Sequence):
    assert run(bench(Tank), None, application) >= 1.0


@pytest.mark.parametrize("application", INTERRUPTED, ids=lambda each: each.__name__)
@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_what_an_error_or_a_cancellation_has_ended_was_not_forgotten(application: Sequence):
    assert run(bench(Tank), None, application) >= 1.0
    gc.collect()


@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_the_error_that_comes_first_is_the_one_that_is_raised():
    async def application(m: Any) -> None:
        filling = m.fill()
        raise KeyError(filling is None)

    with pytest.raises(KeyError):
        run(bench(Tank), None, application)
    gc.collect()  # its frames are let go in this test


def test_what_the_collector_finds_is_not_blamed_on_the_code_at_that_place():
    class Circle:
        pass

    async def application(m: Any) -> int:
        circle: Any = Circle()
        circle.itself, circle.filling = circle, m.fill()
        del circle
        gc.collect()
        await wait("2 ms")
        return 1

    with pytest.warns(RuntimeWarning, match=r"coroutine 'Tank.fill' was never awaited"):
        assert run(bench(Tank), None, application) == 1


class Keeps(Tank):
    """Keeps a sequence for later, in an attribute."""

    def setup(self) -> None:
        self.job: Any = None
        self.turns = 0

    def keep(self) -> None:
        self.job = self.fill()

    def let_go(self) -> None:
        self.job = None

    async def turn(self) -> None:
        while True:
            self.turns += 1
            await next_period()


def test_what_an_attribute_has_at_the_end_is_told_then(caplog: pytest.LogCaptureFixture):
    async def application(m: Any) -> int:
        m.keep()
        await wait("2 ms")
        return 1

    assert run(bench(Keeps), None, application) == 1
    (record,) = caplog.records
    place, _, rest = record.getMessage().partition(": ")
    assert place.endswith(f"test_not_awaited.py:{line_with(Keeps.keep, 'self.fill()')} in keep")
    assert rest == "nobody awaits `self.fill()`, so it does not run; write `cycle.start(...)` around it"


def test_what_a_stop_has_kept_from_being_awaited_is_not_told(caplog: pytest.LogCaptureFixture):
    async def application(m: Any) -> None:
        m.keep()
        await wait("1 s")
        await m.job

    connection = connect(bench(Keeps), None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # Python's own, when it lets go of the sequence
        with connection as m:
            m.cycle.start(application(m))
            periods(m)
            connection.stop.request()
        del m, connection
        gc.collect()
    assert not [record for record in caplog.records if "awaits" in record.getMessage()]


def test_what_an_attribute_lets_go_elsewhere_is_told_with_its_line_and_ends_nothing():
    """It may have been one that an error has kept from being awaited."""

    async def application(m: Any) -> int:
        m.keep()
        await wait("2 ms")
        m.let_go()
        return 1

    with pytest.warns(RuntimeWarning, match=r"(?s)coroutine 'Tank.fill' was never awaited.*in keep"):
        assert run(bench(Keeps), None, application) == 1


def test_a_sequence_that_was_started_runs_on_whatever_becomes_of_the_attribute():
    with connect(bench(Keeps)) as m:
        m.job = m.cycle.start(m.turn())
        periods(m, 2)
        m.let_go()
        gc.collect()
        periods(m, 2)
        assert m.turns == 4


# The process around it -------------------------------------------------------------------------------


@pytest.fixture
def funnel() -> Iterator[Any]:
    """What Python tells of such sequences."""
    yield warnings._warn_unawaited_coroutine  # type: ignore[attr-defined]
    assert sys.get_coroutine_origin_tracking_depth() == 0
    assert sys.gettrace() is None


def test_after_a_run_all_is_as_it_was(funnel: Any):
    with connect(bench(Tank)):
        assert warnings._warn_unawaited_coroutine is not funnel  # type: ignore[attr-defined]
        with connect(zones()):
            pass
        assert warnings._warn_unawaited_coroutine is not funnel  # type: ignore[attr-defined]
    assert warnings._warn_unawaited_coroutine is funnel  # type: ignore[attr-defined]


def test_a_connection_that_fails_leaves_nothing_behind(funnel: Any):
    class Failing(Tank):
        def interlocks(self) -> Any:
            raise ValueError

    with contextlib.suppress(Exception), connect(bench(Failing)):
        pass
    assert warnings._warn_unawaited_coroutine is funnel  # type: ignore[attr-defined]


@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_other_threads_are_left_alone():
    errors: list[BaseException] = []

    def elsewhere() -> None:
        sys.set_coroutine_origin_tracking_depth(1)
        try:
            never_called(None)
        except BaseException as error:
            errors.append(error)

    with connect(bench(Tank)) as m:
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()
        periods(m, 2)
    assert errors == []


@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_a_debugger_that_traces_the_thread_traces_again_after_the_run():
    def trace(frame: Any, event: str, argument: Any) -> None:
        """Of nothing."""

    former = sys.gettrace()
    sys.settrace(trace)
    try:
        with contextlib.suppress(NotAwaited):
            run(bench(Tank), None, forgets_own)
        assert sys.gettrace() is trace

        async def application(m: Any) -> Any:
            await fails_before_another_awaits(m)
            return sys.gettrace()

        assert run(bench(Tank), None, application) is trace
    finally:
        sys.settrace(former)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_hearing_ends_with_the_last_machine_whichever_was_first(order: tuple[int, int]):
    ends = [hear(), hear()]
    for number in order:
        assert sys.get_coroutine_origin_tracking_depth() == 1
        ends[number]()
    assert sys.get_coroutine_origin_tracking_depth() == 0
