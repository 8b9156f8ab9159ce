"""Shrinks a run in closed loop: it finds the fewest faults, options and commands with which a station and its plant
still give the same error.

For each trial the station runs again with its plant, in virtual time, in a separate process. Clients always send
heartbeats.
"""

from __future__ import annotations

import json
import os
import select
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from umo.cycle.connect import connect
from umo.cycle.machine import ConnectedMachine
from umo.cycle.run import drive
from umo.cycle.stopping import TimeLimit
from umo.errors import text_of
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.process.job import Job, Plan
from umo.process.reset import DEATH_TIMEOUT
from umo.recording.replay.code_given import NOTHING_GIVEN, CodeGiven, job_of
from umo.recording.replay.shrinking import ReplayedError
from umo.recording.replay.tape import NotReplayable, Tape, events_of
from umo.system.processes import Child

MORE = 1.25
"""Multiple of the recorded duration after which a trial ends. It is greater than 1 because the error may come later
than in the recording."""
CHILD_TIMEOUT = 120.0
"""Longest wall-clock time in s of a trial."""
MAX_LEVELS = 50
"""Largest depth of nested lists and tables in a command. The command becomes Python code in a generated test."""
FAULT = "fault"
"""The option that injects faults."""


@dataclass(frozen=True)
class Trial:
    """A run of a station with its plant in virtual time."""

    station: str
    wiring: Any = None
    faults: Sequence[str] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    commands: Sequence[tuple[int, Mapping[str, Any]]] = ()
    """Commands of clients, each with the number of the tick at which it is taken."""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    """Facts that are never left out: `seed`, `fault_seed`, `kept`, `alarms`, `manual`, `until` in s."""

    def ending(self) -> ReplayedError | None:
        """Return the error that ends the trial, or None if there is none. The trial runs in a separate process. A trial
        that does not reach its end has no error."""
        ready, told = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                os.close(ready)
                os.write(told, json.dumps(self._told()).encode())
            finally:  # whatever happens, it does not go on as the process that it was forked from
                os._exit(0)
        os.close(told)
        try:
            text = _received(ready)
        finally:
            Child(child).end(DEATH_TIMEOUT)
            os.close(ready)
        found = json.loads(text or "null")
        if isinstance(found, str):
            raise NotReplayable(found)
        return None if found is None else ReplayedError(*found)

    def _told(self) -> list[str] | str | None:
        """Return the result of `run`, or the reason why there is no run."""
        try:
            return self.run()
        except BaseException as error:
            return text_of(error)

    def run(self) -> list[str] | None:
        """Run the trial in this process, and return the class, place and text of the error."""
        fixed = self.fixed
        options = dict(self.options) | ({FAULT: list(self.faults)} if self.faults else {})
        if self.faults and fixed.get("fault_seed") is not None:
            options["fault_seed"] = fixed["fault_seed"]
        job = Job(self.station, wiring=self.wiring, options=options, manual=bool(fixed.get("manual")))
        plan = Plan(job)
        if plan.wired.hardware or plan.wired.timer_wire is None:
            raise NotReplayable("the wiring of the recording has devices: --closed needs a wiring with only a plant")
        connection: connect[Any] = connect(plan.machine, replace(plan.wired, paced=False))
        connection.kept, connection.states = fixed.get("kept", {}), fixed
        connection.seed = fixed.get("seed", 0)
        connection.pause = lambda seconds: None
        try:
            with connection as m:
                machine = connection.machine
                if "until" in fixed:
                    machine.observers.append(TimeLimit(fixed["until"], connection.stop))
                mode = Mode.MANUAL if job.manual else Mode.AUTOMATIC
                machine.attach(ClientControl(_Inbox(machine, self.commands), _Levels(), mode, _now))
                drive(m, plan.application)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            if not connection.started:
                raise
            found = ReplayedError.of(error)
            return [found.kind, found.place, found.text]
        return None

    @property
    def count(self) -> int:
        """Number of faults, options and commands."""
        return len(self.faults) + len(self.options) + len(self.commands)


def recorded_trial(tape: Tape, given: CodeGiven = NOTHING_GIVEN) -> Trial:
    """Return the run of a recording as a trial of the code `given`. Raises NotReplayable if the code is not a station,
    or if the recorded wiring has drivers that no wiring of the station has."""
    job, about = tape.job, tape.layout.about
    made = job_of(job, given, runs=True)
    if made.station is None:
        raise NotReplayable("--closed can run a station, but not a program")
    initial = dict(about.get("initial", {}))
    commands = [(tick, found) for tick, data in _taken(tape) if (found := _content(tick, data)) is not None]
    ends = [event.time for event in events_of(tape) if event.is_end]
    fixed = {
        "seed": initial.get("seed", 0), "fault_seed": job.get("fault_seed"), "kept": initial.get("kept", {}),
        "alarms": initial.get("alarms", {}), "manual": bool(job.get("manual")),
    }  # fmt: skip
    if ends:
        fixed["until"] = MORE * ends[-1] + 1.0
    faults = list(about.get("injected_faults", []))
    return Trial(made.station, made.wiring, faults, made.options, commands, fixed)


class ClosedShrinking:
    """The search for the fewest faults, options and commands. `go_on` is called before each trial, and returns False to
    end the search."""

    def __init__(self, trial: Trial) -> None:
        """Raise NotReplayable if the trial ends without an error."""
        self.trial, self.trials = trial, 1
        trial_error = trial.ending()
        if trial_error is None:
            raise NotReplayable("in closed loop with its plant the run ends without an error: nothing to shrink to")
        self.ending = trial_error

    def run(self, go_on: Callable[[], bool] = lambda: True) -> Trial:
        """Leave out everything that the error does not need."""
        for name in ("commands", "faults", "options"):
            self._fewest(name, go_on)
        return self.trial

    def _fewest(self, name: str, go_on: Callable[[], bool]) -> None:
        """Leave out as many items as possible (delta debugging). The pieces that are left out begin with the size of
        all items; their size is halved down to single items, until no single item can be left out."""
        size = max(len(getattr(self.trial, name)), 1)
        while True:
            before = len(getattr(self.trial, name))
            at = before
            while at > 0:
                if not go_on():
                    return
                at = max(at - size, 0)
                self._try(name, at, at + size)
            if size == 1 and len(getattr(self.trial, name)) == before:
                return
            size = max(size // 2, 1)

    def _try(self, name: str, start: int, stop: int) -> None:
        items: Any = getattr(self.trial, name)
        if isinstance(items, Mapping):
            rows = list(items.items())
            rest: Any = dict(rows[:start] + rows[stop:])
        else:
            rest = [*items[:start], *items[stop:]]
        trial = replace(self.trial, **{name: rest})
        self.trials += 1
        if self.ending.is_same(trial.ending()):
            self.trial = trial


class _Inbox:
    """Delivers the commands at their ticks (`umo.operation.commands.client_commands.Inbox`)."""

    def __init__(self, machine: ConnectedMachine, commands: Sequence[tuple[int, Mapping[str, Any]]]) -> None:
        self._clock, self._commands = machine.clock, commands
        self.taken = self.dropped = 0

    def get(self) -> ClientCommand | None:
        while self.taken < len(self._commands) and self._commands[self.taken][0] <= self._clock.number:
            _, content = self._commands[self.taken]
            self.taken += 1
            with suppress(ValueError, TypeError, AttributeError):
                return ClientCommand.parse(self.taken, json.dumps(content).encode())
            self.dropped += 1
        return None


class _Levels:
    """The levels of clients that are always alive and never request a stop
    (`umo.operation.commands.client_commands.Levels`)."""

    asked: Sequence[int] = (0,)
    stop: tuple[int, str] | None = None

    def signed(self, path: str, lease: int) -> float:
        return _now()


def _now() -> float:
    return 1.0


def _taken(tape: Tape) -> Iterator[tuple[int, bytes]]:
    """Yield the commands, each with the number of the tick at which it was taken. If that period is lost, the number is
    that of the next period."""
    for block in tape.blocks():
        numbers = block.frames["number"].tolist()
        first = int(block.frames["sequence"][0]) // 2 - 1
        for each in block.commands:
            yield numbers[max(each.period - first, 0)], each.data


def _content(tick: int, data: bytes) -> Mapping[str, Any] | None:
    """Return the content of a command that was taken at a tick, or None if it was not a command. Raises NotReplayable
    for a command that is nested too deeply to be written into a test."""
    try:
        found = json.loads(data)
        level = [found]
        for _ in range(MAX_LEVELS):
            level = [inner for each in level for inner in _within(each)]
        if level:
            raise RecursionError
    except RecursionError:
        raise NotReplayable(
            f"the command of period {tick} has more than {MAX_LEVELS} levels of lists or tables"
        ) from None
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def _within(found: object) -> Collection[Any]:
    if isinstance(found, dict):
        return found.values()
    return found if isinstance(found, list) else ()


def _received(ready: int) -> bytes:
    """Return all bytes received until the other end is closed or the time is over."""
    text, until = b"", time.monotonic() + CHILD_TIMEOUT
    while select.select([ready], [], [], max(until - time.monotonic(), 0.0))[0]:
        data = os.read(ready, 65536)
        if not data:
            return text
        text += data
    return b""
