"""The distribution of the options of a run (`--seed 7`) to the functions and drivers that take them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from umo.drivers import Driver, registry
from umo.errors import OptionError, WiringError
from umo.signature import parameters_of, signature_of
from umo.text import did_you_mean
from umo.wiring.off_cycle_table import OWN
from umo.wiring.parameters import arguments_for, flag
from umo.wiring.source import read

RESERVED = ("type", *OWN)
"""Keys of a driver's table that are not options of the driver."""
REALTIME = "realtime"
"""The option of a run by which the timer keeps the pace of the wall clock. It belongs to the wiring and not to a
driver."""
FAULT, FAULT_SEED = "fault", "fault_seed"
"""The options of a run for faults to inject, in addition to those of the wiring, and for the seed of their random
numbers. They belong to the wiring and not to a driver."""
WIRING_OPTIONS = (REALTIME, FAULT, FAULT_SEED)
WiringText = Path | str | Mapping[str, Any]
"""A wiring as a TOML file or as its contents."""
SIMULATED = {"wire": {"timer": {"driver": "simulated"}}}
"""The drivers of a machine without a wiring."""


class OptionShares(NamedTuple):
    """The options of a run, divided among the functions and drivers that take them."""

    machine: dict[str, Any]
    application: dict[str, Any]
    wiring: dict[str, Any]


def distribute_options(
    given: Mapping[str, Any],
    *,
    machine: Callable[..., Any] | None = None,
    application: Callable[..., Any] | None = None,
    wiring: WiringText | None = None,
) -> OptionShares:
    """Pass each option to all functions and drivers that take an option of that name: the function that makes the
    machine, the application (its first parameter is the machine), the drivers of the wiring (`{}`: no drivers). Raises
    OptionError if an option is unknown, if a required one is missing, or if its parameter does not accept the value
    (`arguments_for`)."""
    takers = {"machine": (machine, 0), "application": (application, 1)}
    if given:
        drivers, complete = _driver_options(SIMULATED if wiring is None else wiring)
    else:  # whoever connects reads the wiring anyway
        drivers, complete = {}, True
    of_wiring = {*drivers, *(() if isinstance(wiring, Mapping) and not wiring else WIRING_OPTIONS)}
    known = of_wiring.union(*(parameters_of(each, skip) for each, skip in takers.values() if each is not None))
    for name in given:
        if name not in known and complete:  # else it may be of a driver that the wiring misspells: `check` says so
            flags = ", ".join(map(flag, sorted(known))) or "none"
            raise OptionError(f"{flag(name)}: unknown option{did_you_mean(name, known)}; there are: {flags}")
    shares = {
        taker: {} if function is None else arguments_for(function, taker, given, skip)
        for taker, (function, skip) in takers.items()
    }
    return OptionShares(**shares, wiring={name: value for name, value in given.items() if name in of_wiring})


def driver_options(wiring: WiringText | None) -> dict[str, tuple[str, inspect.Parameter]]:
    """Return all options of all drivers in use by name: the driver's type and the parameter. Mistakes are reported by
    `check`."""
    return {} if wiring is None else _driver_options(wiring)[0]


def _driver_options(wiring: WiringText) -> tuple[dict[str, tuple[str, inspect.Parameter]], bool]:
    """Return the options of the drivers, and True if these are the options of all drivers, that is, if the wiring could
    be read and every driver was found."""
    source = read(wiring)
    complete = not source.mistakes
    types = {name: table.get("type", name) for name, table in source.drivers.items()}
    named = {entry.driver: None for entry in source.entries.values() if entry.driver not in types}
    taken: dict[str, tuple[str, inspect.Parameter]] = {}
    for name in dict.fromkeys([*types.values(), *(registry.table_of(each)["type"] for each in named)]):
        try:
            parameters = signature_of(registry.find(name))
        except WiringError:
            complete = False
            continue
        except TypeError:  # a driver that is made already
            continue
        new = {key: (str(name), parameter) for key, parameter in parameters.items() if key not in taken}
        taken |= {key: found for key, found in new.items() if key not in WIRING_OPTIONS}
    return taken, complete


def maker_of(wiring: WiringText | None, name: str) -> partial[Driver[Any]]:
    """Return a function that makes drivers like the one of this name, in a wiring without mistakes (`check`). The
    keywords of the function change options."""
    from umo.wiring.schema import arguments_of

    source = read({} if wiring is None else wiring)
    table = {"type": name} | source.drivers.get(name, {})
    cls = registry.find(table["type"])
    given = {key: value for key, value in table.items() if key not in RESERVED}
    return partial(cls, **arguments_of(cls, signature_of(cls), given, source.file))
