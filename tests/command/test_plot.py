"""The plot of a run: grouped, of a bounded height, and saying what it does not show."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.machines import actuator, relay, sensor, timer
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Number, connect
from umo.cycle.trace import Trace
from umo.objects.presentation.described import Described
from umo.states import OnOff
from umo.testing import periods

pytest.importorskip("matplotlib")
from umo_command.run import plot
from umo_command.run.plot import MAX_PANELS, MAX_ROWS, MIN_HEIGHT, Curve, Curves, draw, save_plot


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor
    fan: BinaryActuator[OnOff]


class Tunnel(Compound, numbers={"load": Number("percent", shown=True)}):
    zones: tuple[Zone, ...]
    lamp: BinaryActuator[OnOff]
    timer: DigitalSensor
    load: float = float("nan")


class Rack(Compound):
    parts: dict[str, Any]
    timer: DigitalSensor


def tunnel(count: int) -> Tunnel:
    zones = tuple(Zone(heater=actuator(), temperature=sensor(), fan=relay()) for _ in range(count))
    return Tunnel(zones=zones, lamp=relay(), timer=timer())


def trace_of(machine: Compound, phases: int = 2) -> Trace:
    trace, connection = Trace(), connect(machine)
    with connection as m:
        connection.machine.observers.append(trace)
        for number in range(phases):
            m.cycle.progress(f"part {number}: a text that is rather long for its place $_{{")
            periods(m, 3)
    return trace


def assert_clear(figure: Any) -> None:
    """No legend covers a panel, no panel or text another one, and nothing is outside of the picture."""
    figure.canvas.draw()  # a warning of matplotlib would be an error here
    boxes = [axis.get_window_extent() for axis in figure.axes]
    assert all(box.width > 400 and box.height > 40 for box in boxes)
    for axis in figure.axes:
        legend = axis.get_legend()
        if legend is not None:
            assert not any(legend.get_window_extent().overlaps(box) for box in boxes)
    texts = sorted((text.get_window_extent().extents for text in figure.axes[0].texts), key=lambda box: box[0])
    assert all(left[2] <= right[0] for left, right in pairwise(texts))
    tight = figure.get_tightbbox()
    assert tight.width <= figure.get_figwidth() * 1.01
    assert tight.height <= figure.get_figheight() * 1.01


@pytest.mark.parametrize("count", first(2, [40, 1, 2, 3, 12, 333]))
def test_a_list_of_any_length_is_a_panel_for_each_name(count: int) -> None:
    figure, rest = draw(trace_of(tunnel(count)), "umo run tunnel")
    assert rest == ""
    assert len(figure.axes) == 4  # temperatures, heaters, load and the strip
    assert figure.get_figheight() == MIN_HEIGHT
    assert_clear(figure)
    labels = [label.get_text() for label in figure.axes[-1].get_yticklabels()]
    assert len(labels) == (count + 1 if count < 3 else 2)
    assert any(("share" in label) == (count >= 3) for label in labels)


def names(axis: Any) -> list[str]:
    return [text.get_text() for text in axis.get_legend().get_texts()]


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (3, ["zones.0.temperature", "zones.1.temperature", "zones.2.temperature"]),
        (12, ["zones[0..11].temperature\n12 lines"]),
        (333, ["zones[0..332].temperature\nleast to most", "median of 333"]),
    ],
)
def test_few_curves_are_named_many_are_thin_lines_and_very_many_a_band(count: int, expected: list[str]) -> None:
    figure, _ = draw(trace_of(tunnel(count)), "umo run tunnel")
    assert names(figure.axes[0]) == expected


def test_what_has_several_states_is_a_row_of_bars_with_their_names() -> None:
    phase = Described({"path": "phase", "unit": "", "states": {"0": "FILLING", "1": "STIRRING", "2": "EMPTYING"}})
    rows = np.array([[time, 0.0, 0.0, time // 10] for time in range(30)], float)
    figure, _ = draw(Curves(rows, [Curve.of(phase, 3)], [(0.0, "")]), "umo run mixer")
    (axis,) = figure.axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["phase"]
    assert {text.get_text() for text in axis.texts} == {"FILLING", "STIRRING", "EMPTYING"}
    assert [bars.get_paths()[0].get_extents().x0 for bars in axis.collections[:3]] == [0.0, 10.0, 20.0]


UNITS = ["mm", "cm", "m", "V", "mV", "A", "mA", "N", "kN", "W", "kW", "bar", "Pa", "s"]


def rack(sensors: int, units: int = 1, relays: int = 0) -> Rack:
    """Parts without a family: every name is its own."""
    parts: dict[str, Any] = {f"sensor{chr(65 + i % 26)}_{i}": _sensor(UNITS[i % units]) for i in range(sensors)}
    return Rack(parts=parts | {f"relay_{i}": relay() for i in range(relays)}, timer=timer())


def _sensor(unit: str) -> DigitalSensor:
    return DigitalSensor(unit, minimum=0.0, maximum=100.0, resolution=0.5)


def test_a_thousand_objects_without_a_list_share_the_panel_of_their_unit() -> None:
    figure, rest = draw(trace_of(rack(1000)), "umo run rack")
    assert (rest, len(figure.axes)) == ("", 1)
    assert names(figure.axes[0])[0].endswith(" and 998 others\nleast to most")
    assert_clear(figure)


@pytest.mark.full
def test_what_has_no_room_is_said_in_the_picture_and_returned() -> None:
    figure, rest = draw(trace_of(rack(14, 14, MAX_ROWS + 5)), "umo run rack")
    assert rest == f"{4 + 5} of {14 + MAX_ROWS + 5}: parts.sensorK_10, parts.sensorL_11 and 7 others"
    assert f"not shown: {rest} (all are in trace.csv)" in figure.axes[-1].get_xlabel()
    assert len(figure.axes) == MAX_PANELS + 1
    assert figure.get_figheight() < 23
    assert_clear(figure)


@pytest.mark.full
def test_names_of_any_length_and_any_script_leave_room_for_the_curves(tmp_path: Path) -> None:
    parts = {f"{'long_' * 20}{i}": part for i, part in enumerate([_sensor("mm"), relay(), _sensor("V")])}
    machine = Rack(parts=parts | {"目标_$_{": relay()}, timer=timer())
    trace = trace_of(machine, phases=50)
    figure, _ = draw(trace, "umo run rack")
    boxes = [axis.get_position() for axis in figure.axes]
    assert all(box.width > 0.4 for box in boxes)
    assert save_plot(trace, tmp_path / "plot.png", "目标 $_{") == ""
    assert (tmp_path / "plot.png").stat().st_size > 1000


def test_a_trace_without_rows_or_without_objects_is_no_error(tmp_path: Path) -> None:
    assert save_plot(Trace(), tmp_path / "none.png", "") == ""
    assert not (tmp_path / "none.png").exists()
    figure, _ = draw(trace_of(Rack(parts={}, timer=timer())), "nothing")
    assert len(figure.axes) == 1


@pytest.mark.full
def test_umo_run_says_what_the_plot_does_not_show(umo: Any, tank: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plot, "MAX_ROWS", 1)
    result = umo("run", "tank")
    assert result.exit_code == 0
    assert "; the plot does not show 2 of " in " ".join(result.stdout.split())
