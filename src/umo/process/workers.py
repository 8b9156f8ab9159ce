"""The worker processes of a run, as its guardian keeps them: one for each group of drivers that share a device.

A worker that has died or does not answer is replaced while the machine runs: the new one brings the outputs to their
defaults first. At the end of a run the workers are ended when every actuator is at its default.
"""

from __future__ import annotations

import mmap
import os
import signal
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from math import inf
from time import monotonic, monotonic_ns, sleep
from typing import Any

from umo.cycle.stage import Stage
from umo.cycle.stopping import signal_name
from umo.cycle.transfer import UNCONTROLLED_TIMEOUT
from umo.drivers.off_cycle import OffCycle
from umo.drivers.off_cycle.proxy import MARGIN, Worker
from umo.drivers.off_cycle.shared_memory import Cell
from umo.objects import Compound
from umo.objects.stop_order import stop_sequence
from umo.process.reset import DEATH_TIMEOUT, LOOK_INTERVAL
from umo.process.run_state import RunState, worker
from umo.process.worker import WorkerProcess
from umo.system import realtime
from umo.system.processes import ProcessHandle, carry_out
from umo.text import some
from umo.wiring import Wired

FIRST_PAUSE, MAX_PAUSE = 0.1, 5.0
"""Time in s from one replacement of a worker to the next: the first one is made at once, then it doubles."""


def _reaped(pid: int) -> bool:
    """Wait for the end of a process that was killed; False if it does not end. The standby guardian is not its
    parent."""
    until = monotonic() + DEATH_TIMEOUT
    with suppress(ChildProcessError):
        while not os.waitpid(pid, os.WNOHANG)[0]:
            if monotonic() > until:
                return False
            sleep(LOOK_INTERVAL)
    return True


def groups_of(wired: Wired) -> list[list[str]]:
    """The names of the drivers off the cycle; those that share a device stand together."""
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
    """A worker, as those see it that ask it."""

    def __init__(self, run_state: RunState, number: int, cells: Any) -> None:
        self._run_state, self._who, self._cells = run_state, worker(number), cells

    def is_gone(self) -> bool:
        return self._run_state.gone(0.0, self._who)

    def silence(self) -> float:
        return float(monotonic_ns() - self._cells[Cell.BEAT]) * 1e-9


class _Group:
    """One worker process and its drivers."""

    def __init__(self, number: int, names: Sequence[str], wired: Wired, run_state: RunState) -> None:
        self.number, self.names = number, names
        self.proxies = [driver for name in names if isinstance(driver := wired.drivers[name], OffCycle)]
        self.watchdogs = [wired.watchdogs.get(name) for name in names]
        self.pid = 0
        self.next_fork, self.pause = 0.0, FIRST_PAUSE
        for proxy in self.proxies:
            proxy.worker = _Link(run_state, number, proxy.exchange.cells)

    @property
    def limit(self) -> float:
        """Timeout in s for its signs of life: it gives one before each call of a driver."""
        timeouts: list[float] = [proxy.timeout for proxy in self.proxies]
        return MARGIN + 2 * max(UNCONTROLLED_TIMEOUT, *timeouts)

    @property
    def silence(self) -> float:
        beat: int = self.proxies[0].exchange.cells[Cell.BEAT]
        return (monotonic_ns() - beat) * 1e-9

    def begin(self) -> None:
        """It has a moment for its first sign of life."""
        for proxy in self.proxies:
            proxy.exchange.cells[Cell.BEAT] = monotonic_ns()


class Workers:
    """The workers of one run. `say` tells the user what happened to one."""

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
        self._pids = mmap.mmap(-1, 8 * max(1, len(self._groups)))  # shared: the standby guardian ends them too
        self._cells = memoryview(self._pids).cast("q")

    # The guardian ----------------------------------------------------------------------------------------

    def fork(self) -> None:
        """Fork them all. OSError where no process can be had."""
        for group in self._groups:
            self._fork(group, replaces=False)

    def _fork(self, group: _Group, replaces: bool) -> None:
        group.begin()
        pid = self._run_state.fork(worker(group.number))
        if pid == 0:
            carry_out(lambda: self._work(group, replaces))
        group.pid = self._cells[group.number] = pid

    def _work(self, group: _Group, replaces: bool) -> int:
        realtime.leave_core(self._wired.process.cpu)  # that of the control process
        orders, defaults = [], []
        for proxy in group.proxies:
            orders.append([wire.channel.text for wire in self._stop_order if wire.driver is proxy])
            defaults.append({wire.channel.text: wire.default for wire in self._wired.wires if wire.driver is proxy})
        hang = self._wired.process.hang_timeout
        process = WorkerProcess(self._run_state, group.proxies, orders, hang, self._wired.injection)
        return process.run(defaults, group.watchdogs) if replaces else process.run()

    def look(self) -> None:
        """Replace those that have died, were stopped by a signal, or give no sign of life."""
        for group in self._groups:
            why = self._ending(group)
            if why:
                names = some([f"driver {name}" for name in group.names])
                replaced = self._run_state.stage is Stage.RUNNING
                then = "; its outputs are brought to their defaults" if replaced else ""
                self._say(f"the worker process of {names} {why}{then}")
            if not group.pid and self._run_state.stage is Stage.RUNNING and monotonic() >= group.next_fork:
                group.next_fork = monotonic() + group.pause
                group.pause = min(2 * group.pause, MAX_PAUSE)
                self._fork(group, replaces=True)

    def _ending(self, group: _Group) -> str:
        """How it has ended, or was ended, in words; "" as long as it serves."""
        if not group.pid:
            return ""
        pid, status = os.waitpid(group.pid, os.WNOHANG | os.WUNTRACED)
        if not pid and group.silence <= group.limit:
            return ""
        if not pid:
            why = f"gave no sign of life for {group.limit:g} s"
        elif os.WIFSTOPPED(status):
            why = "was stopped by a signal"
        else:
            why = f"was killed ({signal_name(os.WTERMSIG(status))})" if os.WIFSIGNALED(status) else "has ended"
        if not pid or os.WIFSTOPPED(status):
            os.kill(group.pid, signal.SIGKILL)
            if not _reaped(group.pid):  # nobody else may open its device
                why += ", and cannot be killed: it is blocked in a call of the kernel"
                group.next_fork = inf
        group.pid = self._cells[group.number] = 0
        return why

    # The end of the run ------------------------------------------------------------------------------------

    def end_those_of(self, paths: Collection[str]) -> None:
        """End the workers that did not bring these actuators to their defaults: their devices are opened anew."""
        proxies = {id(wire.driver) for wire in self._stop_order if wire.item.path in paths}
        for group in self._groups:
            if any(id(proxy) in proxies for proxy in group.proxies):
                self._kill(group)

    def dismiss(self) -> None:
        """Every actuator is at its default, or could not be reached."""
        for group in self._groups:
            self._kill(group)

    def _kill(self, group: _Group) -> None:
        pid = int(self._cells[group.number])
        self._cells[group.number] = 0
        with suppress(OSError):
            if pid and not self._run_state.gone(0.0, worker(group.number)):
                ProcessHandle(pid).send(signal.SIGKILL)
        if pid:
            _reaped(pid)
        self._run_state.gone(1.0, worker(group.number))
