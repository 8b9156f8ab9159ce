"""What one cause costs a period: the list of docs/bounds.md, and calls counted at two sizes (docs/decisions/0061)."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench import bounds
from bench.bounded_plant import Rig
from helpers.machines import actuator, timer, wired
from helpers.operator import Operator
from umo import Compound, DigitalActuator, action, connect
from umo.clients.remote.client_session import has_ended
from umo.cycle.events import LET_GO, CommandState, Event
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.verbs import VERBS
from umo.testing import Scripted

PAGE = Path(__file__).parents[2] / "docs" / "bounds.md"
SMALL = 50
CALLS_OF_ONE = 200
"""Calls of functions for each object that a cause concerns, at most; those of each of its equipment in it."""
CONSTANT = 3000
"""Calls that do not depend on the number of objects: 20 events and 20 changes of alarms are told."""


def rows() -> list[list[str]]:
    """The cells of the table of the page."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_page_lists_what_is_measured_with_its_bound() -> None:
    assert [row[0] for row in rows()] == [cause.name for cause in bounds.CAUSES]
    for row, cause in zip(rows(), bounds.CAUSES, strict=True):
        assert row[2:4] == [bounds.bound_of(cause, size * bounds.LIMIT / 1000) for size in bounds.SIZES], row
        assert re.findall("`([^`]+)`", row[1]) == list(cause.verbs), row


def test_every_command_of_clients_is_in_the_list() -> None:
    listed = {verb for cause in bounds.CAUSES for verb in cause.verbs}
    assert listed == {name for name, verb in VERBS.items() if not verb.is_level}


@pytest.fixture(scope="module")
def rigs() -> Iterator[dict[type[Rig], tuple[Rig, Rig]]]:
    kinds = dict.fromkeys(cause.rig for cause in bounds.CAUSES)
    made = {kind: (kind(SMALL), kind(2 * SMALL)) for kind in kinds}
    yield made
    for rig in (rig for both in made.values() for rig in both):
        rig.close()


def calls_in(step: Any) -> int:
    """Number of calls of Python and C functions."""
    count = 0

    def noted(frame: object, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(noted)
    try:
        step()
    finally:
        sys.setprofile(before)
    return count


def extra_calls(cause: bounds.Cause, rig: Rig) -> int:
    """The calls of the period that a cause meets, more than those of an idle one; of the second time."""
    more = 0
    for _ in range(2):
        cause.before(rig)
        rig.drain()
        idle = calls_in(rig.step)
        cause.arm(rig)
        more = calls_in(rig.step) - idle
        rig.drain()
        cause.after(rig)
        rig.drain()
    return more


@pytest.mark.parametrize("cause", bounds.CAUSES, ids=lambda cause: cause.name)
def test_what_a_cause_makes_a_period_do_grows_no_faster_than_the_objects(
    cause: bounds.Cause, rigs: dict[type[Rig], tuple[Rig, Rig]]
) -> None:
    small, large = (extra_calls(cause, rig) for rig in rigs[cause.rig])
    assert large <= 2 * max(small, 0) + CONSTANT / 30, (small, large)
    assert large <= CALLS_OF_ONE * 2 * SMALL + CONSTANT, large


class Line(Compound):
    """Actuators in a list of the machine itself."""

    timer: Any
    valves: list[DigitalActuator]


def line(count: int) -> tuple[Line, Any]:
    m = Line(timer=timer(), valves=[actuator() for _ in range(count)])
    return m, connect(m, wired(m, Scripted()))


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("how", ["given back", "lapsed", "let go", "taken over"])
def test_an_actuator_in_a_list_of_the_machine_is_released(count: int, how: str) -> None:
    m, connection = line(count)
    with connection:
        ann = Operator(m, Mode.MANUAL)
        ann.do("lease", seconds=2.0)
        for number in range(count):
            assert ann.do("write", f"valves.{number}", 3.0).state is CommandState.DONE
        if how == "given back":
            ann.do("give back")
        elif how == "lapsed":
            ann.alive = False
            ann.run(700)
        elif how == "let go":
            for number in range(count):
                ann.do("let go", f"valves.{number}")
        else:
            ann.letters.waiting.append(ClientCommand(99, "bob", "other", "lease", over=True))
        ann.run(2)
        assert [each.read() for each in m.valves] == [0.0] * count
        ended = [event for event in ann.events if event.state is CommandState.CANCELLED]
        if how == "let go":
            assert not ended
        elif count == 1:
            assert [(event.path, event.command > 0) for event in ended] == [("valves.0", True)]
        else:
            (event,) = ended
            assert (event.path, event.command, event.asked) == ("valves", 0, LET_GO)
            assert event.text.endswith(": 5 released: valves.0, valves.1 and 3 others")


class JoggedLine(Line):
    is_jogging = False

    @action(release="halt")
    def jog(self) -> None:
        """Drive while it is held."""
        self.is_jogging = True

    def halt(self) -> None:
        self.is_jogging = False


@pytest.mark.parametrize("count", [0, 1, 5])
@pytest.mark.parametrize("how", ["given back", "lapsed"])
def test_the_end_of_an_action_that_is_held_is_told_by_itself_beside_actuators(count: int, how: str) -> None:
    m = JoggedLine(timer=timer(), valves=[actuator() for _ in range(count)])
    with connect(m, wired(m, Scripted())):
        ann = Operator(m, Mode.MANUAL)
        ann.do("lease", seconds=2.0)
        for number in range(count):
            ann.do("write", f"valves.{number}", 3.0)
        jog = ann.call("jog")
        assert m.is_jogging
        if how == "given back":
            ann.do("give back")
        else:
            ann.alive = False
            ann.run(700)
        ann.run(2)
        assert not m.is_jogging
        ended = [event for event in ann.events if event.state is CommandState.CANCELLED]
        assert [event.path for event in ended if event.command == jog.command] == ["jog"]
        assert len(ended) == 1 + min(count, 1)


@pytest.mark.parametrize("path", ["cell.jog", "cell.valve", "cell.lamp", "other.valve"])
@pytest.mark.parametrize("around", ["", "cell", "cell.jog", "cell.valve"])
@pytest.mark.parametrize("number", [0, 7])
def test_the_end_of_several_actuators_is_that_of_no_action(path: str, around: str, number: int) -> None:
    objects = ["cell.valve", "cell.lamp", "other.valve"]
    reader: Any = SimpleNamespace(paths=objects, is_taken=lambda path: path == "cell.lamp")
    event = Event(1.0, around, "its lease ended", "ann", number, CommandState.CANCELLED, LET_GO)
    of_several = not number and path in ("cell.valve", "other.valve") and around in ("", path.partition(".")[0])
    assert has_ended(event, path, reader) == of_several
    assert has_ended(event, path, reader, 7) == (of_several or number == 7)


def test_of_the_commands_that_may_concern_the_whole_machine_one_is_carried_out_in_a_period() -> None:
    m, connection = line(1)
    with connection:
        ann = Operator(m)
        ann.do("lease")
        commands = [ann.send(*each) for each in (("acknowledge",), ("cancel",), ("lease",))]
        ann.run()
        answered = {event.command for event in ann.events}
        assert [each in answered for each in commands] == [True, False, False]
        ann.run()
        answered = {event.command for event in ann.events}
        assert all(each in answered for each in commands)
