"""The guardian, which forks the control process, watches it, and resets the machine if the control process dies or
hangs.

At its start the guardian reserves everything that a reset needs: a child process that resets, descriptors, shared
memory, and the standby guardian, which takes its place if it dies (`standby`). The guardian resets the machine after
any error in the guardian, and whenever the control process has not reported that every actuator is at its default.
"""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import FrameType
from typing import NoReturn

from umo.cycle.insisting import place_within
from umo.cycle.stage import Stage
from umo.errors import Interrupted, text_of
from umo.process import kept_values
from umo.process.compiling import prepare_if_asked
from umo.process.control_process import Control, drive_and_report
from umo.process.control_watch import ControlWatch
from umo.process.frame_watcher import FrameWatcher
from umo.process.frames.blackbox import ON_DEMAND
from umo.process.hang_detection import LOOK_INTERVAL, HangDetector, guardian_limit
from umo.process.job import Job, Plan
from umo.process.keeper import Keeper
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome
from umo.process.processor_share import ProcessorShare
from umo.process.reset import DEATH_TIMEOUT, STOP_SIGNALS
from umo.process.run_end import RunEnd, tell_final_message
from umo.process.run_state import FOLLOWERS, RunState, Who
from umo.process.service_report import ServiceReport
from umo.process.standby import Standby, tell_who
from umo.process.workers import Workers, groups_of
from umo.system import calls, realtime
from umo.system.device_record import INSPECT, DeviceClaim
from umo.system.processes import adjust_oom_score, carry_out, flush, name_process
from umo.system.realtime import CorePlace
from umo.system.signal_handling import SIGNALS
from umo.system.streams import late, log_tracebacks, never_wait, send_waiting
from umo.text import in_brackets, some

OOM_SCORE_CHANGE = -500
"""The change of the guardian's score by which the kernel selects a process to kill when memory runs out. It is made
only if it is permitted."""
MAX_NOTICES = 1000
"""The largest number of notices for the user. It is limited because a run may last for years."""
MAX_DEAF_LOOKS = 3
"""The number of looks in which listening fails, after which the machine is stopped."""


def main(file: int, job_file: int) -> int:
    """Run a guardian process, from its job to its exit status."""
    never_wait()  # what is printed, here or in the control process, can neither end a run nor hold it up
    name_process("umo guardian")
    adjust_oom_score(OOM_SCORE_CHANGE)
    for number in SIGNALS:
        calls.handle_signal(number, _interrupt)
    channel = MessageSocket(calls.socket_of(file))
    device_claim = guardian = None
    name = "the run"
    try:
        calls.mask_signals(signal.SIG_UNBLOCK, SIGNALS)  # the starter has blocked them until here
        with open(job_file, "rb") as opened:
            job = Job.load(opened.read())
        if job.traceback:
            log_tracebacks()
        plan = Plan(job)
        name = plan.name
        plan.prepared = prepare_if_asked(plan.machine, plan.wired, lambda text: channel.send("notice", text=text))
        calls.mask_signals(signal.SIG_BLOCK, SIGNALS)  # a stop comes before the devices are claimed or after that
        device_claim = DeviceClaim(
            plan.wired.devices, plan.name, plan.wiring_name, acknowledge=job.acknowledge, launch=plan.launch
        )
        calls.mask_signals(signal.SIG_UNBLOCK, SIGNALS)
        guardian = Guardian(plan, channel, device_claim)
        return guardian.run().status
    except BaseException as error:
        if guardian is not None and guardian.is_followed:
            raise  # the standby guardian takes over as soon as this process has ended
        outcome = _outcome_of(error, channel)
        if guardian is not None and guardian.is_driving:
            outcome = guardian.give_up(outcome)
        elif device_claim is not None:  # nothing was driven
            device_claim.abandon()
    channel.send("ended", outcome=outcome.dump())
    tell_final_message(channel, name, outcome)
    return outcome.status


def _outcome_of(error: BaseException, channel: MessageSocket) -> Outcome:
    """Return the outcome for an error that has ended the guardian, before or while it guarded."""
    for number in SIGNALS:
        calls.handle_signal(number, signal.SIG_IGN)
    if not isinstance(error, Interrupted):
        return Outcome(Failed.of(error))
    channel.send("notice", text=text_of(error))
    return Outcome(stopped_by=error.number)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Raise Interrupted: a stop was requested while the station's code declares the machine. Nothing is driven yet."""
    raise Interrupted(f"stopped before the machine was started{in_brackets(place_within(frame, None))}", number)


class Guardian:
    """The guardian of one control process."""

    def __init__(self, plan: Plan, channel: MessageSocket, device_claim: DeviceClaim) -> None:
        self._plan = plan
        self._channel = channel
        self._device_claim = device_claim
        self._core: int | None = None
        """The core that is reserved for the control process under SCHED_FIFO."""
        self._place = self._take_core()
        """The reservation of the core, which lasts as long as this process lives."""
        self._process = plan.wired.process
        groups = groups_of(plan.wired)
        self._run_state = RunState(len(groups))
        self._stop_signal: int | None = None
        self._stop_passed_on = False
        self._deaf_looks = 0
        """The number of successive looks in which listening failed."""
        self._said: set[str] = set()
        self._is_standby = False
        self._control: ControlWatch | None = None
        self._traces = tempfile.TemporaryFile()  # noqa: SIM115  (as long as the process)
        self._watcher = FrameWatcher(plan.name)
        self._service = ServiceReport.of_this_process(self._run_state, lambda: self._watcher.reader)
        self._workers = Workers(plan.machine, plan.wired, groups, self._run_state, self._say)
        self._keeper = Keeper(
            kept_values.file_of(plan), kept_values.title_of(plan), self._run_state, self._say, self._process.cpu
        )
        self._end = RunEnd(plan, device_claim, self._run_state, channel, self._watcher, self._workers, self._keeper)
        limit = guardian_limit(self._process.hang_timeout)
        self._standby = Standby(self._run_state, limit, self._take_over, channel, self._say)
        self._end.resetter.in_reserve = self._standby.follow_both

    def _take_core(self) -> CorePlace | None:
        """Reserve the core that the wiring names. If it names none, reserve under SCHED_FIFO the core with the fewest
        other stations."""
        process = self._plan.wired.process
        fifo = realtime.use_fifo(process.priority + 1) is None
        if not fifo and process.cpu is None:
            return None
        place = CorePlace(process.cpu)
        self._plan.wired = replace(self._plan.wired, process=replace(process, cpu=place.core))
        self._core = place.core if fifo else None
        return place

    def run(self) -> Outcome:
        """Carry out the run, from the fork of the control process to the last reset."""
        for number in SIGNALS:
            calls.handle_signal(number, self._ask)
        calls.handle_signal(signal.SIGCHLD, signal.SIG_DFL)  # ignored, it would leave nobody to wait for
        flush()
        self._run_state.hold(Who.GUARDIAN)
        self._workers.fork()  # before the frames: who holds their pipe hides the end of the run
        if why := self._watcher.make():
            self._say(f"this run cannot be watched or traced, and keeps no values: {why}")
        kept = kept_values.take_over(self._plan, self._say)
        guardian = os.getpid()
        pid = self._run_state.fork(Who.CONTROL)
        if pid == 0:
            frames = self._watcher.frames
            control = Control(
                self._plan, self._device_claim, self._run_state, self._channel, guardian, frames, self._end, kept
            )
            carry_out(lambda: drive_and_report(control, self._traces))
        tell_who(self._channel, "control", pid)
        self._watcher.forked()
        self._control = ControlWatch(pid, self._run_state, self._traces.fileno())
        self._end.resetter.stand_by()
        self._tell_reserve()
        with suppress(Exception):
            realtime.prepare_guardian(self._process.priority, self._process.cpu)
        self._standby.appoint()
        self._run_state.admit()
        outcome = self._guard()
        self._standby.dismiss()
        return outcome

    @property
    def is_driving(self) -> bool:
        """True if the control process may be using the devices."""
        return self._run_state.admitted

    def give_up(self, outcome: Outcome) -> Outcome:
        """Return the outcome for the case that the guardian has failed and no other process can reset the machine. If
        an outcome was settled, return this one. Otherwise no actuator counts as reached, and the record of the start
        remains."""
        settled = Outcome.decode(self._run_state.settled())
        if settled is not None:
            return settled
        outcome.unsafe, outcome.unreached = True, list(self._end.resetter.paths)
        if outcome.failure is not None:
            outcome.failure.message += f"\nnot reached: {some(outcome.unreached)}; {INSPECT}"
        return outcome

    @property
    def is_followed(self) -> bool:
        """True if there is a living process that takes over when this process ends."""
        return self.is_driving and any(map(self._run_state.is_able, FOLLOWERS))

    def _guard(self) -> Outcome:
        """Watch the control process to its end, reset the machine if necessary, and record and report the outcome."""
        assert self._control is not None
        try:
            outcome = self._keep(self._control)
        except BaseException as error:  # whatever it is, the machine comes first
            outcome = self._end.step_in(self._control, f"the {self._end.title} failed: {text_of(error)}", self._say)
        with suppress(Exception):
            self._run_state.settle(outcome.encode())
        self._tell_service()
        self._end.tell(outcome)
        return outcome

    def _take_over(self) -> None:
        """Take over in the standby guardian when the guardian is dead. An outcome that was settled is only reported."""
        with suppress(Exception):
            realtime.prepare_guardian(self._process.priority, self._process.cpu)
        self._is_standby = True
        self._service.take_over()
        self._end.hand_over()
        settled = Outcome.decode(self._run_state.settled())
        if settled is not None:
            self._end.tell(settled)
        else:
            self._ask(signal.SIGTERM)  # a control process that is alive stops the machine by itself
            self._guard()

    def _keep(self, control: ControlWatch) -> Outcome:
        hung = self._watch(control)
        self._tell_service(hung)
        outcome = Outcome.decode(self._run_state.reported()) if self._run_state.stage is Stage.ENDED else None
        if outcome is None:
            why = control.silent(hung, self._watcher.moment) if hung else ""
            return self._end.step_in(control, why, self._say)
        if hung:  # in code of the application's, when the machine had been reset
            control.process.send(signal.SIGKILL)
        control.is_dead(DEATH_TIMEOUT)
        return self._end.settle(control.is_dead, outcome, self._say)

    def _tell_service(self, hung: str = "") -> None:
        """Tell the service manager that the machine stops, unless it was told."""
        self._try(lambda: self._service.stopping(hung or "every actuator goes to its default"))

    # While it runs -------------------------------------------------------------------------------------

    def _watch(self, control: ControlWatch) -> str:
        """Watch until the control process has ended, and return "". If it hangs, return as text how it hangs."""
        share = ProcessorShare(control.process, self._core, self._say)
        silence = HangDetector(self._run_state, share, self._process.hang_timeout, self._plan.wired.period or 0.0)
        while not self._run_state.gone(LOOK_INTERVAL):
            self._run_state.watch()
            self._look_around()
            if hung := silence.look():
                return hung
        return ""

    def _look_around(self) -> None:
        """Carry out the steps between two looks at the control process. If no client can ask for a stop, the guardian
        does."""
        self._deaf_looks = 0 if self._try(self._listen) else self._deaf_looks + 1
        if self._deaf_looks == MAX_DEAF_LOOKS:
            self._ask(signal.SIGTERM)
            self._try(self._pass_on)
        self._try(self._watcher.look)
        self._try(lambda: self._keeper.look(self._watcher.reader))
        self._try(self._service.look)
        if late:  # what is printed
            send_waiting()
        if not self._is_standby:
            self._try(self._standby.look)
            self._try(self._look_at_resetter)
            self._try(self._workers.look)

    def _look_at_resetter(self) -> None:
        try:
            is_replaced = self._end.resetter.look()
        except OSError as error:
            self._say(f"no reset process: {text_of(error)}; umo tries again")
            return
        if is_replaced:
            self._tell_reserve()
            self._say("the process that waits to reset the machine was killed or stopped; another one takes its place")

    def _tell_reserve(self) -> None:
        if pid := self._end.resetter.reserve:
            tell_who(self._channel, "reserve", pid)

    def _try(self, step: Callable[[], object]) -> bool:
        """Carry out a step. Return True if it succeeded. A failure is reported once."""
        try:
            step()
        except Exception as error:
            self._say(f"the {self._end.title} failed in a step and continues: {text_of(error)}")
            return False
        return True

    def _say(self, text: str) -> None:
        """Tell the user once."""
        if text not in self._said and len(self._said) < MAX_NOTICES:
            self._said.add(text)
            self._channel.send("notice", text=text)

    def _ask(self, number: int, frame: object = None) -> None:
        """Record the request to stop, as by this signal. Only the first request counts."""
        self._stop_signal = self._stop_signal or number

    def _listen(self) -> None:
        """Take the requests of the starter and of clients. A stop is requested by the starter, by a client, by a
        signal, or because the starter has ended."""
        while (message := self._channel.receive()) is not None:
            for file in message["files"]:
                calls.close(file)
            if message["kind"] == "stop":
                if self._stop_signal is not None and self._run_state.stage is Stage.STARTING:
                    self._insist()
                self._ask(_signal(message.get("signal")))
            elif message["kind"] == "keep":
                self._watcher.keep(ON_DEMAND)
        if self._channel.ended:
            self._ask(signal.SIGTERM)
        if (asked := self._watcher.stop) is not None:
            self._ask(asked)
        self._pass_on()

    def _insist(self) -> None:
        """Repeat the request to stop while the control process connects: a further signal ends code that does not end
        by itself (`umo.cycle.insisting`). The signal differs from the first one, because one of two equal pending
        signals would be lost."""
        assert self._control is not None
        self._control.process.send(signal.SIGINT)

    def _pass_on(self) -> None:
        """Ask the control process to stop, once."""
        if self._stop_signal is not None and not self._stop_passed_on:
            assert self._control is not None
            self._stop_passed_on = True
            self._run_state.ask(self._stop_signal)
            self._control.process.send(signal.SIGTERM)  # it ends a wait; what was asked stands in the shared memory


def _signal(number: object) -> int:
    """Return the number in a message if it is a signal that requests a stop; otherwise SIGTERM."""
    return number if isinstance(number, int) and number in STOP_SIGNALS else signal.SIGTERM
