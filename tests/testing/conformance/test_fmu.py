"""The conformance kit on the driver `fmu`, with the C tank of FMI 2.0 and 3.0 and with a model of PythonFMU."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.fmus import PYTHON_LOOPS, python_fmu, tank_fmu
from umo.drivers.fmu import Fmu
from umo.testing.conformance import Input, Output, Subject, conform

OUTPUTS = {
    "enable": Output("enable", 0, 0, 1),
    "mode": Output("mode", 1, 1, 2),
    "small": Output("small", 0, -128, 127),
    "word": Output("word", 7, 0, 65535),
    "big": Output("big", 0, 0, 2**63 - 1),
    "wide": Output("wide", 0, -(2**63), 2**63 - 1),
    "single:0.5": Output("single:0.5", 0, -(2**20), 2**20),
    "level:0.001": Output("level:0.001", 0, -(2**47), 2**47 - 1),
}
LOOPS_2 = (("enable", "enabled"), ("mode", "mode_used"))
LOOPS_3 = (*LOOPS_2, ("small", "small_out"), ("word", "word_out"), ("big", "big_out"), ("wide", "wide_out"),
           ("single:0.5", "single_out:0.5"))  # fmt: skip
LOOPS_PYTHON = (("enable", "enabled"), ("level:0.001", "level_out:0.001"))


def subject(name: str, model: Path, loops: tuple[tuple[str, str], ...], refused: tuple[str, ...] = ()) -> Subject:
    return Subject(
        name=name,
        make=lambda: Fmu(model=model),
        outputs=tuple(OUTPUTS[output] for output, _ in loops),
        inputs=tuple(Input(text) for _, text in loops),
        loopbacks=loops,
        refused=refused,
        device=model.name,
    )


@pytest.mark.parametrize(("version", "loops"), [(2, LOOPS_2), (3, LOOPS_3)], ids=["fmi2", "fmi3"])
@pytest.mark.full
def test_the_driver_of_a_model_in_c_conforms(tmp_path: Path, version: int, loops: tuple[tuple[str, str], ...]) -> None:
    model = tank_fmu(tmp_path, version)
    certificate = conform(subject(f"fmu, FMI {version}.0", model, loops, ("broken:1",)), cycles=2000)
    assert certificate.passed, certificate
    assert certificate.finding("block failures").verdict == "passed", certificate


def test_the_driver_of_a_model_of_pythonfmu_conforms(tmp_path: Path, rules: list[str] | None) -> None:
    model = python_fmu(tmp_path, PYTHON_LOOPS, "python_loops_of_the_tests")
    certificate = conform(subject("fmu, PythonFMU", model, LOOPS_PYTHON), cycles=500, only=rules)
    assert certificate.passed, certificate
