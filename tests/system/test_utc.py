"""UTC of a period, with its error."""

from __future__ import annotations

import ctypes
import time
from typing import Any

import pytest

from helpers.publishing import running
from umo.process.frames import Reader
from umo.process.frames.ring import UTC_PAUSE
from umo.system import utc as module
from umo.system.utc import UNKNOWN, utc
from umo.testing import periods


def kernel(status: int, maxerror: int, result: int = 0) -> Any:
    def adjtimex(asked: Any) -> int:
        asked._obj.status, asked._obj.maxerror = status, maxerror
        return result

    return lambda: adjtimex


def test_the_sum_with_the_monotonic_clock_is_utc() -> None:
    before = time.time_ns()
    offset, error = utc()
    now = time.monotonic_ns() + offset
    assert before - 1_000_000 <= now <= time.time_ns() + 1_000_000
    assert error == UNKNOWN or error >= 0


@pytest.mark.parametrize(
    ("adjtimex", "known"),
    [
        (kernel(0, 1500), True),
        (kernel(module.UNSYNCHRONISED, 1500), False),
        (kernel(0, 1500, result=-1), False),
        (lambda: None, False),
    ],
)
def test_the_error_is_the_kernels_and_unknown_while_the_clock_is_not_synchronised(
    adjtimex: Any, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_adjtimex", adjtimex)
    _, error = utc()
    assert (error >= 1_500_000) if known else (error == UNKNOWN)


def test_the_structure_is_as_long_as_the_kernels() -> None:
    assert ctypes.sizeof(module._Timex) >= 208  # struct timex with 64 bits
    assert module._Timex.status.offset == 4 * ctypes.sizeof(ctypes.c_long) + (ctypes.sizeof(ctypes.c_long))


def test_each_frame_has_the_utc_of_its_period(monkeypatch: pytest.MonkeyPatch) -> None:
    offsets = iter([(10**18, 5_000), (10**18 + 7, UNKNOWN)])
    monkeypatch.setattr("umo.process.frames.ring.utc", lambda: next(offsets))
    with running() as (m, ring, _), Reader(ring.path) as reader:
        periods(m, 2)
        frames = reader.read()
        assert frames["utc"].tolist() == [10**18] * 2
        assert frames["utc_error"].tolist() == [5_000] * 2
        ring._utc_until -= UTC_PAUSE
        periods(m)
        assert (reader.latest()["utc"], reader.latest()["utc_error"]) == (10**18 + 7, UNKNOWN)
