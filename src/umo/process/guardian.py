"""The guardian: forks the control process, sees it die or hang, and brings the machine to its defaults then."""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import socket
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

from umo.process.control import Control, end
from umo.process.job import Job, Plan
from umo.process.life import Life, Stage
from umo.process.lock import lock_file, only_one
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome
from umo.process.record import Record
from umo.process.reset import Resetter, summary
from umo.process.watcher import Watcher
from umo.system import realtime

LOOK = 0.02
"""s between two looks at the starter and at the frames; death is seen at once."""
WHERE = signal.SIGUSR2
"""At this signal the control process writes down where its Python code stands."""
STARTING_LIMIT = 30.0
"""s that a step of connecting may take."""
BURIAL = 5.0
"""s that a killed process may take to end."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main(file: int) -> int:
    """A guardian process from its first message, the job, to its exit status."""
    channel = MessageSocket(socket.socket(fileno=file))
    message = channel.receive(None)
    if message is None:
        return 1
    try:
        job = Job.load(message["job"].encode())
        plan = Plan(job)
        with only_one(plan.place, plan.file):
            record = Record(lock_file(plan.place, plan.file), plan.name, plan.wiring_name)
            guardian = Guardian(plan, channel, record)
            record.begin(job.acknowledge)
            outcome = guardian.run()
    except Exception as error:
        outcome = Outcome(Failed.of(error))
    channel.send("ended", outcome=outcome.dump())
    return outcome.status


class Guardian:
    """Keeps one control process."""

    def __init__(self, plan: Plan, channel: MessageSocket, record: Record) -> None:
        self._plan = plan
        self._channel = channel
        self._record = record
        self._resetter = Resetter(plan.machine, plan.wired)
        self._process = plan.wired.process
        self._life = Life()
        self._stop: int | None = None
        self._stopping = False
        self._pid = 0
        self._status: int | None = None
        self._report, self._reporting = os.pipe()
        self._traces = tempfile.TemporaryFile()  # noqa: SIM115  (as long as the process)
        self._watcher = Watcher(plan.name)

    def run(self) -> Outcome:
        """From fork to the last reset."""
        for number in SIGNALS:
            signal.signal(number, self._ask)
        self._fork()
        realtime.guard(self._process.priority, self._process.cpu)
        try:
            return self._keep()
        finally:
            self._watcher.finish()

    def _keep(self) -> Outcome:
        hung = self._watch()
        if hung:
            return self._step_in(hung)
        if self._life.stage is not Stage.ENDED:
            return self._step_in("")
        self._bury()
        return self._settle(self._read_report())

    # While it runs -------------------------------------------------------------------------------------

    def _fork(self) -> None:
        guardian = os.getpid()
        held, holding = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            self._life.hold()
            os.write(holding, b"!")
            self._in_child(guardian)
        os.close(holding)
        os.close(self._reporting)
        os.read(held, 1)  # the child holds its lock, or is dead already
        os.close(held)

    def _in_child(self, guardian: int) -> None:
        """The control process; never returns."""
        try:
            control = Control(self._plan, self._life, self._channel, guardian, self._watcher.path)
            faulthandler.register(WHERE, file=self._traces, all_threads=False)
            outcome = control.run(lambda: self._stop)
            if outcome.unsafe:  # the guardian is gone: it is for this process to say so
                assert outcome.failure is not None
                self._record.stopped(outcome.failure.message, outcome.unreached)
                self._channel.send("ended", outcome=outcome.dump())
            with suppress(OSError):
                os.write(self._reporting, json.dumps(outcome.dump()).encode())
            self._life.enter(Stage.ENDED)
            end(outcome.status)
        except BaseException:
            sys.excepthook(*sys.exc_info())
        os._exit(1)

    def _watch(self) -> str:
        """Until the control process is gone (""), or hangs: then what is known of it."""
        while True:
            due = monotonic() + LOOK
            if self._life.gone(LOOK):
                return ""
            late = monotonic() - due
            self._listen()
            self._watcher.look()
            limit = self._limit()
            if self._life.silence > limit and late < limit / 2:  # else this computer stood still, not the process
                return f"no sign of life for {limit * 1e3:g} ms while {self._life.stage.name.lower()}"

    def _limit(self) -> float:
        stage = self._life.stage
        if stage is Stage.RUNNING:
            return self._process.hang_timeout
        return STARTING_LIMIT if stage is Stage.STARTING else self._resetter.limit

    def _ask(self, number: int, frame: object) -> None:
        self._stop = self._stop or number

    def _listen(self) -> None:
        """Requests to stop: from the starter, by its end, by a signal. Notes the ring of the control process."""
        while (message := self._channel.receive()) is not None:
            if message["kind"] == "stop":
                self._stop = self._stop or int(message.get("signal") or signal.SIGTERM)
            elif message["kind"] == "keep":
                self._watcher.keep("on demand")
        if self._channel.ended:
            self._stop = self._stop or signal.SIGHUP
        if self._stop is not None and not self._stopping:
            self._stopping = True
            os.kill(self._pid, self._stop)

    # Its end -------------------------------------------------------------------------------------------

    def _read_report(self) -> Outcome:
        """What the control process said at its end."""
        text = b""
        while data := os.read(self._report, 65536):
            text += data
        return Outcome.load(json.loads(text))

    def _step_in(self, hung: str) -> Outcome:
        """It is dead without having left, or it hangs: make sure that it is dead, and reset the machine."""
        where = self._where() if hung else ""
        stopped = hung and _is_stopped(self._pid)
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        left = self._reset(self._resetter.paths)
        if hung:
            what = f"the control process hung: {hung}{' (it was stopped by a signal)' if stopped else ''}{where}"
        else:
            what = f"the control process {_ending(self._status)}"
        what += self._write_down(what, list(left))
        self._watcher.keep(what)
        told = f"not reached: {summary(left)}" if left else "the guardian reset every actuator"
        return Outcome(Failed("ControlLost", f"{what}; {told}", 1), unsafe=True, unreached=list(left))

    def _settle(self, outcome: Outcome) -> Outcome:
        """The control process left by itself; what it could not reach is tried again."""
        if outcome.unreached:
            left = self._reset(outcome.unreached)
            outcome.unreached = list(left)
            assert outcome.failure is not None
            told = f"not reached: {summary(left)}" if left else "reset by the guardian afterwards"
            outcome.failure.message += f"\n{told}"
            if left:
                outcome.unsafe = True
            else:
                outcome.failure.status = 1
        if outcome.unsafe:
            assert outcome.failure is not None
            self._write_down(outcome.failure.message.partition("\n")[0], outcome.unreached)
        else:
            self._record.finish()
        if outcome.failure is not None:
            self._watcher.keep(outcome.failure.message.partition("\n")[0])
        return outcome

    def _write_down(self, what: str, unreached: list[str]) -> str:
        """For the next start; where that cannot be done, say so."""
        try:
            self._record.stopped(what, unreached)
        except OSError as error:  # the record of the start stands all the same
            return f" (this could not be written down: {error})"
        return ""

    def _reset(self, paths: list[str]) -> dict[str, str]:
        return self._resetter.reset(
            paths,
            self._process.reset_for,
            once_dead=self._bury,
            said=lambda text: self._channel.send("notice", text=text),
        )

    def _bury(self) -> None:
        """Wait for the end of the control process: its connections are closed then. One that sticks in the kernel,
        in a call of its device, cannot be waited for."""
        until = monotonic() + BURIAL
        while self._status is None and monotonic() < until:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._status = status
            else:
                sleep(0.0005)

    def _where(self) -> str:
        """Where the Python code of a hanging process stands, as far as it can still tell."""
        with suppress(OSError):
            os.kill(self._pid, WHERE)
            sleep(0.003)
            lines = os.pread(self._traces.fileno(), 4096, 0).decode(errors="replace").splitlines()
            for line in lines:
                if line.strip().startswith("File "):
                    return f", at {line.strip().removeprefix('File ')}"
        return ""


def _is_stopped(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
    return False


def _ending(status: int | None) -> str:
    if status is None:
        return "cannot be ended: it sticks in a call of the kernel"
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        what = "was killed" if number in (signal.SIGKILL, *SIGNALS) else "crashed"
        return f"{what} ({signal.Signals(number).name})"
    return f"ended with status {os.WEXITSTATUS(status)} and did not leave"
