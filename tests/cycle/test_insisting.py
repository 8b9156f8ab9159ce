"""The second signal ends what does not end by itself: in `umo.run`, a program's own loop, `umo run`, pytest.

Most runs are made in processes that are forked from this one: that is sooner than to start Python anew.
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any, NoReturn

import pytest

from helpers.machines import timer
from helpers.tiers import first
from helpers.waiting import until
from umo import BinaryActuator, Compound, DigitalSensor, Interlock, connect, run
from umo.control import wait
from umo.cycle import insisting
from umo.cycle.insisting import Side, StopSignals, side_of
from umo.cycle.sequences import next_period
from umo.drivers import Channel
from umo.errors import Interrupted, StopError
from umo.exit_status import ExitStatus
from umo.process.job import Job
from umo.process.outcome import status_of
from umo.process.start import ONE_THREAD, RunFailed, Started
from umo.states import OnOff
from umo.system import calls
from umo.system.processes import state
from umo.testing import Scripted, VirtualTimer, periods
from umo.text import COMMAND, UMO

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes that are forked")
HERE = "tests/cycle/test_insisting.py"


def wait_for_ever() -> None:
    """In a call of the kernel."""
    select.select([], [], [])


class Box(Scripted):
    """Its calls and the valve's level are written to a file."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.file = file

    def _call(self, name: str, channels: Sequence[Any] = (), raws: Any = ()) -> Any:
        found = super()._call(name, channels, raws)
        with self.file.open("a") as file:
            file.write(f"{name} {self.get('valve')}\n")
        return found


class Plant(VirtualTimer):
    """Its fourth step does what the test wants."""

    def __init__(self, stuck: Callable[[], object]) -> None:
        super().__init__()
        self.stuck = stuck

    def read(self, channel: Channel) -> int:
        if self.reads == 3:
            self.stuck()
        return super().read(channel)


class Machine(Compound):
    timer: DigitalSensor
    valve: BinaryActuator[OnOff]

    def setup(self) -> None:
        self.stuck: Callable[[], object] = lambda: None
        self.condition: Callable[[], bool] = lambda: False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.condition(), [self.valve], "never")

    def control(self) -> None:
        self.valve.write(OnOff.ON)
        if self.now > 0.0035:
            self.stuck()


class Case:
    """A run in which something never ends: `where` it is."""

    def __init__(self, folder: Path, where: str) -> None:
        self.ready, self.file, self.told = folder / "ready", folder / "box", folder / "told"
        self.begun = folder / "begun"
        self.where = where
        self.m = Machine(timer=timer(), valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
        plant = Plant(self.spin if where == "plant" else self.sleep if where == "plant that sleeps" else lambda: None)
        valve = {"driver": "box", "channel": "valve"}
        self.wiring = {
            "drivers": {"box": Box(self.file), "clock": plant},
            "wire": {"timer": {"driver": "clock", "period": "1 ms"}, "valve": valve},
        }
        if where in CONTROLS:
            self.m.stuck = getattr(self, CONTROLS[where])
        if where == "condition":
            self.m.condition = self.condition

    def is_driving(self) -> bool:
        return self.file.exists() and "write_many 1" in self.file.read_text()

    def spin(self) -> None:
        self.ready.touch()
        while True:
            pass

    def sleep(self) -> None:
        self.ready.touch()
        wait_for_ever()

    def write(self) -> None:
        self.ready.touch()
        while True:
            self.m.valve.write(OnOff.ON)

    def swallow(self) -> None:
        self.ready.touch()
        while True:
            with suppress(BaseException):
                self.swallow_within()

    def swallow_within(self) -> None:
        """A signal that comes in the moment between two turns is for the loop around this one."""
        while True:
            with suppress(BaseException):
                wait_for_ever()

    async def application(self, m: Machine) -> None:
        await wait("3 ms")
        if self.where == "sequence":
            self.spin()
        if self.where == "sequence that swallows":
            self.swallow()
        if self.where == "cleaning up":
            try:
                self.begun.touch()
                while True:
                    await next_period()
            finally:
                self.spin()
        await wait("1000000 s")

    def observe(self, frame: Any) -> None:
        if self.where == "observer" and frame.number > 3:
            self.spin()

    def condition(self) -> bool:
        if self.where == "condition" and self.m.now > 0.0035:
            self.spin()
        return False

    def drive(self) -> None:
        if self.where == "own loop":
            with connect(self.m, self.wiring) as m:
                while True:
                    m.timer.read()
                    m.sample()
                    m.control()
                    m.update()
                    if m.now > 0.0035 and not self.ready.exists():
                        self.ready.touch()
        run(self.m, self.wiring, self.application, observers=[self.observe])


CONTROLS = {"control": "spin", "control that sleeps": "sleep", "control that writes": "write", "swallowed": "swallow"}
ENDED = {
    "control": "the application does not end: {here}:{line} in spin",
    "control that sleeps": "the application does not end: {here}:{line} in wait_for_ever",
    "control that writes": "the application does not end: {here}:{line} in write",
    "sequence": "the application does not end: {here}:{line} in spin",
    "observer": "the application does not end: {here}:{line} in spin",
    "condition": "the application does not end: {here}:{line} in spin",
    "own loop": "the application does not end: {here}:{line} in drive",
    "cleaning up": "the application does not end: {here}:{line} in spin",
    "plant": "a call of a driver does not end: {here}:{line} in spin",
    "plant that sleeps": "a call of a driver does not end: {here}:{line} in wait_for_ever",
}


class Child:
    """A process that does this work, as the whole of a program. It ends as Python does."""

    def __init__(self, told: Path, work: Callable[[], object]) -> None:
        self.told, self.parent = told, os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            self._work(work)

    def _work(self, work: Callable[[], object]) -> NoReturn:
        status = 99
        try:
            file = os.open(self.told, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            os.dup2(file, 2)
            sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
            calls.die_with_parent(self.parent, signal.SIGKILL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.excepthook = sys.__excepthook__
            try:
                work()
                status = 0
            except SystemExit:
                raise
            except BaseException:
                status = 1
                sys.excepthook(*sys.exc_info())
        except SystemExit as end:
            status = int(end.code or 0)
        finally:
            sys.stderr.flush()
            os._exit(status)

    def send(self, number: int) -> None:
        os.kill(self.pid, number)

    def status(self) -> int:
        """The exit status; the child must end by itself."""
        self.wait_status: int | None = None
        until(self.has_ended)
        return os.waitstatus_to_exitcode(self.wait_status)

    def has_ended(self) -> bool:
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        self.wait_status = status
        return pid != 0


def assert_reset(file: Path) -> None:
    """The valve was on, it is off, and nothing came after its reset but its release."""
    lines = file.read_text().splitlines()
    assert "write_many 1" in lines
    last = max(number for number, line in enumerate(lines) if line.startswith("reset"))
    assert lines[last:] == ["reset 1", "finalize 0", "close 0"]  # each with the level before it


@pytest.mark.parametrize("where", list(ENDED))
def test_the_second_signal_ends_what_does_not_end_and_the_outputs_are_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    monkeypatch.setattr(insisting, "SIMULATED_CALL_LIMIT", 0.0 if "plant" in where else 1e9)
    case = Case(tmp_path, where)
    child = Child(case.told, case.drive)
    until(case.begun.exists if where == "cleaning up" else case.ready.exists)
    if "sleeps" in where:  # a signal that comes just before a call of the kernel does not end that
        until(lambda: state(child.pid) == "S")
    child.send(signal.SIGINT)
    until(lambda: case.told.read_text().endswith("\n"))  # what is waited for is told at once
    until(case.ready.exists)
    child.send(signal.SIGTERM)  # another one: two of the same kind would count as one
    assert child.status() in (128 + signal.SIGTERM, 128 + signal.SIGINT)  # the second, where it came into the first
    notice, *further, line = case.told.read_text().splitlines()
    if where in ("cleaning up", "own loop"):  # it does not stand still yet
        assert notice.startswith(("umo: asked to stop; ", "umo: a call of a driver is in progress"))
    else:
        function = ENDED[where].rpartition(" ")[2]
        assert re.fullmatch(rf"umo: .*{HERE}:\d+ in {function}.*ends it.*", notice)
    assert all(
        each.startswith("umo: a call of a driver is in progress") for each in further
    )  # of the device, while it is
    said, _, at = line.partition(f"{HERE}:")
    assert said == "umo: " + ENDED[where].partition("{here}")[0]
    place = ENDED[where].partition("{line} ")[2]
    within = (place, "in control") if where == "own loop" else (place,)  # which the loop calls in each turn
    assert at.partition(" ")[2].startswith(within)
    assert_reset(case.file)


@pytest.mark.parametrize("where", ["swallowed", "sequence that swallows"])
def test_code_that_passes_over_what_ends_it_is_ended_by_further_signals(tmp_path: Path, where: str) -> None:
    case = Case(tmp_path, where)
    child = Child(case.told, case.drive)
    until(case.ready.exists)

    def insist() -> bool:
        if child.has_ended():
            return True
        child.send(signal.SIGTERM)
        return False

    until(insist)
    assert child.wait_status is not None
    # A further signal may come when all is reset and its handling has been given back.
    assert os.waitstatus_to_exitcode(child.wait_status) in (128 + signal.SIGTERM, -signal.SIGTERM)
    _, line = case.told.read_text().splitlines()
    assert line.startswith(f"umo: the application does not end: {HERE}:")
    passed_over = " in wait_for_ever, and it catches the exception that should end it; every actuator is at its default"
    assert line.endswith(passed_over) or " in swallow (at " in line  # it was ended while it passed over one
    assert_reset(case.file)


class Stuck(Box):
    """A device whose call for a reset never returns."""

    ready: Path

    def reset(self, channel: Channel, default: int | None) -> None:
        if default is not None:
            self.ready.touch()
            wait_for_ever()


def test_a_reset_that_hangs_counts_as_failed_and_the_status_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insisting, "SIMULATED_CALL_LIMIT", 0.0)
    case = Case(tmp_path, "nowhere")
    case.wiring["drivers"]["box"] = stuck = Stuck(case.file)
    stuck.ready = case.ready

    def drive() -> None:
        try:
            case.drive()
        except StopError as error:
            raise SystemExit(status_of(error)) from None

    child = Child(case.told, drive)
    until(case.is_driving)
    child.send(signal.SIGTERM)
    until(case.ready.exists)
    until(lambda: state(child.pid) == "S")
    child.send(signal.SIGINT)
    assert child.status() == ExitStatus.UNREACHED


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_program_whose_run_a_signal_ends_tells_it_in_a_line_and_has_its_status(tmp_path: Path, number: int) -> None:
    """After the reset; it ended with status 0 once."""
    case = Case(tmp_path, "nowhere")
    child = Child(case.told, case.drive)
    until(case.is_driving)
    child.send(number)
    assert child.status() == 128 + number
    name = signal.Signals(number).name
    asked, line = case.told.read_text().splitlines()
    assert asked.startswith("umo: ")
    assert asked.endswith((": a second Ctrl-C ends it", "that does not end by itself", "a signal ends it"))
    stopped = f"umo: stopped by {name}; every actuator is at its default; the application waited at {HERE}:"
    assert line.startswith(stopped)
    assert_reset(case.file)


def test_a_finalizer_that_is_interrupted_is_told_in_a_line(tmp_path: Path) -> None:
    """Python ignores what it raises, with a traceback of umo's own lines."""
    case = Case(tmp_path, "control")

    class Finalized:
        def __del__(self) -> None:
            case.ready.touch()
            wait_for_ever()

    def finalize() -> None:
        case.m.stuck = lambda: None
        Finalized()

    case.m.stuck = finalize
    child = Child(case.told, case.drive)
    until(case.ready.exists)
    until(lambda: state(child.pid) == "S")
    child.send(signal.SIGINT)
    until(lambda: state(child.pid) == "S")
    child.send(signal.SIGTERM)
    assert child.status() == 128 + signal.SIGINT
    asked, first_line, *lines = case.told.read_text().splitlines()
    line = wait_for_ever.__code__.co_firstlineno + 2
    assert asked == f"umo: asked to stop; {HERE}:{line} in wait_for_ever is in progress: a second Ctrl-C ends it"
    assert first_line.startswith(f"umo: the application does not end: {HERE}:")
    assert first_line.endswith(" in wait_for_ever; it was interrupted there")
    stopped = f"umo: stopped by SIGINT; every actuator is at its default; the application waited at {HERE}:"
    assert [line.startswith(stopped) for line in lines] == [True]
    assert_reset(case.file)


def test_a_loop_of_ones_own_ends_and_its_program_goes_on(tmp_path: Path) -> None:
    case = Case(tmp_path, "nowhere")

    def drive() -> None:
        with connect(case.m, case.wiring) as m:
            while m.cycle.running:
                periods(m)
        raise SystemExit(7)

    child = Child(case.told, drive)
    until(case.is_driving)
    child.send(signal.SIGINT)
    assert child.status() == 7
    assert_reset(case.file)


def test_a_reset_that_ends_is_interrupted_by_no_number_of_signals(tmp_path: Path) -> None:
    class Slow(Box):
        def reset(self, channel: Channel, default: int | None) -> None:
            for number in (signal.SIGINT, signal.SIGTERM) * 10:
                os.kill(os.getpid(), number)
            super().reset(channel, default)

    case = Case(tmp_path, "nowhere")
    case.wiring["drivers"]["box"] = Slow(case.file)
    child = Child(case.told, case.drive)
    until(case.is_driving)
    child.send(signal.SIGTERM)
    assert child.status() == 128 + signal.SIGTERM
    assert_reset(case.file)


class Numbered(Scripted):
    """The channels that were reset are written to a file."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.file = file

    def reset(self, channel: Channel, default: int | None) -> None:
        super().reset(channel, default)
        with self.file.open("a") as file:
            file.write(f"{channel.text}\n")


class Valves(Compound):
    timer: DigitalSensor
    valves: Sequence[BinaryActuator[OnOff]]

    def control(self) -> None:
        for valve in self.valves:
            valve.write(OnOff.ON)
        while self.now > 0.0035:
            with suppress(BaseException):
                os.kill(os.getpid(), signal.SIGINT)


class SignalsIn:
    """In a call, signals come before these of the steps (calls and returns of functions of Python's) within it."""

    def __init__(self, call: Callable[..., NoReturn], moments: set[int]) -> None:
        self.call, self.moments, self.step = call, moments, 0

    def __call__(self, *arguments: Any) -> NoReturn:
        sys.setprofile(self.next_step)
        self.call(*arguments)

    def next_step(self, *event: Any) -> None:
        self.step += 1
        if self.step in self.moments:
            os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("seed", first(4, range(200)))
def test_signals_in_the_midst_of_the_last_reset_keep_nothing_from_being_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    chance = Random(seed)
    steps = {chance.randrange(1, chance.choice([20, 200, 2000])) for _ in range(chance.randrange(1, 8))}
    monkeypatch.setattr(insisting, "SIMULATED_CALL_LIMIT", 1e9)
    monkeypatch.setattr(insisting, "_leave_and_exit", SignalsIn(insisting._leave_and_exit, steps))
    valves = [BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(6)]
    box = Numbered(tmp_path / "box")
    wire = {"timer": {"driver": "clock", "period": "1 ms"}, "valves.*": {"driver": "box", "channel": "v{}"}}
    wiring = {"drivers": {"box": box, "clock": VirtualTimer()}, "wire": wire}
    child = Child(tmp_path / "told", lambda: run(Valves(timer=timer(), valves=valves), wiring))
    status, told = child.status(), (tmp_path / "told").read_text()
    assert box.file.read_text().split() == [f"v{number}" for number in range(6)]
    assert status == 128 + signal.SIGINT
    assert told.splitlines()[-1].endswith("every actuator is at its default")


# At random -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", first(2, range(60)))
def test_however_many_signals_come_and_when_the_outputs_are_reset(tmp_path: Path, seed: int) -> None:
    chance = Random(seed)
    where = chance.choice([*ENDED, "swallowed", "sequence that swallows", "nowhere"])
    case = Case(tmp_path, where)
    child = Child(case.told, case.drive)
    until(case.is_driving)

    def insist() -> bool:
        if child.has_ended():
            return True
        if chance.random() < 0.3:
            child.send(chance.choice([signal.SIGINT, signal.SIGTERM]))
        return False

    until(insist)
    assert child.wait_status is not None
    status = os.waitstatus_to_exitcode(child.wait_status)
    assert_reset(case.file)
    # the last two: of a signal that came when the machine was left, and its handlers with it
    assert status in (0, 128 + signal.SIGINT, 128 + signal.SIGTERM, -signal.SIGTERM, 1)


# The clock is injected -------------------------------------------------------------------------------------


class Calling(Scripted):
    """Does something in each call that writes a block."""

    does: Callable[[FrameType], object]

    def _call(self, name: str, channels: Sequence[Any] = (), raws: Any = ()) -> Any:
        if name == "write_many":
            self.does(sys._getframe())
        return super()._call(name, channels, raws)


def in_calls(count: int, does: Callable[[FrameType], object]) -> None:
    """Do it in so many calls of a driver."""
    box, m = Calling(), Machine(timer=timer(), valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
    box.does = does
    wire = {"timer": {"driver": "clock", "period": "1 ms"}, "valve": {"driver": "box", "channel": "valve"}}
    with connect(m, {"drivers": {"box": box, "clock": VirtualTimer()}, "wire": wire}):
        periods(m, count)


@pytest.fixture
def untraced(monkeypatch: pytest.MonkeyPatch) -> None:
    """The code around is that of a test, which is not to be interrupted."""
    monkeypatch.setattr(insisting, "_at_return", lambda frame, call: None)


@pytest.mark.usefixtures("untraced")
@pytest.mark.parametrize(("after", "ends"), [(0.99, False), (1.0, True), (50.0, True)])
def test_a_call_of_a_driver_is_ended_by_a_signal_that_finds_it_again_after_its_limit(after: float, ends: bool) -> None:
    now, ended = 100.0, []
    insistence = StopSignals(lambda: now)

    def signals(frame: FrameType) -> None:
        nonlocal now
        insistence.begin(frame, [])
        now += after
        try:
            insistence.insist(signal.SIGTERM, frame, [insisting.SignalledMachine(1.0, list)])
        except Interrupted as error:
            ended.append(str(error))

    in_calls(1, signals)
    assert [each.partition(":")[0] for each in ended] == ["a call of a driver does not end"] * ends


@pytest.mark.usefixtures("untraced")
def test_calls_of_a_driver_that_end_are_never_interrupted() -> None:
    now = 100.0
    insistence = StopSignals(lambda: now)

    def signals(frame: FrameType) -> None:
        nonlocal now
        insistence.insist(signal.SIGTERM, frame, [insisting.SignalledMachine(1.0, list)])
        now += 50.0

    in_calls(5, signals)


def test_a_signal_that_interrupts_the_handler_of_another_finds_the_code_that_this_has_interrupted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    m = Machine(timer=timer(), valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
    connection = connect(m)
    with pytest.raises(Interrupted, match="the application does not end"), connection:
        rest = [partial(os.kill, os.getpid(), signal.SIGTERM)]
        connection.stop.end_wait = lambda: rest and rest.pop()()
        os.kill(os.getpid(), signal.SIGINT)
        wait_for_ever()


def test_where_a_guardian_ends_what_hangs_further_signals_interrupt_nothing() -> None:
    m = Machine(timer=timer(), valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
    connection = connect(m)
    connection.stop.insists = False
    with connection:
        for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGINT):
            os.kill(os.getpid(), number)
        assert connection.stop.signal == signal.SIGTERM


def test_a_machine_that_is_connected_after_a_stop_is_asked_anew() -> None:
    first, second = (
        Machine(timer=timer(), valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)) for _ in range(2)
    )
    with connect(first) as one:
        os.kill(os.getpid(), signal.SIGINT)
        with connect(second) as other:
            assert other.cycle.running
            os.kill(os.getpid(), signal.SIGINT)
            assert (one.cycle.running, other.cycle.running) == (False, False)


def test_the_time_of_a_call_is_that_of_the_drivers_that_have_devices() -> None:
    assert insisting.call_limit([]) == insisting.SIMULATED_CALL_LIMIT
    assert insisting.call_limit([0.02, 1.0]) == 3.0


@pytest.mark.parametrize(
    ("file", "side"),
    [
        (__file__, Side.USER),
        ("/home/anna/press/control.py", Side.USER),
        ("<stdin>", Side.USER),
        ("<string>", Side.LIBRARY),
        (os.__file__, Side.LIBRARY),
        ("/x/lib/python3.12/site-packages/numpy/core/numeric.py", Side.LIBRARY),
        ("/x/lib/python3.12/site-packages/press/control.py", Side.USER),
        (f"{UMO}stations/ztheta/control.py", Side.USER),
        (f"{UMO}control/servo.py", Side.UMO),
        (f"{UMO}cycle/transfer.py", Side.CALLER),
        (f"{UMO}drivers/simulated.py", Side.DRIVER),
        (f"{UMO}cycle/run.py", Side.LOOP),
        (f"{COMMAND}app.py", Side.LOOP),
    ],
)
def test_a_file_is_of_the_user_of_a_library_or_of_umo(file: str, side: Side) -> None:
    assert side_of(file) is side


def test_the_files_of_umo_that_are_named_are_there() -> None:
    for name in (*insisting.LOOPS, *insisting.CALLERS, *insisting.DRIVERS, *insisting.ROOMS):
        assert Path(UMO, name).exists(), name


def test_a_program_that_serves_is_asked_and_then_ended() -> None:
    asked: list[int] = []
    before = signal.getsignal(signal.SIGTERM)
    with insisting.asked_by_signals(lambda: asked.append(1)):
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked == [1]
        with pytest.raises(Interrupted, match=rf"it does not end: {HERE}:\d+ in test_a_program"):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is before


# As a user starts them -------------------------------------------------------------------------------------

OBJECTS = """
import pathlib
from umo import BinaryActuator, Compound, DigitalSensor
from umo.states import OnOff


def stand(where):
    if where == {where!r}:
        pathlib.Path("ready").touch()
        while True:
            pass


stand("import")


class Pump(Compound):
    timer: DigitalSensor
    valve: BinaryActuator[OnOff]
    speed: float = 1.0

    def setup(self):
        if self.speed == 2.0:
            stand("setup")

    def control(self):
        self.valve.write(OnOff.ON)
        stand("control")


def machine():
    stand("machine")
    timer = DigitalSensor("sampling_period", minimum=0, maximum=9999, resolution=1, synchronous=False)
    return Pump(timer=timer, valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
"""
WIRING = """
[wire]
"timer" = { driver = "simulated", period = "1 ms" }
"valve" = { driver = "simulated" }
[parameters]
"speed" = 2.0
"""
SUITE = """
from objects import machine
from umo import run


def test_it():
    run(machine())
"""


def station(folder: Path, where: str) -> None:
    pump = folder / "pump"
    (pump / "wiring").mkdir(parents=True)
    (pump / "objects.py").write_text(OBJECTS.replace("{where!r}", repr(where)))
    (pump / "wiring" / "simulated.toml").write_text(WIRING)
    (folder / "objects.py").write_text(OBJECTS.replace("{where!r}", repr(where)))
    (folder / "test_it.py").write_text(SUITE)


UMO_RUN = ["-m", "umo_command", "run", "pump", "--no-plot"]
COMMANDS = [
    (UMO_RUN, "control", 2, "umo: the application does not end: pump/objects.py:"),
    (UMO_RUN, "import", 1, "umo: interrupted (pump/objects.py:"),
    (UMO_RUN, "setup", 2, "umo: the application does not end: pump/objects.py:"),
    (["-m", "umo_command", "check", "pump"], "machine", 1, "umo: interrupted (pump/objects.py:"),
    (
        ["-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"],
        "control",
        2,
        "Interrupted: the application does not end",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("command", "where", "count", "line"), first(2, COMMANDS))
def test_a_command_in_code_that_does_not_end_is_ended_with_a_line(
    tmp_path: Path, command: list[str], where: str, count: int, line: str
) -> None:
    station(tmp_path, where)
    process = subprocess.Popen(
        [sys.executable, *command],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_THREAD,  # numpy's threads may take one of two signals of the same moment: it is not seen
    )
    until((tmp_path / "ready").exists)
    for number in (signal.SIGINT, signal.SIGTERM)[:count]:  # the lower number is handled first
        process.send_signal(number)
    try:
        out, told = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 128 + (signal.SIGINT, signal.SIGTERM)[count - 1]
    assert "Traceback" not in told
    assert line in (told if line.startswith("umo") else out)
    if line.startswith("umo"):
        assert len(told.splitlines()) == count  # the first one tells what is waited for


@pytest.mark.slow
def test_a_second_stop_ends_a_setup_that_does_not_end_in_the_control_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    station(tmp_path, "setup")
    machine = Started(Job(station=str(tmp_path / "pump"), options={"realtime": True}, path=list(sys.path)))
    until((tmp_path / "ready").exists)
    machine.ask_to_stop()
    machine.ask_to_stop()
    with pytest.raises(RunFailed, match=r"the application does not end: .*objects\.py:"):
        machine.wait(20.0)
    machine._channel.close()
    assert machine.outcome is not None
    assert (machine.outcome.status - 128) in (signal.SIGTERM, signal.SIGINT)
    assert not machine.outcome.unsafe
