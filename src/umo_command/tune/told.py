"""The output of `umo tune law`: tables of the model and of the gains, and the lines by which the gains can be tried and
kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from math import inf, isfinite

from rich.table import Table

from umo.commissioning.tuning.gain_rules import GainSet
from umo.commissioning.tuning.plain_result import rounded, settings_of
from umo.commissioning.tuning.tuning_result import TuningResult
from umo.control.loops import SETTINGS
from umo.digits import number_text, setting_text
from umo.objects.presentation.value_text import shown_unit
from umo_command.console import plain_table
from umo_command.tune.kept import toml_line

LEAST_DEAD_TIME = 1e-3
"""The number of periods below which a dead time is shown as 0."""


@dataclass
class SettingsReport:
    """The gains of one set, with the lines by which they can be tried and kept."""

    name: str
    values: dict[str, float]
    """Values of the gains, by the names of the law."""
    lines: list[str] = field(default_factory=list)


def settings_report(
    result: TuningResult, name: str, station: str, tunable: Mapping[str, tuple[float, float]]
) -> SettingsReport:
    """Return the report on one set of gains. `tunable`: the tunable numbers, with their ranges. Raises RangeError if
    there is no set with this name."""
    chosen = result.set_of(name)
    told = SettingsReport(name, settings_of(result, chosen))
    base = result.facts.base
    if result.axis is not None:
        axis = base.rpartition(".")[0]
        told.lines += _tries(told, station, base, tunable)
        fields = [toml_line(f"{axis}.{each}".lstrip("."), setting_text(value)) for each, value in told.values.items()]
        heading = f"To keep the {name} set, with the feed-forward that belongs to it, in the wiring:"
        told.lines += [heading, "  [parameters]", *(f"  {line}" for line in fields)]
        return told
    inside = _tunable_settings(told, base, tunable)
    lines = told.lines
    if inside:
        lines += _tries(told, station, base, tunable)
        lines += ["To keep it, in the wiring:", "  [parameters]"]
        lines += [f"  {toml_line(path, setting_text(told.values[each]))}" for each, path in inside.items()]
    rest = {each: value for each, value in told.values.items() if each not in inside}
    if rest:
        settings = ", ".join(f"{each}={_code(value)}" for each, value in rest.items())
        lines.append(f"In the code, where {base} is made{' (not tunable)' if inside else ''}: {settings}")
    return told


def _tunable_settings(told: SettingsReport, base: str, tunable: Mapping[str, tuple[float, float]]) -> dict[str, str]:
    """Return the paths of the settings that can be tuned while the station runs, by the names of the settings."""
    paths = {each: f"{base}.{each}" for each, value in told.values.items() if isfinite(value)}
    return {each: path for each, path in paths.items() if path in tunable}


def _tries(told: SettingsReport, station: str, base: str, tunable: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    """Yield the lines by which the set can be tried while the station runs."""
    inside = _tunable_settings(told, base, tunable)
    if inside:
        without = " (without the feed-forward)" if "feed_forward" in told.values else ""
        yield f"To try the {told.name} set{without}, while the station runs:"
    for each, path in inside.items():
        low, high = tunable[path]
        beyond = "" if low <= told.values[each] <= high else f"   # outside of its range, {low:g} to {high:g}"
        yield f"  umo tune number {station} {path} {setting_text(told.values[each])}{beyond}"


def _code(value: float) -> str:
    return "inf" if value == inf else setting_text(value)


def tables_of(result: TuningResult) -> Iterator[Table]:
    """Return the tables: first the model, then the sets."""
    yield _model_table(result)
    yield _sets_table(result)


def _model_table(result: TuningResult) -> Table:
    facts, identified = result.facts, result.identified
    table = plain_table()
    table.add_column(f"{facts.law}: {facts.actuator} to {facts.sensor}")
    table.add_column("value")
    table.add_column("95 %")
    unit, output = shown_unit(facts.units[0]), shown_unit(facts.units[1])
    integrates = result.axis is not None or identified.model.integrates
    what = "velocity: first order" if result.axis is not None else identified.model.kind
    table.add_row("model", f"{what}, fit {identified.fit:.1f} %", "")
    units = {"K": f" {unit or 1}{'/s' if integrates else ''} per {output or 1}", "D": ""}
    intervals = identified.intervals
    for letter, value in identified.model.describe().items():
        value = 0.0 if letter == "L" and value < LEAST_DEAD_TIME * facts.dt else value
        table.add_row(f"  {letter}", f"{value:.4g}{units.get(letter, ' s')}", f"+- {intervals[letter]:.2g}")
    if others := [kind for kind in identified.kinds if kind != identified.model.kind]:
        table.add_row("fits as well", "\n".join(others), "")
    if result.relay is not None:
        relay = result.relay
        table.add_row("relay", f"{relay.cycles} cycles of {relay.ultimate_period:.4g} s", "")
        table.add_row("  gain, phase", f"{relay.ultimate_gain:.4g} {output} per {unit or 1}, {relay.phase:.0f} deg", "")
        if relay.uneven:
            table.add_row("  note", "its halves differ: the loop was not at rest", "")
    if result.inner_time is not None:
        faster = "" if result.faster is None else f"{result.faster:.1f} times faster"
        table.add_row("inner loop", f"{result.inner_time:.4g} s", faster)
    if result.axis is not None:
        axis = result.axis
        for name in ("feed_forward", "inertia", "friction", "offset"):
            table.add_row(name.replace("_", "-"), f"{getattr(axis, name):.4g}", "")
    return table


def _sets_table(result: TuningResult) -> Table:
    table = plain_table()
    shown = [name for name in SETTINGS if any(asdict(each.gains)[name] not in (0.0, inf) for each in result.sets)]
    heads = [
        "gains",
        *(name.replace("_", " ") for name in shown),
        "gain margin",
        "phase margin",
        "overshoot",
        "settled",
    ]
    for head in [*heads, "rule"]:
        table.add_column(head)
    steps = result.steps
    for each in result.sets:
        step = steps.get(each.name)
        gains = asdict(each.gains)
        cells = [number_text(rounded(gains[name])) if isfinite(gains[name]) else "none" for name in shown]
        promised = ("", "") if step is None else (f"{step.overshoot:.0f} %", _time(step.settling_time))
        table.add_row(each.name, *cells, *_margin_texts(each), *promised, each.rule)
    return table


def _margin_texts(each: GainSet) -> tuple[str, str]:
    gain, phase = each.margins.gain, each.margins.phase
    if not each.margins.stable:
        return "unstable", "unstable"
    return (f"{gain:.1f}" if isfinite(gain) else "any"), (f"{phase:.0f} deg" if isfinite(phase) else "any")


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if isfinite(seconds) else "later"
