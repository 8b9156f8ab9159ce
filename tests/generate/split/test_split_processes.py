"""A run with a guardian whose part is on a controller: whoever dies, the outputs of the part go to their defaults."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from contextlib import suppress

import pytest

from helpers.generating import needs_a_compiler
from helpers.runs import Run, RunEnded
from helpers.split_parts import HOST_GONE, TIMEOUT_PERIODS, ZONE, RunningController
from umo.cycle import segments

pytestmark = [
    needs_a_compiler,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux"),
]


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(segments, "SETTLE", 0.01)


def heating(controller: RunningController) -> Run:
    """A run whose controller heats. One that ends before, as on a busy computer, begins anew."""
    wiring = ZONE.wiring(controller.port)
    for again in (False, True, True, True, True):
        try:
            run = Run(wiring, "heat_zone", "helpers.split_parts", acknowledge=again).until_running()
            next(each for each in controller.recorded(run) if each.outputs[0] > 0)
            return run
        except RunEnded:
            traceback.print_exc()
    raise AssertionError("every run ended before its controller heated")


def test_when_the_control_process_is_killed_the_guardian_stops_the_controller(controller: RunningController) -> None:
    run, record = heating(controller), controller.recorded()
    os.kill(run.control, signal.SIGKILL)
    stopped = next(each for each in record if each.mode in (0, HOST_GONE))
    assert (stopped.outputs, stopped.silent <= TIMEOUT_PERIODS) == (ZONE.defaults, True)
    outcome = run.outcome()
    assert (outcome.unreached, outcome.status) == ([], 1)


def test_when_all_processes_are_killed_the_controller_stops_by_itself(controller: RunningController) -> None:
    run, record = heating(controller), controller.recorded()
    for number in (signal.SIGSTOP, signal.SIGKILL):  # so that none acts on the end of another
        for each in (run.reserve, run.standby, run.guardian, run.control):
            with suppress(ProcessLookupError):  # it has died with the guardian
                os.kill(each, number)
    gone = next(each for each in record if each.mode == HOST_GONE)
    assert (gone.outputs, gone.silent <= TIMEOUT_PERIODS) == (ZONE.defaults, True)
    run.until_all_ended()
    run.channel.close()
