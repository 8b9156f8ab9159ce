"""`umo run`: connect, drive, and say what came of it."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable, Coroutine
from datetime import datetime
from pathlib import Path
from typing import Any

from umo.cycle import connect, drive
from umo.cycle.record import Statistics, Trace
from umo.errors import UmoError
from umo.objects import Compound
from umo.wiring import driver_options

from .console import err, out
from .lock import only_one
from .progress import Shown, task_of
from .result import Result, message_of, signal_name
from .station import Station, StationError

RUNS = Path("runs")


def run_station(
    station: Station, wiring: str | None, options: dict[str, Any], *, summary: Path | None, full_traceback: bool = False
) -> int:
    """Run the station's application to its end; the exit status. `options` are those that the user gave."""
    if summary is not None and (summary.is_dir() or not summary.resolve().parent.is_dir()):
        what = "is a folder" if summary.is_dir() else f"there is no folder {summary.parent}"
        raise StationError(f"--summary {summary}: {what}")
    file = station.wiring(wiring)
    machine = station.machine()
    application, for_drivers = _share(station, file, options)
    result = Result(Statistics())
    trace = Trace(note=lambda: task_of(machine))
    with only_one(station.path, file):
        _drive(connect(machine, file, **for_drivers), application, result, trace)
    if not result.statistics.periods and isinstance(result.failure, UmoError):
        raise result.failure  # nothing ran: there is nothing to show
    written = summary is None or _write_summary(result, summary)
    _leave_behind(station, machine, result, trace)
    name = station.name if file is None else f"{station.name}, {file.stem}"
    out.print(result.table(f"umo run {name}"))
    if result.failure is not None:
        if full_traceback:
            traceback.print_exception(result.failure)
        err.print(f"umo: {message_of(result.failure)}", style="red", highlight=False, markup=False, soft_wrap=True)
    elif result.stopped_by is not None:
        err.print(f"umo: stopped by {signal_name(result.stopped_by)}; every actuator is at its default")
    return result.status if written else max(result.status, 1)


def _share(
    station: Station, wiring: Path | None, options: dict[str, Any]
) -> tuple[Callable[[Compound], Coroutine[Any, Any, Any]] | None, dict[str, Any]]:
    """Hand each option to whoever takes one of that name: the application's main, the drivers, or both."""
    main = station.main
    taken = set() if main is None else set(list(inspect.signature(main).parameters)[1:])
    drivers = driver_options(wiring)
    for name in options.keys() - taken - drivers - {"realtime"}:
        raise StationError(f"--{name}: neither the application of {station.name} nor a driver of its wiring takes it")
    if "realtime" in options and "realtime" not in drivers:
        err.print("umo: --realtime changes nothing: this wiring's timer keeps its own time")
    for_main = {name: value for name, value in options.items() if name in taken}
    for_drivers = {name: value for name, value in options.items() if name in drivers}
    if main is None:
        return None, for_drivers
    return lambda machine: main(machine, **for_main), for_drivers


def _drive(
    connection: connect[Compound],
    application: Callable[[Compound], Coroutine[Any, Any, Any]] | None,
    result: Result,
    trace: Trace,
) -> None:
    """The run itself; whatever ends it is kept in the result, and the actuators are at their defaults after it."""
    try:
        with connection as machine, Shown(machine, err) as shown:
            connection.machine.observers += [result.statistics, trace, shown]
            begun = time.perf_counter()
            try:
                drive(machine, application)
            finally:
                result.elapsed = time.perf_counter() - begun
                result.simulated = machine.now
                result.stopped_by = connection.stop.signal
                result.inspect(machine, connection.wired.drivers)
    except Exception as error:
        result.failure = error


def _write_summary(result: Result, summary: Path) -> bool:
    try:
        result.save(summary)
    except OSError as error:
        err.print(f"umo: the summary could not be written: {error}")
        return False
    return True


def _leave_behind(station: Station, machine: Compound, result: Result, trace: Trace) -> None:
    """Trace, plot and summary; what cannot be written is said, and changes nothing else."""
    folder = RUNS / f"{station.name}-{datetime.now():%Y%m%d-%H%M%S}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        trace.save(folder / "trace.csv")
        result.save(folder / "summary.json")
        if result.failure is not None:
            (folder / "failure.txt").write_text("".join(traceback.format_exception(result.failure)), encoding="utf-8")
        from .plot import save_plot

        save_plot(trace, folder / "plot.png", f"umo run {station.name}: {task_of(machine) or 'done'}")
    except ImportError:
        err.print(f'umo: no plot: it needs matplotlib (pip install "umo[plot]"); the trace is in {folder}')
    except OSError as error:
        err.print(f"umo: the run could not be written down whole: {error}")
    else:
        out.print(f"trace and plot: {folder}", highlight=False)
