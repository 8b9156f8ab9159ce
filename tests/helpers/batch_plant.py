"""The batch plant behind controller boxes of its own, in virtual time."""

from __future__ import annotations

from typing import Any

from umo.drivers import Channel, Driver
from umo.objects import atoms
from umo.stations.batch.objects import machine
from umo.stations.batch.plant import Plant


class Box(Driver):
    """A controller box of its own in front of the plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant

    def channel(self, text: str) -> Channel:
        return self._plant.channel(text)

    def read(self, channel: Channel) -> int:
        return self._plant.read(channel)

    def write(self, channel: Channel, raw: int) -> None:
        self._plant.write(channel, raw)


def boxes(plant: Plant | None = None) -> dict[str, Any]:
    """A wiring of the plant behind a box for each reactor and one for the line; the plant itself is the timer."""
    plant = plant or Plant()
    names = {"reactors.0": "box_0", "reactors.1": "box_1", "line": "box_line", "timer": "plant"}
    kinds = {"inlets": "inlet", "outlets": "outlet", "temperature": "thermometer"}
    wire: dict[str, Any] = {"timer": {"driver": "plant", "channel": "tick", "period": "100 ms"}}
    for item in atoms(machine()):
        parts = item.path.split(".")
        if parts != ["timer"]:
            driver = next(name for part, name in names.items() if item.path.startswith(part))
            number = [part for part in parts if part.isdigit()]
            kind = next(part for part in reversed(parts) if not part.isdigit())
            wire[item.path] = {"driver": driver, "channel": ":".join([kinds.get(kind, kind), *number])}
    return {"drivers": {"plant": plant} | {name: Box(plant) for name in ("box_0", "box_1", "box_line")}, "wire": wire}
