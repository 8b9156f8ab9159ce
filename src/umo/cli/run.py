"""`umo run`: run a station and print the results."""

from __future__ import annotations

import time
from datetime import datetime
from pathlib import Path
from typing import Any

from umo.cycle import connect, drive
from umo.cycle.stopping import signal_name
from umo.cycle.trace import Statistics, Trace
from umo.process.job import Job, Plan
from umo.process.outcome import Failed, Outcome, plain, plain_reports
from umo.process.start import LINUX
from umo.process.station import StationError
from umo.text import cause_of

from .console import err, out
from .follow import Seen, follow
from .progress_line import Shown
from .result import Result

RUNS = Path("runs")


def run_station(job: Job, *, summary: Path | None, full_traceback: bool = False) -> int:
    """Run a station's application to its end; the exit status.

    In real time it runs in processes of its own (`umo.process`), in virtual time in this one.
    """
    if summary is not None and (summary.is_dir() or not summary.parent.is_dir()):
        what = "is a folder" if summary.is_dir() else f"there is no folder {summary.parent}"
        raise StationError(f"--summary {summary}: {what}")
    plan = Plan(job)
    if job.options.get("realtime") and not plan.wired.paced:
        err.print("umo: --realtime has no effect: the timer of this wiring is a real-time timer")
    result = Result(Statistics(), faults=() if plan.wired.injection is None else plan.wired.injection.texts)
    seen = Seen(plan.machine)
    trace = Trace()
    with Shown(err) as shown:
        if plan.wired.realtime and LINUX:
            result.outcome, result.elapsed = follow(job, seen, [result.statistics, trace, shown])
            result.progress = seen.progress
        else:
            _drive(plan, result, [result.statistics, trace, shown])
    outcome = result.outcome
    if outcome.failure is not None and not result.statistics.periods:
        return _fail(outcome.failure, full_traceback)  # nothing ran: there is nothing to show
    _say_how_it_ended(outcome, full_traceback)  # at once: the plot takes seconds
    written = summary is None or _write_summary(result, summary)
    _leave_behind(plan.name, result, trace)
    name = f"{plan.name}, {plan.wiring_name}" if plan.wiring_name else plan.name
    out.print(result.table(f"umo run {name}"))
    return outcome.status if written else max(outcome.status, 1)


def _say_how_it_ended(outcome: Outcome, full_traceback: bool) -> None:
    if outcome.failure is not None:
        _fail(outcome.failure, full_traceback)
    elif outcome.stopped_by is not None:
        err.print(f"umo: stopped by {signal_name(outcome.stopped_by)}; every actuator is at its default")


def _fail(failure: Failed, full_traceback: bool) -> int:
    if full_traceback:
        err.print(failure.traceback, soft_wrap=True)
    err.print(f"umo: {failure.message}", style="red", soft_wrap=True)
    return failure.status


def _drive(plan: Plan, result: Result, observers: list[Any]) -> None:
    """The run itself, in this process. Its error is stored in the result; the actuators are reset before it returns."""
    connection = connect(plan.machine, plan.wired, acknowledge=plan.job.acknowledge)
    outcome = result.outcome
    try:
        with connection as machine:
            connection.machine.observers += observers
            begun = time.perf_counter()
            try:
                outcome.result = plain(drive(machine, plan.application))
            finally:
                result.elapsed = time.perf_counter() - begun
                outcome.simulated = machine.now
                result.progress = connection.machine.frame.progress
                outcome.stopped_by = connection.stop.signal
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: the run did not come to its end
        outcome.failure = Failed.of(error)
    outcome.reports = plain_reports(connection.reports)


def _write_summary(result: Result, summary: Path) -> bool:
    try:
        result.save(summary)
    except OSError as error:
        err.print(f"umo: the summary could not be written: {error}")
        return False
    return True


def _leave_behind(name: str, result: Result, trace: Trace) -> None:
    """Write trace, plot and summary. A failure is printed and does not change the exit status."""
    failure = result.outcome.failure
    try:
        folder = _new_folder(f"{name}-{datetime.now():%Y%m%d-%H%M%S}")
        trace.save(folder / "trace.csv")
        result.save(folder / "summary.json")
        if failure is not None:
            text = f"{failure.message}\n{failure.traceback}"
            (folder / "failure.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
        from .plot import save_plot

        rest = save_plot(trace, folder / "plot.png", f"umo run {name}: {result.progress.text or 'done'}")
    except ImportError:
        err.print(f'umo: no plot: matplotlib is not installed (pip install "umo[plot]"); the trace is in {folder}')
    except Exception as error:  # a full disk; a name that the plot cannot show
        err.print(f"umo: the results of the run are incomplete: {cause_of(error)}", soft_wrap=True)
    else:
        out.print(f"trace and plot: {folder}" + (f"; the plot does not show {rest}" if rest else ""), soft_wrap=True)


def _new_folder(name: str) -> Path:
    """A folder of its own in runs/, also for the second run that ends within a second."""
    RUNS.mkdir(exist_ok=True)
    folder, number = RUNS / name, 1
    while True:
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            number += 1
            folder = RUNS / f"{name}-{number}"
