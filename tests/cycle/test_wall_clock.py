"""The wall clock of a computer is set while a machine runs, by a day back or on: durations do not change by it."""

from __future__ import annotations

import ast
import os
import re
import time
from pathlib import Path
from typing import Any

import pytest

from helpers.publishing import running
from tools import lint
from umo.objects.presentation.run_facts import since
from umo.process import kept_file
from umo.process.kept_file import KeptValues
from umo.process.run_state import RunState, Who
from umo.system import calls
from umo.system.processes import Child, carry_out

DAY = 86_400.0


@pytest.fixture(params=[pytest.param(-DAY, id="back"), pytest.param(DAY, id="on", marks=pytest.mark.full)])
def set_clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that sets the wall clock of this process."""
    real = time.time
    return lambda: monkeypatch.setattr(time, "time", lambda: real() + request.param)


def test_umo_ps_shows_the_time_that_has_passed(umo: Any, set_clock: Any) -> None:
    with running():
        set_clock()
        shown = re.search(r"\((\d+) s\)", umo("show", "stations").stdout)
        assert shown is not None and int(shown[1]) < 60


def test_a_run_of_which_the_time_is_not_known_has_the_time_of_day_alone() -> None:
    assert re.fullmatch(r"\d\d:\d\d:\d\d", since(0.0, None))
    assert since(0.0, 180.0).endswith(" (3 min)")


def test_values_that_were_kept_later_than_the_clock_shows_are_told_so(umo: Any, tmp_path: Path) -> None:
    (tmp_path / "press" / "wiring").mkdir(parents=True)
    (tmp_path / "press" / "objects.py").write_text("")
    path = kept_file.path_of("press", "simulated")
    entries = {"a": {"value": 1, "unit": "", "type": "int"}}
    for later, told in ((DAY, "later than the clock shows now"), (-DAY, "kept 24 h 00 min ago")):
        values = KeptValues("press", "simulated", utc=time.time() + later, sections={"numbers": entries})
        with kept_file.locked(path, 1.0):
            kept_file.write(path, kept_file.dump(values))
        assert told in umo("tune", "kept", "press").stdout


class OldLibrary:
    """A C library whose locks can be waited for by the wall clock only."""

    def __init__(self, library: Any) -> None:
        self._library = library

    def __getattr__(self, name: str) -> Any:
        if name == "pthread_mutex_clocklock":
            raise AttributeError(name)
        return getattr(self._library, name)


def test_a_lock_is_waited_for_by_the_monotonic_clock_also_with_an_old_c_library(
    set_clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = OldLibrary(calls._libc())
    monkeypatch.setattr(calls, "_libc", lambda: library)
    state = RunState(workers=1)
    (asked, ask) = os.pipe()
    pid = state.fork(Who.GUARDIAN)
    if pid == 0:
        os.close(ask)
        carry_out(lambda: len(os.read(asked, 1)))
    set_clock()
    child = Child(pid)
    try:
        assert not state.gone(0.05, Who.GUARDIAN)
    finally:
        os.close(ask)
        assert child.end(10.0)
    assert state.gone(10.0, Who.GUARDIAN)
    os.close(asked)


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import time\nx = time.time() - 5", True),
        ("from time import time as now\nx = now()", True),
        ("from datetime import datetime\nx = datetime.now()", True),
        ("from umo.system import calls\nx = calls.wall_time()", True),
        ("import time\nx = time.monotonic() - time.perf_counter()", False),
        ("from datetime import datetime\nx = datetime.fromtimestamp(0)", False),
    ],
)
def test_the_lint_finds_a_reading_of_the_wall_clock_in_a_module_that_means_no_date(source: str, found: bool) -> None:
    problems = [each for each in lint.wall_clocks({"cycle/new.py": ast.parse(source)}) if "cycle/new.py" in each]
    assert bool(problems) is found
