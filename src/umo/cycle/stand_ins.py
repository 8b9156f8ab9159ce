"""What stands in the place of a driver that is away, or that was found and is tried (`absence.py`)."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic_ns
from typing import Any, NoReturn

from umo.drivers.contract import Driver
from umo.errors import ChannelsFailed, DeviceTimeout, text_of


class NotCalled(DeviceTimeout):
    """The driver is away: the call was not made."""


class Away:
    """Stands in the place of a driver that is away: every call fails at once."""

    def __init__(self, refusal: Callable[[], NotCalled]) -> None:
        self._refusal = refusal

    def _refuse(self, *_: object) -> NoReturn:
        raise self._refusal()

    read = write = read_many = write_many = initialize = reset = finalize = _refuse


class Tried:
    """Stands in the place of a driver that was found: the first call that succeeds is told, and the ns that each call
    for one object takes. Those of blocks are measured with the period's transfers. `now` is the clock in s by which a
    call has taken too long."""

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
