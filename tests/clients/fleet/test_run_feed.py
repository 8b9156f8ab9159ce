"""Deltas and events in their order, each once, and what is asked for."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.clients.fleet.kept_deltas import MAX_DELTA_BYTES, MAX_DELTAS, KeptDeltas
from umo.clients.fleet.message_parts import packed
from umo.clients.fleet.run_feed import AHEAD, LONGEST_SILENCE, RETRY_DELAY, SILENCE, TRIES, Missing, RunFeed
from umo.clients.fleet.run_words import FULL, LAST, Delta, peek
from umo.errors import FramesError

RUN = b"12345678"
FULL_EVERY = 10
EVENTS = 100
"""Of one answer at most."""


def delta(number: int, *, events: int = 0, last: bool = False, size: int = 1) -> Delta:
    flags = FULL * (number % FULL_EVERY == 0) | LAST * last
    return Delta(RUN, number, flags, np.zeros(0, "<u2"), np.zeros(size, np.uint64), b"", events=events)


def data(number: int, **more: Any) -> bytes:
    return delta(number, **more).packed()


def event(number: int) -> list[Any]:
    return [number, 0.0, "path", f"event {number}", "", 0, 0, ""]


class Gateway:
    """Keeps what it has published, and answers."""

    def __init__(self, keeps: int = 50) -> None:
        self.kept, self.events = KeptDeltas(keeps, FULL_EVERY), 0

    def publish(self, number: int, **more: Any) -> bytes:
        made = delta(number, events=self.events, **more)
        self.kept.add(made, made.packed())
        return made.packed()

    def answer(self, request: Missing) -> bytes:
        head, deltas = self.kept.since(request.delta)
        stop = min(request.event + EVENTS, self.events)
        about = {"head": head, "event": stop, "events": [event(n) for n in range(request.event, stop)]}
        return packed(json.dumps(about).encode(), *deltas)


def feed(first: int = 0) -> RunFeed:
    return RunFeed(RUN, first, 0, 0.0)


def passed_on(this: RunFeed) -> list[int]:
    return [peek(each).number for each in this.deltas()]


# What is missing -------------------------------------------------------------------------------------------


def test_what_comes_in_order_is_passed_on_and_nothing_is_asked() -> None:
    this = feed()
    for number in range(5):
        assert this.take_delta(data(number), 0.0)
    assert not this.take_delta(data(3), 0.0)
    assert passed_on(this) == list(range(5))
    assert this.request(1.0) is None


def test_what_is_missing_is_asked_for_and_passed_on_in_its_order() -> None:
    gateway, this = Gateway(), feed()
    for number in range(8):
        message = gateway.publish(number)
        if number not in (2, 3, 5):
            this.take_delta(message, 0.0)
    assert passed_on(this) == [0, 1]
    request = this.request(0.0)
    assert request == Missing(RUN, 2, 0)
    this.take_past(gateway.answer(request))
    assert passed_on(this) == list(range(2, 8))
    assert this.request(0.1) is None


def test_a_question_without_an_answer_is_asked_again_and_given_up_in_the_end() -> None:
    this = feed()
    for number in (0, 1, 5, 6):
        this.take_delta(data(number), 0.0)
    asked = [now for now in np.arange(0.0, 3 * TRIES, RETRY_DELAY / 4) if this.request(now) is not None]
    assert asked[:3] == [0.0, RETRY_DELAY, 2 * RETRY_DELAY]
    assert len([each for each in asked if each < TRIES * RETRY_DELAY]) == TRIES
    assert passed_on(this) == [0, 1, 5, 6]


def test_answers_that_bring_nothing_are_no_reason_to_give_up() -> None:
    """A gateway that has begun anew, and has not come so far yet."""
    this, gateway = feed(), Gateway()
    this.take_delta(data(0), 0.0)
    this.take_delta(data(4), 0.0)
    for turn in range(3 * TRIES):
        request = this.request(turn * RETRY_DELAY)
        assert request is not None
        this.take_past(gateway.answer(request))
    for number in range(5):
        gateway.publish(number)
    this.take_past(gateway.answer(Missing(RUN, 1, 0)))
    assert passed_on(this) == list(range(5))


def test_what_the_gateway_has_no_longer_is_left_out() -> None:
    gateway, this = Gateway(keeps=20), feed()
    this.take_delta(gateway.publish(0), 0.0)
    for number in range(1, 100):
        message = gateway.publish(number)
    this.take_delta(message, 0.0)
    request = this.request(0.0)
    assert request is not None
    this.take_past(gateway.answer(request))
    numbers = passed_on(this)
    assert numbers[0] == 0
    assert numbers[1:] == list(range(70, 100))  # from one with all words


def test_what_the_gateway_itself_has_lost_is_no_reason_to_wait() -> None:
    gateway, this = Gateway(), feed()
    for number in (0, 1, 7, 8):
        this.take_delta(gateway.publish(number), 0.0)
    request = this.request(0.0)
    assert request is not None
    this.take_past(gateway.answer(request))
    assert passed_on(this) == [0, 1, 7, 8]
    assert this.request(0.0) is None


def test_a_run_of_which_nothing_comes_is_asked_less_and_less() -> None:
    gateway, this = Gateway(), feed()
    this.take_delta(gateway.publish(0), 0.0)
    gateway.publish(1)
    assert this.request(SILENCE - 0.1) is None
    request = this.request(SILENCE)
    assert request is not None
    this.take_past(gateway.answer(request))  # the last one had been dropped
    assert passed_on(this) == [0, 1]
    asked = [now for now in np.arange(SILENCE, 300.0, 0.5) if this.request(now) is not None]
    assert np.diff(asked).max() <= LONGEST_SILENCE + RETRY_DELAY
    assert len(asked) < 300.0 / LONGEST_SILENCE + 5


def test_a_delta_with_a_number_far_ahead_of_its_gateway_is_of_nobody() -> None:
    gateway, this = Gateway(), feed()
    this.take_delta(gateway.publish(0), 0.0)
    this.take_delta(data(AHEAD + 5), 0.0)
    request = this.request(0.0)
    assert request is not None
    this.take_past(gateway.answer(request))
    this.take_delta(gateway.publish(1), 0.0)
    assert passed_on(this) == [0, 1]
    assert this.request(10 * RETRY_DELAY) is None or this.delta == 2


@given(st.data())
def test_whatever_is_dropped_is_there_in_the_end_in_its_order(drawn: st.DataObject) -> None:
    gateway, this, now = Gateway(keeps=200), feed(), 0.0
    got: list[int] = []
    events: list[int] = []
    for number in range(60):
        now += 0.1
        if drawn.draw(st.booleans()):
            gateway.events += 1
            if drawn.draw(st.booleans()):
                this.take_events({"events": [event(gateway.events - 1)]})
        message = gateway.publish(number, last=number == 59)
        if drawn.draw(st.booleans()):
            this.take_delta(message, now)
        if (request := this.request(now)) is not None and drawn.draw(st.booleans()):
            this.take_past(gateway.answer(request))
        got += passed_on(this)
        events += [each[0] for each in this.events()]
    for _ in range(100):
        now += 0.5
        if (request := this.request(now)) is not None:
            this.take_past(gateway.answer(request))
        got += passed_on(this)
        events += [each[0] for each in this.events()]
    assert got == list(range(60))
    assert events == list(range(gateway.events))
    assert this.is_over


# Events ----------------------------------------------------------------------------------------------------


def test_events_that_did_not_come_are_asked_for_as_deltas_tell_their_number() -> None:
    gateway, this = Gateway(), feed()
    gateway.events = 3
    this.take_delta(gateway.publish(0), 0.0)
    request = this.request(0.0)
    assert request == Missing(RUN, 1, 0)
    this.take_past(gateway.answer(request))
    assert [each[0] for each in this.events()] == [0, 1, 2]


def test_the_last_delta_waits_for_the_events_before_it() -> None:
    gateway, this = Gateway(), feed()
    this.take_delta(gateway.publish(0), 0.0)
    gateway.events = 1
    this.take_delta(gateway.publish(1, last=True), 0.0)
    assert passed_on(this) == [0]
    assert not this.is_over
    request = this.request(0.0)
    assert request is not None
    this.take_past(gateway.answer(request))
    assert passed_on(this) == [1]
    assert this.is_over
    assert this.request(100.0) is None


def test_the_last_delta_waits_for_more_events_than_one_answer_holds() -> None:
    gateway, this = Gateway(), feed()
    gateway.events = 2 * EVENTS + 50
    this.take_delta(gateway.publish(0, last=True), 0.0)
    events: list[int] = []
    while (request := this.request(0.0)) is not None:
        assert not this.is_over
        this.take_past(gateway.answer(request))
        events += [each[0] for each in this.events()]
        numbers = passed_on(this)
    assert events == list(range(gateway.events))
    assert numbers == [0]
    assert this.is_over


def test_an_answer_that_was_made_before_the_last_delta_does_not_end_the_wait_for_its_events() -> None:
    gateway, this = Gateway(), feed()
    this.take_delta(gateway.publish(0), 0.0)
    older = gateway.answer(Missing(RUN, 1, 0))
    gateway.events = 1
    this.take_delta(gateway.publish(1, last=True), 0.0)
    this.take_past(older)
    assert passed_on(this) == [0]
    request = this.request(10.0)
    assert request == Missing(RUN, 2, 0)
    this.take_past(gateway.answer(request))
    assert passed_on(this) == [1]
    assert [each[0] for each in this.events()] == [0]


def test_messages_that_are_none_are_refused() -> None:
    with pytest.raises(FramesError):
        feed().take_delta(b"short", 0.0)
    with pytest.raises(FramesError):
        feed().take_past(b"\xff\xff\xff\xff")


# What is kept ----------------------------------------------------------------------------------------------


def test_an_answer_has_a_bounded_size() -> None:
    kept = KeptDeltas(1000, FULL_EVERY)
    for number in range(300):
        made = delta(number, size=1 if number < 200 else 10_000)
        kept.add(made, made.packed())
    assert len(kept.since(0)[1]) == MAX_DELTAS
    head, found = kept.since(205)
    assert head == 299
    assert 0 < sum(map(len, found)) <= MAX_DELTA_BYTES
    assert kept.since(300) == (299, [])
    assert KeptDeltas(5, 5).since(0) == (-1, [])
