"""The promises of worlds with clients (`tools.schedules.client_promises`): what breaks each of them."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tools.schedules.client_promises import (
    ClientsEnd,
    answers_are_so,
    faces_learn_of_the_end,
    only_the_holder_commands,
    others_get_done,
    service_is_told_truly,
)
from tools.schedules.faults import parsed
from tools.schedules.shared import START
from umo.cycle.stage import Stage

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the processes of a run need Linux")
TAKEN = "control: event operator done lease"
OVER = "control: event supervisor done lease over=True"
EXPIRED = "control: event machine none the lease of operator has ended, because it was not renewed"
RUNS = f"control: enter {Stage.RUNNING}"


def ended(*lines: str, faults: str = "", processes: Any = ()) -> ClientsEnd:
    """A world with these steps, 10 ms one after the other."""
    texts = [f"{10.0 * number:.3f} {line} -> 0" for number, line in enumerate(lines)]
    came = list(parsed(f"0 clients: {faults}").faults)
    scheduler: Any = SimpleNamespace(lines=texts, processes=list(processes), came=came)
    return ClientsEnd(scheduler, Path("none.mcap"))


def process(name: str, ended_at: float) -> Any:
    return SimpleNamespace(name=name, is_dead=True, ended_at=START + round(ended_at * 1e9), ended_by="exit")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([TAKEN, "control: event operator done mode manual", "control: event operator done give back"], ""),
        ([TAKEN, OVER, "control: event supervisor done write motor 4.0 motor"], ""),
        (
            [TAKEN, OVER, "control: event operator done let go motor motor"],
            "carried out for operator, while supervisor",
        ),
        (["control: event operator done mode manual"], "while nobody had the lease"),
        ([TAKEN, "control: event supervisor done lease"], "supervisor has got the lease while operator had it"),
        ([OVER, EXPIRED], "the lease of operator has expired, and supervisor had it"),
        ([TAKEN, EXPIRED], "the lease of operator has expired, and nothing had happened to it"),
    ],
)
def test_a_command_of_who_has_not_the_lease_is_found(lines: list[str], told: str) -> None:
    found = [*only_the_holder_commands(ended(*lines))]
    assert told in found[0] if told else found == []


def test_the_lease_of_a_client_that_was_killed_may_expire() -> None:
    assert [*only_the_holder_commands(ended(TAKEN, EXPIRED, faults="kill operator at operator:3"))] == []


def test_an_answer_that_the_machine_has_not_given_is_found() -> None:
    assert [*answers_are_so(ended(TAKEN, "operator: told lease done"))] == []
    assert len([*answers_are_so(ended(TAKEN, "operator: told mode done"))]) == 1
    assert len([*answers_are_so(ended(TAKEN, "operator: told lease refused: held"))]) == 1
    own = "operator: told lease refused: another client has locked the queue of commands"
    assert [*answers_are_so(ended(TAKEN, own))] == []


def test_a_client_that_does_not_get_done_is_found_where_only_others_were_killed() -> None:
    exits = ["operator: exit 0", "supervisor: exit 1", "faces: exit 0", "recorder: exit 0"]
    assert [*others_get_done(ended(*exits))] == ["nothing has happened to supervisor, and it ended with exit 1"]
    assert [*others_get_done(ended(*exits, faults="kill supervisor at supervisor:3"))] == []
    assert [*others_get_done(ended(*exits, faults="kill control at supervisor:3"))] == []


def test_faces_that_learn_of_the_end_too_late_are_found() -> None:
    both = [process("control", 0.0), process("faces", 1.0)]
    begun = "faces: told begin"
    assert [*faces_learn_of_the_end(ended(begun, "faces: told end: gone", processes=both))] == []
    late = [begun, *["keeper: sleep"] * 10, "faces: told end: gone"]
    assert len([*faces_learn_of_the_end(ended(*late, processes=both))]) == 1
    assert len([*faces_learn_of_the_end(ended(begun, processes=both))]) == 1


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([RUNS, "guardian: service READY=1", "guardian: service WATCHDOG=1", "control: publish 0",
          "guardian: service WATCHDOG=1", "guardian: service STOPPING=1", "guardian: send ended"], ""),
        (["guardian: service STOPPING=1", "guardian: send ended"], ""),
        (["guardian: service READY=1"], "before the machine runs"),
        ([RUNS, "guardian: service WATCHDOG=1", "guardian: service WATCHDOG=1"], "without a new sign of life"),
        ([RUNS, "guardian: service STOPPING=1", "guardian: service READY=1"], "after STOPPING"),
        ([RUNS, "guardian: send ended"], "was not told of the stop"),
    ],
)  # fmt: skip
def test_what_a_service_manager_is_told_untruly_is_found(lines: list[str], told: str) -> None:
    found = [*service_is_told_truly(ended(*lines))]
    assert told in found[0] if told else found == []
