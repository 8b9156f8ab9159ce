"""Proofs that a text may be left out: making it has no effect and cannot fail. The proofs follow the parts of a text
into the functions, properties and methods that are called, including those of the user. Parts that cannot be proved
raise `Unproved`.

The proofs know the live objects of the machine, and for all other values the classes that these may have."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import Enum
from string import Formatter
from types import FunctionType, MethodType, ModuleType, NoneType
from typing import Any, NamedTuple, cast

import numpy as np

from umo.digits import number_text, setting_text
from umo.duration import duration, lasting
from umo.generate.c_types import CType
from umo.generate.function_source import ABSENT, NoSource, SourcedFunction, sourced
from umo.generate.known_values import Unwatchable
from umo.generate.lower.flow import disproved_by, expression_text, proved_by, without_name
from umo.generate.lower.terms import Term
from umo.generate.lower.text_kinds import (
    NUMBERS,
    PLAIN,
    TEXT,
    ClassKind,
    Kind,
    LiveKind,
    RowKind,
    TupleKind,
    are_one_enum,
    is_bare,
    is_plain,
    kind_of_term,
    kind_of_type,
    plain_kinds,
    some,
)
from umo.generate.value_kinds import attribute_kind, is_container, is_plain_enum, own_methods
from umo.objects import Compound, Node, Quality, Vector
from umo.objects.atomic import Atomic, Binary
from umo.objects.link import Cycle
from umo.objects.presentation.value_text import measure, span
from umo.operation import PackML, PackMLState, Procedure, ProcedureState
from umo.text import cut_repr

SHOWING = ("__str__", "__repr__", "__format__")
"""Methods that show an object in a text."""
OF_UMO = (Atomic.__repr__, Compound.__repr__, Vector.__repr__)
"""The methods of umo's objects that have no effect."""
MAKERS = (str, repr, cut_repr)
"""Functions that make a text from any value."""
OF_NUMBERS = (number_text, setting_text, measure, span, duration, lasting)
"""Functions of umo that make a text from numbers and units."""
METHODS = ("upper", "lower", "strip", "rstrip", "lstrip", "title", "capitalize", "removeprefix", "removesuffix",
           "replace")  # fmt: skip
"""Methods of a string that take and return strings."""
REDUCING = {"max": float, "min": float, "sum": float, "any": bool, "all": bool, "argmax": int, "argmin": int}
"""Methods of an array that is not empty, each with the class of its result."""
PROPERTIES: Mapping[Any, tuple[type, ...]] = {
    Node._path: (str,),
    Cycle.fault: (str, NoneType),
    Procedure.state: (ProcedureState,),
    PackML.state: (PackMLState,),
}
"""Properties of umo without an effect, each with the classes of its values."""
OF_ATOMIC: Mapping[str, tuple[type, ...]] = {
    "path": (str,),
    "units": (str,),
    "inhibited": (str, NoneType),
    "quality": (Quality,),
    "minimum": (float,),
    "maximum": (float,),
    "resolution": (float,),
}
FORMATS = {float: "fFeEgG%", int: "fFeEgG%dxob", bool: "d"}
"""The letters for the type at the end of a number's format."""
DEEPEST = 12
"""Maximum depth of nested calls."""


class Unproved(Exception):
    """Raised if a part of a text may have an effect or fail."""

    def __init__(self, node: ast.AST, source: SourcedFunction, why: str) -> None:
        super().__init__(why)
        self.node, self.source, self.why = node, source, why


class ProofQueries(NamedTuple):
    """The queries of a proof to the translation."""

    field: Callable[[Any, str], CType | None]
    """Function that returns the type of an attribute that is a number or a state, or None."""
    take: Callable[[Any, str, tuple[str, int]], None]
    """Function that records that an attribute of a live object is taken as known."""
    term: Callable[[str], Term | None]
    """Function that returns the term of a local name of the enclosing function, or None."""


class TextProof:
    """The proof for expressions of one function whose names have these kinds."""

    def __init__(self, source: SourcedFunction, names: Mapping[str, Kind], ways: ProofQueries, depth: int = 0) -> None:
        self._source, self._names, self._ways, self._depth = source, dict(names), ways, depth
        self._present = set[str]()
        """Expressions that are not None here."""

    def unproved(self, node: ast.AST, why: str = "it may change something or fail") -> Unproved:
        return Unproved(node, self._source, why)

    # Expressions ---------------------------------------------------------------------------------------

    def of(self, node: ast.AST) -> Kind:
        """Return the kind of an expression after proving that evaluating it has no effect and cannot fail."""
        found = EXPRESSIONS.get(type(node))
        if found is None:
            raise self.unproved(node)
        kind = found(self, node)
        if isinstance(kind, ClassKind) and expression_text(node) in self._present:
            return ClassKind(kind.kinds - {NoneType})
        return kind

    def shown(self, node: ast.AST) -> ClassKind:
        """Prove that a text may show this value."""
        self._show(self.of(node), node)
        return TEXT

    def text(self, node: ast.AST) -> ClassKind:
        """Prove that this value is a string."""
        kind = self.of(node)
        if kind != TEXT and not (isinstance(kind, LiveKind) and type(kind.value) is str):
            raise self.unproved(node, "it is not always a text")
        return TEXT

    def constant(self, node: ast.Constant) -> Kind:
        return LiveKind(node.value)

    def joined(self, node: ast.JoinedStr) -> Kind:
        for each in node.values:
            if isinstance(each, ast.FormattedValue):
                self._formatted(each)
        return TEXT

    def _formatted(self, node: ast.FormattedValue) -> None:
        spec = node.format_spec.values if isinstance(node.format_spec, ast.JoinedStr) else []
        if not spec:
            self.shown(node.value)
            return
        text = "".join(str(each.value) if isinstance(each, ast.Constant) else "?" for each in spec)
        if node.conversion == -1:
            self._check_format(self.of(node.value), text, node.value)
        else:
            self.shown(node.value)
            self._check_format(TEXT, text, node.value)

    def _check_format(self, kind: Kind, spec: str, node: ast.AST) -> None:
        """Prove that a value of this kind always accepts this format."""
        kinds = self._classes(kind)
        if kinds == {str}:
            fits = re.fullmatch(r"(.?[<>^])?[0-9]*(\.[0-9]+)?s?", spec) is not None
        else:
            ends = [FORMATS.get(each, "") for each in kinds]
            pattern = r"(.?[<>^=])?[-+ ]?#?0?[0-9]*[,_]?(\.[0-9]+)?({})"
            fits = all(each and re.fullmatch(pattern.format(f"[{each}]"), spec) for each in ends)
        if not fits or not kinds:
            raise self.unproved(node, f"the format {spec!r} does not suit all possible values")

    def _classes(self, kind: Kind) -> set[type]:
        if isinstance(kind, ClassKind):
            return {float if issubclass(each, np.generic) else each for each in kind.kinds}
        return {type(kind.value)} if isinstance(kind, LiveKind) else {object}

    def name(self, node: ast.Name) -> Kind:
        if node.id in self._names:
            return self._names[node.id]
        term = self._ways.term(node.id) if not self._depth else None
        if term is not None:
            return kind_of_term(term)
        if self._source.is_local(node.id) or (value := self._source.meaning(node.id)) is ABSENT:
            raise self.unproved(node, "it is used before it has a value on every branch")
        return LiveKind(value)

    def attribute(self, node: ast.Attribute) -> Kind:
        if isinstance(node.value, ast.Call) and _is_super(node.value):
            return self._of_super(node)
        return self.attribute_of(self.of(node.value), node.attr, node)

    def attribute_of(self, base: Kind, name: str, node: ast.AST) -> Kind:
        if isinstance(base, LiveKind):
            return self._of_live(base.value, name, node)
        if isinstance(base, RowKind) and name == "size":
            return some(int)
        if isinstance(base, TupleKind) and name in base.names:
            return base.parts[base.names.index(name)]
        kinds = base.kinds if isinstance(base, ClassKind) else ()
        if kinds and all(issubclass(each, Enum) and is_plain_enum(each) for each in kinds):
            if name == "name":
                return TEXT
            if name == "value":
                return ClassKind(
                    frozenset(type(member.value) for each in cast("frozenset[type[Enum]]", kinds) for member in each)
                )
            (kind, *others) = kinds
            static = inspect.getattr_static(kind, name, None)
            if not others and type(static) is property and static.fget is not None:
                return self._called(static.fget, [base], {}, node)
        raise self.unproved(node)

    def _of_live(self, owner: Any, name: str, node: ast.AST) -> Kind:
        if isinstance(owner, Atomic):
            if name == "pending":
                return some(owner.states) if isinstance(owner, Binary) else some(float)
            if name in OF_ATOMIC:
                return some(*OF_ATOMIC[name])
            raise self.unproved(node)
        if isinstance(owner, Compound) and name in ("dt", "now"):
            return some(float)
        if isinstance(owner, Compound) and name == "cycle":
            return LiveKind(owner.cycle)
        static = inspect.getattr_static(type(owner), name, None)
        if isinstance(static, property):
            if static in PROPERTIES:
                return some(*PROPERTIES[static])
            if static.fget is None:
                raise self.unproved(node)
            self._take(type(owner), name, node)
            return self._called(static.fget, [LiveKind(owner)], {}, node)
        if not isinstance(owner, ModuleType | type) and attribute_kind(owner, name) not in ("value", "function"):
            raise self.unproved(node)
        found = getattr(owner, name, ABSENT)
        if found is ABSENT:
            raise self.unproved(node, f"{type(owner).__name__} has no {name!r} now")
        return self._value_of(owner, name, found, node)

    def _value_of(self, owner: Any, name: str, found: Any, node: ast.AST) -> Kind:
        """Return the kind of an attribute of a live object. A number, a text or a state may have changed when it is
        shown; other values stay the same."""
        of = None if isinstance(owner, ModuleType | type) else self._ways.field(owner, name)
        if of is not None:
            return kind_of_type(of)
        if isinstance(owner, ModuleType | type | Enum) or not is_plain(found):
            self._take(owner, name, node)
            return LiveKind(found)
        return some(type(found))

    def _take(self, owner: Any, name: str, node: ast.AST) -> None:
        try:
            self._ways.take(owner, name, (self._source.file, getattr(node, "lineno", 0)))
        except Unwatchable as error:
            raise self.unproved(node, str(error)) from None

    def _of_super(self, node: ast.Attribute) -> Kind:
        me, kind = next(iter(self._names.values()), None), self._source.meaning("__class__")
        if not isinstance(me, LiveKind) or not isinstance(kind, type):
            raise self.unproved(node)
        mro = type(me.value).__mro__
        static = next((vars(each)[node.attr] for each in mro[mro.index(kind) + 1 :] if node.attr in vars(each)), None)
        if static in PROPERTIES:
            return some(*PROPERTIES[static])
        if not isinstance(static, property) or static.fget is None:
            raise self.unproved(node)
        return self._called(static.fget, [me], {}, node)

    def tuple(self, node: ast.Tuple | ast.List) -> Kind:
        parts: list[Kind] = []
        for each in node.elts:
            inner = self.of(each.value if isinstance(each, ast.Starred) else each)
            parts += self._parts(inner, each) if isinstance(each, ast.Starred) else [inner]
        return TupleKind(tuple(parts))

    def _parts(self, kind: Kind, node: ast.AST) -> Sequence[Kind]:
        """Return the kinds of the elements of a container of fixed length."""
        if isinstance(kind, TupleKind):
            return kind.parts
        if isinstance(kind, LiveKind) and is_container(kind.value) and not isinstance(kind.value, dict | set):
            return [LiveKind(each) for each in kind.value]
        if isinstance(kind, RowKind) and kind.count is not None:
            return [some(kind.of)] * kind.count
        raise self.unproved(node)

    def _each(self, kind: Kind, node: ast.AST) -> Sequence[Kind]:
        """Return the kinds of the elements in the turns of a loop; for numbers, one kind for all turns."""
        return [some(kind.of)] if isinstance(kind, RowKind) else self._parts(kind, node)

    def subscript(self, node: ast.Subscript) -> Kind:
        base = self.of(node.value)
        if isinstance(node.slice, ast.Slice):
            ends = [each for each in (node.slice.lower, node.slice.upper) if each is not None]
            if node.slice.step is None and all(self._classes(self.of(each)) == {int} for each in ends):
                if isinstance(base, RowKind):
                    return RowKind(base.of, None)
                if self._classes(base) == {str}:
                    return TEXT
            raise self.unproved(node)
        place = self.of(node.slice)
        if isinstance(place, LiveKind) and isinstance(base, LiveKind) and type(base.value) in (tuple, dict):
            entries = base.value if isinstance(base.value, dict) else dict(enumerate(base.value))
            if place.value in entries:
                return LiveKind(entries[place.value])
        if isinstance(place, LiveKind) and type(place.value) is int and not isinstance(base, ClassKind):
            parts = [] if isinstance(base, RowKind) and base.count is None else self._parts(base, node)
            if -len(parts) <= place.value < len(parts):
                return parts[place.value]
        raise self.unproved(node, "it may not have this element")

    # Conditions and operators ----------------------------------------------------------------------------

    def if_exp(self, node: ast.IfExp) -> Kind:
        self.asked(node.test)
        before = self._present
        self._present = before | proved_by(node.test)
        one = self.of(node.body)
        self._present = before | disproved_by(node.test)
        other = self.of(node.orelse)
        self._present = before
        return self._either(one, other, node)

    def _either(self, one: Kind, other: Kind, node: ast.AST) -> Kind:
        if one == other:
            return one
        kinds = [plain_kinds(each) for each in (one, other)]
        if None in kinds:
            raise self.unproved(node, "it is one of two objects")
        return ClassKind(frozenset().union(*cast("list[frozenset[type]]", kinds)))

    def _one_of(self, found: Sequence[Kind], node: ast.AST) -> Kind:
        kind = found[0]
        for other in found[1:]:
            kind = self._either(kind, other, node)
        return kind

    def asked(self, node: ast.AST) -> ClassKind:
        """Prove that the truth of this expression can be evaluated."""
        kind = self.of(node)
        if isinstance(kind, TupleKind):
            return some(bool)
        kinds = self._classes(kind)
        good = all(each in PLAIN or issubclass(each, tuple | list | dict) or is_bare(each) for each in kinds)
        if isinstance(kind, RowKind) or not good:
            raise self.unproved(node, "its class defines its truth value")
        return some(bool)

    def bool_op(self, node: ast.BoolOp) -> Kind:
        before, found = self._present, []
        for each in node.values:
            self.asked(each)
            found.append(self.of(each))
            self._present = self._present | (proved_by if isinstance(node.op, ast.And) else disproved_by)(each)
        self._present = before
        return self._one_of(found, node)

    def unary_op(self, node: ast.UnaryOp) -> Kind:
        if isinstance(node.op, ast.Not):
            return self.asked(node.operand)
        kind = self.of(node.operand)
        if isinstance(node.op, ast.Invert) and isinstance(kind, RowKind) and kind.of is bool:
            return kind
        if isinstance(node.op, ast.USub) and isinstance(kind, LiveKind) and type(kind.value) in NUMBERS:
            return LiveKind(-kind.value)
        if isinstance(node.op, ast.USub) and self._classes(kind) <= NUMBERS:
            return ClassKind(frozenset({int if each is bool else each for each in self._classes(kind)}))
        raise self.unproved(node)

    def compare(self, node: ast.Compare) -> Kind:
        operands = [self.of(each) for each in (node.left, *node.comparators)]
        for sign, one, other in zip(node.ops, operands[:-1], operands[1:], strict=True):
            if isinstance(sign, ast.Is | ast.IsNot):
                continue
            inner = self._parts(other, node) if isinstance(sign, ast.In | ast.NotIn) else [other]
            if any(isinstance(each, RowKind) for each in (one, *inner)):
                return self._compared_rows(one, other, node)
            kinds = set[type]().union(*map(self._classes, (one, *inner)))
            ordered = not isinstance(sign, ast.Eq | ast.NotEq | ast.In | ast.NotIn)
            if not (kinds <= NUMBERS if ordered else kinds <= PLAIN or are_one_enum(kinds)):
                raise self.unproved(node, "its class defines the comparison")
        return some(bool)

    def _compared_rows(self, one: Kind, other: Kind, node: ast.Compare) -> Kind:
        if len(node.ops) > 1 or isinstance(node.ops[0], ast.In | ast.NotIn):
            raise self.unproved(node)
        return RowKind(bool, self._common_count([one, other], node))

    def _common_count(self, kinds: Sequence[Kind], node: ast.AST) -> int:
        """Return the common length of arrays, among which there may be numbers."""
        counts = {each.count for each in kinds if isinstance(each, RowKind)}
        rest = [each for each in kinds if not isinstance(each, RowKind)]
        if len(counts) != 1 or None in counts or any(not self._classes(each) <= NUMBERS for each in rest):
            raise self.unproved(node)
        (count,) = counts
        return cast(int, count)

    def bin_op(self, node: ast.BinOp) -> Kind:
        one, other = self.of(node.left), self.of(node.right)
        kinds = [self._classes(each) for each in (one, other)]
        if kinds == [{str}, {str}] and isinstance(node.op, ast.Add):
            return TEXT
        if {str} in kinds and isinstance(node.op, ast.Mult):
            times = kinds[1] if kinds[0] == {str} else kinds[0]
            if times <= {int, bool}:
                return TEXT
        if isinstance(one, RowKind) or isinstance(other, RowKind):
            return self._of_rows(node, one, other)
        if all(each <= NUMBERS for each in kinds):
            whole = all(each <= {int, bool} for each in kinds)
            if isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
                return some(int if whole else float)
            divides = isinstance(node.op, ast.Div | ast.FloorDiv | ast.Mod)
            if divides and isinstance(other, LiveKind) and other.value:
                return some(int if whole and not isinstance(node.op, ast.Div) else float)
        raise self.unproved(node)

    def _of_rows(self, node: ast.BinOp, one: Kind, other: Kind) -> Kind:
        count = self._common_count([one, other], node)
        kinds = {each.of for each in (one, other) if isinstance(each, RowKind)}
        if kinds == {bool} and isinstance(node.op, ast.BitAnd | ast.BitOr):
            return RowKind(bool, count)
        if bool not in kinds and isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
            return RowKind(float, count)
        raise self.unproved(node)

    # Calls -----------------------------------------------------------------------------------------------

    def call(self, node: ast.Call) -> Kind:
        if isinstance(node.func, ast.Attribute) and not _is_super(node.func.value):
            base = self.of(node.func.value)
            if self._classes(base) == {str}:
                return self._method_of_text(base, node.func.attr, node)
            if isinstance(base, RowKind):
                return self._method_of_row(base, node.func.attr, node)
        func = self.of(node.func)
        if not isinstance(func, LiveKind):
            raise self.unproved(node)
        if isinstance(func.value, Hashable) and func.value in FUNCTIONS and not isinstance(func.value, MethodType):
            return FUNCTIONS[func.value](self, node)
        if any(isinstance(each, ast.Starred) for each in node.args) or any(each.arg is None for each in node.keywords):
            raise self.unproved(node)
        given = [self.of(each) for each in node.args]
        named = {str(each.arg): self.of(each.value) for each in node.keywords}
        return self._called(func.value, given, named, node)

    def _called(self, target: Any, given: Sequence[Kind], named: Mapping[str, Kind], node: ast.AST) -> Kind:
        """Return the kind of a call of a Python function, whose body is proved."""
        if isinstance(target, MethodType):
            target, given = target.__func__, [LiveKind(target.__self__), *given]
        if not isinstance(target, FunctionType) or self._depth > DEEPEST:
            raise self.unproved(node, "it is not known what the function does")
        try:
            source = sourced(target)
            bound = inspect.signature(target, follow_wrapped=False).bind(*given, **named)
        except (NoSource, TypeError) as error:
            raise self.unproved(node, str(error)) from None
        if not isinstance(source.tree, ast.FunctionDef) or inspect.isgeneratorfunction(target):
            raise self.unproved(node)
        for each in bound.signature.parameters.values():
            if each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD):
                raise self.unproved(node)
            if each.name not in bound.arguments:
                bound.arguments[each.name] = LiveKind(each.default)
        return TextProof(source, bound.arguments, self._ways, self._depth + 1).function()

    def _method_of_text(self, base: Kind, name: str, node: ast.Call) -> Kind:
        if name == "join" and len(node.args) == 1 and not node.keywords:
            self._elements(node.args[0])
        elif name == "format" and isinstance(base, LiveKind):
            self._format(base.value, node)
        elif name in METHODS and not node.keywords:
            for argument in node.args:
                self.text(argument)
            try:
                getattr("", name)(*[""] * len(node.args))
            except TypeError as error:
                raise self.unproved(node, str(error)) from None
        else:
            raise self.unproved(node)
        return TEXT

    def _elements(self, node: ast.expr) -> None:
        """Prove that the elements of a `join` are texts."""
        if isinstance(node, ast.GeneratorExp | ast.ListComp):
            self._turns(node, self.text)
        elif isinstance(node, ast.Tuple | ast.List):
            for each in node.elts:
                self.text(each)
        elif isinstance(node, ast.Call) and self.of(node.func) == LiveKind(map) and len(node.args) == 2:
            maker, over = self.of(node.args[0]), self.of(node.args[1])
            if not (isinstance(maker, LiveKind) and maker.value in MAKERS):
                raise self.unproved(node)
            for part in self._each(over, node):
                self._show(part, node)
        elif any(self._classes(each) != {str} for each in self._parts(self.of(node), node)):
            raise self.unproved(node)

    def _turns(self, node: ast.GeneratorExp | ast.ListComp, each_turn: Callable[[ast.AST], Any]) -> None:
        """Prove the turns of a generator with one loop."""
        (loop, *more) = node.generators
        if more or loop.is_async:
            raise self.unproved(node)
        over, before = self.of(loop.iter), dict(self._names)
        for part in self._each(over, node):
            self._bind(loop.target, part)
            for test in loop.ifs:
                self.asked(test)
            each_turn(node.elt)
            self._names = dict(before)

    def _bind(self, target: ast.AST, kind: Kind) -> None:
        if isinstance(target, ast.Name):
            self._names[target.id] = kind
            self._present = without_name(self._present, target.id)
            return
        parts = self._parts(kind, target) if isinstance(target, ast.Tuple) else ()
        if not isinstance(target, ast.Tuple) or len(parts) != len(target.elts):
            raise self.unproved(target)
        for each, part in zip(target.elts, parts, strict=True):
            self._bind(each, part)

    def _format(self, text: str, node: ast.Call) -> None:
        """Prove `"...".format(...)` with positional arguments."""
        given = iter(node.args)
        for _, name, spec, conversion in Formatter().parse(text):
            if name is None:
                continue
            each = next(given, None)
            if name or conversion or each is None:
                raise self.unproved(node)
            kind = self.of(each)
            if spec:
                self._check_format(kind, spec, each)
            else:
                self._show(kind, each)
        if node.keywords:
            raise self.unproved(node)

    def _method_of_row(self, base: RowKind, name: str, node: ast.Call) -> Kind:
        if name in REDUCING and base.count and not node.args and not node.keywords:
            return some(base.of if REDUCING[name] is float and base.of is not bool else REDUCING[name])
        raise self.unproved(node)

    def shows(self, node: ast.Call) -> Kind:
        """Prove `str` or `repr` of one argument."""
        if len(node.args) > 1 or node.keywords:
            raise self.unproved(node)
        for each in node.args:
            self.shown(each)
        return TEXT

    def of_numbers(self, node: ast.Call) -> Kind:
        """Prove a function of umo that makes a text from numbers and units."""
        for each in (*node.args, *(one.value for one in node.keywords)):
            if not self._classes(self.of(each)) <= NUMBERS | {str, NoneType}:
                raise self.unproved(each)
        return TEXT

    def _argument(self, node: ast.Call, place: int = 0, count: int = 1) -> Kind:
        """Return one argument of a function that takes this number of arguments."""
        if len(node.args) != count or node.keywords:
            raise self.unproved(node)
        return self.of(node.args[place])

    def length(self, node: ast.Call) -> Kind:
        kind = self._argument(node)
        if isinstance(kind, RowKind | TupleKind) or self._classes(kind) == {str}:
            return some(int)
        if isinstance(kind, LiveKind) and (is_container(kind.value) or isinstance(kind.value, Vector)):
            return some(int)
        raise self.unproved(node)

    def absolute(self, node: ast.Call) -> Kind:
        kinds = self._classes(self._argument(node))
        if not kinds <= NUMBERS:
            raise self.unproved(node)
        return ClassKind(frozenset({int if each is bool else each for each in kinds}))

    def rounded(self, node: ast.Call) -> Kind:
        """Prove `round(x, digits)`."""
        if len(node.args) != 2 or not isinstance(node.args[1], ast.Constant) or node.keywords:
            raise self.unproved(node)
        return self.absolute(ast.copy_location(ast.Call(node.func, node.args[:1], []), node))

    def extreme(self, node: ast.Call) -> Kind:
        """Prove `min` or `max` of several numbers."""
        kinds = set[type]().union(*(self._classes(self.of(each)) for each in node.args))
        if len(node.args) < 2 or node.keywords or not kinds <= NUMBERS:
            raise self.unproved(node)
        return ClassKind(frozenset(kinds))

    def truth(self, node: ast.Call) -> Kind:
        if len(node.args) != 1:
            raise self.unproved(node)
        return self.asked(node.args[0])

    def total(self, node: ast.Call) -> Kind:
        """Prove `sum` of a generator or a list of numbers."""
        found: set[type] = {int}

        def add(each: ast.AST) -> None:
            found.update(self._classes(self.of(each)))

        if len(node.args) != 1 or node.keywords:
            raise self.unproved(node)
        if isinstance(node.args[0], ast.GeneratorExp | ast.ListComp):
            self._turns(node.args[0], add)
        else:
            kind = self.of(node.args[0])
            for each in self._each(kind, node):
                found |= self._classes(each)
        if not found <= NUMBERS:
            raise self.unproved(node)
        return ClassKind(frozenset(found - {bool}))

    def places(self, node: ast.Call) -> Kind:
        """Prove `np.flatnonzero` of an array."""
        if not isinstance(self._argument(node), RowKind):
            raise self.unproved(node)
        return RowKind(int, None)

    def chosen(self, node: ast.Call) -> Kind:
        """Prove `np.where` of three arguments."""
        if len(node.args) != 3:
            raise self.unproved(node)
        kinds = [self.of(each) for each in node.args]
        count = self._common_count(kinds, node)
        found = set[type]().union(
            *({each.of} if isinstance(each, RowKind) else self._classes(each) for each in kinds[1:])
        )
        return RowKind(float if float in found else max(found, key=[bool, int].index), count)

    def counted(self, node: ast.Call) -> Kind:
        """Prove `np.count_nonzero` of an array."""
        self.places(node)
        return some(int)

    def converted(self, node: ast.Call) -> Kind:
        """Prove `cast` of typing, which does nothing."""
        return self._argument(node, 1, 2)

    # What is shown ---------------------------------------------------------------------------------------

    def _show(self, kind: Kind, node: ast.AST) -> None:
        """Prove that a text can show this without an effect and without a failure."""
        if isinstance(kind, RowKind):
            return
        if isinstance(kind, TupleKind):
            for each in kind.parts:
                self._show(each, node)
            return
        if isinstance(kind, LiveKind) and is_container(kind.value) and not isinstance(kind.value, str | np.ndarray):
            values = kind.value.items() if isinstance(kind.value, dict) else kind.value
            for value in values:
                self._show(LiveKind(value), node)
            return
        for of in [type(kind.value)] if isinstance(kind, LiveKind) else kind.kinds:
            self._show_object(of, kind, node)

    def _show_object(self, kind: type, value: Kind, node: ast.AST) -> None:
        if kind is object:
            raise self.unproved(node)
        for name in own_methods(kind, SHOWING):
            method = getattr(kind, name)
            if method in OF_UMO or issubclass(kind, np.generic | np.ndarray | BaseException):
                continue
            if name == "__repr__" and is_dataclass(kind) and method.__code__.co_filename == "<string>":
                continue
            if name == "__repr__" and is_dataclass(kind) and hasattr(method, "__wrapped__"):
                self._show_fields(kind, value, node)
                continue
            more: list[Kind] = [TEXT] if name == "__format__" else []
            one = value if isinstance(value, LiveKind) else some(kind)
            if self._classes(self._called(method, [one, *more], {}, node)) != {str}:
                raise self.unproved(node)

    def _show_fields(self, kind: Any, value: Kind, node: ast.AST) -> None:
        """Prove the fields of a dataclass, which its own method shows."""
        for name, each in kind.__dataclass_fields__.items():
            if each.repr:
                self._show(self.attribute_of(value, name, node), node)

    # Functions -------------------------------------------------------------------------------------------

    def function(self) -> Kind:
        """Return the kind of the result of the function. The statements of the function may only compute."""
        assert isinstance(self._source.tree, ast.FunctionDef)
        found: list[Kind] = []
        if self._body(self._source.tree.body, found):
            found.append(LiveKind(None))
        return self._one_of(found, self._source.tree)

    def _body(self, statements: Sequence[ast.stmt], found: list[Kind]) -> bool:
        """Prove the statements. Return True if the code after them is reached."""
        for each in statements:
            if isinstance(each, ast.Return):
                found.append(LiveKind(None) if each.value is None else self.of(each.value))
                return False
            if isinstance(each, ast.If):
                if not self._if(each, found):
                    return False
            elif isinstance(each, ast.Assign) and len(each.targets) == 1:
                self._bind(each.targets[0], self.of(each.value))
            elif isinstance(each, ast.AnnAssign) and each.value is not None:
                self._bind(each.target, self.of(each.value))
            elif isinstance(each, ast.AugAssign) and isinstance(each.target, ast.Name):
                left = ast.copy_location(ast.Name(each.target.id, ast.Load()), each)
                self._bind(each.target, self.of(ast.copy_location(ast.BinOp(left, each.op, each.value), each)))
            elif not (isinstance(each, ast.Pass) or (isinstance(each, ast.Expr) and _is_constant(each.value))):
                raise self.unproved(each)
        return True

    def _if(self, node: ast.If, found: list[Kind]) -> bool:
        self.asked(node.test)
        before, ends = (self._names, self._present), list[tuple[dict[str, Kind], set[str]]]()
        for body, shown in ((node.body, proved_by(node.test)), (node.orelse, disproved_by(node.test))):
            self._names, self._present = dict(before[0]), before[1] | shown
            if self._body(body, found):
                ends.append((self._names, self._present))
        if len(ends) == 2:
            (one, known), (other, more) = ends
            self._names = {name: self._either(one[name], other[name], node) for name in one.keys() & other.keys()}
            self._present = known & more
        else:
            self._names, self._present = ends[0] if ends else before
        return bool(ends)


EXPRESSIONS: Mapping[type[ast.AST], Callable[[TextProof, Any], Kind]] = {
    ast.Constant: TextProof.constant,
    ast.JoinedStr: TextProof.joined,
    ast.Name: TextProof.name,
    ast.Attribute: TextProof.attribute,
    ast.Tuple: TextProof.tuple,
    ast.List: TextProof.tuple,
    ast.Subscript: TextProof.subscript,
    ast.IfExp: TextProof.if_exp,
    ast.BoolOp: TextProof.bool_op,
    ast.UnaryOp: TextProof.unary_op,
    ast.Compare: TextProof.compare,
    ast.BinOp: TextProof.bin_op,
    ast.Call: TextProof.call,
}
FUNCTIONS: Mapping[Any, Callable[[TextProof, ast.Call], Kind]] = {
    **dict.fromkeys(MAKERS, TextProof.shows),
    **dict.fromkeys(OF_NUMBERS, TextProof.of_numbers),
    len: TextProof.length,
    abs: TextProof.absolute,
    round: TextProof.rounded,
    min: TextProof.extreme,
    max: TextProof.extreme,
    bool: TextProof.truth,
    sum: TextProof.total,
    cast: TextProof.converted,
    np.flatnonzero: TextProof.places,
    np.where: TextProof.chosen,
    np.count_nonzero: TextProof.counted,
}


def _is_super(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super" and not node.args


def _is_constant(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant)
