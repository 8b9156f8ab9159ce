"""The search for a driver's class by name: entry points of the group `umo.drivers`, or `module:Class`.

A driver is imported only if a wiring names it. umo never uses another driver in place of a missing one.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from umo.drivers.contract import Driver
from umo.drivers.optional import short_form_of
from umo.errors import WiringError, text_of
from umo.system.packages import registered
from umo.text import did_you_mean

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "umo.drivers"


@cache
def known() -> dict[str, list[EntryPoint]]:
    """Return the registered drivers by name; no driver is imported. A name with several entry points is ambiguous, so
    it stands for no driver."""
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in registered(GROUP):
        found.setdefault(point.name, {})[point.value] = point
    return {name: list(points.values()) for name, points in found.items()}


def find(name: str) -> type[Driver]:
    """Return the driver class of a registered name or of `module:Class`; raises WiringError otherwise."""
    if ":" in name:
        module, _, attribute = name.partition(":")
    elif name in (points := known()):
        if len(points[name]) > 1:
            both = " and ".join(
                f"{each.dist.name if each.dist else 'a package'} ({each.value})" for each in points[name]
            )
            raise WiringError(f"driver {name!r} is registered by {both}; remove one, or name module:Class")
        module, attribute = points[name][0].module, points[name][0].attr
    else:
        names = ", ".join(points)
        raise WiringError(f"there is no driver {name!r}{did_you_mean(name, points)}; known: {names}, or module:Class")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:  # a module may raise anything
        raise WiringError(f"driver {name!r} cannot be imported: {text_of(error)}") from error
    if not (isinstance(found, type) and issubclass(found, Driver)):
        raise WiringError(f"{name!r} is not a umo driver")
    return found


def table_of(name: str) -> Mapping[str, Any]:
    """Return the table `[drivers.NAME]` of a driver that only lines of `[wire]` name: by a type, or by `TYPE:TEXT` if
    the registered type has such a short form. For any other type `:` means `module:Class`."""
    kind, _, text = name.partition(":")
    if text and kind in known():
        with suppress(WiringError):  # it is told as for any other
            table = short_form_of(find(kind), text)
            if table is not None:
                return {"type": kind, **table}
    return {"type": name}
