"""The end of a run: reset the machine if needed, record the end, and report it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress

from umo.process.control_watch import ControlWatch
from umo.process.frame_watcher import FrameWatcher
from umo.process.job import Plan
from umo.process.keeper import Keeper
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome
from umo.process.reset import DEATH_TIMEOUT, Resetter, summary
from umo.process.run_state import RunState, Who
from umo.process.workers import Workers
from umo.system import calls, realtime
from umo.system.device_record import DeviceClaim
from umo.system.streams import say_without_waiting
from umo.text import in_brackets, printable

STANDBY = "standby guardian"
SPARE_DESCRIPTORS = 16
"""The number of descriptors that are kept free for the end, because the drivers need them."""
STARTER_END_TIMEOUT = 0.3
"""The time in s for the end of a starter that is killed together with this process. The memory of the starter is freed
before its end of the channel is closed."""
MAX_MESSAGE_LENGTH = 1000
"""Largest length of the message, in characters."""


class RunEnd:
    """The work of a guardian when the control process has ended or hangs."""

    def __init__(
        self,
        plan: Plan,
        device_claim: DeviceClaim,
        run_state: RunState,
        channel: MessageSocket,
        watcher: FrameWatcher,
        workers: Workers,
        keeper: Keeper,
    ) -> None:
        self._plan = plan
        self._device_claim = device_claim
        self._run_state = run_state
        self._channel = channel
        self._watcher = watcher
        self.title = "guardian"
        self._workers, self._keeper = workers, keeper
        self.resetter = Resetter(
            plan.machine, plan.wired, self._begin_reset, workers.end_those_of, self._fork_reserve, run_state.end_process
        )
        self.resetter.takes_place = self._takes_place
        self._spares = [calls.open(os.devnull, os.O_RDONLY) for _ in range(SPARE_DESCRIPTORS)]

    def hand_over(self) -> None:
        """Work from now on for the standby guardian, which calls this."""
        self.title = STANDBY
        self.resetter.hand_over()

    def _fork_reserve(self, first: bool) -> int:
        """Fork the child that waits to reset, and return its pid; 0 in the child. A child that is not the first waits
        for its lock itself (`_takes_place`), so that it does not delay the reset."""
        if first:
            return self._run_state.fork(Who.RESERVE)
        pid = calls.fork()
        if pid == 0:
            calls.new_session()
        return pid

    def _takes_place(self, within: float) -> bool:
        """Take the lock, in the child that waits to reset. Return True if the child has the lock. The previous child
        keeps the lock until it begins to reset."""
        return self._run_state.holds(Who.RESERVE) or self._run_state.hold(Who.RESERVE, within)

    def _begin_reset(self) -> None:
        """Begin the reset, in the child that resets."""
        if self._run_state.holds(Who.RESERVE):  # another one waits from now on
            self._run_state.release(Who.RESERVE)
        self._run_state.hold(Who.RESET)
        process = self._plan.wired.process
        # one below the guardian: a driver that loops for ever must not keep the guardian from ending it
        realtime.prepare_guardian(process.priority - 1, process.cpu)

    def step_in(self, control: ControlWatch, why: str, said: Callable[[str], object]) -> Outcome:
        """Take over from a control process that died without resetting the machine, or that hangs: make sure that the
        process is dead, then reset."""
        control.process.send(signal.SIGKILL)
        left = self._reset(control.is_dead, said)
        lost = "the guardian was lost; " if self.title == STANDBY else ""
        what = why or f"{lost}the control process {control.ending()}{in_brackets(self._watcher.moment)}"
        told = f"not reached: {summary(left)}" if left else f"the {self.title} reset every actuator"
        return Outcome(Failed("ControlLost", f"{what}\n{told}", 1), unsafe=True, unreached=list(left))

    def settle(self, is_dead: Callable[[], bool], outcome: Outcome, said: Callable[[str], object]) -> Outcome:
        """Finish after a control process that has disconnected by itself: retry the actuators that the process could
        not reset. `is_dead` returns whether the process has certainly ended or no longer uses a device."""
        if outcome.unreached:
            left = self._reset(is_dead, said)  # all of them: the list may have been cut, and the order counts
            outcome.unsafe, outcome.unreached = True, list(left)
            outcome.failure = outcome.failure or Failed("StopError", "not brought to their defaults", 3)
            told = f"not reached: {summary(left)}" if left else f"reset by the {self.title} afterwards"
            outcome.failure.message = "\n".join([outcome.failure.message.partition("\n")[0], told])
            outcome.failure.status = 3 if left else 1
        return outcome

    def _reset(self, is_dead: Callable[[], bool], said: Callable[[str], object]) -> dict[str, str]:
        """Reset every actuator, in stop order. Return those not reached, with the cause."""
        self._run_state.conclude()
        self._device_claim.hold.used_here()
        while self._spares:
            with suppress(OSError):  # control code may have closed it
                calls.close(self._spares.pop())
        self._run_state.wait(lambda: self._run_state.gone(0.0, Who.RESET), DEATH_TIMEOUT)  # the child of a dead one
        lasting = self._plan.wired.process.reset_for
        return self.resetter.reset(lasting, is_dead=is_dead, said=said)

    def tell(self, outcome: Outcome) -> None:
        """Record and report how the run ended. The standby guardian repeats this if the guardian is killed
        meanwhile."""
        failure = outcome.failure
        what = failure.message.partition("\n")[0] if failure is not None else "it was stopped"
        with suppress(Exception):
            self._workers.dismiss()
        if not outcome.unsafe:
            self._channel.send("safe")  # before the records are removed
        with suppress(Exception):
            if outcome.unsafe:
                told = self._device_claim.stopped(what, outcome.unreached)
                if told and failure is not None:
                    failure.message += f"; {told}"
            elif outcome.driven:
                self._device_claim.finish()
            else:
                self._device_claim.abandon()
        if failure is not None:
            self._watcher.keep(what)
        with suppress(Exception):
            self.resetter.dismiss()
        with suppress(Exception):
            outcome.unkept = self._keeper.finish(self._watcher.reader)
        with suppress(Exception):
            self._watcher.finish(self._run_state.wait)
        self._channel.send("ended", outcome=outcome.dump())
        self._run_state.note_told()
        with suppress(Exception):
            self._end_reserve()
        tell_final_message(self._channel, self._plan.name, outcome)

    def _end_reserve(self) -> None:
        """End the child that waits to reset, after the report. A stopped child would hold the devices; if it belongs to
        another guardian, its lock proves which process it is."""
        if not self._run_state.holds(Who.RESERVE):
            self._run_state.end(Who.RESERVE, DEATH_TIMEOUT)


def tell_final_message(channel: MessageSocket, name: str, outcome: Outcome) -> None:
    """Print on stderr how the run ended, if the process that started it has ended. The function waits for no terminal.
    It is called when the machine has been reset and everything is recorded. An error here does not change how the run
    ended."""
    with suppress(Exception):
        if channel.peer_is_gone(STARTER_END_TIMEOUT if outcome.unsafe else 0.0):
            how = f"the run has ended; {outcome.outputs}" if outcome.failure is None else outcome.failure.message
            text = f"umo: {name}: the process that started the run has ended; {how}"
            say_without_waiting(printable(text.replace("\n", "; "))[:MAX_MESSAGE_LENGTH])
