"""The plot of a run's trace (extra `plot`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from umo.cycle.signals import Signal
from umo.cycle.trace import Trace
from umo.objects import Atomic, Binary, DigitalSensor
from umo.objects.atomic import Digital

BESIDE_SENSORS = ("setpoint", "low", "high")
"""Signals that are compared with what a sensor reads."""
POINTS = 4000
"""Columns of the picture hardly exceed a thousand; more points only cost time."""


def save_plot(trace: Trace, path: Path, title: str) -> None:
    """A panel for each unit, a strip of bars for the binary objects; ImportError without matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not len(trace.rows):
        return
    items = [item for item in trace.items if item.path != "timer"]
    panels = _by_unit([item for item in items if isinstance(item, Digital)], trace.signals)
    binaries = [item for item in items if isinstance(item, Binary)]
    heights = [2.0] * len(panels) + [0.3 * len(binaries) + 0.5] * bool(binaries)
    figure = Figure(figsize=(16, 10), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, ha="left", x=0.01)
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    step = max(1, len(trace.rows) // POINTS)
    for axis, (label, group) in zip(axes, panels.items(), strict=False):
        for item in group:
            dashed = "--" if isinstance(item, Signal) and label.endswith("sensors") else "-"
            axis.plot(trace.rows[::step, 0], trace.column(item)[::step], dashed, linewidth=1.0, label=item.path)
        axis.set_ylabel(label)
        _legend(axis)
        axis.grid(alpha=0.3)
        axis.margins(x=0)
    if binaries:
        _strip(axes[-1], trace, binaries)
    _phases(axes, trace)
    _missed(axes, trace)
    axes[-1].set_xlabel("time in s on the cycle's clock")
    figure.savefig(path)


def _by_unit(items: list[Digital], signals: Sequence[Signal]) -> dict[str, list[Digital | Signal]]:
    """Actuators, sensors and signals of one unit in panels of their own; setpoints with the sensors."""
    panels: dict[str, list[Digital | Signal]] = {}
    for item in items:
        kind = "sensors" if isinstance(item, DigitalSensor) else "actuators"
        panels.setdefault(f"{item.units}\n{kind}", []).append(item)
    for signal in signals:
        with_sensors = f"{signal.unit}\nsensors"
        beside = signal.name in BESIDE_SENSORS and with_sensors in panels
        panels.setdefault(with_sensors if beside else f"{signal.unit}\nsignals", []).append(signal)
    return panels


def _strip(axis: Any, trace: Trace, binaries: list[Atomic] | list[Binary[Any]]) -> None:
    """A row for each object, a bar wherever it was in its 1 state."""
    time = trace.rows[:, 0]
    for row, item in enumerate(reversed(binaries)):
        levels = np.concatenate(([0.0], trace.column(item) > 0.5, [0.0]))
        edges = np.diff(levels)
        ends = np.append(time, time[-1])
        begins, stops = ends[np.flatnonzero(edges > 0)], ends[np.flatnonzero(edges < 0)]
        spans = np.column_stack([begins, np.maximum(stops - begins, 0.0)])
        axis.broken_barh(_merged(spans), (row - 0.38, 0.76), facecolors=f"C{row % 10}")
    axis.set_yticks(range(len(binaries)), [f"{b.path} {b.one}" for b in reversed(binaries)], fontsize=8)  # type: ignore[union-attr]
    axis.set_ylim(-0.6, len(binaries) - 0.4)
    axis.grid(axis="x", alpha=0.3)
    axis.margins(x=0)


def _merged(spans: Any, most: int = 2000) -> Any:
    """A fast train of pulses as few bars: gaps that no eye could see are closed."""
    if len(spans) <= most:
        return spans
    gap = (spans[-1, 0] - spans[0, 0]) / most
    starts = np.flatnonzero(np.append(True, spans[1:, 0] - spans[:-1].sum(axis=1) > gap))
    ends = np.append(starts[1:], len(spans)) - 1
    return np.column_stack([spans[starts, 0], spans[ends].sum(axis=1) - spans[starts, 0]])


def _phases(axes: Any, trace: Trace) -> None:
    """What the machine was doing, as shaded spans; their names above the uppermost panel."""
    last = trace.rows[-1, 0]
    ends = [begin for begin, _ in trace.notes[1:]] + [last]
    for number, ((begin, label), end) in enumerate(zip(trace.notes, ends, strict=False)):
        for axis in axes:
            axis.axvspan(begin, end, color="0.5", alpha=0.10 if number % 2 else 0.0, linewidth=0)
        if label and end - begin > last / 60:
            place = axes[0].get_xaxis_transform()
            short = label.rpartition(": ")[2]
            axes[0].text((begin + end) / 2, 1.02, short, transform=place, ha="center", fontsize=8, clip_on=False)


def _missed(axes: Any, trace: Trace) -> None:
    late = trace.rows[trace.rows[:, 1] > 0, 0]
    if len(late):
        axes[0].plot(
            late, np.full(len(late), 0.02), "r|", transform=axes[0].get_xaxis_transform(), label="missed periods"
        )
        _legend(axes[0])


def _legend(axis: Any) -> None:
    """Beside the panel, where it covers nothing."""
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, borderaxespad=0.2)
