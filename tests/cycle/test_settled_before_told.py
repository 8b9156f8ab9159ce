"""In a period nothing is put into words, logged or shown before its last output is sent (docs/decisions/0060)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.operator import Operator
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.control import next_period
from umo.cycle.events import EVENTS_PER_PERIOD, FAULT, FAULT_PREFIX, MOST_WAITING, CommandState, Event, Events
from umo.errors import DriverError, EquipmentFault
from umo.operation.alarms import Alarm, High
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer

WRITES = ("write", "write_many", "reset", "initialize")


class Part(Compound, equipment=True, alarms={"high": Alarm(High("level", 50.0), "too high")}):
    """Equipment with a law, an actuator that expires, an asynchronous one, and a sensor."""

    heater: DigitalActuator
    valve: BinaryActuator[OnOff]
    level: DigitalSensor
    broken = False

    def control(self) -> None:
        if self.broken:
            raise ValueError("it is broken")

    def on_suspend(self) -> None:
        self.heater.write(1.0)


class Plant(Compound):
    timer: DigitalSensor
    parts: list[Part]
    fans: list[DigitalActuator]
    probe: DigitalSensor
    stopped = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.stopped, list(self.fans), "emergency stop", latched=True)
        yield Interlock(lambda: self.probe.read() > 60.0, [self], "too hot")


class Order:
    """What has happened in the periods, in order: "tick", "sent" for a call of a driver that writes, "told"."""

    def __init__(self) -> None:
        self.marks: list[str] = []

    def check(self) -> None:
        """Nothing was sent after anything was told, between two ticks."""
        for period in "\n".join(self.marks).split("tick"):
            each = period.split()
            assert "sent" not in each[each.index("told") :] if "told" in each else True, each


class Box(Scripted):
    def __init__(self, order: Order) -> None:
        super().__init__()
        self.order = order

    def _call(self, segment: str, *arguments: Any) -> Any:
        if segment in WRITES:
            self.order.marks.append("sent")
        return super()._call(segment, *arguments)


class Clock(VirtualTimer):
    def __init__(self, order: Order) -> None:
        super().__init__()
        self.order = order

    def read(self, channel: Any) -> int:
        self.order.marks.append("tick")
        return super().read(channel)


class Spy(logging.Handler):
    def __init__(self, order: Order) -> None:
        super().__init__()
        self.order = order

    def emit(self, record: logging.LogRecord) -> None:
        self.order.marks.append("told")


@contextmanager
def spied(order: Order) -> Iterator[None]:
    """Note each line of the log, and each event that is put into words."""
    take, handler, log = Events._take, Spy(order), logging.getLogger("umo")

    def taken(events: Events, note: Any) -> None:
        order.marks.append("told")
        take(events, note)

    Events._take = taken  # type: ignore[method-assign]
    log.addHandler(handler)
    try:
        yield
    finally:
        Events._take = take  # type: ignore[method-assign]
        log.removeHandler(handler)


def plant(parts: int) -> Plant:
    return Plant(
        timer=timer(),
        parts=[
            Part(heater=actuator(expires="5 ms"), valve=relay(synchronous=False, expires="7 ms"), level=sensor())
            for _ in range(parts)
        ],
        fans=[actuator() for _ in range(3)],
        probe=sensor(on_error="mark"),
    )


async def failing() -> None:
    await next_period()
    raise ValueError("the sequence has failed")


class Rig:
    """The plant with two circuits, and an operator in manual mode or not."""

    def __init__(self, parts: int) -> None:
        self.order, self.m = Order(), plant(parts)
        self.boxes = {"box": Box(self.order), "other": Box(self.order)}
        entries: dict[str, dict[str, Any]] = {"probe": {"driver": "other"}, "parts.0.valve": {"driver": "other"}}
        wiring = wired(self.m, self.boxes["box"], clock=Clock(self.order), entries=entries, other=self.boxes["other"])
        self.connection = connect(self.m, wiring)

    def do(self, what: str, number: int, ann: Operator) -> None:
        """Bring something about."""
        part = self.m.parts[number % len(self.m.parts)]
        if what in ("stopped", "broken"):
            owner: Any = self.m if what == "stopped" else part
            setattr(owner, what, not getattr(owner, what))
        elif what == "drive":
            for each in (*self.m.fans, *(part.heater for part in self.m.parts)):
                each.write(2.0)
            part.valve.write(OnOff.ON)
        elif what == "hot":
            self.boxes["other"].set("probe", 200 if number % 2 else 0)
        elif what == "high":
            self.boxes["box"].set(f"parts.{number % len(self.m.parts)}.level", 150 if number % 2 else 0)
        elif what == "sequence":
            with suppress(EquipmentFault):
                part.cycle.start(failing())
        elif what in self.boxes:
            self.boxes[what].broken = (None, OSError("cut"), TimeoutError("no answer"))[number % 3]
        elif what == "silent":
            ann.alive = not ann.alive
        elif what == "write":
            ann.send("write", "fans.0", 3.0)
        elif what == "mode":
            ann.send("mode", value="manual" if number % 2 else "automatic")
        else:
            ann.send(what, "parts.7" if what == "clear" and number == 3 else "")

    def period(self, causes: list[tuple[str, int]], ann: Operator) -> None:
        """One period, in which some things are brought about."""
        if ann.alive:
            ann.sign()
        bring_about = [partial(self.do, what, number, ann) for what, number in causes]
        for step in (self.m.timer.read, *bring_about, self.m.sample, self.m.control, self.m.update):
            try:
                step()
            except DriverError:
                return


CAUSES = st.tuples(
    st.sampled_from(
        [
            "stopped",
            "broken",
            "drive",
            "drive",
            "hot",
            "high",
            "sequence",
            "box",
            "other",
            "silent",
            "lease",
            "write",
            "mode",
            "clear",
            "acknowledge",
            "give back",
            "acknowledge alarm",
        ]
    ),
    st.integers(0, 5),
)


@settings(max_examples=25, deadline=None)
@given(parts=st.integers(1, 3), periods=st.lists(st.lists(CAUSES, max_size=3), min_size=5, max_size=25))
def test_nothing_is_told_before_the_last_output_of_a_period_is_sent(
    parts: int, periods: list[list[tuple[str, int]]]
) -> None:
    rig = Rig(parts)
    with spied(rig.order), rig.connection:
        rig.connection.machine.observers.append(lambda frame: rig.order.marks.append("told"))
        ann = Operator(rig.m)
        ann.send("lease", seconds=0.5)
        for causes in periods:
            rig.period(causes, ann)
        for part in rig.m.parts:
            part.broken = False
        for box in rig.boxes.values():
            box.broken = None
        rig.order.marks.append("tick")  # the run ends
    rig.order.check()


def test_a_period_that_fails_is_told_after_the_machine_was_reset(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig(1)
    with spied(rig.order), pytest.raises(DriverError), rig.connection:
        rig.m.timer.read()
        rig.m.sample()
        rig.m.stopped = True
        rig.m.update()
        rig.m.timer.read()
        rig.m.sample()
        rig.boxes["box"].broken = OSError("cut")
        rig.order.marks.clear()
        try:
            rig.m.update()
        finally:
            rig.boxes["box"].broken = None
    rig.order.check()
    marks = rig.order.marks
    assert marks.index("told") > max(place for place, mark in enumerate(marks[: marks.index("told")]) if mark == "sent")
    assert "emergency stop: 3 actuators inhibited until acknowledged: fans.0, fans.1 and fans.2" in caplog.text


def test_one_event_tells_what_one_interlock_does_with_a_thousand_actuators() -> None:
    class Valves(Compound):
        timer: DigitalSensor
        valves: list[DigitalActuator]
        stopped = False

        def interlocks(self) -> Iterator[Interlock]:
            yield Interlock(lambda: self.stopped, [self], "emergency stop")

    m = Valves(timer=timer(), valves=[actuator() for _ in range(1000)])
    connection = connect(m, wired(m, Scripted()))
    with connection:
        m.cycle.tell("something that happened before")
        m.stopped = True
        m.timer.read()
        m.sample()
        m.update()
        events = list(connection.machine.events)
        assert [(event.path, event.text) for event in events] == [
            ("", "something that happened before"),
            ("", "emergency stop: 1,000 actuators inhibited: valves.0, valves.1 and 998 others"),
        ]
        assert {each.inhibited for each in m.valves} == {"emergency stop"}


def test_what_several_parts_have_in_common_is_told_at_the_compound_around_them() -> None:
    rig = Rig(2)
    with rig.connection as m:
        for part in m.parts:
            part.heater.write(2.0)
        for _ in range(8):
            m.timer.read()
            m.sample()
            m.update()
        (event,) = rig.connection.machine.events
        assert event.path == ""
        assert event.text.startswith("2 commands expired: not written for 0.005 s, defaults sent: parts.0.heater and")


def test_a_flood_of_events_is_told_in_the_following_periods_and_answers_at_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    events = Events()
    for number in range(50):
        events.add(Event(0.0, "", f"event {number}"), logged=True)
    events.add(Event(0.0, "", "the answer", command=7))
    events.tell()
    texts = [event.text for event in events.recent(100)]
    assert texts == [*(f"event {number}" for number in range(EVENTS_PER_PERIOD)), "the answer"]
    assert len(caplog.records) == EVENTS_PER_PERIOD
    events.tell()
    events.tell()
    assert [record.getMessage() for record in caplog.records] == [f"event {number}" for number in range(50)]
    assert not events.untold


@pytest.mark.parametrize("size", first(2, [1_001, 3_500, 999, 1_000]))
@pytest.mark.parametrize("periods", first(1, [3, 1]))
def test_of_any_number_of_notes_every_answer_is_told_in_its_period_and_nothing_is_lost_without_being_counted(
    caplog: pytest.LogCaptureFixture, size: int, periods: int
) -> None:
    events, told = Events(), list[Event]()

    def tell() -> list[Event]:
        before = events.told
        events.tell()
        told.extend(new := events.recent(events.told - before))
        return new

    for period in range(periods):
        events.add(Event(0.0, "valve", "", "ann", 1 + 2 * period, CommandState.DONE, "write"))
        for number in range(size):
            events.add(partial(Event, 0.0, "zone", f"other {number}"), logged=True)
            events.add(
                partial(Event, 0.0, f"zones.{period}.{number}", FAULT_PREFIX, asked=FAULT), logged=True, needed=True
            )
        events.add(Event(0.0, "valve", "", "ann", 2 + 2 * period, CommandState.DONE, "write"))
        assert [each.command for each in tell() if each.command] == [1 + 2 * period, 2 + 2 * period]
    while events.untold:
        assert len(tell()) <= EVENTS_PER_PERIOD + 1
    faults = [event.path for event in told if event.asked == FAULT]
    assert faults == [f"zones.{period}.{number}" for period in range(periods) for number in range(size)]
    left_out = [int(event.text.split()[0].replace(",", "")) for event in told if "were not stored" in event.text]
    others = sum(event.text.startswith("other") for event in told)
    assert others + sum(left_out) == periods * size
    assert others <= MOST_WAITING + periods * EVENTS_PER_PERIOD
    assert len(caplog.records) == others + len(faults) + len(left_out)


def test_whoever_reads_the_events_finds_what_is_not_told_yet_and_it_is_logged_later(
    caplog: pytest.LogCaptureFixture,
) -> None:
    events = Events()
    events.add(lambda: Event(1.0, "ram", "inhibited"), logged=True)
    assert (events.told, len(events), events.number, events[-1].path) == (0, 1, 1, "ram")
    assert (caplog.records, events.untold) == ([], True)
    events.tell()
    assert [record.getMessage() for record in caplog.records] == ["ram inhibited"]
    assert not events.untold
