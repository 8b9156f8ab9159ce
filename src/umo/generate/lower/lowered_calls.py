"""Calls of umo's objects, of Python's own functions, and of functions that are translated too."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import logging
import typing
from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from types import FunctionType, MethodType
from typing import Any

import numpy as np

from umo.control.inputs import state_of, value_of
from umo.control.profile import Profile
from umo.errors import RangeError, StateError
from umo.generate.c_types import (
    BOOL,
    INT,
    MASK,
    REAL,
    ArrayType,
    OptionalType,
    TextType,
    TupleType,
    may_be_bool,
    plain,
    plain_number,
    state,
)
from umo.generate.form import (
    ZERO,
    Element,
    Literal,
    Member,
    Reals,
    Runtime,
    RuntimeCall,
    Value,
    WholeMachine,
    has,
    inside,
    negated,
)
from umo.generate.function_source import NoSource, bound
from umo.generate.lower.known_tables import member_of, of_dict
from umo.generate.lower.local_functions import LocalFunction, terms_around
from umo.generate.lower.lowered_attributes import asks_host, dropped
from umo.generate.lower.lowered_expressions import of_element, record_kind
from umo.generate.lower.lowered_sequences import CONSUMERS
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.state_members import StateMethod
from umo.generate.lower.terms import (
    ArrayMethod,
    Code,
    Known,
    OneOf,
    RecordReplace,
    RingMethod,
    Term,
    TruePlaces,
    TupleTerm,
)
from umo.generate.value_kinds import is_container, is_plain_dataclass, is_plain_record, static_attribute
from umo.objects import DigitalSensor, Vector
from umo.objects.atomic import Atomic, Binary, Digital

MOST_NUMBERS = 256
"""Maximum number of elements of a list in one expression. Each element is written out."""
HOST_CALLS: frozenset[Any] = frozenset({Profile.to})
"""Functions that only the host can carry out, because they plan motions."""


class LoweredCalls(LoweredSubject):
    """Lowers the calls and attributes of a function."""

    def lower_call(self, node: ast.Call) -> Term:
        if self.f.texts.is_text(node):
            return self.f.texts.text(node)
        func = self.f.term(node.func)
        if isinstance(func, OneOf):
            arguments, named = self._arguments(node.args, node.keywords)
            return self._of_each(func, arguments, named, node)
        if not isinstance(func, Known):
            raise self.f.refused(node, "the called function is not known when the code is generated")
        if func.value is dropped or _tells(func.value):
            self.f.texts.check_removable([*node.args, *(each.value for each in node.keywords)])
            if not self.f.texts.python_calls(node):
                told = f"{self.f.source.segment(node.func)} only makes a text: it is left out on the controller"
                self.f.world.note(told)
            return Known(None)
        if (found := self.f.generators.over(func.value, node)) is not None:
            return found
        passed = node.args[:1] if func.value in CONSUMERS and any(map(self._is_passage, node.args[:1])) else []
        elements = [TupleTerm(tuple(self.f.sequences.gone_through(each))) for each in passed]
        arguments, named = self._arguments(node.args[len(passed) :], node.keywords)
        return self._of_each(func, [*elements, *arguments], named, node)

    def _of_each(self, func: Known | OneOf, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        """Return a call. If the callee or an argument is one of several objects, the call is written out for each of
        them."""
        terms = [func, *arguments, *named.values()]
        place = next((n for n, each in enumerate(terms) if isinstance(each, OneOf)), None)
        if place is None:
            return self.apply(func, arguments, named, node)  # type: ignore[arg-type]
        settled = [self.f.values.settled(each) for each in terms]

        def call(option: Known) -> Term:
            given = [*settled[:place], option, *settled[place + 1 :]]
            rest = dict(zip(named, given[1 + len(arguments) :], strict=True))
            return self._of_each(given[0], given[1 : 1 + len(arguments)], rest, node)  # type: ignore[arg-type]

        return self.f.choices.each(terms[place], call, node)  # type: ignore[arg-type]

    def _is_passage(self, node: ast.AST) -> bool:
        """Return True if the elements of the expression can be iterated only once."""
        return isinstance(node, ast.GeneratorExp) or self.f.sequences.is_iterator(node)

    def _arguments(
        self, given: Sequence[ast.expr], keywords: Sequence[ast.keyword]
    ) -> tuple[list[Term], dict[str, Term]]:
        for each in keywords:
            if each.arg is None:
                raise self.f.refused(each, "** cannot be translated", "name the arguments")
        terms = self.f.sequences.spread([*given, *(each.value for each in keywords)])
        count = len(terms) - len(keywords)
        return terms[:count], {str(each.arg): term for each, term in zip(keywords, terms[count:], strict=True)}

    def parts(self, term: Term, node: ast.AST) -> list[Term]:
        """Return the elements of a tuple or of a list of numbers."""
        self.f.expressions.check_elements(term, node)
        return self.members(term, node)

    def members(self, term: Term, node: ast.AST) -> list[Term]:
        """Return the members of a value, and the values of the fields of a dataclass."""
        if isinstance(term, TupleTerm):
            return list(term.terms)
        if isinstance(term, Known) and isinstance(term.value, tuple | list) and is_container(term.value):
            self.f.world.memory.place_known(term.value)
            return [Known(each) for each in term.value]
        if isinstance(term, Code) and isinstance(term.type, TupleType):
            place = self.f.expressions.place(term).value
            return [Code(of, Member(place, name)) for name, of in term.type.members]
        if isinstance(term, Code) and isinstance(term.type, ArrayType):
            return self.numbers_of(term, node)
        raise self.f.refused(node, "the number of its elements is not known")

    def numbers_of(self, code: Code, node: ast.AST) -> list[Term]:
        """Return the elements of an array or a list of numbers, each as a separate expression."""
        assert isinstance(code.type, ArrayType)
        self.f.arrays.check_length(code.type, node)
        if code.type.length > MOST_NUMBERS:
            raise self.f.refused(
                node, f"the expression has {code.type.length} numbers", f"at most {MOST_NUMBERS}, or a loop"
            )
        place = self.f.arrays.kept_place(code)
        return [Code(of_element(code.type), Element(place, Literal(i, INT))) for i in range(code.type.length)]

    def apply(self, func: Known, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        target = func.value
        own = static_attribute(type(target), "__call__")
        if isinstance(own, FunctionType) and not isinstance(target, type):
            self.f.takes(type(target), "__call__", node)
            return self.function(own, [func, *arguments], named, node)
        if isinstance(target, StateMethod):
            return self.function(target.function, [target.member, *arguments], named, node)
        if isinstance(target, LocalFunction):
            around = terms_around(self.f, target, node)
            terms = self._by_name(target.source.function, arguments, named, node)
            return self.f.world.invoke(self.f, target.source, terms | around, node)
        if isinstance(target, RecordReplace) and not arguments:
            return self._changed_record(target.record, named, node)
        if isinstance(target, RingMethod) and not named:
            return self.f.rings.call(target, arguments, node)
        if isinstance(target, ArrayMethod) and not named:
            return self.f.arrays.method_of_array(target, arguments, node)
        of_table = of_dict(self.f, func, arguments, node) if type(func.owner) is dict and not named else None
        if of_table is not None:
            return of_table
        if isinstance(func.owner, Vector):
            return self.f.vectors.method_of_vector(func.owner, func.name, arguments, named, node)
        if target is np.flatnonzero:
            return Known(TruePlaces(self.f.arrays.array(self.f.values.settled(arguments[0]), node)))
        if (of_numpy := self.f.arrays.of_numpy(target, arguments, named, node)) is not None:
            return of_numpy
        if str(getattr(target, "__module__", "")).partition(".")[0] == "numpy":
            nearest = "np.where, clip, maximum, minimum, abs, isfinite, zeros, full; a loop with functions of math"
            raise self.f.refused(node, f"{self.f.source.segment(node.func)} cannot be translated", nearest)
        if isinstance(func.owner, Atomic):
            return self._call_atomic(func.owner, func.name, arguments, named, node)
        if target is value_of and isinstance(arguments[0], Known) and isinstance(arguments[0].value, Vector):
            self.f.attributes.object(arguments[0].value[0], node)
            return self.f.vectors.values_of(arguments[0].value, arguments[1:], named, node)
        if target is value_of or target is state_of:
            return self._input(target, arguments, named, node)
        if isinstance(target, type) and dataclasses.is_dataclass(target):
            return self._record(target, arguments, named, node)
        if target is dataclasses.replace and len(arguments) == 1:
            return self._replaced(arguments[0], named, node)
        if isinstance(target, type) and issubclass(target, tuple) and hasattr(target, "_fields"):
            if not is_plain_record(target):
                raise self.f.refused(
                    node, f"{target.__name__} changes the behaviour of a tuple", "a NamedTuple with fields only"
                )
            defaults = {name: Known(each) for name, each in getattr(target, "_field_defaults", {}).items()}
            given = defaults | dict(zip(target._fields, arguments, strict=False)) | named
            if len(arguments) > len(target._fields) or given.keys() != set(target._fields):
                raise self.f.refused(
                    node, f"the arguments do not match the fields of {target.__name__}", ", ".join(target._fields)
                )
            return TupleTerm(tuple(given[name] for name in target._fields), target._fields, target)
        if (found := self.f.builtins.of_python(target, arguments, named, node)) is not None:
            return found
        if target is typing.cast:
            return arguments[1]
        if getattr(target, "__func__", target) in HOST_CALLS:
            return self._host(target.__self__, target.__name__, arguments, node)
        if asks_host(func.owner, func.name):
            return self._host(func.owner, func.name, arguments, node)
        if isinstance(target, FunctionType | MethodType | partial):
            return self.function(target, arguments, named, node)
        if isinstance(target, type) and issubclass(target, Enum) and len(arguments) == 1 and not named:
            return member_of(self.f, target, arguments[0], node)
        raise self.f.refused(
            node, f"{self.f.source.segment(node.func)} cannot be translated", "functions of Python code, math"
        )

    def _record(self, kind: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> TupleTerm:
        """Return a new frozen dataclass."""
        if not is_plain_dataclass(kind):
            told = f"a {kind.__name__} is created, and is not frozen or has its own code for that"
            raise self.f.refused(node, told, "a frozen dataclass with only fields, methods and properties")
        signature = inspect.signature(kind)
        try:
            given = signature.bind(*arguments, **named).arguments
        except TypeError as error:
            raise self.f.refused(node, str(error)) from None
        for each in dataclasses.fields(kind):
            if each.name not in given and each.default is dataclasses.MISSING:
                raise self.f.refused(node, f"the default of {each.name!r} is created at each call", "the argument")
        names = tuple(each.name for each in dataclasses.fields(kind))
        defaults = {each.name: Known(each.default) for each in dataclasses.fields(kind)}
        return TupleTerm(tuple((defaults | given)[name] for name in names), names, kind)

    def _replaced(self, term: Term, named: dict[str, Term], node: ast.Call) -> TupleTerm:
        """Return a frozen dataclass with some fields replaced."""
        is_known = isinstance(term, Known) and is_plain_dataclass(type(term.value))
        term = self.f.values.code(term, node) if is_known else term
        kind = record_kind(term)
        if not is_plain_dataclass(kind) or isinstance(getattr(term, "type", None), OptionalType):
            raise self.f.refused(
                node, "`replace` is applied to something that is not a frozen dataclass", "a frozen dataclass"
            )
        before = dict(zip((each.name for each in dataclasses.fields(kind)), self.members(term, node), strict=True))
        return self._record(kind, [], before | named, node)

    def _changed_record(self, term: Term, named: dict[str, Term], node: ast.AST) -> TupleTerm:
        """Return a NamedTuple with some fields replaced."""
        kind = record_kind(term)
        before = dict(zip(kind._fields, self.members(term, node), strict=True))
        if named.keys() - before.keys():
            raise self.f.refused(
                node, f"the arguments do not match the fields of {kind.__name__}", ", ".join(kind._fields)
            )
        return TupleTerm(tuple((before | named).values()), kind._fields, kind)

    def is_super(self, node: ast.AST) -> bool:
        """True if this is `super()`."""
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super"):
            return False
        return not node.args and "super" not in self.f.flow.names and self.f.source.meaning("super") is super

    def of_super(self, node: ast.Attribute) -> Term:
        """Return a method, a property or a value of a base class."""
        me = next((self.f.flow.names.get(each.arg) for each in self.f.source.tree.args.args), None)
        kind = self.f.source.meaning("__class__")
        if not isinstance(me, Known) or not isinstance(kind, type):
            raise self.f.refused(node, "super() is called outside of a method")
        for each in type(me.value).__mro__:
            self.f.takes(each, node.attr, node)
        above = type(me.value).__mro__[type(me.value).__mro__.index(kind) + 1 :]
        static = next((vars(each)[node.attr] for each in above if node.attr in vars(each)), None)
        if type(static) is property and static.fget is not None:
            return self.function(static.fget, [me], {}, node)
        if isinstance(static, FunctionType | staticmethod | classmethod):
            return Known(getattr(super(kind, me.value), node.attr))
        if static is None or hasattr(type(static), "__get__"):
            raise self.f.refused(node, "no class has this attribute of super()", "a method, a property, a number")
        return Known(static)

    def _call_atomic(
        self, owner: Atomic, name: str, arguments: list[Term], named: dict[str, Term], node: ast.Call
    ) -> Term:
        place, terms = self.f.attributes.object(owner, node), [*arguments, *named.values()]
        if name == "read":
            if isinstance(owner, Binary):
                return self.f.attributes.got_by("umo_binary_read", place, of=state(owner.states))
            return self.f.attributes.got_by("umo_digital_read", place, of=REAL)
        if name == "write" and len(terms) == 1:
            return self._write(owner, place, terms[0], node)
        if name in ("reset", "referenced"):
            self.f.attributes.check_in_c(name, node)
        if name == "reset":
            self.f.called("umo_object_reset", place)
            return Known(None)
        if name == "referenced" and isinstance(owner, DigitalSensor):
            return self._home(owner, place, dict(zip(("known",), arguments, strict=False)) | named, node)
        raise self.f.refused(
            node, f"`{name}` of an object cannot be translated", "read, write, reset, quality, pending"
        )

    def _home(self, owner: DigitalSensor, place: Value, named: dict[str, Term], node: ast.Call) -> Term:
        """Lower `referenced` of an incremental sensor."""
        known, at = self.f.values.truth(named.get("known", Known(True)), node), named.get("at", Known(None))
        if not owner.incremental:
            raise self.f.refused(node, f"{owner.path} is not declared incremental", "incremental=True")
        if not (isinstance(at, Known) and at.value is None):
            if owner.linearization is not None or known is not True:
                told = "`at` needs an incremental sensor without a linearization"
                raise self.f.refused(node, told, "referenced(at=...)")
            self.f.called("umo_set_reading", place, self.f.values.as_type(at, REAL, node))
        self.f.add(
            RuntimeCall(Runtime("umo_referenced", (place, Literal(known, BOOL) if isinstance(known, bool) else known)))
        )
        return Known(None)

    def _write(self, owner: Atomic, place: Value, term: Term, node: ast.Call) -> Term:
        if isinstance(owner, Digital):
            code = self.f.values.code(term, node)
            if plain_number(plain(code.type)) == BOOL:  # a bool is refused, and so is None
                self.f.raises(RangeError, node)
                return Known(False)
            if may_be_bool(code.type):
                raise self.f.refused(node, "it may be a bool, which no digital object accepts", "float(...), int(...)")
            if isinstance(code.type, OptionalType):
                term = code = self.f.values.kept(code)
                self.f.raises(RangeError, node, negated(has(code.value)))
            return self.f.attributes.got_by(
                "umo_digital_write", place, self.f.values.as_type(term, REAL, node), of=BOOL
            )
        assert isinstance(owner, Binary)
        code = self.f.values.code(term, node)
        if isinstance(code.type, TextType):
            raise self.f.refused(node, "a text is written", "a state of the object")
        if isinstance(code.type, OptionalType):
            of, code = code.type.of, self.f.values.kept(code)
            self.f.raises(StateError, node, negated(has(code.value)))
            code = Code(of, inside(code.value))
        if code.type != state(owner.states):
            self.f.raises(StateError, node)
            return Known(False)
        return self.f.attributes.got_by("umo_binary_write", place, code.value, of=BOOL)

    def _input(self, which: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        sensor = arguments[0]
        accept = arguments[1] if len(arguments) > 1 else named.get("accept", Known(()))
        if not (isinstance(sensor, Known) and isinstance(sensor.value, Atomic)):
            raise self.f.refused(node, "the sensor is not known when the code is generated")
        place, mask = self.f.attributes.object(sensor.value, node), self.f.values.as_type(accept, MASK, node)
        if which is state_of and isinstance(sensor.value, Binary):
            return self.f.attributes.got_by("umo_state_of", place, mask, of=state(sensor.value.states))
        return self.f.attributes.got_by("umo_value_of", place, mask, of=REAL)

    def _host(self, owner: Any, name: str, arguments: Sequence[Term], node: ast.Call) -> Term:
        """Lower a request to the host, with numbers as arguments, for what only the host can do."""
        number = Literal(self.f.world.host_call(owner, name), INT)
        numbers = tuple(self.f.values.as_type(each, REAL, node) for each in arguments)
        self.f.called("umo_host_call", WholeMachine(), number, ZERO, Reals(numbers), Literal(len(numbers), INT))
        return Known(None)

    # Functions that are translated too -----------------------------------------------------------------

    def function(
        self, target: Callable[..., Any], arguments: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> Term:
        if inspect.iscoroutinefunction(target):
            raise self.f.refused(node, "a sequence runs on the host", "functions without await")
        try:
            found = bound(target)
        except NoSource as error:
            raise self.f.refused(
                node, f"{getattr(target, '__name__', target)}: {error}", "`def` in a file of the station"
            ) from None
        if inspect.isgeneratorfunction(found.source.function):
            raise self.f.refused(node, "a generator function is called", "sum(... for ...), a loop")
        given = [*map(Known, found.given), *arguments]
        terms = self._by_name(found.source.function, given, {k: Known(v) for k, v in found.named} | named, node)
        return self.f.world.invoke(self.f, found.source, terms, node)

    def _by_name(
        self, function: FunctionType, given: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> dict[str, Term]:
        signature = inspect.signature(function, follow_wrapped=False)
        try:
            bound_to = signature.bind(*given, **named)
        except TypeError as error:
            raise self.f.refused(node, str(error)) from None
        terms: dict[str, Term] = {}
        for name, each in signature.parameters.items():
            if each.kind is each.VAR_POSITIONAL:
                terms[name] = TupleTerm(tuple(bound_to.arguments.get(name, ())))
            elif each.kind is each.VAR_KEYWORD:
                if bound_to.arguments.get(name):
                    raise self.f.refused(node, "** cannot be translated", "name the arguments")
                terms[name] = Known({})
            else:
                term = bound_to.arguments.get(name, ABSENT)
                terms[name] = Known(each.default) if term is ABSENT else term
        return terms


ABSENT: Any = object()


def _tells(target: Any) -> bool:
    return isinstance(getattr(target, "__self__", None), logging.Logger) or target is print
