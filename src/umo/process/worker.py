"""A worker process, which serves drivers off the cycle that belong together, next to the control process. The worker
answers the requests of the process that connects or resets the machine. While the control process lives and requests
it, the worker makes transfers at the periods of the drivers. It is an ordinary process, which the kernel runs only when
the control process does not need the processor. If the control process and the guardians are gone, the worker brings
its outputs to their defaults and ends.
"""

from __future__ import annotations

import signal
from collections.abc import Sequence
from functools import partial

from umo.cycle.attempts import Attempts
from umo.cycle.stage import Stage
from umo.drivers.faults.wrapper import Injection
from umo.drivers.off_cycle import NO_TIME, OffCycle
from umo.drivers.off_cycle.shared_memory import Cell
from umo.process.reset import ATTEMPT_PAUSE, STOP_SIGNALS
from umo.process.run_state import RunState, Who
from umo.system import calls, realtime
from umo.system.processes import name_process

REQUEST_INTERVAL = 0.0005
"""The time in s between two checks for a request while nothing is controlled."""
ORDER_INTERVAL = 0.005
"""The longest time in s between two checks for an order while the machine runs."""


class MachineTime:
    """The machine's time that the control process provides. Injected faults act by this time."""

    def __init__(self) -> None:
        self.ns = NO_TIME

    @property
    def now(self) -> float:
        return self.ns * 1e-9


class WorkerProcess:
    """The work of one worker process. `orders`: the texts of the channels of each driver's outputs, in stop order."""

    def __init__(
        self,
        run_state: RunState,
        proxies: Sequence[OffCycle],
        orders: Sequence[Sequence[str]],
        hang: float,
        reset_for: float,
        injection: Injection | None,
    ) -> None:
        """`hang`: the timeout in s for heartbeats of the control process. `reset_for`: the time in s for which the
        worker tries to reset if no other process is left."""
        self._run_state = run_state
        self._proxies = proxies
        self._orders = orders
        self._hang = hang
        self._reset_for = reset_for
        self._injection = injection
        self._time = MachineTime()
        self._lost = True
        """True if the control process is gone."""
        for proxy in proxies:
            proxy.server.on_call = self._beat
            proxy.server.in_charge = partial(self._runs, proxy)

    def run(
        self,
        defaults: Sequence[dict[str, int | None]] = (),
        watchdogs: Sequence[float | None] = (),
        hold: float = 0.0,
    ) -> int:
        """Serve until the machine is reset. With `defaults`, the defaults of each driver's channels, this process
        replaces a worker that has died: it first brings the outputs to their defaults, and keeps them there for `hold`
        s."""
        name_process("umo worker")
        realtime.drop_realtime(niceness=0)
        for number in STOP_SIGNALS:
            calls.handle_signal(number, signal.SIG_IGN)
        self._beat()
        for proxy, each, watchdog in zip(self._proxies, defaults, watchdogs, strict=False):
            proxy.server.begin_anew(each, watchdog, hold)
        while not self._is_left_alone():
            self._beat()
            for proxy in self._proxies:
                self._serve(proxy)
        self._reset_alone()
        return 0

    def _reset_alone(self) -> None:
        """Reset because no other process can: for `reset_for`, and as long as an attempt reaches something new."""
        self._set_fault_time(NO_TIME)
        until, attempts = calls.now() + self._reset_for, Attempts()
        due = list(zip(self._proxies, self._orders, strict=True))
        while due:
            left, reached = [], set[tuple[int, str]]()
            for proxy, order in due:
                failed = proxy.server.reset_all(order)
                reached.update((id(proxy), text) for text in order if text not in failed)
                if failed:
                    left.append((proxy, order))
            if not attempts.add(reached) and calls.now() > until:
                break
            due = left
            if due:
                calls.sleep(ATTEMPT_PAUSE)
        for proxy in self._proxies:
            proxy.server.perform({"call": "close"})

    def _beat(self) -> None:
        now = calls.now_ns()
        for proxy in self._proxies:
            proxy.exchange.cells[Cell.BEAT] = now

    def _serve(self, proxy: OffCycle) -> None:
        exchange, server = proxy.exchange, proxy.server
        if (asked := exchange.asked()) is not None:
            number, request = asked
            self._set_fault_time(request["now"])
            answer = server.perform(request)
            try:
                exchange.answer(number, answer)
            except (TypeError, ValueError) as error:
                exchange.answer(
                    number, {"error": "driver", "text": f"the answer of the driver cannot be passed on: {error}"}
                )
        elif exchange.cells[Cell.CYCLIC] and not self._lost:
            self._set_fault_time(exchange.cells[Cell.NOW])
            server.work()

    def _runs(self, proxy: OffCycle) -> bool:
        """Return True if the control process still runs the machine and has made no other request."""
        return proxy.exchange.asked() is None and not self._run_state.gone(0.0) and not self._control_hangs

    def _is_left_alone(self) -> bool:
        """Wait until work may be due. Return True if no process is left that controls the machine or could reset it."""
        run_state = self._run_state
        self._lost = run_state.gone(self._slice())
        if not self._lost and not self._control_hangs:
            return False
        if all(run_state.gone(0.0, who) for who in (Who.GUARDIAN, Who.STANDBY, Who.RESERVE)):
            return True
        if self._lost:
            calls.sleep(REQUEST_INTERVAL)
        return False

    @property
    def _control_hangs(self) -> bool:
        return self._run_state.stage is Stage.RUNNING and self._run_state.silence > self._hang

    def _slice(self) -> float:
        cyclic = [proxy for proxy in self._proxies if proxy.exchange.cells[Cell.CYCLIC]]
        if len(cyclic) < len(self._proxies):
            return REQUEST_INTERVAL
        return max(0.0, min(ORDER_INTERVAL, *(proxy.server.seconds_left() for proxy in cyclic)))

    def _set_fault_time(self, ns: int) -> None:
        """Set the machine's time in ns for injected faults, as provided by the control process."""
        if self._injection is not None:
            self._time.ns = ns
            self._injection.clock = None if ns == NO_TIME else self._time
            self._injection.tells = False
