"""The guardian: forks the control process, watches it, and resets the machine if it dies or hangs.

It reserves everything that a reset needs at its start: a standby child, descriptors, shared memory. It resets the
machine after any error of its own, and whenever the control process has not reported that every actuator is at its
default.
"""

from __future__ import annotations

import faulthandler
import os
import re
import signal
import socket
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import NoReturn

from umo.cycle.stage import Stage
from umo.cycle.stopping import SIGNALS, signal_name
from umo.process.control_process import Control, end
from umo.process.job import Job, Plan
from umo.process.last_words import say_last
from umo.process.life import Life
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome
from umo.process.reset import BURIAL, Resetter, summary
from umo.process.watcher import Watcher
from umo.system import realtime
from umo.system.custody import Custody
from umo.system.streams import keep_open, log_on_lines
from umo.text import cause_of, in_brackets, place_among

LOOK = 0.02
"""s between two looks at the starter and at the frames; death is seen at once."""
LOOKS = 3
"""The minimum number of looks without a sign of life before the control process counts as hung."""
WHERE = signal.SIGUSR2
"""At this signal the control process writes down where its Python code stands."""
STARTING_LIMIT = 30.0
"""Timeout in s of a step of connecting, in addition to two periods."""
REPORTING_LIMIT = 5.0
"""s that the control process may take for its report when the machine has been reset."""
SPARES = 4
"""Descriptors kept free for the end."""


def main(file: int, job_file: int) -> int:
    """A guardian process from its job to its exit status."""
    keep_open()  # what is printed, here or in the control process, cannot end a run
    log_on_lines()
    channel = MessageSocket(socket.socket(fileno=file))
    custody = guardian = None
    name = "the run"
    try:
        with open(job_file, "rb") as opened:
            job = Job.load(opened.read())
        plan = Plan(job)
        name = plan.name
        custody = Custody(plan.wired.devices, plan.name, plan.wiring_name, acknowledge=job.acknowledge)
        guardian = Guardian(plan, channel, custody)
        outcome = guardian.run()
    except BaseException as error:
        outcome = Outcome(Failed.of(error))
        if custody is not None and (guardian is None or not guardian.forked):  # so nothing was driven
            custody.abandon()
    channel.send("ended", outcome=outcome.dump())
    say_last(channel, name, outcome)
    return outcome.status


class Guardian:
    """Keeps one control process."""

    def __init__(self, plan: Plan, channel: MessageSocket, custody: Custody) -> None:
        self._plan = plan
        self._channel = channel
        self._custody = custody
        self._process = plan.wired.process
        self._life = Life()
        self._stop: int | None = None
        self._asked = False
        self._pid = 0
        self._status: int | None = None
        self._given_up = 0.0
        """Time at which waiting for a process that cannot be killed ends."""
        self._spares = [os.open(os.devnull, os.O_RDONLY) for _ in range(SPARES)]
        self._traces = tempfile.TemporaryFile()  # noqa: SIM115  (as long as the process)
        self._watcher = Watcher(plan.name)
        # one below the guardian: a driver that loops for ever in a reset must not keep the guardian from ending it
        self._resetter = Resetter(
            plan.machine, plan.wired, lambda: realtime.guard(self._process.priority - 1, self._process.cpu)
        )

    def run(self) -> Outcome:
        """From fork to the last reset."""
        for number in SIGNALS:
            signal.signal(number, self._ask)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # ignored, it would leave nobody to wait for
        self._resetter.stand_by()
        self._fork()
        try:
            realtime.guard(self._process.priority, self._process.cpu)
            outcome = self._keep()
        except BaseException as error:  # whatever it is, the machine comes first
            outcome = self._step_in(f"the guardian failed: {cause_of(error)}")
        with suppress(Exception):
            self._resetter.dismiss()
        with suppress(Exception):
            self._watcher.finish()
        return outcome

    @property
    def forked(self) -> bool:
        """Whether there has been a control process."""
        return self._pid != 0

    def _keep(self) -> Outcome:
        hung = self._watch()
        outcome = Outcome.decode(self._life.reported()) if self._life.stage is Stage.ENDED else None
        if outcome is None:
            return self._step_in(self._what_hung(hung) if hung else "")
        if hung:  # in code of the application's, when the machine had been reset
            os.kill(self._pid, signal.SIGKILL)
        self._is_dead(BURIAL)
        return self._settle(outcome)

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
        os.read(held, 1)  # the child holds its lock, or is dead already
        os.close(held)

    def _in_child(self, guardian: int) -> NoReturn:
        """The control process."""
        try:
            for number in SIGNALS:  # until the machine is connected
                signal.signal(number, lambda number, frame: self._life.ask(number))
            control = Control(self._plan, self._custody, self._life, self._channel, guardian, self._watcher.path)
            faulthandler.register(WHERE, file=self._traces, all_threads=False)
            outcome = control.run()
            self._channel.send("left", outcome=outcome.dump())  # stands if the guardian is killed before it has spoken
            if outcome.unsafe:  # the guardian is gone or stopped: it is for this process to say so
                assert outcome.failure is not None
                self._custody.stopped(outcome.failure.message, outcome.unreached)
                if not control.orphaned:
                    os.kill(guardian, signal.SIGKILL)
                say_last(self._channel, self._plan.name, outcome)
            end(outcome.status)
        except BaseException:
            with suppress(BaseException):
                sys.excepthook(*sys.exc_info())
        finally:
            os._exit(1)

    def _watch(self) -> str:
        """Until the control process is gone (""), or hangs: then what is known of it."""
        beat = looks = 0
        while not self._life.gone(LOOK):
            self._life.watch()
            self._listen()
            self._watcher.look()
            looks = looks + 1 if beat == self._life.last_beat else 0
            beat, limit = self._life.last_beat, self._limit()
            # several looks: if the whole computer stood still, the control process gets time to report that itself
            if self._life.silence > limit and looks >= max(LOOKS, limit / LOOK):
                return f"no sign of life for {limit * 1e3:g} ms while {self._life.stage}"
        return ""

    def _limit(self) -> float:
        if self._life.stage is Stage.STARTING:
            return STARTING_LIMIT + 2 * (self._plan.wired.period or 0.0)
        if self._life.stage is Stage.ENDED:
            return REPORTING_LIMIT
        return self._process.hang_timeout

    def _ask(self, number: int, frame: object) -> None:
        self._stop = self._stop or number

    def _listen(self) -> None:
        """Requests to stop: from the starter, by its end, by a signal."""
        while (message := self._channel.receive()) is not None:
            for file in message["files"]:
                os.close(file)
            if message["kind"] == "stop":
                self._stop = self._stop or _signal(message.get("signal"))
            elif message["kind"] == "keep":
                self._watcher.keep("on demand")
        if self._channel.ended:
            self._stop = self._stop or signal.SIGTERM
        if self._stop is not None and not self._asked:
            self._asked = True
            self._life.ask(self._stop)
            os.kill(self._pid, signal.SIGTERM)  # it ends a wait; what was asked stands in the shared memory

    # Its end -------------------------------------------------------------------------------------------

    def _what_hung(self, hung: str) -> str:
        stopped = " (it was stopped by a signal)" if _is_stopped(self._pid) else ""
        return f"the control process hung: {hung}{stopped}{in_brackets(self._watcher.moment, self._where())}"

    def _step_in(self, why: str) -> Outcome:
        """The control process died without resetting the machine, or hangs: make sure that it is dead, then reset."""
        while self._spares:
            os.close(self._spares.pop())
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        left = self._reset(self._resetter.paths)
        what = why or f"the control process {_ending(self._status)}{in_brackets(self._watcher.moment)}"
        self._watcher.keep(what)
        told = f"not reached: {summary(left)}" if left else "the guardian reset every actuator"
        unwritten = self._custody.stopped(what, list(left))
        message = "; ".join(filter(None, [what, told, unwritten]))
        return Outcome(Failed("ControlLost", message, 1), unsafe=True, unreached=list(left))

    def _settle(self, outcome: Outcome) -> Outcome:
        """The control process has ended by itself. Retry the actuators that it could not reset."""
        if outcome.unreached:
            left = self._reset(self._resetter.paths)  # all of them: the list may have been cut, and the order counts
            outcome.unsafe, outcome.unreached = True, list(left)
            outcome.failure = outcome.failure or Failed("StopError", "not brought to their defaults", 3)
            told = f"not reached: {summary(left)}" if left else "reset by the guardian afterwards"
            outcome.failure.message = "\n".join([outcome.failure.message.partition("\n")[0], told])
            outcome.failure.status = 3 if left else 1
        if outcome.unsafe:
            what = outcome.failure.message.partition("\n")[0] if outcome.failure else "it was stopped"
            unwritten = self._custody.stopped(what, outcome.unreached)
            if unwritten and outcome.failure:
                outcome.failure.message += f"; {unwritten}"
        elif outcome.driven:
            self._custody.finish()
        else:
            self._custody.abandon()
        if outcome.failure is not None:
            self._watcher.keep(outcome.failure.message.partition("\n")[0])
        return outcome

    def _reset(self, paths: list[str]) -> dict[str, str]:
        return self._resetter.reset(
            paths,
            self._process.reset_for,
            is_dead=self._is_dead,
            said=lambda text: self._channel.send("notice", text=text),
        )

    def _is_dead(self, within: float = 0.0) -> bool:
        """Whether the control process has ended: its connections are closed then. One that sticks in the kernel, in a
        call of its device, counts as dead after a while: it cannot be waited for."""
        if self._status is not None:
            return True
        until = monotonic() + within
        self._given_up = self._given_up or monotonic() + BURIAL
        while True:
            self._life.watch()
            with suppress(ChildProcessError):
                pid, status = os.waitpid(self._pid, os.WNOHANG)
                if pid:
                    self._status = status
                    return True
            if monotonic() >= until:
                return monotonic() >= self._given_up
            sleep(0.0005)

    def _where(self) -> str:
        """Where the Python code of a hanging process stands, as far as it can still tell."""
        with suppress(OSError):
            os.kill(self._pid, WHERE)
            sleep(0.003)
            text = os.pread(self._traces.fileno(), 1 << 16, 0).decode(errors="replace")
            frames = re.findall(r'^  File "(.+)", line (\d+) in (.+)$', text, re.MULTILINE)  # the innermost first
            return place_among((file, int(line), function) for file, line, function in reversed(frames))
        return ""


def _signal(number: object) -> int:
    """A number that a message names, if it is a signal that asks to stop."""
    known = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    return number if isinstance(number, int) and number in known else signal.SIGTERM


def _is_stopped(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
    return False


def _ending(status: int | None) -> str:
    if status is None:
        return "cannot be killed: it is blocked in a kernel call"
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        what = "was killed" if number in (signal.SIGKILL, *SIGNALS) else "crashed"
        return f"{what} ({signal_name(number)})"
    return f"ended with status {os.WEXITSTATUS(status)} without resetting the machine"
