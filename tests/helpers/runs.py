"""Runs of the machine of `process_box` under a guardian."""

from __future__ import annotations

import os
import select
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from helpers.process_box import Cells
from umo.drivers import registry
from umo.process import guardian, source_files
from umo.process.job import Job
from umo.process.messages import MessageSocket
from umo.process.outcome import Outcome
from umo.system import realtime
from umo.system.device_record import Ended, all_standing
from umo.wiring import schema

TESTS = Path(__file__).parents[1]
OWN = tuple(f"{TESTS.parent / each}{os.sep}" for each in ("tests", "tools", "bench"))
IMPORTED_ONCE = schema
"""With pydantic. A run imports it when it reads its wiring: the forked ones need not, each for itself."""
NEIGHBOURS = "the control process did not get core"
"""The beginning of a notice that other stations had the core."""


def as_if_begun_afresh(kept: set[str]) -> None:
    """This process has imported all tests, which a guardian that is started afresh has not: a run would hash and read
    them as the user's code, and lock all their memory, of which each process then gets a copy. It would also look for
    the files that `process_box` names, which are all helpers of tests."""
    realtime.lock_memory = lambda: None
    source_files.named_files = lambda modules, folder: []
    for name, module in list(sys.modules.items()):
        if name not in kept and (getattr(module, "__file__", None) or "").startswith(OWN):
            del sys.modules[name]


class RunEnded(AssertionError):
    """A run has ended before what was waited for."""


class Run:
    """One run under a guardian that was forked from this process instead of started afresh: the same code, sooner."""

    def __init__(
        self, wiring: dict[str, Any], application: str = "drive", box: str = "helpers.process_box", **more: Any
    ) -> None:
        path = [str(TESTS), *sys.path]
        job = Job(machine=f"{box}:machine", application=f"{box}:{application}", wiring=wiring, path=path)
        for name, value in more.items():
            setattr(job, name, value)
        self.channel, there = MessageSocket.pair()
        file = tempfile.TemporaryFile()  # noqa: SIM115  (the guardian's)
        file.write(job.dump())
        file.seek(0)
        self._rest, held = os.pipe()
        registry.known()  # as above: once for all runs
        self.guardian = os.fork()
        if self.guardian == 0:
            os.setsid()
            os.close(self._rest)
            self.channel.close()
            as_if_begun_afresh({"helpers", "helpers.process_box", box})
            try:
                os._exit(guardian.main(there.detach(), os.dup(file.fileno())))
            finally:
                os._exit(99)
        there.close()
        file.close()
        os.close(held)
        self.notices: list[str] = []
        self.control = self.standby = self.reserve = 0

    def until_running(self) -> Run:
        """Until the control process says so; its pid and that of the standby guardian are known then."""
        while not self.control:
            message = self.next()
            if message["kind"] == "standby":
                self.standby = message["pid"]
            elif message["kind"] == "notice":
                self.notices.append(message["text"])
            elif message["kind"] == "running":
                self.control = message["pid"]
            else:
                raise RunEnded(f"{message}, {self.notices}")
        return self

    def goes_on_until(self, file: int) -> None:
        """Until `file` can be read. Fails with what the run has said if it ends before."""
        guardian = os.pidfd_open(self.guardian)
        ready = select.select([file, guardian], [], [], 60)[0]
        os.close(guardian)
        if file not in ready:
            assert ready, "neither the file nor the run changes within a minute"
            raise RunEnded(f"{self.outcome()}, {self.notices}")

    def message(self, kind: str) -> dict[str, Any]:
        """The next message, which is of this kind."""
        message = self.next()
        assert message["kind"] == kind, message
        return message

    def next(self) -> dict[str, Any]:
        """The next message."""
        message = self._receive()
        if message is None:
            raise RunEnded(self.notices)
        return message

    def _receive(self) -> dict[str, Any] | None:
        """None at the end. What other stations of this computer do to this one is passed over."""
        while True:
            message = self.channel.receive(60)
            assert message is not None or self.channel.ended, "neither a message nor an end within a minute"
            for file in [] if message is None else message["files"]:
                os.close(file)
            if message is not None and message["kind"] == "reserve":
                self.reserve = message["pid"]
                continue
            if message is not None and message["kind"] == "control":
                continue
            if message is None or NEIGHBOURS not in message.get("text", ""):
                return message

    def until_all_ended(self) -> None:
        """Until every process of the run has ended."""
        assert select.select([self._rest], [], [], 30)[0], "a process of the run goes on"
        os.close(self._rest)
        with suppress(ChildProcessError):  # `outcome` has waited for it
            os.waitpid(self.guardian, 0)

    def outcome(self) -> Outcome:
        """How it ended: what was said, which is the guardian's exit status as well."""
        said = None
        while (message := self._receive()) is not None:
            if message["kind"] == "notice":
                self.notices.append(message["text"])
            if message["kind"] in ("left", "ended"):  # the last counts
                said = Outcome.load(message["outcome"])
        status = os.waitpid(self.guardian, 0)[1]
        self.channel.close()
        assert said is not None, "nothing was reported"
        if os.WIFEXITED(status):
            assert os.WEXITSTATUS(status) == said.status
        return said


def until_dead(pid: int) -> None:
    """Until a process that was killed, or kills itself, has ended."""
    try:
        file = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    assert select.select([file], [], [], 20)[0], f"process {pid} goes on"
    os.close(file)


def standing() -> list[Ended]:
    """The devices that are locked after an unsafe end."""
    return all_standing()


def assert_safe(cells: Cells) -> None:
    assert cells.levels == {"motor": 0, "valve": 0}
