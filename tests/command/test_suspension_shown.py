"""What is driven in manual mode is said: in the terminal, in JSON, on the page, by the machine itself."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from typer.testing import CliRunner

from helpers.machines import actuator, relay, timer, wired
from helpers.operator import Operator
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, connect, published
from umo.clients.page.watched_run import Watched
from umo.objects.presentation.described import Described
from umo.objects.presentation.run_facts import driven_text
from umo.process.frames import Reader
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer
from umo_command.app import app


class Winder(Compound):
    spindle: DigitalActuator
    clamp: BinaryActuator[OnOff]
    fan: BinaryActuator[OnOff]
    timer: DigitalSensor

    def control(self) -> None:
        self.spindle.write(4.5)


@contextmanager
def winding() -> Iterator[tuple[Operator, Any]]:
    m = Winder(spindle=actuator(), clamp=relay(when_suspended="hold"), fan=relay(), timer=timer())
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer()))
    with connection, published(connection, "winder") as ring:
        ann = Operator(m)
        ring.show(ann.clients)
        ann.do("lease", seconds=60.0)
        m.clamp.write(OnOff.ON)
        ann.mode("manual")
        ann.do("write", "fan", "ON")
        yield ann, ring


ALL = "spindle 4.5 V (its law or an action), clamp ON (held, or its law), fan ON (client ann)"


def umo(*words: str) -> str:
    return " ".join(CliRunner(env={"COLUMNS": "400"}).invoke(app, words).stdout.split())


def test_ps_watch_and_page_say_what_is_driven_and_why() -> None:
    with winding() as (ann, ring):
        assert ann.driven == ALL
        assert ALL in umo("show", "stations")
        assert json.loads(umo("show", "stations", "--json"))["running"][0]["driven"] == ALL
        assert f"driven: {ALL}" in umo("show", "values", "winder", "--once")
        with Reader(ring.path) as reader:
            assert reader.facts(reader.latest())["driven"] == ALL
            watched = Watched(reader)
            watched.read()
            assert json.loads(watched.state(True))["facts"]["driven"] == ALL
        ann.do("give back")
        ann.run()
        assert "spindle 4.5 V (its law), clamp ON (held, or its law)" in umo("show", "stations")
        ann.do("lease")
        ann.mode("automatic")
        ann.run()
        assert "spindle" not in umo("show", "stations")


def test_an_actuator_that_a_law_runs_is_not_said_to_be_held_alone() -> None:
    """The compound around it declares `hold`; the event says that its law writes it."""

    class Line(Winder, when_suspended="hold"): ...

    m = Line(spindle=actuator(), clamp=relay(), fan=relay(), timer=timer())
    with connect(m, wired(m, Scripted(), clock=VirtualTimer())):
        ann = Operator(m)
        ann.do("lease", seconds=60.0)
        ann.mode("manual")
        assert ann.notes[-1] == "manual mode: its law writes: spindle"
        assert ann.driven == "spindle 4.5 V (held, or its law)"


def test_the_first_few_are_told_and_the_others_counted() -> None:
    about = [Described({"path": f"fans.{n}", "one": "ON", "zero": "OFF", "default": "OFF"}) for n in range(5)]
    level = Described({"path": "level", "unit": "mm"})
    text = driven_text([(each, 1.0, False) for each in [*about, level]], "")
    assert text == "fans.0 ON (its law), fans.1 ON (its law), fans.2 ON (its law) and 2 others"
    assert driven_text([(each, 1.0, False) for each in about[:4]], "").endswith("fans.2 ON (its law) and 1 other")
    assert driven_text([(each, 0.0, False) for each in about], "") == ""
