"""Sequences that are started again and again while the former ones run are told once, with the place."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.machines import Bench, bench
from umo import connect
from umo.control import next_period, wait
from umo.cycle.piling_up import FEW, MANY
from umo.testing import periods


class Blinking(Bench):
    pause: str = "1 s"

    def control(self) -> None:
        self.cycle.start(self.blink())

    async def blink(self) -> None:
        await wait(self.pause)

    async def blink_once(self, pause: str) -> None:
        await wait(pause)


def told(m: Any) -> list[str]:
    return [event.text for event in m._machine.whole.events if "run at the same time" in event.text]


def test_a_sequence_that_is_started_in_each_period_is_told_once_with_its_place():
    with connect(bench(Blinking)) as m:
        periods(m, FEW)
        (text,) = told(m)
        assert text.startswith(f"{FEW} of sequence Blinking.blink run at the same time, and more are started (")
        line = Blinking.control.__code__.co_firstlineno + 1
        assert f"test_sequences_pile_up.py:{line} in control" in text
        assert "start the next one when `task.done` of the last one is true" in text
        periods(m, 5 * FEW)
        assert told(m) == [text]


def test_it_is_said_where_people_see_it(caplog: pytest.LogCaptureFixture):
    with connect(bench(Blinking)) as m:
        periods(m, 2 * FEW)
    assert sum("run at the same time" in record.getMessage() for record in caplog.records) == 1


def test_one_that_ends_before_it_is_started_again_is_not_told():
    machine = bench(Blinking)
    machine.pause = "3 ms"
    with connect(machine) as m:
        periods(m, 5 * FEW)
        assert told(m) == []


@pytest.mark.parametrize("step", ["at once", "one a period"])
def test_one_sequence_for_each_of_many_things_is_not_told(step: str):
    async def look_after(number: int) -> None:
        await wait("1 s")

    async def start(m: Bench) -> None:
        for number in range(4 * FEW):
            m.cycle.start(look_after(number))
            if step != "at once":
                await next_period()

    with connect(bench()) as m:
        m.cycle.start(start(m))
        periods(m, 5 * FEW)
        assert told(m) == []


def test_the_same_sequence_many_times_from_one_period_is_not_told():
    async def work() -> None:
        await wait("1 s")

    with connect(bench()) as m:
        for _ in range(4 * FEW):
            m.cycle.start(work())
        periods(m, 2)
        assert told(m) == []


def test_a_value_that_was_read_makes_no_other_sequence():
    async def note(value: float) -> None:
        await wait("1 s")

    with connect(bench()) as m:
        for _ in range(2 * FEW):
            m.cycle.start(note(m.now))
            periods(m)
        assert len(told(m)) == 1


def test_one_other_sequence_beside_delays_the_word_by_a_few_periods_only():
    with connect(bench(Blinking)) as m:
        m.cycle.start(m.blink_once("1 h"))
        periods(m, FEW + FEW // 2)
        assert len(told(m)) == 1


def test_it_is_found_beside_many_others():
    async def other(number: int) -> None:
        await wait("10 s")

    with connect(bench(Blinking)) as m:
        for number in range(100):
            m.cycle.start(other(number))
        periods(m, 150)
        assert len(told(m)) == 1


@pytest.mark.full
def test_a_number_that_grows_without_end_is_told_whatever_each_was_called_with():
    async def track(part: int) -> None:
        await wait("1 h")

    with connect(bench()) as m:
        for part in range(4 * MANY):
            m.cycle.start(track(part))
            periods(m)
        assert len(told(m)) == 1
