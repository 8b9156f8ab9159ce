"""Connecting a machine to its hardware, and leaving it safely (design.md section 3, rule 9)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, TypeVar

from umo.cycle.clock import Clock, WallClock
from umo.cycle.forms import make_image
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine
from umo.cycle.signals import StopFlag
from umo.cycle.stop_order import stop_sequence
from umo.drivers.contract import Driver
from umo.errors import DeclarationError, DriverError, Failure, StopError
from umo.objects import Compound
from umo.wiring import Wired, resolve

C = TypeVar("C", bound=Compound)


class connect(Generic[C]):
    """Connect a machine: `with connect(machine, "wiring/simulated.toml") as m:`.

    `wiring` is a TOML file, its contents as a dict, or None: everything on simulated channels at 1 ms.
    `options` go to every driver that takes one of that name (`seed=1`).

    Entering checks the wiring (WiringError lists every fault), opens the drivers, initialises every object at
    its default, arms the circuits' watchdogs, then takes one sample. Leaving resets every actuator, in the
    order of the root's `stop_order`, then finalises in reverse order; one failure never stops the rest, and
    StopError lists by path what could not be brought to its default. After a failed entry the same is
    done to everything that was initialised.
    """

    def __init__(self, root: C, wiring: Path | str | Mapping[str, Any] | None = None, **options: Any) -> None:
        if root._parent is not None:
            raise DeclarationError(f"{root.path} is a part of a machine; connect the whole machine")
        self.root = root
        self._wiring = wiring
        self._options = options
        self.stop = StopFlag()
        self.on_step: Callable[[], None] = lambda: None
        """Called before every call of a driver while connecting and leaving: a sign of life."""
        self.wired: Wired
        self.machine: ConnectedMachine
        self._restore: list[Callable[[], object]] = []
        self._opened: list[tuple[str, Driver]] = []
        self._initialized: list[int] = []  # slots

    @property
    def image(self) -> Image:
        """The process image."""
        return self.machine.image

    def driver(self, name: str) -> Driver:
        """The open driver of that name in the wiring."""
        return self.wired.drivers[name]

    def __enter__(self) -> C:
        if self.root.connected:
            raise DeclarationError(f"{type(self.root).__name__} is connected already")
        self._opened, self._initialized = [], []
        self.wired = resolve(self.root, self._wiring, self._options)
        self._restore = []
        self.stop.install()
        try:
            for wire in self.wired.wires:
                self._restore.append(wire.apply().apply)  # one by one: the next may fail
            for parameter in self.wired.parameters:
                self._restore.append(parameter.apply().apply)
            clock = WallClock() if self.wired.period is None else Clock(self.wired.period)
            image = make_image(self.wired.wires, clock, self.wired.timer)
            self.machine = ConnectedMachine(self.root, image, self.stop)
        except BaseException:
            self._give_back()
            raise
        try:
            self._start()
        except BaseException as error:
            self._leave(error)
            raise
        return self.root

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave(error)

    def _start(self) -> None:
        for name, driver in self.wired.drivers.items():
            self.on_step()
            self._opened.append((name, driver))
            _try(name, "opened", driver.open)
        for slot in self._declared_order():
            self.on_step()
            self._initialized.append(slot)
            failures = self.image.try_each([slot], "initialize")
            if failures:
                raise DriverError("could not be initialised", failures)
        for name, limit in self.wired.watchdogs.items():
            _try(name, "given its watchdog", partial(self.wired.drivers[name].watchdog, limit))
        self.machine.sample(self.root)

    def _leave(self, cause: BaseException | None) -> None:
        """Everything back to its default, everything given back; what was not reached is raised at the end."""
        try:
            failures = self._cancel_sequences()
            unreached = self._reset()
            failures += self._finalize() + self._close()
        finally:
            self.machine.disconnect()
            self.image.disconnect()
            self._give_back()
        if unreached:
            raise StopError("not brought to their defaults", [*unreached, *failures]) from cause
        if failures:
            raise DriverError("could not be given back", failures) from cause

    def _give_back(self) -> None:
        """Calibrations, parameters and signal handlers as they were."""
        try:
            for undo in reversed(self._restore):
                undo()
        finally:
            self.stop.restore()

    def _cancel_sequences(self) -> list[Failure]:
        try:
            self.machine.sequences.cancel()
        except BaseException as error:  # whatever it is, the outputs are still to be reset
            first = str(error).partition("\n")[0]
            return [Failure("application", "-", f"{type(error).__name__} while stopping: {first}")]
        return []

    def _reset(self) -> list[Failure]:
        failures = []
        for slot in self._stop_sequence():
            self.on_step()
            failures += self.image.try_each([slot], "reset")
        return failures

    def _finalize(self) -> list[Failure]:
        failures = []
        for slot in reversed(self._initialized):
            self.on_step()
            wire = self.image.wires[slot]
            try:
                wire.driver.finalize(wire.channel)
            except Exception as error:
                failures.append(Failure(wire.item.path, wire.channel.text, f"not finalised: {error}"))
        return failures

    def _close(self) -> list[Failure]:
        failures = []
        for name, driver in reversed(self._opened):
            self.on_step()
            try:
                driver.close()
            except Exception as error:
                failures.append(Failure(f"driver {name}", "-", f"not closed: {error}"))
        return failures

    def _declared_order(self) -> list[int]:
        return [self.image.slot_of[id(item)] for item in self.root.atoms()]

    def _stop_sequence(self) -> list[int]:
        """The slots of the initialised actuators."""
        initialized = set(self._initialized)
        slots = [self.image.slot_of[id(item)] for item in stop_sequence(self.root)]
        return [slot for slot in slots if slot in initialized]


def _try(name: str, what: str, call: Callable[[], None]) -> None:
    try:
        call()
    except DriverError as error:
        raise DriverError(f"driver {name}: {error}", error.failures) from error
    except Exception as error:
        raise DriverError(f"driver {name} could not be {what}: {type(error).__name__}: {error}") from error
