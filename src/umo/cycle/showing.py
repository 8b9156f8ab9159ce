"""Frames: each period of a connected machine, shown to its observers, as a capability."""

from __future__ import annotations

import logging
from collections.abc import Callable
from inspect import iscoroutine
from time import monotonic_ns
from typing import Any

from umo.cycle.capability import Capability
from umo.cycle.frame import Frame, Signal, signals_of, velocities
from umo.cycle.machine import ConnectedMachine
from umo.drivers.faults.wrapper import Injection
from umo.errors import NotAwaited
from umo.system.streams import log_without_waiting
from umo.user_code import Raised, as_json, told

log = logging.getLogger("umo")
MAX_OBSERVER_TEXT = 200
"""Largest length of an observer's name in the log, in characters."""
INJECTED = "injected_faults"
"""The signal of a run with injected faults: the number of faults in effect."""


class Showing(Capability):
    """The frames of one machine, shown at the end of SHOW if there are observers."""

    frame: Frame

    def __init__(self, injection: Injection | None) -> None:
        self._injection = injection

    def attach(self, machine: ConnectedMachine) -> None:
        image, injection, self._machine = machine.image, self._injection, machine
        faults = () if injection is None else (Signal(INJECTED, "", injection, "active"),)
        self.frame = Frame(image, (*signals_of(machine.directory.numbers), *velocities(image.items), *faults))
        self._axis_states: Any = image.columns.axes.data
        machine.phases.show = self._show

    def _show(self) -> None:
        frame, machine = self.frame, self._machine
        clock, began = machine.clock, machine.phases.began
        frame.began = began
        frame.execution = (monotonic_ns() - began) * 1e-9
        frame.number, frame.time, frame.missed = clock.number, clock.now, clock.missed
        frame.progress = machine.progress
        frame.renew()
        for number, axis in enumerate(machine.directory.axes):
            self._axis_states[number] = axis.shown_state()
        show(frame, machine.observers)


def frame_of(machine: ConnectedMachine) -> Frame:
    """Return the frame of a connected machine that was shown last."""
    found = machine.find(Showing)
    assert found is not None  # every connected machine has them (`umo.cycle.laid_out`)
    return found.frame


def show(frame: Frame, observers: list[Callable[[Any], object]]) -> None:
    """Call the observers. An observer that raises an error is logged and removed; it does not affect the loop."""
    for observer in tuple(observers):
        try:  # not by `attempt`: a call for each in every period is too dear
            result = observer(frame)
            if result is None:
                continue
            error = _as_sequence(result)
        except BaseException as raised:
            error = told(raised)
        if error is not None:
            observers[:] = [each for each in observers if each is not observer]
            name = as_json(observer, MAX_OBSERVER_TEXT)
            log_without_waiting(log, f"observer {name} failed and was disabled: {error.text}")


def _as_sequence(result: object) -> Raised | None:
    """Return the error of an observer that is a sequence, which is recognised by the result of its call; otherwise
    None."""
    if not iscoroutine(result):
        return None
    result.close()
    return Raised(NotAwaited, "the observer is a sequence, and nothing awaits it: an observer must be a plain function")
