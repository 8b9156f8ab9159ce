"""Every claim of docs/howto-stop-safely.md is tried by a test: its rows and sentences, listed in stop_safely_page.txt.

A row or sentence that is new or was changed has no entry until somebody has looked at it again.
"""

from __future__ import annotations

import ast
import os
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.documents import ROOT
from helpers.machines import Board, bench, on, sensor, wired
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe
from helpers.waiting import until
from umo import Compound, DigitalActuator, Quality, connect, run
from umo.cycle.stopping import request_stop
from umo.drivers.optional import WaitEnded
from umo.objects.stop_order import stop_sequence
from umo.process import reset
from umo.process.reset import Resetter
from umo.system import calls, folders, processes
from umo.testing import Scripted, VirtualTimer, periods
from umo.wiring import resolve

PAGE, LIST = ROOT / "docs" / "howto-stop-safely.md", Path(__file__).with_name("stop_safely_page.txt")
NO_TESTS = {"(advice)", "(definition)", "(limit)", "(where else)"}
"""In place of a test: what nobody can try."""
BLOCK = re.compile(r"^```.*?^```", re.M | re.S)
SENTENCE_END = re.compile(r"(?<=[.!?])\s+(?=[A-Z`\[(*]|umo\b)|(?<=\.\))\s+")
RULE = re.compile(r"[|\s:-]+")


def claims(text: str) -> list[str]:
    """The rows of tables, without their headings, and the sentences, in their order; code is tried by test_docs.py."""
    found: list[str] = []
    lines = [line.strip() for line in BLOCK.sub("", text).splitlines()]
    paragraph: list[str] = []
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        row, begins = line.startswith("|"), not line or line.startswith(("|", "#", "- "))
        if begins:
            found += SENTENCE_END.split(" ".join(paragraph))
            paragraph = []
        if row and not RULE.fullmatch(line) and not (following and RULE.fullmatch(following)):
            found.append(line)
        elif line and not row and not line.startswith("#"):
            paragraph.append(line.removeprefix("- "))
    found += SENTENCE_END.split(" ".join(paragraph))
    return [each for each in found if each]


def listed() -> dict[str, list[str]]:
    """The tests of each claim, as the list has them."""
    found: dict[str, list[str]] = {}
    claim = ""
    for line in LIST.read_text("utf-8").splitlines():
        if line.startswith("    "):
            found[claim].append(line.strip())
        elif line and not line.startswith("# "):
            assert line not in found, f"listed twice: {line}"
            claim = line
            found[claim] = []
    return found


@cache
def named_in(file: str) -> set[str]:
    tree = ast.parse((Path(__file__).parents[1] / file).read_text("utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_each_claim_of_the_page_has_tests_that_try_it() -> None:
    page, tried = claims(PAGE.read_text("utf-8")), listed()
    assert [each for each in page if each not in tried] == [], "not tried by any test, or changed"
    assert [each for each in tried if each not in page] == [], "no longer on the page"
    assert [each for each, tests in tried.items() if not tests] == []


def test_the_tests_that_the_list_names_exist() -> None:
    for claim, tests in listed().items():
        for each in tests:
            file, _, name = each.partition("::")
            assert each in NO_TESTS or name in named_in(file), f"{each}: of {claim}"


def test_a_claim_that_is_changed_or_new_has_no_entry() -> None:
    """The list fails for each: a sentence, a row, the cell of a row."""
    text, known = PAGE.read_text("utf-8"), set(listed())
    for changed in (
        text.replace("no period ends for longer", "no period ends for much longer"),
        text.replace("| 124 | no |", "| 125 | no |"),
        text.replace("## What umo does not promise", "It also tells the weather.\n\n## What umo does not promise"),
        text.replace("- **One actuator", "- It never rains.\n- **One actuator"),
    ):
        assert changed != text
        assert len([each for each in claims(changed) if each not in known]) == 1
    assert set(claims(text)) == known


# What no other test tries ----------------------------------------------------------------------------------


def test_a_stop_order_names_patterns_lists_and_dicts() -> None:
    def volts() -> DigitalActuator:
        return DigitalActuator("V", default=0, minimum=0, maximum=1, resolution=0.1)

    class Zone(Compound):
        fan: DigitalActuator
        heater: DigitalActuator

    class Oven(Compound, stop_order=("zones.*.heater", "valves", "lamps")):
        lamps: Any
        zones: Any
        valves: Any

    oven = Oven(
        lamps=[volts(), volts()], zones=[Zone(fan=volts(), heater=volts()) for _ in range(2)], valves={"a": volts()}
    )
    assert [item.path for item in stop_sequence(oven)] == [
        *("zones.0.heater", "zones.1.heater", "valves.a", "lamps.0", "lamps.1"),
        *("zones.0.fan", "zones.1.fan"),
    ]


def test_a_wiring_gives_the_invalid_raws_of_its_circuit() -> None:
    machine, box = bench(encoder=sensor(on_error="mark")), Scripted({"encoder": [5, 7]})
    with connect(machine, wired(machine, box, entries={"encoder": {"invalid_raws": [7]}})) as m:
        assert m.encoder.quality is Quality.GOOD
        periods(m)
        assert m.encoder.quality is Quality.BAD


def names_of_children(pid: int) -> set[str]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return {processes.name_of(int(child)) for child in found}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="children are looked up in Linux's /proc")
def test_in_a_program_of_ones_own_there_is_one_process() -> None:
    before = names_of_children(os.getpid())

    async def children(m: Any) -> set[str]:
        return names_of_children(os.getpid()) - before

    machine = bench()
    assert run(machine, wired(machine, Scripted(), clock=VirtualTimer()), children) == set()


class Asked(VirtualTimer):
    """A timer of one's own, during whose third wait somebody asks for a stop. It ends the wait, or waits on."""

    def __init__(self, ends_the_wait: bool) -> None:
        super().__init__()
        self._ends_the_wait, self.waits = ends_the_wait, 0

    def read(self, channel: Any) -> int:
        self.waits += 1
        if self.waits == 3:
            request_stop()
            if self._ends_the_wait:
                raise WaitEnded
        return super().read(channel)


def test_a_timer_of_ones_own_ends_the_run_when_its_call_returns() -> None:
    machine, box, clock = bench(), Scripted(), Asked(ends_the_wait=False)
    assert run(machine, wired(machine, box, clock=clock)) is None
    assert clock.waits == 3
    assert box.get("valve") == 0


def test_in_a_loop_of_ones_own_the_timer_gives_minus_1_after_a_stop() -> None:
    machine, read = bench(), list[tuple[float, float]]()
    with connect(machine, wired(machine, Scripted(), clock=Asked(ends_the_wait=True))) as m:
        while m.cycle.running:
            read.append((m.timer.read(), m.now))
            m.sample()
            m.update()
    assert [tick for tick, _ in read] == [0, 0, -1]
    assert read[-1][1] == read[-2][1]


def test_whoever_resets_after_a_death_writes_every_default_three_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """At once, when the connections of the dead process are closed, and when its pending requests are over."""

    def no_room() -> int:
        raise BlockingIOError("no room for another process")

    machine, board, waited = bench(), Board("three times"), list[float]()
    monkeypatch.setattr(calls, "fork", no_room)
    monkeypatch.setattr(reset, "wait_for", lambda seconds, pause, on_call: waited.append(seconds))
    resetter = Resetter(machine, resolve(machine, on(board, machine)))
    assert resetter.reset(5.0) == {}
    outputs = ("motor", "valve")
    made = [call for call in board.calls if call.segment in ("initialize", "reset") and call.channels[0] in outputs]
    assert [call.channels[0] for call in made] == [*outputs] * 3
    assert [call.segment for call in made[::2]] == ["initialize", "reset", "reset"]
    assert len(waited) == 1


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="processes of their own need Linux")
def test_the_processes_of_a_run_have_their_names(tmp_path: Path) -> None:
    cells = Cells(tmp_path / "box")
    running = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    known = {running.guardian: "umo guardian", running.control: "umo control", running.standby: "umo standby"}
    until(lambda: {pid: processes.name_of(pid) for pid in known} == known)
    until(lambda: {"umo control", "umo standby", "umo reset"} <= names_of_children(running.guardian))
    running.channel.send("stop")
    assert not running.outcome().unsafe
    assert_safe(cells)


def test_records_are_in_var_tmp_unless_umo_state_names_another_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(folders.STATE_VARIABLE, str(tmp_path / "own"))
    assert folders.lasting() == tmp_path / "own"
    monkeypatch.delenv(folders.STATE_VARIABLE)
    assert folders.lasting() in (Path("/var/tmp"), Path("/tmp"))
    assert folders.LASTING_PLACES[0] == Path("/var/tmp")


def test_the_campaign_does_as_many_kills_as_the_page_says() -> None:
    from bench.kills.kinds import KINDS

    (said,) = re.findall(r"makes ([\d,]+) kills", " ".join(PAGE.read_text("utf-8").split()))
    assert int(said.replace(",", "")) == sum(kind.count for kind in KINDS)
