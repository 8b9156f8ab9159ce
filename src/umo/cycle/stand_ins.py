"""The stand-ins for a driver that is away, or that was found and is being tried (`drivers_away.py`)."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic_ns
from typing import Any, NoReturn

from umo.drivers.contract import Driver
from umo.errors import ChannelsFailed, DeviceTimeout, text_of


class NotCalled(DeviceTimeout):
    """The error of a call that was not made, because the driver is away."""


class NobodyAway:
    """The object in use if no driver is away, or if absences are not checked: every call is made, and waits for the
    device. `DriversAway` replaces this object while a machine runs."""

    tried: Callable[[str, int], object] = staticmethod(lambda name, ns: None)
    """The function that is called with the name of a driver and the time in ns that a look or an attempt has taken."""

    def is_away(self, driver: Driver[Any]) -> bool:
        """Return True if calls of this driver are refused."""
        return False

    def is_unknown(self, driver: Driver[Any]) -> bool:
        """Return True if calls of this driver are refused, and it is not known yet whether its device answers."""
        return False

    def failed(self, driver: Driver[Any], error: BaseException, timed_out: bool, write: bool) -> None:
        """Record the error of a call that failed for the whole driver, or that timed out."""

    def end(self) -> None:
        """Call every driver again, even if it does not answer, because the machine stops."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Stop looking for devices. `instead` is called in place of a look."""


class Away:
    """The stand-in for a driver that is away: every call fails immediately."""

    def __init__(self, refusal: Callable[[], NotCalled]) -> None:
        self._refusal = refusal

    def _refuse(self, *_: object) -> NoReturn:
        raise self._refusal()

    read = write = read_many = write_many = initialize = reset = finalize = _refuse


class Tried:
    """The stand-in for a driver that was found. It reports the first call that succeeds, and the time in ns of each
    call for one object. Calls for blocks are measured with the period's transfers. `now` returns the time in s, by
    which a call is judged to have taken too long."""

    def __init__(
        self,
        driver: Driver[Any],
        succeeded: Callable[[], object],
        took: Callable[[int], object],
        now: Callable[[], float],
    ) -> None:
        for segment in ("read", "write", "initialize", "reset", "finalize"):
            setattr(self, segment, _watched(driver, getattr(driver, segment), succeeded, took, now))
        for segment in ("read_many", "write_many"):
            setattr(self, segment, _watched(driver, getattr(driver, segment), succeeded, lambda ns: None, now))


def _watched(
    driver: Driver[Any],
    call: Callable[..., Any],
    succeeded: Callable[[], object],
    took: Callable[[int], object],
    now: Callable[[], float],
) -> Callable[..., Any]:
    def tried(*arguments: Any) -> Any:
        began, then = monotonic_ns(), now()
        try:
            result = call(*arguments)
        except ChannelsFailed:
            succeeded()  # the device answers
            raise
        except (Exception, SystemExit) as error:
            if now() - then >= driver.timeout and not isinstance(error, TimeoutError):
                raise DeviceTimeout(text_of(error)) from None
            raise
        finally:
            took(monotonic_ns() - began)
        succeeded()
        return result

    return tried
