"""Optional abilities of a driver beyond the functions of the contract: one class for each, which the driver names as a
base.

    class Modbus(Driver[ModbusChannel], Looks, HasWatchdog, Inspects): ...

Next to each class is the function that umo calls, which also handles drivers without this ability. A driver that
defines one of these functions without naming its class is refused when it is defined.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from umo.errors import DeclarationError, DriverError
from umo.text import in_brackets, shown_place
from umo.user_code import definition


class Looks(ABC):
    """A driver that can find out without waiting whether its device answers again. For any other driver a call is
    tried, which may take its timeout."""

    @property
    def answers_for_device(self) -> bool:
        """True if the result True of a look means that the device itself has answered, and not only that a call may be
        tried."""
        return True

    @abstractmethod
    def look(self) -> bool | None:
        """Return whether the device answers again. None means that this is not known yet: the function is called again
        in the next period, and after `timeout` (or 0.5 s if that is longer) None counts as False. False, or an OSError,
        means that the device does not answer now. Called while the driver is away, after a call that timed out or a
        failed call of the whole driver. Other calls may come in between."""


def look_for(driver: object) -> bool | None:
    """Return the result of the driver's look: True, False or None. For a driver without a look return True, which means
    "try a transfer"."""
    if not isinstance(driver, Looks):
        return True
    found = driver.look()
    return None if found is None else bool(found)


def answers_for_device(driver: object) -> bool:
    """Return True if the result True of a look means that the device itself has answered."""
    return isinstance(driver, Looks) and driver.answers_for_device


class KnowsAges(ABC):
    """A driver whose circuit receives values from elsewhere instead of reading them on request, so that they have ages.
    This matters only for a driver off the cycle."""

    @abstractmethod
    def ages(self, channels: Sequence[Any]) -> Sequence[float] | None:
        """Return the age in s of each value that the last `read_many` of these channels has given. None means that the
        values are as old as the transfer."""


def ages_of(driver: object, channels: Sequence[Any]) -> Sequence[float] | None:
    """Return the ages in s of the values of the last reading; None if they are as old as the transfer."""
    return driver.ages(channels) if isinstance(driver, KnowsAges) else None


class HasShortForm(ABC):
    """A driver for which lines of `[wire]` can contain `driver = "TYPE:TEXT"` instead of a table of options."""

    @classmethod
    @abstractmethod
    def table(cls, text: str) -> Mapping[str, Any] | None:
        """Return the options for which the text stands, as in a table `[drivers.NAME]`; None if the text is not such a
        form."""


def short_form_of(driver: type, text: str) -> Mapping[str, Any] | None:
    """Return the options for which the text stands; None if the driver's class has no such form."""
    return driver.table(text) if issubclass(driver, HasShortForm) else None


class PhysicalScale(NamedTuple):
    """The scale of a channel, as the circuit itself reports it: raw * resolution + zero_offset."""

    resolution: float
    zero_offset: float
    units: str
    """The unit in the spelling of pint, such as "mV" or "degC"."""


class KnowsScale(ABC):
    """A driver whose circuit itself reports the value of a raw integer. The wiring is checked against this if the
    object has units of the same dimension."""

    @abstractmethod
    def physical_scale(self, channel: Any) -> PhysicalScale | None:
        """Return the scale of a channel, or None if it is unknown or the device is not there. May be called before
        `open`."""


def scale_of(driver: object, channel: Any) -> PhysicalScale | None:
    """Return the scale that the circuit reports for a channel; None if unknown."""
    return driver.physical_scale(channel) if isinstance(driver, KnowsScale) else None


class NoWatchdog(DriverError, NotImplementedError):
    """The circuit has no watchdog, or the options of the driver do not name it."""


class HasWatchdog(ABC):
    """A driver whose circuit has a watchdog."""

    @abstractmethod
    def watchdog(self, seconds: float) -> None:
        """Arm the watchdog: after this time without a request the circuit sets its outputs to safe levels. Called when
        the driver is open, and again when its device is back after being away. It is not called after the watchdog has
        expired; then the circuit determines whether the watchdog is armed. Requests that a driver makes outside of its
        calls must not keep the watchdog from expiring."""

    def check_watchdog(self, seconds: float) -> None:  # noqa: B027  most take any time
        """Check a time. Raises WiringError or DriverError if `watchdog` does not accept it. Called before `open`. This
        function sends nothing."""


def arm_watchdog(driver: object, seconds: float) -> None:
    """Arm the watchdog of the driver's circuit. Raises NoWatchdog if the circuit has none."""
    if not isinstance(driver, HasWatchdog):
        raise NoWatchdog(f"{type(driver).__name__} has no watchdog of its own")
    driver.watchdog(seconds)


class Reports(ABC):
    """A driver that reports results of its circuit or plant."""

    @abstractmethod
    def report(self) -> Mapping[str, Any]:
        """Return the results so far, as plain data by name. Called at the end of a run before `close`, and by `umo
        device plant --report` ten times a second."""


def report_of(driver: object) -> dict[str, Any]:
    """Return the results of a driver so far; empty if it reports none."""
    return dict(driver.report()) if isinstance(driver, Reports) else {}


class Inspects(ABC):
    """A driver that shows the content of its circuit for commissioning, in `umo device get`. The content helps to find
    a wrong option, such as the order of bytes."""

    @abstractmethod
    def inspect(self, channel: Any) -> str:
        """Return the content of the circuit for an input channel, read now, in one line. Empty if there is nothing to
        show."""


def inspection_of(driver: object, channel: Any) -> str:
    """Return the content of the circuit for an input channel, read now; empty if the driver cannot show it."""
    return driver.inspect(channel) if isinstance(driver, Inspects) else ""


class WaitEnded(Exception):
    """The wait of a timer's reading for its tick was ended (`EndsWait.stop_waiting`)."""


class EndsWait(ABC):
    """A timer whose wait for a tick can be ended. Any other timer ends its call within its timeout."""

    @abstractmethod
    def stop_waiting(self) -> None:
        """End the wait for a tick immediately with WaitEnded, or the next wait if there is none now, because a stop was
        requested. Called in a signal handler or in another thread; it must not raise an error."""


class TransferInC(NamedTuple):
    """A function in C that moves the raw integers of some channels (`umo_transfer` of umo_driver.h)."""

    function: int
    """The address of the function."""
    context: int
    """The address that is passed to the function."""
    keep: Any
    """The object that keeps the function and its context alive."""


class MovesInC(ABC):
    """A driver whose transfers can be made in C, in addition to its functions in Python. Compiled machines call the
    Python functions only if the function in C requests it (umo_driver.h)."""

    @abstractmethod
    def in_c(self, channels: Sequence[Any], write: bool) -> TransferInC | str:
        """Return the transfer in C that replaces `read_many` or `write_many` (for a timer, `read`) for these channels.
        The transfer is valid until the driver is closed. If there is none, return the reason as text. Called when the
        channels are initialised, and again after the driver was away."""


def transfer_in_c(driver: object, channels: Sequence[Any], write: bool) -> TransferInC | str:
    """Return the driver's transfer in C, or the reason as text if there is none. If a subclass changes functions in
    Python but not the transfer in C, the transfer in C is not used."""
    if not isinstance(driver, MovesInC):
        return "it has no transfers in C"
    for place in (vars(driver), *map(vars, type(driver).__mro__)):
        if "in_c" in place:
            return driver.in_c(channels, write)
        if not place.keys().isdisjoint(IN_PYTHON):
            return f"{type(driver).__name__} has functions of its own in Python"
    return "it has no transfers in C"


IN_PYTHON = frozenset({"read", "write", "read_many", "write_many"})
"""The functions of a driver in Python that its transfers in C replace."""
OPTIONAL: tuple[type, ...] = (
    Looks,
    KnowsAges,
    HasShortForm,
    KnowsScale,
    HasWatchdog,
    Reports,
    Inspects,
    EndsWait,
    MovesInC,
)


def names_of(kind: type) -> list[str]:
    """Return the names of the functions and attributes that a class of this module adds to a driver."""
    return [name for name in vars(kind) if not name.startswith("_")]


def check_named(cls: type) -> None:
    """Check a driver class. Raises DeclarationError if it has a function of one of these classes but does not name the
    class, because the function would never be called."""
    for kind in OPTIONAL:
        for name in names_of(kind):
            function = getattr(cls, name, None)
            if callable(function) and not issubclass(cls, kind):
                bases = ", ".join(each.__name__ for each in cls.__bases__)
                raise DeclarationError(
                    f"{cls.__name__}.{name} would never be called: it is a function of {kind.__name__}; write"
                    f" `class {cls.__name__}({bases}, {kind.__name__})` ({kind.__name__} is in umo.drivers), or give it"
                    f" another name{_place(function)}"
                )


def _place(function: Any) -> str:
    return in_brackets(shown_place(definition(getattr(function, "__func__", function))))
