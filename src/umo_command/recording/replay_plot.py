"""Draws the plot of `umo recording replay --set`: the recorded commands, and the commands with the changed numbers.
Needs the extra `plot`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from umo.objects.presentation.value_text import shown_unit
from umo.recording.replay.what_if import RawCurves

MAX_PANELS = 8
"""Largest number of actuators that are drawn."""
WIDTH, HEIGHT = 16.0, 2.2
"""Width of the picture and height of each panel in inches."""


def save_what_if(curves: RawCurves, path: Path, settings: Mapping[str, Any]) -> None:
    """Draw the recorded and the replayed commands of the actuators that differ, and save the picture. Raises
    ImportError without matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    different = curves.different()
    shown = different[:MAX_PANELS]
    figure = Figure(figsize=(WIDTH, HEIGHT * len(shown) + 1.0), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    changed = ", ".join(f"{name} = {value}" for name, value in settings.items())
    rest = f"; {len(different) - len(shown)} more differ" if len(different) > len(shown) else ""
    title = f"open loop: the recorded sensors, with {changed}{rest}"
    figure.suptitle(title, ha="left", x=0.01, parse_math=False)
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axis, curve in zip(axes, shown, strict=True):
        axis.plot(curve.times, curve.recorded, color="0.6", linewidth=2.0, label="recorded")
        axis.plot(curve.times, curve.replayed, color="tab:red", linewidth=0.9, label="replayed")
        axis.set_ylabel(f"{curve.path}\n{shown_unit(curve.unit)}".rstrip(), parse_math=False)
        axis.grid(alpha=0.3)
    axes[0].legend(loc="upper right")
    axes[-1].set_xlabel("s")
    figure.savefig(path)
