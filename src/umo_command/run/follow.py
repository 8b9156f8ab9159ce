"""Follows a run that has separate processes, for the command that started it: reads frames, and forwards signals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from umo.cycle.fault_log import FaultLog
from umo.cycle.frame import Signal
from umo.cycle.stage import Progress
from umo.errors import text_of
from umo.objects import Atomic, Compound, atoms
from umo.objects.presentation.described import Described
from umo.process.frames import Reader, RunReader
from umo.process.frames.run_reader import progress_of
from umo.process.job import Job
from umo.process.outcome import Outcome
from umo.process.start import Started
from umo.system.signal_handling import SIGNALS, handling
from umo.system.streams import without_waiting
from umo_command.console import say
from umo_command.run.event_lines import EventLines
from umo_command.run.faces_beside import FacesBeside
from umo_command.run.record_beside import RecordBeside
from umo_command.show.stations import readers

POLL_TIMEOUT = 0.05
"""Time in s between two readings of the frames."""


class RingFrame:
    """A frame that was read from a ring, in the form in which observers see the live frame (`umo.Frame`)."""

    time = 0.0
    progress = Progress()
    whole = True
    """True if the observers have seen all frames up to the end of the run."""

    def __init__(self, machine: Compound) -> None:
        self._machine = machine

    def order(self, reader: RunReader) -> None:
        known = {item.path: item for item in atoms(self._machine)}
        self.items: list[Atomic] = [known[path] for path in reader.paths]
        self.signals = list(map(_signal, reader.layout.described.signals))

    def show(self, row: Any) -> None:
        self.number, self.missed = int(row["number"]), int(row["missed"])
        self.time, self.execution = float(row["time"]), float(row["execution"]) * 1e-9
        self.values, self.quality, self.signal_values = row["values"], row["quality"], row["signals"]
        self.alarms = row["alarms"]
        self.progress = progress_of(row)


def _signal(about: Described) -> Signal:
    return Signal(about.path, about.unit, None, about.path.rpartition(".")[2], about.states)


def follow(
    job: Job,
    frame: RingFrame,
    observers: list[Callable[[Any], None]],
    faults: FaultLog,
    lines: EventLines,
    faces: FacesBeside,
    recorder: RecordBeside,
) -> Outcome:
    """Start the job, and show every frame to the observers until the job ends. Return the outcome of the job. Faults
    of equipment are added to `faults`, and all events to `lines`. `faces` are served while the job runs, and end after
    it. The recorder begins before the job."""

    def stop(number: int, frame: object) -> None:
        faces.is_ending = True
        started.ask_to_stop(number)

    with without_waiting(), faces, recorder, Started(job, is_service=True) as started, handling(stop, SIGNALS):
        told, lost, is_attached = 0, 0, False
        while True:
            outcome = started.outcome
            if not is_attached and started.frames is not None:
                is_attached = True
                recorder.attach(started.frames)
                frame.order(started.frames)
                _name_other_runs(started)
                for refusal in started.refusals:
                    say(str(refusal))
            for notice in started.notices[told:]:
                say(notice)
            told = len(started.notices)
            if started.frames is not None and frame.whole:
                _show(started.frames, frame, observers, faults, lines)
                lost = started.frames.lost
            lines.look(is_over=outcome is not None)
            if outcome is not None:
                break
            if is_attached:
                faces.look(started.pid, job.path)
            recorder.look()
            started.poll(POLL_TIMEOUT)
    if outcome.driven and not is_attached:  # the frames had no memory or no folder
        frame.whole = False
    if outcome.unsafe:  # the control process could not report this time any more
        outcome.simulated = frame.time
    if lost:
        say(f"{lost} periods came too fast to be written to the trace")
    return outcome


def _show(
    frames: Reader, frame: RingFrame, observers: list[Callable[[Any], None]], faults: FaultLog, lines: EventLines
) -> None:
    """Show the new frames to the observers. If the frames are invalid or an observer fails, the machine continues to
    run, and the record has a gap."""
    try:
        for row in frames.read():
            frame.show(row)
            for observer in observers:
                observer(frame)
        for number, event in frames.events(faults.next):
            faults.next = number + 1
            faults.add(event)
            lines.add(event)
    except Exception as error:
        say(f"the periods of this run are neither shown nor recorded any longer: {text_of(error)}")
        frame.whole = False


def _name_other_runs(started: Started) -> None:
    """Print that other runs of the same station have the same name: each has devices of its own, but the name is
    ambiguous."""
    assert started.frames is not None
    name, others = started.frames.about["station"], []
    for reader in readers():
        with reader:
            if reader.about["station"] == name and reader.about["pid"] != started.pid:
                others.append(str(reader.about["pid"]))
    if others:
        say(
            f"{name} runs already (pid {', '.join(others)}); each run has its own devices or simulation. "
            f"This run has pid {started.pid}: use the pid instead of the name in commands, as in umo do {started.pid}"
        )
