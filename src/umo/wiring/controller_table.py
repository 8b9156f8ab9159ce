"""The lines of `[wire]` that give a part to a controller: `"theta" = { controller = "drive" }`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from umo.drivers.contract import Driver
from umo.drivers.off_cycle import OffCycle
from umo.drivers.wrapping import bare
from umo.objects import Atomic, Compound, atoms, walk
from umo.text import did_you_mean, some
from umo.wiring.source import CONTROLLER, WiringSource
from umo.wiring.wired import Wire

ON_CONTROLLER = "take_part"
"""The method of a driver on whose device a part can run (`umo.generate.split.controller_driver`)."""


def give_to_controllers(source: WiringSource, root: Compound, items: Mapping[str, Atomic]) -> dict[str, str]:
    """Return the controller of each part, by path. Objects of the part that have no line in `[wire]` get one."""
    parts = {node._path: node for node in walk(root) if isinstance(node, Compound)}
    found: dict[str, str] = {}
    for path, table in source.controllers.items():
        key, name = f'wire."{path}"', table[CONTROLLER]
        if path not in parts:
            is_object = (
                "is an object; only a part can run on a controller"
                if path in items
                else ("the machine has no such part")
            )
            source.mistake(key, f"{is_object}{did_you_mean(path, parts)}")
        elif not isinstance(name, str) or len(table) > 1:
            source.mistake(key, f'must be {{ controller = "NAME" }} and nothing else, not {dict(table)!r}')
        elif name in found.values():
            source.mistake(f"{key}.{CONTROLLER}", f"{name} already runs another part: one part for each controller")
        elif any(path.startswith(f"{other}.") or other.startswith(f"{path}.") for other in found):
            source.mistake(key, "is within a part that runs on another controller, or contains such a part")
        else:
            found[path] = name
            from umo.wiring.schema import Entry

            mine = (item.path for item in atoms(parts[path]))
            source.entries |= {each: Entry(driver=name) for each in mine if each not in source.entries}
    return found


def check_controllers(
    source: WiringSource, controllers: Mapping[str, str], drivers: Mapping[str, Driver[Any]], wires: list[Wire]
) -> None:
    """Check that each controller has the objects of its part and no other objects."""
    for path, name in controllers.items():
        driver = drivers.get(name)
        if driver is None:
            continue  # it is reported
        if not hasattr(bare(driver), ON_CONTROLLER):
            source.mistake(
                f'wire."{path}".{CONTROLLER}', f'{name} is not a controller: its driver needs type = "controller"'
            )
        elif isinstance(driver, OffCycle):
            source.mistake(f"drivers.{name}.off_cycle", "the driver of a controller cannot be off the cycle")
        on_it = [wire.path for wire in wires if bare(wire.driver) is bare(driver)]
        away = [each.path for each in wires if each.path.startswith(f"{path}.") and each.path not in on_it]
        if away:
            source.mistake(f'wire."{path}"', f"{some(away)} must be wired to {name}, like the part")
        others = [each for each in on_it if not each.startswith(f"{path}.")]
        if others:
            source.mistake(
                f'wire."{path}"', f"{some(others)} does not belong to this part, and cannot be wired to {name}"
            )
