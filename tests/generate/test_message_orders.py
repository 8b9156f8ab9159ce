"""Orders of messages, between a host and its controller and in a fleet: what a transport may do to them, and what is
true all the same (docs/decisions/0121). Each test that names a finding is the schedule that has shown it."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator

import pytest

from helpers.generating import needs_a_compiler
from tools.message_orders import command_world, feed_world, link_world
from tools.message_orders.fleet_net import Net
from tools.message_orders.line import Line
from tools.message_orders.planted import PLANTED
from tools.message_orders.schedules import Finding, Schedule, at_random, exhaustive, shrunk

Run = Callable[[Schedule], str]
FEED = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)


@pytest.fixture(scope="module")
def link() -> Iterator[Run]:
    with link_world.controller_library() as library:
        runs = link_world.LinkRuns(library)
        yield runs.run
        runs.close()


@pytest.fixture(scope="module")
def fleet() -> Iterator[Run]:
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    commands, follow = command_world.CommandRuns(), feed_world.FeedRuns()
    yield lambda each: (commands if each.scenario in command_world.SCENARIOS else follow).run(each)
    commands.close()


FLEET = (*feed_world.SCENARIOS, *command_world.SCENARIOS)


def failing(schedules: Iterator[Schedule], run: Run) -> str:
    """The first one that fails, as short as it can be; "": none does."""
    for each in schedules:
        if text := run(each):
            shortest = shrunk(Finding(each, text), run)
            return f'python -m tools.message_orders --replay "{shortest.schedule}": {shortest.text}'
    return ""


# The link --------------------------------------------------------------------------------------------------


@needs_a_compiler
def test_the_link_is_true_and_in_step_again_whatever_becomes_of_two_messages(link: Run) -> None:
    assert failing(exhaustive(link_world.SCENARIOS, Line.EACH, 2), link) == ""


@needs_a_compiler
def test_the_link_at_random(link: Run) -> None:
    assert failing(at_random(link_world.SCENARIOS, Line.LETTERS[1:], 60, 0, 40), link) == ""


@needs_a_compiler
@pytest.mark.parametrize(
    "line",
    [
        pytest.param("run .W.", id="what was given is not given again where only its answer was lost"),
        pytest.param("greet R.H", id="the items of a START that is said again are not carried out again"),
        pytest.param("greet ..E", id="a session that has ended is not begun by a late copy of its START"),
        pytest.param("guardian ...L", id="a guardian says STOP again with a number that is answered"),
        pytest.param("orphan E.H", id="a guardian greets again where another greeting has come after its own"),
        pytest.param("guardian .SLL..L", id="a guardian takes no answer of another session"),
        pytest.param("run .WH", id="a value counts its age from when it was asked for"),
    ],
)
def test_of_the_link(line: str, link: Run) -> None:
    assert link(Schedule.of(line)) == ""


@needs_a_compiler
@pytest.mark.full
@pytest.mark.parametrize("scenario", link_world.SCENARIOS)
def test_the_link_whatever_becomes_of_six_messages(scenario: str, link: Run) -> None:
    assert failing(exhaustive((scenario,), Line.EACH, 6), link) == ""


@needs_a_compiler
@pytest.mark.full
def test_the_link_at_random_at_length(link: Run) -> None:
    assert failing(at_random(link_world.SCENARIOS, Line.LETTERS[1:], 10_000, 1000, 40), link) == ""


# The fleet -------------------------------------------------------------------------------------------------


@FEED
def test_a_fleet_is_true_and_in_step_again_whatever_becomes_of_two_messages(fleet: Run) -> None:
    assert failing(exhaustive(FLEET, Net.EACH, 2), fleet) == ""


@FEED
def test_a_fleet_at_random(fleet: Run) -> None:
    assert failing(at_random(FLEET, Net.LETTERS[1:], 24, 0, 40), fleet) == ""


@FEED
@pytest.mark.parametrize(
    "line",
    [
        pytest.param("silence W.", id="what comes late counts its age from when it was made"),
        pytest.param("stalled L", id="the image of a station that stands is not fresh"),
        pytest.param("commands H...H...RL", id="a last answer that comes twice is told once"),
        pytest.param("stalled .H", id="an answer that comes late is not of when it comes"),
    ],
)
def test_of_a_fleet(line: str, fleet: Run) -> None:
    assert fleet(Schedule.of(line)) == ""


@FEED
def test_after_a_slow_declaration_the_clocks_are_compared_again(fleet: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed_world, "LONG", 2.0)  # longer than values are fresh
    assert fleet(Schedule.of("join H")) == ""


@FEED
@pytest.mark.full
@pytest.mark.parametrize("scenario", FLEET)
def test_a_fleet_whatever_becomes_of_six_messages(scenario: str, fleet: Run) -> None:
    assert failing(exhaustive((scenario,), Net.EACH, 6), fleet) == ""


@FEED
@pytest.mark.full
def test_a_fleet_at_random_at_length(fleet: Run) -> None:
    assert failing(at_random(FLEET, Net.LETTERS[1:], 10_000, 1000, 40), fleet) == ""


# Schedules -------------------------------------------------------------------------------------------------


def test_a_finding_is_shrunk_to_the_letters_that_it_needs() -> None:
    def run(schedule: Schedule) -> str:
        return "wrong" if schedule.letters[1:2] == "L" and "H" in schedule.letters else ""

    assert shrunk(Finding(Schedule("run", "XLRH.."), "wrong"), run) == Finding(Schedule("run", ".L.H"), "wrong")
    assert Schedule.of(str(Schedule("run", ".L.H"))) == Schedule("run", ".L.H")


def test_random_schedules_repeat_with_their_seed() -> None:
    assert [*at_random(("run",), "LR", 5, 3, 20)][1:] == [*at_random(("run",), "LR", 4, 4, 20)]


def test_each_fault_that_is_planted_has_its_place_in_umo() -> None:
    assert all(each.place().is_file() for each in PLANTED)
    assert len({each.what for each in PLANTED}) == len(PLANTED)
