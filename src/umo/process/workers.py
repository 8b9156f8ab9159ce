"""The worker processes of a run, which its guardian supervises: one for each group of drivers that share a device.

A worker that has died or does not answer is replaced while the machine runs. The new worker first brings the outputs to
their defaults. At the end of a run the workers are ended when every actuator is at its default.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Collection, Sequence
from math import inf
from typing import Any

from umo.cycle.segments import UNCONTROLLED_TIMEOUT
from umo.cycle.stage import Stage
from umo.drivers.off_cycle import OffCycle
from umo.drivers.off_cycle.proxy import MARGIN, Worker
from umo.drivers.off_cycle.shared_memory import Cell
from umo.objects import Compound
from umo.objects.stop_order import stop_sequence
from umo.process.reset import DEATH_TIMEOUT
from umo.process.run_state import RunState, worker
from umo.process.worker import WorkerProcess
from umo.system import calls, realtime
from umo.system.processes import Child, carry_out
from umo.system.signal_handling import signal_name
from umo.text import some
from umo.wiring import Wired

FIRST_PAUSE, MAX_PAUSE = 0.05, 0.5
"""The shortest and the longest time in s until a worker is replaced that has died before it had brought its outputs to
their defaults. The time is doubled each time. Any other worker is replaced immediately."""
FIRST_HOLD, MAX_HOLD = 0.1, 5.0
"""The first and the longest time in s for which a worker keeps its outputs at their defaults, from the second
replacement on. The time is doubled each time."""
STABLE_TIME = 60.0
"""The time in s for which a worker must live so that the next replacement counts as the first one."""


def groups_of(wired: Wired) -> list[list[str]]:
    """Return the names of the drivers off the cycle, in groups. Drivers that share a device are in one group."""
    groups: list[tuple[set[str], list[str]]] = []
    for name, driver in wired.drivers.items():
        if isinstance(driver, OffCycle):
            devices = set(wired.hardware.get(name, (f"driver {name}",)))
            joined = [group for group in groups if group[0] & devices]
            groups = [group for group in groups if not group[0] & devices]
            names = [each for _, mine in joined for each in mine]
            groups.append((devices.union(*(theirs for theirs, _ in joined)), [*names, name]))
    return [names for _, names in groups]


class _Link(Worker):
    """A worker process, as seen by the processes that send it requests."""

    def __init__(self, run_state: RunState, number: int, cells: Any) -> None:
        self._run_state, self._who, self._cells = run_state, worker(number), cells

    def is_gone(self) -> bool:
        return self._run_state.gone(0.0, self._who)

    def silence(self) -> float:
        return float(calls.now_ns() - self._cells[Cell.BEAT]) * 1e-9


class _Group:
    """One worker process and its drivers."""

    def __init__(self, number: int, names: Sequence[str], wired: Wired, run_state: RunState) -> None:
        self.number, self.names = number, names
        self.proxies = [driver for name in names if isinstance(driver := wired.drivers[name], OffCycle)]
        self.watchdogs = [wired.watchdogs.get(name) for name in names]
        self.child: Child | None = None
        """The worker's process, for the guardian that has forked it; None if it is not forked."""
        self.ended_for = ""
        """The reason why the worker was killed, as text; "" if it was not."""
        self.given_up = inf
        """The time in s from which on a worker that was killed counts as blocked in the kernel."""
        self.begun = 0.0
        """Time in s at which the worker was forked."""
        self.generations = self.initialized
        """The generation of each driver's outputs that had been initialised when the worker was forked."""
        self.next_fork, self.pause, self.hold = 0.0, FIRST_PAUSE, 0.0
        for proxy in self.proxies:
            proxy.worker = _Link(run_state, number, proxy.exchange.cells)

    @property
    def limit(self) -> float:
        """The timeout in s for the worker's heartbeats. A worker gives a heartbeat before each call of a driver."""
        timeouts: list[float] = [proxy.timeout for proxy in self.proxies]
        return MARGIN + 2 * max(UNCONTROLLED_TIMEOUT, *timeouts)

    @property
    def silence(self) -> float:
        beat: int = self.proxies[0].exchange.cells[Cell.BEAT]
        return (calls.now_ns() - beat) * 1e-9

    @property
    def initialized(self) -> list[int]:
        """The generation of each driver's outputs that was initialised last."""
        return [int(proxy.exchange.cells[Cell.INITIALIZED]) for proxy in self.proxies]

    def begin(self) -> None:
        """Begin the time within which the worker must give its first heartbeat."""
        self.begun, self.generations = calls.now(), self.initialized
        for proxy in self.proxies:
            proxy.exchange.cells[Cell.BEAT] = calls.now_ns()

    def note_end(self) -> None:
        """Record the worker's end, and compute the time at which the next worker is forked."""
        now = calls.now()
        if now - self.begun > STABLE_TIME:
            self.hold = 0.0
        if all(now > before for now, before in zip(self.initialized, self.generations, strict=True)):
            self.next_fork, self.pause = now, FIRST_PAUSE
        else:  # it has perhaps not come to resetting them: a driver that crashes at once is not forked all the time
            self.next_fork, self.pause = now + self.pause, min(2 * self.pause, MAX_PAUSE)
        self.child, self.ended_for, self.given_up = None, "", inf

    def lengthen(self) -> None:
        """Lengthen the time for which the next worker holds its outputs at their defaults."""
        self.hold = min(max(2 * self.hold, FIRST_HOLD), MAX_HOLD)


class Workers:
    """The workers of one run. `say` prints notices about them."""

    def __init__(
        self,
        machine: Compound,
        wired: Wired,
        groups: Sequence[Sequence[str]],
        run_state: RunState,
        say: Callable[[str], object],
    ) -> None:
        self._wired, self._run_state, self._say = wired, run_state, say
        self._groups = [_Group(number, names, wired, run_state) for number, names in enumerate(groups)]
        by_item = {id(wire.item): wire for wire in wired.wires}
        self._stop_order = [by_item[id(item)] for item in stop_sequence(machine)]

    # The guardian ----------------------------------------------------------------------------------------

    def fork(self) -> None:
        """Fork all workers. Raises OSError if no process is available."""
        for group in self._groups:
            self._fork(group, replaces=False)

    def _fork(self, group: _Group, replaces: bool) -> None:
        group.begin()
        pid = self._run_state.fork(worker(group.number))
        if pid == 0:
            carry_out(lambda: self._work(group, replaces))
        group.child = Child(pid)

    def _work(self, group: _Group, replaces: bool) -> int:
        realtime.leave_core(self._wired.process.cpu)  # that of the control process
        orders, defaults = [], []
        for proxy in group.proxies:
            orders.append([wire.channel.text for wire in self._stop_order if wire.driver is proxy])
            defaults.append({wire.channel.text: wire.default for wire in self._wired.wires if wire.driver is proxy})
        limits = self._wired.process
        process = WorkerProcess(
            self._run_state, group.proxies, orders, limits.hang_timeout, limits.reset_for, self._wired.injection
        )
        return process.run(defaults, group.watchdogs, group.hold) if replaces else process.run()

    def look(self) -> None:
        """Replace the workers that have died, were stopped by a signal, or give no heartbeat. The next worker first
        brings the outputs to their defaults. It starts immediately, unless the previous worker has failed before it had
        done this."""
        for group in self._groups:
            why = self._ending(group)
            if why:
                names = some([f"driver {name}" for name in group.names])
                self._say(f"the worker process of {names} {why}{self._consequence(group)}")
            if group.child is None and self._run_state.stage is Stage.RUNNING and calls.now() >= group.next_fork:
                group.next_fork = calls.now() + MAX_PAUSE  # where it cannot be forked
                self._fork(group, replaces=True)
                group.lengthen()

    def _consequence(self, group: _Group) -> str:
        if self._run_state.stage is not Stage.RUNNING:
            return ""
        stay = f", where they stay for {group.hold:g} s" if group.hold else ""
        return f"; its outputs are set to their defaults{stay}"

    def _ending(self, group: _Group) -> str:
        """Return as text how the worker has ended, or why it was killed. Return "" while it works or is not dead yet:
        until then no other process may open its device."""
        child = group.child
        if child is None:
            return ""
        if child.ended:
            why = group.ended_for or _how(child.status)
            group.note_end()
            return why
        if group.ended_for:
            if calls.now() > group.given_up:
                names = some([f"driver {name}" for name in group.names])
                self._say(f"the worker process of {names} cannot be killed: it is blocked in a call of the kernel")
        elif child.was_stopped or group.silence > group.limit:
            silent = f"sent no heartbeat for {group.limit:g} s"
            group.ended_for = "was stopped by a signal" if child.was_stopped else silent
            group.given_up = calls.now() + DEATH_TIMEOUT
            child.send(signal.SIGKILL)
        return ""

    # The end of the run ------------------------------------------------------------------------------------

    def end_those_of(self, paths: Collection[str]) -> None:
        """End the workers that did not bring these actuators to their defaults, because their devices are opened
        again."""
        proxies = {id(wire.driver) for wire in self._stop_order if wire.path in paths}
        for group in self._groups:
            if any(id(proxy) in proxies for proxy in group.proxies):
                self._kill(group)

    def dismiss(self) -> None:
        """Dismiss the workers, when every actuator is at its default or could not be reached."""
        for group in self._groups:
            self._kill(group)

    def _kill(self, group: _Group) -> None:
        """Kill a worker. When this returns, it no longer uses its device, unless it is blocked in a call of the kernel.
        For a worker of another guardian the lock proves which process it is."""
        who = worker(group.number)
        if group.child is not None and group.child.is_own:
            self._run_state.end_process(group.child, DEATH_TIMEOUT)
        else:
            self._run_state.end(who, DEATH_TIMEOUT)
        self._run_state.wait(lambda: self._run_state.gone(0.0, who), 1.0)


def _how(status: int | None) -> str:
    """Return as text how a worker has ended by itself."""
    killed = status is not None and os.WIFSIGNALED(status)
    return f"was killed ({signal_name(os.WTERMSIG(status))})" if killed and status is not None else "has ended"
