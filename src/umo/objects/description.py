"""Objects as plain data, for other processes and for tables."""

from __future__ import annotations

from typing import Any

from umo.objects.actuators import BinaryActuator, DigitalActuator
from umo.objects.atomic import Atomic, Binary, Digital


def described(item: Atomic) -> dict[str, Any]:
    """Path, kind and meaning of an object; once it is connected, how it is wired (`wire`)."""
    what: dict[str, Any] = {"path": item.path, "kind": type(item).__name__, "synchronous": item.synchronous}
    if item.connected:
        what["wire"] = item._image.wire_texts[item._slot]
    if isinstance(item, BinaryActuator | DigitalActuator):
        default = item.default if isinstance(item, DigitalActuator) else str(item.default)
        what |= {"actuator": True, "default": default, "expires": item.expires}
    if isinstance(item, Digital):
        return what | {"unit": item.units, "minimum": item.minimum, "maximum": item.maximum}
    assert isinstance(item, Binary)
    return what | {"one": str(item.one), "zero": str(item.zero)}
