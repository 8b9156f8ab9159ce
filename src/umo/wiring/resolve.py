"""The check of a wiring against its machine, and its resolution. `umo check` and `connect` use it.

All errors are found in one run, each with its file and key.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import operator
from collections.abc import Hashable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from umo.digits import number_text
from umo.drivers import registry
from umo.drivers.contract import INT64, MAX_DEFAULT_TIMEOUT, Channel, Direction, Driver
from umo.drivers.faults.fault_syntax import InjectedFault
from umo.drivers.faults.wrapper import Injection
from umo.drivers.optional import HasWatchdog, PhysicalScale, scale_of
from umo.duration import duration, seconds
from umo.errors import DeclarationError, Mistake, OptionError, RangeError, WiringError, text_of
from umo.objects import (
    Actuator,
    Atomic,
    Compound,
    Digital,
    DigitalSensor,
    Node,
    Sensor,
    atoms,
    walk,
)
from umo.objects.atomic import LEVEL, Calibration
from umo.objects.compound import check_machine
from umo.objects.linearization import fitted
from umo.objects.numbers import MachineNumber, numbers_of
from umo.objects.presentation.value_text import measure, span
from umo.objects.scaling import to_raw
from umo.objects.sensors import MAX_COUNTER, MIN_COUNTER
from umo.objects.units import check_unit
from umo.signature import signature_of
from umo.system.packages import station_of
from umo.text import count_of
from umo.wiring.controller_table import check_controllers, give_to_controllers
from umo.wiring.fault_binding import inject
from umo.wiring.off_cycle_table import OFF_CYCLE, DriverTable, check_shared_devices, driver_table, take_off_cycle
from umo.wiring.parameters import flag
from umo.wiring.patterns import collapsed, counted, expand, expand_parameters
from umo.wiring.process_table import process_of
from umo.wiring.rates import rates_of
from umo.wiring.run_options import FAULT, FAULT_SEED, REALTIME, RESERVED, WIRING_OPTIONS
from umo.wiring.settings import a_whole
from umo.wiring.source import SECTIONS, WiringSource, read
from umo.wiring.wired import Parameter, Wire, Wired, mistake_of_parameters

if TYPE_CHECKING:
    from umo.wiring.schema import Entry, LinearizationTable

DEFAULT_PERIOD = "1 ms"
SEED = a_whole(0, int(INT64.max))
OPTION = "--"
"""The beginning of the name in place of a file for a mistake in an option of the run."""


def check(root: Compound, wiring: Path | str | Mapping[str, Any] | None = None) -> list[Mistake]:
    """Return every mistake in the wiring; empty if it fits the machine. No device is opened. The parameters of the
    wiring are set on the machine, which calls `setup`, and are then restored. That a wiring runs only with `umo run
    --realtime` is not a mistake."""
    check_machine("check", root)
    resolver = _Resolver(root, wiring, {}, to_run=False)
    wired, mistakes = resolver.run()
    if not mistakes and (text := mistake_of_parameters(root, wired.parameters)):
        return resolver.source.located([Mistake(resolver.source.file, "parameters", text)])
    return mistakes


def resolve(
    root: Compound,
    wiring: Path | str | Mapping[str, Any] | None,
    options: Mapping[str, Any] | None = None,
    *,
    to_run: bool = True,
) -> Wired:
    """Return the checked and complete wiring. Raises WiringError, which lists every mistake, or OptionError if only the
    options are wrong. No device is opened. `options`: the options for its drivers
    (`umo.wiring.run_options.distribute_options`). `to_run`: False if the machine will not be connected. Hardware
    together with virtual time is then accepted (`Wired.mixed_times`)."""
    wired, mistakes = _Resolver(root, wiring, options or {}, to_run).run()
    if mistakes:
        if all(each.file.startswith(OPTION) for each in mistakes):
            raise OptionError("\n".join(map(str, mistakes)))
        raise WiringError(f"{count_of(len(mistakes), 'error')} in the wiring", mistakes)
    return wired


class _Resolver:
    def __init__(
        self,
        root: Compound,
        wiring: Path | str | Mapping[str, Any] | None,
        options: Mapping[str, Any],
        to_run: bool,
    ) -> None:
        self.root, self.to_run = root, to_run
        self.options = {name: value for name, value in options.items() if name not in WIRING_OPTIONS}
        self.realtime = options.get(REALTIME, False)
        self.given = options
        self.items = {item.path: item for item in atoms(root)}
        self.source: WiringSource = read(_all_simulated(self.items) if wiring is None else wiring)
        self.drivers: dict[str, Driver | None] = {}
        self.tables: dict[str, DriverTable] = {}
        self.hardware: dict[str, tuple[str, ...]] = {}
        """The devices of each driver that has devices."""
        self.used_places: dict[tuple[type, str, Hashable], str] = {}

    def run(self) -> tuple[Wired, list[Mistake]]:
        if not self.source.entries and self.source.mistakes and self.source.mistakes[0].key == "":
            return Wired({}, []), self.source.mistakes  # there was nothing to read
        origin = expand(self.source, self.items)
        controllers = give_to_controllers(self.source, self.root, self.items)
        timer = self.items.get("timer")
        period = self._period(timer)
        self.rates = rates_of(self.root, period, partial(self.source.mistake, 'wire."timer".period'))
        watchdogs = self._make_drivers(period)
        drivers = {name: driver for name, driver in self.drivers.items() if driver is not None}
        self.hardware = self._hardware(drivers)
        channels = {path: self._channel(path) for path in self.items}
        # after all channels were made, which then lie side by side in memory: a driver goes through them in each period
        found = ((path, channel) for path, channel in channels.items() if channel is not None)
        wires = [self._wire(path, self.items[path], channel) for path, channel in found]
        for wire in wires:
            self._check_place(wire)
        self._check_rewritten([wire for wire in wires if wire.item.direction is Direction.OUTPUT])
        injection = self._inject(wires, drivers, timer)
        take_off_cycle(self.source, wires, drivers, self.tables, timer)
        check_shared_devices(self.source, drivers, self.hardware)
        check_controllers(self.source, controllers, drivers, wires)
        paced = bool(self.realtime) and self._pace(wires, timer)
        for path in sorted(self.source.entries.keys() - self.items.keys()):
            self.source.mistake(f'wire."{path}"', f"the machine has no such object{self.source.near(path, self.items)}")
        self._check_periods(period)
        parameters = self._parameters() if self.source.parameters else []
        wired = Wired(
            drivers,
            wires,
            period,
            timer,
            parameters,
            watchdogs,
            self.hardware,
            rates=self.rates,
            faces=self.source.faces,
            record=self.source.record,
            controllers=controllers,
        )
        if self.to_run and wired.mixed_times:
            self.source.mistake(
                'wire."timer".driver',
                f"{wired.mixed_times}; "
                'wire the timer to a real clock, { driver = "timerfd", period = ... }, or run with --realtime',
            )
        self._check_plants()
        wired = dataclasses.replace(wired, process=process_of(self.source, wired), paced=paced, injection=injection)
        return wired, self.source.located(collapsed(self.source.mistakes, origin))

    # Drivers -------------------------------------------------------------------------------------------

    def _make_drivers(self, period: float | None) -> dict[str, float]:
        """Make one driver for each name that is in use or declared. Return the watchdogs' times by name."""
        watchdogs = {}
        for name in dict.fromkeys([*self.source.drivers, *(e.driver for e in self.source.entries.values())]):
            table = self.source.drivers[name] if name in self.source.drivers else self._table_of(name)
            driver = self.drivers[name] = self._make_driver(name, table) if table else None
            if driver is None:
                continue
            own = self.tables[name] = driver_table(self.source, name, table)
            if driver.only_off_cycle and not own.off_cycle:
                text = f"must be true: {table['type']} is a driver off the cycle; give it a period too"
                self.source.mistake(f"drivers.{name}.{OFF_CYCLE}", text)
            own_period = own.period if own.off_cycle else None
            driver.period = own_period or self._shortest_period(name, period) or 0.0
            shortest = own_period or period or 0.1  # the machine's: no fast part waits for the device of a slow one
            driver.timeout = own.timeout or min(10 * shortest, MAX_DEFAULT_TIMEOUT)
            if own.watchdog is None:
                continue
            if why := _why_not_watched(driver, own.watchdog, table["type"]):
                self.source.mistake(f"drivers.{name}.watchdog", why)
            else:
                watchdogs[name] = own.watchdog
        return watchdogs

    def _shortest_period(self, name: str, period: float | None) -> float | None:
        """Return the shortest period in s in which a driver is used: the period of the fastest output, because outputs
        feed the watchdog; for a driver without outputs, that of the fastest object."""
        items = [
            self.items[path]
            for path, entry in self.source.entries.items()
            if entry.driver == name and path in self.items
        ]
        outputs = [item for item in items if item.direction is Direction.OUTPUT]
        timed = any(item.path == "timer" for item in items)
        return period and period * (1 if timed else min(map(self.rates.every, outputs or items), default=1))

    def _table_of(self, name: str) -> Mapping[str, Any]:
        """Return the table of a driver that only lines of `[wire]` name."""
        table = registry.table_of(name)
        if table["type"] != name:
            self.source.drivers[name] = dict(table)
        return table

    def _make_driver(self, name: str, table: Mapping[str, Any]) -> Driver | None:
        from pydantic import ValidationError

        from umo.wiring.schema import arguments_of
        from umo.wiring.schema_mistakes import mistakes_of

        declared = name in self.source.drivers
        given = {key: value for key, value in table.items() if key not in RESERVED}
        if isinstance(table["type"], Driver):
            for key in given:
                self.source.mistake(
                    f"drivers.{name}.{key}", "is an option for a driver's type; this driver is already constructed"
                )
            return table["type"]
        try:
            cls = registry.find(table["type"])
        except WiringError as error:
            if declared:
                self.source.mistake(f"drivers.{name}.type", f"{error}{self._own_module(table['type'])}")
            else:
                names = [*self.source.drivers, *registry.known()]
                message = f"there is no driver {name!r}{self.source.near(name, names)}; known: {', '.join(names)}"
                for path in [p for p, entry in self.source.entries.items() if entry.driver == name]:
                    self.source.mistake(f'wire."{path}".driver', message)
            return None
        signature: Mapping[str, inspect.Parameter] = {}
        try:
            signature = signature_of(cls)
            return cls(**arguments_of(cls, signature, given, self.source.file, self.options))
        except ValidationError as error:
            types = {key: each.annotation for key, each in signature.items()}
            for key, message in mistakes_of(error, [*signature, *RESERVED], types):
                if key.partition(".")[0] in self.options:
                    self._mistake_of_option(key, message)
                else:
                    self.source.mistake(f"drivers.{name}.{key}", message)
        except (Exception, SystemExit) as error:  # of the driver's constructor
            if wrong := self._wrong_option(cls, signature, given):
                self._mistake_of_option(wrong, text_of(error))
            else:
                self.source.mistake(f"drivers.{name}", text_of(error))
        return None

    def _wrong_option(self, cls: Any, signature: Mapping[str, inspect.Parameter], given: Mapping[str, Any]) -> str:
        """Return the option of the run without which the driver can be made; "" if there is none."""
        from umo.wiring.schema import arguments_of

        for name in filter(signature.__contains__, self.options):
            others = {key: value for key, value in self.options.items() if key != name}
            with suppress(Exception, SystemExit):
                cls(**arguments_of(cls, signature, given, self.source.file, others))
                return name
        return ""

    def _mistake_of_option(self, name: str, message: str) -> None:
        self.source.mistakes.append(Mistake(flag(name), "", message.removeprefix(f"{name} ")))

    def _own_module(self, kind: str) -> str:
        """Return a hint if a module of the station was probably meant."""
        folder = station_of(Path(self.source.file))
        own = folder is not None and (folder / f"{kind.partition(':')[0]}.py").is_file()
        return f"; for a module of the station write {'.' + kind!r}" if own else ""

    def _hardware(self, drivers: dict[str, Driver[Any]]) -> dict[str, tuple[str, ...]]:
        """Return the devices that each driver uses."""
        found = {}
        for name, driver in drivers.items():
            try:
                devices = tuple(map(str, driver.devices()))
            except (Exception, SystemExit) as error:
                self.source.mistake(f"drivers.{name}", f"cannot name its devices: {text_of(error)}")
                continue
            if devices:
                found[name] = devices
        return found

    # Wires ---------------------------------------------------------------------------------------------

    def _channel(self, path: str) -> Channel | None:
        key = f'wire."{path}"'
        entry = self.source.entries.get(path)
        if entry is None:
            if path not in self.source.refused:
                hint = 'for hardware that does not exist yet use { driver = "simulated" }'
                if path == "timer" and self.hardware:
                    hint = 'for real time use { driver = "timerfd", period = "50 ms" }'
                self.source.mistake(key, f"is not wired; {hint}")
            return None
        driver = self.drivers[entry.driver]
        if driver is None:
            return None  # reported with the driver
        try:
            channel = driver.channel(path if entry.channel is None else entry.channel)
        except (Exception, SystemExit) as error:  # most are ChannelErrors
            self.source.mistake(f"{key}.channel", text_of(error))
            return None
        if isinstance(channel, Channel):
            return channel
        what = f"{type(driver).__name__}.channel returned {channel!r}, not a Channel"
        self.source.mistake(f"{key}.channel", what)
        return None

    def _wire(self, path: str, item: Atomic, channel: Channel) -> Wire:
        key, entry = f'wire."{path}"', self.source.entries[path]
        driver = self.drivers[entry.driver]
        assert driver is not None  # it has made the channel
        self._check_direction(key, item, channel)
        self._check_retry(key, item, channel)
        if not isinstance(item, Digital):
            for name in Calibration._fields:
                if getattr(entry, name) is not None:
                    self.source.mistake(f"{key}.{name}", f"is for digital objects; this one is {item._word}")
            try:
                return Wire(item, driver, channel, item._levels(bool(entry.inverted)), path)
            except DeclarationError as error:
                self.source.mistake(f"{key}.inverted", str(error))
                return Wire(item, driver, channel, item._levels(False), path)
        if entry.inverted is not None:
            self.source.mistake(f"{key}.inverted", "is for binary objects; use a negative resolution")
        calibration = self._calibration(key, item, entry)
        wire = Wire(item, driver, channel, calibration, path)
        self._check_raws(key, item, wire)
        self._check_scale(key, item, wire)
        if path == "timer" and item.units == "sampling_period" and not _is_count(wire):
            what = "its resolution is 1 and its zero offset 0, and nothing filters, linearizes or refuses it"
            self.source.mistake(key, f"timer counts missed periods: {what}")
        return wire

    def _check_place(self, wire: Wire) -> None:
        path, channel = wire.path, wire.channel
        driver = self.source.entries[path].driver
        for place, circuit in product(channel.places, self._circuits(driver)):
            other = self.used_places.setdefault((type(wire.driver), circuit, place), path)
            if other != path:
                text = f"channel {channel.text!r} of {driver} is already used by {other}"
                self.source.mistake(f'wire."{path}"', text)
                return

    def _check_rewritten(self, outputs: Sequence[Wire]) -> None:
        """Check that no output lies where another driver rewrites its own outputs."""
        rewritten: dict[tuple[type, str, Hashable], Wire] = {}
        for wire in outputs:
            for place, circuit in product(wire.channel.rewrites, self._circuits_of(wire)):
                rewritten[type(wire.driver), circuit, place] = wire
        for wire in outputs if rewritten else ():
            for place, circuit in product(wire.channel.places, self._circuits_of(wire)):
                other = rewritten.get((type(wire.driver), circuit, place), wire)
                if other.driver is not wire.driver:
                    self._mistake_of_rewriting(wire, other)
                    break

    def _mistake_of_rewriting(self, wire: Wire, other: Wire) -> None:
        path, writer = wire.path, self.source.entries[other.path].driver
        what = f"channel {wire.channel.text!r} of {self.source.entries[path].driver} is overwritten by {writer}"
        why = f"which writes the whole register for {other.path} ({other.channel.text!r})"
        self.source.mistake(f'wire."{path}".driver', f"{what}, {why}; wire both to one driver")

    def _circuits(self, driver: str) -> Sequence[str]:
        """Return the devices of a driver; for a driver without devices, its name. Two drivers of one device share its
        places."""
        return self.hardware.get(driver, (driver,))

    def _circuits_of(self, wire: Wire) -> Sequence[str]:
        return self._circuits(self.source.entries[wire.path].driver)

    def _check_retry(self, key: str, item: Atomic, channel: Channel) -> None:
        if isinstance(item, Actuator) and item._max_age is not None and channel.event:
            what = f"a write to channel {channel.text!r} is an event, which must not happen twice"
            hint = 'declare on_error="raise" (a text channel that sets a level: sets_level = true)'
            self.source.mistake(f"{key}.channel", f'on_error="retry" sends a value again, but {what}; {hint}')

    def _check_direction(self, key: str, item: Atomic, channel: Channel) -> None:
        if item.direction not in channel.direction:
            actuator = item.direction is Direction.OUTPUT
            kind = "an actuator" if actuator else "a sensor"
            has = "an input" if actuator else "an output"
            self.source.mistake(f"{key}.channel", f"is {kind}, but channel {channel.text!r} is {has}")

    def _calibration(self, key: str, item: Digital, entry: Entry) -> Calibration:
        """Return the declared range and scale with the overrides of the entry. An entry can narrow a range, but not
        widen it."""
        declared = item.calibration
        override = {name: value for name in declared._fields if (value := getattr(entry, name)) is not None}
        if entry.linearization is not None:
            override["linearization"] = self._linearization(
                key, item, entry.linearization, declared._replace(**override)
            )
        if entry.invalid_raws is not None:
            override["invalid_raws"] = tuple(entry.invalid_raws)
        if not override:
            return declared
        if override.get("resolution") == 0:
            self.source.mistake(f"{key}.resolution", "is 0; it is the change of the value for one bit")
            return declared
        calibration = declared._replace(**override)
        for name in ("minimum", "maximum"):
            value = getattr(calibration, name)
            if not declared.minimum <= value <= declared.maximum:
                range_text = span(declared.minimum, declared.maximum, item.units)
                self.source.mistake(f"{key}.{name}", f"{number_text(value)} widens the declared range {range_text}")
        if calibration.minimum >= calibration.maximum:
            low, high = (measure(each, item.units) for each in (calibration.minimum, calibration.maximum))
            self.source.mistake(key, f"minimum {low} is not below maximum {high}")
        if isinstance(item, Actuator) and not calibration.minimum <= item.default <= calibration.maximum:
            self.source.mistake(key, f"the default {measure(item.default, item.units)} is outside the narrowed range")
        return calibration

    def _linearization(self, key: str, item: Digital, given: LinearizationTable, calibration: Calibration) -> Any:
        """Return the linearization of the entry, prepared for the range of this calibration; None if the entry's table
        is empty. If it is faulty, return the declared linearization."""
        declared = item.linearization
        if given.is_empty:
            return None
        low, high = calibration.minimum, calibration.maximum
        if low >= high:
            return declared  # the range is reported
        try:
            return fitted(given.made(), item.units, low, high)
        except DeclarationError as error:
            self.source.mistake(f"{key}.linearization", str(error))
            return declared

    def _check_raws(self, key: str, item: Digital, wire: Wire) -> None:
        channel, resolution = wire.channel, f"resolution {number_text(wire.calibration.resolution)}"
        try:
            ends = [to_raw(x, *wire.scale) for x in wire.ends]
        except OverflowError:
            self.source.mistake(key, f"the {resolution} makes raw values too large for any channel")
            return
        if isinstance(item, Actuator) and operator.gt(*wire.raw_bounds):
            self.source.mistake(key, f"no multiple of the {resolution} lies within the range")
        lowest, highest = channel.lowest, channel.highest
        self._check_rollover(f"{key}.rollover", item, wire)
        if not wire.rollover_bits and not lowest <= min(ends) <= max(ends) <= highest:
            self.source.mistake(
                key,
                f"the range needs raw values {min(ends)} to {max(ends)}, channel {channel.text!r} "
                f"has {channel.bits} bits: {lowest} to {highest}",
            )
        for raw in wire.invalid_raws:
            if isinstance(item, Actuator):
                self.source.mistake(f"{key}.invalid_raws", "is for sensors; this is an actuator")
                return
            if not lowest <= raw <= highest:
                text = f"{raw} cannot be read: channel {channel.text!r} has {lowest} to {highest}"
                self.source.mistake(f"{key}.invalid_raws", text)

    def _check_rollover(self, key: str, item: Digital, wire: Wire) -> None:
        bits, channel = wire.rollover_bits, wire.channel
        if not bits:
            return
        if isinstance(item, Actuator):
            self.source.mistake(key, "is for sensors; this is an actuator")
        elif not MIN_COUNTER <= bits <= MAX_COUNTER:
            self.source.mistake(key, f"{bits} is not the number of a counter's bits, {MIN_COUNTER} to {MAX_COUNTER}")
        elif bits > channel.bits:
            self.source.mistake(key, f"{bits} is more than the {channel.bits} bits of channel {channel.text!r}")

    def _check_scale(self, key: str, item: Digital, wire: Wire) -> None:
        """Check the scale against that of the circuit, if the circuit reports a scale."""
        try:
            given = scale_of(wire.driver, wire.channel)
        except Exception as error:  # of the driver's code
            self.source.mistake(f"{key}.channel", f"its scale cannot be read: {text_of(error)}")
            return
        if given is None:
            return
        if not isinstance(given, PhysicalScale):
            self.source.mistake(f"{key}.channel", f"its scale is {given!r}, not a PhysicalScale")
            return
        try:
            check_unit(given.units)
        except DeclarationError as error:
            self.source.mistake(f"{key}.channel", f"the unit of channel {wire.channel.text!r}: {error}")
            return
        if wire.scale[0] and (text := wire.mismatch(given, item.units)):
            self.source.mistake(key, text)

    # Time and parameters -------------------------------------------------------------------------------

    def _period(self, timer: Atomic | None) -> float | None:
        for path, entry in self.source.entries.items():
            if path != "timer" and entry.period is not None:
                self.source.mistake(f'wire."{path}".period', "is allowed for the timer only")
        if timer is None:
            return None
        key = 'wire."timer"'
        if not isinstance(timer, DigitalSensor) or timer.synchronous or timer.units != "sampling_period":
            self.source.mistake(key, "timer must be an asynchronous DigitalSensor in sampling_period")
        elif timer._max_age is not None or timer._marks:
            self.source.mistake(key, 'timer must have on_error="raise": a held value would stop the clock')
        wired = self.source.entries.get("timer")
        if wired is None:
            return None
        if wired.period is None:
            self.source.mistake(f"{key}.period", 'is missing; give for example "1 ms"')
        return wired.period

    def _inject(self, wires: list[Wire], drivers: dict[str, Driver[Any]], timer: Atomic | None) -> Injection | None:
        """Put the requested faults between the machine and its drivers."""
        given, seed = self.given.get(FAULT, ()), self.given.get(FAULT_SEED, self.source.seed)
        given = [given] if isinstance(given, str | InjectedFault) else list(given)
        faults = [*self.source.injected, *given]
        try:
            SEED.take(seed)
        except DeclarationError as error:
            self.source.mistake("fault_seed", str(error))
        if not faults:
            return None
        waits = bool(self.realtime) or any(wire.item is timer and wire.driver.realtime for wire in wires)
        injection = inject(faults, seed, wires, drivers, waits, partial(self._not_injected, len(self.source.injected)))
        faulty = {id(each.driver): each for each in injection.drivers}
        for i, wire in enumerate(wires):
            wires[i] = dataclasses.replace(wire, driver=faulty.get(id(wire.driver), wire.driver))
        for name, driver in drivers.items():
            drivers[name] = faulty.get(id(driver), driver)
        return injection

    def _not_injected(self, written: int, number: int, text: str, why: str) -> None:
        """Report a fault that cannot be injected. The first `written` faults are those of the wiring; the others were
        given as options."""
        if number < written:
            self.source.mistake("faults", f"fault {text!r}: {why}")
        else:
            self.source.mistakes.append(Mistake(f"{flag(FAULT)} {text!r}", "", why))

    def _pace(self, wires: list[Wire], timer: Atomic | None) -> bool:
        """Let the timer's wire keep the pace of real time. Return False if its driver runs in real time by itself."""
        from umo.drivers.paced import PacedTimer

        if self.realtime is not True:
            self.source.mistake("", f"the option realtime is true or false, not {self.realtime!r}")
        elif timer is None:
            self.source.mistake("", "real time needs a timer, and the machine has no object `timer`")
        for i, wire in enumerate(wires):
            if wire.item is timer and not wire.driver.realtime:
                wires[i] = dataclasses.replace(wire, driver=PacedTimer(wire.driver))
                return True
        return False

    def _check_periods(self, period: float | None) -> None:
        if period is None:
            return
        for node in [self.root, *walk(self.root)]:
            every = self.rates.every(node)
            if why := _fault_of_period(every * period, node):
                times = f", {every} times the period," if every > 1 else ""
                self.source.mistake('wire."timer".period', f"{duration(every * period)}{times} is {why}")

    def _check_plants(self) -> None:
        """Refuse a plant that is not the timer, because no time would pass in it."""
        wired = self.source.entries.get("timer")
        timer = self.drivers.get(wired.driver) if wired is not None else None
        if wired is None or timer is None:
            return
        for name in dict.fromkeys(entry.driver for entry in self.source.entries.values()):
            driver = self.drivers.get(name)
            if driver is not None and driver is not timer and driver.simulates_time:
                self.source.mistake(
                    'wire."timer".driver',
                    f"{wired.driver} is the timer, so no time would pass in driver {name}; wire the timer to {name}, "
                    f'{{ driver = "{name}", channel = "tick", period = ... }}, and run with --realtime for real time',
                )

    def _parameters(self) -> list[Parameter]:
        """Return the numbers that the wiring sets. A range that may depend on fields is checked when the fields are
        set."""
        known = {path: each for path, each in numbers_of(self.root).items() if each.settable}
        found: list[Parameter] = []
        for key, values in expand_parameters(self.source, known).items():
            faults = [text for path, value in values if (text := self._parameter(known, path, value, found))]
            if faults:
                self.source.mistake(f"parameters.{key!r}", counted(faults[0], len(faults) - 1))
        return found

    def _parameter(self, known: Mapping[str, MachineNumber], path: str, value: Any, found: list[Parameter]) -> str:
        """Return the mistake in setting a number to this value. If there is none, add the parameter to `found` and
        return ""."""
        if path not in known:
            late = path in SECTIONS
            hint = f"; put {path} before the first table" if late else self.source.near(path, known)
            return f"there is no such parameter{hint}"
        number = known[path]
        try:
            value = number.from_written(value)
            checked = number.checked(value) if number.is_field else number.of_its_type(value)
        except (RangeError, DeclarationError) as error:
            return str(error).removeprefix(f"{path}: ")
        found.append(Parameter(number, checked))
        return ""


def _is_count(wire: Wire) -> bool:
    """Return True if the value of a sensor is its raw integer, unscaled and not conditioned."""
    item = wire.item
    conditioned = item._incremental or item._filter is not None or item._velocity is not None
    return wire.calibration[2:] == LEVEL[2:] and not conditioned


def _fault_of_period(period: float, node: Node) -> str:
    """Return why the period does not fit the object; empty if it fits."""
    if isinstance(node, Compound) and node._settings.max_period is not None:
        longest = seconds(node._settings.max_period)
        if period > longest * (1 + 1e-9):
            return f"longer than `max_period` of {node._path or type(node).__name__} ({duration(longest)})"
    if isinstance(node, Actuator):
        expires = node.expires or math.inf  # it must outlast the way from one write to the next
        if period > expires * (1 - 1e-9):
            return f"not shorter than `expires` of {node.path} ({duration(expires)})"
    if isinstance(node, Actuator) or (isinstance(node, Sensor) and node.synchronous):
        max_age = node._max_age  # at the first failure the last transfer is one period old
        if max_age is not None and period > max_age * (1 + 1e-9):
            return f"longer than `max_age` of {node.path} ({duration(max_age)})"
    return ""


def _all_simulated(items: Mapping[str, Atomic]) -> dict[str, Any]:
    wire: dict[str, dict[str, Any]] = {path: {"driver": "simulated"} for path in items}
    if "timer" in wire:
        wire["timer"]["period"] = DEFAULT_PERIOD
    return {"wire": wire}


def _why_not_watched(driver: Driver[Any], seconds: float, kind: str) -> str:
    """Return why the watchdog of a driver cannot be armed with this time; "" if it can."""
    if not isinstance(driver, HasWatchdog):
        return f"{kind} has no watchdog of its own"
    if seconds <= driver.period:
        return f"{duration(seconds)} is not longer than the period, {duration(driver.period)}"
    try:
        driver.check_watchdog(seconds)
    except Exception as error:  # of the driver's code
        return text_of(error)
    return ""
