"""The user's code, called in one way: whatever it raises is told, and nothing of umo's own work ends by it."""

import math
import signal
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from typing import Any, Self

import pytest

from helpers.machines import Bench, actuator, bench, relay, sensor, switch, timer, wired
from umo import (
    Compound,
    DigitalActuator,
    DigitalSensor,
    Frame,
    Interlock,
    Number,
    Quality,
    TaskFailed,
    connect,
    published,
    run,
)
from umo.control import next_period
from umo.cycle.columns import Source
from umo.cycle.frame import Signal
from umo.errors import DeclarationError, DriverError, RangeError
from umo.objects import numbers_of
from umo.objects.linearization import Linearization
from umo.operation.alarms import Alarm
from umo.process.frames import Reader, Stage
from umo.process.reset import Resetter
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods
from umo.text import place_of
from umo.user_code import as_json, attempt, read_numbers
from umo.wiring import resolve


class Exit(BaseException):
    pass


class Refusing(Exception):
    """It lets nobody look at it."""

    def refuse(self, *_: object) -> Any:
        raise SystemExit(0)

    __str__ = __setattr__ = add_note = refuse
    __traceback__ = property(refuse)  # type: ignore[assignment]


RAISED = [SystemExit(0), KeyboardInterrupt(), GeneratorExit(), Exit(), ValueError(), Refusing()]


class Shown(Bench, numbers={"moody": Number(shown=True), "steady": Number(shown=True)}):
    """A signal that raises what it is given."""

    steady = 1.0
    mood: BaseException | None = None

    @property
    def moody(self) -> float:
        if self.mood is not None:
            raise self.mood
        return 2.0


def shown() -> Shown:
    return Shown(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())


async def drive_on(m: Bench) -> None:
    while True:
        m.motor.write(5.0)
        m.valve.write(OnOff.ON)
        await next_period()


def off(box: Scripted) -> bool:
    """Both outputs are at their defaults, and the box is closed."""
    return (box.get("motor"), box.get("valve"), box.calls[-1].segment) == (0, 0, "close")


@pytest.mark.parametrize("error", RAISED)
@pytest.mark.parametrize("where", ["observer", "signal", "both"])
def test_what_shows_a_failed_period_keeps_no_output_on_and_no_driver_open(where: str, error: BaseException) -> None:
    machine, box = shown(), Scripted()
    seen = []

    def observer(frame: Frame) -> None:
        seen.append((box.get("motor"), list(frame.signal_values)))
        if len(seen) == 5 and where != "signal":
            raise error

    def fail() -> int:
        machine.mood = error if where != "observer" else None
        raise OSError("unplugged")

    clock = VirtualTimer(on_period=lambda number: box.set("encoder", fail) if number == 5 else None)
    with pytest.raises(DriverError, match="unplugged"):
        run(machine, wired(machine, box, clock=clock), drive_on, observers=[observer])
    assert off(box)
    assert [motor for motor, _ in seen] == [10, 10, 10, 10, 0]  # the failed period was shown, after the reset
    assert math.isnan(seen[-1][1][0]) == (where != "observer")
    assert seen[-1][1][1] == 1.0


@pytest.mark.parametrize("move", ["write", "update", "part"])
def test_nothing_that_shows_the_end_of_a_run_moves_what_has_been_reset(
    move: str, caplog: pytest.LogCaptureFixture
) -> None:
    machine, box = bench(valve=relay(synchronous=False)), Scripted()

    def observer(frame: Frame) -> None:
        if connection.reached:
            machine.motor.write(5.0)
            {"write": lambda: machine.valve.write(OnOff.ON), "update": machine.update, "part": machine.motor.update}[
                move
            ]()

    connection = connect(machine, wired(machine, box))
    with pytest.raises(KeyError), connection as m:
        connection.machine.observers.append(observer)
        periods(m)
        m.timer.read()
        m.sample()
        raise KeyError
    assert off(box)
    assert "the machine has been reset; nothing is written any more" in caplog.text


class Compensated(Linearization):
    """A curve of the user's own, which fails from some moment on."""

    broken = False

    def over(self, minimum: float, maximum: float) -> Self:
        return self

    def to_value(self, x: float) -> float:
        return x

    def to_input(self, value: float) -> float:
        return value / (0.0 if self.broken else 1.0)


@pytest.mark.parametrize("by", ["leaving", "part", "guardian"])
def test_a_linearization_that_fails_keeps_no_actuator_from_being_reset(by: str) -> None:
    curve, box = Compensated(), Scripted()
    machine = bench(motor=actuator(default=1.0, linearization=curve))
    wires = wired(machine, box)
    resetter = Resetter(machine, resolve(machine, wires))
    with nullcontext() if by != "leaving" else pytest.raises(DriverError), connect(machine, wires) as m:
        m.motor.write(5.0)
        m.valve.write(OnOff.ON)
        m.update()
        curve.broken = True
        if by == "part":
            m.reset()
            assert (box.get("motor"), box.get("valve")) == (2, 0)
        elif by == "leaving":
            m.motor.write(4.0)
            m.update()
    if by == "guardian":
        assert resetter.reset(0.0) == {}
    assert (box.get("motor"), box.get("valve"), box.calls[-1].segment) == (2, 0, "close")


@pytest.mark.parametrize("whole", [True, False])
def test_a_linearization_that_fails_is_told_of_its_actuators_and_the_others_are_sent(whole: bool) -> None:
    curve, boxes = Compensated(), {"motor": Scripted(), "valve": Scripted()}
    machine = bench(motor=actuator(default=1.0, linearization=curve, expires="3 ms"))
    wires: dict[str, Any] = wired(machine, boxes["motor"])
    wires["drivers"]["other"] = boxes["valve"]
    wires["wire"]["valve"] = {"driver": "other"}
    with connect(machine, wires) as m:
        m.motor.write(5.0)
        periods(m)
        curve.broken = True
        periods(m)  # it is not asked again for what is sent already
        m.motor.write(4.0)
        m.valve.write(OnOff.ON)
        with pytest.raises(DriverError, match="its linearization failed") as caught:
            periods(m) if whole else m.motor.update()
        assert [failure.path for failure in caught.value.failures] == ["motor"]
        assert m.motor.quality is Quality.BAD
        assert (boxes["motor"].get("motor"), m.motor.read()) == (10, 5.0)
        assert boxes["valve"].get("valve") == whole
        with suppress(DriverError):
            periods(m, 1)
        with suppress(DriverError):
            periods(m, 1)
        periods(m, 2)  # expired: the default
        assert (boxes["motor"].get("motor"), m.motor.read(), m.motor.quality) == (2, 1.0, Quality.GOOD)


class Cell(Compound):
    bent: DigitalActuator
    plain: DigitalActuator
    gauge: DigitalSensor
    level: DigitalSensor
    timer: DigitalSensor


def cell(curve: Linearization) -> Cell:
    return Cell(
        bent=actuator(default=1.0, linearization=curve),
        plain=actuator(expires="3 ms"),
        gauge=sensor(linearization=curve, on_error="mark"),
        level=sensor(),
        timer=timer(),
    )


@pytest.mark.parametrize("whole", [True, False])
def test_a_linearization_that_fails_keeps_no_neighbour_of_its_block_from_being_sent(whole: bool) -> None:
    curve, box = Compensated(), Scripted()
    machine = cell(curve)
    with connect(machine, wired(machine, box)) as m:
        m.bent.write(5.0)
        m.plain.write(3.0)
        periods(m)
        curve.broken = True
        for _ in range(5):
            m.bent.write(4.0)
            with pytest.raises(DriverError, match="its linearization failed") as caught:
                if whole:
                    periods(m)
                else:
                    m.timer.read()
                    m.sample()
                    m.update()
            assert [failure.path for failure in caught.value.failures] == ["bent"]
        assert (m.plain.read(), m.plain.quality, m.bent.quality) == (0.0, Quality.GOOD, Quality.BAD)  # expired
        assert m.bent.read() == 5.0
        curve.broken = False
        periods(m)
        assert (m.bent.read(), m.bent.quality) == (4.0, Quality.GOOD)


def test_a_clients_write_is_refused_by_a_linearization_that_fails() -> None:
    curve = Compensated()
    machine = cell(curve)
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m:
        curve.broken = True
        with pytest.raises(ZeroDivisionError):
            connection.image.command(connection.image.slot_of[id(m.bent)], 5.0, Source.CLIENT)
        periods(m)
        assert m.bent.read() == 1.0


class Failing(Compensated):
    """A curve of the user's own that cannot be read either."""

    def to_value(self, x: float) -> float:
        return x / (0.0 if self.broken else 1.0)


def test_a_linearization_that_fails_is_a_failure_of_its_sensor_alone() -> None:
    curve = Failing()
    machine = cell(curve)
    with connect(machine, wired(machine, Scripted({"gauge": [4], "level": [6, 8]}))) as m:
        periods(m)
        assert m.gauge.quality is Quality.GOOD
        curve.broken = True
        periods(m)
        assert (m.gauge.quality, m.level.quality) == (Quality.BAD, Quality.GOOD)
        assert m.level.read() == 8 * m.level.resolution
        curve.broken = False
        periods(m)
        assert m.gauge.quality is Quality.GOOD


@pytest.mark.parametrize("error", RAISED)
def test_whatever_control_raises_ends_the_run_after_the_reset(error: BaseException) -> None:
    class Failing(Bench):
        def control(self) -> None:
            self.motor.write(5.0)
            if self.now > 0.002:
                raise error

    machine, box = Failing(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch()), Scripted()
    with pytest.raises(type(error) if isinstance(error, Exception) else TaskFailed):
        run(machine, wired(machine, box, clock=VirtualTimer()))
    assert off(box)


def test_the_end_of_a_run_keeps_its_place_whatever_shows_it() -> None:
    """An error that is told lets go of the frames that led to it; those of the run's end are not among them."""

    def observer(frame: Frame) -> None:
        if frame.number == 3:
            raise ValueError("of the observer")

    async def work(m: Bench) -> None:
        for _ in range(2):
            await next_period()
        raise KeyError("of the application")

    machine, box = shown(), Scripted()
    with pytest.raises(KeyError) as caught:
        run(machine, wired(machine, box, clock=VirtualTimer()), work, observers=[observer])
    assert "in work" in place_of(caught.value)


@pytest.mark.parametrize("again", [False, True])
def test_a_sequence_that_waits_goes_on_when_an_error_that_it_keeps_is_told(again: bool) -> None:
    kept: list[ValueError] = []

    def observer(frame: Frame) -> None:
        raise kept[0] if again else OSError("in fault") from kept[0]

    async def work(m: Bench) -> str:
        try:
            raise ValueError("a fault")
        except ValueError as error:
            kept.append(error)
            await next_period()
            await next_period()
        return "done"

    machine, box = shown(), Scripted()
    assert run(machine, wired(machine, box, clock=VirtualTimer()), work, observers=[observer]) == "done"


@pytest.mark.parametrize("error", RAISED)
def test_an_observer_that_raises_is_told_and_disabled_and_the_run_goes_on(
    error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    calls = []

    class Odd:
        def __call__(self, frame: Frame) -> None:
            calls.append(frame.number)
            raise error

        def __eq__(self, other: object) -> bool:
            raise SystemExit(0)

        def __repr__(self) -> str:
            raise SystemExit(0)

    machine, box = shown(), Scripted()
    run(machine, wired(machine, box, clock=VirtualTimer(end_after=4)), observers=[Odd(), Odd()])
    assert calls == [1, 1]
    assert sum("failed and was disabled" in record.message for record in caplog.records) == 2


@pytest.mark.parametrize("error", RAISED)
def test_a_condition_that_raises_inhibits_and_ends_nothing(error: BaseException) -> None:
    class Guarded(Shown):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(self.forbidden, [self.motor], "it must not")

        def forbidden(self) -> bool:
            if self.mood is not None:
                raise self.mood
            return False

    machine = Guarded(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())
    with connect(machine) as m:
        periods(m)
        assert m.motor.inhibited is None
        m.mood = error
        periods(m)
        assert type(error).__name__ in str(m.motor.inhibited)
        m.mood = None
        periods(m)
        assert m.motor.inhibited is None


@pytest.mark.parametrize("holds", [None, 1, "yes", [[]], object()])
def test_a_condition_that_gives_no_bool_inhibits_and_says_so(holds: Any) -> None:
    class Guarded(Bench):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: holds, [self.motor], "it must not")

    with connect(Guarded(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())) as m:
        assert "which is not True or False" in str(m.motor.inhibited)


def test_a_wrong_result_is_told_by_its_type_and_is_not_written_out_in_every_period() -> None:
    class Large:
        shown = 0

        def __repr__(self) -> str:
            Large.shown += 1  # of an array of 1000 numbers this takes 7 ms
            return "0, " * 1000

    class Guarded(Bench, alarms={"odd": Alarm(lambda _: [Large()], "odd")}):
        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: Large(), [self.motor], "it must not")

    machine = Guarded(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())
    with (connection := connect(machine)) as m:
        periods(m, 5)
        told = [event.text for event in connection.machine.events if event.path == "odd"]
        assert "it gives an object of the type list, which is not True or False" in told[0]
        assert "it gives an object of the type Large, which" in str(m.motor.inhibited)
    assert Large.shown == 0


def test_frames_show_the_failed_period_with_its_resets_and_then_the_end() -> None:
    machine, box = shown(), Scripted()
    connection = connect(machine, wired(machine, box))
    with pytest.raises(DriverError, match="unplugged"), connection as m, published(connection, "bench") as ring:
        reader = Reader(ring.path)
        m.motor.write(5.0)
        periods(m, 3)
        m.mood = SystemExit(0)
        box.set("encoder", OSError("unplugged"))
        periods(m)
    assert off(box)
    frame = reader.latest()
    assert frame is not None
    assert (int(frame["number"]), reader.values(frame)["motor"]) == (4, 0.0)
    assert frame["entries"] > 0
    assert not ring.path.exists()
    reader.close()


class Bare(Exception):
    args = 3  # type: ignore[assignment]


class Textless(Exception):
    __str__ = property(lambda self: 1 / 0)  # type: ignore[assignment]


@pytest.mark.parametrize("error", [Bare, Textless])
def test_an_error_that_cannot_be_told_ends_the_frames_as_any_other(error: type[Exception]) -> None:
    connection = connect(machine := bench(), wired(machine, Scripted()))
    with pytest.raises(error), connection, published(connection, "bench") as ring:
        reader = Reader(ring.path)
        raise error
    with reader:
        assert reader.events()[-1].event.text == error.__name__
        assert reader.state is Stage.ENDED
    assert not ring.path.exists()


@pytest.mark.parametrize("longest", [0, 5, 25, 100])
def test_a_result_is_cut_to_any_length(longest: int) -> None:
    assert len(as_json("x" * 1000, longest)) <= max(longest, 2)


@pytest.mark.parametrize("error", RAISED)
def test_a_number_that_cannot_be_read_is_nan(error: BaseException) -> None:
    m = shown()
    m.mood = error
    assert read_numbers([Signal("steady", "", m, "steady")]) == [1.0]
    with connect(m):
        assert math.isnan(read_numbers([Signal("moody", "", m, "moody")])[0])


@pytest.mark.parametrize("error", RAISED)
def test_what_a_declaration_raises_is_a_mistake_of_the_declaration(error: BaseException) -> None:
    def fail(self: Any) -> Any:
        raise error

    for made, keywords in (({}, {"numbers": fail}), ({"interlocks": fail}, {})):
        m = type("Wrong", (Bench,), made, **keywords)(
            timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch()
        )
        with pytest.raises(DeclarationError, match=type(error).__name__), connect(m):
            numbers_of(m)


@pytest.mark.parametrize("error", RAISED)
def test_a_tuned_number_that_its_owner_fails_to_take_is_as_it_was(error: BaseException) -> None:
    class Law:
        k = 0.5

        def check_settings(self) -> None:
            raise error

    class Tuned(Shown, numbers={"law.k": Number("", 0.0, 1.0, tunable=True)}):
        def setup(self) -> None:
            self.law = Law()

    with connect(Tuned(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())) as m:
        with pytest.raises(RangeError, match=rf"law\.k: .*{type(error).__name__}"):
            numbers_of(m)["law.k"].set(0.75)
        assert m.law.k == 0.5
        m.mood = error
        Tuned._settings = Tuned._settings._replace(numbers=({"moody": Number("", 0.0, 1.0, tunable=True)},))
        with pytest.raises(DeclarationError, match=f"number moody cannot be read: {type(error).__name__}"):
            numbers_of(m)


def test_only_a_ctrl_c_passes_an_attempt() -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            attempt(interrupted)
        with connect(shown()):
            _, error = attempt(interrupted)
            assert error is not None
            assert error.kind is KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_huge_text_of_an_error_is_cut() -> None:
    def complain() -> None:
        raise ValueError("no" * 1_000_000)

    _, error = attempt(complain)
    assert error is not None
    assert len(error.text) < 3000
