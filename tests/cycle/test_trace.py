"""What a run leaves behind."""

from __future__ import annotations

import csv
import math
import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from umo import BinaryActuator, Compound, DigitalSensor, Quality, connect
from umo.cycle.frame import Signal
from umo.cycle.stage import Progress
from umo.cycle.trace import Statistics, Trace
from umo.states import OnOff
from umo.testing import VirtualTimer, periods, put


class Press(Compound):
    valve: BinaryActuator[OnOff]
    pressure: DigitalSensor
    timer: DigitalSensor


def press() -> Press:
    return Press(
        valve=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        pressure=DigitalSensor("bar", minimum=0.0, maximum=1e6, resolution=1.0),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=1e5, resolution=1, synchronous=False),
    )


def recorded(trace: Trace, statistics: Statistics, count: int, missed: list[int] | None = None) -> None:
    wiring = {
        "drivers": {"clock": VirtualTimer(missed or ())},
        "wire": {
            "timer": {"driver": "clock", "period": "10 ms"},
            "valve": {"driver": "simulated"},
            "pressure": {"driver": "simulated"},
        },
    }
    connection = connect(press(), wiring)
    with connection as m:
        connection.machine.observers += [trace, statistics]
        for number in range(count):
            put(m.pressure, float(number))
            m.valve.write(OnOff.ON if number % 2 else OnOff.OFF)
            periods(m)


def test_a_value_that_was_bad_is_none() -> None:
    trace, connection = Trace(), connect(press())
    with connection as m:
        connection.machine.observers.append(trace)
        put(m.pressure, 3.0)
        periods(m)
        m.timer.read()
        m.sample()
        connection.image.quality[connection.image.slot_of[id(m.pressure)]] = Quality.BAD
        m.update()
    assert trace.rows[:, trace.place(m.pressure)].tolist() == pytest.approx([3.0, math.nan], nan_ok=True)


def test_each_row_of_the_file_names_its_values_that_are_not_good(tmp_path: Path) -> None:
    trace, connection = Trace(rows=4), connect(press())
    with connection as m:
        connection.machine.observers.append(trace)
        for number in range(7):
            m.timer.read()
            m.sample()
            quality = connection.image.quality
            quality[connection.image.slot_of[id(m.pressure)]] = Quality.STALE if number % 4 == 2 else Quality.GOOD
            quality[connection.image.slot_of[id(m.valve)]] = Quality.BAD if number == 6 else Quality.GOOD
            m.update()
    trace.save(tmp_path / "trace.csv")
    with (tmp_path / "trace.csv").open() as file:
        told = [row["not_good"] for row in csv.DictReader(file)]
    assert (trace.stride, told) == (2, ["", "pressure=STALE", "", "pressure=STALE valve=BAD"])


def test_a_row_a_period_with_a_column_for_each_object(tmp_path: Path) -> None:
    trace = Trace()
    recorded(trace, Statistics(), 3)
    trace.save(tmp_path / "trace.csv")
    with (tmp_path / "trace.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert set(rows[0]) == {
        "time_s",
        "missed",
        "execution_us",
        "timer[sampling_period]",
        "valve[ON=1]",
        "pressure[bar]",
        "not_good",
    }
    assert [row["time_s"] for row in rows] == ["0.01", "0.02", "0.03"]
    assert [row["pressure[bar]"] for row in rows] == ["0", "1", "2"]
    assert [row["valve[ON=1]"] for row in rows] == ["0", "1", "0"]


def test_a_long_run_stays_whole_in_bounded_memory() -> None:
    trace = Trace(rows=64)
    recorded(trace, Statistics(), 1000)
    assert len(trace.rows) <= 64
    assert trace.stride == 16
    assert trace.rows[-1, 0] > 9.5
    assert np.allclose(np.diff(trace.rows[:, 0]), 0.16)


def test_missed_periods_are_not_lost_with_the_rows_that_are_not_kept() -> None:
    trace, statistics = Trace(rows=16), Statistics()
    recorded(trace, statistics, 500, [number % 3 for number in range(500)])
    assert trace.rows[:, 1].sum() == statistics.missed == sum(number % 3 for number in range(500))


def test_missed_periods_are_counted_and_placed() -> None:
    trace, statistics = Trace(), Statistics()
    recorded(trace, statistics, 4, [0, 3, 0, 1])
    assert (statistics.periods, statistics.missed) == (4, 4)
    assert trace.rows[:, 1].tolist() == [0, 3, 0, 1]


def test_percentiles_are_of_the_last_periods_and_absent_before_the_first() -> None:
    statistics = Statistics(capacity=10)
    assert statistics.percentile(50) is None
    recorded(Trace(), statistics, 25)
    median, p99 = statistics.percentile(50), statistics.percentile(99)
    assert median is not None
    assert p99 is not None
    assert 0 < median <= p99


def test_labels_are_kept_when_they_change() -> None:
    trace, m = Trace(), press()
    connection = connect(m)
    with connection:
        connection.machine.observers.append(trace)
        for text in ("", "a", "a", "b", "b"):
            if text:
                m.cycle.progress(text)
            periods(m)
    assert [text for _, text in trace.notes] == ["a", "b"]
    assert [time for time, _ in trace.notes] == pytest.approx([0.002, 0.004])


def test_an_observer_that_fails_is_disabled_and_the_run_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    statistics = Statistics()
    connection = connect(press())
    with connection as m:

        def broken(frame: object) -> None:
            raise OSError("no space left on device")

        connection.machine.observers += [broken, statistics]
        periods(m, 3)
    assert statistics.periods == 3
    assert caplog.text.count("failed and was disabled") == 1


def test_a_trace_of_many_objects_is_bounded_in_bytes_and_grows_as_it_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.cycle.trace.MAX_BYTES", most := 16_000_000)
    frame: Any = SimpleNamespace(
        progress=Progress(),
        signals=(),
        signal_values=[],
        items=[None] * 10_000,
        time=0.0,
        missed=1,
        execution=0.0,
        values=np.zeros(10_000),
        quality=np.zeros(10_000, np.uint8),
    )
    trace = Trace()
    tracemalloc.start()
    try:
        trace(frame)
        assert tracemalloc.get_traced_memory()[1] < most / 20
        for number in range(1, 1000):
            frame.time = float(number)
            trace(frame)
        assert most / 2 < tracemalloc.get_traced_memory()[1] < most * 1.05
    finally:
        tracemalloc.stop()
    assert trace.stride == 16
    assert trace.rows[:, 0].tolist() == list(range(0, 1000, 16))
    assert trace.rows[:, 1].sum() == 1000


def test_a_path_that_is_not_utf8_does_not_cost_the_trace(tmp_path: Path) -> None:
    trace = Trace()
    trace.items = [DigitalSensor("mm", minimum=0.0, maximum=1.0, resolution=0.1)]
    trace.items[0]._name, trace.items[0]._parent = "caf\udce9", press()
    trace.save(tmp_path / "trace.csv")
    assert r"caf\udce9[mm]" in (tmp_path / "trace.csv").read_text()


def test_the_heading_of_a_signal_with_states_tells_their_numbers() -> None:
    trace = Trace()
    trace.signals = (
        Signal("mixer.step", "", None, "step", {0: "FILL", 4: "STIR"}),
        Signal("mixer.level", "mm", None, "level"),
    )
    assert trace.columns[-2:] == ["mixer.step[FILL=0 STIR=4]", "mixer.level[mm]"]
