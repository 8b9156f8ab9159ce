"""The absence of a device as a state machine: state and event -> state and step, the same for both who have one."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import pytest

from umo.drivers.absence import (
    FIRST_INTERVAL,
    LONG_ABSENCE,
    OFF_CYCLE,
    ON_CYCLE,
    Absence,
    AbsenceState,
    AbsenceStep,
    SearchPolicy,
)

TIMEOUT = 0.02
PERIOD = 0.01
EVENTS: dict[str, Callable[[Absence, float], AbsenceStep]] = {
    "refuses": lambda absence, now: absence.failed(now, False),
    "times out": lambda absence, now: absence.failed(now, True),
    "found": lambda absence, now: absence.looked(now, True, TIMEOUT),
    "not found": lambda absence, now: absence.looked(now, False, TIMEOUT),
    "not known": lambda absence, now: absence.looked(now, None, TIMEOUT),
    "initialised": lambda absence, now: absence.initialized(now, True),
    "not initialised": lambda absence, now: absence.initialized(now, False),
}
WAYS: dict[str, list[str | float]] = {
    "there": [],
    "doubted": ["refuses"],
    "away": ["times out"],
    "away for long": ["times out", LONG_ABSENCE],
    "tried": ["times out", "found"],
    "tried, initialised": ["times out", LONG_ABSENCE, "found", "initialised"],
}
"""What leads to each state: events, and times in s between them."""
T, D, A, TR = AbsenceState.THERE, AbsenceState.DOUBTED, AbsenceState.AWAY, AbsenceState.TRIED
CALL, REFUSE, INIT, TRY = AbsenceStep.CALL, AbsenceStep.REFUSE, AbsenceStep.INITIALIZE, AbsenceStep.TRY
TABLE = {
    # state, event: on the cycle, off the cycle
    ("there", "refuses"): ((D, CALL), (A, REFUSE)),
    ("there", "times out"): ((A, REFUSE), (A, REFUSE)),
    ("doubted", "refuses"): ((D, CALL), None),
    ("doubted", "times out"): ((A, REFUSE), None),
    ("doubted", "found"): ((TR, TRY), None),
    ("doubted", "not found"): ((A, REFUSE), None),
    ("doubted", "not known"): ((A, REFUSE), None),
    ("away", "refuses"): ((A, REFUSE), (A, REFUSE)),
    ("away", "times out"): ((A, REFUSE), (A, REFUSE)),
    ("away", "found"): ((TR, TRY), (TR, TRY)),
    ("away", "not found"): ((A, REFUSE), (A, REFUSE)),
    ("away", "not known"): ((A, REFUSE), (A, REFUSE)),
    ("away for long", "found"): ((A, INIT), (A, INIT)),
    ("away for long", "not found"): ((A, REFUSE), (A, REFUSE)),
    ("away for long", "initialised"): ((TR, TRY), (TR, TRY)),
    ("away for long", "not initialised"): ((A, REFUSE), (A, REFUSE)),
    ("tried", "refuses"): ((D, CALL), (A, REFUSE)),
    ("tried", "times out"): ((A, REFUSE), (A, REFUSE)),
    ("tried, initialised", "refuses"): ((A, REFUSE), (A, REFUSE)),
    ("tried, initialised", "times out"): ((A, REFUSE), (A, REFUSE)),
}


def led_to(state: str, manner: SearchPolicy, answers: bool) -> tuple[Absence, float]:
    absence, now = Absence(manner, answers), 100.0
    for each in WAYS[state]:
        if isinstance(each, float):
            now += each
        else:
            EVENTS[each](absence, now)
    return absence, now


@pytest.mark.parametrize("answers", [True, False], ids=["looks", "is tried"])
@pytest.mark.parametrize("side", [0, 1], ids=["on", "off"])
@pytest.mark.parametrize(("state", "event"), TABLE, ids=[f"{state}: {event}" for state, event in TABLE])
def test_the_table(state: str, event: str, side: int, answers: bool) -> None:
    expected = TABLE[state, event][side]
    if expected is None:
        return
    absence, now = led_to(state, (ON_CYCLE, OFF_CYCLE)[side], answers)
    step = EVENTS[event](absence, now)
    assert (absence.state, step) == expected
    assert absence.is_away is (absence.state is A)
    assert absence.is_confirmed is (absence.state is TR and answers)


def steps(
    absence: Absence, seconds: float, fails: str, looked: Callable[[float], str] = lambda now: "found"
) -> list[str]:
    """What happens in so many s, in which each try fails so, by the words of the events and steps."""
    found = []
    for number in range(round(seconds / PERIOD)):
        now = 100.0 + number * PERIOD
        if absence.is_due(now):
            step = EVENTS[looked(now)](absence, now)
            if step is INIT:
                found.append("initialised")
                step = EVENTS["initialised"](absence, now)
            if step is TRY:
                found.append("tried")
                EVENTS[fails](absence, now)
    return found


@pytest.mark.parametrize("manner", [ON_CYCLE, OFF_CYCLE])
def test_a_device_that_answers_and_refuses_is_there_and_not_initialised_again(manner: SearchPolicy) -> None:
    absence, _ = led_to("doubted", manner, True)
    found = steps(absence, 20.0, "refuses")  # longer than the longest interval
    assert "initialised" not in found and "tried" in found
    assert absence.refuses


def test_a_device_that_was_initialised_and_answers_ever_since_is_not_initialised_again_though_it_refuses() -> None:
    absence, _ = led_to("away", OFF_CYCLE, True)
    found = steps(absence, 20.0, "refuses", lambda now: "found" if now > 101.0 else "not found")
    assert found.count("initialised") == 1
    assert found.count("tried") > 10


@pytest.mark.parametrize("fails", ["refuses", "times out"])
def test_a_device_that_must_be_tried_is_initialised_again_however_it_fails(fails: str) -> None:
    """An error at once, of whatever class, may be that of a library whose device was switched off."""
    absence, _ = led_to("away", OFF_CYCLE, False)
    found = steps(absence, 20.0, fails, lambda now: "found" if now > 101.0 else "not found")
    assert found.count("initialised") > 1
    assert not absence.refuses


@pytest.mark.parametrize("manner", [ON_CYCLE, OFF_CYCLE])
@pytest.mark.parametrize("event", ["not found", "times out"])
def test_a_device_that_refused_and_then_does_not_answer_is_initialised_again(manner: SearchPolicy, event: str) -> None:
    absence, _ = led_to("doubted", manner, True)
    steps(absence, 5.0, "refuses")
    EVENTS[event](absence, 105.0)
    assert not absence.refuses
    assert EVENTS["found"](absence, 105.0 + LONG_ABSENCE + absence.due) is INIT


def test_a_device_that_was_initialised_and_then_not_found_is_initialised_again() -> None:
    absence, now = led_to("tried, initialised", ON_CYCLE, True)
    EVENTS["refuses"](absence, now)
    EVENTS["not found"](absence, now + 1.0)
    assert EVENTS["found"](absence, now + 2.0) is INIT


@pytest.mark.parametrize(("manner", "longest"), [(ON_CYCLE, 5.0), (OFF_CYCLE, 1.0)])
def test_the_intervals_double_up_to_the_longest(manner: SearchPolicy, longest: float) -> None:
    absence, now = led_to("away", manner, True)
    assert absence.is_due(now)  # the first look is in the next period
    gaps = []
    for _ in range(10):
        EVENTS["not found"](absence, now)
        gaps.append(absence.due - now)
        assert not absence.is_due(absence.due - 1e-3)
        assert absence.is_due(absence.due - 1e-10)
        now = absence.due
    assert gaps == pytest.approx([min(FIRST_INTERVAL * 2**number, longest) for number in range(10)])


def test_a_device_that_accepts_an_initialisation_is_tried_soon_once() -> None:
    absence, now = led_to("away", ON_CYCLE, True)
    for _ in range(5):
        EVENTS["not found"](absence, now)
    gaps = []
    for _ in range(3):
        absence.accepted()
        EVENTS["not initialised"](absence, now)
        gaps.append(absence.due - now)
    assert gaps == pytest.approx([FIRST_INTERVAL, 2 * FIRST_INTERVAL, 4 * FIRST_INTERVAL])


@pytest.mark.parametrize(("timeout", "limit"), [(0.02, LONG_ABSENCE), (0.8, 0.8)])
def test_a_look_that_does_not_decide_is_asked_in_each_period_and_counts_as_false_in_the_end(
    timeout: float, limit: float
) -> None:
    absence, now = led_to("away", ON_CYCLE, True)
    for after in (0.0, limit):
        absence.looked(now + after, None, timeout)
        assert (absence.known, absence.is_due(now + after)) == (False, True)
    absence.looked(now + limit + PERIOD, None, timeout)
    assert (absence.known, absence.is_due(now + limit + PERIOD)) == (True, False)


@pytest.mark.parametrize(("write", "known"), [(False, False), (True, True)])
def test_a_device_is_known_to_be_away_when_a_write_has_failed_or_it_was_not_found(write: bool, known: bool) -> None:
    absence = Absence(ON_CYCLE, True)
    absence.failed(0.0, True, write)
    assert absence.known is known
    absence.looked(PERIOD, False, TIMEOUT)
    assert absence.known


def test_an_absence_counts_from_the_beginning_of_the_call_that_has_failed() -> None:
    absence = Absence(OFF_CYCLE, True)
    absence.failed(100.6, True, began=100.0)
    assert absence.has_lasted(100.5) and not absence.has_lasted(100.4)
    assert absence.looked(100.65, True, TIMEOUT) is INIT


def test_a_device_of_which_nothing_is_known_is_initialised_first() -> None:
    absence = Absence(OFF_CYCLE, True)
    absence.assume(100.0)
    assert absence.is_due(100.0)
    assert absence.looked(100.0, True, TIMEOUT) is INIT
    assert absence.began == 100.0 and absence.due < inf
