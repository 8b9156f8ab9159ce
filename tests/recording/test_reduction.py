"""The reduction to a minimum and a maximum per pixel, triggers, measured values, and the history."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from umo.recording.scope.history import History
from umo.recording.scope.reduction import crossing, measured, measured_state, reduced

VALUES = st.floats(-1e9, 1e9) | st.just(float("nan"))
SAMPLES = st.integers(1, 300).flatmap(lambda count: arrays(np.float64, (2, count), elements=VALUES))


@given(SAMPLES, st.floats(0.0005, 0.5), st.floats(0.0, 1e4))
def test_no_peak_is_lost(values: np.ndarray, step: float, begin: float) -> None:
    times = begin + np.arange(values.shape[1]) * 0.001
    points = reduced(times, values, step, 0.001)
    ends = np.append(points.times[1:], np.inf)
    for start, end, low, high in zip(points.times, ends, points.low.T, points.high.T, strict=True):
        inside = values[:, (times >= start) & (times < end)]
        for row, least, most in zip(inside, low, high, strict=True):
            known = row[np.isfinite(row)]
            if len(known):
                assert (least, most) == (known.min(), known.max())
            else:
                assert np.isnan(least)
                assert np.isnan(most)


@given(st.integers(1, 5000), st.integers(10, 500))
def test_there_are_no_more_points_than_pixels(count: int, width: int) -> None:
    times = np.arange(count) * 0.001
    span = count * 0.001
    points = reduced(times, np.zeros((1, count)), span / width, 0.001)
    assert len(points.times) <= max(2 * width, 1) + 1


def test_every_sample_is_a_point_where_pixels_are_as_fine_as_samples() -> None:
    times, values = np.arange(5) * 0.001, np.arange(5.0)[np.newaxis]
    points = reduced(times, values, 0.001, 0.001)
    assert points.times.tolist() == times.tolist()
    assert points.high is points.low


@given(st.lists(st.integers(1, 40), min_size=1, max_size=40), st.integers(20, 60))
def test_the_history_keeps_the_newest_samples_in_order(sizes: list[int], capacity: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("umo.recording.scope.history.MIN_SAMPLES", 1)
        patch.setattr("umo.recording.scope.history.BLOCKS", 5)
        history = History(1, 1.0, seconds=capacity)
    assert history.capacity == capacity
    added = 0
    for size in sizes:
        new = np.arange(added, added + size, dtype=float)
        history.add(new, 10 * new[:, np.newaxis])
        added += size
    times, values = history.between(-1.0, np.inf, [0])
    assert times.tolist() == list(range(added - len(times), added))
    assert values[0].tolist() == (10 * times).tolist()
    assert min(added, capacity) <= len(times) <= capacity + capacity // 5 + 5
    assert (history.start, history.stop) == (times[0], times[-1])
    middle = history.between(times[0] + 3, times[-1] - 3, [0]).times
    assert middle.tolist() == list(range(int(times[0]) + 3, added - 3))


def test_what_was_read_from_the_history_stays_as_it_was() -> None:
    history = History(1, 1.0, seconds=1024)
    for start in range(0, 2000, 10):
        times = np.arange(start, start + 10.0)
        history.add(times, times[:, np.newaxis])
    parts = history.parts(1500, 1700)
    for start in range(2000, 9000, 10):
        times = np.arange(start, start + 10.0)
        history.add(times, times[:, np.newaxis])
    assert history.start > 1700
    assert [time for part in parts for time in part.times] == list(range(1500, 1701))


def test_the_history_of_a_large_station_takes_bounded_memory() -> None:
    history = History(10_000, 0.001)
    rows = np.zeros((1, 10_000))
    for number in range(3000):
        history.add(np.array([number * 0.001]), rows)
    parts = list(history.parts(0, 3))
    assert sum(part.values.nbytes + part.times.nbytes for part in parts) <= 128 << 20
    assert sum(len(part.times) for part in parts) >= 1024


@pytest.mark.parametrize(
    ("kind", "level", "time"),
    [("rising", 1.5, 4.0), ("falling", 1.5, 2.0), ("above", 1.5, 0.0), ("below", 1.5, 2.0), ("rising", 9.0, None)],
)
def test_a_trigger_fires_at_the_first_sample_beyond_its_level(kind: str, level: float, time: float | None) -> None:
    values = np.array([2.0, 3.0, 1.0, 1.0, 2.0, 1.0])
    assert crossing(np.arange(6.0), values, kind, level) == time


def test_no_edge_follows_a_sample_without_a_value() -> None:
    assert crossing(np.arange(3.0), np.array([np.nan, 2.0, 3.0]), "rising", 1.0) is None


def test_a_sine_is_measured() -> None:
    times = np.arange(0, 2, 0.001)
    found = measured(times, 3 + 2 * np.sin(2 * np.pi * 5 * times))
    assert found is not None
    assert found["minimum"] == pytest.approx(1, abs=1e-3)
    assert found["maximum"] == pytest.approx(5, abs=1e-3)
    assert found["mean"] == pytest.approx(3, abs=1e-3)
    assert found["rms"] == pytest.approx(np.sqrt(9 + 2), abs=1e-3)
    assert found["frequency"] == pytest.approx(5, rel=0.01)


def test_of_a_state_the_share_of_time_and_the_changes_are_measured() -> None:
    assert measured_state(np.array([0, 1, np.nan, 1, 0])) == {"on": 0.5, "changes": 2}
    assert measured_state(np.full(3, np.nan)) is None


def test_noise_around_the_middle_does_not_count_as_periods() -> None:
    times = np.arange(0, 2, 0.001)
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(times))
    found = measured(times, np.sin(2 * np.pi * 5 * times) + noise)
    assert found is not None
    assert found["frequency"] == pytest.approx(5, rel=0.02)


def test_what_has_no_value_and_what_stands_still_has_no_frequency() -> None:
    assert measured(np.arange(3.0), np.full(3, np.nan)) is None
    still = measured(np.arange(3.0), np.ones(3))
    assert still is not None
    assert still["frequency"] is None
