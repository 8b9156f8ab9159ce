"""What is given to a wait in the place of a condition is refused with the line and what to write; so is a sequence
where umo calls a plain function, and a plain function where it awaits one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.machines import Bench, bench
from umo import Compound, Interlock, connect, run
from umo.control import Lock, ServoAxis, timeout, together, unless, until, wait
from umo.drivers import Channel, Driver, HasWatchdog
from umo.errors import DeclarationError, text_of
from umo.operation import PackML, Procedure
from umo.operation.alarms import Alarm
from umo.states import OnOff, PassFail

PLACE = r"\(\S*test_asked_conditions.py:\d+\)"


class Tank(Bench):
    lock: Any = None

    async def fill(self) -> float:
        await wait("1 ms")
        return 1.0


async def an_object(m: Any) -> None:
    await until(m.limit)


async def an_actuator(m: Any) -> None:
    await until(m.valve, timeout="1 s")


async def a_number_object(m: Any) -> None:
    await until(m.encoder)


async def a_state(m: Any) -> None:
    await until(m.limit.read())


async def a_comparison(m: Any) -> None:
    await until(m.encoder.read() > 3.0)


async def over_lines(m: Any) -> None:
    await until(
        m.encoder.read() > 3.0
        and m.limit.read() is PassFail.PASS,
        timeout="1 s",
    )  # fmt: skip


async def a_value(m: Any) -> None:
    await until(m.encoder.read())


async def a_sequence(m: Any) -> None:
    await until(m.fill())


async def a_task(m: Any) -> None:
    filling = m.cycle.start(m.fill())
    await until(filling)


async def a_name(m: Any) -> None:
    ready = m.now > 1.0
    await until(ready)


async def to_unless(m: Any) -> None:
    await unless(m.encoder.read() > 3.0, m.fill())


async def a_method_of_an_object(m: Any) -> None:
    await until(m.limit.read)


async def a_method_of_a_number(m: Any) -> None:
    await until(m.encoder.read)


async def a_function_that_waits(m: Any) -> None:
    async def ready() -> bool:
        return False

    await until(ready)


async def nothing(m: Any) -> None:
    await until(None)  # type: ignore[arg-type]


TAKES = "() takes a function, which it calls in every period; "
REFUSED: list[tuple[Callable[[Any], Any], str]] = [
    (an_object, f"until{TAKES}`m.limit` is an object: write `until(lambda: m.limit.read() is PassFail.FAIL)`"),
    (an_actuator, f"until{TAKES}`m.valve` is an object: write `until(lambda: m.valve.read() is OnOff.ON)`"),
    (
        a_number_object,
        f"until{TAKES}`m.encoder` is an object: write, for example, `until(lambda: m.encoder.read() > 5.0)`",
    ),
    (
        a_state,
        f"until{TAKES}`m.limit.read()` was read only once, before the call, and gave PASS: "
        "write `until(lambda: m.limit.read() is PassFail.PASS)`",
    ),
    (
        a_comparison,
        f"until{TAKES}`m.encoder.read() > 3.0` was evaluated only once, before the call, and gave False: "
        "write `until(lambda: m.encoder.read() > 3.0)`",
    ),
    (over_lines, "write `until(lambda: m.encoder.read() > 3.0 and m.limit.read() is PassFail.PASS)`"),
    (a_value, "and gave 0.0: write `until(lambda: m.encoder.read())`"),
    (a_sequence, f"until{TAKES}`m.fill()` is a sequence: write `await m.fill()`"),
    (a_task, f"until{TAKES}`filling` is a task: write `await filling`, or `until(lambda: filling.done)`"),
    (a_name, "`ready` was evaluated only once, before the call, and gave False: write `until(lambda: ready)`"),
    (to_unless, "write `unless(lambda: m.encoder.read() > 3.0)`"),
    (a_method_of_an_object, "is true or false: write `until(lambda: m.limit.read() is PassFail.FAIL)`"),
    (a_method_of_a_number, "is true or false: write, for example, `until(lambda: m.encoder.read() > 5.0)`"),
    (a_function_that_waits, "until() needs a condition that answers immediately, but ready is a sequence: `def ready`"),
    (nothing, "`None` was evaluated only once, before the call, and gave None"),
]


@pytest.mark.parametrize(("application", "text"), REFUSED, ids=lambda each: getattr(each, "__name__", ""))
def test_what_is_no_condition_is_refused_with_its_line_and_what_to_write(application: Any, text: str):
    with pytest.raises(TypeError) as caught:
        run(bench(Tank), None, application)
    assert text in str(caught.value)
    assert f"in {application.__name__})" in text_of(caught.value)


def test_a_condition_of_a_started_wait_is_told_without_the_source():
    async def application(m: Any) -> None:
        m.cycle.start(until(False))  # type: ignore[arg-type]
        await wait("3 ms")

    with pytest.raises(TypeError, match=r"False is not a function: write `until\(lambda: ...\)`"):
        run(bench(Tank), None, application)


# Functions that were not called ----------------------------------------------------------------------


def test_a_sequence_that_was_not_called_is_named():
    async def starts(m: Any) -> None:
        m.cycle.start(m.fill)

    async def gathers(m: Any) -> None:
        await together(m.fill, m.fill)

    for application in (starts, gathers):
        with pytest.raises(TypeError, match=r"fill is an `async def` function and was not called: write `fill\(\)`"):
            run(bench(Tank), None, application)


def test_several_sequences_are_given_by_a_star():
    async def gathers(m: Any) -> None:
        await together([m.cycle.start(m.fill()), m.cycle.start(m.fill())])

    with pytest.raises(TypeError, match=r"a list is not a sequence; give several with a star: `tog"):
        run(bench(Tank), None, gathers)


def test_a_sequence_is_no_result_so_far():
    async def given(m: Any) -> None:
        m.cycle.result(m.fill())

    async def asked(m: Any) -> None:
        m.cycle.result(m.fill)

    with pytest.raises(TypeError, match="`fill` is a sequence, not a result: write `await` before its call"):
        run(bench(Tank), None, given)
    with pytest.raises(DeclarationError, match=f"the function of a result is a sequence; it must act at once.*{PLACE}"):
        run(bench(Tank), None, asked)


def test_an_application_that_is_no_sequence_is_refused_with_its_place():
    def plain(m: Any) -> None:
        """Nothing."""

    async def yields(m: Any) -> Any:
        yield 1

    with pytest.raises(
        DeclarationError,
        match=rf"plain is not a sequence, but an application must be one: write `async def plain` "
        f"{PLACE}",
    ):
        run(bench(), None, plain)  # type: ignore[arg-type]
    with pytest.raises(
        DeclarationError,
        match=rf"yields is not a sequence, but an application must be one: there is a `yield` in it "
        f"{PLACE}",
    ):
        run(bench(), None, yields)


# Sequences where a plain function is called ----------------------------------------------------------


@pytest.mark.parametrize("name", ["control", "setup", "interlocks", "on_suspend", "sample", "update", "reset"])
def test_a_hook_of_a_compound_is_no_sequence(name: str):
    async def hook(self: Any) -> None:
        """It would never be carried out."""

    with pytest.raises(
        DeclarationError, match=rf"Wrong.{name} is a sequence; it must act at once: `def {name}.*{PLACE}"
    ):
        type("Wrong", (Compound,), {name: hook})
    mixin = type("Mixin", (), {name: hook})
    with pytest.raises(DeclarationError, match=f"Wrong.{name} is a sequence"):
        type("Wrong", (mixin, Compound), {})


def test_what_a_law_takes_long_for_is_started():
    with pytest.raises(DeclarationError, match=r"control is a sequence; .*; a sequence is started in it: `self.cycle"):

        class Wrong(Compound):
            async def control(self) -> None:
                """It would never be carried out."""


def test_a_plain_method_of_an_axis_is_no_sequence():
    with pytest.raises(DeclarationError, match=r"Wrong.enable is a sequence; .*: `def enable\(self\)`"):

        class Wrong(ServoAxis):
            async def enable(self) -> None:  # type: ignore[override]
                """It would never be carried out."""


@pytest.mark.parametrize("base", [PackML, Procedure])
def test_a_refusal_of_states_is_no_sequence(base: type):
    async def refusal(self: Any, command: str) -> None:
        """Every command would be refused."""

    with pytest.raises(DeclarationError, match=rf"Wrong.refusal is a sequence; .*{PLACE}"):
        type("Wrong", (base,), {"refusal": refusal})


@pytest.mark.parametrize("name", ["read", "write", "open", "close", "reset", "read_many", "watchdog"])
def test_a_function_of_a_driver_is_no_sequence(name: str):
    async def function(self: Any, *given: Any) -> int:
        return 0

    with pytest.raises(DeclarationError, match=rf"Card.{name} is a sequence; .*{PLACE}"):
        type("Card", (Driver, HasWatchdog), {name: function, "channel": lambda self, text: Channel(text)})


def test_the_condition_of_an_interlock_or_an_alarm_is_no_sequence():
    async def open_now(*given: Any) -> bool:
        return True

    class Guarded(Bench):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(open_now, [self.valve], "open")

    with pytest.raises(DeclarationError, match=rf"the condition of an interlock is a sequence; .*{PLACE}"):
        connect(bench(Guarded)).__enter__()
    with pytest.raises(DeclarationError, match=rf"the condition of an alarm is a sequence; .*{PLACE}"):
        Alarm(open_now, "open")


def test_an_observer_is_no_sequence():
    async def look(frame: Any) -> None:
        """It would see nothing."""

    with pytest.raises(DeclarationError, match=rf"an observer is a sequence; .*{PLACE}"):
        run(bench(), None, observers=[look])


def test_sequences_of_ones_own_are_as_free_as_before():
    class Right(Tank):
        async def on_resume(self) -> None:
            """A sequence, as it is."""

        async def open_valve(self) -> None:
            self.valve.write(OnOff.ON)

        def control(self) -> None:
            """Plain, as it is."""

    with connect(bench(Right)) as m:
        assert m.cycle.connected


# Blocks and awaits -----------------------------------------------------------------------------------


async def a_plain_with(m: Any) -> None:
    with timeout("1 s"):  # type: ignore[attr-defined]
        await m.fill()


async def a_plain_lock(m: Any) -> None:
    with m.lock:
        await m.fill()


async def an_await_without_a_call(m: Any) -> None:
    await m.fill


async def an_await_of_a_part(m: Any) -> None:
    await m.valve


@pytest.mark.parametrize(
    ("application", "text"),
    [
        (a_plain_with, "a timeout is entered by `async with`, in a sequence"),
        (a_plain_lock, "a Lock is entered by `async with`, in a sequence"),
        (an_await_without_a_call, "object method can't be used in 'await' expression: it is not called; write `await"),
        (an_await_of_a_part, "expression; a sequence can await only the functions of umo.control"),
    ],
)
def test_a_block_or_an_await_of_the_wrong_kind_is_told_with_its_line(application: Any, text: str):
    machine = bench(Tank)
    machine.lock = Lock()
    with pytest.raises(TypeError) as caught:
        run(machine, None, application)
    assert text in str(caught.value)
    assert f"in {application.__name__})" in text_of(caught.value)
