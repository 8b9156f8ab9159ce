"""How old what a station tells is, by clocks that differ."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.clients.fleet.arrival_ages import ArrivalAges

SECOND = 1_000_000_000


@given(st.integers(-(10**18), 10**18))
def test_what_was_held_up_is_as_old_as_that_whatever_the_clocks(difference: int) -> None:
    ages = ArrivalAges()
    ages.know(0, difference)
    for number in range(5):
        assert ages.age(number * SECOND, number * SECOND + difference) == 0.0
    now = 12 * SECOND + difference  # seven seconds without a network, then all of it at once
    assert [ages.age(number * SECOND, now) for number in range(5, 13)] == pytest.approx([7, 6, 5, 4, 3, 2, 1, 0])


def test_without_a_comparison_of_the_clocks_nothing_is_fresh() -> None:
    assert ArrivalAges().age(0, 0) == inf


@given(st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.lists(st.tuples(st.integers(0, 100), st.floats(0.0, 9.0))))
def test_no_age_is_less_than_the_true_one(asked: float, answered: float, arrivals: list[tuple[int, float]]) -> None:
    """The declaration is made `asked` s after it was asked for, and comes `answered` s later: only the sum is known."""
    ages = ArrivalAges()
    ages.know(round(asked * SECOND), 0)
    ages.age(round(asked * SECOND), round((asked + answered) * SECOND))
    for made, way in arrivals:
        assert ages.age(made * SECOND, round((made + way) * SECOND)) >= way - 1e-6


def test_what_came_slowly_at_first_is_compared_with_what_comes_later() -> None:
    ages = ArrivalAges()
    ages.know(0, 0)
    ages.age(0, 5 * SECOND)
    assert ages.age(6 * SECOND, 6 * SECOND) == 0.0
    assert ages.age(7 * SECOND, 8 * SECOND) == pytest.approx(1.0)


def test_a_station_whose_computer_slept_is_fresh_again_after_a_comparison() -> None:
    ages, slept = ArrivalAges(), 3600 * SECOND
    ages.know(0, 0)
    assert ages.age(SECOND, SECOND + slept) == pytest.approx(3600.0)
    ages.know(2 * SECOND, 2 * SECOND + slept)
    assert ages.age(3 * SECOND, 3 * SECOND + slept) == 0.0


def test_a_mirror_whose_computer_slept_finds_what_arrives_fresh() -> None:
    ages, slept = ArrivalAges(), 3600 * SECOND
    ages.know(0, slept)
    assert ages.age(SECOND, SECOND + slept) == 0.0
    assert ages.age(2 * SECOND, 2 * SECOND) == 0.0
    assert ages.age(3 * SECOND, 5 * SECOND) == pytest.approx(2.0)


def test_a_long_silence_does_not_make_what_is_old_fresh() -> None:
    ages = ArrivalAges()
    ages.know(0, 0)
    now = 150 * SECOND
    assert ages.age(now - 30 * SECOND, now) == pytest.approx(30.0)
    assert ages.age(now, now) == 0.0
