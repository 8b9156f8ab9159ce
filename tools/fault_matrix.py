"""The fault matrix: every station that ships, under every kind of fault, on every one of its objects.

    python -m tools.fault_matrix > matrix.md         runs all of it on all cores: a page of tables
    python -m tools.fault_matrix conveyor            the cells of one station, with what each ended in
    python -m tools.fault_matrix ztheta z.encoder    those of one object

Each cell is a run in virtual time. What the run claims is compared with what the plant knows, which no control code can
read. A run that takes ten times as long as one without faults counts as hanging. Until a fault begins, a run is the one
without faults: that one is made once for many cells, and forks when their faults begin.
"""

from __future__ import annotations

import argparse
import logging
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from fnmatch import fnmatchcase
from itertools import groupby
from multiprocessing import get_context
from typing import Any

import numpy as np

from umo import Quality, UmoError
from umo.cycle.connect import connect
from umo.cycle.run import drive
from umo.cycle.showing import frame_of
from umo.cycle.stopping import StopFlag
from umo.drivers.contract import Channel, Direction
from umo.drivers.faults.effects import Effect
from umo.drivers.faults.fault_syntax import KINDS_OF_DRIVERS, InjectedFault
from umo.drivers.faults.wrapper import FaultyDriver
from umo.drivers.off_cycle import OffCycle
from umo.drivers.optional import Reports
from umo.drivers.wrapping import Wrapper, of_driver
from umo.errors import OptionError, StopError
from umo.objects import Binary, atoms
from umo.operation import ProcedureState
from umo.operation.alarms import AlarmState
from umo.operation.alarms.alarming import engine_of
from umo.process.outcome import message_of, plain
from umo.process.station import find
from umo.testing.faults import KINDS
from umo.wiring import Wired, distribute_options, resolve
from umo.wiring.patterns import generalised

DRIVER = "plant"
SEED = 1
LONGEST = 600.0
"""s of wall-clock time that a cell may take; the longest takes 20 s of processor time."""
SLOWER = 10
"""A run that takes so many times the periods of one without faults hangs."""
SLOW = "slow drift"
"""Of a ten-thousandth of the range in a second; `drift` is a hundredth."""
COLUMNS = [kind for known in KINDS for kind in ((known, SLOW) if known == "drift" else (known,))]
NO_ROOM = "out of range"
"""Refused where the channel has no level beyond the range of the object."""
DRIFTS = ("drift", SLOW)
"""Binary objects have none."""
LOUD = KINDS_OF_DRIVERS
"""Kinds that make a call fail; tried at the first moment only."""
AGAIN = ("stuck", "wrong length")
"""Kinds that depend on the level at the moment. The others are tried at a later moment only if the run ended before it:
a fault lasts to the end."""
SHOWN = "shown"
"""What an observer kept of a state or an alarm that was shown and was not so."""
ACTIVE = (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED)
DEFECTS = ("WRONG", "HANG", "TRACEBACK", "UNSAFE")
WORDS = {
    "ok": "the work was done, and the plant agrees",
    "degraded": "the work was done in part, or in another way; the result says which part; the plant agrees",
    "stopped": "the run failed with one clear message; every actuator is at its default (an actuator with the fault "
    "was sent its default)",
    "not reached": "the same, but an actuator on the faulty connection could not be sent its default while the "
    "fault lasted: the message names it, exit status 3",
    "not seen": "the result is not true, and nothing that the machine measures shows it; the reasons are below",
}
"""How a cell may end. Anything else is a defect, and fails the test."""
ENDED = ("ok", "degraded", "not seen", "WRONG")
"""Of a run that came to its end."""


@dataclass
class Run:
    """One run of a machine to its end."""

    machine: Any
    wired: Wired
    stop: StopFlag
    result: Any = None
    error: BaseException | None = None
    reports: dict[str, Any] = field(default_factory=dict)
    plant: Any = None
    seen: dict[str, Any] = field(default_factory=dict)
    """What an observer kept of the truth."""
    periods: int = 0
    stopped: bool = False
    """Whether it took too many periods."""
    sent: dict[str, int] = field(default_factory=dict)
    """By object: the raw integer that was last sent without an error, when the faults ended."""
    levels: dict[str, int] = field(default_factory=dict)
    """By actuator: the raw integer that the plant had then."""


@dataclass(frozen=True)
class Trial:
    """A station, the options of a short run, and the truth about it."""

    name: str
    machine: dict[str, Any]
    options: dict[str, Any]
    moments: dict[float, str]
    """When a fault begins, s, and what the machine does then."""
    level: Callable[[Any, Channel], int]
    """The raw integer that an output of the plant has."""
    lie: Callable[[Run], str]
    """What of the claim of a run that ended well is not true; empty if all is."""
    degraded: Callable[[Run], bool] = lambda run: False
    """Whether the result says that not all of the work was done."""
    watch: Callable[[Run], None] = lambda run: None
    """Called after each period."""
    slow: str = ""
    """Objects, as a pattern, on a driver off the cycle."""
    unseen: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)
    """By object: kinds of faults that the machine cannot notice with the sensors that it has, and why."""

    @property
    def station(self) -> str:
        return self.name.partition(" ")[0]

    def reason(self, path: str, kind: str) -> str:
        kinds, why = self.unseen.get(generalised(path), ((), ""))
        return why if kind in kinds else ""


# The truth of each station -----------------------------------------------------------------------------


def _parts_not_placed(run: Run) -> str:
    placed = run.reports["plant"]["parts_placed"]
    return "" if placed == 1 else f"{placed} of 1 parts placed"


LENGTH_ERROR = 2.0
"""mm; half of the tolerance, nearer to which no part is made."""


def _parts_wrongly_sorted(run: Run) -> str:
    report, accepted = run.reports["plant"], run.result["accepted"]
    delivered, wrong = report["parts_delivered"], report["wrongly_sorted"]
    if delivered != 4 or wrong or len(run.plant.accepted) != accepted:
        return f"{delivered} of 4 parts delivered, {wrong} to the wrong place"
    true = [part.length for part in run.seen["parts"]]
    errors = [abs(claimed - length) for claimed, length in zip(run.result["lengths_mm"], true, strict=True)]
    return f"a length is {max(errors):.1f} mm off" if max(errors) > LENGTH_ERROR else ""


def _watch_conveyor(run: Run) -> None:
    """The parts in the order in which they come."""
    run.seen.setdefault("parts", [*run.plant.belt, *run.plant.coming])


def _watch_furnace(run: Run) -> None:
    if run.machine.soaking:
        error = np.abs(run.plant.temperatures - run.machine.targets)
        run.seen["error"] = np.maximum(run.seen.get("error", 0.0), error)
        run.seen["soaked"] = run.seen.get("soaked", 0) + 1


def _zones_not_good(run: Run) -> str:
    """5 K are claimed; 1 K more is allowed for the thermocouples' lag and the converters."""
    if (soaked := run.seen["soaked"] * run.wired.period) < FURNACE.options["soak"] - 0.5:
        return f"soaked for {soaked:g} s"
    errors = run.result["soak_errors_K"]
    wrong = [
        f"zone {i}: {true:.1f} K off, {claimed:.1f} K claimed"
        for i, (claimed, true) in enumerate(zip(errors, run.seen["error"], strict=True))
        if claimed is not None and claimed <= 5.0 and true > 6.0
    ]
    return ", ".join(wrong)


def _watch_batch(run: Run) -> None:
    """The first of what is shown of a reactor that is not so."""
    if SHOWN not in run.seen and (wrong := "; ".join(filter(None, map(_not_so, run.machine.reactors)))):
        run.seen[SHOWN] = wrong


def _not_so(reactor: Any) -> str:
    """What the frame says of the state and the alarms of a reactor, and is not so; "": all is so."""
    machine, path, fault = reactor._machine.whole, reactor._path, reactor.cycle.fault is not None
    signals = {
        each.path: value for each, value in zip(frame_of(machine).signals, frame_of(machine).signal_values, strict=True)
    }
    engine = engine_of(machine)
    assert engine is not None
    alarms = dict(zip(engine.paths, engine.states.tolist(), strict=True))
    state, temperature = ProcedureState(int(signals[f"{path}.unit.state"])), reactor.temperature
    hot = alarms[f"{path}.hot"] in ACTIVE
    if state is not reactor.unit.state or (state is ProcedureState.ABORTED) is not fault:
        return f"{path}: {state.name} is shown, {'in' if fault else 'without a'} fault"
    if (alarms[f"{path}.fault"] in ACTIVE) is not fault:
        return f"{path}: the alarm of its fault is not that of {reactor.cycle.fault}"
    value = temperature.read()
    if temperature.quality is Quality.GOOD and hot is not (value > 95.0) and not 94.0 <= value <= 95.0:
        return f"{path}: the alarm of {value:g} degC is {'' if hot else 'not '}active"
    return ""


def _batches_not_good(run: Run) -> str:
    report = run.reports[DRIVER]
    if report["good"] != run.result["made"]:
        return f"{run.result['made']} were claimed; of the drained ones were good: {report['good'] or 'none'}"
    return ""


ZTHETA = Trial(
    "ztheta",
    {},
    {"parts": 1, "seed": 4},
    {2.0: "homing", 9.4: "turning a part"},
    lambda plant, channel: plant._levels[channel.index],  # type: ignore[attr-defined]
    _parts_not_placed,
    degraded=lambda run: bool(run.result),
    unseen={
        "gripper.vacuum": (
            ("noise",),
            "a chattering valve keeps a vacuum that lifts the part, and is below the threshold of the pressure switch",
        ),
    },
)
CONVEYOR = Trial(
    "conveyor",
    {},
    {"parts": 4, "patience": 0.5},
    {0.5: "starting", 2.2: "sorting"},
    lambda plant, channel: plant.outputs[channel.text],
    _parts_wrongly_sorted,
    watch=_watch_conveyor,
    unseen={
        "sorter.diverter": (
            ("stuck", "bit flip", "wrong length"),
            "no sensor sees the diverter, or the parts behind it",
        ),
    },
)
FURNACE = Trial(
    "furnace",
    {"zones": 3},
    {"peak": 200.0, "soak": 15.0, "ramp": 4.0},
    {5.0: "heating up", 70.0: "soaking"},
    lambda plant, channel: plant._levels[channel.kind, channel.zone],  # type: ignore[attr-defined]
    _zones_not_good,
    degraded=lambda run: bool(run.result["zones_good"] < 3),
    watch=_watch_furnace,
    unseen={
        "zones.*.temperature": (
            (SLOW,),
            "a zone has one thermocouple, and there is nothing that its reading could be compared with",
        ),
        "timer": (
            ("noise", "drift", SLOW),
            "the timer is the only clock of the machine; a count of missed periods within its range is believed",
        ),
    },
)
BATCH = Trial(
    "batch",
    {},
    {"batches": 1, "patience": 5.0},
    {10.0: "weighing", 130.0: "heating"},
    lambda plant, channel: plant.levels[channel.text],
    _batches_not_good,
    degraded=lambda run: bool(run.result["batches_dumped"]),
    watch=_watch_batch,
    unseen={
        "reactors.*.stirrer": (("stuck", "drift", "out of range"), "no sensor sees the stirrer turn"),
        "reactors.*.temperature": (
            (SLOW,),
            "a reactor has one thermometer, and there is nothing that its reading could be compared with",
        ),
        "line.inlets.*": (
            ("noise",),
            "the scale does not see what flows into the hopper while it is being emptied",
        ),
    },
)
SLOW_FURNACE = replace(
    FURNACE,
    name="furnace off the cycle",
    slow="zones.*",
    unseen={each: why for each, why in FURNACE.unseen.items() if each != "timer"},
)
TRIALS = {trial.name: trial for trial in (ZTHETA, CONVEYOR, FURNACE, SLOW_FURNACE, BATCH)}

# A slow device -----------------------------------------------------------------------------------------

SLOW_PERIOD, SLOW_MAX_AGE = 0.5, 1.5
"""Period and maximum age of the driver off the cycle, s."""


class SlowDevice(Wrapper):
    """Some channels of a plant, whose own driver opens and closes it."""

    withheld = (Reports,)
    initialize = of_driver("initialize")
    finalize = of_driver("finalize")
    reset = of_driver("reset")
    read = of_driver("read")
    write = of_driver("write")
    read_many = of_driver("read_many")
    write_many = of_driver("write_many")


def with_slow_device(wired: Wired, pattern: str) -> Wired:
    """The same machine, with these objects on a driver off the cycle."""
    proxy = OffCycle(SlowDevice(wired.drivers[DRIVER]), SLOW_PERIOD, SLOW_MAX_AGE)
    proxy.timeout = wired.drivers[DRIVER].timeout
    slow = [wire for wire in wired.wires if fnmatchcase(wire.item.path, f"{pattern}.*")]
    proxy.meet(
        [wire.channel for wire in slow],
        [wire.channel for wire in slow if wire.item.direction is Direction.INPUT],
        [wire.channel for wire in slow if wire.item.direction is Direction.OUTPUT],
    )
    wires = [replace(wire, driver=proxy) if wire in slow else wire for wire in wired.wires]
    return replace(wired, wires=wires, drivers={**wired.drivers, "slow": proxy})


# One cell ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, order=True)
class Cell:
    """One fault at one moment, and how the run ended."""

    station: str
    path: str
    kind: str
    moment: float
    verdict: str = ""
    detail: str = ""
    seconds: float = 0.0

    amount: str = ""

    @property
    def fault(self) -> str:
        kind = "drift" if self.kind == SLOW else self.kind
        return " ".join(filter(None, [self.path, kind, self.amount, f"at {self.moment:g} s"]))


class Hung(BaseException):
    """The wall-clock time of a cell is over."""


def carried_out(
    trial: Trial, faults: Iterable[str], most: int, then: Callable[[Run, float], None] = lambda run, time: None
) -> Run:
    """Run the station, at most so many periods. `then` is called after each period, with its time."""
    station = find(trial.station)
    machine, file = station.machine(**trial.machine), station.wiring(None)
    shares = distribute_options(trial.options, application=station.main, wiring=file)
    wired = resolve(machine, file, shares.wiring | {"fault": list(faults), "fault_seed": SEED})
    if trial.slow:
        wired = with_slow_device(wired, trial.slow)
    connection = connect(machine, wired)
    run = Run(machine, wired, connection.stop)

    injection = wired.injection
    assert injection is not None
    ended = injection.end

    def end() -> bool:
        """The machine was reset with its faults; it is again without them."""
        image = connection.machine.image
        run.sent = {item.path: image.raws[slot] for slot, item in enumerate(image.items)}
        outputs = [wire for wire in wired.wires if wire.item.direction is Direction.OUTPUT]
        run.levels = {wire.item.path: trial.level(run.plant, wire.channel) for wire in outputs}
        return ended()

    injection.end = end  # type: ignore[method-assign]

    def observe(frame: Any) -> None:
        run.periods += 1
        trial.watch(run)
        if run.periods >= most:
            run.stopped = True
            run.stop.request()
        then(run, frame.time)

    try:
        with connection as m:
            run.plant = connection.driver("plant")
            connection.machine.observers.append(observe)
            run.result = drive(m, station.main, **shares.application)
    except Exception as error:
        run.error = error
    run.reports = dict(connection.reports)
    return run


def not_at_default(run: Run, path: str, kind: str) -> list[str]:
    """The actuators that are not at their defaults in the plant. The one with the fault may be elsewhere if it was sent
    there, and, as all of a faulty driver, if the message names it."""
    named = {failure.path for failure in run.error.failures} if isinstance(run.error, StopError) else set()
    found = []
    for wire in run.wired.wires:
        if wire.item.direction is not Direction.OUTPUT:
            continue
        item, own = wire.item.path, wire.item.path == path
        if item in named and (own or path == DRIVER):
            continue
        level = run.sent[item] if own and kind not in LOUD else run.levels[item]
        if item in named or level != wire.raw(wire.item._default_value()):  # type: ignore[attr-defined]
            found.append(item)
    return found


def judged(trial: Trial, run: Run, path: str, kind: str) -> tuple[str, str]:
    """The verdict of a cell, and the detail."""
    if left := not_at_default(run, path, kind):
        return "UNSAFE", f"not at the default: {', '.join(left)}"
    if SHOWN in run.seen:
        return "WRONG", run.seen[SHOWN]
    if run.stopped:
        return "HANG", f"after {run.periods} periods"
    if run.error is not None:
        message = message_of(run.error)
        if not isinstance(run.error, UmoError) or len(message.splitlines()) > 2:
            return "TRACEBACK", message
        return ("not reached" if isinstance(run.error, StopError) else "stopped"), message
    if lie := trial.lie(run):
        reason = trial.reason(path, kind)
        return ("not seen", f"{lie}: {reason}") if reason else ("WRONG", lie)
    return ("degraded" if trial.degraded(run) else "ok"), str(plain(run.result))


class Attempt:
    """One cell that this process carries out, once it has begun."""

    cell: Cell | None = None
    begun: float

    def begin(self, cell: Cell) -> None:
        self.cell, self.begun = cell, time.perf_counter()
        signal.signal(signal.SIGALRM, _hang)
        signal.setitimer(signal.ITIMER_REAL, LONGEST, 1.0)  # again and again: a reset goes on after any exception

    def end(self, carry_out: Callable[[], Run]) -> Cell | None:
        """The cell, as its run ended; None if no cell was begun."""
        try:
            run = carry_out()
            if self.cell is None:
                return None
            verdict, detail = judged(TRIALS[self.cell.station], run, self.cell.path, self.cell.kind)
        except Hung:
            verdict, detail = "HANG", f"after {LONGEST:g} s of wall-clock time"
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        assert self.cell is not None
        seconds = time.perf_counter() - self.begun
        return replace(self.cell, verdict=verdict, detail=" ".join(detail.split()), seconds=seconds)


def _hang(number: int, frame: object) -> None:
    raise Hung


def tried(cell: Cell, most: int) -> Cell:
    """Carry out one cell from its start."""
    attempt = Attempt()
    attempt.begin(cell)
    done = attempt.end(lambda: carried_out(TRIALS[cell.station], [cell.fault], most))
    assert done is not None
    return done


# Many cells in one run ---------------------------------------------------------------------------------

AHEAD = 2.5
"""Periods before the moment of a fault at which the run forks."""


class Forks(Attempt):
    """Cells of a station in one run, which stays without a fault. At each moment it forks: each copy of the process
    goes on with the fault of one cell, and tells how that ended."""

    def __init__(self, groups: Sequence[Sequence[Cell]]) -> None:
        """Each group is one kind of fault on one object, at its moments."""
        self.groups = groups
        self.moments = sorted({cell.moment for group in groups for cell in group})
        self.done: list[list[Cell]] = [[] for _ in groups]
        self.effects: list[tuple[FaultyDriver, Sequence[Effect]]] = []
        self.shared: list[Any] = []
        """Memory that a copy of the process writes too: it is restored after each."""

    def then(self, run: Run, now: float) -> None:
        """After each period of the run."""
        if not self.effects:
            self._remove_the_faults(run)
            drivers = run.wired.drivers.values()
            self.shared = [each.exchange._memory for each in drivers if isinstance(each, OffCycle)]
        if self.cell is not None or not self.moments or run.wired.period is None:
            return
        if now < self.moments[0] - AHEAD * run.wired.period:
            return
        moment = self.moments.pop(0)
        for group, done in zip(self.groups, self.done, strict=True):
            for cell in group:
                wanted = cell.kind in AGAIN or not done or done[-1].verdict not in ENDED
                if cell.moment == moment and wanted:
                    ended = self._forked(cell)
                    if ended is None:
                        return
                    done.append(ended)
        if not self.moments:
            run.stop.request()

    def _remove_the_faults(self, run: Run) -> None:
        assert run.wired.injection is not None
        for driver in run.wired.injection.drivers:
            self.effects.append((driver, driver.effects))
            driver.effects = []

    def _forked(self, cell: Cell) -> Cell | None:
        """The cell, as a copy of this process ended it; None in the copy."""
        reader, self.writer = os.pipe()
        before = [bytes(memory) for memory in self.shared]
        if (copy := os.fork()) == 0:
            os.close(reader)
            text = str(InjectedFault.parse(cell.fault))
            for driver, effects in self.effects:
                driver.effects = [effect for effect in effects if effect.text == text]
            self.begin(cell)
            return None
        os.close(self.writer)
        with open(reader, "rb") as answer:
            told = answer.read()
        os.waitpid(copy, 0)
        for memory, content in zip(self.shared, before, strict=True):
            memory[:] = content
        return pickle.loads(told) if told else replace(cell, verdict="TRACEBACK", detail="its process died")

    def tried(self, most: int) -> list[Cell]:
        """Carry out the cells."""
        cells = [cell for group in self.groups for cell in group]
        trial, faults = TRIALS[cells[0].station], [cell.fault for cell in cells]
        try:
            if done := self.end(lambda: carried_out(trial, faults, most, self.then)):
                os.write(self.writer, pickle.dumps(done))
        finally:
            if self.cell is not None:
                os._exit(0)
        return [cell for group in self.done for cell in group]


# All of them -------------------------------------------------------------------------------------------


def cells(station: str, *paths: str) -> Iterator[Cell]:
    """All cells of a station, or those of some objects."""
    trial = TRIALS[station]
    machine = find(trial.station).machine(**trial.machine)
    items = {item.path: item for item in atoms(machine)}
    for path in paths or [*items, DRIVER]:
        item = items.get(path)
        for kind in COLUMNS if item else KINDS_OF_DRIVERS:
            if isinstance(item, Binary) and kind in DRIFTS:
                continue
            if kind == NO_ROOM and _refused(trial, f"{path} {kind}"):
                continue
            slow = f"{(item.maximum - item.minimum) / 10_000:.3g} {item.units}/s" if kind == SLOW else ""  # type: ignore[union-attr]
            for moment in list(trial.moments)[: 1 if kind in LOUD else None]:
                yield Cell(station, path, kind, moment, amount=slow)


def _refused(trial: Trial, fault: str) -> bool:
    """Whether the channel has no such level."""
    station = find(trial.station)
    try:
        resolve(station.machine(**trial.machine), station.wiring(None), {"fault": fault})
    except OptionError:
        return True
    return False


def normal(station: str) -> int:
    """The periods of a run without faults."""
    run = carried_out(TRIALS[station], ["timer noise 0"], 10**9)
    assert run.error is None and not TRIALS[station].lie(run), run
    return run.periods


def all_tried(wanted: Iterable[Cell], processes: int, show: Callable[[str], object] = lambda text: None) -> list[Cell]:
    """All the cells, carried out by so many processes. `show` is told the progress."""
    wanted = list(wanted)
    place = {(cell.station, cell.path, cell.kind, cell.moment): number for number, cell in enumerate(wanted)}
    runs = list(_runs(wanted, processes))
    done: list[Cell] = []
    with get_context("spawn").Pool(processes, _quiet) as pool:
        for number, found in enumerate(pool.imap_unordered(_tried, runs), start=1):
            done += found
            show(f"\r{number} of {len(runs)} runs: {len(done)} cells\x1b[K")
    show("\r\x1b[K")
    return sorted(done, key=lambda cell: place[cell.station, cell.path, cell.kind, cell.moment])


def _runs(wanted: Iterable[Cell], count: int) -> Iterator[tuple[int, Sequence[Sequence[Cell]]]]:
    """The most periods, and the cells, of each run: so many for each station."""
    for station, cells in groupby(wanted, key=lambda cell: cell.station):
        groups = [list(group) for _, group in groupby(cells, key=lambda cell: (cell.path, cell.kind))]
        most = SLOWER * normal(station)
        yield from ((most, part) for part in (groups[first::count] for first in range(count)) if part)


def _quiet() -> None:
    logging.getLogger("umo").setLevel(logging.CRITICAL)


def _tried(given: tuple[int, Sequence[Sequence[Cell]]]) -> list[Cell]:
    most, groups = given
    return Forks(groups).tried(most)


# The page ----------------------------------------------------------------------------------------------

INTRODUCTION = """# The fault matrix

Every station that ships, run in virtual time under every kind of fault (docs/howto-inject-faults.md) on every one of
its objects and on its driver. What a run claims is compared with what the plant knows.

{words}

Several words in a cell: the fault began at several moments of the run, in this order. `{loud}` begin at the first one
only, and so do the others if the run came to its end with them, but `stuck` and `wrong length`. Amounts are the
defaults; a slow drift is a ten-thousandth of the range in a second. The faults last to the end of the run.

Made on {day}, seed {seed}: {count} runs.
"""


def page(done: Sequence[Cell]) -> str:
    words = "\n".join(["| word | how the run ended |", "| --- | --- |", *(f"| {k} | {v} |" for k, v in WORDS.items())])
    head = INTRODUCTION.format(
        words=words, loud="`, `".join(LOUD), day=date.today().isoformat(), seed=SEED, count=len(done)
    )
    return "\n".join([head, *(section(trial, done) for trial in TRIALS.values())])


def section(trial: Trial, done: Sequence[Cell]) -> str:
    mine = [cell for cell in done if cell.station == trial.name]
    moments = ", ".join(f"{what} ({moment:g} s)" for moment, what in trial.moments.items())
    lines = [f"## {trial.name}", "", f"Moments: {moments}.", "", *table(mine)]
    unseen = {cell.path: cell for cell in mine if cell.verdict == "not seen"}
    if unseen:
        reasons = dict.fromkeys(
            f"- `{generalised(path)}`: {trial.reason(path, cell.kind)}." for path, cell in unseen.items()
        )
        lines += ["", "Not seen:", "", *reasons]
    return "\n".join([*lines, ""])


def table(done: Sequence[Cell]) -> list[str]:
    """A row for each object, a column for each kind."""
    cells: dict[str, dict[str, list[Cell]]] = {}
    for cell in done:
        cells.setdefault(cell.path, {}).setdefault(cell.kind, []).append(cell)
    head = ["| object | " + " | ".join(COLUMNS) + " |", "| --- " * (1 + len(COLUMNS)) + "|"]
    return head + [
        f"| {path} | " + " | ".join(_words(kinds.get(kind, [])) for kind in COLUMNS) + " |"
        for path, kinds in cells.items()
    ]


def _words(found: Sequence[Cell]) -> str:
    words = [cell.verdict for cell in sorted(found, key=lambda cell: cell.moment)]
    return ", ".join(words if len(set(words)) > 1 else words[:1]) or "-"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("station", nargs="?", choices=list(TRIALS))
    parser.add_argument("path", nargs="*")
    given = parser.parse_args()
    names = [given.station] if given.station else list(TRIALS)
    begun = time.perf_counter()
    done = all_tried(
        [cell for name in names for cell in cells(name, *given.path)], os.cpu_count() or 1, sys.stderr.write
    )
    if given.station is None:
        print(page(done))
    for cell in done:
        if given.station is not None or cell.verdict in DEFECTS:
            out = sys.stdout if given.station else sys.stderr
            print(f"{cell.verdict:11} {cell.seconds:5.1f} s  {cell.fault}: {cell.detail}", file=out)
    bad = sum(cell.verdict in DEFECTS for cell in done)
    print(f"{len(done)} runs in {time.perf_counter() - begun:.0f} s, {bad} defects", file=sys.stderr)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
