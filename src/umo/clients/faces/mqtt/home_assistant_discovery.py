"""The messages for Home Assistant: the configuration of each entity for discovery, and values as JSON."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from math import isfinite, isnan
from typing import Any

from umo.clients.faces.face import Changes
from umo.objects import Quality
from umo.objects.presentation.identity import Identities, escaped, is_topic, is_word
from umo.process.frames.machine_items import QUIET, Declaration, ItemKind, MachineItem

PRESS = b"PRESS"
STEP = 0.001
"""Smallest step of a number that Home Assistant can set."""
DEFAULT_LIMITS = -1e9, 1e9
DISPLAYED = (Quality.GOOD, Quality.OUT_OF_RANGE, Quality.UNREFERENCED)
"""The qualities with which an entity shows its value; with other qualities it is unavailable."""
PROBLEMS = (ItemKind.ALARM, ItemKind.EQUIPMENT)
"""Items that become a binary sensor of class `problem`."""
UNITS = {"l": "L", "ml": "mL", "l/min": "L/min"}
"""Home Assistant's spelling of units."""
DEVICE_CLASSES = {
    unit: name
    for name, units in {
        "temperature": "°C °F", "pressure": "Pa hPa kPa mbar bar psi mmHg", "voltage": "V mV", "current": "A mA",
        "power": "W kW", "frequency": "Hz kHz MHz GHz", "distance": "mm cm m km", "speed": "m/s km/h",
        "weight": "mg g kg", "volume_storage": "mL L m³", "volume_flow_rate": "L/min m³/h", "duration": "ms s min h d",
        "irradiance": "W/m²", "illuminance": "lx",
    }.items()
    for unit in units.split()
}  # fmt: skip
"""The device class that follows from a sensor's unit. K has no device class here, and a computed value has none,
because it may be a difference (such as a law's error in °C), which Home Assistant would convert like a temperature."""


ENTITIES = Identities("-", "--", is_word)
"""Identifiers of entities: `tunable:cell.gain` is `tunable--cell-gain`. Home Assistant allows letters, digits, _ and
-."""
TOPICS = Identities("/", ":", is_topic)
"""Topics below `value`, `set` and `press`: that of `tunable:cell.gain` is `tunable:cell/gain`."""


def device_of(station: str) -> str:
    """Return the identifier of a station's device."""
    return f"umo-{escaped(station, is_word)}"


def value_topic(base: str, item: MachineItem) -> str:
    return f"{base}/value/{item.identity(TOPICS)}"


def text_of_time(utc: float) -> str | None:
    return None if isnan(utc) else datetime.fromtimestamp(utc, UTC).isoformat(timespec="milliseconds")


def told(item: MachineItem, changes: Changes) -> bytes:
    """Return the value, quality and time of an item as JSON."""
    value, quality = float(changes.values[item.number]), changes.quality_of(item.number)
    shown: Any = None
    if not isnan(value) and quality is not Quality.BAD:
        shown = item.state_of(value) if item.states else None
        if shown is None and abs(value) < 1e300:  # the name of a state is a text, whatever it looks like
            shown = value
    time = text_of_time(float(changes.times[item.number]))
    return json.dumps({"value": shown, "quality": _word(quality), "time": time}).encode()


def _word(quality: Quality) -> str:
    """Return the word for a quality."""
    return str(quality).lower()


def _listed(names: Iterable[str]) -> str:
    """Return texts as a list in the syntax of Jinja."""
    return json.dumps(list(names), ensure_ascii=False)


FRESH = f"{{{{ 'online' if value_json.quality in {_listed(map(_word, DISPLAYED))} else 'offline' }}}}"


def discovery(machine: Declaration, base: str, prefix: str) -> Mapping[str, Mapping[str, Any]]:
    """Return the configuration of each entity by its topic."""
    device, found = device_of(machine.station), {}
    common = _common(machine, base)

    def add(component: str, name: str, identity: str, about: dict[str, Any]) -> None:
        topic = f"{prefix}/{component}/{device}/{identity}/config"
        availability = [*common["availability"]]
        if "json_attributes_topic" in about:
            availability.append({"topic": about["state_topic"], "value_template": FRESH})
        own = {"name": name, "unique_id": f"{device}-{identity}", "availability": availability}
        found[topic] = common | own | about

    for item in machine.items:
        component, more = _component(item, base)
        add(component, item.name, item.identity(ENTITIES), _value(base, item) | more)
    for path in pressed(machine):
        press = {"command_topic": f"{base}/press/{TOPICS.of(path)}", "payload_press": PRESS.decode()}
        add("button", f"action:{path}", ENTITIES.of(path, "action"), press)
    refusal = {"state_topic": f"{base}/refusal", "value_template": "{{ value_json.text }}"}
    add("sensor", "refusal", ENTITIES.of("refusal", "run"), refusal)
    return found


def pressed(machine: Declaration) -> list[str]:
    """Return the paths of the actions that have a button."""
    return [str(each["path"]) for each in machine.actions if not each.get("arguments") and not each.get("dead_man")]


def former_topics(machine: Declaration, prefix: str) -> list[str]:
    """Return the topics of discovery that umo 0.2 used, where two names could have the same identity. Messages that the
    broker retains there are deleted, so that Home Assistant has each entity only once."""
    found: list[str] = []

    def add(component: str, name: str) -> None:
        station, plain = (re.sub(r"[^A-Za-z0-9_-]", "_", each) for each in (machine.station, name))
        while (topic := f"{prefix}/{component}/umo_{station}/{plain}/config") in found:
            plain += "_"
        found.append(topic)

    for item in machine.items:
        is_binary = item.kind is ItemKind.SENSOR and set(item.states) == {0, 1}
        is_number = item.kind is ItemKind.TUNABLE and not item.states
        add("binary_sensor" if is_binary else "number" if is_number else "sensor", item.name)
    for path in pressed(machine):
        add("button", f"action:{path}")
    add("sensor", "refusal")
    return found


def mark_of(machine: Declaration) -> str:
    """Return a mark of the declaration. Messages with another mark, which the broker retains from another declaration,
    are ignored."""
    return f"{zlib.crc32(repr((machine.items, machine.actions)).encode()):08x}"


def _common(machine: Declaration, base: str) -> dict[str, Any]:
    """Return the fields that all entities have."""
    is_declared = f"{{{{ 'online' if value == '{mark_of(machine)}' else 'offline' }}}}"
    return {
        "device": {"identifiers": [device_of(machine.station)], "name": machine.station, "manufacturer": "umo"},
        "availability": [
            {"topic": f"{base}/status"},
            {"topic": f"{base}/declaration", "value_template": is_declared},
        ],
        "availability_mode": "all",
    }


def _value(base: str, item: MachineItem) -> dict[str, Any]:
    """Return the topic of the value, and the template for its state. A value that is not one of the states is shown as
    unknown (`None`); otherwise Home Assistant would keep showing the last state."""
    topic, template = value_topic(base, item), "{{ value_json.value }}"
    if item.states:
        known = _listed(dict.fromkeys(item.states.values()))
        shown = (
            f"('OFF' if value_json.value in {_listed(QUIET)} else 'ON')" if _is_problem(item) else "value_json.value"
        )
        template = f"{{{{ {shown} if value_json.value in {known} else None }}}}"
    return {"state_topic": topic, "value_template": template, "json_attributes_topic": topic}


def _is_problem(item: MachineItem) -> bool:
    return item.kind in PROBLEMS and bool(item.states)


def _component(item: MachineItem, base: str) -> tuple[str, dict[str, Any]]:
    """Return the entity type of an item, and the fields of this type."""
    look = UNITS.get(item.look, item.look)
    unit = {"unit_of_measurement": look} if look else {}
    if item.kind is ItemKind.TUNABLE and not item.states:
        limits = zip((item.minimum, item.maximum), DEFAULT_LIMITS, strict=True)
        low, high = (other if limit is None or not isfinite(limit) else limit for limit, other in limits)
        order = f"{base}/set/{TOPICS.of(item.path)}"
        return "number", unit | {"command_topic": order, "min": low, "max": high, "step": STEP, "mode": "box"}
    if item.kind is ItemKind.SENSOR and set(item.states) == {0, 1}:
        return "binary_sensor", {"payload_off": item.states[0], "payload_on": item.states[1]}
    if _is_problem(item):
        return "binary_sensor", {"device_class": "problem"}
    if item.states:
        return "sensor", {"device_class": "enum", "options": list(dict.fromkeys(item.states.values()))}
    is_at_circuit = item.kind in (ItemKind.SENSOR, ItemKind.ACTUATOR)
    more: dict[str, Any] = {"device_class": DEVICE_CLASSES[look]} if is_at_circuit and look in DEVICE_CLASSES else {}
    if item.digits is not None:
        more["suggested_display_precision"] = item.digits
    return "sensor", unit | more | {"state_class": "measurement"}
