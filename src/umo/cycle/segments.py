"""The calls of drivers outside of a period: drivers are opened and closed, and their objects are initialised, reset and
finalised. A heartbeat precedes each call, because the call may wait."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import inf
from time import sleep
from typing import Any, Literal, TypeVar

from umo.cycle.journal import ErrorKind, Kind
from umo.cycle.transfer import Transfer
from umo.drivers.contract import Driver
from umo.drivers.off_cycle import OffCycle
from umo.drivers.optional import arm_watchdog, report_of
from umo.errors import FAILURES, DriverError, Failure, cause_of_failure, text_of
from umo.wiring.wired import Wired

SETTLE = 0.25
"""The time in s that a device gets to carry out pending requests, at least."""
MAX_SETTLE = 1.0
"""The largest time in s that a device with a long timeout gets for this."""
UNCONTROLLED_TIMEOUT = 3.0
"""Timeout in s of a driver's call while nothing is controlled: when connecting, and for the guardian's resets. A device
that serves one connection at a time may need a long time to release the previous connection."""
WAIT_SLICE = 0.05
"""The time in s between two heartbeats while waiting."""
LATE_TIME = 0.5
"""The time in s for which a driver that has timed out is served last; twice the driver's timeout is added to it."""
T = TypeVar("T")
_JOURNAL_KINDS = {"initialize": Kind.INITIALIZE, "reset": Kind.RESET}


class DriverSegments:
    """The paper's segments except read and write, and the calls of whole drivers."""

    def __init__(self, transfer: Transfer, wired: Wired) -> None:
        self._transfer = transfer
        self.drivers = wired.drivers
        self.on_call: Callable[[], object] = lambda: None
        """The function that is called before each of these calls, as a heartbeat."""
        for driver in self.drivers.values():
            if isinstance(driver, OffCycle):
                driver.pause = self._wait_for_worker

    def _wait_for_worker(self, seconds: float) -> None:
        self.on_call()
        sleep(seconds)

    # Whole drivers -------------------------------------------------------------------------------------

    def open(self, name: str) -> None:
        self._whole(name, "opened", self.drivers[name].open)

    def close(self, name: str) -> None:
        self._whole(name, "closed", self.drivers[name].close)

    def watchdog(self, name: str, seconds: float) -> None:
        self._whole(name, "armed with its watchdog", lambda: arm_watchdog(self.drivers[name], seconds))

    def report(self, name: str) -> dict[str, Any]:
        return self._whole(name, "asked for its report", lambda: report_of(self.drivers[name]))

    def _whole(self, name: str, what: str, call: Callable[[], T]) -> T:
        self.on_call()
        try:
            return call()
        except DriverError as error:
            raise DriverError(f"driver {self._words(name)}: {error}", error.failures) from error
        except FAILURES as error:
            raise DriverError(f"driver {self._words(name)} could not be {what}: {text_of(error)}") from error

    def _words(self, name: str) -> str:
        return self._transfer.words_of(self.drivers[name])

    def failed_whole(self, name: str, what: str, error: BaseException) -> Failure:
        """Record that a call for a whole driver has failed."""
        cause = error.__cause__ or error  # the driver is named already
        return Failure(f"driver {name}", "-", f"{what}: {text_of(cause)}", self._words(name))

    # Single objects ------------------------------------------------------------------------------------

    def initialize(self, slot: int) -> Failure | None:
        return self._segment(slot, "initialize", self._transfer.defaults[slot])

    def finalize(self, slot: int) -> Failure | None:
        return self._segment(slot, "finalize")

    def bring_to_default(
        self,
        slots: Iterable[int],
        segment: Literal["initialize", "reset"] = "reset",
        begin: Callable[[int], object] = lambda slot: None,
        patient: bool = True,
    ) -> Iterator[tuple[int, Failure | None]]:
        """Reset (or initialise) each slot in turn. A failure never prevents the calls for the other slots. The slots of
        a driver that does not answer in time are reset last, so that they do not delay other slots. If `patient` is
        False, these slots are left out: the next attempt then opens one more connection, not one for each slot. `begin`
        is called with each slot."""
        wires, defaults = self._transfer.wires, self._transfer.defaults
        if not patient:
            self._transfer.late.clear()
        waiting: list[int] = []
        for slot in slots:
            if self._is_late(wires[slot].driver):
                waiting.append(slot)
            else:
                begin(slot)
                yield slot, self._segment(slot, segment, defaults[slot])
        for slot in waiting if patient else ():
            begin(slot)
            yield slot, self._segment(slot, segment, defaults[slot])

    def _is_late(self, driver: Driver[Any]) -> bool:
        return self._transfer.now() - self._transfer.late.get(id(driver), -inf) < LATE_TIME + 2 * driver.timeout

    def _segment(self, slot: int, segment: str, *default: int | None) -> Failure | None:
        """Carry out one of the paper's segments for an object, and return its failure."""
        self.on_call()
        transfer = self._transfer
        wire = transfer.wires[slot]
        began = transfer.now()
        try:
            getattr(transfer.callees.of[slot], segment)(wire.channel, *default)
        except BaseException as error:  # whatever a driver raises, the others are still to be brought to their defaults
            took = transfer.now() - began
            transfer.mark(wire.driver, error, True, took)
            kind = ErrorKind.TIMEOUT if took >= wire.driver.timeout else ErrorKind.of(error)
            transfer.note(slot, Kind.FAILED_RESET, kind, default[0] if default else None)
            return transfer.failure(slot, cause_of_failure(error))
        transfer.late.pop(id(wire.driver), None)
        if segment in _JOURNAL_KINDS:
            transfer.moved(slot, transfer.raws[slot] if default[0] is None else default[0], _JOURNAL_KINDS[segment])
        return None


def settling(wired: Wired) -> float:
    """Return the time in s that a device may take to carry out requests that were still in progress when it began to
    answer again."""
    return max([SETTLE, *(min(wired.drivers[name].timeout, MAX_SETTLE) for name in wired.hardware)])


def wait_for(seconds: float, pause: Callable[[float], object], on_call: Callable[[], object]) -> None:
    """Wait in slices, each with a heartbeat."""
    while seconds > 0:
        on_call()
        pause(min(WAIT_SLICE, seconds))
        seconds -= WAIT_SLICE
