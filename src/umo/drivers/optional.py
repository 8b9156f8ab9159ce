"""Optional abilities of a driver beyond the functions of the contract: one class for each, which it names as a base.

    class Modbus(Driver[ModbusChannel], Looks, HasWatchdog, Inspects): ...

Beside each stands the function by which umo asks: it knows what holds for a driver that has no such thing. A driver
that has one of the functions and does not name its class is refused as it is defined.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from umo.errors import DeclarationError, DriverError
from umo.text import in_brackets, shown_place
from umo.user_code import definition


class Looks(ABC):
    """Detects without waiting whether its device answers again. For any other driver a call is tried, which may cost
    its timeout."""

    @property
    def answers_for_device(self) -> bool:
        """True if a look that says True is the device's own answer, and not that the device may be tried."""
        return True

    @abstractmethod
    def look(self) -> bool | None:
        """Return whether the device answers again. None: not known yet, called again in the next period; after
        `timeout`, or 0.5 s if that is longer, this counts as False. False, or an OSError: not now.

        Called while the driver is away: a call has timed out, or one of the whole driver has failed. Other calls may
        come in between."""


def look_for(driver: object) -> bool | None:
    """The result of the driver's look as True, False or None; True, "try a transfer", if it has none."""
    if not isinstance(driver, Looks):
        return True
    found = driver.look()
    return None if found is None else bool(found)


def answers_for_device(driver: object) -> bool:
    """True if a look that says True is the device's own answer."""
    return isinstance(driver, Looks) and driver.answers_for_device


class KnowsAges(ABC):
    """Its circuit receives values from elsewhere instead of being asked for them. It counts for a driver off the
    cycle."""

    @abstractmethod
    def ages(self, channels: Sequence[Any]) -> Sequence[float] | None:
        """The age in s of each value that the last `read_many` of these channels has given. None: they are as old as
        the transfer."""


def ages_of(driver: object, channels: Sequence[Any]) -> Sequence[float] | None:
    """Return the ages in s of the last reading; None if as old as the transfer."""
    return driver.ages(channels) if isinstance(driver, KnowsAges) else None


class HasShortForm(ABC):
    """Lines of `[wire]` may have `driver = "TYPE:TEXT"` in place of a table of options."""

    @classmethod
    @abstractmethod
    def table(cls, text: str) -> Mapping[str, Any] | None:
        """The options that the text stands for, as a table `[drivers.NAME]` has them. None: there is no such form."""


def short_form_of(driver: type, text: str) -> Mapping[str, Any] | None:
    """Return the options that the text means; None if the driver's class has no such form."""
    return driver.table(text) if issubclass(driver, HasShortForm) else None


class PhysicalScale(NamedTuple):
    """Scale of a channel, as the circuit itself knows it: raw * resolution + zero_offset."""

    resolution: float
    zero_offset: float
    units: str
    """The unit as pint knows it: "mV", "degC"."""


class KnowsScale(ABC):
    """Its circuit itself knows what a raw integer stands for. The wiring is checked against that where the object has
    units of the same dimension."""

    @abstractmethod
    def physical_scale(self, channel: Any) -> PhysicalScale | None:
        """The scale of a channel; None: unknown, or the device is not there. May be called before `open`."""


def scale_of(driver: object, channel: Any) -> PhysicalScale | None:
    """Return the scale that the circuit reports for a channel; None if unknown."""
    return driver.physical_scale(channel) if isinstance(driver, KnowsScale) else None


class NoWatchdog(DriverError, NotImplementedError):
    """The circuit has no watchdog of its own, or none that its options name."""


class HasWatchdog(ABC):
    """Its circuit has a watchdog of its own."""

    @abstractmethod
    def watchdog(self, seconds: float) -> None:
        """Arm it: after this time without a request the circuit sets its outputs to safe levels. Called once the driver
        is open, and again when its device was away and is back, not when it has let go: whether the circuit is armed
        then is its own choice. A driver that makes requests beside its calls must not keep it from letting go."""

    def check_watchdog(self, seconds: float) -> None:  # noqa: B027  most take any time
        """WiringError or DriverError if `watchdog` cannot take this time. Nothing is sent; called before `open`."""


def arm_watchdog(driver: object, seconds: float) -> None:
    """Arm the watchdog of the driver's circuit; NoWatchdog if it has none."""
    if not isinstance(driver, HasWatchdog):
        raise NoWatchdog(f"{type(driver).__name__} has no watchdog of its own")
    driver.watchdog(seconds)


class Reports(ABC):
    """Reports results of its circuit or plant."""

    @abstractmethod
    def report(self) -> Mapping[str, Any]:
        """The results so far, as plain data by name. Called at the end of a run before `close`, and by `umo device
        plant --report` ten times a second."""


def report_of(driver: object) -> dict[str, Any]:
    """The results of a driver so far; empty if it has none."""
    return dict(driver.report()) if isinstance(driver, Reports) else {}


class Inspects(ABC):
    """Shows the content of the circuit for commissioning, in `umo device get`. It helps to find a wrong option, such as
    the order of bytes."""

    @abstractmethod
    def inspect(self, channel: Any) -> str:
        """Return the content of the circuit for an input channel, read now, in one line. Empty if there is nothing to
        show."""


def inspection_of(driver: object, channel: Any) -> str:
    """The content of the circuit for an input channel, read now; empty if the driver cannot show it."""
    return driver.inspect(channel) if isinstance(driver, Inspects) else ""


class WaitEnded(Exception):
    """Raised by the reading of a timer whose wait for its tick was ended (`EndsWait.stop_waiting`)."""


class EndsWait(ABC):
    """A timer whose wait for a tick can be ended. Any other one ends its call within its timeout."""

    @abstractmethod
    def stop_waiting(self) -> None:
        """A stop was requested: the wait for a tick, or the next one if there is none now, ends at once with WaitEnded.
        Called in a signal handler or in another thread; raises nothing."""


class TransferInC(NamedTuple):
    """A function in C that moves the raw integers of some channels (`umo_transfer` of umo_driver.h)."""

    function: int
    """Its address."""
    context: int
    """The address that it is called with."""
    keep: Any
    """The object that keeps both alive."""


class MovesInC(ABC):
    """Its transfers can be made in C, beside its functions in Python: compiled machines then do not call those, but
    where the function in C says so (umo_driver.h)."""

    @abstractmethod
    def in_c(self, channels: Sequence[Any], write: bool) -> TransferInC | str:
        """The transfer of these channels, as `read_many` or `write_many` has them; of a timer, as `read` has it. It
        holds until the driver is closed. A text: why there is none. Called when the channels are initialised; again
        when the driver was away."""


def transfer_in_c(driver: object, channels: Sequence[Any], write: bool) -> TransferInC | str:
    """The driver's transfer in C; a text: why there is none. One that a subclass has not changed with its functions in
    Python is not theirs."""
    if not isinstance(driver, MovesInC):
        return "it has no transfers in C"
    for place in (vars(driver), *map(vars, type(driver).__mro__)):
        if "in_c" in place:
            return driver.in_c(channels, write)
        if not place.keys().isdisjoint(IN_PYTHON):
            return f"{type(driver).__name__} has functions of its own in Python"
    return "it has no transfers in C"


IN_PYTHON = frozenset({"read", "write", "read_many", "write_many"})
"""The functions of a driver in Python that its transfers in C stand for."""
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
    """The names that a class of this module gives a driver."""
    return [name for name in vars(kind) if not name.startswith("_")]


def check_named(cls: type) -> None:
    """DeclarationError for a driver with a function of one of these classes that does not name the class: nobody would
    call it."""
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
