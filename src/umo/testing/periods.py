"""Helpers for tests of a connected machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

from umo.drivers.wrapping import bare
from umo.errors import DeclarationError
from umo.objects import Atomic, Compound, Sensor, children
from umo.states import TwoState

if TYPE_CHECKING:
    from umo.cycle.image import Image


@runtime_checkable
class _Settable(Protocol):
    def set(self, channel: str, reading: int, /) -> None: ...


def put(sensor: Sensor, value: float | TwoState) -> None:
    """Set what a sensor on a simulated or scripted channel measures from now on: a value in its unit, or a state.

    The wired scaling applies. A value outside the range is allowed (`OUT_OF_RANGE`). A synchronous sensor takes it
    with the next `sample`, an asynchronous one with the next `read`.
    """
    image = cast("Image", sensor._image)
    wire = image.wires[sensor._slot]
    driver = bare(wire.driver)
    if not isinstance(driver, _Settable):
        raise DeclarationError(f"{sensor.path}: put() cannot set a {type(driver).__name__} channel")
    driver.set(wire.channel.text, image.nearest(sensor._slot, sensor._number(value)))


def periods(machine: Compound, count: int = 1) -> None:
    """Run `count` periods of a connected machine: timer (if there is one), sample, control, update."""
    timer = children(machine).get("timer")
    for _ in range(count):
        if isinstance(timer, Atomic):
            timer.read()  # type: ignore[attr-defined]  # every atomic object reads
        machine.sample()
        machine.control()
        machine.update()
