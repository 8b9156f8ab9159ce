"""`umo run`: runs a station and prints the results."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from umo.cycle.connect import connect
from umo.cycle.frame import Frame
from umo.cycle.run import drive, result_of
from umo.cycle.stopping import TimeLimit
from umo.cycle.trace import Statistics, Trace
from umo.errors import Interrupted, text_of
from umo.exit_status import ExitStatus
from umo.operation.alarms.alarming import alarm_log
from umo.operation.commands.client_commands import Mode
from umo.process import kept_values
from umo.process.compiling import prepare_if_asked, start_compiled
from umo.process.job import Job, Plan
from umo.process.outcome import Failed, Outcome, plain, plain_reports
from umo.process.start import FIXED_HASHES, LINUX
from umo.system.folders import replaced
from umo.system.packages import how_to_install
from umo.system.processes import HASH_SEED
from umo.system.signal_handling import SIGNALS, handling
from umo.system.streams import limit_waits, log_tracebacks, lost_lines, send_waiting
from umo_command.console import err, out, say
from umo_command.progress_line import RunProgressLine
from umo_command.run.event_lines import EventLines
from umo_command.run.faces_beside import FacesBeside, faces_of, wiring_of
from umo_command.run.follow import RingFrame, follow
from umo_command.run.long_runs import RunningSummary, TraceParts, prune
from umo_command.run.record_beside import SUFFIX, RecordBeside, RecordOrder, order_of
from umo_command.run.record_virtual import RecordedVirtual
from umo_command.run.run_folder import MAX_VALUE_LENGTH, RUNS, NotRecorded, RunFolder, RunSummary, TraceFile
from umo_command.shared import begin_again, interrupt_once
from umo_command.values import check_file

STILL_TIME = 600.0
"""Time in s on the machine's clock without a change after which a notice is printed."""
LOOK_PERIODS = 997
"""Number of periods between two checks for a change. It is a prime number, so that a machine whose values repeat is
hardly ever mistaken for one whose values do not change."""


@dataclass(frozen=True)
class Record:
    """The files that a run writes."""

    folder: bool = True
    """True if the run leaves a folder in runs/."""
    plot: bool = True
    summary: Path | None = None
    """The file for the summary."""
    keep: int | None = None
    """Maximum number of bytes of a trace of every period, whose oldest parts are removed. None means that no such trace
    is written."""
    keep_runs: int | None = None
    """Number of runs of the station that are kept, including this one. None means all."""
    recording: Path | None = None
    """The file for a recording of every period. An empty path means `recording.mcap` in the run's folder. None means no
    recording, unless the wiring declares one."""
    recording_settings: Mapping[str, Any] = field(default_factory=dict)
    """The settings of a recording that are given on the command line."""


def run_station(job: Job, record: Record = Record(), *, full_traceback: bool = False, serve: bool = True) -> int:
    """Run a station's application to its end, and return the exit status. `serve`: True to also serve the faces of its
    wiring. In real time the station runs in separate processes (`umo.process`), in virtual time in this process.
    """
    limit_waits()
    if full_traceback:
        job.traceback = True
        log_tracebacks()
    status = _run_station(job, record, full_traceback, serve)
    if lost := send_waiting():
        say(lost_lines(lost))
    return status


def _run_station(job: Job, record: Record, full_traceback: bool, serve: bool) -> int:
    check_file("--summary", record.summary)
    plan = Plan(job)
    if _is_recorded(plan, record) and not _has_processes(plan) and HASH_SEED not in os.environ:
        begin_again(FIXED_HASHES[HASH_SEED])  # like the processes in real time, so that a replay repeats the run
    faces = faces_of(wiring_of(plan), plan.wired.faces) if serve else {}
    if job.options.get("realtime") and not plan.wired.paced and not job.manual:
        say("--realtime has no effect: the timer of this wiring is a real-time timer")
    try:
        folder = RunFolder.make(plan) if record.folder else None
    except NotRecorded as error:
        return _fail(Failed("NotRecorded", str(error), ExitStatus.NOT_RECORDED), full_traceback)
    trace, parts, order = Trace(), None, None
    if folder is not None:
        _make_room(plan, record)
        parts = None if record.keep is None else TraceParts(folder.path, record.keep)
    try:
        order = _recording(plan, record, folder)
        result, recorded = _run(plan, trace, folder, parts, faces, order)
    except BaseException:  # Ctrl-C before the run, a job that cannot be handed to another process
        if folder is not None and not len(trace.rows):
            folder.discard()
        raise
    outcome = result.outcome
    with handling(signal.SIG_IGN, SIGNALS):  # the run is over: its record is written whole
        if outcome.failure is not None and not result.statistics.periods:
            if folder is not None:
                folder.discard()
            return _fail(outcome.failure, full_traceback)  # nothing ran: there is nothing to show
        _say_how_it_ended(outcome, full_traceback)
        if outcome.unkept:
            say(outcome.unkept, "red")
        for line in result.standing_faults():
            say(line, "red")
        name = f"{plan.name}, {plan.wiring_name}" if plan.wiring_name else plan.name
        out.print(result.table(f"umo run {name}", MAX_VALUE_LENGTH if out.is_terminal else None))
        complete = record.summary is None or _write_summary(result, record.summary)
        if folder is not None:
            how = result.failed or outcome.early_end or result.progress.text or "done"
            title = f"umo run {plan.name}: {how}" if record.plot else ""
            if parts is not None:
                parts.write()
                complete &= parts.complete
            _leave_behind(folder, result, trace, title)
            complete &= folder.complete
        complete &= recorded
    ended_well = outcome.failure is None and not outcome.unreached
    return ExitStatus.NOT_RECORDED if ended_well and not complete else outcome.status


def _make_room(plan: Plan, record: Record) -> None:
    """Remove the oldest runs, if this was requested. Print a notice if the disk has less space than the trace may need.
    A failure here does not prevent the run."""
    with suppress(OSError):
        if record.keep_runs is not None:
            prune(record.keep_runs, plan.name)
        if record.keep is not None and (free := shutil.disk_usage(RUNS).free) < record.keep:
            say(f"--keep: {RUNS}/ has {free / 1e6:.0f} MB left, and the trace may need {record.keep / 1e6:.0f} MB")


def _run(
    plan: Plan,
    trace: Trace,
    folder: RunFolder | None,
    parts: TraceParts | None,
    faces: dict[str, Any],
    order: RecordOrder | None,
) -> tuple[RunSummary, bool]:
    """Run, and print its notices. Return the summary, and True if it was recorded as requested. The run's error is in
    the result; the actuators are reset. `faces`: served in real time only."""
    injected = () if plan.wired.injection is None else plan.wired.injection.texts
    alarms = alarm_log(plan.machine)
    result = RunSummary(Statistics(), realtime=plan.wired.realtime, injected=injected, alarms=alarms)
    with RunProgressLine(err) as shown:
        optional = [each for each in (result.alarms, parts) if each is not None]
        kept = [] if folder is None else [trace]
        observers: list[Any] = [result.statistics, *kept, shown, *optional]
        lines = EventLines(shown.note, Mode.MANUAL if plan.job.manual else Mode.AUTOMATIC)
        if not _has_processes(plan):
            with RecordedVirtual(order) as recorded:
                _drive(plan, result, observers, lines, recorded)
            return result, recorded.complete
        if folder is not None:
            observers.append(TraceFile(trace, folder.path / "trace.csv"))
            observers.append(RunningSummary(result, folder.path / "summary.json"))
        frame = RingFrame(plan.machine)
        beside, recorder = FacesBeside(wiring_of(plan), faces), RecordBeside(order)
        faults = result.equipment_faults
        result.outcome = follow(plan.job, frame, observers, faults, lines, beside, recorder)
        result.progress = frame.progress
        if folder is not None:
            folder.complete = frame.whole
    return result, recorder.complete


def _say_how_it_ended(outcome: Outcome, full_traceback: bool) -> None:
    if outcome.failure is not None:
        _fail(outcome.failure, full_traceback)
    elif outcome.early_end:
        say(f"{outcome.early_end}; {outcome.outputs}")


def _fail(failure: Failed, full_traceback: bool) -> int:
    if full_traceback:
        err.print(failure.traceback, soft_wrap=True)
    say(failure.message, "red")
    return failure.status


def _has_processes(plan: Plan) -> bool:
    """True if the run has separate processes."""
    return plan.wired.realtime and LINUX


def _is_recorded(plan: Plan, record: Record) -> bool:
    asked = record.recording is not None or bool(record.recording_settings)
    return asked or (plan.wired.record is not None and record.folder)


def _recording(plan: Plan, record: Record, folder: RunFolder | None) -> RecordOrder | None:
    """Return the recording that the command line or the wiring requests, or None. Raises OptionError for a mistake."""
    if not _is_recorded(plan, record):
        return None
    given = None if record.recording in (None, Path()) else record.recording
    name = f"{plan.name}-{time.strftime('%Y%m%d-%H%M%S')}{SUFFIX}"
    default = Path(name) if folder is None else folder.path / f"recording{SUFFIX}"
    return order_of(given, record.recording_settings, plan.wired.record, default, wiring_of(plan))


def _drive(plan: Plan, result: RunSummary, observers: list[Any], lines: EventLines, recorded: RecordedVirtual) -> None:
    """Carry out the run in this process. An error is stored in the result. The actuators are reset before this function
    returns."""
    plan.prepared = prepare_if_asked(plan.machine, plan.wired, say)
    connection = connect(plan.machine, plan.wired, acknowledge=plan.job.acknowledge)
    connection.kept = kept_values.copy(plan, say)
    connection.laid_out = lambda machine: start_compiled(plan.prepared, machine, say)
    outcome, returned = result.outcome, None
    try:
        with connection as machine:
            for text in kept_values.tell(connection):
                say(text)
            events, faults = connection.machine.events, result.equipment_faults

            def add_events(frame: object = None) -> None:
                for event in faults.add_new(events):
                    lines.add(event)

            connection.machine.observers += [*observers, add_events]
            if plan.job.until is not None:
                connection.machine.observers.append(TimeLimit(plan.job.until, connection.stop))
            if not plan.wired.realtime:
                connection.machine.observers.append(Stillness(say, lambda: connection.machine.sequences.places))
            begun = time.perf_counter()
            try:
                with recorded.published(connection, plan):
                    returned = drive(machine, plan.application)
            finally:
                result.elapsed = time.perf_counter() - begun
                outcome.simulated = machine.now
                result.progress = connection.machine.progress
                add_events()
                lines.look(is_over=True)
                outcome.driven = connection.started
                outcome.stopped_by = connection.stop.signal
                outcome.time_over = connection.stop.time_over and outcome.stopped_by is None
    except BaseException as error:  # SystemExit too: the run did not come to its end
        if isinstance(error, KeyboardInterrupt) and not isinstance(error, Interrupted):
            raise
        outcome.failure = Failed.of(error)
    outcome.result = plain(result_of(returned, connection))
    outcome.reports = plain_reports(connection.reports)


def _write_summary(result: RunSummary, summary: Path) -> bool:
    try:
        result.save(summary)
    except OSError as error:
        say(f"{summary} could not be written: {text_of(error)}", "red")
        return False
    return True


def _leave_behind(folder: RunFolder, result: RunSummary, trace: Trace, title: str) -> None:
    """Write the files of the run's folder. If there is a title, draw the plot. Print the names of the files."""
    folder.save(result, trace)
    rest = _plot(title, trace, result, folder) if title and len(trace.rows) else ""
    files = (("trace", "csv"), ("plot", "png"))
    kept = [name for name, end in files if (folder.path / f"{name}.{end}").exists()]
    out.print(f"{' and '.join(kept) or 'results'}: {folder.path}{rest}", soft_wrap=True)


def _plot(title: str, trace: Trace, result: RunSummary, folder: RunFolder) -> str:
    """Draw the plot, which takes seconds. Return what it does not show. A failure, or Ctrl-C, affects the plot only."""
    try:
        with replaced(folder.path / "plot.png") as file, handling(interrupt_once, SIGNALS):
            say("drawing the plot; Ctrl-C skips it, --no-plot always skips it")
            from umo_command.run.plot import Curves, save_plot

            rest = save_plot(Curves.of(trace, result.alarms), file, title)
        return f"; the plot does not show {rest}" if rest else ""
    except KeyboardInterrupt:
        say("the plot was skipped")
    except ImportError:
        say(f"no plot: matplotlib is not installed ({how_to_install('plot')})")
    except OSError as error:
        folder.lost("plot.png", error)
    except Exception as error:  # a name that it cannot show
        say(f"the plot could not be drawn: {text_of(error)}")
    return ""


class Stillness:
    """An observer that reports once if no value has changed for a long time, and at which line the application
    waits."""

    def __init__(self, say: Callable[[str], object], places: Callable[[], list[str]]) -> None:
        self._say = say
        self._places = places
        self._periods = 0
        self._before: object = None
        self._since = 0.0

    def __call__(self, frame: Frame) -> None:
        self._periods += 1
        if self._periods % LOOK_PERIODS:
            return
        now = (list(frame.raws), frame.progress)
        if now != self._before:
            self._before, self._since = now, frame.time
        elif frame.time - self._since >= STILL_TIME:
            places = ", ".join(filter(None, self._places()))
            where = f"the application waits at {places}" if places else "there is no application"
            self._say(
                f"nothing has changed for {STILL_TIME:g} s of the machine's time: {where}; "
                "Ctrl-C ends the run (--until TIME would)"
            )
            self._since = float("inf")
