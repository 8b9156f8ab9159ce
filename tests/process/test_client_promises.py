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
    clients_end_well,
    faces_learn_of_the_end,
    holds_end,
    only_the_holder_commands,
    recording_is_whole,
    service_is_told_truly,
)
from tools.schedules.faults import parsed
from tools.schedules.shared import START, Move, Moved
from umo.cycle.stage import Stage

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the processes of a run need Linux")
TAKEN = "control: event operator done lease"
OVER = "control: event supervisor done lease over=True"
EXPIRED = "control: event machine none the lease of operator has ended, because it was not renewed"
RUNS = f"control: enter {Stage.RUNNING}"


def ended(*lines: str, faults: str = "", processes: Any = (), levels: Any = ()) -> ClientsEnd:
    """A world with these steps, 10 ms one after the other, and these levels of the first device, with their times."""
    texts = [f"{10.0 * number:.3f} {line} -> 1" for number, line in enumerate(lines)]
    came = list(parsed(f"0 clients: {faults}").faults)
    moves = [Moved(0, 0, Move.WRITE, level, START + round(time * 1e9)) for time, level in levels]
    memory = SimpleNamespace(moves=moves)
    clock = START + 10**10
    scheduler: Any = SimpleNamespace(lines=texts, processes=list(processes), came=came, memory=memory, clock=clock)
    return ClientsEnd(scheduler, Path("none.mcap"))


def process(name: str, ended_at: float) -> Any:
    at = START + round(ended_at * 1e9)
    return SimpleNamespace(name=name, is_dead=True, ended_at=at, lost_at=at, ended_by="exit")


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


def test_a_client_that_is_refused_as_dead_and_lives_is_found() -> None:
    lines = ["control: event operator refused write", "operator: told write refused: motor: dead-man timeout: no"]
    assert len([*answers_are_so(ended(*lines))]) == 1
    assert [*answers_are_so(ended(*lines, faults="hold operator 700ms at operator:3"))] == []


@pytest.mark.parametrize(
    ("lines", "lost_at", "levels", "told"),
    [
        ([TAKEN], 0.1, [(0.05, 3), (0.3, 0)], ""),
        ([TAKEN], 0.1, [(0.05, 3), (0.7, 0)], "600 ms after it was lost"),
        ([TAKEN, OVER], 9.0, [(0.005, 3), (0.03, 4)], ""),
        ([TAKEN, OVER], 9.0, [(0.005, 3), (0.2, 4)], "190 ms after it has lost the lease"),
        ([TAKEN, EXPIRED], 9.0, [(0.005, 3), (0.2, 0)], "190 ms after it has lost the lease"),
        ([TAKEN, OVER], 9.0, [(0.005, 7), (0.2, 0)], ""),
    ],
)
def test_what_a_client_has_written_and_stays_is_found(
    lines: list[str], lost_at: float, levels: list[tuple[float, int]], told: str
) -> None:
    found = [*holds_end(ended(*lines, processes=[process("operator", lost_at)], levels=levels))]
    assert told in found[0] if told else found == []


def test_a_client_that_does_not_get_done_is_found_where_only_others_were_killed() -> None:
    exits = ["operator: exit 0", "supervisor: exit 1", "faces: exit 0", "recorder: exit 0", "control: exit 0"]
    assert [*clients_end_well(ended(*exits))] == ["nothing has happened to supervisor, and it ended with 1"]
    assert [*clients_end_well(ended(*exits, faults="kill supervisor at supervisor:3"))] == []
    assert [*clients_end_well(ended(*exits, faults="kill control at supervisor:3"))] == []


def test_a_client_that_ends_by_an_exception_is_found() -> None:
    faults = "kill control at supervisor:3"
    assert [*clients_end_well(ended("faces: exit 97", faults=faults))] == ["faces has ended with status 97"]


def test_a_recorder_that_has_recorded_nothing_is_found() -> None:
    published = ["control: publish 0", "control: publish 1"]
    ends = [process("control", 1.0), process("recorder", 1.0)]
    (found,) = recording_is_whole(ended(*published, processes=ends))
    assert "nothing was recorded of 2 periods" in found
    assert [*recording_is_whole(ended(*published, processes=ends[:1]))] == []


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
        ([RUNS, "guardian: service READY=1", "guardian: service WATCHDOG=1", "control: beat", "guardian: poll",
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
