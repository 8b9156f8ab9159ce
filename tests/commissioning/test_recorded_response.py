"""Responses from files: samples with a value that is not good are left out."""

from __future__ import annotations

from pathlib import Path

import pytest

from umo.commissioning.tuning.recorded_response import recorded_response


def test_samples_of_a_trace_with_a_value_that_is_not_good_are_left_out(tmp_path: Path) -> None:
    rows = ["time_s,missed,execution_us,valve[percent],level[mm],levels.other[mm],not_good"]
    for number in range(60):
        told = {30: "level=STALE", 31: "valve=OUT_OF_RANGE level=STALE", 32: "levels.other=STALE"}.get(number, "")
        level = 99.0 if "level=" in told else 1.0 * number
        rows.append(f"{number * 0.1:.1f},0,1,{number},{level},0,{told}")
    (tmp_path / "trace.csv").write_text("\n".join(rows))
    response = recorded_response(tmp_path / "trace.csv", ["valve", "level"])
    assert response.measurements[29:33] == pytest.approx([29.0, 30.0, 31.0, 32.0])  # from those beside them


def test_a_trace_without_marks_is_read_as_it_is(tmp_path: Path) -> None:
    rows = ["time_s,missed,execution_us,valve[percent],level[mm]", *(f"{n},0,1,0,{n}" for n in range(30))]
    (tmp_path / "trace.csv").write_text("\n".join(rows))
    response = recorded_response(tmp_path / "trace.csv", ["valve", "level"])
    assert response.measurements.tolist() == [float(n) for n in range(30)]
