"""A world: one run of the machine, whose starter is forked from the process that plays schedules.

umo is imported, and the plan of the run is made, once; each world has a copy. All code of the run is umo's own, but for
`Starter`, which does what `umo run` does. What cannot be the same in each run (priorities, locked memory) is left out.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import umo.clients.faces.gateway as gateway
import umo.cycle.insisting as insisting
import umo.drivers.off_cycle.proxy as proxy
import umo.process.control_process as control_process
import umo.process.frames.command_queue as command_queue
import umo.process.guardian as guardian
import umo.process.keeper as keeper
import umo.process.reset as reset
import umo.process.worker as worker
import umo.system.processes as processes
from tools.schedules import clients, machine
from tools.schedules.faults import Schedule
from tools.schedules.gate import Gate, stand_before
from tools.schedules.scheduler import CLIENTS
from tools.schedules.shared import Memory
from umo.drivers.off_cycle import OffCycle
from umo.process.frame_watcher import FrameWatcher
from umo.process.frames import Reader
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.ring import Ring
from umo.process.job import Job, Plan
from umo.process.job_facts import job_facts
from umo.process.run_end import RunEnd
from umo.process.run_state import RunState, Who
from umo.process.start import Started
from umo.system import calls, realtime
from umo.system.notify import ServiceManager
from umo.system.realtime import Refusal

INTERVALS: tuple[tuple[Any, str, float], ...] = (
    (processes, "LOOK_INTERVAL", 0.004),
    (reset, "LOOK_INTERVAL", 0.004),
    (proxy, "LOOK_INTERVAL", 0.01),
    (control_process, "ADMISSION_INTERVAL", 0.01),
    (worker, "REQUEST_INTERVAL", 0.01),
    (worker, "ORDER_INTERVAL", 0.02),
    (gateway, "LINGER", 0.1),
)
"""Times in s between two looks at another process, in place of 0.5 and 5 ms: the same protocol in fewer steps; and for
which a face keeps the lease that it does not use, in place of 5 s."""
WORKERS = 1


def job(with_clients: bool) -> Job:
    """That of a world with clients, or of another one."""
    name = machine.__name__
    if with_clients:
        return Job(machine=f"{name}:declare_plant", application=f"{name}:drive_plant", wiring=machine.PLANT_WIRING)
    return Job(machine=f"{name}:declare", application=f"{name}:drive", wiring=machine.WIRING)


class World:
    """Makes the processes of one run after the other. `prefix`: of the abstract names of their sockets. `recording`:
    the file of the recorder."""

    def __init__(self, memory: Memory, prefix: str, recording: Path) -> None:
        self._memory, self._prefix, self._recording = memory, prefix, recording
        self._plans = {with_clients: Plan(job(with_clients)) for with_clients in (False, True)}
        self._facts = {with_clients: job_facts(plan) for with_clients, plan in self._plans.items()}
        drivers = [driver for plan in self._plans.values() for driver in plan.wired.drivers.values()]
        shared = [driver.exchange._memory for driver in drivers if isinstance(driver, OffCycle)]
        self._clean = [(memory, bytes(memory)) for memory in shared]
        """What the processes of a run share from before its start, as it is then: all worlds have the same memory."""
        gc.collect()
        gc.freeze()

    def begin(self, log: int, schedule: Schedule) -> int:
        """Fork the starter; its pid. It stands at its first gate when this returns. `log`: the file for what is
        printed."""
        for memory, content in self._clean:
            memory[:] = content
        slot = self._memory.new_slot("starter")
        pid = os.fork()
        if pid == 0:
            try:
                os.dup2(log, 1)
                os.dup2(log, 2)
                self._become_starter(Gate(self._memory, slot, self._prefix), schedule)
            except BaseException:
                sys.excepthook(*sys.exc_info())
            finally:
                os._exit(99)
        self._memory.until_born()
        return pid

    def _become_starter(self, gate: Gate, schedule: Schedule) -> None:
        os.setsid()
        gc.disable()
        machine.gates.append(gate)
        plan = self._plans[schedule.clients]
        install(gate, plan)
        _change(control_process, "job_facts", lambda *_: self._facts[schedule.clients])
        machine.periods[0] = machine.LONG if schedule.long else machine.PERIODS
        manager = None
        if schedule.clients:
            machine.periods[0] = machine.WITH_CLIENTS
            _stand_at_clients(gate)
            manager = clients.Manager(self._prefix)
        elif not schedule.frames:
            _change(FrameWatcher, "make", lambda self: "")
        gate.begin()
        Starter(plan.job, self._memory, gate, manager, self._recording).run()
        calls.exit_now(0)


class Starter:
    """The process that has started the run and waits for its end, as `umo run` does. In a world with clients it is the
    service manager too (`manager`), and starts the clients, one of which makes a recording."""

    def __init__(self, job: Job, memory: Memory, gate: Gate, manager: clients.Manager | None, recording: Path) -> None:
        self._memory, self._gate, self._manager, self._recording = memory, gate, manager, recording
        self._has_clients = manager is None
        self._started: Started | None = None
        signal.signal(signal.SIGTERM, self._ask)
        self._started = Started(job, is_service=manager is not None)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._started is not None:
            self._started.ask_to_stop(number)

    def run(self) -> None:
        assert self._started is not None
        while (outcome := self._started.outcome) is None:
            self._started.poll(0.1)
            if self._manager is not None:
                self._manager.read()
            if not self._has_clients and self._started.frames is not None:
                self._has_clients = True
                self._start_clients(self._started.frames)
        self._memory.put_outcome(outcome.encode())

    def _start_clients(self, reader: Reader) -> None:
        ends, gate = reader.ends, self._gate
        assert ends is not None
        for name in CLIENTS:
            gate.start_client(name, ends, partial(clients.become, gate, name, ends, self._recording))


# What is different in a world -----------------------------------------------------------------------------


def install(gate: Gate, plan: Plan) -> None:
    """In the starter, which all processes of the world descend from."""
    gate.locks = [who.name.lower() for who in Who] + [f"worker {number}" for number in range(WORKERS)]
    gate.starts = lambda files, environ: guardian.main(*files)
    gate.install()
    _change(guardian, "Plan", lambda job: plan)
    for module, name, seconds in INTERVALS:
        _change(module, name, seconds)
    _leave_real_time_out()
    _name_processes(gate)
    _stand_at_memory(gate)
    library = insisting.side_of
    _change(insisting, "side_of", lambda file: insisting.Side.LOOP if file in _OWN_FILES else library(file))


_OWN_FILES = {sys.modules[Gate.__module__].__file__, sys.modules[Memory.__module__].__file__}
"""No code of a user's, which a second signal would end."""


def _change(owner: Any, name: str, value: Any) -> None:
    """ValueError where there is no such name any more."""
    if not hasattr(owner, name):
        raise ValueError(f"{owner.__name__} has no {name}")
    setattr(owner, name, value)


def _leave_real_time_out() -> None:
    refusal = Refusal("no real-time scheduling", "it is a world of schedules", "-")
    _change(realtime, "prepare", lambda *_: [])
    _change(realtime, "granted", lambda: (0, None))
    _change(realtime, "use_fifo", lambda priority: refusal)
    for name in ("prepare_guardian", "drop_realtime", "leave_core"):
        _change(realtime, name, lambda *_, **__: None)
    for module in (guardian, control_process, keeper):
        _change(module, "adjust_oom_score", lambda change: None)


def _name_processes(gate: Gate) -> None:
    """Each process is named by what it is forked for."""
    fork, fork_reserve, keep = RunState.fork, RunEnd._fork_reserve, FrameWatcher.keep

    def named_fork(self: RunState, who: int) -> int:
        gate.next_kind = Who(who).name.lower() if who < len(Who) else "worker"
        return fork(self, who)

    def named_fork_reserve(self: RunEnd, first: bool) -> int:
        gate.next_kind = "reserve"
        return fork_reserve(self, first)

    def named_keep(self: FrameWatcher, reason: str) -> None:
        gate.next_kind = "box"
        keep(self, reason)
        gate.next_kind = "reset"

    _change(RunState, "fork", named_fork)
    _change(RunEnd, "_fork_reserve", named_fork_reserve)
    _change(FrameWatcher, "keep", named_keep)


def _stand_at_clients(gate: Gate) -> None:
    """What the machine, its clients and a service manager tell one another has a gate, before each store that others
    may see."""
    _change(command_queue, "fcntl", clients.QueueLock(gate))
    _change(gateway, "SENDER", clients.Here(1))
    stand_before(gate, ClientMemory, "ask_to_stop", lambda self, number, who: [f"ask to stop {who}"])
    stand_before(gate, ClientMemory, "sign", lambda self, path, lease, now: [f"sign {path or 'lease'}"])
    stand_before(gate, command_queue.Sender, "_put", lambda self, head, text: [f"put command {head + 1}"])
    stand_before(gate, Ring, "__call__", lambda self, frame: [f"publish {self.index}"])
    stand_before(gate, Ring, "_tell", clients.events_of)
    stand_before(gate, RunState, "beat", lambda self: ["beat"])
    stand_before(gate, ServiceManager, "tell", lambda self, *lines: [f"service {lines[0]}"])


class _Torn:
    """Memory whose writes have a gate each: a process may be killed between the two of a report."""

    def __init__(self, gate: Gate, memory: Any) -> None:
        self._gate, self._memory = gate, memory

    def __getitem__(self, place: slice) -> bytes:
        return bytes(self._memory[place])

    def __setitem__(self, place: slice, content: bytes) -> None:
        self._gate.stand("write report")
        self._memory[place] = content


def _stand_at_memory(gate: Gate) -> None:
    """What is written to shared memory, and others decide by, has a gate."""
    make = RunState.__init__

    def made(self: RunState, workers: int = 0) -> None:
        make(self, workers)
        for text in (self._report, self._outcome):
            text._memory = _Torn(gate, text._memory)  # type: ignore[assignment]

    _change(RunState, "__init__", made)
    for name in ("enter", "ask", "admit", "conclude", "note_told"):
        stand_before(gate, RunState, name, lambda self, *words, name=name: [" ".join([name, *map(str, words)])])
