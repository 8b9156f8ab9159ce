"""`umo tune law`: finds the gains of a law, from an experiment or from a recorded run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

from umo.clients.remote import RemoteStation
from umo.commissioning.tuning.gain_rules import SPEEDS
from umo.commissioning.tuning.law_facts import LawFacts
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.plain_result import as_data, finite, settings_of
from umo.commissioning.tuning.recorded_response import recorded_response
from umo.commissioning.tuning.tuning_result import FASTER, PRESENT, TuningResult, tuned, tuned_axis
from umo.cycle.law_loops import Loops
from umo.errors import FramesError, OptionError, RangeError
from umo.objects import numbers_of
from umo.objects.laws import laws_in
from umo.objects.presentation.rows import families, folded
from umo.process.frames import Reader
from umo.process.frames.search import find_elsewhere, meant_by, several_runs
from umo.process.job import Job, Plan
from umo.system.packages import how_to_install
from umo.system.streams import limit_waits
from umo_command.console import err, out, say
from umo_command.do.commanding import hinting, leased
from umo_command.progress_line import OneLine
from umo_command.show.stations import readers
from umo_command.station_named import station_named
from umo_command.station_options import machine_with, parse
from umo_command.tune.told import SettingsReport, settings_report, tables_of
from umo_command.values import check_picture, difference, number

MAX_LIMITED_SHARE = 0.02
"""Largest share of an experiment during which an inner law may be at its limit without a remark."""
LOW_FIT = 90.0
"""The fit in per cent below which a remark is printed."""


@dataclass(frozen=True)
class TuningOrder:
    """The order that the command line gives."""

    relay: str | None = None
    step: str | None = None
    moves: str | None = None
    file: Path | None = None
    start: float | None = None
    stop: float | None = None
    at: float | None = None
    hysteresis: float | None = None
    within: float | None = None
    cycles: int | None = None
    lasting: float | None = None
    name: str = "balanced"
    derivative: bool = False
    sensor: str = ""
    actuator: str = ""
    wiring: str | None = None
    picture: Path | None = None
    as_json: bool = False
    over: bool = False
    cascade: bool = False

    def check(self) -> None:
        """Raise OptionError unless the order names one source and a set of gains, and its options go together."""
        sources = {"--relay": self.relay, "--step": self.step, "--moves": self.moves, "--file": self.file}
        given = [name for name, value in sources.items() if value is not None]
        if len(given) != 1:
            raise OptionError(f"give one of {', '.join(sources)}" + (f", not {' and '.join(given)}" if given else ""))
        if self.file is None and (self.start, self.stop) != (None, None):
            raise OptionError("--from and --to can only be used with --file")
        if self.cascade and self.relay is None and self.step is None:
            raise OptionError("--cascade can only be used with --relay or --step")
        if self.cascade and not (self.relay or self.step or "").strip().endswith("%"):
            raise OptionError("with --cascade the amplitude must be a share of the range, such as 10%")
        if self.cascade and (self.sensor or self.actuator):
            raise OptionError("--cascade finds the sensors and actuators: leave out --sensor and --actuator")
        if self.name not in (names := (*SPEEDS, PRESENT)):
            raise OptionError(f"--gains: there is no set {self.name!r}: {', '.join(names)}")
        check_picture(self.picture)


def tune_law(station: str, place: str, order: TuningOrder, options: Sequence[str]) -> int:
    """Find the gains and print them. If no law is given, list the laws. Return the exit status."""
    if not place:
        return _list_laws(station, order, options)
    order.check()
    if find_spec("scipy") is None:
        raise OptionError(f"umo tune law needs scipy: {how_to_install('tune')}")
    if order.picture is not None and find_spec("matplotlib") is None:
        raise OptionError(f"a plot needs matplotlib: {how_to_install('plot')}")
    limit_waits()
    running = None if order.file is not None else _running(station)
    if running is not None:
        with RemoteStation(running) as remote:
            results = _live(remote, place, order)
            known = {each.path: each.bounds for each in remote.reader.layout.described.tunables}
    else:
        results, known = _alone(station, place, order, options)
    for result in results:
        _say_doubts(result)
    told = [settings_report(result, order.name, station, known) for result in results]
    if order.as_json:
        each = [
            as_data(result) | {"chosen": {"name": chosen.name, **finite(chosen.values)}}
            for result, chosen in zip(results, told, strict=True)
        ]
        out.print_json(json.dumps({"inner": each[0], "outer": each[1]} if order.cascade else each[0]))
    else:
        _print(results, told)
    if order.picture is not None:
        from umo_command.tune.picture import save_tuning_plot

        save_tuning_plot(results[-1], order.picture, f"umo tune law {station} {place}")
        err.print(f"plot: {order.picture}", soft_wrap=True)
    return 0


def _list_laws(station: str, order: TuningOrder, options: Sequence[str]) -> int:
    """Print the laws of a station, those of a list in one line."""
    found = station_named(station)
    machine = machine_with(found, parse(found, order.wiring, options))
    paths = Loops(machine, laws_in(machine)).paths
    for places in families(paths).values():
        out.print(folded([paths[place] for place in places]), markup=False, soft_wrap=True)
    if not paths:
        out.print(f"{found.name} has no law that can be tuned", markup=False)
    return 0


def _print(results: Sequence[TuningResult], told: Sequence[SettingsReport]) -> None:
    for result, chosen in zip(results, told, strict=True):
        for table in tables_of(result):
            out.print(table)
        for line in chosen.lines:
            out.print(line, soft_wrap=True)


def _say_doubts(result: TuningResult) -> None:
    if result.identified.fit < LOW_FIT:
        better = "--moves" if result.facts.axis and result.axis is None else "a larger amplitude"
        say(f"the model describes only {result.identified.fit:.0f} % of the response; {better} may do better")
    if result.faster is not None and result.faster < FASTER:
        say(
            f"{result.facts.inner}, the inner law, is only {result.faster:.1f} times faster than the rest of the "
            f"process (it needs at least {FASTER:g}; 5 is better): make the inner law faster, and repeat the experiment"
        )


def _found(order: TuningOrder, facts: LawFacts, response: MeasuredResponse) -> TuningResult:
    if order.moves is not None or (facts.axis and order.file is not None):
        return tuned_axis(facts, response)
    return tuned(facts, response, order.relay is not None, order.derivative)


# A station that runs ---------------------------------------------------------------------------------------


def _running(name: str) -> Reader | None:
    """Return the frames of the run with this name, or None if there is no such run. Raises FramesError if there are
    several."""
    if (elsewhere := find_elsewhere(name)) is not None:
        return elsewhere
    found = readers()
    fitting = meant_by(name, found)
    for each in found:
        if len(fitting) != 1 or each is not fitting[0]:
            each.close()
    if len(fitting) > 1:
        raise FramesError(several_runs(name, fitting))
    return fitting[0] if fitting else None


def _live(station: RemoteStation, place: str, order: TuningOrder) -> list[TuningResult]:
    """Tune the law; with --cascade its inner law first."""
    from umo.commissioning.tuning.live_experiment import facts_of
    from umo.commissioning.tuning.tried_gains import check_tunable, trying

    if order.at is not None:
        raise OptionError("--at makes a separate simulated run, but this station is running")
    with hinting(station.reader), leased(station, order.over):
        facts = facts_of(station, place, order.sensor, order.actuator)
        if not order.cascade:
            return [_live_one(station, place, order, facts)]
        inner_facts = facts_of(station, _inner_of(facts))
        check_tunable(station, facts.inner, ("gain", "integral_time"))
        inner = _live_one(station, facts.inner, order, inner_facts)
        with trying(station, facts.inner, settings_of(inner, inner.set_of(order.name))):
            time.sleep(inner.response.duration)  # in this time the outer law returns its measurement to the setpoint
            return [inner, _live_one(station, place, order, facts)]


def _inner_of(facts: LawFacts) -> str:
    if not facts.inner:
        raise OptionError(f"--cascade: {facts.law} has no inner law; a `Cascade` has one")
    return facts.inner


def _live_one(station: RemoteStation, place: str, order: TuningOrder, facts: LawFacts) -> TuningResult:
    from umo.commissioning.tuning.live_experiment import experiment, moves

    with OneLine(err) as line:
        began, before = time.monotonic(), station.progress

        def show() -> None:
            progress = station.progress  # progress from before the experiment does not belong to it
            line.show(time.monotonic() - began, "" if progress == before else progress.text, None)

        if order.moves is not None:
            response = moves(station, facts, number("--moves", order.moves, facts.units[0]), show)
        else:
            response, ended = experiment(station, place, facts, _arguments(order, facts), show)
            _say_end(facts, ended)
    return _found(order, facts, response)


def _say_end(facts: LawFacts, ended: Mapping[str, Any]) -> None:
    say(f"{facts.law}: the experiment has ended ({ended['ended']}); the law is in control")
    if (share := ended.get("limited", 0.0)) > MAX_LIMITED_SHARE:
        say(
            f"{facts.inner}, the inner law, was at its limit during {share:.0%} of the experiment; use a smaller "
            f"amplitude"
        )


def _arguments(order: TuningOrder, facts: LawFacts) -> dict[str, Any]:
    """Return the arguments of the action `experiment`."""
    kind, text = ("relay", order.relay) if order.relay is not None else ("step", order.step)
    assert text is not None
    more = {
        "hysteresis": order.hysteresis,
        "within": order.within,
        "cycles": order.cycles,
        "duration": order.lasting,
    }
    amplitude = _amplitude(f"--{kind}", text, facts)
    return {"kind": kind, "amplitude": amplitude, **{name: value for name, value in more.items() if value is not None}}


def _amplitude(option: str, text: str, facts: LawFacts) -> float:
    """Return the amplitude in the actuator's unit. The text is a share of the actuator's range (10%), or a number in
    its unit."""
    if text.strip().endswith("%"):
        if not isfinite(facts.ranges[1]):
            raise OptionError(f"{option}: {text} is a share of a range, and {facts.actuator} has no range")
        return float(number(option, text.strip()[:-1], "")) * facts.ranges[1] / 100.0
    try:
        return difference(option, text, facts.units[1])
    except RangeError as error:
        raise RangeError(f"{error}; a share of the range of {facts.actuator} is possible too, such as 10%") from error


# Without one -----------------------------------------------------------------------------------------------


def _alone(
    station: str, place: str, order: TuningOrder, options: Sequence[str]
) -> tuple[list[TuningResult], dict[str, tuple[float, float]]]:
    """Tune from a recording, or from a separate run."""
    from umo.commissioning.tuning.own_experiment import declared_facts, own_experiment

    def plan() -> Plan:
        found = station_named(station)
        given = parse(found, order.wiring, options)
        return Plan(Job(str(found.path), wiring=order.wiring, options=given))

    first = plan()
    facts = declared_facts(first, place, order.sensor, order.actuator)
    numbers = ((path, each.declared) for path, each in numbers_of(first.machine).items())
    known = {path: (each.minimum, each.maximum) for path, each in numbers if each.tunable}
    if order.file is not None:
        response = recorded_response(order.file, facts.columns, order.start, order.stop)
        return [_found(order, facts, response)], known
    if order.moves is not None:
        raise OptionError(f"{station} does not run: start it with `umo run {station} --manual`, or give --file FILE")
    if order.at is None:
        raise OptionError(
            f"{station} does not run: start it with `umo run {station} --manual`; or give --at TIME, the time of the "
            f"experiment in a separate simulated run"
        )
    at = order.at

    def one(place: str, facts: LawFacts, tried: Mapping[str, Mapping[str, float]]) -> TuningResult:
        with OneLine(err) as line:
            show: Callable[[float, str], object] = lambda moment, text: line.show(moment, text, None)  # noqa: E731
            response, ended = own_experiment(plan(), place, facts, at, _arguments(order, facts), show, tried)
        _say_end(facts, ended)
        return _found(order, facts, response)

    if not order.cascade:
        return [one(place, facts, {})], known
    inner = one(facts.inner, declared_facts(plan(), _inner_of(facts)), {})
    return [inner, one(place, facts, {facts.inner: settings_of(inner, inner.set_of(order.name))})], known
