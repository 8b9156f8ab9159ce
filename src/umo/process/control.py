"""The control process: connects the machine, holds the loop and nothing else, leaves safely, reports."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from umo.cycle import connect, drive
from umo.cycle.signals import request_stop
from umo.cycle.stop_order import stop_sequence
from umo.errors import StopError
from umo.frames import Ring, published
from umo.objects import Compound, DigitalSensor
from umo.process.job import Plan
from umo.process.life import Life, Stage
from umo.process.messages import MessageSocket
from umo.process.outcome import Failed, Outcome, Parts
from umo.system import realtime

GUARDIAN_GONE = "the guardian is gone; the control process stopped the machine by itself"


class Control:
    """Runs one plan in the process that calls it, which was forked by the guardian."""

    def __init__(self, plan: Plan, life: Life, channel: MessageSocket, guardian: int, ring: Path | None) -> None:
        self._plan = plan
        self._life = life
        self._channel = channel
        self._guardian = guardian
        self._path = ring
        self._asked: Callable[[], int | None] = lambda: None

    def run(self, asked: Callable[[], int | None]) -> Outcome:
        """Connect, drive, leave; whatever ends it is in the outcome. `asked` gives the signal, if any, that asked to
        stop before the machine was connected."""
        self._asked = asked
        outcome = Outcome()
        realtime.die_with_parent(signal.SIGTERM)
        try:
            self._work(outcome)
        except BaseException as error:
            outcome.failure = Failed.of(error)
            if isinstance(error, StopError):
                actuators = {item.path for item in stop_sequence(self._plan.machine)}
                outcome.unreached = sorted({failure.path for failure in error.failures} & actuators)
        if self._orphaned:
            outcome.unsafe = True
            outcome.failure = outcome.failure or Failed("GuardianGone", GUARDIAN_GONE, 1)
        return outcome

    @property
    def _orphaned(self) -> bool:
        return os.getppid() != self._guardian

    def _work(self, outcome: Outcome) -> None:
        plan = self._plan
        process = plan.wired.process
        refusals = realtime.prepare(process.priority, process.cpu)
        connection = connect(plan.machine, plan.wiring, **plan.options)
        connection.on_step = self._life.beat
        with connection as machine:
            try:
                with published(connection, plan.name, plan.wiring_name, self._path) as ring:
                    connection.machine.observers.append(self._life.beat)
                    self._ready(machine, ring, refusals)
                    outcome.result = drive(machine, plan.application)
            finally:
                self._life.enter(Stage.LEAVING)
                outcome.stopped_by = connection.stop.signal
                outcome.simulated = machine.now
                outcome.parts = Parts.of(machine, connection.wired.drivers)

    def _ready(self, machine: Compound, ring: Ring, refusals: list[realtime.Refusal]) -> None:
        gc.freeze()
        if isinstance(timer := machine.children().get("timer"), DigitalSensor):
            timer.read()  # the ticks that passed until here
        if threading.active_count() > 1:
            others = [thread.name for thread in threading.enumerate() if thread is not threading.main_thread()]
            text = f"the control process has other Python threads, which will delay it: {', '.join(others)}"
            self._channel.send("notice", text=text)
        self._channel.send(
            "running",
            pid=os.getpid(),
            guardian=self._guardian,
            files=[ring.file],
            refusals=[[refusal.what, refusal.why, refusal.grant] for refusal in refusals],
        )
        self._life.enter(Stage.RUNNING)
        if self._orphaned or self._asked():
            request_stop(self._asked())


def end(status: int) -> None:
    """Leave without the exit handlers of the guardian that this process was forked from."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            continue
    os._exit(status)
