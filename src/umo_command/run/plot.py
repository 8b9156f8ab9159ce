"""Draws the plot of a run's trace, with as many panels as fit on a page, whatever the number of objects. Needs the
extra `plot`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from umo.cycle.trace import Trace
from umo.objects.description import described
from umo.objects.presentation.described import Described
from umo.objects.presentation.rows import FOLDED_FROM, families, folded
from umo.objects.presentation.value_text import shown_unit
from umo.operation.alarms.alarm_log import AlarmLog, AlarmOfRun
from umo.operation.alarms.declaration import Priority
from umo.process.frames.layout import describe_signals
from umo.text import some

SENSOR_SIGNALS = ("setpoint", "low", "high")
"""Signals that are drawn together with the sensors of the same unit."""
MAX_POINTS = 4000
"""Largest number of points of a curve. A picture has hardly more than a thousand columns of pixels."""
MAX_PANELS, MAX_ROWS = 10, 30
"""Largest number of panels, and of rows of binary objects. With these limits a figure is at most 23 inches high."""
ALARM_COLOURS = {
    Priority.LOW: "#4682b4",
    Priority.MEDIUM: "#e6a700",
    Priority.HIGH: "#e8590c",
    Priority.CRITICAL: "#b00020",
}
MAX_NAMED, MAX_LINES = 8, 40
"""Largest number of curves of a panel that have names, and largest number that are drawn individually. More curves are
drawn as a band."""
STRIP = ("binary", "states")
"""The kinds of curves that are drawn as bars."""
MAX_NAMED_BARS = 60
"""Largest number of bars of a row that have the names of their states."""
WIDTH, MIN_HEIGHT = 16.0, 10.0
"""Width and smallest height of the figure in inches."""
MAX_NAME_LENGTH = 40
"""Largest number of characters of a name next to a panel."""
CHARACTER_WIDTH = 0.065
"""Width in inches of a character in the texts above the panels."""


class Curve(NamedTuple):
    """An object or a signal of a plot."""

    path: str
    unit: str
    kind: str
    """The kind: `sensors`, `actuators`, `signals`, `binary`, or `states`."""
    one: str
    """The state of a binary object that is drawn as 1."""
    column: int
    """Index of the curve's column in the rows."""
    states: Mapping[int, str] = {}
    """The names of several states by number."""

    @classmethod
    def of(cls, about: Described, column: int) -> Curve:
        if about.is_binary:
            return cls(about.path, about.unit, "binary", about.states[1], column)
        if not about.is_number:
            return cls(about.path, about.unit, "states", "", column, about.states)
        sensor = "actuators" if about.is_actuator else "sensors"
        return cls(about.path, about.unit, sensor if about.is_object else "signals", "", column)


@dataclass
class Curves:
    """The curves of a picture."""

    rows: npt.NDArray[np.float64]
    """The rows of a `Trace`."""
    curves: list[Curve]
    notes: list[tuple[float, str]]
    where: str = "all are in trace.csv"
    """A text that says where the curves are that did not fit."""
    alarms: AlarmLog | None = None

    @classmethod
    def of(cls, trace: Trace, alarms: AlarmLog | None = None) -> Curves:
        about = [*map(described, trace.items), *map(Described, describe_signals(trace.signals))]
        return cls(trace.rows, [Curve.of(each, 3 + i) for i, each in enumerate(about)], trace.notes, alarms=alarms)


@dataclass
class Panel:
    """A panel: the curves of one unit."""

    label: str
    name: str = ""
    """Name of the family to which the curves belong, or empty if each curve has a name."""
    curves: list[Curve] = field(default_factory=list)


def save_plot(trace: Trace | Curves, path: Path, title: str) -> str:
    """Draw and save the plot. Return a text about the curves that did not fit; empty if all curves fitted. Raises
    ImportError without matplotlib."""
    if not len(trace.rows):
        return ""
    figure, rest = draw(trace, title)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")  # a name that the font cannot show
        figure.savefig(path)
    return rest


def draw(drawn: Trace | Curves, title: str) -> tuple[Any, str]:
    """Draw a panel for each unit and for each family of similar objects, a strip of bars for the states, and a strip
    for the raised alarms. Return the figure, and a text about the curves that did not fit, which is also in the
    figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    trace = Curves.of(drawn) if isinstance(drawn, Trace) else drawn
    curves = [each for each in trace.curves if each.path != "timer"]
    panels = _panels([each for each in curves if each.kind not in STRIP])
    strip = _groups([each for each in curves if each.kind == "binary"])
    strip += [[each] for each in curves if each.kind == "states"]
    left_out = [shown.path for panel in panels[MAX_PANELS:] for shown in panel.curves]
    left_out += [shown.path for group in strip[MAX_ROWS:] for shown in group]
    panels, strip = panels[:MAX_PANELS], strip[:MAX_ROWS]
    alarms = _alarm_groups(trace.alarms)
    left_out += [each.path for group in alarms[MAX_ROWS:] for each in group]
    number, alarms = len(curves) + sum(map(len, alarms)), alarms[:MAX_ROWS]
    strips = [0.3 * len(rows) + 0.5 for rows in (strip, alarms) if rows]
    heights = [2.0] * len(panels) + strips or [2.0]
    figure = Figure(figsize=(WIDTH, max(0.75 * sum(heights), MIN_HEIGHT)), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, ha="left", x=0.01, parse_math=False)
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axis, panel in zip(axes, panels, strict=False):
        _curves(axis, trace, panel)
    if strip:
        _strip(axes[len(panels)], trace, strip)
    if alarms:
        _alarms(axes[-1], trace, alarms)
    _phases(axes, trace)
    _missed(axes, trace)
    rest = f"{len(left_out)} of {number}: {some(left_out)}" if left_out else ""
    hint = f"\nnot shown: {rest} ({trace.where})" if rest else ""
    axes[-1].set_xlabel(f"time in s on the cycle's clock{hint}", parse_math=False)
    return figure, rest


def _groups(shown: Sequence[Curve]) -> list[list[Curve]]:
    """Return a group for each family of curves, and a group of one for every other curve."""
    groups: list[list[Curve]] = []
    for places in families(each.path for each in shown).values():
        members = [shown[place] for place in places]
        groups += [members] if len(members) >= FOLDED_FROM else [[each] for each in members]
    return groups


def _panels(shown: Sequence[Curve]) -> list[Panel]:
    """Return a panel for each family. The other curves of one unit have a panel for the actuators, one for the sensors
    (with setpoints), and one for the signals."""
    panels: dict[str, Panel] = {}
    for group in _groups(shown):
        first = group[0]
        unit = shown_unit(first.unit)
        if len(group) >= FOLDED_FROM:
            name = folded([each.path for each in group])
            panels[name] = Panel(unit, name, group)
            continue
        label = f"{unit}\n{first.kind}"
        if first.kind == "signals" and first.path.rpartition(".")[2] in SENSOR_SIGNALS and f"{unit}\nsensors" in panels:
            label = f"{unit}\nsensors"
        panels.setdefault(label, Panel(label)).curves += group
    return list(panels.values())


def _curves(axis: Any, trace: Curves, panel: Panel) -> None:
    """Draw a few curves each with its name, many curves as thin lines, and very many as the least, median and greatest
    of their values."""
    rows = trace.rows[:: max(1, len(trace.rows) // MAX_POINTS)]
    time, curves = rows[:, 0], rows[:, [each.column for each in panel.curves]]
    paths = [each.path for each in panel.curves]
    if len(paths) <= MAX_NAMED:
        for each, curve in zip(panel.curves, curves.T, strict=True):
            dashed = "--" if each.kind == "signals" and panel.label.endswith("sensors") else "-"
            axis.plot(time, curve, dashed, linewidth=1.0, label=_short(each.path))
    else:
        name = _short(panel.name or some(paths))
        if len(paths) <= MAX_LINES:
            lines = axis.plot(time, curves, color="C0", linewidth=0.5, alpha=0.6)
            lines[0].set_label(f"{name}\n{len(paths)} lines")
        else:
            least, most = np.fmin.reduce(curves, axis=1), np.fmax.reduce(curves, axis=1)
            axis.fill_between(time, least, most, color="C0", alpha=0.3, linewidth=0, label=f"{name}\nleast to most")
            axis.plot(time, _median(curves), color="C0", linewidth=1.0, label=f"median of {len(paths)}")
    axis.set_ylabel(panel.label)
    _legend(axis)
    axis.grid(alpha=0.3)
    axis.margins(x=0)


def _median(curves: Any) -> Any:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN slice")  # signals that have no value yet
        return np.nanmedian(curves, axis=1)


def _short(name: str) -> str:
    return name if len(name) <= MAX_NAME_LENGTH else f"...{name[3 - MAX_NAME_LENGTH :]}"


def _strip(axis: Any, trace: Curves, strip: list[list[Curve]]) -> None:
    """Draw a row for each object, with a bar wherever the object was in its 1 state. In the row of a family a shade
    shows how many objects were in this state. Of several states each has a bar of its colour and, if there is room, its
    name."""
    time = trace.rows[:, 0]
    labels = []
    for row, group in enumerate(reversed(strip)):
        first, columns = group[0], [each.column for each in group]
        if first.states:
            _states(axis, time, trace.rows[:, first.column], row, first.states)
            labels.append(_short(first.path))
            continue
        if len(group) == 1:
            axis.broken_barh(
                _bars(time, trace.rows[:, columns[0]] > 0.5), (row - 0.38, 0.76), facecolors=f"C{row % 10}"
            )
            labels.append(f"{_short(first.path)} {first.one}")
            continue
        step = max(1, len(time) // MAX_POINTS)
        share = trace.rows[::step, columns].mean(axis=1)[np.newaxis]
        sides = (time[0], max(time[-1], time[0] + 1e-9), row - 0.38, row + 0.38)
        axis.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto", extent=sides, interpolation="nearest")
        labels.append(f"{_short(folded([each.path for each in group]))} {first.one}, share")
    axis.set_yticks(range(len(strip)), labels, fontsize=8, parse_math=False)
    axis.set_ylim(-0.6, len(strip) - 0.4)
    axis.set_xlim(time[0], max(time[-1], time[0] + 1e-9))
    axis.grid(axis="x", alpha=0.3)


def _states(axis: Any, time: Any, values: Any, row: int, states: Mapping[int, str]) -> None:
    """Draw a bar for each time in a state."""
    named = []
    for place, (number, name) in enumerate(states.items()):
        bars = _bars(time, values == number)
        axis.broken_barh(bars, (row - 0.38, 0.76), facecolors=f"C{place % 10}", alpha=0.45)
        named += [(length, begin, name) for begin, length in bars]
    for length, begin, name in sorted(named, reverse=True)[:MAX_NAMED_BARS]:
        if _room(length, time[-1] - time[0]) > len(name):
            axis.text(begin + length / 2, row, name, ha="center", va="center", fontsize=7, parse_math=False)


def _alarm_groups(log: AlarmLog | None) -> list[list[AlarmOfRun]]:
    """Return the alarms that were raised, the most important first: a group for each family, and a group of one for
    every other alarm."""
    raised = [] if log is None else log.raised
    groups: list[list[AlarmOfRun]] = []
    for places in families(each.path for each in raised).values():
        members = [raised[place] for place in places]
        groups += [members] if len(members) >= FOLDED_FROM else [[each] for each in members]
    return groups


def _alarms(axis: Any, trace: Curves, groups: list[list[AlarmOfRun]]) -> None:
    """Draw a row for each raised alarm, or for each family of alarms, with a bar wherever the alarm was active."""
    assert trace.alarms is not None
    first, last = trace.rows[0, 0], trace.rows[-1, 0]
    labels = []
    for row, group in enumerate(reversed(groups)):
        paths, priority = {each.path for each in group}, max(each.priority for each in group)
        spans = [each for each in trace.alarms.spans if each.path in paths]
        ends = [last if each.cleared is None else each.cleared for each in spans]
        bars = [(each.raised, max(end - each.raised, 0.0)) for each, end in zip(spans, ends, strict=True)]
        colour = ALARM_COLOURS[priority]  # with an edge: the shortest can be seen, too
        axis.broken_barh(bars, (row - 0.38, 0.76), facecolors=colour, edgecolors=colour, alpha=0.8 / len(group) + 0.2)
        labels.append(f"{_short(folded([each.path for each in group]))} ({priority})")
    axis.set_yticks(range(len(groups)), labels, fontsize=8, parse_math=False)
    axis.set_ylim(-0.6, len(groups) - 0.4)
    axis.set_xlim(first, max(last, first + 1e-9))
    kept = len(trace.alarms.spans)
    axis.set_ylabel("alarms" if kept == trace.alarms.number else f"alarms\nthe last {kept:,} times")
    axis.grid(axis="x", alpha=0.3)


def _bars(time: Any, ones: Any) -> Any:
    """Return the beginning and the length of each interval of ones."""
    edges = np.diff(np.concatenate(([0.0], ones, [0.0])))
    ends = np.append(time, time[-1])
    begins, stops = ends[np.flatnonzero(edges > 0)], ends[np.flatnonzero(edges < 0)]
    return _merged(np.column_stack([begins, np.maximum(stops - begins, 0.0)]))


def _merged(spans: Any, most: int = 2000) -> Any:
    """Return fewer bars for a fast train of pulses: gaps that are too small to be seen are closed."""
    if len(spans) <= most:
        return spans
    gap = (spans[-1, 0] - spans[0, 0]) / most
    starts = np.flatnonzero(np.append(True, spans[1:, 0] - spans[:-1].sum(axis=1) > gap))
    ends = np.append(starts[1:], len(spans)) - 1
    return np.column_stack([spans[starts, 0], spans[ends].sum(axis=1) - spans[starts, 0]])


def _phases(axes: Any, trace: Curves) -> None:
    """Draw the machine's progress as shaded spans, with names above the uppermost panel where they fit."""
    begins = np.array([begin for begin, _ in trace.notes])
    first, last = trace.rows[0, 0], trace.rows[-1, 0]
    lengths = np.diff(np.append(begins, last))
    for axis in axes:
        axis.broken_barh(
            np.column_stack([begins, lengths])[1::2],
            (0.0, 1.0),
            transform=axis.get_xaxis_transform(),
            color="0.5",
            alpha=0.10,
            linewidth=0,
        )
    for (begin, text), length in zip(trace.notes, lengths, strict=True):
        label, room = text.rpartition(": ")[2], _room(length, last - first)
        if not label or room < 4:
            continue
        axes[0].text(
            begin + length / 2,
            1.02,
            label if len(label) <= room else f"{label[: room - 2]}...",
            transform=axes[0].get_xaxis_transform(),
            ha="center",
            fontsize=8,
            clip_on=False,
            parse_math=False,
        )


def _room(length: float, whole: float) -> int:
    """Return how many characters of the texts of the figure fit into a part of its time."""
    return int(length * 0.75 * WIDTH / max(whole, 1e-9) / CHARACTER_WIDTH)


def _missed(axes: Any, trace: Curves) -> None:
    late = trace.rows[trace.rows[:, 1] > 0, 0]
    if len(late):
        axes[0].plot(
            late, np.full(len(late), 0.02), "r|", transform=axes[0].get_xaxis_transform(), label="missed periods"
        )
        _legend(axes[0])


def _legend(axis: Any) -> None:
    """Put the legend beside the panel, where it covers nothing."""
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, borderaxespad=0.2)
