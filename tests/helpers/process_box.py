"""A machine and a circuit for the tests of `umo.process`: its outputs outlive every process, in a mapped file."""

from __future__ import annotations

import asyncio
import faulthandler
import gc
import itertools
import mmap
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import umo
from umo.cycle.sequences import next_period
from umo.drivers import Channel, Direction, Driver, Reports

CALLS, STRUCK, LEVELS, PRIORITY, REFUSED = 0, 1, 2, 10, 11
OUTPUTS = ("motor", "valve")


class Machine(umo.Compound, stop_order=("valve", "motor")):
    """A motor, a valve, a switch."""

    timer: umo.DigitalSensor
    switch: umo.BinarySensor[umo.states.PassFail]
    motor: umo.DigitalActuator
    valve: umo.BinaryActuator[umo.states.OnOff]


def machine(kind: type[Machine] = Machine) -> Machine:
    return kind(
        timer=umo.DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        switch=umo.BinarySensor(umo.states.PassFail, one=umo.states.PassFail.FAIL),
        motor=umo.DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01),
        valve=umo.BinaryActuator(umo.states.OnOff, one=umo.states.OnOff.ON, default=umo.states.OnOff.OFF),
    )


class Watching(umo.Compound):
    """A switch alone: a machine that drives nothing."""

    timer: umo.DigitalSensor
    switch: umo.BinarySensor[umo.states.PassFail]


def watching() -> Watching:
    timer = umo.DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
    return Watching(timer=timer, switch=umo.BinarySensor(umo.states.PassFail, one=umo.states.PassFail.FAIL))


async def watch(m: Watching) -> None:
    while True:
        await next_period()


async def drive(m: Machine, periods: int = 4) -> str:
    """Outputs on for some periods."""
    m.motor.write(5.0)
    m.valve.write(umo.states.OnOff.ON)
    for _ in range(periods):
        await next_period()
    return "driven"


async def forever(m: Machine) -> None:
    await drive(m, 10**9)


async def loop_at(m: Machine, period: int = 5) -> None:
    """User code that never comes back."""
    await drive(m, period)
    while True:
        pass


async def never_returns_in_c(m: Machine) -> None:
    """It holds the interpreter's lock, and runs no handler of signals."""
    await drive(m)
    max(itertools.repeat(0))


async def fail_at(m: Machine, period: int = 5) -> None:
    await drive(m, period)
    raise ValueError("a mistake in the application")


async def returns_much(m: Machine) -> list[int]:
    await drive(m)
    return list(range(20_000))


async def returns_a_file(m: Machine) -> object:
    await drive(m)
    return open(os.devnull)


async def returns_the_machine(m: Machine) -> object:
    await drive(m)
    return m


class Unshowable:
    def __repr__(self) -> str:
        raise RuntimeError("no")


async def returns_the_unshowable(m: Machine) -> object:
    await drive(m)
    return Unshowable()


async def returns_a_million(m: Machine) -> list[int]:
    await drive(m)
    return list(range(1_000_000))


class ShownSlowly:
    """Takes half a second."""

    def __repr__(self) -> str:
        spin_for(0.5)
        return "slow"


async def returns_the_slow(m: Machine) -> object:
    await drive(m)
    return ShownSlowly()


class ShownByLeaving:
    def __repr__(self) -> str:
        raise SystemExit(0)


async def returns_the_leaving(m: Machine) -> object:
    await drive(m)
    return ShownByLeaving()


class Lethal:
    def __repr__(self) -> str:
        os.kill(os.getpid(), signal.SIGKILL)
        return ""


async def returns_the_lethal(m: Machine) -> object:
    await drive(m)
    return Lethal()


class SlowError(Exception):
    """Takes 1.5 s."""

    def __str__(self) -> str:
        spin_for(1.5)
        return "said slowly"


async def fails_slowly(m: Machine) -> None:
    await drive(m)
    raise SlowError


async def fails_at_length(m: Machine) -> None:
    await drive(m)
    raise ValueError("x" * 1_000_000)


async def breaks_its_stop_order(m: Machine) -> None:
    await drive(m)
    type(m)._settings = m._settings._replace(stop_order=("valve", "moter"))


async def closes_everything(m: Machine) -> None:
    await drive(m)
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # a worker of the tests has hundreds
    await drive(m, 10**9)


async def deaf(m: Machine) -> None:
    """An application that takes the signals for itself."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    await drive(m, 10**9)


class Cells:
    """64-bit numbers in a file, shared by every process that maps it."""

    def __init__(self, file: Path) -> None:
        with file.open("a+b") as opened:
            opened.truncate(512)  # of one that is there already nothing changes, whoever was killed meanwhile
            self._map = mmap.mmap(opened.fileno(), 512)
        self.numbers = memoryview(self._map).cast("q")

    @property
    def levels(self) -> dict[str, int]:
        return {name: self.numbers[LEVELS + i] for i, name in enumerate(OUTPUTS)}


def _hang() -> None:
    while True:
        time.sleep(1000)


def _spin() -> None:
    while True:
        pass


def _kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _stop() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def _fail() -> None:
    raise OSError("unplugged")


ACTIONS: dict[str, Callable[[], None]] = {
    "raise": _fail,
    "hang": _hang,
    "spin": _spin,
    "kill": _kill,
    "stop": _stop,
}


class Box(Driver):
    """Counts its calls; at call `at` (from 1) it does `action`, once for all processes together.

    `away` is a file: while it is there the device does not answer any process but the first. With `descriptor` each
    call needs the descriptor that `open` got.
    """

    def __init__(
        self, *, file: str, at: int = 0, action: str = "raise", away: str = "", descriptor: bool = False
    ) -> None:
        self._file, self._at, self._action, self._away = Path(file), at, action, away
        self._descriptor: int | None = None
        self._wants_descriptor = descriptor
        self._cells: Cells | None = None

    def devices(self) -> list[str]:
        return [f"file {os.path.realpath(self._file)}"]

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.OUTPUT if text in OUTPUTS else Direction.INPUT, 32, signed=True)

    def _called(self) -> Any:
        if self._cells is None:
            self._cells = Cells(self._file)
        numbers = self._cells.numbers
        if self._descriptor is not None:
            os.fstat(self._descriptor)
        numbers[CALLS] += 1
        if numbers[CALLS] == self._at and not numbers[STRUCK]:
            numbers[STRUCK] = 1
            ACTIONS[self._action]()
        if self._away and numbers[STRUCK] and Path(self._away).exists():
            numbers[REFUSED] = os.getpid()
            raise OSError("no route to the device")
        return numbers

    def open(self) -> None:
        self._called()
        if self._wants_descriptor:
            self._descriptor = os.open(self._file, os.O_RDONLY)

    def close(self) -> None:
        self._called()

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._put(channel, default)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._put(channel, default)

    def finalize(self, channel: Channel) -> None:
        self._called()

    def read(self, channel: Channel) -> int:
        self._called()
        return 0

    def write(self, channel: Channel, raw: int) -> None:
        self._put(channel, raw)

    def _put(self, channel: Channel, raw: int | None) -> None:
        numbers = self._called()
        if raw is not None:
            numbers[LEVELS + OUTPUTS.index(channel.text)] = raw


def wiring(file: Path, **options: Any) -> dict[str, Any]:
    """A wiring of `machine()` to a box, plain data."""
    process = {"hang_timeout": "5 s"} | options.pop("process", {})  # what a busy machine does is not tested here
    period = options.pop("period", "1 ms")
    return {
        "drivers": {"box": {"type": "helpers.process_box:Box", "file": str(file), **options}},
        "wire": {
            "timer": {"driver": "timerfd", "period": period},
            "switch": {"driver": "box"},
            "motor": {"driver": "box"},
            "valve": {"driver": "box"},
        },
        "process": process,
    }


def spin_for(seconds: float) -> None:
    """Work for so long."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        pass


class Slow(Box):
    """Takes 20 ms for one of so many reads: on a busy computer some of these are interrupted."""

    EVERY = 100
    _reads = 0

    def read(self, channel: Channel) -> int:
        raw = super().read(channel)
        assert self._cells is not None
        self._reads += 1
        if self._cells.numbers[LEVELS] == 700 and self._reads % self.EVERY == 0:
            spin_for(0.02)
        return raw


async def slow_driver(m: Machine) -> None:
    await drive(m, 100)
    m.motor.write(7.0)  # raw 700: the driver's sign
    for _ in range(400):
        await next_period()


async def collection(m: Machine) -> None:
    await drive(m, 100)
    kept: list[Any] = []
    for _ in range(400):
        kept.append([[] for _ in range(1000)])
        await next_period()
    gc.collect()
    await drive(m, 300)
    del kept


async def page_faults(m: Machine) -> None:
    """Several times: on a busy computer some of these are interrupted."""
    for _ in range(4):
        await drive(m, 200)
        with mmap.mmap(-1, 32 << 20, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as fresh:
            fresh.madvise(mmap.MADV_NOHUGEPAGE)
            for at in range(0, len(fresh), mmap.PAGESIZE):
                fresh[at] = 1
    await drive(m, 300)


async def half_busy(m: Machine) -> None:
    """Half of each period on the core."""
    for _ in range(400):
        spin_for(0.0005)
        await next_period()


class Leaving(Box):
    """Resetting its valve raises what is not an Exception."""

    def reset(self, channel: Channel, default: int | None) -> None:
        if channel.text == "valve":
            raise asyncio.CancelledError
        super().reset(channel, default)


class HalfDead(Box):
    """Once it is struck, nothing answers for its valve when it is opened again."""

    def initialize(self, channel: Channel, default: int | None) -> None:
        if channel.text == "valve" and self._called()[STRUCK]:
            raise umo.errors.DeviceTimeout("no answer")
        super().initialize(channel, default)


class Reporting(Box, Reports):
    """Its report tells the level of the motor."""

    def report(self) -> dict[str, Any]:
        return {"motor": self._called()[LEVELS]}


class Mute(Box, Reports):
    """Its report fails."""

    def report(self) -> dict[str, Any]:
        raise SystemExit("no report")


def _leave() -> None:
    raise asyncio.CancelledError


def _crash() -> None:
    faulthandler.disable()  # pytest's would tell
    os.kill(os.getpid(), signal.SIGSEGV)


FAULTS = {"raise": _fail, "hang": _hang, "crash": _crash, "kill": _kill, "leave": _leave}


class Faulty(Box):
    """`fault="open:raise close:hang reset.valve:leave"`: each time the call is made (for the valve), it does this,
    until there is a file of the same name with the suffix `.repaired`."""

    def __init__(self, *, fault: str, file: str) -> None:
        super().__init__(file=file)
        self._faults = dict(each.split(":") for each in fault.split())

    def _fault(self, call: str) -> None:
        if call in self._faults and not self._file.with_suffix(".repaired").exists():
            FAULTS[self._faults[call]]()

    def open(self) -> None:
        self._fault("open")

    def close(self) -> None:
        self._fault("close")

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._fault(f"initialize.{channel.text}")
        super().initialize(channel, default)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._fault(f"reset.{channel.text}")
        super().reset(channel, default)


class Silent(Box):
    """Many outputs, of which only one answers: the motor."""

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.OUTPUT, 1)

    def _put(self, channel: Channel, raw: int | None) -> None:
        if channel.text != "motor":
            raise umo.errors.DeviceTimeout("slot gone")
        super()._put(channel, raw)


class HangsInReset(Box):
    """The first reset of its valve never returns."""

    def reset(self, channel: Channel, default: int | None) -> None:
        if channel.text == "valve" and not self._called()[STRUCK]:
            self._called()[STRUCK] = 1
            _hang()
        super().reset(channel, default)


class Forks(Box):
    """A child that goes on connecting, as the control process does."""

    def open(self) -> None:
        super().open()
        if child := os.fork():
            os.waitpid(child, 0)


class NotesPriority(Box):
    """Notes the priority of the process that opened it last."""

    def open(self) -> None:
        self._called()[PRIORITY] = os.sched_getparam(0).sched_priority


async def forks(m: Machine) -> int:
    """A child that goes on as the control process does; its exit status."""
    await drive(m)
    child = os.fork()
    if child == 0:
        m.motor.write(9.0)
        return -1
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


async def forks_for_work(m: Machine) -> int:
    """A child that does something else, and so does one of its own, with the child's files."""
    await drive(m)
    child = os.fork()
    if child == 0:
        files = [os.open(os.devnull, os.O_RDONLY) for _ in range(16)]
        if os.fork():
            os._exit(os.waitstatus_to_exitcode(os.wait()[1]))
        os._exit(7 if all(os.path.exists(f"/proc/self/fd/{file}") for file in files) else 8)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


async def forks_and_waits(m: Machine, told: str) -> None:
    """A child that waits for ever; its pid is written to a file."""
    await drive(m)
    child = os.fork()
    while child == 0:
        signal.pause()
    Path(told).write_text(str(child))
    await forever(m)
