"""Finds states, objects and attributes in a station's code that are certainly wrong: a comparison that is never true,
an attribute that does not exist. Their types are known from the objects of the machine that the station declares."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from types import UnionType
from typing import Any, Union, get_origin

from umo.objects import Atomic, Compound
from umo.objects.attributes import DeclaredAttributes, names_in
from umo.objects.stored_names import stores_in
from umo.signature import hints_of
from umo.states import TwoState, comparisons, shown
from umo.text import did_you_mean, near_attribute
from umo_command.check.code_values import MISSING, ExactObject, Instance, ModuleCode, NameScope, Objects, below

SIGNS: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.IsNot: "!=", ast.NotEq: "!=",
}  # fmt: skip
"""Signs of comparisons between numbers; == stands for any other comparison."""
TURNED = {"<": ">", ">": "<", "<=": ">=", ">=": "<="}
"""Signs of comparisons with the sides exchanged."""
STATES = ("pending", "default", "one", "zero")
"""Properties of an object whose value is one of its states."""


class CodeObjects:
    """The meaning of the expressions of one module, for objects of the machine."""

    def __init__(self, code: ModuleCode, known: Objects) -> None:
        self._code, self._known = code, known

    def mistaken(self, node: ast.Compare | ast.Match, scope: NameScope) -> Iterator[tuple[ast.expr, str]]:
        """Return the errors in a comparison or a `match`, each with its expression."""
        if isinstance(node, ast.Match):
            yield from self._mistaken_match(node, scope)
            return
        for left, sign, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            if isinstance(sign, ast.In | ast.NotIn):
                for each in right.elts if isinstance(right, ast.Tuple | ast.List | ast.Set) else []:
                    yield from self._compared(left, "==", each, scope)
                continue
            yield from self._of_two_types(left, right, scope)
            as_written = SIGNS.get(type(sign), "==")
            yield from self._compared(left, as_written, right, scope)
            yield from self._compared(right, TURNED.get(as_written, as_written), left, scope)

    def _of_two_types(self, one: ast.expr, other: ast.expr, scope: NameScope) -> Iterator[tuple[ast.expr, str]]:
        """Yield the mistakes in a comparison of two states that are read."""
        kinds = [self.states_of(each, scope) for each in (one, other)]
        if None not in kinds and kinds[0] is not kinds[1]:
            first, second = (each.__name__ for each in kinds if each is not None)
            yield one, f"`{{}}` is a state of {first} and is compared with a state of {second}: they are never equal"

    def _mistaken_match(self, node: ast.Match, scope: NameScope) -> Iterator[tuple[ast.expr, str]]:
        """Yield the mistakes in a `match`."""
        for case in node.cases:
            for subject, value in _compared_by(node.subject, case.pattern):
                yield from self._compared(subject, "==", value, scope)

    def _compared(self, one: ast.expr, sign: str, other: ast.expr, scope: NameScope) -> Iterator[tuple[ast.expr, str]]:
        """Yield the mistakes in the comparison of `one`, the value that is tested, with `other`."""
        written = self._written(other, scope)
        states = None if written is MISSING else self.states_of(one, scope)
        if states is not None and type(written) is not states:
            nearest = comparisons(states, written)
            yield (
                one,
                f"`{{}}` is a state of {states.__name__}, and is never equal to {shown(written)}: write {nearest}",
            )
        elif isinstance(written, Enum | str | bytes) and self._is_number(one, scope):
            yield one, f"`{{}}` is a number, and is never equal to {shown(written)}"
        items = [] if written is MISSING or states else self.objects(one, scope)
        if items and all(kinds := set(map(_states, items))):
            if len(kinds) == 1 and (kind := kinds.pop()):
                nearest = comparisons(kind, written, "{}.read() ")
                yield one, f"`{{}}` is an object, not its state: write {nearest}"
        elif items and all(isinstance(each, Atomic) for each in items):
            number = shown(written) if isinstance(written, int | float) else "..."
            yield one, f"`{{}}` is an object, not its value: write `{{}}.read() {sign} {number}`"

    def wrongly_written(self, node: ast.Call, scope: NameScope) -> str | None:
        """Return the error in a written value: an object in place of its value, or a value of another type."""
        if not (isinstance(node.func, ast.Attribute) and node.func.attr == "write" and node.args):
            return None
        items, given = self.objects(node.func.value, scope), node.args[0]
        kind = self._code.atomic(node.func.value, scope)
        if not (all(isinstance(each, Atomic) for each in items) if items else kind):
            return None
        if items and self._code.atomic(given, scope):
            return f"`{{}}`: an object is written, not its value: write `{ast.unparse(given)}.read()`"
        states: set[type[TwoState] | None] = set(map(_states, items))
        if not items and kind:
            states = {TwoState if kind._has_states else None}
        written = given.value if isinstance(given, ast.Constant) else self._written(given, scope)
        if len(states) != 1 or not _is_wrong(written, taken := states.pop()):
            return None
        values = "one of its states" if taken is TwoState else " or ".join(map(shown, taken or ()))
        return f"`{{}}`: it takes {values or 'a number in its unit'}, not {shown(written)}"

    def no_truth(self, node: ast.expr, scope: NameScope) -> str | None:
        """Return the error in code that uses the truth of a state or an object. An optional object is accepted."""
        if (states := self.states_of(node, scope)) is not None:
            ways = comparisons(states, "", "{} ")
            return f"`{{}}` is a state, which is neither true nor false: write {ways}"
        items, found = self.objects(node, scope), self._code.thing(node, scope)
        if not items or not all(isinstance(each, Atomic) for each in items):
            return None
        if (isinstance(found, Instance) and found.optional) or any(map(_may_be_missing, items)):
            return None
        compared = "is ..." if items[0]._has_states else "> ..."
        return f"`{{}}` is an object, which is always true: write `{{}}.read() {compared}`"

    def is_state(self, node: ast.expr, scope: NameScope) -> bool:
        """True if the expression is a state written in the code, such as OnOff.ON."""
        return isinstance(self._written(node, scope), TwoState)

    def _written(self, node: ast.expr, scope: NameScope) -> Any:
        """Return a state, number or text written in the code."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
            node = node.operand
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, int | float | str | bytes) else MISSING
        if isinstance(node, ast.Attribute):
            of = self._code.thing(node.value, scope)
            if isinstance(of, ExactObject) and isinstance(of.value, type) and issubclass(of.value, Enum):
                return of.value.__members__.get(node.attr, MISSING)
        return MISSING

    def states_of(self, node: ast.expr, scope: NameScope) -> type[TwoState] | None:
        """Return the two-state type of the states that an expression may have."""
        source = self._source_of(node, scope)
        items = [] if source is None else self.objects(*source)
        kinds = set(map(_states, items))
        return kinds.pop() if len(kinds) == 1 else None

    def _is_number(self, node: ast.expr, scope: NameScope) -> bool:
        """True if an expression is the value of an actuator or a sensor that has no states."""
        source = self._source_of(node, scope)
        items = [] if source is None else self.objects(*source)
        return bool(items) and all(isinstance(each, Atomic) and not each._has_states for each in items)

    def _source_of(self, node: ast.expr, scope: NameScope) -> tuple[ast.expr, NameScope] | None:
        """Return the object whose state an expression is: `m.valve.read()`, `state_of(m.valve)`, `m.valve.pending`, or
        a name that is bound to such an expression. Return None for any other expression."""
        if isinstance(node, ast.Name):
            bound = _bound(node.id, scope)
            return self._source_of(*bound[1:]) if bound and bound[0] == "value" else None
        if isinstance(node, ast.Attribute):
            return (node.value, scope) if node.attr in STATES else None
        if not isinstance(node, ast.Call):
            return None
        if isinstance(node.func, ast.Attribute) and node.func.attr == "read":
            return node.func.value, scope
        function = self._code.thing(node.func, scope)
        is_state = isinstance(function, ExactObject) and getattr(function.value, "__name__", "") == "state_of"
        return (node.args[0], scope) if is_state and node.args else None

    # Objects -------------------------------------------------------------------------------------------

    def objects(self, node: ast.expr, scope: NameScope) -> list[Any]:
        """Return the objects of the machine that an expression may mean, or none if they are not certain."""
        if isinstance(node, ast.Name):
            return self._named(node, scope)
        if isinstance(node, ast.Attribute):
            found = [self._known.own(each, node.attr) for each in self.objects(node.value, scope)]
            return [] if any(each is MISSING for each in found) else found
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            return _elements([_values(each) for each in self.objects(node.value, scope)])
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "values":
            found = self.objects(node.func.value, scope)
            return [_values(each) for each in found] if all(isinstance(each, Mapping) for each in found) else []
        return []

    def _named(self, node: ast.Name, scope: NameScope) -> list[Any]:
        bound = _bound(node.id, scope)
        if bound is not None and bound[0] == "value":
            return self.objects(*bound[1:])
        if bound is not None and bound[0] == "element":
            return _elements(self.objects(*bound[1:]))
        found = self._code.thing(node, scope)
        if isinstance(found, ExactObject):
            return [found.value] if isinstance(found.value, Compound | Atomic) else []
        return self._known.of(found.kind) if isinstance(found, Instance) else []

    # Attributes ----------------------------------------------------------------------------------------

    def misspelt(self, node: ast.Attribute, scope: NameScope) -> str | None:
        """Return the error in the use of an attribute that none of the possible objects has."""
        if node.attr.startswith("_"):
            return None
        states = self._code.value(node.value, scope)
        if isinstance(states, type) and issubclass(states, TwoState) and not hasattr(states, node.attr):
            near = did_you_mean(node.attr, list(states.__members__))
            return f"`{{}}`: {states.__name__} has no state {node.attr!r}{near}"
        items = self.objects(node.value, scope)
        if not items:
            return None
        kinds = {type(each) for each in items}
        derived = {each for kind in kinds for each in below(kind)}
        """The further classes that the object may have after `isinstance`."""
        if not all(map(_has_declared, kinds | derived)):
            return None
        if any(_has(each, node.attr) for each in items) or any(_declares(each, node.attr) for each in derived):
            return None
        near = near_attribute(node.attr, {name for each in items for name in dir(each)})
        if isinstance(node.ctx, ast.Store) and isinstance(items[0], Atomic):
            near = items[0]._instead_of_setting("...")
        return f"`{{}}`: {' and '.join(sorted(each.__name__ for each in kinds))} has no attribute {node.attr!r}{near}"


def _compared_by(subject: ast.expr, pattern: ast.pattern) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield the comparisons that the pattern of a `case` makes: the tested value (the subject or an element of it), and
    the value of the pattern."""
    if isinstance(pattern, ast.MatchValue):
        yield subject, pattern.value
    elif isinstance(pattern, ast.MatchSingleton) and pattern.value is not None:
        yield subject, ast.copy_location(ast.Constant(pattern.value), subject)
    elif isinstance(pattern, ast.MatchOr):
        for each in pattern.patterns:
            yield from _compared_by(subject, each)
    elif isinstance(pattern, ast.MatchAs) and pattern.pattern is not None:
        yield from _compared_by(subject, pattern.pattern)
    elif isinstance(pattern, ast.MatchSequence) and isinstance(subject, ast.Tuple | ast.List):
        parts = [*subject.elts, *pattern.patterns]
        is_even = len(subject.elts) == len(pattern.patterns)
        if is_even and not any(isinstance(each, ast.Starred | ast.MatchStar) for each in parts):
            for one, each in zip(subject.elts, pattern.patterns, strict=True):
                yield from _compared_by(one, each)


def _bound(name: str, scope: NameScope | None) -> tuple[str, ast.expr, NameScope] | None:
    """Return the binding of a name in a function, if there is only one: two loops over the same expression count as
    one."""
    while scope is not None:
        bindings = scope.bindings.get(name, [])
        if bindings:
            how, node = bindings[0]
            ways = {(each.how, ast.dump(each.node)) for each in bindings}
            return (how if len(ways) == 1 else "", node, scope)
        scope = scope.around
    return None


def _is_wrong(written: Any, taken: type[TwoState] | None) -> bool:
    """True if an actuator cannot take the written value. `taken`: its states, `TwoState` if they are not known, None
    for numbers."""
    if isinstance(written, TwoState):
        return taken is None or not isinstance(written, taken)
    if isinstance(written, int | float) and not isinstance(written, bool):
        return taken is not None
    return written is None or isinstance(written, str | bytes | bool)


def _states(item: object) -> type[TwoState] | None:
    """Return the two-state type of an object, or None for other values."""
    found = item._states if isinstance(item, Atomic) else None
    return found if found is not None and issubclass(found, TwoState) else None


def _may_be_missing(item: Atomic) -> bool:
    """True if the class of the object's compound declares that the object may be None."""
    kind: Any = type(item._parent)
    hint = hints_of(kind).get(item._name.partition(".")[0])
    return get_origin(hint) in (Union, UnionType)


def _values(item: Any) -> Any:
    """Return the values of a mapping, whose elements are its keys; any other object unchanged."""
    return tuple(item.values()) if isinstance(item, Mapping) else item


def _elements(items: Iterable[Any]) -> list[Any]:
    """Return all elements of tuples and lists."""
    items = list(items)
    return [one for each in items for one in each] if all(isinstance(each, tuple | list) for each in items) else []


def _has_declared(kind: type) -> bool:
    """True if objects of this class have only the attributes that classes declare, as objects, states and laws of
    umo."""
    of_umo = issubclass(kind, DeclaredAttributes) or any(
        each.__module__.startswith("umo.control.") for each in kind.__mro__
    )
    return of_umo and not hasattr(kind, "__getattr__")


def _has(item: Any, name: str) -> bool:
    return inspect.getattr_static(item, name, MISSING) is not MISSING or _declares(type(item), name)


def _declares(kind: type, name: str) -> bool:
    return name in names_in(kind) or any(name == each.name for own in kind.__mro__ for each in stores_in(own))
