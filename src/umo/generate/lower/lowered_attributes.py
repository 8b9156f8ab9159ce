"""Attributes of live objects: fields of structs, known values, and results of the runtime."""

from __future__ import annotations

import ast
from dataclasses import replace
from enum import Enum
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from umo.control.axis import Axis
from umo.cycle.clock import Clock
from umo.cycle.machine_view import MachineView
from umo.cycle.rate_groups import PartClock
from umo.drivers.contract import Direction
from umo.generate.c_types import (
    INT,
    NOTHING,
    REAL,
    ArrayType,
    CType,
    perhaps_of_numpy,
    plain,
    state,
)
from umo.generate.form import Literal, Object, OfObject, Runtime, Value, WholeMachine
from umo.generate.lower.live_fields import MOST_INT
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Known, NullTest, Term
from umo.generate.translation import Untranslatable
from umo.generate.value_kinds import NUMPY_NUMBERS, attribute_kind, is_plain_record, is_ring, static_attribute
from umo.objects import Compound, DigitalSensor, Quality, Vector
from umo.objects.atomic import Atomic, Binary, Digital
from umo.objects.link import Cycle

DROPPED = ("progress", "say")
"""Names of methods that only make texts."""
OF_THE_HOST = ("sample", "update", "reset", "acknowledge", "control")
"""Names of methods of a part that only the host calls."""
OF_CLOCK = {"dt": REAL, "now": REAL, "period": REAL, "ticks": INT}
"""The attributes of a clock, with their types."""


class LoweredAttributes(LoweredSubject):
    """Lowers the attributes of a function."""

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term:
        owner = base.value
        self.f.texts.check_decided(base, node)
        if is_ring(owner):
            return self.f.rings.attribute(base, name, node)
        if isinstance(owner, Atomic):
            return self._of_atomic(owner, name, node)
        if isinstance(owner, Vector):
            self.object(owner[0], node)
            return self.f.vectors.attribute_of_vector(owner, name, node)
        if isinstance(owner, ModuleType | type):
            return self._known(owner, name, node)
        if isinstance(owner, Clock | Cycle):
            return self._of_time(owner, name, node)
        if isinstance(owner, MachineView) and name == "clock":
            return Known(owner.clock)
        if isinstance(owner, Compound):
            if name in OF_THE_HOST and name in vars(owner) | vars(Compound):
                raise self.f.refused(
                    node, f"`{name}` of a part is carried out by the host", "read, write, reset of an object"
                )
            if name in ("dt", "now"):
                return _of_clock(owner._machine.clock, name)
            if name == "cycle":
                return Known(owner.cycle)
        if (
            not isinstance(owner, ModuleType | type)
            and type(owner).__module__ in ("builtins",)
            and not hasattr(owner, "__dict__")
        ):
            return Known(self._got(owner, name, node), owner, name)
        if isinstance(owner, Enum):
            return self._of_state(owner, name, node)
        if isinstance(owner, tuple) and name in getattr(owner, "_fields", ()) and is_plain_record(type(owner)):
            return Known(getattr(owner, name), owner, name)
        found = attribute_kind(owner, name)
        if found == "property":
            self.f.takes(type(owner), name, node)
            return self.f.calls.function(static_attribute(type(owner), name).fget, [base], {}, node)
        if found == "function":
            return self._known(owner, name, node)
        if found != "value":
            raise self.f.refused(node, found, "an attribute, a property or a method")
        return self.field(owner, name, base, node)

    def _of_state(self, owner: Enum, name: str, node: ast.AST) -> Term:
        static = static_attribute(type(owner), name)
        if type(static) is property and static.fget is not None:
            self.f.takes(type(owner), name, node)
            return self.f.calls.function(static.fget, [Known(owner)], {}, node)
        if name not in ("name", "value") and not isinstance(static, FunctionType | staticmethod | classmethod | Enum):
            raise self.f.refused(
                node, f"the attribute {name!r} of a state cannot be translated", "value, name, a method, a property"
            )
        return self._known(owner, name, node)

    def field(self, owner: Any, name: str, base: Known, node: ast.AST) -> Term:
        """Return a field if the attribute is a number, otherwise a known value."""
        memory = self.f.world.memory
        if (id(owner), name) in memory.texts and not memory.is_text_state(owner, name):
            return Known(memory.shown_text(owner, name))
        value = self._got(owner, name, node)
        if isinstance(value, FunctionType | MethodType | BuiltinFunctionType | partial):
            if asks_host(owner, name):
                return Known(value, owner, name)
            raise self.f.refused(node, f"{name} is a function stored as an attribute of an object", "a method")
        if isinstance(value, np.generic) and not isinstance(value, NUMPY_NUMBERS):
            raise self.f.refused(node, f"{name} is a {type(value).__name__} of numpy", "float(...), np.float64")
        of = self.f.world.fields.type_of(owner, name, value)
        if of is None or of == NOTHING:
            if (id(owner), name) in self.f.world.memory.assigned and of is None:
                raise self.f.refused(
                    node, "it is assigned, and is not a number or a state", "numbers, states, tuples of numbers"
                )
            if _is_record_of_numbers(value) and self.f.world.fields.type_of_value(value) is None:
                told = f"{name} has a value of another class than {type(value).__name__} declares"
                raise self.f.refused(node, told, "0.0 instead of 0, float(...)")
            if hasattr(value, "__dict__"):
                self.f.world.fields.known(value, self._path(owner, base, name))
            found = self._known(owner, name, node)
            return replace(found, name=self._path(owner, base, name)) if is_ring(value) else found
        self.f.takes_class(owner, name, node)
        if type(value) is int and abs(value) > MOST_INT:
            raise self.f.refused(node, f"{name} is {value}, and does not fit 32 bits", "a smaller number, or a float")
        if (id(owner), name) in memory.of_numpy or isinstance(value, np.generic):
            of = perhaps_of_numpy(of)
        place = self.f.world.fields.field(owner, name, of, self._path(owner, base, ""))
        if isinstance(plain(of), ArrayType) and value is not None:
            self._check_numbers(value, name, node)
        self.f.world.memory.place_arrays(place, value)
        return Code(of, place)

    def _check_numbers(self, value: Any, name: str, node: ast.AST) -> None:
        """Refuse an array or a list with numbers that do not fit, or with states or tuples of other classes."""
        numbers = value.tolist() if isinstance(value, np.ndarray) else value
        if any(type(each) is int and abs(each) > MOST_INT for each in numbers):
            raise self.f.refused(node, f"{name} has a number that does not fit 32 bits", "smaller numbers, or floats")
        if len({type(each) for each in numbers}) > 1:
            raise self.f.refused(node, f"{name} has values of several classes", "one class for all elements")

    def _path(self, owner: Any, base: Known, name: str) -> str:
        path = self.f.world.fields.known(owner, base.name or type(owner).__name__).path
        return f"{path}.{name}".strip(".") if name else path

    def _known(self, owner: Any, name: str, node: ast.AST) -> Known:
        """Return an attribute that is taken as known. The machine around a part differs between runs."""
        value = self._got(owner, name, node)
        if not (isinstance(owner, Compound) and name == "_machine") and not _is_of_cycle(owner):
            self.f.takes(owner, name, node)
        return Known(value, owner, name)

    def _got(self, owner: Any, name: str, node: ast.AST) -> Any:
        try:
            return getattr(owner, name)
        except AttributeError:
            told = f"{type(owner).__name__} has no {name!r} now"
        raise self.f.refused(node, told, "give it a value in `setup`")

    def _of_time(self, owner: Any, name: str, node: ast.AST) -> Term:
        if name in OF_CLOCK:
            return _of_clock(owner if isinstance(owner, Clock) else owner._machine.clock, name)
        if isinstance(owner, Cycle) and name in DROPPED:
            return Known(dropped)
        nearest = "dt, now, cycle.period"
        raise self.f.refused(node, f"`{name}` of the cycle is not known on a controller", nearest)

    def _of_atomic(self, owner: Atomic, name: str, node: ast.AST) -> Term:
        place = self.object(owner, node)
        if name == "time":
            self.check_in_c(name, node)
            return Code(REAL, Runtime("umo_time", (place,)))
        if name == "quality":
            return Code(state(Quality), Runtime("umo_quality", (place,)))
        if name == "inhibited":
            return NullTest(Runtime("umo_inhibited", (place,)))
        if name == "raw":
            return Code(INT, Runtime("umo_raw", (place,)))
        if name == "pending":
            if isinstance(owner, Binary):
                return Code(state(owner.states), Runtime("umo_pending_state", (place,)))
            return Code(REAL, Runtime("umo_pending", (place,)))
        if name == "velocity":
            return self.got_by("umo_velocity", place, of=REAL)
        if isinstance(owner, DigitalSensor) and owner.incremental:  # homing changes it
            if name == "zero_offset":
                self.check_in_c(name, node)
                return Code(REAL, OfObject(place, "zero_offset"))
            if name == "calibration":
                raise self.f.refused(node, "homing changes it", "minimum, maximum, resolution, zero_offset")
        return self._known(owner, name, node)

    def check_in_c(self, name: str, node: ast.AST) -> None:
        """Refuse an attribute of an object if Python evaluates it when laws are compiled."""
        if self.f.world.target.makes_texts:
            raise self.f.refused(
                node,
                f"`{name}` of an object is evaluated by Python where laws are compiled",
                "read, write, quality, pending",
            )

    def object(self, owner: Atomic, node: ast.AST) -> Value:
        """Return the object. A note is added for an asynchronous sensor, because a controller does not read it."""
        if not isinstance(owner, Binary | Digital):
            raise self.f.refused(
                node, f"a {type(owner).__name__} cannot be translated", "a binary object, or a digital one"
            )
        if owner.direction is Direction.INPUT and not owner.synchronous:
            told = f"{owner.path} is asynchronous: it is not read on a controller"
            at = self.f.source.file, getattr(node, "lineno", 0), self.f.source.segment(node)
            self.f.world.on_host.append(Untranslatable(*at, told, "a synchronous sensor"))
        return Object(owner._slot)

    def got_by(self, function: str, *arguments: Value, of: CType) -> Code:
        """Return the result of a runtime function that may fail."""
        name = self.f.temporary(of)
        self.f.called(function, *arguments, out=name)
        return Code(of, name)


def _is_record_of_numbers(value: Any) -> bool:
    return isinstance(value, tuple) and hasattr(value, "_fields") and {*map(type, value)} <= {int, float, bool}


def _of_clock(clock: Any, name: str) -> Code:
    """Return an attribute of a clock: of the machine's, or of that of parts with a rate of their own."""
    of = OF_CLOCK[name]
    if name == "now" or not isinstance(clock, PartClock):
        return Code(of, Runtime(f"umo_{name}", (WholeMachine(),)))
    if name == "period":
        return Code(of, Literal(clock.period, of))
    return Code(of, Runtime(f"umo_group_{name}", (WholeMachine(), Literal(clock.group, INT))))


def _is_of_cycle(owner: Any) -> bool:
    return type(owner).__module__.startswith("umo.cycle.")


def asks_host(owner: Any, name: str) -> bool:
    """True if this attribute is a function that only the host can call, because the function plans motions."""
    return isinstance(owner, Axis) and name == "_replan"


def dropped(*_: object) -> None:
    """Add nothing, because the statement only makes a text."""
