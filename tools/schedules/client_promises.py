"""What must be so at the end of a world with clients, beside what must be so at the end of each (`promises`)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tools.schedules.clients import FACE_RATE, FACES, LEASE_SECONDS, NOT_DONE, RECORDER, RUN_IS_OVER, WRITTEN
from tools.schedules.faults import What
from tools.schedules.machine import PERIOD
from tools.schedules.promises import is_manual
from tools.schedules.scheduler import CLIENTS, COMMANDERS, LEVELLING, Scheduler
from tools.schedules.shared import DEVICES, START
from umo.cycle.stage import Stage
from umo.errors import FramesError
from umo.operation.commands.client_commands import DEAD_MAN_REASON, NOT_RENEWED
from umo.operation.commands.verbs import GIVE_BACK, TAKE_LEASE, VERBS
from umo.recording.recording import Recording

LINE = re.compile(r"(\S+) (\w+): (.*) -> (-?\d+)")
EVENT = re.compile(r"event (.+?) (none|begun|done|refused|failed|cancelled) (.*)")
EXPIRED = re.compile(rf"the lease of (.+?) has ended, because it {NOT_RENEWED}")
ANSWER = re.compile(r"told ([a-z ]+) (done|refused)")
OWN_REFUSAL = re.compile("another client has locked|the queue of commands is full|the machine has not answered")
"""Refusals of a client's own."""
FACE_NAMES = ("panel", f"{FACES} (panel)")
"""The names of a face in the events of the machine: by itself, and with its user."""
BESIDE = 0.04
"""Time in s beside those that are promised: looks, and the steps of all processes."""
GUARDIANS = ("guardian", "standby")
MAY_EXIT_WITH = (0, RUN_IS_OVER, NOT_DONE)


@dataclass(frozen=True)
class Line:
    """A step of a process. `at`: time in s since the begin of the world."""

    at: float
    who: str
    text: str
    answer: int


@dataclass(frozen=True)
class Told:
    """An event of the machine, when it is told: whose command, its state, and the command; or what has happened."""

    at: float
    who: str
    state: str
    what: str

    @classmethod
    def of(cls, line: Line) -> Told | None:
        match = EVENT.match(line.text)
        return cls(line.at, _client(match[1]), match[2], match[3]) if match else None

    @property
    def expired(self) -> str:
        """The client whose lease has ended by itself; "": none."""
        match = EXPIRED.match(self.what)
        return _client(match[1]) if match else ""

    @property
    def is_command(self) -> bool:
        """Whether a command of a client was carried out. (A request to stop is none, and has no words.)"""
        return self.state == "done" and self.who != "machine" and bool(self.what)

    @property
    def takes(self) -> bool:
        return self.is_command and self.what.startswith(TAKE_LEASE.name)

    @property
    def gives_back(self) -> bool:
        return self.is_command and self.what.startswith(GIVE_BACK.name)


def _client(name: str) -> str:
    return FACES if name in FACE_NAMES else name


class ClientsEnd:
    """The end of a world with clients. `recording`: the file of the recorder."""

    def __init__(self, scheduler: Scheduler, recording: Path) -> None:
        self.scheduler, self.recording = scheduler, recording
        found = (LINE.match(line) for line in scheduler.lines)
        self.lines = [Line(float(each[1]) * 1e-3, each[2], each[3], int(each[4])) for each in found if each]
        self.processes = {process.name: process for process in scheduler.processes}

    def lines_of(self, begin: str) -> list[Line]:
        """Those whose texts begin so."""
        return [line for line in self.lines if line.text.startswith(begin)]

    @cached_property
    def events(self) -> list[tuple[Told, str]]:
        """The events of the machine, each with the client that had the lease before it; "": none."""
        found, holder = list[tuple[Told, str]](), ""
        for each in filter(None, map(Told.of, self.lines_of("event "))):
            found.append((each, holder))
            if each.takes:
                holder = each.who
            elif each.expired or each.gives_back:
                holder = ""
        return found

    @cached_property
    def exits(self) -> dict[str, int]:
        """The status of each process that has ended by itself."""
        return {line.who: int(line.text.removeprefix("exit ")) for line in self.lines_of("exit ")}

    @cached_property
    def hit(self) -> set[str]:
        """The processes and devices that a fault has come to."""
        return {fault.who for fault in self.scheduler.came}

    @property
    def slowed(self) -> set[str]:
        """Those that were stopped or held up."""
        return {fault.who for fault in self.scheduler.came if fault.what in (What.STOP, What.HOLD)}

    @property
    def has_only_kills(self) -> bool:
        """Whether nothing has happened but that clients were killed."""
        return self.hit <= {*CLIENTS} and {fault.what for fault in self.scheduler.came} <= {What.KILL}


def only_the_holder_commands(end: ClientsEnd) -> Iterator[str]:
    """A command that needs the lease is carried out for its holder alone. A client gets the lease when nobody has it,
    or where it takes it over; it loses it by itself when it was not able to renew it."""
    for each, holder in end.events:
        if each.expired and each.expired != holder:
            yield f"the lease of {each.expired} has expired, and {holder or 'nobody'} had it"
        elif each.expired and end.has_only_kills and holder not in end.hit:
            yield f"the lease of {holder} has expired, and nothing had happened to it"
        elif each.takes and holder not in ("", each.who) and "over=True" not in each.what:
            yield f"{each.who} has got the lease while {holder} had it"
        elif each.is_command and not each.takes and each.who != holder:
            yield f"carried out for {each.who}, while {holder or 'nobody'} had the lease: {each.what}"


def answers_are_so(end: ClientsEnd) -> Iterator[str]:
    """What a client is told as done, or as refused by the machine, the machine has told before; and a client to which
    nothing has happened is not refused as one that is dead. (A face is refused the lease where its user is refused a
    command.)"""
    told: Counter[tuple[str, str]] = Counter()
    for line in end.lines:
        if (event := Told.of(line)) and event.state in ("done", "refused", "failed", "cancelled"):
            told[event.who, _verb(event.what) if event.state == "done" else "refused"] += 1
        elif (answer := ANSWER.match(line.text)) and not OWN_REFUSAL.search(line.text):
            key = line.who, answer[1] if answer[2] == "done" else "refused"
            told[key] -= 1
            if told[key] < 0:
                yield f"{line.who} is told what the machine has not told: {answer[1]} {answer[2]}"
            if DEAD_MAN_REASON in line.text and not end.hit & {line.who, "control"}:
                yield f"{line.who} lives, and it is refused as one that is dead: {line.text}"


def _verb(text: str) -> str:
    return next((name for name in VERBS if text.startswith(name)), "")


def holds_end(end: ClientsEnd) -> Iterator[str]:
    """What a client has written goes to its default, or to what another one writes, when the client has lost its lease;
    and it loses that when it is dead or stopped, as nobody renews it."""
    if end.hit & {"control", "guardian", "standby", "worker", *DEVICES}:  # the table of ends says when
        return
    names = {level: name for name, level in WRITTEN.items()}
    for begin, until, level in _spans(end.scheduler):
        for why, lost, within in _losses(end, names[level]) if level in names else ():
            limit = max(begin, lost) + round((within + 3 * PERIOD) * 1e9)
            if begin < lost and until > limit:
                yield f"the output of {names[level]} is driven {(until - lost) / 1e6:.0f} ms after it {why}"


def _losses(end: ClientsEnd, name: str) -> Iterator[tuple[str, int, float]]:
    """How and when, in ns, a client has lost what it may do; and the time in s from then to the end of what it does."""
    if name in end.processes and (lost := end.processes[name].lost_at):
        yield "was lost", lost, LEASE_SECONDS + BESIDE
    for each, holder in end.events:
        if holder == name and (each.expired or each.gives_back or (each.takes and each.who != name)):
            yield "has lost the lease", START + round(each.at * 1e9), 0.0


def _spans(scheduler: Scheduler) -> Iterator[tuple[int, int, int]]:
    """From when, to when the first device had which level, ns."""
    begin, level = START, 0
    for move in scheduler.memory.moves:
        if move.device == 0 and move.move in LEVELLING and move.raw != level:
            yield begin, move.time, level
            begin, level = move.time, move.raw
    yield begin, scheduler.clock, level


def clients_end_well(end: ClientsEnd) -> Iterator[str]:
    """No client ends by an exception. Where nothing happens but that clients are killed, all others do what they were
    to do; and the run ends well, if none has left it in manual mode."""
    for name in CLIENTS:
        if (status := end.exits.get(name, 0)) not in MAY_EXIT_WITH:
            yield f"{name} has ended with status {status}"
        if end.has_only_kills and name not in end.hit and end.exits.get(name) != 0:
            yield f"nothing has happened to {name}, and it ended with {end.exits.get(name)}"
    if end.has_only_kills and not is_manual(end.scheduler) and end.exits.get("control") != 0:
        yield f"nothing has happened but to clients, and the run ended with {end.exits.get('control')}"


def faces_learn_of_the_end(end: ClientsEnd) -> Iterator[str]:
    """The faces are told the end of the run when the control process has ended. (A client that is stopped in the middle
    of a command keeps others from theirs for a second; the faces of a world have no thread for these.)"""
    faces, control = end.processes.get(FACES), end.processes.get("control")
    if faces is None or control is None or not control.is_dead or FACES in end.hit or end.slowed & {*COMMANDERS}:
        return
    told = [line.at for line in end.lines_of("told end") if line.who == FACES]
    if not any(line.who == FACES for line in end.lines_of("told begin")):
        return
    limit = (control.ended_at - START) * 1e-9 + 1 / FACE_RATE + BESIDE
    if not told or told[0] > limit:
        when = f"at {told[0]:.3f} s" if told else "never"
        yield f"the faces are told the end {when}, and by {limit:.3f} s the control process was dead"


def recording_is_whole(end: ClientsEnd) -> Iterator[str]:
    """A recorder to which nothing happens records all periods; a recording that is told as complete is so."""
    published = len({line.text for line in end.lines_of("publish ")})
    control, recorder = end.processes.get("control"), end.processes.get(RECORDER)
    by_itself = control is not None and control.ended_by == "exit"
    ended = recorder is not None and recorder.ended_by == "exit"
    try:
        with Recording(end.recording) as recording:
            periods, complete, damage = recording.periods, recording.complete, recording.damage
    except (FramesError, OSError) as error:
        if ended and published > 1:
            yield f"nothing was recorded of {published} periods: {error}"
        return
    least = published if by_itself else published - 1  # killed at the last of them
    if ended and damage:
        yield f"the recording is damaged: {damage[0]}"
    if (ended or complete) and not least <= periods <= published:
        yield f"{periods} periods of {published} are recorded{', and it is told as complete' if complete else ''}"
    if ended and by_itself and not complete:
        yield "the recording of a run that has ended is not complete"


def service_is_told_truly(end: ClientsEnd) -> Iterator[str]:
    """READY comes when the machine runs; a sign of life after a new one of the control process; no process tells
    anything after STOPPING, which comes before the outcome. (Who takes over tells READY and STOPPING once more.)"""
    is_read = "starter" not in end.hit  # the starter reads what the manager is told
    running, beats, passed_on, stopping = False, 0, -1, set[str]()
    seen: dict[str, int] = {}
    """The signs of life that there were at the last step of each process: what it does next, it has decided then."""
    for line in end.lines:
        told = line.text.removeprefix("service ") if line.text.startswith("service ") else ""
        if line.who == "control" and line.text == f"enter {Stage.RUNNING}":
            running = True
        elif line.who == "control" and line.text == "beat":
            beats += 1
        elif told and not running and told != "STOPPING=1":
            yield f"{line.who} tells {told} before the machine runs"
        elif told and line.who in stopping:
            yield f"{line.who} tells {told} after STOPPING"
        elif told == "STOPPING=1" and line.answer:
            stopping.add(line.who)
        elif told == "WATCHDOG=1" and line.answer:
            if (known := seen.get(line.who, 0)) <= passed_on:
                yield f"{line.who} tells {told} without a new sign of life"
            passed_on = known
        elif line.text.startswith("send ended") and line.who in GUARDIANS and running and is_read and not stopping:
            yield "the outcome is told, and the service manager was not told of the stop"
        seen[line.who] = beats


CHECKS = (
    only_the_holder_commands, answers_are_so, holds_end, clients_end_well, faces_learn_of_the_end, recording_is_whole,
    service_is_told_truly,
)  # fmt: skip


def broken(end: ClientsEnd) -> list[str]:
    """The promises that are broken, in words."""
    return [text for check in CHECKS for text in check(end)]
