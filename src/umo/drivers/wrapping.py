"""Objects that wrap a driver and are used in its place, for injected faults and for drivers off the cycle."""

from __future__ import annotations

from abc import ABCMeta
from operator import attrgetter
from typing import Any, ClassVar, Self

from umo.drivers.contract import Driver
from umo.drivers.optional import OPTIONAL, MovesInC, names_of


def of_driver(name: str) -> Any:
    """Return the attribute with this name of the wrapped driver."""
    return property(attrgetter(f"driver.{name}"), lambda wrapper, value: setattr(wrapper.driver, name, value))


class Wrapper(Driver[Any]):
    """A driver that wraps another driver. It is an instance of the classes of `optional.py` that the wrapped driver
    has, and of those that it names itself. Calls that the wrapper does not handle go to the wrapped driver."""

    withheld: ClassVar[tuple[type, ...]] = (MovesInC,)
    """Classes from which a wrapper never derives, because the driver's transfers in C would bypass the wrapper."""

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Define functions for all optional functions of a wrapped driver."""

    def __new__(cls, driver: Driver[Any], *_: Any, **keywords: Any) -> Self:
        had = (kind for kind in OPTIONAL if isinstance(driver, kind) and kind not in cls.withheld)
        kinds = [kind for kind in had if not issubclass(cls, kind)]
        passed = {name: of_driver(name) for kind in kinds for name in names_of(kind) if not hasattr(cls, name)}
        made: Any = ABCMeta(cls.__name__, (cls, *kinds), {"__module__": cls.__module__, **passed})
        found: Self = super().__new__(made)
        return found

    def __init__(self, driver: Driver[Any]) -> None:
        self.driver = driver

    timeout = of_driver("timeout")
    period = of_driver("period")
    realtime = of_driver("realtime")
    simulates_time = of_driver("simulates_time")
    only_off_cycle = of_driver("only_off_cycle")
    forms = of_driver("forms")
    channel = of_driver("channel")
    devices = of_driver("devices")


def bare(driver: Driver[Any]) -> Driver[Any]:
    """Return the driver itself, without the objects that wrap it."""
    while isinstance(driver, Wrapper):
        driver = driver.driver
    return driver
