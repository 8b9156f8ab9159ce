"""Subjects that several tests use."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from math import inf
from typing import Any

from conformance.careful import HASTE, Careful
from conformance.device import Device
from conformance.odd import LEVELS
from conformance.plain import Plain, of_bytes, scpi, serving
from umo.drivers import Driver
from umo.drivers.off_cycle import OffCycle
from umo.drivers.simulated import Simulated
from umo.testing.conformance import Input, Output, Subject, TcpTap


@contextmanager
def careful(
    driver: type[Careful] = Careful, watchdog: float = inf, wire: float = 0.0, **changes: Any
) -> Iterator[Subject]:
    """A driver of the device of these tests, behind a tap: every rule can be tried."""
    device = Device(watchdog=watchdog, defaults={0: 5, 1: 0, 16: 0}, wire=wire)
    with device, TcpTap(device.host, device.port) as tap:
        given: dict[str, Any] = {
            "name": driver.__name__,
            "make": lambda: driver(host=tap.host, port=tap.port),
            "direct": lambda: driver(host=device.host, port=device.port),
            "outputs": (Output("out:0", 5, 0, 255), Output("out:1", 0, 0, 255), Output("io:0", 0, -2048, 2047)),
            "inputs": (Input("in:0"), Input("in:8"), Input("in:9")),
            "loopbacks": (("out:0", "in:0"),),
            "refused": ("io:40", "in:40"),
            "levels": device.levels,
            "line": tap,
            "checksum": True,
            "timeout": HASTE,
            "watchdog": 0.2,
            "settle": 0.2,
        }
        yield Subject(**given | changes)


@contextmanager
def without_watchdog(driver: type[Careful]) -> Iterator[Subject]:
    """The device's own watchdog is left alone."""
    with careful(driver) as subject:
        yield replace(subject, watchdog=0.0)


def off_cycle(subject: Subject) -> Subject:
    """The same driver off the cycle: each call of it is a request."""

    def wrapped(make: Callable[[], Driver[Any]]) -> Callable[[], Driver[Any]]:
        return lambda: OffCycle(make(), own_period=0.05, max_age=0.15)

    direct = None if subject.direct is None else wrapped(subject.direct)
    return replace(subject, name=f"{subject.name}, off the cycle", make=wrapped(subject.make), direct=direct)


def simulated() -> Subject:
    """The simulated circuit: one memory for all drivers, as a device has."""
    memory: dict[str, int] = {}

    class Shared(Simulated):
        def __init__(self) -> None:
            super().__init__(history=100)
            self._raws = memory

    Shared.__module__, Shared.__qualname__ = Simulated.__module__, Simulated.__qualname__
    return Subject(
        "simulated",
        make=Shared,
        outputs=(Output("valve", 0, 0, 1), Output("motor", 5, -2047, 2047)),
        inputs=(Input("encoder"), Input("motor")),
        loopbacks=(("motor", "motor"),),
        device="memory",
    )


@contextmanager
def plain(driver: type[Plain], device: Callable[[bytes], bytes], greatest: int, **more: Any) -> Iterator[Subject]:
    """A driver of a device with an output and an input that reads it."""
    with serving(device) as port, TcpTap("127.0.0.1", port) as tap:
        subject = Subject(
            driver.__name__,
            make=lambda: driver(port=tap.port),
            direct=lambda: driver(port=port),
            outputs=(Output("out", 0, 0, greatest),),
            inputs=(Input("in"),),
            loopbacks=(("out", "in"),),
            line=tap,
            timeout=0.1,
        )
        yield replace(subject, **more)


def of_plain(driver: type[Plain]) -> AbstractContextManager[Subject]:
    """The device that fits a driver of `plain`."""
    if driver.__name__ == "Scpi":
        return plain(driver, scpi(), 65535, refused=("unknown",), settle=0.1)
    return plain(driver, of_bytes(2), 65535)


def memory(driver: type[Driver[Any]]) -> AbstractContextManager[Subject]:
    """Channels of 64 bits and of one, in a dict."""
    LEVELS.update(wide=-7, switch=0)
    return nullcontext(Subject(
        "memory", make=driver, outputs=(Output("wide", -7, -(2**63), 2**63 - 1), Output("switch")), settle=0.05,
        levels=lambda text: [LEVELS[text]],
    ))  # fmt: skip
