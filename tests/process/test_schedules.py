"""The stop, in every order of the processes and with faults at their gates (`tools.schedules`). What is long is in
`python -m tools.schedules`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from inspect import isfunction
from itertools import islice

import pytest

from helpers.documents import ROOT
from helpers.tiers import first, some
from tools.schedules.campaigns import (
    Played,
    Player,
    asks,
    at_random,
    beside_clients,
    gates_of,
    in_worlds,
    no_disks,
    no_forks,
    orders,
    pairs,
    played,
    shrunk,
    silences,
    singles,
)
from tools.schedules.cases import ONCE_WRONG, ROWS, cases
from tools.schedules.ends import BY_KEY, ENDS, UNSAFE, Times
from tools.schedules.faults import MS, Fault, Moment, Schedule, ScheduleError, What, parsed
from tools.schedules.gate import GATED
from tools.schedules.traces import follow, is_in_model
from umo.system import calls

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the processes of a run need Linux")
EVERY_KIND = (
    "7 frames: kill control at guardian:12; stop standby at guardian:12+60ms; continue standby at 90.5ms; "
    "hold worker 150ms at worker:3; ask at 20ms; ask operator at operator:3; no-fork guardian at guardian:9; "
    "no-forks guardian 80ms at guardian:9; no-disk 500ms at 1ms; "
    "silent d2 1300ms at control:20"
)
PARTS = 40
"""Of the single kills, the first of which is tried always."""


@pytest.fixture(scope="module")
def player() -> Iterator[Player]:
    with Player() as player:
        yield player


@pytest.fixture(scope="module")
def gates(player: Player) -> dict[str, int]:
    return gates_of(player, 0)


def wrong(schedules: Iterable[Schedule], player: Player) -> list[str]:
    """The lines that replay what is wrong, with what it is."""
    return [f"{each.schedule} | {'; '.join(each.wrong)}" for each in played(schedules, [player]) if each.wrong]


@pytest.mark.slow
@pytest.mark.parametrize("seeds", first(1, [range(1, 6), range(6, 1001)]), ids=str)
def test_without_a_fault_a_run_ends_well_in_every_order_of_its_processes(player: Player, seeds: range) -> None:
    assert wrong(orders(seeds), player) == []


@pytest.mark.slow
@pytest.mark.parametrize("begin", first(1, range(PARTS)))
def test_after_the_kill_of_any_process_at_any_gate_all_is_at_its_default_and_told(
    player: Player, gates: dict[str, int], begin: int
) -> None:
    assert wrong(islice(singles([What.KILL], 0, gates), begin, None, PARTS), player) == []


@pytest.mark.full
@pytest.mark.parametrize("what", [What.STOP, What.HOLD])
def test_after_any_process_is_stopped_or_held_up_at_any_gate_all_is_at_its_default_and_told(
    player: Player, gates: dict[str, int], what: What
) -> None:
    assert wrong(singles([what], 0, gates), player) == []


@pytest.mark.full
def test_a_stop_may_be_asked_for_at_any_gate(player: Player, gates: dict[str, int]) -> None:
    assert wrong(asks(0, gates), player) == []


@pytest.mark.full
@pytest.mark.parametrize("held", [0, 60])
def test_after_the_kill_of_any_two_processes_at_one_moment_all_is_at_its_default_and_told(
    player: Player, gates: dict[str, int], held: int
) -> None:
    assert wrong(pairs((What.KILL, What.KILL), 0, gates, held=held * MS), player) == []


@pytest.mark.full
@pytest.mark.parametrize("what", [What.KILL, What.STOP])
def test_so_it_is_of_a_run_with_frames_a_keeper_and_black_boxes(player: Player, what: What) -> None:
    gates = gates_of(player, 0, frames=True)
    assert wrong(in_worlds(singles([what], 0, gates), frames=True), player) == []


@pytest.mark.slow
@pytest.mark.parametrize("seeds", first(1, [range(1, 2), range(2, 101)]), ids=str)
def test_without_a_fault_clients_faces_recorder_and_service_manager_are_told_truly(
    player: Player, seeds: range
) -> None:
    assert wrong(in_worlds(orders(seeds), clients=True), player) == []


@pytest.mark.full
def test_after_a_fault_at_any_gate_of_a_client_all_is_told_truly_and_nobody_commands_without_the_lease(
    player: Player,
) -> None:
    assert wrong(beside_clients(0, gates_of(player, 0, clients=True), every=8), player) == []


@pytest.mark.full
def test_so_it_is_after_some_faults_at_random(player: Player) -> None:
    schedules = at_random(range(1, 301), gates_of(player, 0, clients=True))
    assert wrong(in_worlds(schedules, clients=True), player) == []


@pytest.mark.full
@pytest.mark.parametrize("campaign", [no_forks, no_disks, silences])
def test_where_forks_fail_disks_are_full_or_devices_silent_all_is_at_its_default_and_told(
    player: Player, gates: dict[str, int], campaign: Callable[..., Iterator[Schedule]]
) -> None:
    assert wrong(campaign(0, gates), player) == []


@pytest.mark.full
def test_after_some_faults_at_random_all_is_at_its_default_and_told(player: Player, gates: dict[str, int]) -> None:
    assert wrong(at_random(range(1, 1001), gates), player) == []


QUICK = {
    "0: ask at guardian:5",
    "0: ask at guardian:5; ask at guardian:6",
    "0: kill guardian at worker:5; stop worker at worker:5",
    "0: kill guardian at control:5; stop control at control:5",
    "0: no-fork guardian at guardian:10",
    "0 frames: kill keeper at keeper:5; kill control at keeper:5",
    "0 long: stop reserve at worker:20; kill guardian at worker:20",
    "0: kill guardian at guardian:79; stop standby at guardian:79",
    "0: kill guardian at guardian:76; kill standby at guardian:76",
    "37315: stop reserve at control:39; kill worker at worker:24",
    "18656: stop worker at worker:30; ask at worker:30; kill guardian at reserve:3",
    "0 clients: kill control at operator:12",
    "0 long: stop reserve at worker:20; kill control at worker:20; kill guardian at worker:20+200ms; "
    "kill standby at worker:20+200ms",
}
"""Of what was once wrong: what finds a planted fault (`tools.schedules.planted`), or has a kind of fault that no row of
the table of ends has. The others are as those rows, at other moments."""
NOTICED_BY_NOBODY_ELSE = {
    "handle_signal", "listen", "mask_signals", "message_sockets", "new_session", "pipe", "socket_of", "stat_of",
    "wall_time",
}  # fmt: skip
"""Functions of `calls` without a gate: what others can notice of them comes with another call; or they are clocks."""


def test_each_call_to_the_operating_system_has_a_gate_where_another_process_can_notice_it() -> None:
    functions = {
        name for name, value in vars(calls).items() if isfunction(value) and value.__module__ == calls.__name__
    }
    public = {name for name in functions if not name.startswith("_")}
    assert public - {*GATED} == NOTICED_BY_NOBODY_ELSE


@pytest.mark.slow
@pytest.mark.parametrize("line", some(lambda line: line in QUICK, ONCE_WRONG))
def test_what_was_once_wrong_is_right(player: Player, line: str) -> None:
    assert player.play(parsed(line)).wrong == []


# The table of docs/howto-stop-safely.md -------------------------------------------------------------------


def test_the_page_has_the_tables_of_ends() -> None:
    rows = (ROOT / "docs" / "howto-stop-safely.md").read_text("utf-8").splitlines()
    for table in (ENDS, UNSAFE):
        first = rows.index(table[0].row)
        assert rows[first : first + len(table) + 1] == [*(each.row for each in table), ""]


@pytest.mark.slow
@pytest.mark.parametrize(
    "key", [pytest.param(key, marks=pytest.mark.full) if key == "stopped within a reset" else key for key in ROWS]
)
def test_each_row_of_the_table_of_ends_is_kept(player: Player, key: str) -> None:
    found = player.play(parsed(ROWS[key]))
    assert found.wrong == []
    assert key in found.due.split(" + ")


def test_each_row_that_has_a_key_is_tried() -> None:
    assert {*ROWS} == {*BY_KEY}


@pytest.mark.slow
@pytest.mark.parametrize("what", [each.what for each in UNSAFE])
def test_what_cannot_be_made_safe_stays_driven_and_is_told(player: Player, what: str) -> None:
    (row,) = (each for each in UNSAFE if each.what == what)
    for line, devices in row.schedules.items():
        found = player.play(parsed(line))
        assert found.wrong == []
        assert found.driven[row.until] == devices.split()


def test_a_time_of_the_table_is_a_sum_of_times_and_settings() -> None:
    times = Times(period=0.5, hang_timeout=0.1, timeout=0.25)
    assert times.seconds("within 3 * `hang_timeout` + 40 ms more") == pytest.approx(0.34)
    assert times.seconds("immediately") == 0.0
    assert times.seconds("`call_timeout` + `watch_timeout` + 1.3 s") == pytest.approx(1.5 + 0.5 + 1.3)
    with pytest.raises(ValueError, match="soon"):
        times.seconds("soon")


# The model ------------------------------------------------------------------------------------------------

RESET_BY_GUARDIAN = "0: kill control at control:35"
ONCE_NO_PATH = (
    "0 long: stop worker at worker:12",  # it was ended, and no other one was forked in time
    "1021: kill standby at guardian:27+10ms; kill reserve at worker:19; kill control at worker:5+42ms",
)


def no_paths(schedules: Iterable[Schedule], player: Player) -> list[str]:
    """The plays whose traces are no paths of the model, and where."""
    found = ((each, follow(each, player.play(each, trace=True).trace)) for each in schedules if is_in_model(each))
    return [f"{each} | {why}" for each, why in found if why]


@pytest.mark.slow
def test_what_the_processes_do_is_a_path_of_the_model(player: Player) -> None:
    lines = ["0:", "7:", RESET_BY_GUARDIAN, "0: kill guardian at control:35; stop control at control:35"]
    assert no_paths(map(parsed, lines), player) == []


@pytest.mark.slow
def test_what_no_process_may_do_is_no_path_of_the_model(player: Player) -> None:
    schedule = parsed(RESET_BY_GUARDIAN)
    trace = player.play(schedule, trace=True).trace
    *_, forked = (number for number, line in enumerate(trace) if "guardian: fork reserve " in line)
    assert follow(schedule, trace) == ""
    assert "the model has no" in follow(schedule, [*trace[:forked], *trace[forked + 1 :]])


@pytest.mark.full
def test_each_play_of_the_campaigns_is_a_path_of_the_model(player: Player, gates: dict[str, int]) -> None:
    assert no_paths(map(parsed, ONCE_NO_PATH), player) == []
    assert no_paths(cases(), player) == []
    assert no_paths(orders(range(1, 50)), player) == []
    assert no_paths(singles([What.KILL], 0, gates), player) == []
    assert no_paths(in_worlds(singles([What.STOP], 0, gates), long=True), player) == []
    assert no_paths(at_random(range(1, 500), gates), player) == []


# A schedule -----------------------------------------------------------------------------------------------


def test_the_line_of_a_schedule_gives_the_schedule() -> None:
    assert str(parsed(EVERY_KIND)) == EVERY_KIND
    assert {fault.what for fault in parsed(EVERY_KIND).faults} == {*What}


@pytest.mark.parametrize(
    "line",
    ["kill control at 1ms", "0: kill at 1ms", "0: end control at 1ms", "0: hold control at 1ms", "0: kill d at b:+1ms"],
)
def test_what_is_no_schedule_is_refused(line: str) -> None:
    with pytest.raises(ScheduleError):
        parsed(line)


class Scripted(Player):
    """In its worlds a promise is broken where both of these are killed."""

    def __init__(self, *who: str) -> None:
        self._who = {*who}

    def play(self, schedule: Schedule, *, trace: bool = False) -> Played:
        is_wrong = self._who <= {fault.who for fault in schedule.faults}
        return Played(schedule, ["d1 is driven"] if is_wrong else [], 1, "", 0.0, 0.0, {}, None, {}, "", 0.0, 0.0)


def test_a_failure_is_reduced_to_the_faults_that_it_takes() -> None:
    faults = [Fault(What.KILL, who, Moment(who, 3)) for who in ("starter", "guardian", "worker", "control")]
    player = Scripted("guardian", "control")
    least = shrunk(player.play(Schedule(17, tuple(faults))), player)
    assert str(least.schedule) == "0: kill guardian at guardian:3; kill control at control:3"


@pytest.mark.slow
@pytest.mark.parametrize("anew", first(1, [False, True]))
def test_a_schedule_is_the_same_whenever_it_is_played(player: Player, anew: bool) -> None:
    schedule = parsed("23: kill control at control:30; hold guardian 60ms at guardian:20; ask at 31ms")
    before = player.play(schedule, trace=True).trace
    with Player() if anew else nullcontext(player) as another:
        assert another.play(schedule, trace=True).trace == before
