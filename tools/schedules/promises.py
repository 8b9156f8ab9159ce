"""What must be so at the end of each world, whatever its schedule."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise

from tools.schedules.due import Due
from tools.schedules.ends import BY_KEY
from tools.schedules.faults import What
from tools.schedules.scheduler import RESETTING, Process, Scheduler, kind_of
from tools.schedules.shared import DEVICES, START, Head, Move, Moved
from umo.exit_status import ExitStatus
from umo.process.outcome import Outcome
from umo.system.device_record import Ended

FOLLOWERS = ("standby", "reserve")
"""Those that take the place of a guardian."""
DRIVES = re.compile(r"\w+: d\d WRITE [1-9]")
ENDS_RUN = re.compile(r"\S+ (\w+): (?:conclude|send ended|note_told) ")
MODE = re.compile(r": event .+ done mode (\w+)")
OUTPUTS = {"d1": "motor", "d2": "heater"}
"""The path of the output of each device."""


@dataclass
class End:
    """The end of a world."""

    scheduler: Scheduler
    outcome: Outcome | None
    """What the starter got."""
    records: list[Ended]
    """The devices that stand stopped."""

    @property
    def driven(self) -> list[str]:
        """The devices that are not at their defaults."""
        return self.scheduler.memory.driven


ANSWERED = 500_000_000
"""ns for which a device has to answer before the end for its output to be at its default; two timeouts of the other one
are less (docs/howto-stop-safely.md)."""


def broken(end: End) -> list[str]:
    """The promises that are broken, in words."""
    return [text for check in CHECKS for text in check(end)]


def at_defaults(end: End) -> Iterator[str]:
    """Every output is at its default if any process was left that can reset, and its device answered in the end."""
    told = end.scheduler.memory.head[Head.TOLD] or end.scheduler.clock
    left = end.scheduler.able_at_last_fault
    for device in end.driven:
        able = left & ({*RESETTING} if device == "d1" else {*RESETTING, "worker"})
        answers = end.scheduler.answers_from[device]
        if able and (answers == START or answers + ANSWERED < told):
            yield f"{device} is driven at the end; left at the last fault: {', '.join(sorted(able))}"


def told_truly(end: End) -> Iterator[str]:
    """What was told is so: who reads it need not look at the machine."""
    outcome, driven = end.outcome, end.driven
    standing = {record.device.removeprefix("board "): record.state for record in end.records}
    if outcome is not None:
        if driven and not outcome.unsafe:
            yield f"told as safe, and {', '.join(driven)} is driven"
        for device in driven:
            named = OUTPUTS[device] in outcome.unreached or outcome.status == ExitStatus.UNREACHED  # of all
            if outcome.unsafe and not named:
                yield f"{device} is driven, and not among what was not reached"
        if outcome.failure is None and standing:
            yield f"told as a good end, and there are records: {standing}"
        if outcome.unsafe and not standing:
            yield "told as an end that must be acknowledged, and there is no record"
        if outcome.unkept and end.scheduler.schedule.is_gentle_to("keeper"):
            yield f"nobody was kept from keeping values, and told is: {outcome.unkept}"
    for device in driven:
        if standing.get(device) not in ("running", "stopped"):
            yield f"{device} is driven, and its record is {standing.get(device)}"


def one_writer(end: End) -> Iterator[str]:
    """While one process resets a device, no other resets it, and control drives it no more."""
    processes = end.scheduler.processes
    for number, device in enumerate(DEVICES):
        moves = [move for move in end.scheduler.memory.moves if move.device == number]
        resets = [move for move in moves if move.move is Move.RESET and _resets(processes[move.slot])]
        spans = {slot: (_of(resets, slot)[0].time, _of(resets, slot)[-1].time) for slot in {m.slot for m in resets}}
        for one in spans:
            for other in spans:
                if one < other and spans[one][0] < spans[other][1] and spans[other][0] < spans[one][1]:
                    yield f"{processes[one].name} and {processes[other].name} reset {device} at one time"
        for move in moves:
            if resets and move.move is Move.WRITE and move.time > resets[0].time and move.raw:
                yield f"{processes[move.slot].name} writes to {device} after its reset has begun"


def one_guardian(end: End) -> Iterator[str]:
    """Who ends the run is the only one who does: whoever was guardian before does so no more."""
    found = [match[1] for line in end.scheduler.lines if (match := ENDS_RUN.match(line))]
    turns = [name for name, _ in groupby(found)]
    for number, (before, name) in enumerate(pairwise(turns)):
        if name == "guardian" or name in turns[:number]:
            yield f"{name} goes on to end the run after {before} has taken its place"


def _resets(process: Process) -> bool:
    return kind_of(process.name) not in ("control", "worker")


def _of(moves: list[Moved], slot: int) -> list[Moved]:
    return [move for move in moves if move.slot == slot]


def ends_well(end: End) -> Iterator[str]:
    """Without a fault no run fails, in whatever order its processes go on."""
    outcome = end.outcome
    if end.scheduler.schedule.faults or outcome is None:
        return
    if outcome.failure is not None or outcome.unsafe or outcome.stopped_by is not None or outcome.unkept:
        why = outcome.failure.message if outcome.failure else outcome.unkept or f"by {outcome.stopped_by}"
        yield f"a run without a fault did not end well: {why}"
    lines = [line.partition(" ")[2] for line in end.scheduler.lines]
    if sum(": note_told " in line for line in lines) != 1:
        yield "the end of a run without a fault was not told once"


def followers_come_first(end: End) -> Iterator[str]:
    """Nothing is driven before both are there who follow the guardian."""
    if any(fault.what is not What.HOLD for fault in end.scheduler.schedule.faults):
        return
    lines = [line.partition(" ")[2] for line in end.scheduler.lines]
    driven = next((number for number, line in enumerate(lines) if DRIVES.match(line)), 0)
    for name in FOLLOWERS:
        if driven and not any(line.startswith(f"{name}: begin ") for line in lines[:driven]):
            yield f"an output was driven before there was a {name}"


def lost_are_replaced(end: End) -> Iterator[str]:
    """In the place of a standby guardian, reset process or worker that is lost while the machine runs there is another
    one."""
    schedule = end.scheduler.schedule
    if len(schedule.faults) != 1 or not (schedule.long and end.scheduler.driven_at_last_fault):
        return
    (fault,) = schedule.faults
    names = [process.name for process in end.scheduler.processes]
    if fault.what in (What.KILL, What.STOP) and fault.who in (*FOLLOWERS, "worker") and f"{fault.who}2" not in names:
        yield f"in the place of {fault.who} there was no other one"


def all_end(end: End) -> Iterator[str]:
    """Every process ends within a limit, unless it is stopped, or a worker that waits for one which is; nobody had to
    ask for the end of a machine that could end by itself."""
    scheduler = end.scheduler
    left = [process for process in scheduler.living() if not process.is_stopped]
    if left and not scheduler.waits_for_stopped:
        waits = "; ".join(f"{process.name} before {process.slot.text!r}" for process in left)
        yield f"{scheduler.why_over or 'nobody can go on'}: {waits}"
    elif scheduler.why_over:
        yield scheduler.why_over
    able = scheduler.able_at_last_fault & {*RESETTING}
    if scheduler.driven_when_asked and able and not is_manual(scheduler):
        yield f"it was driven until it was asked to stop; left at the last fault: {', '.join(sorted(able))}"
    for process in scheduler.processes:
        if process.ended_by == "crash":
            yield f"{process.name} has crashed"


def is_manual(scheduler: Scheduler) -> bool:
    """Whether a client has left the machine in manual mode, in which nothing ends by itself."""
    modes = [match[1] for line in scheduler.lines if (match := MODE.search(line))]
    return modes[-1:] == ["manual"]


def nobody_is_left(end: End) -> Iterator[str]:
    """When the end is told, no process is left that was stopped: it would hold the devices of the next run, whose start
    then names the process. Two cases are permitted. A starter that was itself killed or stopped ends nobody. And nobody
    knows a process that was stopped after its fork and before it took its lock, if the guardian that forked it was
    killed or stopped before it could tell the starter the pid."""
    starter = end.scheduler.processes[0]
    if starter.ended_by == "fault" or starter.is_stopped:
        return
    lines = [line.partition(" ")[2] for line in end.scheduler.lines]
    left = [process.name for process in end.scheduler.living() if process is not starter]
    known = [name for name in left if any(line.startswith(f"{name}: lock {kind_of(name)} ") for line in lines)]
    if known and any(": note_told " in line for line in lines):
        yield f"left behind: {', '.join(known)}"


def starter_is_told(end: End) -> Iterator[str]:
    """The starter gets an outcome whenever it lives. (A signal ends it before it has a handler.)"""
    starter = end.scheduler.processes[0]
    if end.outcome is None and starter.ended_by not in ("fault", "signal") and not starter.is_stopped:
        yield "the starter got no outcome"


def in_time(end: End) -> Iterator[str]:
    """Each output is at its default within the time that the table of docs/howto-stop-safely.md says."""
    due = Due(end.scheduler)
    if due.took > due.limit:
        yield f"the last output was at its default after {due.took:.3f} ms, limit {due.limit:.3f} ms: {due}"


def told_as_said(end: End) -> Iterator[str]:
    """Status, and whether it is to be acknowledged, are those of the table, where the machine was driven to the last
    fault and one row says how it ended."""
    due, outcome, faults = Due(end.scheduler), end.outcome, {fault.what for fault in end.scheduler.schedule.faults}
    if due.delays or outcome is None or not end.scheduler.driven_at_last_fault:
        return
    if not faults <= {What.KILL, What.STOP, What.ASK} or end.scheduler.was_asked:
        return
    if faults - {What.KILL} and not end.scheduler.schedule.long:  # the application may end before that is noticed
        return
    row = BY_KEY[due.rows[-1]]
    if outcome.status not in (row.statuses or {outcome.status}):
        yield f"status {outcome.status}, and not {row.status}: {due}"
    if outcome.unsafe != (row.acknowledged == "yes"):
        yield f"must{'' if outcome.unsafe else ' not'} be acknowledged: {due}"


CHECKS = (
    at_defaults, told_truly, one_writer, one_guardian, ends_well, followers_come_first, lost_are_replaced, all_end,
    nobody_is_left, starter_is_told, in_time, told_as_said,
)  # fmt: skip


def outcome_of(text: bytes) -> Outcome | None:
    return Outcome.load(json.loads(text)) if text else None
