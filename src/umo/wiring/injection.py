"""Injected faults in words: `PATH KIND [amount] [at TIME] [for TIME]`, read and bound to the wires of a machine."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from umo.drivers import _effects
from umo.drivers._effects import Effect, Shift, limited
from umo.drivers.contract import Direction, Driver
from umo.drivers.faulty import Faulty, Injection
from umo.errors import DeclarationError
from umo.objects.atomic import Binary
from umo.objects.scaling import to_raw
from umo.objects.units import convert, seconds
from umo.text import did_you_mean
from umo.wiring.patterns import is_pattern, matches
from umo.wiring.resolved import Wire

KINDS = {
    "stuck": "[LEVEL]",
    "noise": "[DEVIATION]",
    "drift": "[RATE]",
    "bit flip": "[BIT]",
    "delay": "[TIME]",
    "drop-out": "[SHARE]",
    "disconnect": "",
    "exception": "",
    "wrong length": "",
    "out of range": "[DISTANCE]",
}
"""Each kind with its amount."""
OF_DRIVERS = ("delay", "drop-out", "disconnect", "exception")
FORM = "PATH KIND [amount] [at TIME] [for TIME]"
_TEXT = re.compile(r"(?P<head>.*?)(?:\s+at\s+(?P<at>.+?))?(?:\s+for\s+(?P<for>.+?))?", re.DOTALL)
_AMOUNT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
SHARES = {"noise": 10.0, "drop-out": 50.0}
"""Percent, where nothing is given."""
PART = {"noise": 0.01, "drift": 0.01, "out of range": 0.1}
"""Of the object's range, where nothing is given; drift: in a second."""


@dataclass(frozen=True)
class InjectedFault:
    """A fault that is injected on purpose: `InjectedFault("z.encoder", "noise", "20 um", at=1.0, for_=2.0)`.

    `str` gives it in words, as wirings and `umo run --fault` take it: "z.encoder noise 20 um at 1 s for 2 s".
    DeclarationError for a kind, an amount or a time that is not one.
    """

    path: str
    """An object's path, a pattern of paths, or the name of a driver."""
    kind: str
    """One of `KINDS`."""
    amount: str | float = ""
    """With a unit: in the units of the object. A number alone: raw steps. Empty: the kind's default."""
    at: float | str = 0.0
    """When it begins: s, or a text such as "30 ms"."""
    for_: float | str = inf
    """How long it lasts. Default: to the end of the run."""

    def __post_init__(self) -> None:
        amount = _shown(self.amount) if isinstance(self.amount, int | float) else " ".join(self.amount.split())
        ends = self.for_ == inf
        set_ = object.__setattr__  # frozen
        set_(self, "kind", _kind(self.kind))
        set_(self, "amount", amount)
        set_(self, "at", seconds(self.at))
        set_(self, "for_", inf if ends else seconds(self.for_))
        if not self.path or len(self.path.split()) != 1:
            raise DeclarationError(f"{self.path!r} is not a path")
        if amount and not KINDS[self.kind]:
            raise DeclarationError(f"{self.kind} has no amount, not {amount!r}")
        if self.for_ == 0:
            raise DeclarationError("a fault lasts longer than 0 s")

    @classmethod
    def parse(cls, text: str) -> InjectedFault:
        """The fault that a text describes."""
        found = _TEXT.fullmatch(text.strip())
        head = found["head"].split() if found else []
        if found is None or len(head) < 2:
            raise DeclarationError(f"is not {FORM}, such as 'z.encoder stuck at 5 s'")
        path, *words = head
        count = next((n for n in (3, 2) if _plain(" ".join(words[:n])) in map(_plain, KINDS)), 1)
        return cls(
            path,
            " ".join(words[:count]),
            " ".join(words[count:]),
            0.0 if found["at"] is None else found["at"],
            inf if found["for"] is None else found["for"],
        )

    def __str__(self) -> str:
        words = [self.path, self.kind, str(self.amount)]
        if self.at:
            words.append(f"at {_shown(self.at)} s")
        if self.for_ != inf:
            words.append(f"for {_shown(self.for_)} s")
        return " ".join(filter(None, words))


def _shown(number: object) -> str:
    """The shortest text of a number that is read as the same one."""
    return repr(number).removesuffix(".0")


def _plain(kind: str) -> str:
    return kind.lower().replace("-", " ").replace("_", " ")


def _kind(kind: str) -> str:
    found = next((known for known in KINDS if _plain(known) == _plain(kind)), None)
    if found is None:
        raise DeclarationError(f"no kind {kind!r}{did_you_mean(kind, KINDS)}; the kinds are: {', '.join(KINDS)}")
    return found


def inject(
    faults: Sequence[InjectedFault | str],
    seed: int,
    wires: Sequence[Wire],
    drivers: Mapping[str, Driver[Any]],
    waits: bool,
    report: Callable[[str], None],
) -> Injection:
    """Put the faults between the machine and its drivers; `report` is told what is wrong with them.

    `drivers` by name. The drivers concerned are found in `Injection.drivers`.
    """
    texts: list[str] = []
    effects: dict[int, list[Effect]] = {}
    for given in faults:
        try:
            if not isinstance(given, InjectedFault | str):
                raise DeclarationError(f"is not a text: {FORM}")
            fault = InjectedFault.parse(given) if isinstance(given, str) else given
            for driver, effect in _effects_of(fault, wires, drivers, waits):
                effects.setdefault(id(driver), []).append(effect)
            texts.append(str(fault))
        except DeclarationError as error:
            report(f"fault {str(given)!r}: {error}")
    injection = Injection(texts, seed)
    for driver in drivers.values():
        if id(driver) in effects:
            Faulty(driver, effects[id(driver)], injection)
    return injection


def _effects_of(
    fault: InjectedFault, wires: Sequence[Wire], drivers: Mapping[str, Driver[Any]], waits: bool
) -> Iterator[tuple[Driver[Any], Effect]]:
    found = [wire for wire in wires if matches(fault.path, wire.item.path)]
    if found:
        for wire in found:
            yield wire.driver, _Binding(fault, wire, waits).effect()
    elif fault.path in drivers:
        if fault.kind not in OF_DRIVERS:
            raise DeclarationError(f"{fault.kind} is for objects; a whole driver has: {', '.join(OF_DRIVERS)}")
        yield drivers[fault.path], _Binding(fault, None, waits).effect()
    else:
        known = [*(wire.item.path for wire in wires), *drivers]
        what = "no object of the machine matches" if is_pattern(fault.path) else "no object or driver"
        raise DeclarationError(f"{what} {fault.path!r}{did_you_mean(fault.path, known)}")


class _Binding:
    """One fault on one wire (None: on a whole driver): its numbers in raw integers."""

    def __init__(self, fault: InjectedFault, wire: Wire | None, waits: bool) -> None:
        self.fault, self.wire, self.waits = fault, wire, waits
        self.given = str(fault.amount)

    def effect(self) -> Effect:
        kind, fault, wire = self.fault.kind, self.fault, self.wire
        at, lasts = float(fault.at), float(fault.for_)
        about: dict[str, Any] = {"text": str(fault), "begin": at, "end": at + lasts}
        if wire is not None:
            about |= {"channel": wire.channel, "output": wire.item.direction is Direction.OUTPUT}
        plain = {
            "disconnect": _effects.Disconnect,
            "exception": _effects.DriverMistake,
            "wrong length": _effects.WrongLength,
        }
        if kind in plain:
            return plain[kind](**about)
        if kind == "delay":
            return _effects.Delay(**about, duration=seconds(self.given) if self.given else inf, waits=self.waits)
        if kind == "drop-out":
            return _effects.DropOut(**about, share=self._share())
        assert wire is not None
        return self._of_levels(about, wire)

    def _of_levels(self, about: dict[str, Any], wire: Wire) -> Effect:
        """A fault that changes raw integers."""
        kind, binary = self.fault.kind, isinstance(wire.item, Binary)
        if kind == "stuck":
            return _effects.Stuck(**about, given=self._level(wire) if self.given else None)
        if kind == "bit flip":
            return _effects.BitFlip(**about, bit=self._bit(wire) if self.given else None)
        if kind == "out of range":
            return _effects.OutOfRange(**about, level=2 if binary else self._beyond(wire))
        if kind == "noise" and binary:
            return _effects.Chatter(**about, share=self._share())
        if binary:
            raise DeclarationError(f"{wire.item.path} is binary: it cannot {kind}")
        amount, shift = self._amount(wire)
        if kind == "noise":
            if amount < 0:
                raise DeclarationError(f"a standard deviation is not negative: {self.given!r}")
            return _effects.Noise(**about, deviation=amount, shift=shift)
        return _effects.Drift(**about, rate=amount, shift=shift)

    # Amounts -------------------------------------------------------------------------------------------

    def _number(self, what: str) -> tuple[float, str]:
        found = _AMOUNT.fullmatch(self.given)
        if found is None or not isfinite(float(found[1])):
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
        if isinstance(item, Binary):
            for raw in (0, 1):
                state = item.one if raw != wire.inverted else item.zero
                if self.given.casefold() in (state.name.casefold(), str(raw)):
                    return raw
            raise DeclarationError(f"{self.given!r} is not a state of {item.path}: {item.zero.name} or {item.one.name}")
        number, unit = self._number(f'a level; write for example "5 {item.units}"')  # type: ignore[attr-defined]
        level = number if not unit else wire.nearest(convert(number, unit, item.units))  # type: ignore[attr-defined]
        return limited(level, wire.channel)

    def _difference(self, wire: Wire) -> tuple[float, bool]:
        """A difference of the object's values, or of raw steps (True)."""
        units: str = wire.item.units  # type: ignore[attr-defined]
        end = "/s" if self.fault.kind == "drift" else ""
        number, unit = self._number(what := f'an amount; write for example "5 {units}{end}", or "5{end}" for raw steps')
        if not unit.endswith(end):
            raise DeclarationError(f"{self.given!r} is not {what}")
        unit = unit.removesuffix(end).strip()
        return (convert(number, unit, units) - convert(0.0, unit, units), False) if unit else (number, True)

    def _amount(self, wire: Wire) -> tuple[float, Shift]:
        """A difference, and how it is added to a raw integer."""
        assert wire.calibration is not None
        if not self.given:
            return PART[self.fault.kind] * (wire.calibration.maximum - wire.calibration.minimum), _by_value(wire)
        number, steps = self._difference(wire)
        return number, _by_steps(wire) if steps else _by_value(wire)

    def _beyond(self, wire: Wire) -> int:
        """A raw integer whose value is above the range, also if the channel cannot have it."""
        assert wire.calibration is not None
        if not self.given:  # of the electrical range
            low, high = wire.ends
            return to_raw(high + PART["out of range"] * (high - low), *wire.scale)
        distance, steps = self._difference(wire)
        if distance <= 0:
            raise DeclarationError(f"a distance from the range is above 0, not {self.given!r}")
        if not steps:
            return wire.nearest(wire.calibration.maximum + distance)
        return wire.nearest(wire.calibration.maximum) + round(
            math.copysign(distance, wire.scale[0] * (wire.ends[1] - wire.ends[0]))
        )


def _by_value(wire: Wire) -> Shift:
    def by_value(raw: int, difference: float) -> int:
        return limited(wire.nearest(wire.value(raw) + difference), wire.channel)

    return by_value


def _by_steps(wire: Wire) -> Shift:
    def by_steps(raw: int, difference: float) -> int:
        return limited(raw + difference, wire.channel)

    return by_steps
