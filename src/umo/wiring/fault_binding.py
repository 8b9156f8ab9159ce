"""The binding of injected faults to the wires of a machine, with amounts in raw integers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from typing import Any

from umo.drivers.contract import Direction, Driver
from umo.drivers.faults import effects
from umo.drivers.faults.effects import Effect, Shift, limited
from umo.drivers.faults.fault_syntax import FORM, KINDS_OF_DRIVERS, InjectedFault
from umo.drivers.faults.wrapper import FaultyDriver, Injection
from umo.duration import seconds
from umo.errors import DeclarationError
from umo.objects.description import described
from umo.objects.paths import is_pattern, matches
from umo.objects.presentation.value_text import span
from umo.objects.scaling import to_raw
from umo.objects.units import convert
from umo.text import did_you_mean
from umo.wiring.wired import Wire

_AMOUNT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
MAX_AMOUNT = 1e30
"""The largest amount of a fault. Calculations with this amount do not overflow."""
SHARES = {"noise": 10.0, "drop-out": 50.0}
"""Default shares of the faults, in percent."""
PARTS = {"noise": 0.01, "drift": 0.01, "out of range": 0.1}
"""The default amounts of the faults, as shares of the object's range; for a drift, per second."""


def inject(
    faults: Sequence[InjectedFault | str],
    seed: int,
    wires: Sequence[Wire],
    drivers: Mapping[str, Driver[Any]],
    waits: bool,
    report: Callable[[int, str, str], None],
) -> Injection:
    """Put the faults between the machine and its drivers; `report` is called with the number, text and reason of each
    wrong fault. `drivers`: the drivers by name. `Injection.drivers` of the result contains the affected drivers.
    """
    texts: list[str] = []
    by_driver: dict[int, list[Effect]] = {}
    for number, given in enumerate(faults):
        try:
            if not isinstance(given, InjectedFault | str):
                raise DeclarationError(f"is not a string: {FORM}")
            fault = InjectedFault.parse(given) if isinstance(given, str) else given
            for driver, effect in _effects_of(fault, wires, drivers):
                by_driver.setdefault(id(driver), []).append(effect)
            texts.append(str(fault))
        except DeclarationError as error:
            report(number, str(given), str(error))
    injection = Injection(texts, seed, waits)
    for driver in drivers.values():
        if id(driver) in by_driver:
            FaultyDriver(driver, by_driver[id(driver)], injection)
    return injection


def _effects_of(
    fault: InjectedFault, wires: Sequence[Wire], drivers: Mapping[str, Driver[Any]]
) -> Iterator[tuple[Driver[Any], Effect]]:
    found = [wire for wire in wires if matches(fault.path, wire.path)]
    if found:
        for wire in found:
            yield wire.driver, _Binding(fault, wire).effect()
    elif fault.path in drivers:
        if fault.kind not in KINDS_OF_DRIVERS:
            raise DeclarationError(f"{fault.kind} is for objects; a whole driver has: {', '.join(KINDS_OF_DRIVERS)}")
        yield drivers[fault.path], _Binding(fault, None).effect()
    else:
        known = [*(wire.path for wire in wires), *drivers]
        what = "no object of the machine matches" if is_pattern(fault.path) else "there is no object or driver"
        raise DeclarationError(f"{what} {fault.path!r}{did_you_mean(fault.path, known)}")


class _Binding:
    """One fault on one wire (None: on a whole driver), with its amounts in raw integers."""

    def __init__(self, fault: InjectedFault, wire: Wire | None) -> None:
        self.fault, self.wire = fault, wire
        self.given = str(fault.amount)

    def effect(self) -> Effect:
        kind, fault, wire = self.fault.kind, self.fault, self.wire
        at, lasts = float(fault.at), float(fault.for_)
        about: dict[str, Any] = {"text": str(fault), "begin": at, "end": at + lasts}
        if wire is not None:
            about |= {"channel": wire.channel, "output": wire.item.direction is Direction.OUTPUT}
        if kind == "disconnect":
            return Effect(**about, loss="disconnected")
        if kind == "drop-out":
            return Effect(**about, loss="no answer", share=self._share())
        if kind == "delay":
            return Effect(**about, takes=seconds(self.given) if self.given else inf)
        if kind in ("exception", "wrong length"):
            return Effect(**about, mistake=kind == "exception", short=kind == "wrong length")
        assert wire is not None
        return self._of_levels(about, wire)

    def _of_levels(self, about: dict[str, Any], wire: Wire) -> Effect:
        """Return the effect of a fault that changes raw integers."""
        kind, binary = self.fault.kind, wire.item._has_states
        if kind == "stuck":
            return effects.Stuck(**about, given=self._level(wire) if self.given else None)
        if kind == "bit flip":
            return effects.BitFlip(**about, bit=self._bit(wire) if self.given else None)
        if kind == "out of range":
            return effects.Stuck(**about, given=self._no_state(wire) if binary else self._beyond(wire))
        if kind == "noise" and binary:
            share = self._share()
            return Effect(**about, change=lambda raw, since, random: raw ^ (random.random() < share))
        if binary:
            raise DeclarationError(f"{wire.path} is {wire.item._word}: it cannot {kind}")
        amount, shift = self._amount(wire)
        if kind == "noise":
            if amount < 0:
                raise DeclarationError(f"a standard deviation must not be negative: {self.given!r}")
            return Effect(**about, change=lambda raw, since, random: shift(raw, random.gauss(0.0, amount)))
        assert kind == "drift", kind
        return Effect(**about, change=lambda raw, since, random: shift(raw, amount * since))

    # Amounts -------------------------------------------------------------------------------------------

    def _number(self, what: str) -> tuple[float, str]:
        found = _AMOUNT.fullmatch(self.given)
        if found is None or abs(float(found[1])) > MAX_AMOUNT:
            raise DeclarationError(f"{self.given!r} is not {what}")
        return float(found[1]), found[2]

    def _share(self) -> float:
        if not self.given:
            return SHARES[self.fault.kind] / 100.0
        number, unit = self._number(what := 'a share; write for example "20 %"')
        if unit not in ("%", "percent") or not 0 <= number <= 100:
            raise DeclarationError(f"{self.given!r} is not {what}")
        return number / 100.0

    def _bit(self, wire: Wire) -> int:
        bits = wire.channel.bits
        if not self.given.isdecimal() or not int(self.given) < bits:
            raise DeclarationError(f"{self.given!r} is not a bit of channel {wire.channel.text!r}: 0 to {bits - 1}")
        return int(self.given)

    def _level(self, wire: Wire) -> int:
        item = wire.item
        if states := described(item).states:
            for number, state in states.items():
                raw = wire.nearest(number)
                if self.given.casefold() in (state.casefold(), str(raw)):
                    return raw
            raise DeclarationError(f"{self.given!r} is not a state of {item.path}: {' or '.join(states.values())}")
        amount, unit = self._number(f'a level; write for example "5 {item.units}"')  # type: ignore[attr-defined]
        level = amount if not unit else wire.nearest(convert(amount, unit, item.units))  # type: ignore[attr-defined]
        if round(level) != (nearest := limited(level, wire.channel)):
            raise DeclarationError(f"{self.given!r} is beyond {_carried(wire)}")
        return nearest

    def _difference(self, wire: Wire) -> tuple[float, bool]:
        """Return a difference of the object's values (and False), or of raw steps (and True)."""
        units: str = wire.item.units  # type: ignore[attr-defined]
        end = "/s" if self.fault.kind == "drift" else ""
        number, unit = self._number(what := f'an amount; write for example "5 {units}{end}", or "5{end}" for raw steps')
        if not unit.endswith(end):
            raise DeclarationError(f"{self.given!r} is not {what}")
        unit = unit.removesuffix(end).strip()
        return (convert(number, unit, units) - convert(0.0, unit, units), False) if unit else (number, True)

    def _amount(self, wire: Wire) -> tuple[float, Shift]:
        """Return a difference, and the function that adds it to a raw integer."""
        if not self.given:
            return PARTS[self.fault.kind] * (wire.calibration.maximum - wire.calibration.minimum), _by_value(wire)
        number, steps = self._difference(wire)
        return number, _by_steps(wire) if steps else _by_value(wire)

    def _beyond(self, wire: Wire) -> int:
        """Return a raw integer of the channel whose value is above the range. Without a given amount it lies a tenth of
        the range above, or as far as the channel allows."""
        if not self.given:  # of the electrical range
            low, high = wire.ends
            top, wanted = (
                to_raw(high, *wire.scale),
                to_raw(high + PARTS["out of range"] * (high - low), *wire.scale),
            )
            level = limited(wanted, wire.channel)
            if level == top or (level > top) is not (wanted > top):
                raise DeclarationError(f"{wire.path} has no level above its range in {_carried(wire)}")
            return level
        distance, steps = self._difference(wire)
        if distance <= 0:
            raise DeclarationError(f"a distance from the range must be above 0, not {self.given!r}")
        if steps:
            upwards = math.copysign(distance, wire.scale[0] * (wire.ends[1] - wire.ends[0]))
            wanted = wire.nearest(wire.calibration.maximum) + round(upwards)
        else:
            wanted = wire.nearest(wire.calibration.maximum + distance)
        if limited(wanted, wire.channel) != wanted:
            raise DeclarationError(f"{self.given!r} above the range is beyond {_carried(wire)}")
        return wanted

    def _no_state(self, wire: Wire) -> int:
        """Return a raw integer of a binary object's channel that is neither 0 nor 1."""
        if self.given:
            raise DeclarationError(f"{wire.path} is binary: its level beyond the range is 2, not {self.given!r}")
        if wire.channel.highest < 2:
            raise DeclarationError(f"{wire.path} has no level but 0 and 1 in channel {wire.channel.text!r}")
        return 2


def _carried(wire: Wire) -> str:
    """Return the channel as text, with the levels that it can have."""
    channel = wire.channel
    lowest, highest = limited(-inf, channel), limited(inf, channel)
    low, high = sorted((wire.value(lowest), wire.value(highest)))
    units = wire.item.units  # type: ignore[attr-defined]
    return f"channel {channel.text!r}: {span(low, high, units)} (raw {lowest} to {highest})"


def _by_value(wire: Wire) -> Shift:
    def by_value(raw: int, difference: float) -> int:
        return limited(wire.nearest(wire.value(raw) + difference), wire.channel)

    return by_value


def _by_steps(wire: Wire) -> Shift:
    def by_steps(raw: int, difference: float) -> int:
        return limited(raw + difference, wire.channel)

    return by_steps
