"""Experiments in a separate run of a station on its simulated plant, in virtual time."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from umo.commissioning.tuning.law_facts import LawFacts
from umo.commissioning.tuning.live_experiment import BEFORE
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.control import wait
from umo.cycle.connect import connect
from umo.cycle.frame import Frame, signals_of
from umo.cycle.law_loops import loop_at
from umo.cycle.run import drive
from umo.cycle.showing import frame_of
from umo.errors import CommandRefused, OptionError
from umo.objects import Compound, Quality, atoms, described, numbers_of
from umo.objects.presentation.described import Described
from umo.process.frames.layout import describe_signals
from umo.process.job import Plan
from umo.wiring.wired import apply_parameters


def declared_facts(plan: Plan, place: str, sensor: str = "", actuator: str = "") -> LawFacts:
    """Return the facts of the law at this path, with the parameters of the wiring. No device is opened; everything is
    simulated. Raises PathError if there is no law."""
    apply_parameters(plan.machine, plan.wired.parameters, lambda restore: None)
    every = {id(each.part): each.every for each in plan.wired.rates}
    with connect(plan.machine, None) as machine:
        loop = loop_at(machine, place)
        told: dict[str, Any] = loop.law.experiments(loop.part, loop.path, loop.name).law()
        if plan.wired.period is not None:
            told["dt"] = plan.wired.period * every.get(id(loop.part), 1)
        signals = map(Described, describe_signals(signals_of(numbers_of(machine))))
        return LawFacts.of(told, sensor, actuator).described([*map(described, atoms(machine)), *signals])


def own_experiment(
    plan: Plan,
    place: str,
    facts: LawFacts,
    at: float,
    arguments: Mapping[str, Any],
    show: Callable[[float, str], object] = lambda time, text: None,
    tried: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> tuple[MeasuredResponse, dict[str, Any]]:
    """Run the station's application, and make the experiment at this time, s. `tried`: settings that laws have from the
    beginning of the run, by the paths of the laws. Returns the response and the result of the experiment. Raises
    OptionError if the wiring runs in real time. Raises CommandRefused if the run ends before this time."""
    if plan.wired.realtime:
        raise OptionError(
            f"{plan.name} with the wiring {plan.wiring_name or 'given'} runs in real time: start it with `umo run "
            f"{plan.name} --manual`, and tune the law while the station runs"
        )
    rows, ended = array("d"), dict[str, Any]()

    async def application(machine: Compound) -> None:
        for path, settings in tried.items():
            vars(loop_at(machine, path).law).update(settings)
        task = None if plan.application is None else machine.cycle.start(plan.application(machine))
        await wait(at)
        if task is not None and task.done:
            raise CommandRefused(f"the application ended before {at:g} s; give a smaller --at")
        loop = loop_at(machine, place)
        experiments = loop.law.experiments(loop.part, loop.path, loop.name)
        ended.update(await experiments.experiment(**arguments))

    def keep(frame: Frame) -> None:
        show(frame.time, frame.progress.text)
        if frame.time >= at - BEFORE * facts.dt:
            rows.extend((frame.time, *(_value(frame, place) for place in places)))

    connection = connect(plan.machine, plan.wired)
    with connection as machine:
        frame = frame_of(connection.machine)
        paths = [*(item.path for item in frame.items), *(signal.path for signal in frame.signals)]
        places = [paths.index(each) for each in facts.columns]
        connection.machine.observers.append(keep)
        drive(machine, application)
    if not ended:
        if connection.stop.signal is not None:
            raise KeyboardInterrupt
        raise CommandRefused("the run ended before the experiment")
    found = np.array(rows).reshape(-1, 1 + len(facts.columns))
    return MeasuredResponse.of_rows(found[found[:, 0] <= ended["to"]]), ended


def _value(frame: Frame, place: int) -> float:
    """Return the value of an object, or NaN while its quality is BAD. Places after those of the objects are signals."""
    if place >= len(frame.items):
        return frame.signal_values[place - len(frame.items)]
    return float(frame.values[place]) if frame.quality[place] < Quality.BAD else np.nan
