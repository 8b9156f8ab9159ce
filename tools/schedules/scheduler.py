"""The scheduler of a world: one process goes on at a time; it has the clock, and carries out faults and signals.

Who goes on, of those that can, is decided by the seed: 0 takes the one that has waited longest; others give each
process a priority, and take it away from the one that runs at `CHANGES` steps (as in Burckhardt et al., A randomized
scheduler with probabilistic guarantees of finding bugs, ASPLOS 2010). Where nobody can go on, the clock moves to the
first time that somebody waits for.
"""

from __future__ import annotations

import errno
import hashlib
import os
import random
import select
import signal
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf

from tools.schedules.faults import Fault, Schedule, What
from tools.schedules.shared import (
    DEVICES,
    DYING,
    LATEST,
    START,
    WAKES_BITS,
    Cell,
    Effect,
    Head,
    Memory,
    Move,
    Slot,
    Wakes,
)
from umo.cycle.stage import Stage

STEP = 1000
"""ns that a step takes."""
CHANGES = 3
CHANGED_WITHIN = 400
"""Steps in which the priorities change."""
MAX_STEPS = 100_000
LIMIT = 60_000_000_000
"""ns after the last fault by which all has ended: more than every limit of the code."""
ASKED_AFTER = 38_000_000_000
"""ns after the last fault at which somebody asks a run to stop that goes on."""
ASKED_SOON = 5_000_000_000
"""The same where no process is left that could end it, in ns."""
ALONE = 10_000_000_000
"""ns after the last fault from which workers are not waited for that wait for a process that is stopped: nobody else
is left who could end their wait."""
RESETTING = ("guardian", "standby", "reserve", "control")
"""The processes each of which can reset the machine."""
CLIENTS = ("operator", "supervisor", "faces", "recorder")
COMMANDERS = CLIENTS[:2]
"""The programs of a world with clients (`tools.schedules.clients`), and those that can be asked to stop the machine."""
LEVELLING = (Move.INITIALIZE, Move.RESET, Move.WRITE)
"""What sets the level of an output."""
SIGNALS = {
    What.KILL: signal.SIGKILL,
    What.STOP: signal.SIGSTOP,
    What.CONTINUE: signal.SIGCONT,
    What.ASK: signal.SIGTERM,
}
TURN_TIMEOUT = 120
"""s of real time for one step on a busy computer."""
TURN_LOOK = 2
"""s of real time from one look at a process that does not come to its gate to the next."""


class WorldError(Exception):
    """A process does not come to its gate: the schedule says nothing."""


class State(StrEnum):
    """What a process can do."""

    ABLE = "able"
    STOPPED = "stopped"
    KILLED = "killed"
    """By a fault."""
    ENDED = "ended"
    """In another way."""


@dataclass
class Process:
    """A process as the scheduler knows it."""

    slot: Slot
    pid: int
    file: int
    """Its descriptor (pidfd_open(2))."""
    priority: float = 0.0
    name: str = ""
    is_dead: bool = False
    is_stopped: bool = False
    ended_by: str = ""
    """How it ended: "fault", "signal" of another process, "exit", "crash"; "": it lives."""
    ended_at: int = 0
    lost_at: int = 0
    """Times in ns at which it ended, and at which it ended or was stopped; 0: it goes on."""
    held_until: int = 0
    turn: int = 0
    """The step in which it ran last."""
    pending: deque[int] = field(default_factory=deque)
    """Signals that it has not got yet."""
    dies_with: tuple[int, int] | None = None
    """The slot of a process at whose end it is sent a signal, and which."""
    alarm: int = 0
    interval: int = 0
    """Time in ns at which it is sent SIGALRM, 0: never; and then after each of these."""
    seen: int = 0
    """The number of events when it began to wait."""
    fork_fails: bool = False
    """Whether its next fork fails."""
    forks_fail_until: int = 0
    """Time in ns until which each of its forks fails."""

    @property
    def gates(self) -> int:
        return self.slot.cells[Cell.GATES]

    @property
    def until(self) -> int:
        return self.slot.cells[Cell.UNTIL]

    @property
    def state(self) -> State:
        if self.is_dead:
            return State.KILLED if self.ended_by == "fault" else State.ENDED
        return State.STOPPED if self.is_stopped else State.ABLE


class Scheduler:
    """Plays one schedule."""

    def __init__(self, memory: Memory, schedule: Schedule) -> None:
        self.memory, self.schedule = memory, schedule
        self._random = random.Random(schedule.seed)
        self._changes = {self._random.randrange(CHANGED_WITHIN) for _ in range(CHANGES)} if schedule.seed else set()
        self.processes: list[Process] = []
        self.steps = 0
        self.lines: list[str] = []
        """The trace: a line for each step, signal and fault."""
        self._events = 0
        """Number of events of all kinds."""
        self._last = {1 << bit: 0 for bit in range(WAKES_BITS)}
        """The number of the last event of each kind."""
        self._waiting: list[Fault] = list(schedule.faults)
        self._due: list[tuple[int, Fault]] = []
        """Faults whose time is known."""
        self._ends: list[tuple[int, Fault]] = []
        """Faults that last until a time."""
        self.came: list[Fault] = []
        """Faults that have come: the gate of another one may never be reached."""
        self.last_fault = START
        """Time in ns of the last one."""
        self.at_last_fault: dict[str, State] = {}
        """The processes that there were then, each with its state."""
        self.driven_at_last_fault = False
        """Whether an output was driven then, and control had not left its loop."""
        self.held_until = START
        """Time in ns until which the last process is held up."""
        self.left_at = 0
        """Time in ns at which control left its loop; 0: it has not."""
        self.is_concluding = self.was_concluding = False
        """Whether a guardian has begun to reset; and whether one had at the last fault."""
        self.was_asked = False
        """Whether the machine had to be asked to stop, long after the last fault."""
        self.driven_when_asked: list[str] = []
        """The devices whose outputs were not at their defaults then."""
        self.why_over = ""
        """Why a world was ended before its processes had: "" where they had."""
        self._disk_is_full = False
        self.answers_from = dict.fromkeys(DEVICES, START)
        """Time in ns from which each device has answered to the end."""

    # The world ----------------------------------------------------------------------------------------------

    def play(self) -> None:
        """To the end of all processes, or until the time is over."""
        self._adopt()
        while not self._is_over():
            self._do_faults()
            chosen = self._chosen()
            if chosen is not None:
                self._turn(chosen)
            elif not self._pass_time():
                break

    def end(self) -> None:
        """Nothing is left of the world when this returns."""
        with suppress(WorldError):
            self._adopt()
        for process in self.processes:
            if not process.is_dead:
                self._kill(process, "end")
        for process in self.processes:
            os.close(process.file)
        self._reap()

    @property
    def clock(self) -> int:
        return self.memory.clock

    @property
    def able_at_last_fault(self) -> set[str]:
        """The kinds of the processes that could go on then."""
        return {kind_of(name) for name, state in self.at_last_fault.items() if state is State.ABLE}

    @property
    def falls(self) -> dict[str, int]:
        """Time in ns at which each output went to its default last, of those that have been driven."""
        levels, falls = [0] * len(DEVICES), dict[str, int]()
        for moved in self.memory.moves:
            if moved.move in LEVELLING:
                if levels[moved.device] and not moved.raw:
                    falls[DEVICES[moved.device]] = moved.time
                levels[moved.device] = moved.raw
        return falls

    @property
    def hash(self) -> str:
        return hashlib.sha256("\n".join(self.lines).encode()).hexdigest()[:16]

    def living(self) -> Iterator[Process]:
        return (process for process in self.processes if not process.is_dead)

    def named(self, name: str) -> Process | None:
        return next((process for process in self.processes if process.name == name), None)

    def _is_over(self) -> bool:
        if all(process.is_dead for process in self.processes):
            return True
        if self.clock - self.last_fault > LIMIT:
            self.why_over = "the time was over"
        elif self.steps >= MAX_STEPS:
            self.why_over = "too many steps"
        comes = self._due or any(not fault.moment.who for fault in self._waiting)
        is_alone = self.clock - self.last_fault > ALONE and self.waits_for_stopped and not comes
        return bool(self.why_over) or is_alone

    @property
    def waits_for_stopped(self) -> bool:
        """Whether none is left but workers, clients, and processes that are stopped: one of these goes on to reset, if
        anybody continues it."""
        kinds = {(kind_of(process.name), process.is_stopped) for process in self.living()}
        others = {kind for kind, is_stopped in kinds if not is_stopped} - {"worker", *CLIENTS}
        return not others and any((kind, True) in kinds for kind in RESETTING)

    def _adopt(self) -> None:
        """Know the processes that were forked in the last step."""
        for slot in self.memory.slots[len(self.processes) : self.memory.head[Head.SLOTS]]:
            pid = slot.cells[Cell.PID]
            if not pid:
                raise WorldError(f"{slot.name} was not forked")
            process = Process(slot, pid, os.pidfd_open(pid), self._random.random(), slot.name)
            process.turn = self.steps
            self.processes.append(process)

    # Who goes on --------------------------------------------------------------------------------------------

    def _chosen(self) -> Process | None:
        able = [process for process in self.living() if self._can_go_on(process)]
        if not able:
            return None
        if not self.schedule.seed:
            return min(able, key=lambda process: process.turn)
        chosen = max(able, key=lambda process: process.priority)
        if self.steps in self._changes:
            chosen.priority = -float(self.steps)
        return chosen

    def _can_go_on(self, process: Process) -> bool:
        if process.is_stopped or process.held_until > self.clock:
            return False
        until = process.until
        if not until or process.pending or until <= self.clock:
            return True
        wakes, last = process.slot.cells[Cell.WAKES], self._last
        while wakes:
            bit = wakes & -wakes
            if last[bit] > process.seen:
                return True
            wakes ^= bit
        return False

    def _happen(self, kinds: int) -> None:
        """Something has happened that others may wait for."""
        self._events += 1
        while kinds:
            bit = kinds & -kinds
            self._last[bit] = self._events
            kinds ^= bit

    def _pass_time(self) -> bool:
        """Nobody can go on: move the clock to the next time at which somebody can. False: there is none."""
        times = [due for due, _ in self._due] + [until for until, _ in self._ends]
        times += [START + fault.moment.after for fault in self._waiting if not fault.moment.who]
        for process in self.living():
            if process.alarm:
                times.append(process.alarm)
            if not process.is_stopped:
                ready = process.pending or not process.until
                times.append(max(process.held_until, self.clock if ready else process.until))
        if self._may_be_asked:
            times.append(self._asked_at)
        future = [time for time in times if time > self.clock]
        if not future or min(future) - self.last_fault > LIMIT:
            if any(not process.is_stopped for process in self.living()):
                self.why_over = "the time was over" if future else "nobody can go on"
            return False
        self.memory.head[Head.CLOCK] = min(future)
        self._do_alarms()
        if self._may_be_asked and self.clock >= self._asked_at:
            self.was_asked, self.driven_when_asked = True, self.memory.driven
            self._ask()
        return True

    @property
    def _may_be_asked(self) -> bool:
        starter = self.processes[0]
        return not (self.was_asked or self.memory.outcome or starter.is_dead or starter.is_stopped)

    @property
    def _asked_at(self) -> int:
        """Time in ns at which somebody loses patience: soon where nobody is left who could end the run, and where
        clients may have left it in manual mode."""
        able = any(kind_of(process.name) in RESETTING and not process.is_stopped for process in self.living())
        return self.last_fault + (ASKED_AFTER if able and not self.schedule.clients else ASKED_SOON)

    def _do_alarms(self) -> None:
        for process in self.living():
            if process.alarm and self.clock >= process.alarm:
                process.alarm = process.alarm + process.interval if process.interval else 0
                process.pending.append(signal.SIGALRM)

    def _turn(self, process: Process) -> None:
        """Let one process go on to its next gate."""
        self.steps += 1
        process.turn = self.steps
        cells, text = process.slot.cells, process.slot.text
        self.memory.head[Head.CLOCK] += STEP
        if process.pending:
            number = process.pending.popleft()
            cells[Cell.SIGNAL] = number
            text = f"gets {signal.Signals(number).name}"
        else:
            self._note_stage(text)
            self._carry_out(process)
        is_exit = cells[Cell.EFFECT] == Effect.EXIT and not cells[Cell.SIGNAL]
        cells[Cell.ANSWER] = 0
        process.slot.go.post()
        if is_exit:
            self._note_death(process, "exit")
        else:
            self._await(process)
        self._note(f"{process.name}: {text} -> {cells[Cell.ANSWER]}")
        self._adopt()

    def _note_stage(self, text: str) -> None:
        """What a call tells of how far the run has come."""
        if text == f"enter {Stage.STOPPING}":
            self.left_at = self.clock
        elif text.startswith("conclude"):
            self.is_concluding = True

    def _await(self, process: Process) -> None:
        """Wait until the process stands at its gate again, or has ended."""
        for _ in range(0, TURN_TIMEOUT, TURN_LOOK):
            if self.memory.arrived.wait(TURN_LOOK):
                break
            if _has_ended(process.file, 0):
                self._note_death(process, "crash")
                return
        else:
            raise WorldError(f"{process.name} does not come back from {process.slot.text!r}")
        cells = process.slot.cells
        if cells[Cell.EFFECT] == Effect.EXIT and cells[Cell.FIRST] == DYING:
            self._note_death(process, "signal")
        process.seen = self._events

    def _carry_out(self, process: Process) -> None:
        """What a call does beside itself, before it is made."""
        cells = process.slot.cells
        if cells[Cell.UNTIL]:  # it goes on waiting
            return
        effect, first, second = Effect(cells[Cell.EFFECT]), cells[Cell.FIRST], cells[Cell.SECOND]
        if effect is Effect.CHANGE:
            self._happen(first)
        elif effect is Effect.SIGNAL:
            self._signal(self.processes[first], second, "signal")
        elif effect is Effect.DIE_WITH:
            process.dies_with = first, second
            if self.processes[first].is_dead:
                process.pending.append(second)  # at this gate, from which it has not yet gone on
        elif effect is Effect.ALARM:
            process.alarm, process.interval = (self.clock + first if first else 0), second
        elif effect is Effect.FORK and (process.fork_fails or self.clock < process.forks_fail_until):
            process.fork_fails, cells[Cell.ERROR] = False, errno.EAGAIN
        elif effect is Effect.DISK and self._disk_is_full:
            cells[Cell.ERROR] = errno.ENOSPC

    # Signals ------------------------------------------------------------------------------------------------

    def _signal(self, process: Process, number: int, by: str) -> None:
        if process.is_dead:
            return
        if number == signal.SIGKILL:
            self._kill(process, by)
        elif number in (signal.SIGSTOP, signal.SIGCONT):
            signal.pidfd_send_signal(process.file, number)
            process.is_stopped = number == signal.SIGSTOP
            process.lost_at = self.clock if process.is_stopped else 0
            _until_state(process.pid, process.is_stopped)
            self._happen(Wakes.DEATH)
        else:
            process.pending.append(number)

    def _kill(self, process: Process, by: str) -> None:
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(process.file, signal.SIGKILL)
        self._note_death(process, by)

    def _note_death(self, process: Process, by: str) -> None:
        """Wait for the end of a process: its locks are free then, its files closed, its children another's."""
        if not _has_ended(process.file, TURN_TIMEOUT):
            raise WorldError(f"{process.name} does not end")
        process.is_dead, process.is_stopped, process.ended_by = True, False, by
        process.ended_at, process.lost_at = self.clock, process.lost_at or self.clock
        self._happen(Wakes.DEATH)
        for other in list(self.living()):
            if other.dies_with is not None and other.dies_with[0] == process.slot.number:
                number, other.dies_with = other.dies_with[1], None
                self._signal(other, number, "signal")
        self._reap()

    def _reap(self) -> None:
        """As the first process of a computer does with those whose parent has ended."""
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass

    # Faults -------------------------------------------------------------------------------------------------

    def _do_faults(self) -> None:
        """All of this moment together."""
        for until, fault in [each for each in self._ends if self.clock >= each[0]]:
            self._ends.remove((until, fault))
            self._set(fault, False)
        for fault in list(self._waiting):
            at = self._time_of(fault)
            if at < inf:
                self._waiting.remove(fault)
                self._due.append((int(at), fault))
        now = [each for each in self._due if self.clock >= each[0]]
        for each in now:
            self._due.remove(each)
            self._do(each[1])
        if now:
            self.last_fault = self.clock
            self.at_last_fault = {process.name: process.state for process in self.processes}
            self.was_concluding = self.is_concluding
            self.driven_at_last_fault = bool(self.memory.driven) and not self.left_at

    def _time_of(self, fault: Fault) -> float:
        """Time in ns at which it comes; inf: that is not known yet."""
        moment = fault.moment
        if not moment.who:
            return START + moment.after
        process = self.named(moment.who)
        if process is None or process.gates < moment.gate:
            return inf
        return self.clock + moment.after

    def _do(self, fault: Fault) -> None:
        process = self.named(fault.who)
        self._note(f"fault: {fault}")
        if fault.who not in CLIENTS or (process is not None and not process.is_dead):
            self.came.append(fault)
        if fault.what is What.ASK and not fault.who:
            self._ask()
        elif fault.what in (What.NO_DISK, What.SILENT):
            self._set(fault, True)
            self._ends.append((self.clock + fault.lasting, fault))
        elif process is None or process.is_dead:
            return
        elif fault.what is What.HOLD:
            process.held_until = self.clock + fault.lasting
            self.held_until = max(self.held_until, process.held_until)
        elif fault.what is What.NO_FORK:
            process.fork_fails = True
        elif fault.what is What.NO_FORKS:
            process.forks_fail_until = self.clock + fault.lasting
        else:
            self._signal(process, SIGNALS[fault.what], "fault")

    def _set(self, fault: Fault, is_so: bool) -> None:
        if fault.what is What.NO_DISK:
            self._disk_is_full = is_so
        else:
            self.memory.head[Head.SILENT + DEVICES.index(fault.who)] = is_so
            self.answers_from[fault.who] = LATEST if is_so else self.clock

    def _ask(self) -> None:
        self._signal(self.processes[0], signal.SIGTERM, "fault")

    def _note(self, text: str) -> None:
        self.lines.append(f"{(self.clock - START) / 1e6:.3f} {text}")


def kind_of(process: str) -> str:
    """`standby` for `standby2`."""
    return process.rstrip("0123456789")


def _has_ended(file: int, within: int) -> bool:
    poll = select.poll()
    poll.register(file, select.POLLIN)
    return bool(poll.poll(within * 1000))


def _until_state(pid: int, stopped: bool) -> None:
    """Wait until a process is stopped, or goes on."""
    while True:
        with open(f"/proc/{pid}/stat", "rb") as file:
            if (file.read().rpartition(b")")[2].split()[0] in (b"T", b"t")) == stopped:
                return
        os.sched_yield()
