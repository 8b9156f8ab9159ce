"""What Home Assistant is told: the configuration of each entity for discovery, and values as JSON."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Mapping
from datetime import UTC, datetime
from math import isfinite, isnan
from typing import Any

from umo.faces.face import Changes
from umo.faces.face_declaration import Declaration, FaceItem, ItemKind
from umo.objects import Quality

PRESS = b"PRESS"
STEP = 0.001
"""Smallest step of a number that Home Assistant can set."""
DEFAULT_LIMITS = -1e9, 1e9
FRESH = "{{ 'online' if value_json.quality in ['good', 'out of range', 'unreferenced'] else 'offline' }}"


def plain(name: str) -> str:
    """A name as Home Assistant takes it in topics and identifiers."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def value_topic(base: str, name: str) -> str:
    return f"{base}/value/{re.sub('[+#]', '_', name).replace('.', '/')}"


def text_of_time(utc: float) -> str | None:
    return None if isnan(utc) else datetime.fromtimestamp(utc, UTC).isoformat(timespec="milliseconds")


def told(item: FaceItem, changes: Changes) -> bytes:
    """Value, quality and time of an item as JSON."""
    value, quality = float(changes.values[item.number]), changes.quality_of(item.number)
    shown: Any = None
    if not isnan(value) and quality is not Quality.BAD:
        shown = item.states.get(int(value), f"{value:g}") if item.states else value if abs(value) < 1e300 else None
    time = text_of_time(float(changes.times[item.number]))
    return json.dumps({"value": shown, "quality": str(quality).lower(), "time": time}).encode()


def discovery(machine: Declaration, base: str, prefix: str) -> Mapping[str, Mapping[str, Any]]:
    """The configuration of each entity by its topic."""
    station = plain(machine.station)
    found: dict[str, dict[str, Any]] = {}
    mark = mark_of(machine)

    def add(component: str, name: str, about: dict[str, Any]) -> None:
        while (topic := f"{prefix}/{component}/umo_{station}/{plain(name)}/config") in found:  # a.b_c and a_b.c
            name += "_"
        found[topic] = _common(station, base, name, mark) | about
        if "json_attributes_topic" in about:
            found[topic]["availability"].append({"topic": about["state_topic"], "value_template": FRESH})

    for item in machine.items:
        component, more = _component(item, base)
        add(component, item.name, _value(base, item) | more)
    for each in machine.actions:
        if not each.get("arguments") and not each.get("dead_man"):
            path = str(each["path"])
            press = {"command_topic": f"{base}/press/{path.replace('.', '/')}", "payload_press": PRESS.decode()}
            add("button", f"action:{path}", press)
    add("sensor", "refusal", {"state_topic": f"{base}/refusal", "value_template": "{{ value_json.text }}"})
    return found


def mark_of(machine: Declaration) -> str:
    """Tells declarations apart: what the broker keeps of another one counts no longer."""
    return f"{zlib.crc32(repr((machine.items, machine.actions)).encode()):08x}"


def _common(station: str, base: str, name: str, mark: str) -> dict[str, Any]:
    is_declared = f"{{{{ 'online' if value == '{mark}' else 'offline' }}}}"
    return {
        "name": name,
        "unique_id": f"umo_{station}_{plain(name)}",
        "device": {"identifiers": [f"umo_{station}"], "name": station, "manufacturer": "umo"},
        "availability": [
            {"topic": f"{base}/status"},
            {"topic": f"{base}/declaration", "value_template": is_declared},
        ],
        "availability_mode": "all",
    }


def _value(base: str, item: FaceItem) -> dict[str, Any]:
    topic = value_topic(base, item.name)
    return {"state_topic": topic, "value_template": "{{ value_json.value }}", "json_attributes_topic": topic}


def _component(item: FaceItem, base: str) -> tuple[str, dict[str, Any]]:
    """Which entity an item is, and what only that has."""
    unit = {"unit_of_measurement": item.look} if item.look else {}
    if item.kind is ItemKind.TUNABLE and not item.states:
        limits = zip((item.minimum, item.maximum), DEFAULT_LIMITS, strict=True)
        low, high = (other if limit is None or not isfinite(limit) else limit for limit, other in limits)
        order = f"{base}/set/{item.path.replace('.', '/')}"
        return "number", unit | {"command_topic": order, "min": low, "max": high, "step": STEP, "mode": "box"}
    if item.kind is ItemKind.SENSOR and set(item.states) == {0, 1}:
        return "binary_sensor", {"payload_off": item.states[0], "payload_on": item.states[1]}
    if item.states:
        return "sensor", {"device_class": "enum", "options": list(dict.fromkeys(item.states.values()))}
    return "sensor", unit | {"state_class": "measurement"}
