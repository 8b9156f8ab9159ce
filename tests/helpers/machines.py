"""Small machines and wirings that many tests share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor
from umo.drivers import Driver
from umo.objects import atoms
from umo.process.station import Station, shipped
from umo.states import OnOff, PassFail
from umo.system.packages import SHIPPED
from umo.testing import Scripted, VirtualTimer

TEMPLATE = SHIPPED.parents[1] / "umo_command" / "template" / "station"
"""The station that `umo new station` copies."""


def stations() -> dict[str, Callable[[], Compound]]:
    """Every machine that ships, by the name of its station."""
    return {name: Station(name, path).machine for name, path in (shipped() | {"template": TEMPLATE}).items()}


def timer() -> DigitalSensor:
    return DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)


def actuator(**changes: Any) -> DigitalActuator:
    return DigitalActuator("V", **({"default": 0.0, "minimum": -10.0, "maximum": 10.0, "resolution": 0.5} | changes))


def sensor(**changes: Any) -> DigitalSensor:
    return DigitalSensor("mm", **({"minimum": 0.0, "maximum": 100.0, "resolution": 0.5} | changes))


def relay(**changes: Any) -> BinaryActuator[OnOff]:
    return BinaryActuator(OnOff, **({"one": OnOff.ON, "default": OnOff.OFF} | changes))


def switch(**changes: Any) -> BinarySensor[PassFail]:
    return BinarySensor(PassFail, **({"one": PassFail.FAIL} | changes))


class Bench(Compound):
    """One of each, and a timer."""

    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor
    valve: BinaryActuator[OnOff]
    limit: BinarySensor[PassFail]


def bench(kind: type[Bench] = Bench, **changes: Any) -> Any:
    parts = {"motor": actuator(), "encoder": sensor(), "valve": relay(), "limit": switch()} | changes
    return kind(timer=timer(), **parts)


def wired(
    machine: Compound,
    box: Driver,
    *,
    clock: Driver | None = None,
    entries: dict[str, dict[str, Any]] | None = None,
    **drivers: Any,
) -> dict[str, Any]:
    """Everything on `box`, the timer on `clock` at 1 ms; `entries` change single lines by path. In virtual time the box
    has 1 s for a call: on a busy computer it may take the 10 periods after which it has timed out by default."""
    wire: dict[str, dict[str, Any]] = {
        item.path: {"driver": "clock", "period": "1 ms"} if item.path == "timer" else {"driver": "box"}
        for item in atoms(machine)
    }
    for path, entry in (entries or {}).items():
        wire[path] = wire.get(path, {}) | entry
    is_virtual = clock is None and wire.get("timer", {}).get("driver") == "clock"
    patient = {"type": box, "timeout": "1 s"} if is_virtual else box
    return {"drivers": {"box": patient, "clock": clock or VirtualTimer(), **drivers}, "wire": wire}


class Board(Scripted):
    """A circuit that takes devices."""

    realtime = True

    def __init__(self, *devices: str) -> None:
        super().__init__()
        self._devices = devices

    def devices(self) -> tuple[str, ...]:
        return self._devices


def on(box: Driver[Any], machine: Compound) -> dict[str, Any]:
    """Everything on one circuit, the timer too."""
    return wired(machine, box, clock=Board())


def failed(error: BaseException) -> list[str]:
    """The paths that an error of the drivers names."""
    return [failure.path for failure in error.failures]  # type: ignore[attr-defined]
