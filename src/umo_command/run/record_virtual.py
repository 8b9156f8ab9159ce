"""Records a run in virtual time, in the process of the run, between its periods."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from umo.cycle.connect import connect
from umo.errors import UmoError, text_of
from umo.process.frames import Reader, published
from umo.process.frames.memory import RunDescriptors
from umo.process.job import Plan
from umo.process.job_facts import job_facts
from umo.process.kept_file import NUMBERS
from umo_command.console import say
from umo_command.run.record_beside import RecordOrder

SHARE_OF_RING = 4
"""Share of the ring after which the recorder reads it."""


class RecordedVirtual:
    """The record of one run in virtual time. It is closed after the machine. If it fails, the failure is printed and
    the run continues."""

    def __init__(self, order: RecordOrder | None) -> None:
        """`order`: None means that nothing is recorded or published."""
        self._order = order
        self._undo = ExitStack()
        self._work: Any = None
        self._periods = self._share = 0
        self.complete = True
        """True if everything was recorded that should be."""

    @contextmanager
    def published(self, connection: connect[Any], plan: Plan) -> Iterator[None]:
        """Return a context in which the periods of the connected machine are published and recorded."""
        with ExitStack() as stack:
            if self._order is not None:
                try:
                    self._begin(connection, plan, self._order, stack)
                except (OSError, UmoError) as error:
                    self.complete = False
                    say(f"nothing is recorded: {self._order.file}: {text_of(error)}")
            yield

    def _begin(self, connection: connect[Any], plan: Plan, order: RecordOrder, stack: ExitStack) -> None:
        from umo.recording.record_settings import RecordSettings
        from umo_command.run.record_work import RecordingWork

        ends, readers = RunDescriptors.pair()
        self._undo.callback(ends.close)
        job = job_facts(plan, {NUMBERS: dict(connection.kept)})
        stack.enter_context(published(
            connection, plan.name, plan.wiring_name, place=plan.place, options=plan.machine_options, job=job, ends=ends
        ))  # fmt: skip
        reader = self._undo.enter_context(Reader("the run", readers))
        self._work = RecordingWork(reader, order.file, RecordSettings(**order.settings), say, threaded=False)
        self._share = max(reader.slots // SHARE_OF_RING, 1)
        connection.machine.observers.append(self._each_period)

    def _each_period(self, frame: object) -> None:
        self._periods += 1
        if self._periods % self._share == 0:
            self._work.look()

    def __enter__(self) -> RecordedVirtual:
        return self

    def __exit__(self, *error: object) -> None:
        """Write the rest, after the actuators are reset."""
        with self._undo:
            if self._work is not None:
                self._work.finish()
                self.complete = self.complete and not self._work.failed
