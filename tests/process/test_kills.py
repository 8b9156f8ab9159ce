"""The short form of `python -m bench --kills`: one try of each important kind, at a box made with libmodbus."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.kills import box, campaign, kept
from bench.kills.box import Box
from bench.kills.kinds import KINDS, possible
from bench.kills.station.journal import COLUMNS, SIZE
from helpers.waiting import until
from umo.process.kept_file import KeptValues

needs_box = pytest.mark.skipif(box.missing() is not None, reason=str(box.missing()))
SHORT = [
    "SIGKILL of the control process",
    "SIGSTOP of it, hang_timeout 100 ms",
    "SIGKILL of the guardian",
    "SIGSTOP of the guardian",
    "SIGKILL of the starter under nohup",
    "SIGSTOP of all for 3 s",
    "SIGKILL of guardian and control at once",
    "SIGKILL of control, then the guardian",
    "os.fork in control code, TERM",
    "INT twice, 5 to 60 ms apart",
    "TERM to all at once",
    "SIGKILL of any at start-up",
    "control killed, box stalled",
    "without privileges: control killed",
    "pids.max reached: control killed",
    "0 to 3 descriptors left: control killed",
    "box: byte count 200 of bits",
    "operated: SIGKILL of keeper and control",
]
CHOSEN = {kind.name: kind for kind in KINDS if kind.name in SHORT}


@needs_box
@pytest.mark.full
def test_every_output_is_at_its_default_and_the_status_is_right_after():
    """All of them in one campaign: while one starts, the outputs of the one before are looked at again."""
    rows = campaign.measure([CHOSEN[name] for name in SHORT if possible(CHOSEN[name])], share=0.001)
    tries = [one for row in rows for one in row.tries]
    assert [str(one) for one in tries if one.unsafe or one.wrong or one.ms is None] == []
    assert len(tries) == len(rows) > 0


# The box and the table themselves ------------------------------------------------------------------------


@pytest.fixture
def own_box(tmp_path: Path) -> Iterator[Box]:
    found = Box(tmp_path)
    yield found
    found.close()


def connect(own_box: Box) -> socket.socket:
    return socket.create_connection(("127.0.0.1", own_box.port), timeout=10.0)


def write_coil(connection: socket.socket, coil: int, on: bool, *, answered: bool = True) -> bytes:
    """Function 5 as it stands in the specification; its answer."""
    connection.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 5, coil, 0xFF00 if on else 0))
    return connection.recv(64) if answered else b""


@needs_box
def test_the_box_notes_when_an_output_leaves_its_default_and_comes_back(own_box):
    with connect(own_box) as connection:
        before = own_box.since
        write_coil(connection, 3, True)
        assert own_box.values[3] == 1
        assert own_box.since == 0
        write_coil(connection, 3, False)
        assert own_box.since > before > 0
        assert (own_box.left, own_box.requests) == (1, 2)


@needs_box
def test_a_stalled_box_carries_out_a_stale_write_after_a_newer_one(own_box):
    with connect(own_box) as old, connect(own_box) as new:
        write_coil(old, 0, False)
        write_coil(new, 0, False)
        own_box.fault("stall", 300)
        until(lambda: own_box.met)
        write_coil(old, 7, True, answered=False)
        assert len(write_coil(new, 7, False)) == 12
        assert old.recv(64)
        assert own_box.values[7] == 1
        assert not own_box.faulty


@needs_box
@pytest.mark.parametrize("name", ["silent", "coil", "unit", "transaction", "half", "exception", "value"])
def test_a_fault_that_is_not_carried_out_changes_no_output(own_box, name):
    own_box.fault(name, 4)
    with connect(own_box) as connection:
        write_coil(connection, 2, True, answered=name != "silent")
        until(lambda: own_box.met)
        own_box.heal()
        write_coil(connection, 1, True)
        assert own_box.values[:4] == [0, 1, 0, 0]
        assert own_box.met == 1


# What is kept -------------------------------------------------------------------------------------------


def row(number: int, moment: float, count: int, state: int, alarm: int) -> bytes:
    return struct.pack(f"<{COLUMNS}d", number, moment, count, state, alarm, *[0] * (COLUMNS - 5))


def values(number: int, count: int, state: str, alarm: int) -> KeptValues:
    sections = {
        "numbers": {"count": {"value": count, "unit": "", "type": "int"}},
        "alarms": {"full": alarm} if alarm else {},
        "states": {"filler.unit": state},
    }
    return KeptValues("station", "box", period=number, sections=sections)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[kept.Journal]:
    """Of two periods, the second one 1.5 s later."""
    found = kept.Journal(tmp_path / "0.rows")
    names = {"numbers": ["count"], "states": ["filler.unit"], "alarms": ["full"]}
    found.file.with_suffix(".json").write_text(json.dumps(names))
    rows = [row(1, 10.0, 5, 2, 0), row(0, 0.0, 0, 0, 0), row(1, 11.0, 6, 6, 1), row(2, 12.5, 7, 11, 0)]
    with found.file.open("r+b") as opened:
        opened.write(b"".join(rows))
    assert found.file.stat().st_size == SIZE
    yield found
    found.close()


@pytest.mark.parametrize(
    ("found", "allowed", "wrong"),
    [
        (values(2, 7, "held", 0), 0.0, ""),
        (values(1, 6, "execute", 1), 0.0, ""),  # the journal is written before the frame
        (values(1, 6, "execute", 1), 2.0, ""),
        (values(1, 6, "execute", 1), 1.0, "kept values 1.50 s old"),
        (values(2, 7, "held", 1), 0.0, "kept values are not those of their period: alarms full 1 in place of 0.0"),
        (values(2, 7, "execute", 0), 0.0, "kept values are not those of their period: states filler.unit execute"),
        (values(2, 6, "held", 0), 0.0, "kept values are not those of their period: numbers count 6.0 in place of 7.0"),
        (values(9, 7, "held", 0), 0.0, "kept values of the period 9, which the machine did not have"),
        (None, 1.0, "nothing was kept"),
        ("it is torn", 1.0, "it is torn"),
    ],
)
def test_what_is_kept_of_no_moment_or_of_an_old_one_is_told(
    journal: kept.Journal, found: KeptValues | str | None, allowed: float, wrong: str
) -> None:
    told = kept.wrong_moment(found, journal, allowed)
    assert told.startswith(wrong) if wrong else told == ""


def test_what_the_next_run_has_not_taken_over_is_told(journal: kept.Journal) -> None:
    """A shelved alarm begins as normal, units stopped."""
    assert kept.wrong_start(values(9, 5, "execute", 6), journal) == ""
    wrong = kept.wrong_start(values(9, 4, "execute", 1), journal)
    assert wrong == "the next run has not taken over: numbers count 4.0 in place of 5.0, alarms full 1 in place of 0.0"
