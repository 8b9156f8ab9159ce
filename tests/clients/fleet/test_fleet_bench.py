"""The bench of a fleet: what it checks, and a short form of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from bench.fleet import campaign
from bench.fleet.checker import MADE_WORDS, Follower
from bench.fleet.namespaces import missing
from bench.fleet.rings import value
from bench.fleet.strikes import Strike
from bench.fleet.verdicts import presence
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.message_parts import packed
from umo.clients.fleet.run_feed import RETRY_DELAY, TRIES
from umo.clients.fleet.run_words import FULL, Delta, Words

RUN = b"12345678"


def words(number: int) -> Words:
    frame = np.zeros(1, MADE_WORDS.dtype)
    frame["number"], frame["values"] = number, value(number)
    return MADE_WORDS.words(frame[0])


def delta(number: int, before: int | None) -> bytes:
    places, changed = MADE_WORDS.changed(words(number), None if before is None else words(before))
    return Delta(RUN, number, 0 if before is not None else FULL, places, changed, b"").packed()


def follower() -> Follower:
    return Follower(StationKey("c1", "made000"), RUN, MADE_WORDS)


def test_a_follower_counts_deltas_that_come_again_and_those_that_are_lost() -> None:
    this = follower()
    for data in (delta(0, None), delta(1, 0), delta(0, None), delta(1, 0), delta(2, 1), delta(8, 7)):
        this.take(data)
    this.take_past(packed(json.dumps({"head": 8, "event": 0, "events": []}).encode(), delta(7, None), delta(8, 7)))
    told = this.told
    assert (told.received, told.again, told.lost, told.untold, told.wrong) == (5, 2, 4, 0, 0)
    assert [each[:2] for each in told.gaps] == [(3, 4)]


def test_a_follower_finds_what_has_no_basis_and_values_that_were_not_made() -> None:
    this = follower()
    this.take(delta(0, None))
    this.take(delta(5, 4))
    for turn in range(TRIES + 1):
        this.feed.request(turn * RETRY_DELAY)
    this.go_on()
    this.take(delta(6, None))
    assert (this.told.untold, this.told.lost, this.told.wrong) == (1, 5, 0)
    this.take(Delta(RUN, 7, 0, np.zeros(1, "<u2"), np.ones(1, np.uint64), b"").packed())
    assert this.told.wrong == 1


def test_a_change_of_presence_without_a_strike_is_told() -> None:
    strikes = [Strike("stations killed", ["c1"], 10.0, 13.0, made_only=True)]
    changes = [(10.6, "c1/made000", False), (13.4, "c1/made000", True), (11.0, "c1/Plant", False)]
    rows = {row.what: row for row in presence(strikes, changes, 0.0)}
    assert rows["stations killed: seen gone"].verdict == "met"
    assert rows["changes of presence without a reason"].measured == "1"


@pytest.mark.full
@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_a_short_form_of_the_bench_loses_nothing() -> None:
    """Three computers, two routers, 13 stations; one strike of each kind."""
    rows = list(campaign.measure(0.5, lambda what: None, campaign.SHORT))
    timed = ("values older than 2 s", "scrapes")  # no times here
    wrong = [
        row for row in rows
        if row.verdict == "missed" and row.target not in ("1 s", "3 s") and not row.what.startswith(timed)
    ]  # fmt: skip
    assert not wrong
    assert any("done twice" in row.what for row in rows)
