"""Bringing a machine to its defaults from outside, after its control process is dead.

Each attempt is made by a child process of its own: the drivers are opened afresh in it, and if a call never
returns, or crashes, the guardian ends that child and goes on with the rest.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic

from umo.cycle.stop_order import stop_sequence
from umo.drivers.contract import Driver
from umo.objects import BinaryActuator, Compound, DigitalActuator
from umo.objects.scaling import to_raw
from umo.text import cause_of
from umo.wiring import Wire, Wired

GRACE = 1.0
"""s that a call of a driver may take beyond twice its timeout."""
PAUSE = 0.2
"""s between two attempts."""


@dataclass
class Attempt:
    """What a child reached, and why it did not reach the rest, by path."""

    reached: set[str] = field(default_factory=set)
    failures: dict[str, str] = field(default_factory=dict)
    stuck: Driver | None = None
    """Whose call did not return."""


class Resetter:
    """Resets the actuators of one machine, in its order of stopping."""

    def __init__(self, machine: Compound, wired: Wired) -> None:
        by_item = {id(wire.item): wire for wire in wired.wires}
        self._wires = [by_item[id(item)] for item in stop_sequence(machine)]
        self._names = {id(driver): name for name, driver in wired.drivers.items()}
        self.limit = call_limit(wired)
        self.paths = [wire.item.path for wire in self._wires]

    def reset(
        self,
        paths: Iterable[str],
        lasting: float,
        *,
        once_dead: Callable[[], object] = lambda: None,
        said: Callable[[str], object] = lambda text: None,
    ) -> dict[str, str]:
        """Bring these actuators to their defaults, trying for `lasting` s; what was not reached, with the cause.

        `once_dead` returns when the old process is gone for certain: then everything is reset a second time, since
        a request of the dead process may still have been under way.
        """
        left = dict.fromkeys(paths, "")
        until = monotonic() + lasting
        told = False
        stuck: set[int] = set()
        while True:
            wires = [wire for wire in self._wires if wire.item.path in left]
            wires.sort(key=lambda wire: id(wire.driver) in stuck)  # the others first
            attempt = self._attempt(wires, once_dead)
            stuck.add(id(attempt.stuck))
            left = {path: attempt.failures.get(path, "no answer") for path in left if path not in attempt.reached}
            if not left or monotonic() >= until:
                return left
            if not told:
                told = True
                said(f"not reached yet, trying for {lasting:g} s: {summary(left)}")
            select.select([], [], [], PAUSE)

    def _attempt(self, wires: list[Wire], once_dead: Callable[[], object]) -> Attempt:
        told, tell = os.pipe()
        heard, hear = os.pipe()
        child = os.fork()
        if child == 0:
            _in_child(wires, tell, heard, (told, hear))
        os.close(tell)
        os.close(heard)
        try:
            once_dead()
            with suppress(OSError):
                os.write(hear, b"!")
            return self._listen(told, child, wires)
        finally:
            os.close(told)
            os.close(hear)

    def _listen(self, told: int, child: int, wires: list[Wire]) -> Attempt:
        """Follow the child until it ends; end it when one of its calls does not return."""
        attempt, text = Attempt(), b""
        stuck = ""
        while select.select([told], [], [], self.limit)[0]:
            data = os.read(told, 65536)
            if not data:
                break
            text += data
        else:
            stuck = f"a call did not return within {self.limit:g} s"
            os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
        *lines, _ = text.split(b"\n")
        for path, cause in map(json.loads, lines):
            if cause is None:
                attempt.reached.add(path)
            else:
                attempt.reached.discard(path)
                attempt.failures[path] = cause
        if os.WIFSIGNALED(status) and not stuck:
            stuck = f"the driver crashed ({signal.Signals(os.WTERMSIG(status)).name})"
        if stuck:
            silent = [w for w in wires if w.item.path not in attempt.reached and w.item.path not in attempt.failures]
            attempt.stuck = silent[0].driver if silent else None
            attempt.failures.update((wire.item.path, stuck) for wire in silent)
        return attempt


def call_limit(wired: Wired) -> float:
    """How long a call of any of the drivers may take, in s, before it counts as one that never returns."""
    return GRACE + 2 * max((driver.timeout for driver in wired.drivers.values()), default=0.0)


def summary(left: dict[str, str]) -> str:
    """`z.motor, theta.step: connection refused`, a cause after the objects that share it."""
    causes: dict[str, list[str]] = {}
    for path, cause in left.items():
        causes.setdefault(cause, []).append(path)
    return "; ".join(f"{', '.join(paths)}: {cause}" for cause, paths in causes.items())


# In the child ------------------------------------------------------------------------------------------


def _in_child(wires: list[Wire], tell: int, heard: int, others: tuple[int, int]) -> None:
    """Never returns."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        for file in others:
            os.close(file)
        _bring_to_defaults(wires, tell, lambda: os.read(heard, 1))
        os._exit(0)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        os._exit(1)


def _bring_to_defaults(wires: list[Wire], tell: int, wait: Callable[[], object]) -> None:
    """Open, initialise at the defaults, and once the old process is dead reset again; then give all back."""
    opened: dict[int, Driver] = {}
    failed: dict[int, str] = {}
    prepared = []
    for wire in wires:
        driver = wire.driver
        if id(driver) not in opened and id(driver) not in failed:
            try:
                opened[id(driver)] = driver
                driver.open()
            except Exception as error:
                failed[id(driver)] = cause_of(error)
        if id(driver) in failed:
            _say(tell, wire, failed[id(driver)])
        elif _try(tell, wire, "initialize"):
            prepared.append(wire)
    wait()
    for wire in prepared:
        _try(tell, wire, "reset")
    for wire in reversed(prepared):
        with suppress(Exception):
            wire.driver.finalize(wire.channel)
    for driver in opened.values():
        with suppress(Exception):
            driver.close()


def _try(tell: int, wire: Wire, segment: str) -> bool:
    try:
        getattr(wire.driver, segment)(wire.channel, default_raw(wire))
    except Exception as error:
        _say(tell, wire, cause_of(error))
        return False
    _say(tell, wire, None)
    return True


def default_raw(wire: Wire) -> int:
    """The raw integer of an actuator's default on its channel."""
    item = wire.item
    assert isinstance(item, BinaryActuator | DigitalActuator)
    return to_raw(item._default_value(), *wire.scale)


def _say(tell: int, wire: Wire, cause: str | None) -> None:
    os.write(tell, json.dumps([wire.item.path, cause]).encode() + b"\n")
