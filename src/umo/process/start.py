"""Functions that start a machine in separate processes, and control it from a program."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from types import TracebackType
from typing import Any

from umo.cycle.stage import Progress, Stage
from umo.errors import DriverError, FramesError, TaskFailed
from umo.exit_status import ExitStatus
from umo.objects import Compound
from umo.objects.presentation.html_table import html_table, never_raises
from umo.process.frames import Reader
from umo.process.frames.memory import RunDescriptors
from umo.process.frames.run_reader import progress_of
from umo.process.frames.search import station_name
from umo.process.job import Job, reference
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome
from umo.system import calls, descriptors, notify
from umo.system.device_record import INSPECT
from umo.system.processes import ENDED, HASH_SEED, STOPPED, Child, ProcessHandle, known, wait_until
from umo.system.realtime import Refusal
from umo.system.signal_handling import SIGNALS, signal_name
from umo.text import some

LINUX = sys.platform.startswith("linux")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""The environment in which numpy starts no threads, because the loop's process must have only one thread."""
FIXED_HASHES = {HASH_SEED: "0"}
"""The environment in which sets of strings have the same order in each run, so that a recording of the run can be
replayed. The user's environment can override it."""

CONTROL = "control process"
GUARDIANS = ("guardian", "standby guardian", "reset process")
"""The processes that can stop and reset the machine."""
NAMES = {"control": CONTROL, "running": CONTROL, "standby": "standby guardian", "reserve": "reset process"}
"""The process to which a message of each kind refers."""
STOPPED_LOOK_INTERVAL = 0.5
"""Time in s between two looks for processes that were stopped by a signal."""
START_STOP_TIMEOUT = 10.0
"""The timeout in s for the end of a guardian that was requested to stop before it guards. A station's code may ignore
such a request."""
GUARDIAN_END_TIMEOUT = 2.0
"""Timeout in s for the end of a guardian that has reported the outcome."""
UNKNOWN_TIMEOUT = 2.0
"""The timeout in s, after all processes that the starter knows have ended, for processes that were not reported to the
starter: a worker that still resets its device, or a process that was stopped by a signal before anything was driven."""
STANDBY_END_TIMEOUT = 1.0
"""Timeout in s for the end of a standby guardian that has reported the outcome."""


class RunFailed(TaskFailed):
    """The run of a machine in its own processes failed; `outcome` has the details."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.failure.message if outcome.failure else "the machine failed")
        self.outcome = outcome


def start(
    station: str | Path | Callable[[], Compound],
    wiring: str | Path | Mapping[str, Any] | None = None,
    application: Callable[..., Coroutine[Any, Any, Any]] | None = None,
    *,
    acknowledge: bool = False,
    manual: bool = False,
    fresh: bool = False,
    **options: Any,
) -> Started:
    """Start a machine with a guardian and a control process. Returns immediately.

        with umo.start("ztheta", "modbus", parts=2) as machine:
            outcome = machine.wait()

    `station` is a station's name or folder, or a function that declares the machine; a function needs an `application`.
    Both functions must be importable by another process, so they cannot be defined in a notebook. `wiring` is the name
    of a wiring of the station, a file, or the contents of a file. `options` are passed to the application and the
    drivers, as on the command line. `acknowledge` starts a machine whose last run ended unsafely. `manual` starts in
    manual mode, in which the application waits (`umo.attach`). `fresh` starts without the kept values of the last run.
    Linux only (DriverError elsewhere). If the other process finds an error, such as an unknown option or a mistake in
    the wiring, `wait` raises RunFailed.
    """
    if callable(station):
        machine, script = reference(station)
        main, other = (None, None) if application is None else reference(application)
        job = Job(machine=machine, application=main, script=script or other)
    else:
        job = Job(station=str(station))
    job.wiring = str(wiring) if isinstance(wiring, Path) else dict(wiring) if isinstance(wiring, Mapping) else wiring
    job.options, job.acknowledge, job.manual, job.fresh = options, acknowledge, manual, fresh
    return Started(job)


class Started:
    """A machine that runs in other processes. The machine is stopped when the `with` block, or this program, ends."""

    def __init__(self, job: Job, *, is_service: bool = False) -> None:
        """`is_service`: True if this program exists only for the run; then the run reports to a service manager in
        place of the program."""
        if not LINUX:
            raise DriverError("umo.start needs Linux; virtual time works everywhere")
        descriptors.ensure()
        self.pid: int | None = None
        """The pid of the control process, once it is running."""
        self.frames: Reader | None = None
        """The reader of all frames from the first one on; None before the machine runs. Use it in one place only."""
        self.refusals: list[Refusal] = []
        """The real-time settings that the operating system did not permit."""
        self.notices: list[str] = []
        self._outcome: Outcome | None = None
        self._left_outcome: Outcome | None = None
        """The outcome that the control process has sent at its end. The outcome of the guardian takes precedence."""
        self._is_safe = False
        """True if the guardian has found the end safe, and may have removed the records of the run."""
        self.standby = 0
        """The standby guardian's pid, once it is known; 0 before."""
        self.reserve = 0
        """The pid of the reset process that follows both guardians, once it is known; 0 before."""
        self._others: dict[str, ProcessHandle] = {}
        """The other processes of the run, by their functions."""
        self._stop_asked = False
        """True if a stop was requested."""
        self._start_limit = inf
        """The time at which a guardian that was requested to stop and has not forked anything is killed."""
        self._give_up = inf
        """Time at which the wait ends, because all known processes have ended."""
        self._next_look = 0.0
        """Time of the next look for stopped processes."""
        self._guardian_has_ended = False
        """True if the guardian had reported the outcome and its end was awaited."""
        self._lock = threading.RLock()
        self._name = job.name
        text = job.dump()
        environ = dict(os.environ)
        if not is_service:
            notify.without(environ)
        self._channel, there = MessageSocket.pair()
        with there, tempfile.TemporaryFile() as file:
            file.write(text)
            file.seek(0)
            files = [there.fileno(), file.fileno()]
            before = calls.mask_signals(signal.SIG_BLOCK, SIGNALS)  # for the guardian, until it handles them
            try:
                self._guardian = self._begun(files, environ, job)
            finally:
                calls.mask_signals(signal.SIG_SETMASK, before)
        self._others["guardian"] = self._guardian

    def _begun(self, files: list[int], environ: dict[str, str], job: Job) -> Child:
        """Start the process of the guardian, which inherits these files: its end of the channel, and the job. The
        process has a separate session, so that Ctrl-C at the terminal reaches only the starter, which passes it on."""
        words = [sys.executable, "-m", "umo.process", *map(str, files), station_name(job.name)]
        path = {"PYTHONPATH": os.pathsep.join(filter(None, job.path))}
        return Child(calls.start_program(words, files, FIXED_HASHES | environ | path | ONE_THREAD))

    @property
    def guardian(self) -> int:
        """The guardian's pid."""
        return self._guardian.pid

    @property
    def stage(self) -> Stage:
        """The stage of the run: STARTING, RUNNING or ENDED."""
        self.poll()
        if self._outcome is not None:
            return Stage.ENDED
        return Stage.STARTING if self.pid is None else Stage.RUNNING

    @property
    def values(self) -> dict[str, float | str]:
        """The latest values by path: a number in its unit, or the name of a state. Empty before the first frame."""
        self.poll()
        frame = None if self.frames is None else self.frames.latest()
        return {} if self.frames is None or frame is None else self.frames.values(frame)

    @property
    def progress(self) -> Progress:
        """The progress of its work that the machine reported last (`m.cycle.progress`)."""
        self.poll()
        return progress_of(None if self.frames is None else self.frames.latest())

    @property
    def outcome(self) -> Outcome | None:
        """The outcome of the run; None while it runs."""
        self.poll()
        return self._outcome

    @never_raises
    def _repr_html_(self) -> str:
        outcome = self.outcome
        failed = outcome.failure.message if outcome is not None and outcome.failure is not None else ""
        facts = {"state": str(self.stage), "failure": failed}
        return html_table("machine", facts, []) if self.frames is None else self.frames.html(more=facts)

    def poll(self, timeout: float = 0.0) -> None:
        """Process messages of the other processes. Wait up to `timeout` s for a message. Any thread may call this."""
        with self._lock:
            while self._outcome is None and (message := self._channel.receive(timeout)) is not None:
                timeout = 0.0
                self._note(message)
            if self._outcome is None and (self._channel.ended or self._nobody_is_left()):
                objects = () if self.frames is None else self.frames.layout.described.objects
                actuators = [each.path for each in objects if each.is_actuator]
                self._outcome = vanished(
                    self._end_of_guardian(),
                    self._left_outcome,
                    actuators,
                    self._name,
                    running=self.pid is not None,
                    safe=self._is_safe,
                )
            if self._outcome is None:
                if calls.now() > self._start_limit and not self._is_under_way:
                    self._guardian.send(signal.SIGKILL)
                self._look_for_stopped()
            elif not self._guardian_has_ended:
                self._end_of_guardian()
                if not self._channel.peer_is_gone(STANDBY_END_TIMEOUT):  # the standby guardian holds the devices
                    self._end_stopped()

    def _end_stopped(self) -> None:
        """Kill the processes that were stopped by a signal after the end of the run. They have nothing left to do, and
        would hold the devices until they continue."""
        for process in self._others.values():
            if process.is_stopped:
                process.send(signal.SIGKILL)

    @property
    def _is_under_way(self) -> bool:
        """True if the guardian has begun to guard; before that nothing is driven."""
        return bool(self.standby or self.reserve or self.pid)

    def _nobody_is_left(self) -> bool:
        """True if all known processes have ended, and other holders of the channel have had time to end, too."""
        if all(process.ended for process in self._others.values()):
            self._give_up = min(self._give_up, calls.now() + UNKNOWN_TIMEOUT)
        else:
            self._give_up = inf
        return calls.now() > self._give_up

    def _end_of_guardian(self) -> int:
        """Return the exit status of a guardian that has reported the outcome, or has closed its end of the channel. If
        it does not end then, it was stopped by a signal and is killed: it has nothing left to do."""
        guardian = self._guardian
        ended = wait_until(lambda: guardian.ended, GUARDIAN_END_TIMEOUT) or guardian.end(GUARDIAN_END_TIMEOUT)
        self._guardian_has_ended = ended
        if not ended:
            return -signal.SIGKILL  # blocked in a call of the kernel: it ends after that
        return 0 if guardian.status is None else os.waitstatus_to_exitcode(guardian.status)

    def _look_for_stopped(self) -> None:
        """Add a notice if no process can stop the machine, because each has died or was stopped by a signal. When a
        stop is requested, the stopped processes are continued."""
        if calls.now() < self._next_look:
            return
        self._next_look = calls.now() + STOPPED_LOOK_INTERVAL
        states = {name: process.state for name, process in self._others.items()}
        if any(states.get(name, "X") not in STOPPED + ENDED for name in GUARDIANS):
            return
        stopped = {name: self._others[name] for name in (*GUARDIANS, CONTROL) if states.get(name, "X") in STOPPED}
        if not stopped:
            return
        told = ", ".join(f"{name} ({process.pid})" for name, process in stopped.items())
        hint = (
            f"to let these processes continue: kill -CONT {' '.join(str(process.pid) for process in stopped.values())}"
        )
        if self._stop_asked:
            hint = "umo lets these processes continue now, to stop the machine"
            for process in reversed(stopped.values()):
                process.send(signal.SIGCONT)
        text = f"nothing can stop the machine: stopped by a signal: {told}; {hint}"
        if text not in self.notices:
            self.notices.append(text)

    def wait(self, timeout: float | None = None) -> Outcome:
        """Wait for the end and return the outcome. Raises TimeoutError after `timeout` s, RunFailed if the run
        failed."""
        until = None if timeout is None else calls.now() + timeout
        while self._outcome is None:
            if until is not None and calls.now() >= until:
                raise TimeoutError(f"the machine is still running after {timeout:g} s")
            self.poll(0.1 if until is None else max(0.0, min(0.1, until - calls.now())))
        if self._outcome.failure is not None:
            raise RunFailed(self._outcome)
        return self._outcome

    def ask_to_stop(self, number: int = signal.SIGTERM) -> None:
        """Request a safe stop, like this signal. Returns immediately."""
        self._stop_asked = True
        self._channel.send("stop", signal=number)
        if not self._is_under_way:  # it may be at work in the station's own code, and does not listen
            self._start_limit = min(self._start_limit, calls.now() + START_STOP_TIMEOUT)
            self._guardian.send(number)

    def stop(self) -> Outcome:
        """Stop safely, wait for the end and return the outcome."""
        self.ask_to_stop()
        while self._outcome is None:
            self.poll(0.1)
        return self._outcome

    def keep_black_box(self) -> None:
        """Write the last periods to a file, for `umo show why`."""
        self._channel.send("keep")

    def __enter__(self) -> Started:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        ended = self._outcome is not None
        outcome = self.stop()
        self._channel.close()
        if kind is None and not ended and outcome.failure is not None:
            raise RunFailed(outcome)

    def _note(self, message: dict[str, Any]) -> None:
        kind = message["kind"]
        if (name := NAMES.get(kind)) and (process := known(message["pid"], message["identity"])) is not None:
            self._others[name] = process
        if kind == "running":
            self.pid = message["pid"]
            self.refusals = [Refusal(*refusal) for refusal in message["refusals"]]
            if len(message["files"]) == len(RunDescriptors._fields):
                ends = RunDescriptors(*message["files"])
                message["files"] = ()
                with suppress(FramesError):
                    self.frames = Reader("the run", ends)
        elif kind == "reserve":
            self.reserve = message["pid"]
        elif kind == "standby":
            self.standby = message["pid"]
        elif kind == "notice":
            self.notices.append(message["text"])
        elif kind == "left":
            self._left_outcome = Outcome.load(message["outcome"])
        elif kind == "safe":
            self._is_safe = True
        elif kind == "ended":
            self._outcome = Outcome.load(message["outcome"])
        for file in message["files"]:
            calls.close(file)


def vanished(
    status: int, left: Outcome | None, actuators: Sequence[str], name: str, *, running: bool, safe: bool
) -> Outcome:
    """Return the outcome for the case that no process has reported it. It is derived from the guardian's exit status,
    and from the report of the control process, if there is one. `actuators`: the known actuators of the machine.
    `name`: the name of the station. `running`: whether the machine had been started. `safe`: whether the guardian has
    found the end safe, and may have removed the records that the next run would have to acknowledge."""
    if status < 0 and left is not None:
        what = f"the guardian was killed ({signal_name(-status)}) after the control process had ended; "
        what += f"{left.outputs}; the next start may need --acknowledge" if safe else INSPECT
        if left.failure is None:
            left.failure = Failed("GuardianLost", what, 1)
        else:
            left.failure.message += f"\n{what}"
        left.unsafe = not safe
        return left
    if status == 0:
        return Outcome()
    if status > 128:
        return Outcome(stopped_by=status - 128)
    unreached = f"not reached: {some(actuators) or f'any actuator of {name}'}; {INSPECT}"
    if status > 0 or not running:
        when = "" if running else " before the machine was started"
        text = f"the guardian ended with status {status}{when}; its report was lost"
        if status != ExitStatus.UNREACHED:
            return Outcome(Failed("Lost", text, max(status, 1)))
        return Outcome(Failed("Lost", f"{text}\n{unreached}", status), unsafe=True, unreached=list(actuators))
    text = (
        "guardian, standby guardian and control process have all ended without resetting the actuators; "
        "only watchdogs of the circuits, and worker processes, can have reset them"
    )
    return Outcome(
        Failed("Vanished", f"{text}\n{unreached}", ExitStatus.UNREACHED), unsafe=True, unreached=list(actuators)
    )
