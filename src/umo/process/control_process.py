"""The control process: it connects the machine, runs the loop and nothing else, disconnects safely, and reports."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from math import inf
from types import MappingProxyType
from typing import IO, Any

from umo.cycle.cache_warming import wait_busily
from umo.cycle.connect import connect
from umo.cycle.events import CommandState
from umo.cycle.frame import Frame
from umo.cycle.machine import ConnectedMachine
from umo.cycle.run import drive, result_of
from umo.cycle.stage import Stage
from umo.cycle.stopping import TimeLimit, end_forked, request_stop
from umo.errors import FramesError, StopError, text_of
from umo.objects.stop_order import stop_sequence
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.client_control import ClientControl
from umo.process import kept_values
from umo.process.compiling import start_compiled
from umo.process.control_watch import WHERE_SIGNAL
from umo.process.frames import Ring, published
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.command_queue import Receiver
from umo.process.frames.frame_server import FrameServer
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.publish import tell
from umo.process.hang_detection import LOOK_INTERVAL, STARVED_LIMITS, guardian_limit
from umo.process.job import Plan
from umo.process.job_facts import job_facts
from umo.process.kept_file import NUMBERS
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome, plain, plain_reports, status_of
from umo.process.reset import DEATH_TIMEOUT
from umo.process.run_end import RunEnd, tell_final_message
from umo.process.run_state import FOLLOWERS, RunState, Who
from umo.system import calls, realtime
from umo.system.device_record import DeviceClaim
from umo.system.processes import adjust_oom_score, identity, name_process, parent_of_this
from umo.system.signal_handling import SIGNALS
from umo.system.streams import late, limit_waits, lost_lines, never_wait, send_waiting
from umo.text import Moment, in_brackets

RESUMING_TIMEOUT = 0.1
"""The timeout in s for a guardian's heartbeat after a suspended computer resumes: the time of five looks."""

OOM_SCORE_CHANGE = 100
"""The change of the control process's score by which the kernel selects a process to kill when memory runs out. It is
chosen so that a guardian remains, which resets the machine."""
ADMISSION_INTERVAL = 0.0005
"""The time in s between two checks whether the control process may begin."""
ADMISSION_TIMEOUT = 10.0
"""The timeout in s for the guardian's heartbeats before the control process begins."""


class Control:
    """The run of one plan in the calling process, which the guardian has forked."""

    def __init__(
        self,
        plan: Plan,
        device_claim: DeviceClaim,
        run_state: RunState,
        channel: MessageSocket,
        guardian: int,
        frames: tuple[RunDescriptors, FrameServer] | None,
        run_end: RunEnd | None = None,
        kept: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self._plan = plan
        self._device_claim = device_claim
        self._run_state = run_state
        self._channel = channel
        self._guardian = guardian
        self._frames = frames
        """The descriptors of the memory for frames, and the server that gives clients descriptors; None without
        frames."""
        self._run_end = run_end
        """The work of a guardian at the end of the run, for the case that no guardian is left."""
        self._stands_in = False
        """True if this process does the work of a guardian."""
        self._kept = kept
        """The kept values of the last run, by section."""
        self._stopped_by = ""
        self._hang = plan.wired.process.hang_timeout
        self._unwatched_limit = guardian_limit(self._hang)
        self._watchdog = min(plan.wired.watchdogs.values(), default=inf)
        """Time in s without a period after which a circuit may have reset its outputs by itself."""
        self._gap = min(self._hang, self._watchdog)
        self._most_excused = (STARVED_LIMITS - 1) * self._hang
        """The time in s for which other processes may keep this process from running."""
        self._alarm = ""
        self._order = stop_sequence(plan.machine)
        self._connection: connect[Any] | None = None

    def take_note(self, number: int, frame: object) -> None:
        """Record a signal that requests a stop before the machine is connected. A request of the guardian takes
        precedence."""
        if not self._run_state.asked:
            self._run_state.ask(number)

    def wait_for_admission(self) -> None:
        """Wait for the standby guardian, then use the devices. No device is driven before. The process ends if the
        guardian dies or gives no heartbeat."""
        while not self._run_state.admitted:
            if self._run_state.gone(ADMISSION_INTERVAL, Who.GUARDIAN) or self._run_state.unwatched > ADMISSION_TIMEOUT:
                calls.exit_now(1)
        self._device_claim.hold.used_here()

    def stand_aside(self) -> None:
        """Give up the devices, in a process that control code has forked. That process ends as soon as it tries to use
        a device."""
        if self._stands_in:
            return

        if self._connection is not None:
            self._connection.refuse(lambda *_: end_forked(self._plan.name))
        for give_up in (self._device_claim.hold.release, self._channel.close, self._leave_frames):
            with suppress(OSError):  # control code has closed its descriptor
                give_up()

    def _leave_frames(self) -> None:
        """Release the frames in a process that does not write them. A process that it forks does not release them
        again: the descriptor may belong to another file."""
        frames, self._frames = self._frames, None
        if frames is not None:
            calls.close(frames[0].alive)
            frames[1].leave()

    def say_how_it_ended(self, outcome: Outcome) -> None:
        """Print how the run ended. This text remains if all processes that could add to it are killed. An unsafe end
        without the guardian is recorded; it is also printed if there is no standby guardian that prints it."""
        self._channel.send("left", outcome=outcome.dump())
        if outcome.unsafe:
            assert outcome.failure is not None
            if told := self._device_claim.stopped(outcome.failure.message, outcome.unreached):
                outcome.failure.message += f"; {told}"
            self._end_guardian()
            if self._is_alone():
                self._run_state.note_told()
                tell_final_message(self._channel, self._plan.name, outcome)

    def reset_if_alone(self, outcome: Outcome) -> Outcome:
        """Retry the reset in this process if actuators were not reached and no guardian is left to retry it. The
        devices are opened again, including those of drivers off the cycle, whose worker may be dead."""
        if not (outcome.unreached and outcome.unsafe and self._run_end is not None):
            return outcome
        self._end_guardian()
        if not (self._run_state.gone(DEATH_TIMEOUT, Who.GUARDIAN) and self._is_alone()):
            return outcome
        self._stands_in = True
        self._run_end.title = "control process"
        self._run_end.resetter.hand_over()
        outcome = self._run_end.settle(self._sends_heartbeat, outcome, lambda text: None)
        self.report(outcome)
        return outcome

    def _sends_heartbeat(self) -> bool:
        """Give a heartbeat, and return True: this process lives and may still use a device."""
        self._run_state.beat()
        return True

    def _end_guardian(self) -> None:
        """End a guardian that was stopped. It is this process's parent as long as it lives."""
        if (guardian := parent_of_this(self._guardian)) is not None:
            guardian.send(signal.SIGKILL)

    def _is_alone(self) -> bool:
        """Return True if no process can take the guardian's place. Processes that could do so, but were stopped or
        killed, are ended first."""
        if any(map(self._run_state.is_able, FOLLOWERS)):
            return False
        for who in FOLLOWERS:
            self._run_state.end(who, DEATH_TIMEOUT)
        return True

    @property
    def keeps_time(self) -> bool:
        """True if the loop runs by the wall clock, so that no printed output may delay it."""
        return self._plan.wired.realtime

    def tell_lost_lines(self) -> None:
        """Report the number of lines of this process that were lost because nothing read them."""
        if lost := send_waiting():
            self._channel.send("notice", text=f"{self._plan.name}: {lost_lines(lost)}")

    def run(self) -> Outcome:
        """Connect, drive and disconnect. Return the outcome, which contains any error."""
        outcome = Outcome()
        error: BaseException | None = None
        calls.die_with_parent(self._guardian, signal.SIGTERM)
        try:
            self._work(outcome)
        except BaseException as caught:
            error = caught
        self._judge(outcome, error)
        result, outcome.result = outcome.result, None
        self.report(outcome)  # the status stands; texts of errors and results call code of the application's
        if self._connection is not None:
            result = result_of(result, self._connection)
        outcome.result = plain(result)
        if error is not None:
            outcome.failure = Failed.of(error)
        if self._connection is not None:
            outcome.reports = plain_reports(self._connection.reports)
        self.report(outcome)
        return outcome

    def report(self, outcome: Outcome) -> None:
        """Report how the machine ended. The report remains valid if this process is killed or hangs before the next
        report."""
        self._run_state.report(outcome.encode())
        self._run_state.enter(Stage.ENDED)

    def _judge(self, outcome: Outcome, error: BaseException | None) -> None:
        """Record what is known of the end without calling the user's code."""
        if error is not None:
            outcome.failure = Failed(
                type(error).__name__, f"{type(error).__name__} (its message was lost)", status_of(error)
            )
        outcome.driven = self._connection is not None and self._connection.started
        if self._connection is not None and not self._connection.reached:
            actuators = [item.path for item in self._order]
            named = {failure.path for failure in error.failures} if isinstance(error, StopError) else set()
            outcome.unreached = sorted(named & set(actuators)) or actuators  # leaving itself failed: nothing is known
        if self._guardian_lost():
            self._alarm = self._alarm or "the guardian has ended"
            outcome.unsafe = True
        if self._alarm and outcome.failure is None:
            moment = in_brackets(Moment.at(outcome.simulated))
            what = f"{self._alarm}; the control process stopped the machine{moment}"
            outcome.failure = Failed("Stopped", what, 1)

    def _guardian_lost(self) -> bool:
        """True if the guardian has ended or hangs. After the whole computer stood still it needs a moment for its next
        heartbeat."""
        until = calls.now() + RESUMING_TIMEOUT
        while not self.orphaned and self._run_state.unwatched > self._unwatched_limit:
            if calls.now() > until:
                return True
            calls.sleep(LOOK_INTERVAL)
        return self.orphaned

    @property
    def orphaned(self) -> bool:
        """True if the guardian has ended."""
        return os.getppid() != self._guardian

    def _work(self, outcome: Outcome) -> None:
        plan = self._plan
        process = plan.wired.process
        refusals = realtime.prepare(process.priority, process.cpu)
        busy_wait = process.busy_wait
        if busy_wait is None:  # asked now: connecting may take so long that the guardian makes this an ordinary process
            busy_wait = realtime.default_busy_wait(plan.wired.period or 0.0, process.compile)
        self._connection = connection = connect(plan.machine, plan.wired)
        connection.device_claim = self._device_claim
        connection.on_step = self._run_state.beat
        connection.kept = self._kept.get(NUMBERS, {})
        connection.states = self._kept
        connection.laid_out = self._start_compiled
        with connection as machine:
            for text in kept_values.tell(connection):
                self._channel.send("notice", text=text)
            try:
                with self._published(connection) as ring, self._commanded(connection, ring):
                    connection.machine.observers.append(self.each_period)
                    if plan.job.until is not None:
                        connection.machine.observers.append(TimeLimit(plan.job.until, connection.stop))
                    self._ready(connection, ring, refusals, busy_wait)
                    try:
                        outcome.result = drive(machine, plan.application)
                    finally:
                        connection.stop.signal = self._run_state.asked or connection.stop.signal
                        if self._alarm:
                            tell(connection.machine, CommandState.FAILED, self._alarm)
            finally:
                self._run_state.enter(Stage.STOPPING)
                outcome.stopped_by = None if self._alarm else self._run_state.asked or connection.stop.signal
                outcome.time_over = connection.stop.time_over and outcome.stopped_by is None
                outcome.stopped_who = "" if outcome.stopped_by is None else self._stopped_by
                outcome.simulated = machine.now

    def _start_compiled(self, machine: ConnectedMachine) -> None:
        start_compiled(self._plan.prepared, machine, lambda text: self._channel.send("notice", text=text))

    @contextmanager
    def _published(self, connection: connect[Any]) -> Iterator[Ring | None]:
        """Publish frames for observers. The machine runs without them if there is not enough memory."""
        if self._frames is None:
            yield None
            return
        with ExitStack() as stack:
            ring, plan = None, self._plan
            try:
                frames = published(
                    connection,
                    plan.name,
                    plan.wiring_name,
                    place=plan.place,
                    options=plan.machine_options,
                    job=job_facts(plan, self._kept),
                    ends=self._frames[0],
                )
                ring = stack.enter_context(frames)
            except (FramesError, OSError) as error:
                text = f"this run cannot be watched or traced, and keeps no values: {text_of(error)}"
                self._channel.send("notice", text=text)
            yield ring

    @contextmanager
    def _commanded(self, connection: connect[Any], ring: Ring | None) -> Iterator[None]:
        """Take commands from outside. This requires frames, in which the answers are given."""
        if ring is None or self._frames is None:
            yield
            return
        machine, cells = connection.machine, ClientMemory(self._frames[0].cells, ring.layout)
        mode = Mode.MANUAL if self._plan.job.manual else Mode.AUTOMATIC
        clients = machine.attach(ClientControl(Receiver(cells), cells, mode))
        ring.show(clients)
        try:
            self._frames[1].listen()
        except FramesError as error:
            self._channel.send("notice", text=f"this run cannot be found by other programs: {text_of(error)}")
        self._frames[1].leave()  # the guardian's looks answer clients
        try:
            yield
        finally:
            clients.look_for_stop()  # a signal may have been quicker
            self._stopped_by = clients.stopped_by

    def each_period(self, frame: Frame) -> None:
        """Give a heartbeat, and check whether this process was suspended, was requested to stop, or has lost its
        guardian. Called in each period."""
        run_state = self._run_state
        excused = run_state.excused  # first: a look of the guardian's that sees the new heartbeat ends it
        gap = run_state.beat()
        if gap > self._gap and (gap > self._watchdog or gap - min(excused, self._most_excused) > self._hang):
            self._stop(
                f"no period ended for {gap:.1f} s, limit {self._gap:g} s: control code or a driver took too long, "
                f"other processes had the processors, or the processes or the computer were suspended"
            )
        elif run_state.asked:
            request_stop(run_state.asked)
        elif run_state.unwatched > self._unwatched_limit:
            self._stop(f"no heartbeat from the guardian for {run_state.unwatched:.1f} s")
        if late:  # what is printed
            send_waiting()

    def _stop(self, why: str) -> None:
        self._alarm = self._alarm or why
        request_stop()

    def _ready(
        self, connection: connect[Any], ring: Ring | None, refusals: list[realtime.Refusal], busy_wait: float
    ) -> None:
        gc.freeze()
        wait_busily(self._plan.wired, busy_wait)
        self._stop_if_asked()
        if not connection.machine.stop.requested:
            connection.machine.skip_ticks()
        if threading.active_count() > 1:
            others = [thread.name for thread in threading.enumerate() if thread is not threading.main_thread()]
            text = f"the control process has other Python threads, which will delay it: {', '.join(others)}"
            self._channel.send("notice", text=text)
        connection.stop.insists = False  # from here on code that does not end is the guardian's to end
        self._run_state.enter(Stage.RUNNING)  # first: who is told so may count on it
        self._channel.send(
            "running",
            pid=os.getpid(),
            identity=identity(os.getpid()),
            guardian=self._guardian,
            files=[] if ring is None or self._frames is None else self._frames[1].ends,
            refusals=refusals,
        )
        self._stop_if_asked()

    def _stop_if_asked(self) -> None:
        """Request the stop if one was requested earlier, when no period could check for it."""
        if self.orphaned or self._run_state.asked:
            request_stop(self._run_state.asked or None)


def drive_and_report(control: Control, traces: IO[bytes]) -> int:
    """Run the control process to its exit status. On request the process writes the present line of its code to
    `traces`."""
    name_process("umo control")
    adjust_oom_score(OOM_SCORE_CHANGE)
    os.register_at_fork(after_in_child=control.stand_aside)
    for number in SIGNALS:  # until the machine is connected
        calls.handle_signal(number, control.take_note)
    control.wait_for_admission()
    never_wait() if control.keeps_time else limit_waits()
    faulthandler.register(WHERE_SIGNAL, file=traces, all_threads=False)
    outcome = control.run()
    outcome = control.reset_if_alone(outcome)
    control.tell_lost_lines()
    control.say_how_it_ended(outcome)
    return outcome.status
