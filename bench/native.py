"""Rows (b) and (c): compiled here with -O2, called through ctypes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from bench.mix import Layout

HERE = Path(__file__).parent
CXX = os.environ.get("CXX", "g++")


def missing() -> str | None:
    """Why there are no rows in C and C++, if so."""
    return None if shutil.which(CXX) else f"Rows (b) and (c) are left out: there is no {CXX} here (set CXX)."


def version() -> str:
    return subprocess.run([CXX, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


@cache
def library() -> ctypes.CDLL:
    """The compiled rows. Each source is a unit of its own, symbols are hidden: calls between them are direct."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "rows.so"
        flags = ["-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-Wall"]
        sources = [str(HERE / "paper.cc"), str(HERE / "paper_io.cc"), "-x", "c", str(HERE / "floor.c")]
        subprocess.run([CXX, *flags, "-o", str(target), *sources, "-lm"], check=True)
        return ctypes.CDLL(str(target))  # stays mapped after its file is gone


class Native:
    """One of the two, with as many objects as the layout says."""

    def __init__(self, prefix: str, plan: Layout) -> None:
        self._prefix = prefix
        self._plan = plan
        sizes = (plan.count,) if prefix == "paper" else (plan.sensors, plan.actuators)
        new = self._function("new")
        new.restype = ctypes.c_void_p
        self._plant = ctypes.c_void_p(new(*sizes))

    def prepare(self, commands: Sequence[float]) -> None:
        self._function("prepare")(self._plant, (ctypes.c_double * len(commands))(*commands))

    def load(self, readings: Sequence[int]) -> None:
        self._function("load")(self._plant, (ctypes.c_long * len(readings))(*readings))

    def sample_update(self, periods: int) -> None:
        self._function("sample_update")(self._plant, periods)

    def write(self, periods: int) -> None:
        self._function("write")(self._plant, periods)

    def period(self, periods: int) -> None:
        self._function("period")(self._plant, periods)

    def values(self) -> list[float]:
        values = (ctypes.c_double * self._plan.sensors)()
        self._function("values")(self._plant, values)
        return list(values)

    def raws(self) -> list[int]:
        raws = (ctypes.c_long * self._plan.actuators)()
        self._function("store")(self._plant, raws)
        return list(raws)

    def _function(self, name: str) -> ctypes._NamedFuncPointer:
        return getattr(library(), f"{self._prefix}_{name}")
