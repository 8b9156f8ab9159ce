"""A wiring that fits its machine: every object is on its channel, and every number is checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from umo.drivers.contract import Channel, Driver
from umo.drivers.faults.wrapper import Injection
from umo.drivers.optional import PhysicalScale
from umo.errors import DeclarationError, RangeError, UmoError
from umo.objects import Actuator, Compound
from umo.objects.atomic import INVERTED, Atomic, Calibration
from umo.objects.linearization import Linearization
from umo.objects.numbers import MachineNumber, check_settings, numbers_of
from umo.objects.presentation.value_text import measure
from umo.objects.scaling import raw_bounds, to_raw, to_value
from umo.objects.sensors import MAX_COUNTER
from umo.objects.units import convert
from umo.user_code import raise_as
from umo.wiring.rates import NO_RATES, RateMap


@dataclass(frozen=True, slots=True)
class Wire:
    """One object on one channel."""

    item: Atomic
    driver: Driver
    channel: Channel
    calibration: Calibration
    path: str
    """The path of the object, which `item.path` builds from its parents."""

    @property
    def scale(self) -> tuple[float, float]:
        """Resolution and zero offset."""
        return self.calibration.resolution, self.calibration.zero_offset

    @property
    def linearization(self) -> Linearization | None:
        return self.calibration.linearization

    @property
    def invalid_raws(self) -> tuple[int, ...]:
        return self.calibration.invalid_raws

    @property
    def rollover_bits(self) -> int:
        """The width in bits of a counter that rolls over; 0 if it does not roll over or is too wide to roll over in
        practice."""
        rollover, bits = self.calibration.rollover, self.channel.bits
        return (bits if bits <= MAX_COUNTER else 0) if rollover is True else int(rollover)

    @property
    def inverted(self) -> bool:
        """True if the electrical level of a binary object is inverted."""
        return self.item._has_states and self.calibration == INVERTED

    @property
    def ends(self) -> tuple[float, float]:
        """The electrical quantities at the minimum and at the maximum."""
        minimum, maximum, linearization = self.calibration.minimum, self.calibration.maximum, self.linearization
        if linearization is None:
            return minimum, maximum
        return linearization.to_input(minimum), linearization.to_input(maximum)

    @property
    def raw_bounds(self) -> tuple[int, int]:
        """The least and the greatest raw integer of an actuator whose value lies within the range."""
        return raw_bounds(*self.ends, *self.scale)

    @property
    def exact(self) -> bool:
        """True if, for every value of an actuator's range, the nearest raw integer stands for a value in the range."""
        scale, (minimum, maximum) = self.scale, self.ends
        ends = to_raw(minimum, *scale), to_raw(maximum, *scale)
        return (min(ends), max(ends)) == raw_bounds(minimum, maximum, *scale)

    @property
    def bounds(self) -> tuple[float, float]:
        """The range in which a sensor's value is GOOD: the declared range and half a resolution beyond it. For a state,
        the range is exact."""
        half = 0.0 if self.item._has_states else abs(self.calibration.resolution) / 2
        low, high = sorted(self.ends)
        if (linearization := self.linearization) is None:
            return low - half, high + half
        least, greatest = sorted(map(linearization.to_value, (low - half, high + half)))
        return least, greatest

    def raw(self, value: float) -> int:
        """Return the raw integer nearest to an actuator's value, among those within its range."""
        least, greatest = self.raw_bounds
        return min(max(self.nearest(value), least), greatest)

    @property
    def default(self) -> int | None:
        """The raw integer of an actuator's default; None for a sensor."""
        return self.raw(self.item._default_value()) if isinstance(self.item, Actuator) else None

    def nearest(self, value: float) -> int:
        """Return the raw integer nearest to a value, even if it lies outside the range."""
        return to_raw(value if self.linearization is None else self.linearization.to_input(value), *self.scale)

    def value(self, raw: int) -> float:
        """Return the value that a raw integer stands for."""
        x = to_value(raw, *self.scale)
        return x if self.linearization is None else self.linearization.to_value(x)

    def mismatch(self, given: PhysicalScale, units: str) -> str:
        """Return a text if the wired scale differs from the circuit's scale by more than half a raw step anywhere in
        the range. Return "" if the scales agree, or if they cannot be compared (other dimensions, a linearization)."""
        if self.linearization is not None:
            return ""
        try:
            zero, one = (convert(n * given.resolution + given.zero_offset, given.units, units) for n in (0, 1))
            raws = [to_raw(end, *self.scale) for end in self.ends]
        except (DeclarationError, RangeError, OverflowError):
            return ""
        apart = max(abs(zero + raw * (one - zero) - self.value(raw)) for raw in raws)
        if apart <= abs(self.scale[0]) / 2 * (1 + 1e-9):
            return ""
        own = f"resolution = {one - zero:.9g}, zero_offset = {zero:.9g}"
        where = f"away from the scale of the circuit, channel {self.channel.text}"
        return f"the wired scale is up to {measure(apart, units)} {where}: {own}"

    @property
    def name(self) -> str:
        """The object and its channel, for messages."""
        return f"{self.path} (channel {self.channel.text})"


def apply_calibrations(wires: Sequence[Wire]) -> Callable[[], object]:
    """Give the objects the calibrations of their wires. Return a function that restores the earlier calibrations."""
    before = [(wire.item, wire.item.calibration) for wire in wires]
    _calibrate((wire.item, wire.calibration) for wire in wires)
    return partial(_calibrate, before)


def _calibrate(each: Iterable[tuple[Atomic, Calibration]]) -> None:
    for item, calibration in each:
        if item.calibration is not calibration:  # most wirings change none
            item._calibrate(calibration)


class Parameter(NamedTuple):
    """A number of the control code that the wiring sets (the paper's section 2.1: only gains need adjusting)."""

    number: MachineNumber
    value: Any
    """The value to set. For a number that is not a field, this is the value as written in the wiring, because the range
    of the number may depend on fields."""


def apply_parameters(
    root: Compound, parameters: Iterable[Parameter], undo: Callable[[Callable[[], object]], object]
) -> None:
    """Set the parameters: first the fields, from which `setup` may make control laws, then the numbers of the laws. For
    each parameter, `undo` is called with a function that restores its earlier value. Raises DeclarationError if `setup`
    or a law does not accept the parameters."""
    each = sorted(parameters, key=lambda parameter: not parameter.number.is_field)
    fields = [parameter for parameter in each if parameter.number.is_field]
    for number, value in fields:
        undo(partial(number.assign, number.value))
        number.assign(value)
    if fields or root._parametrised:
        root._parametrised = bool(fields)
        root._set_up()
    rest = each[len(fields) :]
    known, paths = numbers_of(root) if rest else {}, [number.path for number, _ in rest]
    try:
        for path, (_, value) in zip(paths, rest, strict=True):
            if path not in known:
                raise DeclarationError(f"{path}: with the fields that this wiring sets there is no such number")
            number, checked = known[path], known[path].checked(value)
            undo(partial(number.assign, number.value))
            with raise_as(DeclarationError, f"{path} could not be set"):
                number.assign(checked)
        for path in paths:  # when all are set: they may depend on one another
            try:
                check_settings(known[path].owner)
            except (DeclarationError, RangeError) as error:
                raise DeclarationError(f"{path}: {error}") from None
    except (DeclarationError, RangeError) as error:
        raise DeclarationError(f"the wiring's parameter {error}") from None


def mistake_of_parameters(root: Compound, parameters: list[Parameter]) -> str:
    """Try the parameters on the machine without devices. Return the mistake that the machine finds; "" if it accepts
    all parameters or is connected."""
    restore: list[Callable[[], object]] = []
    before = root._parametrised
    if root.cycle.connected or not parameters:
        return ""
    try:
        with raise_as(DeclarationError, "the wiring's parameters: `setup` failed"):
            apply_parameters(root, parameters, restore.append)
    except UmoError as error:
        return str(error)
    finally:
        for undo in reversed(restore):
            undo()
        if root._parametrised and not before:
            root._parametrised = False
            root._set_up()
    return ""


AT_ONCE, AT_NEXT_TICK = "at once", "at next tick"


@dataclass(frozen=True, slots=True)
class ProcessSettings:
    """The real-time settings of the control process, from `[process]` of the wiring. Times are in s."""

    hang_timeout: float = 0.1
    """Time in s without a finished period after which the process counts as hanging. Default: 20 periods, at least
    0.1 s, and above the sum of the timeouts of one period."""
    reset_for: float = 10.0
    """The time in s for which the guardian retries to reach a device that does not answer. After that, the guardian
    tries each actuator that it has not tried yet exactly once, for at most the same time."""
    priority: int = 80
    """Priority of the control process under SCHED_FIFO, 1 to 98. The guardian runs at a priority that is higher by
    one."""
    cpu: int | None = None
    """The core of the control process. None means, if SCHED_FIFO is permitted, a core that no other station uses: an
    isolated core if possible, otherwise the last one."""
    busy_wait: float | None = None
    """Time in s before each tick of a timer in real time (timerfd, `--realtime`) from which on the control process
    waits busily (spins). 0 means that it sleeps until the tick. None means 200 us, but at most half of the period, if
    SCHED_FIFO and a core were granted; otherwise 0. With `compile` and a period of at most 100 us, None means the whole
    period. Only a control process waits busily: `connect` and `umo.run` sleep until the tick."""
    outputs: str = AT_ONCE
    """The time at which `update` of the whole machine sends the outputs: "at once", or "at next tick". The latter means
    immediately after the next tick, before sampling."""
    compile: bool = False
    """True if the control laws are compiled (`umo.generate.compiled_laws`). Only `umo run` uses it."""


@dataclass(frozen=True, slots=True)
class Wired:
    """Everything that `connect` needs to know about a wiring."""

    drivers: dict[str, Driver]
    wires: list[Wire]
    """Wires in declared order."""
    period: float | None = None
    """The sampling period in s; None for a machine without a timer."""
    timer: Atomic | None = None
    parameters: list[Parameter] = field(default_factory=list)
    watchdogs: dict[str, float] = field(default_factory=dict)
    """The times of the watchdogs in s, by the name of the driver."""
    hardware: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """The devices that each driver uses, by the name of the driver. Drivers without a device are left out."""
    process: ProcessSettings = ProcessSettings()
    paced: bool = False
    """True if the option `realtime` paces a timer that runs in virtual time."""
    injection: Injection | None = None
    """The faults that are injected on purpose; None if there are none."""
    rates: RateMap = NO_RATES
    """The parts that do not have the machine's rate, the fastest first."""
    faces: Mapping[str, Any] = field(default_factory=dict)
    """The table of the station's faces, as written (`umo.clients.faces.face_settings` reads it)."""
    record: Mapping[str, Any] | None = None
    """The settings of recordings of the machine's runs, as written (`umo.recording.record_settings` reads them); None
    if the runs are not recorded."""
    controllers: Mapping[str, str] = field(default_factory=dict)
    """The driver of each part that runs on a controller, by path."""

    @property
    def devices(self) -> list[str]:
        """Every device of the machine."""
        return sorted({device for devices in self.hardware.values() for device in devices})

    def texts_of(self, wires: Iterable[Wire]) -> list[str]:
        """Return the text of each wire, such as `box:coil:3 inverted`."""
        names = {id(driver): name for name, driver in self.drivers.items()}

        def name_of(driver: Driver) -> str:  # a timer that is paced stands before its driver
            return names.get(id(driver)) or names.get(id(getattr(driver, "timer", None)), "timer")

        return [f"{name_of(wire.driver)}:{wire.channel.text}{' inverted' * wire.inverted}" for wire in wires]

    @property
    def timer_wire(self) -> Wire | None:
        """The timer on its channel."""
        return next((wire for wire in self.wires if wire.item is self.timer), None)

    @property
    def mixed_times(self) -> str:
        """The reason why this wiring runs with the option `realtime` only: its timer runs in virtual time, which is as
        fast as possible, and it has hardware. Empty otherwise."""
        if self.timer_wire is None or self.period is None or not self.hardware or self.realtime:
            return ""
        timer = self.texts_of([self.timer_wire])[0].partition(":")[0]
        name, devices = next(iter(self.hardware.items()))
        return f"{timer} runs in virtual time, but driver {name} controls hardware ({devices[0]})"

    @property
    def realtime(self) -> bool:
        """True if the timer keeps the pace of the wall clock."""
        return self.timer_wire is not None and self.timer_wire.driver.realtime
