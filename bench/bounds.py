"""What a client, a lease, a mode, a fault, a clear, a lapse or a flood of alarms costs the one period that it meets.

python -m bench --bounds [REPETITIONS] [--only TEXT] [--markdown]

Each cause is brought about in a machine with 1,000 and with 10,000 objects of each kind (`bounded_plant.py`), on a
simulated driver, with frames published; the period that it meets and idle periods are timed in turns, in time of the
processor. Of a cause that resets actuators the time until they are at their defaults is compared with that of `reset()`
of the same actuators in the same run; what else it costs has the bound of the others.
"""

from __future__ import annotations

import gc
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

from bench.bounded_plant import Rig, SlowRig, failing
from umo.operation.commands.client_control import COMMANDS_PER_PERIOD

TITLE = "What one cause costs the period that it meets"
SIZES = 1_000, 10_000
LIMIT = 2.0
"""ms that a cause may cost at 1,000 objects."""
RESET_RATIO = 1.3
"""The same of a cause that resets, as a ratio to `reset()` of the same actuators."""
LINEAR = 13.0
"""Ratio of the costs at 10,000 and 1,000 objects above which a cause is worse than linear: 10 and what caches add."""
NOTICEABLE = 2.0
"""ms at 10,000 objects below which the ratio is not judged."""
REPETITIONS = 9
WIDTH = 200
"""Characters of a line of the table."""


def _nothing(rig: Rig) -> None:
    """Nothing is to be prepared."""


@dataclass(frozen=True)
class Cause:
    """One cause. `arm` brings it about in the next period; `before` and `after` are not timed."""

    name: str
    arm: Callable[[Rig], object]
    verbs: Sequence[str] = ()
    """The commands of clients that it measures."""
    before: Callable[[Rig], object] = _nothing
    after: Callable[[Rig], object] = _nothing
    resets: Callable[[Rig], Sequence[Any]] | None = None
    """The actuators that are reset; None: none is."""
    reacts: bool = False
    """Whether the resets are the reaction to an interlock: nothing else may precede them."""
    rig: type[Rig] = Rig
    """The machine in which it is brought about."""
    expected: str = ""
    """The beginning of the answer to the last command, or of the last event: that it did happen."""


@dataclass
class Cost:
    """What a cause costs at one size, ms."""

    size: int
    """Number of the objects of each kind."""

    idle: list[float] = field(default_factory=list)
    met: list[float] = field(default_factory=list)
    at_defaults: list[float] = field(default_factory=list)
    """From the tick until the actuators concerned were reset."""
    reset: list[float] = field(default_factory=list)

    @property
    def limit(self) -> float:
        """ms that it may take, beside resets."""
        return LIMIT * max(self.size / SIZES[0], 1.0)

    @property
    def extra(self) -> float:
        return max(median(more - less for more, less in zip(self.met, self.idle, strict=True)), 0.0)

    @property
    def ratio(self) -> float:
        """The time until the actuators are at their defaults, as a ratio to `reset()`."""
        each = zip(self.at_defaults, self.idle, self.reset, strict=True)
        return median((until - idle) / reset for until, idle, reset in each)

    @property
    def rest(self) -> float:
        """What it costs beside the resets."""
        each = zip(self.met, self.idle, self.reset, strict=True)
        return median(more - less - RESET_RATIO * reset for more, less, reset in each)


def measure(cause: Cause, rig: Rig, repetitions: int) -> Cost:
    """In turns with idle periods."""
    cost = Cost(rig.count)
    for _ in range(repetitions):
        cause.before(rig)
        rig.drain()
        cost.idle.append(rig.steps(3) * 1e3)
        cause.arm(rig)
        cost.met.append(rig.step() * 1e3)
        cost.at_defaults.append(rig.were_reset * 1e3)
        if cause.expected and not rig.happened(cause.expected):
            raise AssertionError(f"{cause.name}: {cause.expected!r} did not happen, but {rig.last()!r}")
        rig.drain()
        cause.after(rig)
        rig.drain()
        if cause.resets is not None:
            rig.write_all(5.0)
            rig.steps(2)
            cost.reset.append(rig.reset_time(cause.resets(rig)) * 1e3)
            rig.steps(2)
    return cost


@contextmanager
def _without_collector() -> Iterator[None]:
    """As in the control process."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


# The causes -----------------------------------------------------------------------------------------------


def _four(do: str, path: str = "", value: Any = None, **more: Any) -> Callable[[Rig], None]:
    """As many of one command as are carried out in a period; `{}` in the path counts."""

    def arm(rig: Rig) -> None:
        for number in range(COMMANDS_PER_PERIOD):
            rig.ask(do, path.format(number), value, **more)

    return arm


def _asks(do: str, path: str = "", value: Any = None, **more: Any) -> Callable[[Rig], None]:
    return lambda rig: rig.ask(do, path, value, **more)


def _in_turn(*steps: Callable[[Rig], object]) -> Callable[[Rig], None]:
    def all_of_them(rig: Rig) -> None:
        for step in steps:
            step(rig)
            rig.drain()

    return all_of_them


def _lease(rig: Rig) -> None:
    rig.do("lease")


def _manual(rig: Rig) -> None:
    rig.do("lease")
    rig.do("mode", value="manual")


def _automatic(rig: Rig) -> None:
    rig.signs.silent = False
    rig.do("lease", over=True)
    rig.do("mode", value="automatic")
    rig.do("give back")


def _held(rig: Rig) -> None:
    _manual(rig)
    rig.hold_all()


def _driven(rig: Rig) -> None:
    rig.write_all(5.0)


def _driven_valves(rig: Rig) -> None:
    for each in rig.m.valves:
        each.write(5.0)


def _driven_fans(rig: Rig) -> None:
    for each in rig.m.hall.fans:
        each.write(5.0)


def _rest(rig: Rig) -> None:
    rig.write_all(0.0)


def _set(name: str, value: Any, where: str = "") -> Callable[[Rig], None]:
    """Set an attribute of the machine, or of each of its zones."""

    def act(rig: Rig) -> None:
        for owner in rig.m.zones if where == "zones" else [rig.m]:
            setattr(owner, name, value)

    return act


def _break_one(rig: Rig) -> None:
    rig.m.zones[0].broken = True


def _acknowledged(rig: Rig) -> None:
    rig.m.stopped = rig.m.each_stopped = False
    rig.drain()
    rig.m.acknowledge()


def _cleared(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.broken = False
    if rig.drivers["temperatures"].away:
        rig.drivers["temperatures"].away = False
        _look_now(rig)
        rig.steps(3)
    rig.drain()
    rig.m.cycle.clear()


def _valves(rig: Rig) -> Sequence[Any]:
    return rig.m.valves


def _probes(rig: Rig) -> Sequence[Any]:
    return rig.m.probes


def _heaters(rig: Rig) -> Sequence[Any]:
    return rig.heaters


def _fans(rig: Rig) -> Sequence[Any]:
    return rig.m.hall.fans


def _cold(yes: bool) -> Callable[[Rig], None]:
    def act(rig: Rig) -> None:
        for zone in rig.m.zones:
            rig.drivers["temperatures"].set(zone.temperatures[0].path, -100 if yes else 100)

    return act


def _settle_alarms(rig: Rig) -> None:
    """All alarms normal again."""
    _cold(False)(rig)
    for _ in range(rig.count // 10):
        rig.step()
    rig.do("lease", over=True)
    rig.do("acknowledge alarm")
    for _ in range(rig.count // 10):
        rig.step()
    rig.do("give back")


def _alarmed(rig: Rig) -> None:
    _cold(True)(rig)
    for _ in range(rig.count // 10):
        rig.step()
    _lease(rig)


def _fail_sequences(rig: Rig) -> None:
    for zone in rig.m.zones:
        zone.cycle.start(failing())
    rig.step()


def _fail_hall(rig: Rig) -> None:
    rig.m.hall.cycle.start(failing())
    rig.step()


def _away(name: str, yes: bool) -> Callable[[Rig], None]:
    def act(rig: Rig) -> None:
        rig.drivers[name].away = yes

    return act


def _long_away(rig: Rig) -> None:
    """The probes' device was away for long enough to be initialised again."""
    rig.drivers["probes"].away = True
    for _ in range(600):
        rig.step()


def _look_now(rig: Rig) -> None:
    for away in rig.machine.image.transfer.callees.away._away.values():
        away.absence.due = 0.0


def _found(rig: Rig) -> None:
    rig.drivers["probes"].away = False
    _look_now(rig)


def _probes_back(rig: Rig) -> None:
    _found(rig)
    rig.steps(3)


def _expire(rig: Rig) -> None:
    """The valves' commands expire in the period after this."""
    for valve in rig.m.valves:
        valve.write(5.0)
    rig.step()
    for command in rig.machine.claims.by_slot.values():
        if command.written is not None:
            command.written -= 2.0


def _silent(rig: Rig) -> None:
    """The next period finds no heartbeat for what is held, but one of the lease itself."""
    rig.signs.silent = True
    rig.signs.now += 0.6


def _lease_lapses(rig: Rig) -> None:
    rig.signs.silent = True
    rig.signs.now += 5.0


def _started_hall(rig: Rig) -> None:
    _lease(rig)
    for do in ("reset", "start"):
        rig.do("call", f"hall.unit.{do}")
    _driven_fans(rig)


def _stopped_hall(rig: Rig) -> None:
    rig.do("call", "hall.unit.stop")
    rig.do("give back")


def _hastened(rig: Any) -> None:
    rig.hasten()


def _old(name: str, ages: int) -> Callable[[Any], None]:
    return lambda rig: rig.until_old(name, ages)


def _renewed(name: str) -> Callable[[Any], None]:
    return lambda rig: rig.until_back(name)


MISSPELT = "zones.{}.heaters.5x"
BACK = _asks("give back")
RELAY = {"kind": "relay", "amplitude": 1.0}
FILLING = {"name": "first", "content": json.dumps({"levels": [1] * 440}, separators=(",", ":"))}
"""The largest recipe that a client can send: a command has `MAX_COMMAND_BYTES` bytes."""
MISTAKES = {"name": "first", "content": json.dumps({f"k{number}": "1 lb" for number in range(60)})}
CAUSES = [
    # Leases
    Cause("a lease is taken", _asks("lease"), ["lease"], after=BACK, expected="done"),
    Cause("a lease is given back while nothing is held", BACK, ["give back"], before=_lease, expected="done"),
    Cause("a lease is given back while every valve is held", BACK, before=_held, after=_automatic, expected="done"),
    Cause("a lease is taken over while every valve is held", lambda rig: rig.ask_other("lease", over=True),
          before=_held, after=_automatic, expected="done"),
    Cause("a lease lapses while every valve is held", _lease_lapses, before=_held, after=_automatic),
    Cause("the client of every held valve sends no more heartbeats", _silent, before=_held, after=_automatic),
    # Commands
    Cause("four writes", _four("write", "valves.{}", 5.0), ["write"], before=_manual, after=_automatic,
          expected="done"),
    Cause("four writes to misspelt paths", _four("write", MISSPELT, 5.0), before=_manual, after=_automatic,
          expected="refused"),
    Cause("four written values are let go", _four("let go", "valves.{}"), ["let go"], before=_held, after=_automatic,
          expected="done"),
    Cause("four numbers are tuned", _four("tune", "zones.{}.gain", 2.0), ["tune"], before=_lease, after=BACK,
          expected="done"),
    Cause("four misspelt numbers are tuned", _four("tune", "zones.{}.gian", 2.0), before=_lease, after=BACK,
          expected="refused"),
    Cause("four actions are called", _four("call", "zones.{}.warm"), ["call"], before=_manual, after=_automatic,
          expected="done"),
    Cause("four misspelt actions are called", _four("call", "zones.{}.wram"), before=_manual, after=_automatic,
          expected="refused"),
    Cause("four laws report their structure", _four("call", "zones.{}.law"), before=_lease, after=BACK,
          expected="done"),
    Cause("four experiments on laws begin", _four("call", "zones.{}.experiment", arguments=RELAY), before=_manual,
          after=_automatic, expected="begun"),
    Cause("four experiments on objects without a law", _four("call", "probes.{}.experiment", arguments=RELAY),
          before=_manual, after=_automatic, expected="refused"),
    Cause("four recipes with hundreds of values are chosen", _four("call", "hall.book.choose", arguments=FILLING),
          before=_lease, after=BACK, expected="done"),
    Cause("four recipes with dozens of wrong values are refused", _four("call", "hall.book.choose", arguments=MISTAKES),
          before=_lease, after=BACK, expected="refused"),
    Cause("all actions are cancelled", _asks("cancel"), ["cancel"], before=_lease, after=BACK, expected="done"),
    Cause("four unknown commands", _four("wirte", "valves.{}", 5.0), before=_lease, after=BACK, expected="refused"),
    Cause("a stop is requested", lambda rig: rig.ask_to_stop(), after=lambda rig: rig.go_on()),
    # Modes
    Cause("the mode becomes manual while every valve is driven", _asks("mode", value="manual"), ["mode"],
          before=_in_turn(_lease, _driven_valves), after=_in_turn(_automatic, _rest), expected="done"),
    Cause("the mode becomes automatic after every valve was driven", _asks("mode", value="automatic"),
          before=_in_turn(_lease, _driven_valves, _asks("mode", value="manual")), after=_in_turn(BACK, _rest),
          expected="done"),
    # Interlocks
    Cause("an interlock over all valves begins", _set("stopped", True), before=_driven, after=_acknowledged,
          resets=_valves, reacts=True, expected="emergency stop"),
    Cause("an interlock over all valves ends", _set("stopped", False), before=_set("stopped", True),
          after=_acknowledged),
    Cause("an interlock of each heater begins", _set("each_stopped", True), before=_driven, after=_acknowledged,
          resets=_heaters, reacts=True),
    Cause("an interlock of each heater ends", _set("each_stopped", False), before=_set("each_stopped", True)),
    Cause("four commands acknowledge everything while all valves are latched", _four("acknowledge"), ["acknowledge"],
          before=_in_turn(_lease, _set("stopped", True), _set("stopped", False)), after=BACK, expected="done"),
    Cause("the commands of all valves expire", _expire, after=_rest),
    # Faults
    Cause("the law of one zone fails", _break_one, before=_driven, after=_cleared),
    Cause("the law of each zone fails", _set("broken", True, "zones"), before=_driven, after=_cleared,
          resets=_heaters),
    Cause("a sequence of each zone fails", _fail_sequences, before=_driven, after=_cleared, resets=_heaters),
    Cause("the driver of the sensors fails: each zone is in fault", _away("temperatures", True), before=_driven,
          after=_cleared, resets=_heaters),
    Cause("one equipment with many actuators fails", _fail_hall, before=_driven, after=_cleared, resets=_fans),
    Cause("everything is cleared while each zone is in fault", _asks("clear"), ["clear"],
          before=_in_turn(_lease, _fail_sequences), after=BACK, resets=_heaters, expected="done"),
    Cause("four clears of misspelt paths", _four("clear", MISSPELT), before=_lease, after=BACK, expected="refused"),
    Cause("all probes are marked BAD", _away("probes", True), after=_probes_back),
    Cause("a driver that was away for long is back", _found, before=_long_away, after=_probes_back, resets=_probes),
    # Off the cycle
    Cause("the values of slow devices arrive", _hastened, rig=SlowRig),
    Cause("the values of a slow device are old: they are marked STALE", _old("probes", 1), after=_renewed("probes"),
          rig=SlowRig),
    Cause("the values of a slow device have failed: they are marked BAD", _old("probes", 2), after=_renewed("probes"),
          rig=SlowRig),
    Cause("the values of a slow device have failed: each zone is in fault", _old("temperatures", 2), before=_driven,
          after=_in_turn(_renewed("temperatures"), _cleared), resets=_heaters, rig=SlowRig, expected="in fault"),
    # Units
    Cause("a unit with many actuators is held", _asks("call", "hall.unit.hold"), before=_started_hall,
          after=_in_turn(_stopped_hall, _rest), expected="done"),
    Cause("a unit with many actuators continues", _asks("call", "hall.unit.unhold"),
          before=_in_turn(_started_hall, _asks("call", "hall.unit.hold")), after=_in_turn(_stopped_hall, _rest),
          expected="done"),
    # Alarms
    Cause("the alarms of all zones begin in one period", _cold(True), after=_settle_alarms),
    Cause("all alarms are acknowledged", _asks("acknowledge alarm"), ["acknowledge alarm"], before=_alarmed,
          after=_settle_alarms, expected="done"),
    Cause("all alarms are reset", _asks("reset alarm"), ["reset alarm"], before=_lease, after=BACK, expected="done"),
    Cause("a thousand alarms are shelved", _asks("shelve", "probes", value=600), ["shelve"], before=_lease,
          after=_in_turn(_asks("unshelve", "probes"), BACK), expected="done"),
    Cause("a thousand alarms that a pattern names are shelved", _asks("shelve", "probes.*", value=600), before=_lease,
          after=_in_turn(_asks("unshelve", "probes"), BACK), expected="done"),
    Cause("a thousand alarms are unshelved", _asks("unshelve", "probes"), ["unshelve"],
          before=_in_turn(_lease, _asks("shelve", "probes", value=600)), after=BACK, expected="done"),
    Cause("a thousand alarms are put out of service", _asks("remove from service", "probes"), ["remove from service"],
          before=_lease, after=_in_turn(_asks("return to service", "probes"), BACK), expected="done"),
    Cause("a thousand alarms return to service", _asks("return to service", "probes"), ["return to service"],
          before=_in_turn(_lease, _asks("remove from service", "probes")), after=BACK, expected="done"),
    Cause("four misspelt alarms are shelved", _four("shelve", "zones.{}.clod", 600), before=_lease, after=BACK,
          expected="refused"),
]  # fmt: skip


# The table ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One cause at all sizes."""

    cause: Cause
    costs: Sequence[Cost]

    @property
    def broken(self) -> str:
        """Which bound is broken, in words; "": none."""
        if self.cause.reacts and (ratio := max(each.ratio for each in self.costs)) > RESET_RATIO:
            return f"at the defaults after {ratio:.2f} times reset()"
        for cost in self.costs:
            found = cost.extra if self.cause.resets is None else cost.rest
            if found > cost.limit:
                return f"{found:.1f} ms at {cost.size:,} objects"
        small, large = self.costs[0].extra, self.costs[-1].extra
        worse = large > NOTICEABLE and large > LINEAR * max(small, NOTICEABLE / LINEAR)
        return "worse than linear" if worse else ""

    @property
    def markdown(self) -> str:
        """The row of the page docs/bounds.md."""
        verbs = ", ".join(f"`{verb}`" for verb in self.cause.verbs)
        bounds = (bound_of(self.cause, each.limit) for each in self.costs)
        return f"| {' | '.join([self.cause.name, verbs, *bounds, *map(self._shown, self.costs)])} |"

    def _shown(self, cost: Cost) -> str:
        beside = f" ({_figure(cost.rest)})" if self.cause.resets is not None else ""
        return f"{_figure(cost.extra)}{beside}"


def run(
    console: Console, repetitions: int, only: str = "", sizes: Sequence[int] = SIZES, *, markdown: bool = False
) -> int:
    """Measure and print, or print the rows of the page; exit status 1 if a bound is broken."""
    causes = [each for each in CAUSES if only in each.name]
    found: dict[str, list[Cost]] = {cause.name: [] for cause in causes}
    with console.status(TITLE) as status:
        for size in sizes:
            few = repetitions if size == sizes[0] else max(repetitions // 3, 1)
            for kind in dict.fromkeys(cause.rig for cause in causes):
                status.update(f"{size:,} objects: connecting")
                rig = kind(size)
                try:
                    with _without_collector():
                        rig.steps(20)
                        for cause in (each for each in causes if each.rig is kind):
                            status.update(f"{size:,} objects: {cause.name}")
                            found[cause.name].append(measure(cause, rig, few))
                finally:
                    rig.close()
    rows = [Row(cause, found[cause.name]) for cause in causes]
    if markdown:
        print(*(row.markdown for row in rows), sep="\n")
    else:
        Console(width=WIDTH, highlight=False).print(_table(rows, sizes))
    broken = [f"{row.cause.name}: {row.broken}" for row in rows if row.broken]
    for text in broken:
        console.print(f"broken: {text}")
    return 1 if broken else 0


def _table(rows: Sequence[Row], sizes: Sequence[int]) -> Table:
    grid = Table(title=f"{TITLE} (ms)")
    grid.add_column("cause", no_wrap=True)
    grid.add_column("bound", no_wrap=True)
    for size in sizes:
        for what in ("idle", "with it", "extra", "beside", "/ reset()"):
            grid.add_column(f"{size:,}\n{what}", justify="right")
    grid.add_column("10 x", justify="right")
    for row in rows:
        cells = []
        for cost in row.costs:
            ratio = f"{cost.ratio:.2f}" if cost.reset and any(cost.at_defaults) else ""
            beside = f"{cost.rest:.2f}" if cost.reset else ""
            cells += [f"{median(cost.idle):.2f}", f"{median(cost.met):.2f}", f"{cost.extra:.2f}", beside, ratio]
        small, large = row.costs[0].extra, row.costs[-1].extra
        linear = f"{large / small:.1f}" if small > 0 else ""
        grid.add_row(row.cause.name, bound_of(row.cause), *cells, linear)
    return grid


def bound_of(cause: Cause, limit: float = LIMIT) -> str:
    """The bound of a cause, as the page has it; `limit` in ms."""
    if cause.resets is None:
        return f"{limit:g} ms"
    return f"{RESET_RATIO:g} times `reset()`{', then' if cause.reacts else ' plus'} {limit:g} ms"


def _figure(ms: float) -> str:
    """Two digits: `0.2`, `3.5`, `13`."""
    return f"{ms:.0f}" if ms >= 9.95 else f"{max(ms, 0.0):.1f}"
