"""`driver = "station:press"`: the values of another station, read only.

The counterpart is another run of umo, in processes of its own: frames are umo's own format, so there is no independent
one.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import numpy as np
import pytest

import umo
from helpers.machines import timer, wired
from umo import BinarySensor, Compound, DigitalActuator, DigitalSensor, Quality, RunFailed, connect, published
from umo.clients.remote.station_driver import Published, StationDriver
from umo.control import next_period
from umo.drivers import registry
from umo.errors import ChannelError, ChannelsFailed, DriverError
from umo.process.frames import Reader
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import check

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")
PERIOD = 0.002


class Press(Compound):
    """The other station: a level, a lamp, a force."""

    timer: DigitalSensor
    level: DigitalSensor
    lamp: umo.BinaryActuator[OnOff]
    force: DigitalActuator


def press() -> Press:
    return Press(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        level=DigitalSensor("mm", minimum=0, maximum=100, resolution=0.5),
        lamp=umo.BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        force=DigitalActuator("N", default=0, minimum=0, maximum=5000, resolution=0.5),
    )


async def pressing(m: Press) -> None:
    m.lamp.write(OnOff.ON)
    while True:
        m.force.write(1234.5)
        await next_period()


class Line(Compound):
    timer: DigitalSensor
    force: DigitalSensor
    lamp: BinarySensor[OnOff]


def line(**changes: Any) -> Line:
    return Line(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        force=DigitalSensor("N", minimum=0, maximum=5000, resolution=0.1, on_error="mark"),
        lamp=BinarySensor(OnOff, one=OnOff.ON, on_error="mark"),
    )


def reading(station: str, **changes: Any) -> dict[str, Any]:
    """The line, in virtual time, that reads the press."""
    name = f"station:{station}"
    return {
        "drivers": {"clock": VirtualTimer()},
        "wire": {
            "timer": {"driver": "clock", "period": "5 ms"},
            "force": {"driver": name, "channel": "force:0.1"},
            "lamp": {"driver": name, "channel": "lamp"},
        },
    } | changes


def others_wiring() -> dict[str, Any]:
    wire: dict[str, Any] = {path: {"driver": "simulated"} for path in ("level", "lamp", "force")}
    return {"wire": wire | {"timer": {"driver": "timerfd", "period": PERIOD}}}


def until(condition: Callable[[], bool], seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.002)
    return condition()


def started() -> Any:
    return umo.start(press, others_wiring(), pressing, acknowledge=True)


def running(run: Any) -> str:
    """The pid of a run, by which it is found whatever its name is."""
    while run.frames is None and run.outcome is None:
        run.poll(0.05)
    assert run.frames is not None, run.outcome
    place = run.frames.index("force")
    assert until(lambda: (frame := run.frames.latest()) is not None and frame["values"][place] == 1234.5)
    return str(run.frames.about["pid"])


@pytest.fixture(scope="module")
def presses(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[pytest.MonkeyPatch], Any]]:
    """Gives the press: the same one as long as it runs. Its frames and records are in folders of its own."""
    folders = {name: str(tmp_path_factory.mktemp(name.lower())) for name in ("UMO_STATE", "UMO_FRAMES")}
    begun: list[Any] = []

    def given(patch: pytest.MonkeyPatch) -> Any:
        for name, folder in folders.items():
            patch.setenv(name, folder)
        if not begun or begun[-1].outcome is not None:
            begun.append(stack.enter_context(started()))
        return begun[-1]

    with ExitStack() as stack:
        yield given


@pytest.fixture
def run(presses: Callable[[pytest.MonkeyPatch], Any], monkeypatch: pytest.MonkeyPatch) -> Any:
    return presses(monkeypatch)


def test_values_of_another_station_are_read_with_their_age(run: Any) -> None:
    with connect(line(), reading(running(run))) as m:
        periods(m, 3)
        assert (m.force.read(), m.force.quality) == (1234.5, Quality.GOOD)
        assert m.lamp.read() is OnOff.ON


def test_a_station_that_was_killed_is_never_fresh_again_and_the_reason_is_told(run: Any) -> None:
    driver = StationDriver(station=running(run))
    channels = (driver.channel("force:0.1"), driver.channel("lamp"))
    raws: Any = np.zeros(2, np.int64)
    driver.read_many(channels, raws)
    assert raws.tolist() == [12345, 1]
    (age, _) = driver.ages(channels)
    assert 0.0 <= age < 5.0
    os.kill(int(run.frames.about["pid"]), signal.SIGKILL)
    with suppress(RunFailed):
        run.wait()
    older: list[float] = []
    for _ in range(2):
        try:
            driver.read_many(channels, raws)
        except DriverError as error:
            assert "is not running" in str(error) or "no station is running" in str(error)
            break
        older.append(driver.ages(channels)[0])
    assert older == sorted(older)
    driver.close()


def test_a_station_that_does_not_run_yet_is_no_mistake_and_its_values_are_bad() -> None:
    machine = line()
    assert check(machine, reading("nowhere")) == []
    with connect(machine, reading("nowhere")) as m:
        periods(m, 20)
        assert m.force.quality is Quality.BAD
        assert m.lamp.quality is Quality.BAD


@pytest.mark.full
def test_a_path_that_the_other_station_has_not_fails_alone() -> None:
    with started() as run:
        driver = StationDriver(station=running(run))
        raws: Any = np.zeros(2, np.int64)
        with pytest.raises(ChannelsFailed, match="has no weight"):
            driver.read_many((driver.channel("force:0.1"), driver.channel("weight:1")), raws)
        assert raws[0] == 12345
        driver.close()
        run.stop()


@pytest.mark.full
def test_a_scale_that_is_not_that_of_the_wire_is_a_mistake_while_the_station_runs() -> None:
    with started() as run:
        wiring = reading(running(run))
        wiring["wire"]["force"]["channel"] = "force:0.5"
        (found,) = check(line(), wiring)
        assert "the wired scale is up to" in found.message
        run.stop()


def test_it_is_read_only() -> None:
    class Writes(Compound):
        timer: DigitalSensor
        force: DigitalActuator

    machine = Writes(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        force=DigitalActuator("N", default=0, minimum=0, maximum=5000, resolution=0.1),
    )
    wiring = reading("press")
    del wiring["wire"]["lamp"]
    (found,) = check(machine, wiring)
    assert "is an actuator, but channel 'force:0.1' is an input" in found.message


def test_a_table_of_its_own_says_that_it_is_off_the_cycle() -> None:
    wiring = reading("press")
    wiring["drivers"]["press"] = {"type": "station", "station": "press"}
    for path in ("force", "lamp"):
        wiring["wire"][path]["driver"] = "press"
    (found,) = check(line(), wiring)
    assert (found.key, "must be true" in found.message) == ("drivers.press.off_cycle", True)
    wiring["drivers"]["press"] |= {"off_cycle": True, "period": "10 ms", "max_age": "100 ms"}
    assert check(line(), wiring) == []


@pytest.mark.parametrize("text", [":0.1", "force:", "force:0", "force:nan", "force:x"])
def test_a_channel_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ChannelError, match="PATH:SCALE"):
        StationDriver(station="press").channel(text)


def test_it_is_found_by_its_entry_point() -> None:
    assert registry.find("station") is StationDriver
    assert StationDriver(station="x").channel("a.b:0.5") == Published(
        "a.b:0.5", umo.drivers.Direction.INPUT, 48, True, "a.b", 0.5
    )


async def waiting(m: Line) -> None:
    while True:
        await next_period()


@pytest.mark.full
def test_two_stations_run_side_by_side_in_real_time_and_one_reads_the_other() -> None:
    with started() as run:
        pid = running(run)
        wiring = reading(pid)
        quick = {"type": "station", "station": pid, "off_cycle": True, "period": "5 ms", "max_age": "15 ms"}
        wiring["drivers"] = {f"station:{pid}": quick}
        wiring["wire"]["timer"] = {"driver": "timerfd", "period": "5 ms"}
        with umo.start(line, wiring, waiting, acknowledge=True) as second:
            while second.frames is None and second.outcome is None:
                second.poll(0.05)
            assert second.frames is not None, second.outcome
            reader: Reader = second.frames
            place = reader.index("force")

            def quality() -> Any:
                frame = reader.latest()
                return None if frame is None else (frame["values"][place], Quality(frame["quality"][place]))

            assert until(lambda: quality() == (1234.5, Quality.GOOD))
            os.kill(int(run.frames.about["pid"]), signal.SIGSTOP)  # it publishes no longer
            assert until(lambda: quality()[1] is Quality.BAD)
            os.kill(int(run.frames.about["pid"]), signal.SIGCONT)
            second.stop()
        run.stop()


# What is not taken --------------------------------------------------------------------------------------


class Ram(Compound, equipment=True, numbers={"load": umo.Number("N", shown=True)}):
    force: DigitalSensor
    lamp: BinarySensor[OnOff]
    late: DigitalSensor
    load: float = 2.0


class SlowRam(Ram, every=100):
    pass


class Forge(Compound):
    timer: DigitalSensor
    ram: Ram
    slow: SlowRam


def ram(kind: type[Ram]) -> Ram:
    whole: Any = {"minimum": 0.0, "maximum": 1000.0, "resolution": 1.0}
    return kind(
        force=DigitalSensor("N", incremental=kind is Ram, **whole),
        lamp=BinarySensor(OnOff, one=OnOff.ON),
        late=DigitalSensor("N", synchronous=False, **whole),
    )


@contextmanager
def forge() -> Iterator[tuple[Any, Scripted, StationDriver]]:
    """A station in this process, and the driver that reads it."""
    machine, box = Forge(timer=timer(), ram=ram(Ram), slow=ram(SlowRam)), Scripted()
    connection = connect(machine, wired(machine, box))
    with connection as m, published(connection, f"forge{os.getpid()}"):
        periods(m, 101)
        yield m, box, StationDriver(station=f"forge{os.getpid()}")


def raw_of(driver: StationDriver, text: str) -> int:
    return driver.read(driver.channel(text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ram.forc:1", r"has no ram\.forc \(did you mean 'ram\.force'\?\)"),
        ("ram.force:1", "is UNREFERENCED"),
        ("ram.late:1", "is asynchronous"),
        ("ram.lamp:1", "has two states: its channel is PATH"),
        ("ram.load", "is a number: its channel is PATH:SCALE"),
        ("ram.load:1e-320", "is 2"),
    ],
)
def test_what_has_no_meaning_here_is_not_taken_and_the_reason_is_told(text: str, said: str) -> None:
    with forge() as (_, _, driver), pytest.raises(DriverError, match=said):
        raw_of(driver, text)


def test_one_value_that_cannot_be_read_does_not_cost_the_others() -> None:
    with forge() as (_, _, driver):
        channels = [driver.channel(text) for text in ("ram.load:1e-320", "ram.load:0.5")]
        raws: Any = np.zeros(2, np.int64)
        with pytest.raises(ChannelsFailed) as caught:
            driver.read_many(channels, raws)
    assert list(caught.value.causes) == ["ram.load:1e-320"]
    assert raws[1] == 4


def test_the_signals_of_equipment_in_fault_are_not_taken() -> None:
    with forge() as (m, box, driver):
        assert raw_of(driver, "ram.load:1") == 2
        box.broken = OSError("cut")
        periods(m, 2)
        box.broken = None
        with pytest.raises(DriverError, match="belongs to equipment in fault"):
            raw_of(driver, "ram.load:1")


def test_a_value_of_a_slow_part_is_as_old_as_the_last_period_of_the_part() -> None:
    with forge() as (m, _, driver):
        channel = driver.channel("slow.force:1")
        quick = driver.channel("ram.load:1")
        held = []
        for _ in range(200):
            periods(m)
            raws: Any = np.zeros(2, np.int64)
            driver.read_many([channel, quick], raws)
            slow, fast = driver.ages([channel, quick])
            held.append(round((slow - fast) * 1e3))
    assert sorted(set(held)) == list(range(100))
