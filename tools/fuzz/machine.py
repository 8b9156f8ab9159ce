"""A machine whose parts are programs, connected to a circuit whose channels fail at will."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from functools import reduce
from types import MethodType, ModuleType
from typing import Any

import numpy as np

from tools.fuzz.stimuli import ACTUATORS, SENSORS, Stimulus
from tools.fuzz.verdict import same
from umo import Compound, DigitalSensor
from umo.cycle.connect import connect
from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.errors import ChannelsFailed, UmoError
from umo.generate.translation import ControllerLimit
from umo.objects import atoms
from umo.testing import VirtualTimer
from umo.wiring import resolve

PERIOD = "1 ms"
PATH = re.compile(r"\bparts\.(\d+)\.?(.*)")


class Group(Compound):
    """Each part fails alone."""

    parts: list[Compound]


class Machine(Group):
    timer: DigitalSensor


class Around(Compound):
    """A machine whose parts are on a controller."""

    timer: DigitalSensor
    group: Group


class Circuit(Driver):
    """Channels by the paths of objects: what they read, which cannot be read, which accept nothing."""

    def __init__(self) -> None:
        self.raws: dict[str, int] = {}
        self.cut: set[str] = set()
        self.deaf: set[str] = set()

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 64, signed=True)

    def initialize(self, channel: Channel, default: int | None) -> None:
        if default is not None:
            self.raws[channel.text] = default

    def reset(self, channel: Channel, default: int | None) -> None:
        self.initialize(channel, default)

    def read(self, channel: Channel) -> int:
        if channel.text in self.cut:
            raise ChannelsFailed({channel.text: "cut"})
        return self.raws.get(channel.text, 0)

    def write(self, channel: Channel, raw: int) -> None:
        self.raws[channel.text] = raw

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        out[:] = [self.raws.get(each.text, 0) for each in channels]
        if failed := self.cut.intersection(each.text for each in channels):
            raise ChannelsFailed(dict.fromkeys(failed, "cut"))

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        taken = zip(channels, raws.tolist(), strict=True)
        self.raws |= {each.text: raw for each, raw in taken if each.text not in self.deaf}
        if failed := self.deaf.intersection(each.text for each in channels):
            raise ChannelsFailed(dict.fromkeys(failed, "deaf"))


class Side:
    """A machine of the programs in these modules that is connected, in Python. Its laws can be told to fail."""

    def __init__(
        self, modules: Sequence[ModuleType], missed: Sequence[int], controller: Driver[Any] | None = None
    ) -> None:
        """`missed`: the ticks of the timer; `controller`: a driver that the parts run on."""
        self.modules, self.circuit = modules, Circuit()
        self.parts: list[Any] = [module.part() for module in modules]
        timer = DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False)
        clock = VirtualTimer(missed)
        of_timer = {"driver": "clock", "period": PERIOD}
        if controller is None:
            self.m: Any = Machine(timer=timer, parts=self.parts)
            wire = {each.path: {"driver": "box"} for each in atoms(self.m)} | {"timer": of_timer}
            drivers = {"box": self.circuit, "clock": clock}
        else:
            self.m = Around(timer=timer, group=Group(parts=self.parts))
            wire = {"group": {"controller": "box"}, "timer": of_timer}
            drivers = {"box": controller, "clock": clock}
        self.wired = resolve(self.m, {"drivers": drivers, "wire": wire})
        self.connection = connect(self.m, self.wired)
        self.limited: set[int] = set()
        """Parts whose laws are to end at a limit of the controller."""
        self.errors: dict[int, str] = {}
        """The class of the error of each law that failed in this period."""

    def __enter__(self) -> Side:
        self.connection.__enter__()
        self.numbers = {id(part): number for number, part in enumerate(self.parts)}
        self._places = {id(each): (n, name) for n, part in enumerate(self.parts) for name, each in vars(part).items()}
        return self

    def place(self, owner: Any, path: str) -> tuple[int, str]:
        """The number of the part that has an object, and its path in that; -1: none has it. `path` is that of the
        translation, which has only the class of what it found in a loop."""
        found = part_of(path)
        return self._places.get(id(owner), found) if found[0] < 0 else found

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(None, None, None)

    def observe(self) -> None:
        """From now on the errors of laws are kept, also of those that take their places."""
        laws = self.connection.machine.acting_laws
        replace = laws.replace

        def observing(new: Sequence[MethodType]) -> None:
            replace([MethodType(self._observed(law), law.__self__) for law in new])

        laws.replace = observing  # type: ignore[method-assign]
        observing(laws.of(self.m))

    def _observed(self, law: MethodType) -> Callable[[Any], None]:
        number = self.numbers[id(law.__self__)]

        def act(_: Any) -> None:
            try:
                law()
            except Exception as error:
                self.errors[number] = type(error).__name__
                if number not in self.limited:
                    raise
            if number in self.limited:
                raise ControllerLimit("a limit of the controller")

        return act

    def own(self, number: int, value: Any) -> Any:
        """A state as the member of the Enum of this part's module."""
        kind = getattr(self.modules[number], type(value).__name__, None)
        return kind[value.name] if isinstance(value, Enum) and kind is not None else value

    def give(self, given: Sequence[Stimulus]) -> None:
        """What the sensors read and which channels fail, by part."""
        circuit = self.circuit
        circuit.cut.clear()
        circuit.deaf.clear()
        for number, each in enumerate(given):
            for name, raw, failed in zip(SENSORS, each.raws, each.failed, strict=True):
                circuit.raws[f"parts.{number}.{name}"] = raw
                if failed:
                    circuit.cut.add(f"parts.{number}.{name}")
            circuit.deaf |= {f"parts.{number}.{name}" for name, deaf in zip(ACTUATORS, each.deaf, strict=True) if deaf}

    def step(self) -> str | None:
        """One period; the class of an error that no part has contained."""
        self.errors.clear()
        self.m.timer.read()
        try:
            self.m.sample()
            self.m.control()
            self.m.update()
        except UmoError as error:
            return type(error).__name__
        return None

    def clear(self, number: int) -> bool:
        """Whether the fault of a part could be ended."""
        try:
            self.connection.machine.equipment.clear(self.parts[number])
        except UmoError:
            return False
        return True

    def in_fault(self, number: int) -> bool:
        return self.parts[number].cycle.fault is not None

    def at(self, path: str) -> Any:
        """The object at a path; None: there is none."""
        found = self.m
        for part in filter(None, path.split(".")):
            found = found[int(part)] if part.isdigit() else getattr(found, part, None)
        return found

    def inhibited(self, slot: int) -> bool:
        return self.connection.machine.claims.inhibited(slot) is not None

    def set(self, number: int, name: str, value: Any) -> None:
        """An attribute of a part, or, as in `part.gain`, of an object in it."""
        *path, last = name.split(".")
        setattr(reduce(getattr, path, self.parts[number]), last, value)


def restored(owner: Any, name: str, value: Any) -> None:
    """A list stays the one that it is, and what is the same the attribute of its class. An array is a new one: that of
    Python may have other names, or complex numbers, since the two went apart."""
    kept = getattr(owner, name)
    if isinstance(kept, np.ndarray):
        setattr(owner, name, np.array(value))
    elif isinstance(kept, list):
        kept[:] = value
    elif not same(kept, value):
        setattr(owner, name, value)


def refilled(held: deque[Any], elements: Iterable[Any]) -> None:
    """A deque stays the one that it is, with these elements."""
    held.clear()
    held.extend(elements)


def part_of(path: str) -> tuple[int, str]:
    """The number of the part that an object is in, and its path in that; -1: it is in none."""
    found = PATH.search(path)
    return (int(found[1]), found[2]) if found else (-1, path)
