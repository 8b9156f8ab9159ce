"""How old what a station tells is, by clocks that differ."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.clients.fleet.arrival_ages import WINDOW, ArrivalAges

SECOND = 1_000_000_000


@given(st.integers(-(10**18), 10**18))
def test_what_was_held_up_is_as_old_as_that_whatever_the_clocks(difference: int) -> None:
    ages = ArrivalAges()
    for number in range(5):
        assert ages.age(number * SECOND, number * SECOND + difference) == 0.0
    now = 12 * SECOND + difference  # seven seconds without a network, then all of it at once
    assert [ages.age(number * SECOND, now) for number in range(5, 13)] == pytest.approx([7, 6, 5, 4, 3, 2, 1, 0])


def test_what_came_slowly_at_first_is_compared_with_what_comes_later() -> None:
    ages = ArrivalAges()
    ages.age(0, 5 * SECOND)
    assert ages.age(6 * SECOND, 6 * SECOND) == 0.0
    assert ages.age(7 * SECOND, 8 * SECOND) == pytest.approx(1.0)


def test_a_station_whose_computer_slept_is_fresh_again_after_two_windows() -> None:
    ages = ArrivalAges()
    ages.age(0, 0)
    slept, step = 3600 * SECOND, WINDOW // 4
    found = [ages.age(number * step, number * step + slept) for number in range(1, 15)]
    assert found[0] == pytest.approx(3600.0)
    assert found[-1] == 0.0


def test_a_longer_silence_than_the_window_does_not_make_what_is_old_fresh() -> None:
    ages = ArrivalAges()
    ages.age(0, 0)
    now = 5 * WINDOW
    assert ages.age(now - WINDOW, now) == pytest.approx(WINDOW / SECOND)
    assert ages.age(now, now) == 0.0
