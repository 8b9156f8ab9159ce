"""Injected faults: each kind on a scripted driver, on the machine's time, repeatable by seed (umo.testing.faults)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import umo
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Quality, Thermocouple, connect
from umo.cycle.showing import frame_of
from umo.drivers import Channel, Direction, Driver, DriverError, Looks, Reports, WiringError
from umo.drivers.faults.wrapper import FaultyDriver
from umo.drivers.wrapping import Wrapper
from umo.errors import AcknowledgeRequired, DeclarationError, StopError
from umo.process.job import Job
from umo.states import OnOff, OpenClosed
from umo.testing import Scripted, VirtualTimer, periods, put
from umo.testing.faults import KINDS, InjectedFault


class Bench(Compound, stop_order=("motor", "valve")):
    timer: DigitalSensor
    motor: DigitalActuator
    valve: BinaryActuator[OnOff]
    height: DigitalSensor
    door: BinarySensor[OpenClosed]
    slow: DigitalSensor


def bench(**height: Any) -> Bench:
    return Bench(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01),
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        height=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.1, zero_offset=5.0, **height),
        door=BinarySensor(OpenClosed, one=OpenClosed.OPEN),
        slow=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.1, synchronous=False),
    )


WIDTHS = {"motor": 16, "valve": 1, "height": 16, "door": 1, "slow": 16}
OUTPUTS = ("motor", "valve")


def box() -> Scripted:
    return Scripted(
        channels=[
            Channel(name, Direction.OUTPUT if name in OUTPUTS else Direction.INPUT, bits, signed=bits > 1)
            for name, bits in WIDTHS.items()
        ]
    )


def wiring(circuit: Scripted, *faults: Any, **more: Any) -> dict[str, Any]:
    wire = {name: {"driver": "box"} for name in WIDTHS}
    return {
        "drivers": {"box": {"type": circuit, "timeout": "20 ms"}, "clock": VirtualTimer()},
        "wire": {"timer": {"driver": "clock", "period": "1 ms"}, **wire},
        "faults": list(faults),
        **more,
    }


@contextmanager
def connected(*faults: Any, **height: Any) -> Iterator[tuple[Bench, Scripted]]:
    circuit = box()
    with connect(bench(**height), wiring(circuit, *faults)) as m:
        put(m.height, 50.0)
        yield m, circuit


def raws(m: Bench, count: int, sensor: str = "height") -> list[int]:
    found = []
    for _ in range(count):
        periods(m)
        found.append(getattr(m, sensor).raw)
    return found


# Kinds -------------------------------------------------------------------------------------------------


def test_a_sensor_is_stuck_where_it_was_and_free_again_afterwards():
    with connected("height stuck at 2 ms for 2 ms") as (m, _):
        seen = []
        for value in (10.0, 20.0, 30.0, 40.0):
            put(m.height, value)
            periods(m)
            seen.append(m.height.read())
        assert seen == pytest.approx([10.0, 20.0, 20.0, 40.0])


def test_a_sensor_is_stuck_at_a_level_in_its_units_or_in_raw_steps():
    with connected("height stuck 8 cm at 1 ms") as (m, _):
        periods(m)
        assert m.height.read() == pytest.approx(80.0)
    with connected("height stuck 8 at 1 ms") as (m, _):
        assert raws(m, 1) == [8]


def test_an_actuator_is_stuck_at_what_was_written_before():
    with pytest.raises(AssertionError, match="stop"), connected("motor stuck at 2 ms") as (m, circuit):
        m.motor.write(3.0)
        periods(m)
        m.motor.write(5.0)
        periods(m, 3)
        assert circuit.get("motor") == 300
        assert m.motor.read() == 5.0  # nothing says so
        raise AssertionError("stop")
    resets = [call.raws for call in circuit.segments("reset") if call.channels == ("motor",)]
    assert resets == [(300,), (0,)]  # with the fault, and when it has ended


def test_a_binary_object_is_stuck_in_a_state():
    with connected("door stuck open at 1 ms", "valve stuck ON at 1 ms") as (m, circuit):
        periods(m)
        assert m.door.read() is OpenClosed.OPEN
        assert circuit.get("valve") == 1


def test_noise_has_the_deviation_in_the_units_of_the_object():
    with connected("height noise 2 mm at 1 ms") as (m, _):
        seen = np.array(raws(m, 2000)) * 0.1 + 5.0
        assert seen.mean() == pytest.approx(50.0, abs=0.2)
        assert seen.std() == pytest.approx(2.0, rel=0.1)


def test_noise_of_a_binary_object_inverts_a_share_of_the_transfers():
    with connected("door noise 20 % at 1 ms") as (m, _):
        assert np.mean(raws(m, 2000, "door")) == pytest.approx(0.2, abs=0.04)


def test_drift_grows_with_the_time_of_the_machine():
    with connected("height drift 100 mm/s at 10 ms") as (m, _):
        periods(m, 9)
        assert m.height.read() == pytest.approx(50.0)
        periods(m, 101)
        assert m.height.read() == pytest.approx(60.0)
    with connected("height drift 1000/s at 10 ms") as (m, _):
        assert raws(m, 15)[-1] == 455


def test_noise_and_drift_stay_within_what_the_channel_can_have():
    with connected("height drift 1e30 mm/s at 1 ms", "slow noise 1e30 at 1 ms") as (m, _):
        assert raws(m, 3)[-1] == 0x7FFF


def test_drift_of_a_thermocouple_is_in_degrees():
    class Oven(Compound):
        timer: DigitalSensor
        hot: DigitalSensor

    oven = Oven(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        hot=DigitalSensor("degC", minimum=0, maximum=1300, resolution=0.002, linearization=Thermocouple("K")),
    )
    wires = {
        "drivers": {"box": Scripted(), "clock": VirtualTimer()},
        "wire": {"timer": {"driver": "clock", "period": "1 ms"}, "hot": {"driver": "box"}},
        "faults": ["hot drift 5 K/s at 0 s"],
    }
    with connect(oven, wires) as m:
        put(m.hot, 500.0)
        periods(m, 1000)
        assert m.hot.read() == pytest.approx(505.0, abs=0.1)


@pytest.mark.parametrize(("bit", "raw"), [(0, 451), (1, 448), (14, 450 + 16384), (15, 450 - 32768)])
def test_a_bit_has_the_other_level_in_every_transfer(bit, raw):
    with connected(f"height bit flip {bit} at 1 ms") as (m, _):
        assert raws(m, 3) == [raw] * 3


def test_without_a_number_the_seed_decides_which_bit():
    def seen(seed: int) -> int:
        circuit = box()
        with connect(bench(), wiring(circuit, "height bit flip at 1 ms"), fault_seed=seed) as m:
            return raws(m, 1)[0]

    assert len({seen(seed) for seed in range(20)}) > 5
    assert seen(3) == seen(3)


def test_out_of_range_is_beyond_the_declared_range():
    with connected("height out of range at 1 ms") as (m, _):
        periods(m)
        assert m.height.read() == pytest.approx(110.0)
        assert m.height.quality is Quality.OUT_OF_RANGE
    with connected("height out of range 3 mm at 1 ms") as (m, _):
        periods(m)
        assert m.height.read() == pytest.approx(103.0)


def test_a_binary_channel_out_of_range_reads_what_is_not_a_level():
    circuit = Scripted()  # of any width
    with (
        pytest.raises(DriverError, match="read 2, but a binary channel reads 0 or 1"),
        connect(bench(), wiring(circuit, "door out of range at 1 ms")) as m,
    ):
        periods(m)


def test_out_of_range_without_an_amount_is_as_far_as_the_channel_goes():
    def beyond(bits: int) -> int:
        circuit = Scripted(channels=[replace(box().channel(name), bits=bits) for name in WIDTHS])
        with connect(bench(), wiring(circuit, "height out of range at 1 ms")) as m:
            periods(m)
            return m.height.raw

    assert (beyond(16), beyond(11)) == (1050, 1023)


@pytest.mark.parametrize(
    ("fault", "bits", "why"),
    [
        ("door out of range", 1, "door has no level but 0 and 1 in channel 'door'"),
        ("valve out of range", 1, "valve has no level but 0 and 1"),
        ("height out of range 10 mm", 11, "'10 mm' above the range is beyond channel 'height': -97.4 to 107.3 mm (raw"),
        ("motor out of range 400", 11, "'400' above the range is beyond channel 'motor': -10.24 to 10.23 V (raw"),
        ("slow out of range", 11, "slow has no level above its range in channel 'slow'"),
    ],
)
def test_a_level_that_the_channel_cannot_have_is_refused_in_words(fault, bits, why):
    circuit = Scripted(channels=[Channel(name, Direction.BOTH, bits if width > 1 else 1, signed=width > 1)
                                 for name, width in WIDTHS.items()])  # fmt: skip
    table = wiring(circuit, fault)
    table["wire"]["slow"]["zero_offset"] = -2.3  # 100 mm is raw 1023, the last one of 11 bits
    faults = umo.check(bench(), table)
    assert [why in each.message for each in faults if fault in each.message] == [True], faults


@pytest.mark.parametrize("kind", ["disconnect", "drop-out 100 %"])
def test_a_sensor_that_is_cut_off_fails_alone(kind):
    with connected(f"height {kind} at 2 ms for 1 ms", on_error="mark") as (m, _):
        periods(m, 2)
        assert m.height.quality is Quality.BAD
        assert m.door.quality is Quality.GOOD
        periods(m)
        assert m.height.quality is Quality.GOOD


def test_drop_out_loses_a_share_of_the_transfers():
    with connected("height drop-out 30 % at 1 ms", on_error="mark") as (m, _):
        lost = 0
        for _ in range(1000):
            periods(m)
            lost += m.height.quality is Quality.BAD
        assert lost == pytest.approx(300, abs=60)


def test_an_actuator_that_is_cut_off_is_named_and_reset_when_the_fault_has_ended():
    circuit = box()
    what = r"^not brought to their defaults until the injected faults ended: .*disconnected \(injected fault\)"
    connection = connect(bench(), wiring(circuit, "motor disconnect at 2 ms"))
    with pytest.raises(StopError, match=what) as caught, connection as m:
        m.motor.write(3.0)
        m.valve.write(OnOff.ON)
        periods(m, 3)
    assert [failure.path for failure in caught.value.failures] == ["motor"]
    assert (circuit.get("motor"), circuit.get("valve")) == (0, 0)
    resets = [(call.channels, call.raws) for call in circuit.segments("reset")]
    assert resets == [(("valve",), (0,)), (("motor",), (0,)), (("valve",), (0,))]
    assert connection.reached


@pytest.mark.parametrize("fault", ["motor stuck 4 V", "motor noise 1 V", "motor bit flip 3", "motor out of range"])
def test_an_actuator_with_a_wrong_level_is_at_its_default_in_the_end(fault):
    circuit = box()
    with connect(bench(), wiring(circuit, f"{fault} at 2 ms")) as m:
        periods(m, 3)
    assert [call.raws for call in circuit.segments("reset") if call.channels == ("motor",)][-1] == (0,)
    assert circuit.get("motor") == 0


class Card(Scripted):
    """On a device of its own; it takes no level beyond 1,000."""

    def devices(self) -> list[str]:
        return ["card 7"]

    def write_many(self, channels, raws):
        if max(map(abs, raws.tolist())) > 1000:
            raise DriverError(f"{max(raws.tolist())} is too much")
        super().write_many(channels, raws)


class Clock(VirtualTimer):
    """Virtual time beside a device, which is not one."""

    realtime = True


def on_device(*faults: str) -> tuple[Card, dict[str, Any]]:
    card = Card(channels=[box().channel(name) for name in WIDTHS])
    table = wiring(card, *faults)
    table["drivers"]["clock"] = Clock()
    return card, table


@pytest.mark.parametrize("fault", ["motor disconnect", "box disconnect", "motor out of range", "motor stuck 20 V"])
def test_an_injected_fault_is_nothing_to_acknowledge(fault):
    """The device is at its defaults, and its record says so."""
    circuit, table = on_device(f"{fault} at 2 ms")
    with pytest.raises(DriverError, match=r"\(injected fault\)"), connect(bench(), table) as m:
        m.motor.write(3.0)
        periods(m, 3)
    assert circuit.get("motor") == 0
    with connect(bench(), on_device()[1]):
        pass


def test_a_device_that_is_away_is_still_to_be_acknowledged_beside_an_injected_fault():
    circuit, table = on_device("motor stuck 4 V at 2 ms")
    with pytest.raises(StopError, match=r"^not brought to their defaults: .*cut off"), connect(bench(), table) as m:
        periods(m, 2)
        circuit.broken = OSError("cut off")
    circuit, table = on_device()
    with pytest.raises(AcknowledgeRequired), connect(bench(), table):
        pass


def test_a_whole_driver_is_disconnected_for_a_time():
    with connected("box disconnect at 2 ms for 2 ms", on_error="mark", max_age=0.1) as (m, _):
        periods(m)
        with pytest.raises(DriverError, match="disconnected") as caught:
            periods(m)
        assert {failure.path for failure in caught.value.failures} == {"door"}  # the other one is held
        assert m.height.quality is Quality.STALE
        with pytest.raises(DriverError, match="away: disconnected"):
            periods(m)
        while m.now < 0.0515:  # it is looked for again 50 ms after the first look
            with pytest.raises(DriverError, match="away: disconnected"):
                periods(m)
        periods(m)
        assert m.height.quality is Quality.GOOD


def test_a_driver_that_is_disconnected_from_the_start_cannot_be_opened():
    circuit = box()
    with (
        pytest.raises(DriverError, match="driver box: disconnected"),
        connect(bench(), wiring(circuit, "box disconnect")),
    ):
        pass
    assert [call.segment for call in circuit.calls] == ["close"]


def test_an_exception_is_a_mistake_in_the_drivers_code():
    with (
        pytest.raises(DriverError, match=r"RuntimeError: a mistake in the driver \(injected fault\)"),
        connected("height exception at 2 ms") as (m, _),
    ):
        periods(m, 3)


def test_a_delay_in_virtual_time_counts_from_the_timeout_on():
    with connected("height delay 19 ms at 1 ms") as (m, _):
        periods(m, 3)
        assert m.height.read() == pytest.approx(50.0)
    with (
        pytest.raises(DriverError, match=r"timed out \(20 ms\) \(injected fault\)"),
        connected("height delay 20 ms at 1 ms") as (m, _),
    ):
        periods(m)


def test_a_delay_in_wall_clock_time_waits_at_most_for_the_timeout(monkeypatch):
    waited: list[float] = []
    monkeypatch.setattr("umo.drivers.faults.wrapper.time.sleep", waited.append)
    with connect(bench(), wiring(box(), "height delay 7 ms"), realtime=True) as m:
        m.sample()
    assert set(waited) == {0.007}
    waited.clear()
    with (
        pytest.raises(DriverError, match="timed out"),
        connect(bench(), wiring(box(), "height delay 1 s"), realtime=True),
    ):
        pass
    assert set(waited) == {0.02}


def test_a_delay_in_virtual_time_does_not_wait(monkeypatch):
    monkeypatch.setattr("umo.drivers.faults.wrapper.time.sleep", lambda seconds: pytest.fail("waited"))
    with connected("height delay 7 ms") as (m, _):
        periods(m, 3)


def test_a_block_that_is_filled_short_is_noticed():
    with (
        pytest.raises(DriverError, match="fewer values than channels") as caught,
        connected("height wrong length at 2 ms") as (m, _),
    ):
        periods(m, 3)
    assert {failure.path for failure in caught.value.failures} == {"height", "door"}  # the block ends before them


def test_a_driver_of_ones_own_that_fills_a_block_short_is_noticed(each_way):
    class Short(Scripted):
        def read_many(self, channels, out):
            super().read_many(channels[:1], out[:1])

    with (
        pytest.raises(DriverError, match="fewer values than channels; door"),
        connect(bench(), wiring(Short(channels=[box().channel(name) for name in WIDTHS]))),
    ):
        pass


def test_a_short_block_of_outputs_ends_before_the_actuator():
    with connected("valve wrong length at 2 ms") as (m, circuit):
        m.motor.write(1.0)
        periods(m)
        m.motor.write(2.0)
        m.valve.write(OnOff.ON)
        periods(m)
        assert (circuit.get("motor"), circuit.get("valve")) == (200, 0)


def test_a_single_read_without_a_value_fails():
    with connected("slow wrong length at 1 ms") as (m, _):
        periods(m)
        with pytest.raises(DriverError, match="could not be read"):
            m.slow.read()


def test_a_place_that_the_driver_did_not_fill_is_not_read_behind_a_fault_either():
    class Short(Scripted):
        def read_many(self, channels, out):
            super().read_many(channels[:1], out[:1])

    circuit = Short(channels=[box().channel(name) for name in WIDTHS])
    with (
        pytest.raises(DriverError, match="fewer values than channels; door"),
        connect(bench(), wiring(circuit, "height noise at 0 s", "door noise at 0 s")),
    ):
        pass


@pytest.mark.parametrize("sensors", [1, 100], ids=["in lists", "in arrays"])
def test_a_place_that_was_not_filled_is_not_read_where_its_mark_lies_within_the_range(sensors):
    class Wide(Compound):
        counts: list[DigitalSensor]

    class Nothing(Scripted):
        def read_many(self, channels, out):
            pass

    machine = Wide(
        counts=[DigitalSensor("count", minimum=-9.2e18, maximum=9.2e18, resolution=1) for _ in range(sensors)]
    )
    wires = {"drivers": {"box": Nothing()}, "wire": {"counts.*": {"driver": "box"}}}
    with pytest.raises(DriverError, match="fewer values than channels"), connect(machine, wires) as m:
        m.sample()


def test_everything_of_a_driver_is_handed_on():
    public = {name for name in vars(Driver) if not name.startswith("_")}
    assert public <= vars(FaultyDriver).keys() | vars(Wrapper).keys()


def test_the_delays_of_several_objects_pass_at_the_same_time(monkeypatch):
    waited: list[float] = []
    monkeypatch.setattr("umo.drivers.faults.wrapper.time.sleep", waited.append)
    with connect(bench(), wiring(box(), "* delay 7 ms"), realtime=True) as m:
        waited.clear()
        m.sample()
        assert waited == [0.007]


def test_several_faults_of_one_object_act_one_after_another():
    with connected("height stuck 100 at 1 ms", "height drift 1000/s at 1 ms") as (m, _):
        assert raws(m, 3) == [100, 101, 102]
    with connected("height drift 1000/s at 1 ms", "height stuck 100 at 1 ms") as (m, _):
        assert raws(m, 3) == [100, 100, 100]


def test_a_pattern_stands_for_each_object_that_matches():
    class Row(Compound):
        timer: DigitalSensor
        levels: list[DigitalSensor]

    row = Row(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        levels=[DigitalSensor("mm", minimum=0, maximum=100, resolution=1) for _ in range(3)],
    )
    with connect(row, fault="levels.* stuck 7 mm at 0 s") as m:
        periods(m)
        assert [level.read() for level in m.levels] == [7, 7, 7]


# The driver behind them --------------------------------------------------------------------------------


def test_without_faults_no_driver_is_wrapped():
    circuit = box()
    connection = connect(bench(), wiring(circuit))
    with connection as m:
        assert all(not isinstance(driver, FaultyDriver) for driver in connection.wired.drivers.values())
        assert connection.wired.injection is None
        assert "injected_faults" not in [signal.path for signal in frame_of(connection.machine).signals]
        periods(m)


def test_the_driver_of_a_connection_is_the_circuits_own_and_other_drivers_are_not_wrapped():
    circuit = box()
    connection = connect(bench(), wiring(circuit, "height stuck at 1 s"))
    with connection:
        assert connection.driver("box") is circuit
        assert isinstance(connection.wired.drivers["box"], FaultyDriver)
        assert isinstance(connection.wired.drivers["clock"], VirtualTimer)


def test_the_timeout_watchdog_and_report_are_those_of_the_driver():
    class Watched(Scripted, Reports):
        def report(self):
            return {"answer": 42}

    circuit = Watched()
    wires = wiring(circuit, "height stuck at 1 s")
    wires["drivers"]["box"] = {"type": circuit, "timeout": "20 ms", "watchdog": "50 ms"}
    connection = connect(bench(), wires)
    with connection:
        assert circuit.timeout == connection.wired.drivers["box"].timeout == 0.02
        assert circuit.segments("watchdog")
    assert connection.reports["box"] == {"answer": 42}


def test_two_objects_on_one_channel_are_found_with_faults_too():
    wires = wiring(box(), "height stuck at 1 s")
    wires["wire"]["slow"] = {"driver": "box", "channel": "height"}
    with pytest.raises(WiringError, match="already used by"), connect(bench(), wires):
        pass


def test_a_fault_begins_again_with_the_next_connection():
    circuit, machine = box(), bench()
    for _ in range(2):
        with connect(machine, wiring(circuit, "height stuck 8 at 2 ms")) as m:
            put(m.height, 50.0)
            assert raws(m, 3) == [450, 8, 8]


def test_the_log_and_a_signal_say_when_a_fault_begins_and_ends(caplog):
    circuit = box()
    connection = connect(bench(), wiring(circuit, "height stuck at 2 ms for 2 ms"))
    seen: list[float] = []
    with caplog.at_level(logging.WARNING, "umo"), connection as m:
        connection.machine.observers.append(lambda frame: seen.append(frame.signal_values[-1]))
        periods(m, 5)
        assert frame_of(connection.machine).signals[-1].path == "injected_faults"
    assert seen == [0, 1, 1, 0, 0]
    assert [record.getMessage() for record in caplog.records] == [
        "injected fault begins at 0.002 s: height stuck at 0.002 s for 0.002 s (channel height)",
        "injected fault ends at 0.004 s: height stuck at 0.002 s for 0.002 s (channel height)",
    ]


def test_the_clock_does_not_jump_by_a_timer_that_reads_beyond_its_range():
    with pytest.raises(DriverError, match="outside its range"), connected("timer out of range at 3 ms") as (m, _):
        try:
            periods(m, 10)
        finally:
            assert m.now == pytest.approx(0.003)


# Repeatable --------------------------------------------------------------------------------------------


def noisy(seed: int, *others: str) -> list[int]:
    circuit = box()
    faults = ["height noise 3 mm at 1 ms", "height drop-out 20 % at 1 ms", *others]
    with connect(bench(on_error="mark", max_age=1.0), wiring(circuit, *faults), fault_seed=seed) as m:
        put(m.height, 50.0)
        return raws(m, 50)


def test_a_run_repeats_exactly_by_its_seed():
    assert noisy(1) == noisy(1)
    assert noisy(1) != noisy(2)


def test_the_same_words_twice_have_numbers_of_their_own():
    def noise(*faults: str) -> list[int]:
        with connected(*faults) as (m, _):
            return raws(m, 20)

    one, two = noise("height noise 2 mm"), noise("height noise 2 mm", "height noise 2 mm")
    doubled = [450 + 2 * (raw - 450) for raw in one]
    assert len(set(one)) > 5 and two != doubled
    assert two == noise("height noise 2 mm", "height noise 2 mm")


def test_the_numbers_of_a_fault_do_not_depend_on_other_faults():
    assert noisy(1) == noisy(1, "door noise at 1 ms", "motor noise at 1 ms")


# The words ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("z.encoder stuck at 5 s", InjectedFault("z.encoder", "stuck", at=5.0)),
        ("z.encoder noise 20 um at 1 s for 2 s", InjectedFault("z.encoder", "noise", "20 um", at=1.0, for_=2.0)),
        ("z.encoder bit flip 3", InjectedFault("z.encoder", "bit flip", 3)),
        ("z.motor  DELAY 30 ms  at 2 s", InjectedFault("z.motor", "delay", "30 ms", at="2000 ms")),
        ("box disconnect at 3 s for 1 s", InjectedFault("box", "disconnect", at=3, for_=1)),
        ("a out-of-range for 10 ms", InjectedFault("a", "out of range", for_=0.01)),
        ("a dropout".replace("dropout", "drop out") + " 5 %", InjectedFault("a", "drop-out", "5 %")),
    ],
)
def test_a_fault_in_words(text, fault):
    assert InjectedFault.parse(text) == fault
    assert InjectedFault.parse(str(fault)) == fault


times = st.floats(0, 1e6, allow_nan=False, allow_subnormal=False)


@given(st.sampled_from(sorted(KINDS)), st.floats(-1e9, 1e9), st.sampled_from(["", "mm", "um/s"]), times, times)
def test_a_fault_is_what_its_words_say(kind, number, unit, at, lasts):
    amount = f"{number!r} {unit}".strip() if KINDS[kind] else ""
    fault = InjectedFault("a.b", kind, amount, at=at, for_=lasts or float("inf"))
    assert InjectedFault.parse(str(fault)) == fault


@given(st.text(max_size=60))
def test_any_text_is_a_fault_or_a_declaration_error(text):
    with suppress(DeclarationError):
        InjectedFault.parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hight stuck", r"there is no object or driver 'hight' \(did you mean 'height'\?\)"),
        ("heights.* stuck", "no object of the machine matches 'heights.*'"),
        ("height stuk at 1 s", r"no kind 'stuk' \(did you mean 'stuck'\?\); the kinds are: stuck, noise"),
        ("height", r"is not PATH KIND \[amount\] \[at TIME\] \[for TIME\]"),
        ("", r"is not PATH KIND"),
        ("height stuck at noon", "'noon' is not a duration"),
        ("height stuck at 1 s for 0 s", "longer than 0 s"),
        ("height noise 3 V", "'V' cannot be converted to 'mm'"),
        ("height stuck 5 km", r"'5 km' is beyond channel 'height': .* \(raw "),
        ("height stuck 99999999", "'99999999' is beyond channel 'height'"),
        ("height noise -1 mm", "a standard deviation must not be negative"),
        ("height noise much", 'write for example "5 mm", or "5" for raw steps'),
        ("height drift 3 mm", 'write for example "5 mm/s", or "5/s" for raw steps'),
        ("height bit flip 16", "'16' is not a bit of channel 'height': 0 to 15"),
        ("height disconnect 3", "disconnect takes no amount, but has '3'"),
        ("height drop-out 3 mm", "is not a share"),
        ("height out of range -1 mm", "a distance from the range must be above 0"),
        ("height stuck 1e308 m", "'1e308 m' is not a level"),
        ("height noise 1e31 mm", "'1e31 mm' is not an amount"),
        ("height drift inf", "'inf' is not an amount"),
        (InjectedFault("height", "noise", float("nan")), "'nan' is not an amount"),
        ("height stuck at -1 ms", "must be finite and not negative"),
        ("height stuck for nan s", "is not a duration"),
        ("door out of range 5 mm", "door is binary: its level beyond the range is 2, not '5 mm'"),
        ("door drift", "door is binary: it cannot drift"),
        ("door stuck ajar", "'ajar' is not a state of door: CLOSED or OPEN"),
        ("height delay soon", "'soon' is not a duration"),
        ("box stuck", "stuck is for objects; a whole driver has: delay, drop-out, disconnect, exception"),
        (5, "is not a string"),
    ],
)
def test_a_wrong_fault_is_a_fault_of_the_wiring(text, message):
    (found,) = umo.check(bench(), wiring(box(), text))
    assert found.key == "faults"
    with pytest.raises(WiringError, match=message), connect(bench(), wiring(box(), text)):
        pass


def test_faults_that_are_not_a_list_and_a_seed_that_is_not_one():
    assert [f.key for f in umo.check(bench(), wiring(box()) | {"faults": "height stuck"})] == ["faults"]
    assert [f.key for f in umo.check(bench(), wiring(box(), fault_seed=-1))] == ["fault_seed"]


def test_the_options_of_a_run_add_to_the_faults_of_the_wiring():
    circuit = box()
    fault = InjectedFault("door", "stuck", 1, at=0.001)
    with connect(bench(), wiring(circuit, "height stuck 8 at 1 ms"), fault=fault) as m:
        periods(m)
        assert (m.height.raw, m.door.raw) == (8, 1)


def test_a_job_hands_faults_on_as_texts():
    job = Job("ztheta", options={"fault": [InjectedFault("z.encoder", "stuck", at=5.0)]})
    assert Job.load(job.dump()).options == {"fault": ["z.encoder stuck at 5 s"]}


# Looking for the device -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        ("box disconnect at 2 ms", False),
        ("box delay 10 s at 2 ms", False),
        ("box drop-out 100 % at 2 ms", False),
        ("box exception at 2 ms", False),
        ("door delay 10 s at 2 ms", False),
        ("height stuck 0 mm at 2 ms", True),
        ("box delay 0.1 ms at 2 ms", True),
        ("box disconnect at 1 s", True),
    ],
)
def test_a_fault_that_makes_calls_of_the_driver_fail_keeps_its_device_from_being_found(fault: str, found: bool) -> None:
    connection = connect(bench(on_error="mark"), wiring(box(), fault))
    with suppress(StopError), connection as m:
        for _ in range(3):
            with suppress(DriverError):
                periods(m)
        assert connection.wired.drivers["box"].look() is found


def test_looking_is_the_drivers_own_without_a_fault_in_effect() -> None:
    class Asked(Scripted, Looks):
        def look(self) -> bool | None:
            return None

    connection = connect(bench(), wiring(Asked(), "height stuck 0 mm at 1 s"))
    with connection:
        assert connection.wired.drivers["box"].look() is None
