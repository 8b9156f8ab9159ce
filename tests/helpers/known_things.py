"""A machine whose control code reads everything that is no tracked number, in the ways in which it may be set.

It is loaded anew for each machine (`loaded`): what one sets, in its module or its classes, is no other's.
"""

from __future__ import annotations

import importlib.util
import sys
from abc import ABC
from collections import deque
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import numpy as np

from umo import Compound, DigitalActuator, DigitalSensor, Number
from umo.states import OnOff

LIMIT = 1.0
NAMES = ["a", "b"]
GAINS = np.array([1.0, 2.0])


class Defaults(ABC):  # noqa: B024
    label = "slow"


class OtherDefaults(ABC):  # noqa: B024
    label = "fast"


class Settings(Defaults):
    limit = 2.0

    def __init__(self) -> None:
        self.kind = "first"


class Slotted:
    __slots__ = ("kind",)

    def __init__(self) -> None:
        self.kind = "first"


def kept(start: float) -> tuple[Callable[[], float], Callable[[float], None]]:
    """A number in a cell: what reads it, and what sets it."""
    offset = start

    def read() -> float:
        return offset

    def write(value: float) -> None:
        nonlocal offset
        offset = value

    return read, write


read_offset, write_offset = kept(0.5)


def set_limit(value: float) -> None:
    global LIMIT
    LIMIT = value


def scaled(value: float, scale: float = 2.0, *, more: float = 0.25) -> float:
    return value * scale + more


def other(value: float, scale: float = 2.0, *, more: float = 0.25) -> float:
    return value - scale + more


def named(name: str, names: Any = ("x", ["y"])) -> float:
    return 1.0 if name in names[1] else 0.0


class Tank(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    a: DigitalActuator
    b: DigitalActuator
    PV: Annotated[float, Number("mm", 0.0, 100.0, tunable=True)] = 3.0
    bias: Annotated[float, Number("mm", 0.0, 100.0, tunable=True)] = 1.5
    factor = 2.0
    mode_of_class = "slow"

    def setup(self) -> None:
        self.mode_name: Any = "heat"
        self.target: Any = None
        self.active = self.a
        self.enabled = [self.b]
        self.allowed: Any = {"a"}
        self.recent: Any = deque(["a"])
        self.setpoints: Any = {"heater": 1.0}
        self.settings = Settings()
        self.slotted = Slotted()
        self.nested: Any = [[1.0, "x"], [2.0, "y"]]
        self.state: Any = OnOff.ON
        self.plain = 1.0
        self.table: Any = [1.0, 2.0]
        self.weights: Any = np.array([1.0, 2.0])
        self.total = 0.0
        self.mine: Any = [0.0, 0.0]
        self.spare: Any = None

    @property
    def mode(self) -> float:
        return 3.0 if self.mode_name == "heat" else 5.0

    def part(self) -> float:
        return 0.125

    def control(self) -> None:
        total = LIMIT + self.factor + self.PV + getattr(self, "bias") + self.mode + self.part()  # noqa: B009
        total += read_offset() + scaled(self.plain) + named("y") + max(self.plain, 0.5)
        if self.target is not None:
            total += self.target
        if "a" in self.allowed:
            total += 10.0
        if "a" in self.recent:
            total += 40.0
        if "b" in NAMES:
            total += 20.0
        total += self.setpoints["heater"] + self.settings.limit + self.nested[1][0] + GAINS[1]
        if self.settings.kind == "first" and self.slotted.kind == "first":
            total += 100.0
        if self.mode_of_class == "slow" and self.settings.label == "slow" and self.nested[1][1] == "y":
            total += 200.0
        if hasattr(self, "extra"):
            total += 400.0
        if self.state is OnOff.ON:
            total += 0.5
        total += self.table[1] + float(self.weights[0])
        self.table[0] = float(total)
        self.total += total
        for each in self.enabled:
            each.write(-total)
        self.active.write(total)


def tank() -> Tank:
    """The machine, of a module of its own."""

    def actuator() -> DigitalActuator:
        return DigitalActuator("mm", default=0.0, minimum=-1e4, maximum=1e4, resolution=0.001)

    return Tank(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99999, resolution=1, synchronous=False),
        level=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.5),
        a=actuator(),
        b=actuator(),
    )


_numbers = count()


def loaded() -> ModuleType:
    """This module anew, under a name of its own."""
    spec = importlib.util.spec_from_file_location(f"known_things_{next(_numbers)}", Path(__file__))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    spec.loader.exec_module(module)
    return module


# Ways to set it ----------------------------------------------------------------------------------------------


def _function_of_other_code(module: Any, m: Any) -> None:
    module.scaled.__code__ = module.other.__code__


def _augmented(module: Any, m: Any) -> None:
    m.mode_name += "ing"


def _deleted(module: Any, m: Any) -> None:
    del m.mode_name


def _deleted_number(module: Any, m: Any) -> None:
    del m.plain


def _deleted_global(module: Any, m: Any) -> None:
    del module.LIMIT


def _deleted_item(module: Any, m: Any) -> None:
    del m.setpoints["heater"]


def _other_dict(module: Any, m: Any) -> None:
    m.settings.__dict__ = {"kind": "second"}


def _other_class(module: Any, m: Any) -> None:
    m.settings.__class__ = type("Settings", (), {"limit": 7.0, "label": "fast"})


def _other_bases(module: Any, m: Any) -> None:
    module.Settings.__bases__ = (module.OtherDefaults,)


def _set_and_asked_for(module: Any, m: Any) -> None:
    """An abstract class looks at each class below it when it is asked for an object of another class."""
    module.Settings.limit = 6.5
    isinstance(type("Another", (), {})(), module.Defaults)


def _new_settings(module: Any, m: Any) -> None:
    m.settings = module.Settings()
    m.settings.limit = 9.0


def _shadowed(module: Any, m: Any) -> None:
    module.max = min


def _swapped(module: Any, m: Any) -> None:
    """An attribute less and one more: their number is the same."""
    m.spare = 1
    del m.spare
    vars(m)["part"] = lambda: 4.0


def _element(module: Any, m: Any) -> None:
    m.table[1] = 6.0


def _shared_list(module: Any, m: Any) -> None:
    shared = [3.0, 4.0]
    m.table = shared
    shared[1] = 5.0


def _kept_list(module: Any, m: Any) -> None:
    m.mine = m.table = [3.0, 4.0]


def _kept_array(module: Any, m: Any) -> None:
    m.mine = m.weights = np.array([3.0, 4.0])


def _changed_later(module: Any, m: Any) -> None:
    """What was set before is had by others as well."""
    m.mine[0], m.mine[1] = 8.0, 9.0


def _shared_array(module: Any, m: Any) -> None:
    shared = np.array([3.0, 4.0])
    m.weights = shared
    shared[0] = 5.0


def _class_by_object(module: Any, m: Any) -> None:
    type(m).mode_of_class = "fast"


def _number_of_class_by_object(module: Any, m: Any) -> None:
    type(m).factor = 11.0


WAYS: dict[str, Callable[[Any, Any], object]] = {
    "text": lambda module, m: setattr(m, "mode_name", "off"),
    "text, augmented": _augmented,
    "text, deleted": _deleted,
    "text, in __dict__": lambda module, m: vars(m).update(mode_name="off"),
    "text, by object": lambda module, m: object.__setattr__(m, "mode_name", "off"),
    "None, then a number": lambda module, m: setattr(m, "target", 7.0),
    "reference": lambda module, m: setattr(m, "active", m.b),
    "list, inserted": lambda module, m: m.enabled.insert(0, m.a),
    "list, emptied": lambda module, m: m.enabled.clear(),
    "list, element": lambda module, m: m.enabled.__setitem__(0, m.a),
    "list, replaced": lambda module, m: setattr(m, "enabled", [m.a]),
    "set": lambda module, m: m.allowed.discard("a"),
    "set, replaced": lambda module, m: setattr(m, "allowed", frozenset()),
    "deque": lambda module, m: m.recent.append("b") or m.recent.popleft(),
    "dict, item": lambda module, m: m.setpoints.update(heater=9.0),
    "dict, deleted": _deleted_item,
    "dict, replaced": lambda module, m: setattr(m, "setpoints", {"heater": 8.0}),
    "object, replaced": _new_settings,
    "object, field": lambda module, m: setattr(m.settings, "kind", "second"),
    "object, field of its class": lambda module, m: setattr(m.settings, "limit", 4.0),
    "object, other __dict__": _other_dict,
    "object, other class": _other_class,
    "class of an object, number, then asked for": _set_and_asked_for,
    "class of an object, other bases": _other_bases,
    "object, slot": lambda module, m: setattr(m.slotted, "kind", "second"),
    "class of an object, number": lambda module, m: setattr(module.Settings, "limit", 6.0),
    "class of an object, text": lambda module, m: setattr(module.Settings, "label", "fast"),
    "class, text": lambda module, m: setattr(module.Tank, "mode_of_class", "fast"),
    "class, number": lambda module, m: setattr(module.Tank, "factor", 4.0),
    "class by its object, text": _class_by_object,
    "class by its object, number": _number_of_class_by_object,
    "nested text": lambda module, m: m.nested[1].__setitem__(1, "z"),
    "nested number": lambda module, m: m.nested[1].__setitem__(0, 9.0),
    "nested list": lambda module, m: m.nested.reverse(),
    "global": lambda module, m: setattr(module, "LIMIT", 4.0),
    "global, by its module": lambda module, m: module.set_limit(5.0),
    "global, in __dict__": lambda module, m: vars(module).update(LIMIT=6.0),
    "global, deleted": _deleted_global,
    "global list": lambda module, m: module.NAMES.remove("b"),
    "global array": lambda module, m: module.GAINS.__setitem__(1, 5.0),
    "name of Python": _shadowed,
    "cell": lambda module, m: module.write_offset(3.0),
    "default": lambda module, m: setattr(module.scaled, "__defaults__", (3.0,)),
    "default by name": lambda module, m: module.scaled.__kwdefaults__.update(more=4.0),
    "default, changed in place": lambda module, m: module.named.__defaults__[0][1].clear(),
    "code": _function_of_other_code,
    "function": lambda module, m: setattr(module, "scaled", module.other),
    "method": lambda module, m: setattr(module.Tank, "part", lambda self: 2.0),
    "method of an object": lambda module, m: setattr(m, "part", lambda: 3.0),
    "method of an object, in __dict__": _swapped,
    "property": lambda module, m: setattr(module.Tank, "mode", property(lambda self: 6.0)),
    "upper case": lambda module, m: setattr(m, "PV", 8.0),
    "new attribute": lambda module, m: vars(m).update(extra=True),
    "new attribute of the class": lambda module, m: setattr(module.Tank, "extra", True),
    "state": lambda module, m: setattr(m, "state", OnOff.OFF),
    "state, then a text": lambda module, m: setattr(m, "state", "on"),
    "number": lambda module, m: setattr(m, "plain", 3.0),
    "number, in __dict__": lambda module, m: vars(m).update(plain=4.0),
    "number, deleted": _deleted_number,
    "number by getattr": lambda module, m: setattr(m, "bias", 4.0),
    "element of a list": _element,
    "list of another": _shared_list,
    "array of another": _shared_array,
    "list that others have": _kept_list,
    "array that others have": _kept_array,
    "in what others have": _changed_later,
    "element of an array": lambda module, m: m.weights.__setitem__(0, 7.0),
}
"""What is set, by name: of a module and its machine."""
