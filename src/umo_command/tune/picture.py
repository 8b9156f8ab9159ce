"""Draws the plot of `umo tune law`: the response with that of the model, the output, and the step responses that are
expected with the gains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from umo.commissioning.tuning.gain_rules import BALANCED
from umo.commissioning.tuning.tuning_result import PRESENT, TuningResult
from umo.objects.presentation.value_text import shown_unit

WIDTH, HEIGHT = 12.0, 10.0
"""Size of the picture in inches."""


def save_tuning_plot(result: TuningResult, path: Path, title: str) -> None:
    """Draw and save the picture. Raises ImportError without matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, ha="left", x=0.01, parse_math=False)
    grid = figure.add_gridspec(3, 1, height_ratios=(3, 1, 3))
    measured = figure.add_subplot(grid[0])
    _measured(measured, result)
    _output(figure.add_subplot(grid[1], sharex=measured), result)
    _steps(figure.add_subplot(grid[2]), result)
    figure.savefig(path)


def _measured(axis: Any, result: TuningResult) -> None:
    response, facts = result.response.thinned(), result.facts
    axis.plot(response.times, response.measurements, color="0.6", linewidth=2.0, label="measured")
    fit = f"model, fit {result.identified.fit:.1f} %"
    axis.plot(response.times, result.identified.predicted, color="tab:red", linewidth=1.0, label=fit)
    unit = shown_unit(facts.units[0])
    _label(axis, f"velocity, {unit}/s" if result.axis is not None else f"{facts.sensor}\n{unit}")


def _output(axis: Any, result: TuningResult) -> None:
    response, facts = result.response, result.facts
    what = "without friction" if result.axis is not None else facts.actuator
    axis.step(response.times, response.outputs, where="post", color="tab:blue", linewidth=1.0, label=what)
    _label(axis, shown_unit(facts.units[1]))
    axis.set_xlabel("s")


def _steps(axis: Any, result: TuningResult) -> None:
    """Draw each predicted step of the setpoint by 1; for the balanced set also with the models that fit equally
    well."""
    for number, step in enumerate(result.doubt(BALANCED)):
        label = f"{BALANCED}, with other models that fit as well" if not number else None
        axis.plot(step.times, step.measurements, color="tab:orange", alpha=0.35, linewidth=0.6, label=label)
    for name, step in result.steps.items():
        style = {"color": "0.5", "linestyle": "--"} if name == PRESENT else {}
        axis.plot(step.times, step.measurements, linewidth=1.2, label=name, **style)
    axis.axhline(1.0, color="0.8", linewidth=0.8)
    _label(axis, "predicted: a step of the setpoint")
    axis.set_xlabel("s")


def _label(axis: Any, text: str) -> None:
    axis.set_ylabel(text.rstrip(), parse_math=False)
    axis.grid(alpha=0.3)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, borderaxespad=0.2)
