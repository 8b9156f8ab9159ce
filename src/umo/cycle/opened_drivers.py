"""The drivers of a connection. They are opened and their objects initialised at their defaults; at the end the objects
are reset and finalised, and the drivers are closed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from umo.cycle.attempts import Attempts
from umo.cycle.drivers_away import DriversAway, in_order
from umo.cycle.image import raise_failures
from umo.cycle.machine import ConnectedMachine
from umo.cycle.segments import UNCONTROLLED_TIMEOUT, settling
from umo.cycle.to_defaults import ToDefault
from umo.errors import Failure, text_of
from umo.objects import Sensor, atoms
from umo.wiring.wired import Wired


class OpenedDrivers:
    """The drivers of one connection. `wait`: the function that waits a time in s before another reset."""

    def __init__(self, machine: ConnectedMachine, wired: Wired, wait: Callable[[float], object]) -> None:
        self._machine, self._image, self._wired, self._wait = machine, machine.image, wired, wait
        self._opened: list[str] = []
        self._initialized: list[int] = []  # slots
        self._waiting: set[int] | None = None
        """The slots that are still to be reset; None if no reset has begun."""

    def open(self) -> None:
        """Open the drivers, initialise every object at its default and arm the watchdogs. Raises DriverError for the
        first failure."""
        segments = self._image.segments
        for name in self._wired.drivers:
            self._opened.append(name)
            segments.open(name)
        with self._patient():
            for slot in [self._image.slot_of[id(item)] for item in atoms(self._machine.root)]:
                self._initialized.append(slot)
                failure = self._image.initialize(slot)
                if failure is not None:
                    raise_failures("could not be initialised", [failure])
            for name, limit in self._wired.watchdogs.items():
                segments.watchdog(name, limit)
        self._contain_absences()

    def _contain_absences(self) -> None:
        """Let no call wait any longer for a device that does not answer."""
        image, machine = self._image, self._machine
        sensors = [slot for slot, item in enumerate(image.items) if isinstance(item, Sensor) and slot != image.timer]
        slots = in_order([*machine.claims.order, *sensors], [wire.driver for wire in image.wires])
        image.transfer.callees.away = DriversAway(
            image.transfer,
            image.segments,
            image.clock,
            machine.events,
            image.initialize_again,
            image.path_if_default_kept,
            slots,
            self._wired.watchdogs,
        )

    @contextmanager
    def _patient(self) -> Iterator[None]:
        """Return a context with longer timeouts of the hardware. A device that serves one connection at a time may need
        a long time to release the last connection, and nothing runs yet that would have to wait. The context is not for
        `open`, because there a driver may set its timeout in the circuit for the whole run."""
        drivers = [self._wired.drivers[name] for name in self._wired.hardware]
        timeouts = [driver.timeout for driver in drivers]
        for driver in drivers:
            driver.timeout = max(driver.timeout, UNCONTROLLED_TIMEOUT)
        try:
            yield
        finally:
            for driver, timeout in zip(drivers, timeouts, strict=True):
                driver.timeout = timeout

    def reset(self) -> tuple[list[Failure], list[Failure]]:
        """Reset all actuators. Return the failures: the actuators that were not reached, and those that only a later
        attempt has reached.

        A request that failed may still be carried out later and undo a reset. So after a failure everything is reset a
        second time. Further attempts follow as long as an attempt reaches another actuator, because a device may begin
        to answer in the middle of an attempt.
        """
        slots = self._stop_sequence()
        first = left = self._reset_once(slots)
        if not self._image.transfer.unsure:
            return first, []
        attempts, progress = Attempts(), True
        attempts.add(self._reached(slots, first))
        while progress:
            self._waiting = set(slots)
            self._wait(settling(self._wired))
            left = self._reset_once(slots)
            progress = attempts.add(self._reached(slots, left)) and bool(left)
        still = {failure.path for failure in left}
        late = [failure for failure in first if failure.path not in still]
        return left, [each._replace(cause=f"reset at a later attempt: {each.cause}") for each in late]

    def _reached(self, slots: list[int], failures: list[Failure]) -> set[str]:
        """Return the paths of these actuators without those that failed."""
        return {self._image.items[slot].path for slot in slots} - {failure.path for failure in failures}

    def _reset_once(self, slots: list[int]) -> list[Failure]:
        failures = []
        self._waiting = set(slots)
        for slot, failure in self._image.settling(slots, ToDefault.RESET):
            if failure is None:
                self._waiting.discard(slot)
            else:
                failures.append(failure)
        return failures

    def not_reset(self, cause: str) -> list[Failure]:
        """Return the actuators that are still to be reset, as failures with this cause."""
        slots = self._stop_sequence() if self._waiting is None else self._waiting
        return [self._image.transfer.failure(slot, cause) for slot in sorted(slots)]

    def reports(self) -> dict[str, Mapping[str, Any]]:
        """Return the report of each driver. If a report fails, the text of the error takes its place, and the run has
        not failed."""
        found: dict[str, Mapping[str, Any]] = {}
        for name in self._opened:
            try:
                found[name] = self._image.segments.report(name)
            except BaseException as error:  # whatever it is: the machine is left in any case
                found[name] = {"no report": text_of(error.__cause__ or error)}  # the driver is named already
        return found

    def close(self) -> list[Failure]:
        """Finalise every object, then close every driver, each in reverse order. Returns the failures."""
        found = map(self._image.segments.finalize, reversed(self._initialized))
        failed = [failure._replace(cause=f"not finalised: {failure.cause}") for failure in found if failure is not None]
        return failed + self._of_each(reversed(self._opened), self._image.segments.close, "not closed")

    def _of_each(self, names: Iterable[str], call: Callable[[str], None], what: str) -> list[Failure]:
        """Make one call per driver. An error of one call, of any class, does not prevent the other calls."""
        failures = []
        for name in names:
            try:
                call(name)
            except BaseException as error:
                failures.append(self._image.segments.failed_whole(name, what, error))
        return failures

    def _stop_sequence(self) -> list[int]:
        """Return the slots of the initialised actuators, in stop order."""
        initialized = set(self._initialized)
        return [slot for slot in self._machine.claims.order if slot in initialized]
