"""Calls and attributes: of umo's objects, of Python's own functions, of functions that are translated too."""

from __future__ import annotations

import ast
import inspect
import logging
import math
import typing
from collections.abc import Callable, Sequence
from enum import Enum
from functools import cached_property, partial
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from umo.control.inputs import state_of, value_of
from umo.control.profile import Profile
from umo.cycle.clock import Clock
from umo.drivers.contract import Direction
from umo.errors import RangeError, StateError
from umo.generate.array_code import ArrayMethod
from umo.generate.c_types import BOOL, INT, MASK, NOTHING, REAL, ArrayType, CType, TupleType, numpy_number, state
from umo.generate.expression_code import NUMBERS
from umo.generate.function_scope import TELLS
from umo.generate.function_source import NoSource, bound
from umo.generate.terms import TEXT, Code, Known, Many, Present, Term, UnknownText
from umo.generate.translation import Untranslatable
from umo.generate.vector_code import VectorCode
from umo.objects import Compound, DigitalSensor, Quality, Vector
from umo.objects.atomic import Atomic, Binary, Digital
from umo.objects.link import Cycle

HOST_CALLS: frozenset[Any] = frozenset({Profile.to, Profile.at})
"""What only the host can do: it plans motions."""
DROPPED = ("progress", "say")
"""Names of methods that only tell something."""
OF_THE_HOST = ("sample", "update", "reset", "acknowledge", "control")
"""Names of methods of a whole part that only the host calls."""
OF_CLOCK = {"dt": (REAL, "umo_dt(m)"), "now": (REAL, "umo_now(m)"), "period": (REAL, "umo_period(m)")} | {
    "ticks": (INT, "umo_ticks(m)")
}
EXACT: dict[Any, str] = {math.fabs: "umo_fabs"}
INEXACT: dict[Any, tuple[str, str]] = {
    math.sin: ("umo_sin", "!umo_is_finite({0})"), math.cos: ("umo_cos", "!umo_is_finite({0})"),
    math.tan: ("umo_tan", "!umo_is_finite({0})"), math.exp: ("umo_exp", ""), math.log: ("umo_log", "!({0} > 0)"),
}  # fmt: skip
WHOLE: dict[Any, str] = {
    math.floor: "umo_floor",
    math.ceil: "umo_ceil",
    math.trunc: "umo_trunc",
    int: "umo_trunc",
    round: "umo_round_even",
}


class CallCode(VectorCode):
    """The part of a function that is calls and attributes."""

    # Attributes of live objects ------------------------------------------------------------------------

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term:
        owner = base.value
        if isinstance(owner, Atomic):
            return self._of_atomic(owner, name, node)
        if isinstance(owner, Vector):
            self._object(owner[0], node)
            return self.attribute_of_vector(owner, name, node)
        if isinstance(owner, ModuleType | type):
            return Known(self._got(owner, name, node), owner, name)
        if isinstance(owner, Clock | Cycle):
            return self._of_time(owner, name, node)
        if isinstance(owner, Compound):
            if name in OF_THE_HOST and name in vars(owner) | vars(Compound):
                raise self.refused(node, f"`{name}` of a part is done by the host", "read, write, reset of an object")
            if name in ("dt", "now"):
                return Code(*OF_CLOCK[name])
            if name == "cycle":
                return Known(owner.cycle)
        if (
            not isinstance(owner, ModuleType | type)
            and type(owner).__module__ in ("builtins",)
            and not hasattr(owner, "__dict__")
        ):
            return Known(self._got(owner, name, node), owner, name)
        static = inspect.getattr_static(type(owner), name, None)
        if isinstance(static, property) and static.fget is not None:
            return self.function(static.fget, [base], {}, node)
        if isinstance(static, FunctionType | staticmethod | classmethod | cached_property):
            return Known(self._got(owner, name, node), owner, name)
        if isinstance(owner, Enum):
            return Known(getattr(owner, name))
        return self.field(owner, name, base, node)

    def field(self, owner: Any, name: str, base: Known, node: ast.AST) -> Term:
        """An attribute that is a number is a field; another one is known."""
        if (id(owner), name) in self.world.memory.texts:
            return Known(TEXT)
        value = self._got(owner, name, node)
        of = self.world.fields.type_of(owner, name, value)
        if of is None or of == NOTHING:
            if (id(owner), name) in self.world.memory.assigned and of is None:
                raise self.refused(
                    node, "it is assigned, and is not a number or a state", "numbers, states, tuples of numbers"
                )
            self.world.fields.known(value, self._path(owner, base, name)) if hasattr(value, "__dict__") else None
            return Known(value, owner, name)
        text = self.world.fields.field(owner, name, of, self._path(owner, base, ""))
        return Code(numpy_number(of, sure=False) if (id(owner), name) in self.world.memory.of_numpy else of, text)

    def _path(self, owner: Any, base: Known, name: str) -> str:
        path = self.world.fields.known(owner, base.name or type(owner).__name__).path
        return f"{path}.{name}".strip(".") if name else path

    def _got(self, owner: Any, name: str, node: ast.AST) -> Any:
        try:
            return getattr(owner, name)
        except AttributeError:
            told = f"{type(owner).__name__} has no {name!r} now"
        raise self.refused(node, told, "give it a value in `setup`")

    def _of_time(self, owner: Any, name: str, node: ast.AST) -> Term:
        if name in OF_CLOCK:
            return Code(*OF_CLOCK[name])
        if isinstance(owner, Cycle) and name in DROPPED:
            return Known(_dropped)
        nearest = "dt, now, cycle.period"
        raise self.refused(node, f"`{name}` of the cycle is not known on a controller", nearest)

    def _of_atomic(self, owner: Atomic, name: str, node: ast.AST) -> Term:
        place = self._object(owner, node)
        if name == "time":
            return Code(REAL, f"umo_time({place})")
        if name == "quality":
            return Code(state(Quality), f"umo_quality({place})")
        if name == "inhibited":
            return Present(f"umo_inhibited({place})")
        if name == "raw":
            return Code(INT, f"umo_raw({place})")
        if name == "pending":
            if isinstance(owner, Binary):
                return Code(state(owner.states), f"umo_pending_state({place})")
            return Code(REAL, f"umo_pending({place})")
        if name == "velocity":
            return self._got_by(f"umo_velocity({place}, &%s)", REAL)
        if isinstance(owner, DigitalSensor) and owner.incremental:  # homing changes it
            if name == "zero_offset":
                return Code(REAL, f"{place}->zero_offset")
            if name == "calibration":
                raise self.refused(node, "homing changes it", "minimum, maximum, resolution, zero_offset")
        value = self._got(owner, name, node)
        return Known(value, owner, name)

    def _object(self, owner: Atomic, node: ast.AST) -> str:
        """The object; a controller samples those that are synchronous."""
        if owner.direction is Direction.INPUT and not owner.synchronous:
            told = f"{owner.path} is asynchronous: it is not read on a controller"
            at = self.source.file, getattr(node, "lineno", 0), self.source.segment(node)
            self.world.on_host.append(Untranslatable(*at, told, "a synchronous sensor"))
        return self.world.place(owner)

    def _got_by(self, call: str, of: CType) -> Code:
        """The result of a call that returns a fault."""
        name = self.temporary(of)
        self.called(call % name)
        return Code(of, name, stable=True)

    # Calls ---------------------------------------------------------------------------------------------

    def call(self, node: ast.Call) -> Term:
        if self._is_super(node.func):
            return self._of_super(node)
        if self._is_joined_text(node):
            return Known(TEXT)
        func = self.term(node.func)
        if not isinstance(func, Known):
            raise self.refused(node, "what is called is not known when the code is generated")
        if func.value is _dropped or _tells(func.value):
            self.world.note(f"{self.source.segment(node.func)} only tells something: it is left out on the controller")
            return Known(None)
        if func.value in (any, all, sum) and len(node.args) == 1 and isinstance(node.args[0], ast.GeneratorExp):
            return self._over(func.value, node.args[0], node)
        arguments, named = self._arguments(node)
        return self.apply(func, arguments, named, node)

    def _is_joined_text(self, node: ast.Call) -> bool:
        """A method of a text, such as `", ".join(...)`: it gives a text."""
        func = node.func
        if not (isinstance(func, ast.Attribute) and isinstance(func.value, ast.Constant | ast.JoinedStr)):
            return False
        return func.attr in ("join", "format")

    def _arguments(self, node: ast.Call) -> tuple[list[Term], dict[str, Term]]:
        if any(each.arg is None for each in node.keywords):
            raise self.refused(node, "** does not translate", "name the arguments")
        values = [each.value if isinstance(each, ast.Starred) else each for each in node.args]
        terms = self.ordered([*values, *(each.value for each in node.keywords)])
        arguments: list[Term] = []
        for each, term in zip(node.args, terms, strict=False):
            arguments += self.parts(term, each) if isinstance(each, ast.Starred) else [term]
        rest = terms[len(node.args) :]
        return arguments, {str(each.arg): term for each, term in zip(node.keywords, rest, strict=True)}

    def parts(self, term: Term, node: ast.AST) -> list[Term]:
        """The elements of a tuple."""
        if isinstance(term, Many):
            return list(term.terms)
        if isinstance(term, Known) and isinstance(term.value, tuple | list):
            return [Known(each) for each in term.value]
        if isinstance(term, Code) and isinstance(term.type, TupleType):
            place = self.place(term).text
            return [Code(of, f"{place}.{name}") for name, of in term.type.members]
        raise self.refused(node, "the number of its elements is not known")

    def apply(self, func: Known, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        target = func.value
        if isinstance(target, ArrayMethod) and not named:
            return self.method_of_array(target, arguments, node)
        if isinstance(func.owner, Vector):
            return self.method_of_vector(func.owner, func.name, arguments, named, node)
        if target is np.flatnonzero:
            return Known(TEXT)  # places of elements only tell something
        if (of_numpy := self.of_numpy(target, arguments, named, node)) is not None:
            return of_numpy
        if str(getattr(target, "__module__", "")).partition(".")[0] == "numpy":
            nearest = "np.where, clip, maximum, minimum, abs, isfinite, zeros, full; a loop with functions of math"
            raise self.refused(node, f"{self.source.segment(node.func)} has no translation", nearest)
        if isinstance(func.owner, Atomic):
            return self._call_atomic(func.owner, func.name, arguments, named, node)
        if target is value_of and isinstance(arguments[0], Known) and isinstance(arguments[0].value, Vector):
            self._object(arguments[0].value[0], node)
            return self.values_of(arguments[0].value, arguments[1:], named, node)
        if target is value_of or target is state_of:
            return self._input(target, arguments, named, node)
        if isinstance(target, type) and issubclass(target, tuple) and hasattr(target, "_fields"):
            given = dict(zip(target._fields, arguments, strict=False)) | named
            return Many(tuple(given[name] for name in target._fields), target._fields, target)
        if target in (zip, enumerate) and all(isinstance(each, Known) for each in (*arguments, *named.values())):
            given = {name: each.value for name, each in named.items()}  # type: ignore[union-attr]
            return Known(list(target(*(each.value for each in arguments), **given)))  # type: ignore[union-attr]
        if not named and (found := self._of_python(target, arguments, node)) is not None:
            return found
        if target is typing.cast:
            return arguments[1]
        if getattr(target, "__func__", target) in HOST_CALLS:
            return self._host(target.__self__, target.__name__, arguments, node)
        if isinstance(func.owner, object) and func.name and not _of_class(func):
            return self._host(func.owner, func.name, arguments, node)
        if callable(target) and isinstance(target, FunctionType | MethodType | partial):
            return self.function(target, arguments, named, node)
        if hasattr(target, "__wrapped__") and callable(target):
            return self.function(target, arguments, named, node)
        raise self.refused(
            node, f"{self.source.segment(node.func)} has no translation", "functions of Python code, math"
        )

    def _is_super(self, func: ast.AST) -> bool:
        inner = func.value if isinstance(func, ast.Attribute) else None
        return isinstance(inner, ast.Call) and isinstance(inner.func, ast.Name) and inner.func.id == "super"

    def _of_super(self, node: ast.Call) -> Term:
        assert isinstance(node.func, ast.Attribute)
        first = self.source.tree.args.args[0].arg
        me, kind = self.names.get(first), self.source.meaning("__class__")
        if not isinstance(me, Known) or not isinstance(kind, type):
            raise self.refused(node, "super() outside of a method")
        found = getattr(super(kind, me.value), node.func.attr)
        arguments, named = self._arguments(node)
        return self.function(found, arguments, named, node)

    def _call_atomic(
        self, owner: Atomic, name: str, arguments: list[Term], named: dict[str, Term], node: ast.Call
    ) -> Term:
        place, terms = self._object(owner, node), [*arguments, *named.values()]
        if name == "read":
            if isinstance(owner, Binary):
                return self._got_by(f"umo_binary_read({place}, &%s)", state(owner.states))
            return self._got_by(f"umo_digital_read({place}, &%s)", REAL)
        if name == "write" and len(terms) == 1:
            return self._write(owner, place, terms[0], node)
        if name == "reset":
            self.called(f"umo_object_reset({place})")
            return Known(None)
        if name == "referenced" and isinstance(owner, DigitalSensor):
            return self._home(owner, place, dict(zip(("known",), arguments, strict=False)) | named, node)
        raise self.refused(node, f"`{name}` of an object does not translate", "read, write, reset, quality, pending")

    def _home(self, owner: DigitalSensor, place: str, named: dict[str, Term], node: ast.Call) -> Term:
        """`referenced` of an incremental sensor."""
        known, at = self.truth(named.get("known", Known(True)), node), named.get("at", Known(None))
        if not owner.incremental:
            raise self.refused(node, f"{owner.path} is not declared incremental", "incremental=True")
        if not (isinstance(at, Known) and at.value is None):
            if owner.linearization is not None or known is not True:
                told = "`at` is for what is referenced, and has no linearization"
                raise self.refused(node, told, "referenced(at=...)")
            self.called(f"umo_set_reading({place}, {self.as_type(at, REAL, node)})")
        self.line(f"umo_referenced({place}, {str(known).lower() if isinstance(known, bool) else known});")
        return Known(None)

    def _write(self, owner: Atomic, place: str, term: Term, node: ast.Call) -> Term:
        if isinstance(owner, Digital):
            if self.code(term, node).type == BOOL:
                self.raises(RangeError, node)
                return Known(False)
            return self._got_by(f"umo_digital_write({place}, {self.as_type(term, REAL, node)}, &%s)", BOOL)
        assert isinstance(owner, Binary)
        code = self.code(term, node)
        if code.type != state(owner.states):
            self.raises(StateError, node)
            return Known(False)
        return self._got_by(f"umo_binary_write({place}, {code.text}, &%s)", BOOL)

    def _input(self, which: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        sensor = arguments[0]
        accept = arguments[1] if len(arguments) > 1 else named.get("accept", Known(()))
        if not (isinstance(sensor, Known) and isinstance(sensor.value, Atomic)):
            raise self.refused(node, "the sensor is not known when the code is generated")
        place, mask = self._object(sensor.value, node), self.as_type(accept, MASK, node)
        if which is state_of and isinstance(sensor.value, Binary):
            return self._got_by(f"umo_state_of({place}, {mask}, &%s)", state(sensor.value.states))
        return self._got_by(f"umo_value_of({place}, {mask}, &%s)", REAL)

    def _host(self, owner: Any, name: str, arguments: Sequence[Term], node: ast.Call) -> Term:
        """Only the host can do it: it is asked for, with numbers."""
        number = self.world.host_call(owner, name)
        numbers = [self.as_type(each, REAL, node) for each in arguments]
        given = f"(umo_real[]){{{', '.join(numbers) or '0'}}}"
        self.called(f"umo_host_call(m, {number}, 0, {given}, {len(numbers)})")
        return Known(None)

    # Python's own --------------------------------------------------------------------------------------

    def _of_python(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        """A function of Python itself, or of math; None: it is another one."""
        if target in (isinstance, hasattr, getattr, len, callable, type, range, zip, enumerate, reversed, tuple, list):
            return self._static(target, arguments, node)
        if target in (min, max):
            return self._extreme(target, arguments, node)
        one = arguments[0] if len(arguments) == 1 else None
        if one is None:
            return self._of_two(target, arguments, node)
        if (
            isinstance(one, Known)
            and type(one.value) in NUMBERS
            and (target in WHOLE or target in (abs, float, bool, math.sqrt))
        ):
            try:
                return Known(target(one.value))
            except (ArithmeticError, ValueError) as error:
                self.raises(type(error), node)
                return Known(0.0)
        return self._of_one(target, one, node)

    def _of_one(self, target: Any, one: Term, node: ast.Call) -> Term | None:
        if target is abs and self.is_array(one):
            return self.of_numpy(np.abs, [one], {}, node)
        if target is bool:
            truth = self.truth(one, node)
            return Known(truth) if isinstance(truth, bool) else Code(BOOL, f"({truth})")
        known = target in WHOLE or target in (abs, float, math.isfinite, math.isnan, math.isinf, math.sqrt)
        if not (known or target in EXACT or target in INEXACT):
            return None
        code = self.number(one, node)
        if target is abs and code.type == INT:
            kept = self.kept(code).text
            self.raises(OverflowError, node, f"{kept} == INT32_MIN")
            return Code(INT, f"({kept} < 0 ? -{kept} : {kept})")
        if target in WHOLE:
            return self._whole(target, code, node)
        text = self.as_type(code, REAL, node)
        if target is float:
            return Code(REAL, text)
        if target in (abs, math.fabs):
            return Code(REAL, f"umo_fabs({text})")
        if target is math.isinf:
            kept = self.kept(Code(REAL, text)).text
            return Code(BOOL, f"(!umo_is_finite({kept}) && !umo_is_nan({kept}))")
        if target in (math.isfinite, math.isnan):
            return Code(BOOL, f"umo_is_{'finite' if target is math.isfinite else 'nan'}({text})")
        kept = self.kept(Code(REAL, text)).text
        if target is math.sqrt:
            self.raises(ValueError, node, f"{kept} < 0")
            return Code(REAL, f"umo_sqrt({kept})")
        return self._inexact(target, kept, node)

    def _inexact(self, target: Any, kept: str, node: ast.Call) -> Code:
        name, wrong = INEXACT[target]
        self.world.note_inexact(target.__name__)
        if wrong:
            self.raises(
                ValueError,
                node,
                f"!umo_is_nan({kept}) && {wrong.format(kept)}" if "finite" in wrong else wrong.format(kept),
            )
        result = self.kept(Code(REAL, f"{name}({kept})")).text
        if target is math.exp:
            self.raises(OverflowError, node, f"!umo_is_finite({result}) && umo_is_finite({kept})")
        return Code(REAL, result, stable=True)

    def _whole(self, target: Any, code: Code, node: ast.Call) -> Code:
        if code.type != REAL:
            return Code(INT, self.as_type(code, INT, node))
        kept = self.kept(code).text
        self.raises(ValueError, node, f"umo_is_nan({kept})")
        cut = self.kept(Code(REAL, f"{WHOLE[target]}({kept})")).text
        self.raises(OverflowError, node, f"!umo_fits_int({cut})")
        return Code(INT, f"(int32_t){cut}")

    def _of_two(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        if len(arguments) != 2:
            return None
        if target is math.copysign:
            a, b = (self.as_type(self.number(each, node), REAL, node) for each in arguments)
            return Code(REAL, f"umo_copysign({a}, {b})")
        if target is math.atan2:
            self.world.note_inexact("atan2")
            a, b = (self.as_type(self.number(each, node), REAL, node) for each in arguments)
            return Code(REAL, f"umo_atan2({a}, {b})")
        return None

    def _extreme(self, target: Any, arguments: list[Term], node: ast.Call) -> Term:
        terms = self.parts(arguments[0], node) if len(arguments) == 1 else arguments
        if all(isinstance(each, Known) for each in terms):
            return Known(target(each.value for each in terms))  # type: ignore[union-attr]
        codes = [self.number(each, node) for each in terms]
        of = REAL if any(each.type == REAL for each in codes) else INT
        texts = [self.as_type(each, of, node) for each in codes]
        name = f"umo_{target.__name__}{'' if of == REAL else '_int'}"
        found = texts[0]
        for each in texts[1:]:
            found = f"{name}({found}, {each})"
        return Code(of, found)

    def _static(self, target: Any, arguments: list[Term], node: ast.Call) -> Term:
        if target is len and isinstance(arguments[0], Code) and isinstance(arguments[0].type, ArrayType):
            return Known(arguments[0].type.length)
        if target is len and isinstance(arguments[0], Many):
            return Known(len(arguments[0].terms))
        if any(isinstance(each, Known) and isinstance(each.value, UnknownText) for each in arguments):
            raise self.refused(node, TELLS, "a state of an Enum")
        if target is isinstance and (known := _kind_of(arguments[0])) and isinstance(arguments[1], Known):
            return Known(issubclass(known, arguments[1].value))
        if not all(isinstance(each, Known) for each in arguments):
            raise self.refused(node, f"{target.__name__} of something that is not known when the code is generated")
        return Known(target(*(each.value for each in arguments)))  # type: ignore[union-attr]

    def _over(self, target: Any, generator: ast.GeneratorExp, node: ast.Call) -> Term:
        """any, all or sum of an expression over objects."""
        first = generator.generators[0]
        if len(generator.generators) != 1:
            raise self.refused(node, "two loops in one expression", "a loop for each")
        elements = self.elements(self.term(first.iter), first.iter)
        of = INT if target is sum else BOOL
        parts = []
        if target is sum:
            total: Term = Known(0)
            for each in elements:
                with self.bound_to(first.target, each):
                    condition = self._all_of(first.ifs)
                    if condition is not True:
                        raise self.refused(node, "`if` in a sum", "a loop")
                    total = self.arithmetic(
                        ast.Add(), self.number(total, node), self.number(self.term(generator.elt), node), node
                    )
            return total
        result = self.temporary(of, "c")
        end = self.label("found")
        self.line(f"{result} = {'false' if target is any else 'true'};", pure=True)
        for each in elements:
            with self.bound_to(first.target, each):
                conditions = [self.truth(self.term(test), test) for test in first.ifs]
                truth = self.truth(self.term(generator.elt), generator.elt)
            text = str(truth).lower() if isinstance(truth, bool) else truth
            wanted = text if target is any else f"!({text})"
            both = " && ".join([*(f"({str(c).lower()})" for c in conditions), f"({wanted})"])
            with self.block(f"if ({both})"):
                self.line(f"{result} = {'true' if target is any else 'false'};", pure=True)
                self.line(f"goto {end};", pure=True)
            parts.append(text)
        if elements:
            self.line(f"{end}:;", pure=True)
        return Code(BOOL, result, stable=True)

    def _all_of(self, tests: Sequence[ast.AST]) -> bool:
        return not tests

    def elements(self, term: Term, node: ast.AST) -> list[Term]:
        raise NotImplementedError

    def bound_to(self, target: ast.AST, term: Term) -> Any:
        raise NotImplementedError

    # Functions that are translated too -----------------------------------------------------------------

    def function(
        self, target: Callable[..., Any], arguments: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> Term:
        try:
            found = bound(target)
        except NoSource as error:
            raise self.refused(node, f"{getattr(target, '__name__', target)}: {error}") from None
        if inspect.iscoroutinefunction(found.source.function) or inspect.isgeneratorfunction(found.source.function):
            raise self.refused(node, "a sequence stays on the host", "functions without await")
        given = [*map(Known, found.given), *arguments]
        terms = self._by_name(found.source.function, given, {k: Known(v) for k, v in found.named} | named, node)
        return self.world.invoke(self, found.source, terms, node)

    def _by_name(
        self, function: FunctionType, given: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> dict[str, Term]:
        signature = inspect.signature(function)
        try:
            bound_to = signature.bind(*given, **named)
        except TypeError as error:
            raise self.refused(node, str(error)) from None
        terms: dict[str, Term] = {}
        for name, each in signature.parameters.items():
            if each.kind is each.VAR_POSITIONAL:
                terms[name] = Many(tuple(bound_to.arguments.get(name, ())))
            elif each.kind is each.VAR_KEYWORD:
                if bound_to.arguments.get(name):
                    raise self.refused(node, "** does not translate", "name the arguments")
                terms[name] = Known({})
            else:
                term = bound_to.arguments.get(name, ABSENT)
                terms[name] = Known(each.default) if term is ABSENT else term
        return terms


ABSENT: Any = object()


def _kind_of(term: Term) -> type | None:
    """The class of a value that the controller computes."""
    if not isinstance(term, Code):
        return None
    if isinstance(term.type, ArrayType):
        return np.ndarray
    return {REAL: float, INT: int, BOOL: bool}.get(term.type)


def _dropped(*_: object) -> None:
    """What only tells something."""


def _tells(target: Any) -> bool:
    return isinstance(getattr(target, "__self__", None), logging.Logger) or target is print


def _of_class(func: Known) -> bool:
    """Whether it is a function of the class of its owner, or no attribute of an object."""
    if func.owner is None or isinstance(func.owner, ModuleType | type):
        return True
    return inspect.getattr_static(type(func.owner), func.name, None) is not None and func.name not in vars(func.owner)
