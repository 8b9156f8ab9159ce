"""Cache warming: the work of the thread while it waits busily for its tick.

In a period of 1 ms the processor's caches are cold at the tick, and the work takes several times as long as in a period
that follows immediately. So umo carries out its own part of a period on a copy of the machine's objects: the copies are
sampled, read, written and updated, and their driver does nothing. No real driver and no code of the user is called.
(docs/decisions/0018 describes the alternatives that were tried.)
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Any

from umo.cycle.clock import Clock
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine
from umo.cycle.machine_view import connect_compounds
from umo.cycle.stopping import StopFlag
from umo.drivers.contract import Direction
from umo.drivers.simulated import Simulated
from umo.drivers.timerfd import WhileWaiting
from umo.drivers.wrapping import bare
from umo.errors import text_of
from umo.objects import Atomic, Compound
from umo.objects.atomic import Calibration
from umo.system.streams import log_without_waiting
from umo.wiring.wired import Wire, Wired

log = logging.getLogger("umo")
COPIED_OBJECTS = 50
"""The largest number of objects that are copied. Copying thousands would not end before the tick."""


def wait_busily(wired: Wired, seconds: float) -> None:
    """If the timer of a connected machine runs in real time, wake the machine's thread `seconds` before each tick and
    warm the caches. 0 means no busy waiting."""
    ticker = None if wired.timer_wire is None else getattr(bare(wired.timer_wire.driver), "ticker", None)
    if ticker is None:
        return
    ticker.wait_busily(seconds)
    if seconds and ticker.meanwhile is None:
        try:
            ticker.meanwhile = WhileWaiting(CacheWarming(wired))
        except Exception as error:
            _give_up(error)


class CacheWarming:
    """The function that warms the caches. Each call carries out one period of a copy of at most `COPIED_OBJECTS` of the
    machine's objects."""

    def __init__(self, wired: Wired) -> None:
        """Prepare the copy of the objects of a machine with a timer."""
        nowhere = Simulated(history=1)
        timer_first = sorted(wired.wires, key=lambda wire: wire.item is not wired.timer)
        wires = [
            replace(
                wire,
                item=_copy(wire.item),
                driver=nowhere,
                channel=nowhere.channel(str(number)),
                calibration=_calibration(wire),
            )
            for number, wire in enumerate(timer_first[:COPIED_OBJECTS])
        ]
        for wire in wires[1:]:  # the timer reads 0: no tick has been missed
            nowhere.set(wire.channel.text, _good_raw(wire))
        items = [wire.item for wire in wires]
        copied = Wired({"nowhere": nowhere}, wires, wired.period, items[0])
        self._root = _Copy(objects=items)
        self._machine = ConnectedMachine(self._root, Image(copied, Clock(wired.period or 0.0)), StopFlag())
        connect_compounds(self._machine)
        self._timer: Any = items[0]
        self._sound = True
        synchronous = [item for item in items if item.synchronous]
        self._sensors: list[Any] = [item for item in synchronous if item.direction is Direction.INPUT]
        self._actuators: list[Any] = [item for item in synchronous if item.direction is Direction.OUTPUT]

    def __call__(self) -> None:
        """Warm the caches. An error does not affect the machine; after an error the caches are no longer warmed."""
        if self._sound:
            try:
                self._period()
            except Exception as error:
                self._sound = False
                _give_up(error)

    def _period(self) -> None:
        self._timer.read()
        self._root.sample()
        for sensor in self._sensors:
            sensor.read()
        for actuator in self._actuators:
            actuator.write(actuator.default)
        self._root.update()


def _give_up(error: Exception) -> None:
    log_without_waiting(log, f"caches are not warmed: {text_of(error)}")


def _good_raw(wire: Wire) -> int:
    """Return a raw integer near the middle of the range that does not mark an invalid reading."""
    return next(raw for raw in count(sum(wire.raw_bounds) // 2) if raw not in wire.invalid_raws)


def _calibration(wire: Wire) -> Calibration:
    """Return the calibration, but without a linearization that is the user's own."""
    users = wire.linearization is not None and not type(wire.linearization).__module__.startswith("umo.objects")
    return wire.calibration._replace(linearization=None) if users else wire.calibration


class _Copy(Compound):
    objects: Sequence[Atomic]


def _copy(item: Atomic) -> Any:
    """Return a copy of the object, of umo's own class. It has the same calibration and guards, and no parent; it counts
    as referenced."""
    kind = next(each for each in type(item).__mro__ if each.__module__.startswith("umo.objects"))
    copy: Any = object.__new__(kind)
    for each in kind.__mro__:
        for name in getattr(each, "__slots__", ()):
            if name != "__weakref__":
                setattr(copy, name, getattr(item, name))
    copy._parent, copy._name = None, ""
    if copy._incremental:
        copy._incremental = False
    copy._disconnect()
    return copy
