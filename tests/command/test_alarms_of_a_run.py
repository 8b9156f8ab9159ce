"""The alarms of a run in virtual time: in its table, in `summary.json` and in the plot, as those of a run in real time
are in `umo alarm list`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from helpers.machines import sensor, timer, wired
from umo import Compound, DigitalSensor, connect, published
from umo.cycle.trace import Trace
from umo.operation.alarms import Alarm, AlarmState, High, Low, Priority
from umo.operation.alarms.alarm_log import KEPT_SPANS, AlarmLog
from umo.operation.alarms.alarming import alarm_log
from umo.process.frames import Reader
from umo.testing import Scripted, periods
from umo_command.run.follow import RingFrame

Umo = Callable[..., Result]
STATION = """
from umo import Compound, DigitalActuator, DigitalSensor
from umo.operation.alarms import Alarm, High, Priority


class Press(Compound, alarms={
    "hot": Alarm(High("heater", 5.0), "the press is hot", priority=Priority.HIGH),
    "warm": Alarm(High("heater", 2.0), "the press is warm", priority=Priority.LOW),
    "never": Alarm(High("heater", 9.0), "too much"),
}):
    heater: DigitalActuator
    timer: DigitalSensor


def machine() -> Press:
    return Press(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.5),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo.control import wait


async def main(m, left: float = 0.0):
    for volts in (8.0, 3.0, 8.0, left):
        m.heater.write(volts)
        await wait("1 s")
"""


@pytest.fixture
def press(umo: Umo, tmp_path: Path) -> Path:
    folder = tmp_path / "press"
    folder.mkdir()
    (folder / "objects.py").write_text(STATION)
    (folder / "application.py").write_text(APPLICATION)
    return folder


def run_of(umo: Umo, *words: str) -> tuple[str, dict[str, Any]]:
    """What the command has printed, in a line, and the alarms of its summary."""
    result = umo("run", "press", "--no-record", "--summary", "s.json", *words)
    assert result.exit_code == 0, result.output
    return " ".join(result.stdout.replace("│", " ").split()), json.loads(Path("s.json").read_text())["alarms"]


def test_the_table_tells_how_often_alarms_were_raised_and_for_how_long(umo: Umo, press: Path) -> None:
    said, _ = run_of(umo)
    assert "alarms 3 raised, all cleared" in said
    assert "hot the press is hot (high): 2 times, 2 s in total, last from 2" in said
    assert "warm the press is warm (low): from 0" in said
    assert said.index("hot the press") < said.index("warm the press")  # the most important first
    assert "never" not in said


def test_an_alarm_that_is_active_at_the_end_is_said_to_be(umo: Umo, press: Path) -> None:
    said, alarms = run_of(umo, "--left", "3")
    assert "alarms 3 raised, 1 active at the end" in said
    assert "warm the press is warm (low): since 0" in said
    assert alarms["active"] == ["warm"]
    assert alarms["last"][1]["path"] == "warm"
    assert alarms["last"][1]["cleared"] is None


def test_the_summary_has_each_alarm_that_was_raised_and_when(umo: Umo, press: Path) -> None:
    _, alarms = run_of(umo)
    assert (alarms["raised"], alarms["active"], list(alarms["each"])) == (3, [], ["hot", "warm"])
    hot = alarms["each"]["hot"]
    assert (hot["text"], hot["priority"], hot["raised"], hot["state"]) == ("the press is hot", "high", 2, "returned")
    assert hot["active_s"] == pytest.approx(2.0, abs=0.1)
    assert [each["path"] for each in alarms["last"]] == ["hot", "warm", "hot"]
    assert all(each["cleared"] > each["raised"] for each in alarms["last"])


def test_a_machine_without_alarms_says_nothing_of_them(umo: Umo, press: Path) -> None:
    text = STATION.replace(STATION[STATION.index(", alarms={") : STATION.index("}):") + 1], "")
    (press / "objects.py").write_text(text)
    said, alarms = run_of(umo)
    assert "alarms" not in said
    assert alarms == {"raised": 0, "active": [], "each": {}, "last": []}


# The log ------------------------------------------------------------------------------------------------


class Tank(
    Compound,
    alarms={
        "full": Alarm(High("level", 80.0), "too full", priority=Priority.HIGH),
        "empty": Alarm(Low("level", 5.0), "empty"),
    },
):
    timer: DigitalSensor
    level: DigitalSensor


class Site(Compound):
    tanks: tuple[Tank, ...]
    timer: DigitalSensor


class Row:
    """What a log reads of a frame."""

    def __init__(self, time: float, *states: AlarmState) -> None:
        self.time, self.alarms = time, np.array(states, np.uint8)


def log_of(*rows: Row) -> AlarmLog:
    names = ("a", "b")
    log = AlarmLog([{"path": each, "text": f"text of {each}", "priority": "medium"} for each in names])
    for row in rows:
        log(row)
    return log


def test_acknowledging_an_active_alarm_does_not_raise_it_again() -> None:
    normal, active, acknowledged = AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED
    log = log_of(Row(0.0, normal, normal), Row(1.0, active, normal), Row(2.0, acknowledged, normal))
    assert (log.number, log.active) == (1, ["a"])
    assert log.alarms[0].active_s(5.0) == 4.0
    log(Row(6.0, normal, active))
    assert (log.number, log.active, log.alarms[0].cleared_s) == (2, ["b"], 5.0)


def test_an_alarm_that_cannot_be_evaluated_is_active_and_one_out_of_service_is_not() -> None:
    log = log_of(
        Row(0.0, AlarmState.BAD_UNACKNOWLEDGED, AlarmState.UNACKNOWLEDGED),
        Row(1.0, AlarmState.BAD_UNACKNOWLEDGED, AlarmState.OUT_OF_SERVICE),
    )
    assert (log.number, log.active, log.alarms[1].cleared_s) == (2, ["a"], 1.0)


def test_what_happens_to_a_shelved_alarm_is_counted() -> None:
    normal, shelved, active = AlarmState.NORMAL, AlarmState.SHELVED, AlarmState.SHELVED_ACTIVE
    states = [(normal, AlarmState.UNACKNOWLEDGED), (shelved, active), (active, shelved), (shelved, active)]
    log = log_of(*(Row(float(time), *each) for time, each in enumerate(states)))
    assert [(each.raised, each.cleared_s) for each in log.alarms] == [(1, 1.0), (2, 2.0)]
    assert (log.number, log.active, str(log.alarms[1].state)) == (3, ["b"], "shelved active")


def test_an_alarm_that_was_active_when_it_was_removed_from_service_is_not_counted_again_afterwards() -> None:
    normal, active, away = AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, AlarmState.OUT_OF_SERVICE
    states = [(active, normal), (away, away), (active, active), (normal, normal), (active, normal)]
    log = log_of(*(Row(float(time), *each) for time, each in enumerate(states)))
    assert [each.raised for each in log.alarms] == [2, 1]
    assert (log.number, log.alarms[0].cleared_s, len(log.spans)) == (3, 2.0, 4)


def test_the_log_of_an_alarm_that_flickers_for_ever_is_bounded_and_counts_all() -> None:
    log = log_of()
    for number in range(2 * KEPT_SPANS + 20):
        log(Row(float(number), AlarmState.NORMAL if number % 2 else AlarmState.ACKNOWLEDGED, AlarmState.NORMAL))
    assert (log.number, len(log.spans), log.alarms[0].cleared_s) == (KEPT_SPANS + 10, KEPT_SPANS, KEPT_SPANS + 10)


def test_frames_of_a_recording_and_of_a_run_in_real_time_give_the_same_log(tmp_path: Path) -> None:
    machine = Tank(timer=timer(), level=sensor(resolution=1.0))
    log, connection = alarm_log(machine), connect(machine, wired(machine, Scripted({"level": [90, 90, 50, 2, 2, 90]})))
    assert log is not None
    with connection as m, published(connection, "vat") as ring:
        connection.machine.observers.append(log)
        assert ring.path is not None
        with Reader(ring.path) as reader:
            periods(m, 6)
            frames = reader.last(6)
            of_frames, followed, seen = (
                AlarmLog(reader.layout.alarms),
                AlarmLog(reader.layout.alarms),
                RingFrame(machine),
            )
            seen.order(reader)
            of_frames.add_frames(frames[:3])
            of_frames.add_frames(frames[3:])
            for row in frames:
                seen.show(row)
                followed(seen)
    assert [each.path for each in log.spans] == ["full", "empty", "full"]
    assert log.spans == of_frames.spans == followed.spans
    assert log.alarms == of_frames.alarms == followed.alarms


# The plot -----------------------------------------------------------------------------------------------


def drawn(count: int) -> tuple[Any, Any]:
    pytest.importorskip("matplotlib")
    from umo_command.run.plot import Curves, draw

    machine = Site(tanks=tuple(Tank(timer=timer(), level=sensor(resolution=1.0)) for _ in range(count)), timer=timer())
    levels = {f"tanks.{i}.level": [90, 90, 50, 90] for i in range(count)}
    trace, log = Trace(), alarm_log(machine)
    clocks = {f"tanks.{i}.timer": {"driver": "simulated"} for i in range(count)}
    connection = connect(machine, wired(machine, Scripted(levels), entries=clocks))
    with connection as m:
        assert log is not None
        connection.machine.observers += [trace, log]
        periods(m, 4)
    figure, rest = draw(Curves.of(trace, log), "a run")
    assert rest == ""
    return figure.axes[-1], log


def test_the_plot_has_a_row_for_each_alarm_and_a_bar_wherever_it_was_active() -> None:
    axis, log = drawn(2)
    assert axis.get_ylabel() == "alarms"
    assert [each.get_text() for each in axis.get_yticklabels()] == ["tanks.1.full (high)", "tanks.0.full (high)"]
    bars = [path.get_extents() for path in axis.collections[0].get_paths()]
    spans = [each for each in log.spans if each.path == "tanks.1.full"]
    assert [(bar.x0, pytest.approx(bar.x1)) for bar in bars] == [
        (each.raised, each.cleared if each.cleared is not None else log.now) for each in spans
    ]
    assert len(bars) == 2


def test_alarms_of_a_list_share_a_row() -> None:
    axis, _ = drawn(12)
    assert [each.get_text() for each in axis.get_yticklabels()] == ["tanks[0..11].full (high)"]
    assert len(axis.collections[0].get_paths()) == 24


def test_a_plot_without_alarms_has_no_panel_of_them(umo: Umo, press: Path) -> None:
    pytest.importorskip("matplotlib")
    from umo_command.run.plot import Curves, draw

    figure, _ = draw(Curves(np.zeros((2, 3)), [], []), "nothing")
    assert all(axis.get_ylabel() != "alarms" for axis in figure.axes)
