"""`umo device get` of a sensor of a station that runs says how to see what its circuit holds, which it shows without a
run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from typer.testing import Result

from helpers.machines import Bench, bench, wired
from umo import connect, published
from umo.drivers import Inspects
from umo.drivers.contract import Channel
from umo.testing import Scripted, periods

Umo = Callable[..., Result]
HINT = (
    "the raw content of the circuit of encoder, such as registers in each byte order, can be read only while the "
    "station does not run: `umo do press stop`, then `umo device get press encoder`"
)


class ChangeEvents(Scripted, Inspects):
    """A circuit whose driver says what it holds; not in a run, as that would take its time."""

    def inspect(self, channel: Channel) -> str:
        raise AssertionError("asked in a run")


@contextmanager
def running(box: Scripted, **entries: Any) -> Iterator[Bench]:
    machine = bench()
    connection = connect(machine, wired(machine, box, entries=entries))
    with connection, published(connection, "press", "rig"):
        periods(machine, 3)
        yield machine


def said(umo: Umo, *paths: str) -> str:
    result = umo("device", "get", "press", *paths)
    assert result.exit_code == 0, result.output
    return " ".join(result.stderr.split())


def test_a_sensor_of_a_driver_that_tells_what_it_holds_has_the_hint(umo: Umo) -> None:
    with running(ChangeEvents()):
        assert HINT in said(umo, "encoder")
        assert said(umo, "encoder", "motor", "limit").count("the raw content of the circuit") == 1


def test_outputs_and_states_have_none(umo: Umo) -> None:
    with running(ChangeEvents()):
        assert "the raw content of the circuit" not in said(umo, "motor", "valve", "limit")


def test_a_sensor_of_a_driver_that_tells_nothing_has_none(umo: Umo) -> None:
    with running(Scripted()):
        assert "the raw content of the circuit" not in said(umo, "encoder")


@pytest.mark.parametrize(("box", "has_hint"), [(ChangeEvents(), True), (Scripted(), False)])
def test_injected_faults_do_not_change_that(umo: Umo, box: Scripted, has_hint: bool) -> None:
    machine = bench()
    connection = connect(machine, wired(machine, box), fault="encoder stuck at 5 s")
    with connection, published(connection, "press"):
        periods(machine, 3)
        assert ("the raw content of the circuit" in said(umo, "encoder")) is has_hint
