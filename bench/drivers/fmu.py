"""The tank of the tests in C, FMI 2.0 and 3.0; by hand: FMPy's own functions, one call for each direction."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import fmpy

from bench.drivers.case import Case, NotHere, cycle, split
from tests.helpers.fmus import Missing, tank_fmu
from umo.drivers.fmu import Fmu

INFLOW, LEVEL, SCALE = 1, 4, 0.001
"""Value references; all channels of a direction are this variable under other names."""


def cases(channels: int, stack: ExitStack) -> Iterator[Case]:
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    for version in (2, 3):
        try:
            model = tank_fmu(folder, version, extra=_aliases(version, channels))
        except Missing as error:
            raise NotHere(str(error)) from None
        umo, by_hand = _umo(model, channels, stack), _hand(model, version, channels, stack)
        yield Case(f"fmu, FMI {version}.0", "FMPy", channels, umo, by_hand, None)


def _umo(model: Path, channels: int, stack: ExitStack) -> Callable[[], None]:
    driver = Fmu(model=model)
    stack.callback(driver.close)
    driver.open()
    inputs, outputs = split(channels)
    read, written = (
        [driver.channel(f"{name}{i}:{SCALE}") for i in range(n)] for name, n in (("level", inputs), ("inflow", outputs))
    )
    return cycle(driver, read, written)


def _hand(model: Path, version: int, channels: int, stack: ExitStack) -> Callable[[], None]:
    inputs, outputs = split(channels)
    description = fmpy.read_model_description(str(model), validate=False)
    folder = fmpy.extract(str(model))
    stack.callback(shutil.rmtree, folder)
    unit: Any = fmpy.instantiate_fmu(folder, description)
    stack.callback(unit.freeInstance)
    if version == 2:
        unit.setupExperiment()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    get, put = (unit.getReal, unit.setReal) if version == 2 else (unit.getFloat64, unit.setFloat64)
    read, written = [LEVEL] * inputs, [INFLOW] * outputs

    def run() -> None:
        if read:
            [round(value / SCALE) for value in get(read)]
        if written:
            put(written, [raw * SCALE for raw in [1] * outputs])

    return run


def _aliases(version: int, channels: int) -> str:
    """Variables `level0`, ... and `inflow0`, ..."""
    inputs, outputs = split(channels)
    rows = [(f'name="level{i}" valueReference="{LEVEL}" causality="local"', "") for i in range(inputs)]
    rows += [(f'name="inflow{i}" valueReference="{INFLOW}" causality="input"', ' start="0"') for i in range(outputs)]
    if version == 2:
        return "".join(f"<ScalarVariable {which}><Real{start}/></ScalarVariable>" for which, start in rows)
    return "".join(f"<Float64 {which}{start}/>" for which, start in rows)
