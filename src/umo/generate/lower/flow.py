"""The known facts at a point in a function: the meaning of each name, and which values are not None."""

from __future__ import annotations

import ast
from collections.abc import Sequence, Set
from typing import NamedTuple, TypeAlias

from umo.generate.c_types import CType, OptionalType
from umo.generate.form import Field, inside, root
from umo.generate.lower.terms import Code, Term

Names: TypeAlias = dict[str, CType | Term]
"""The local names. Each has the type of a variable, or another meaning: a live object, one or some of several objects,
or the array of another name."""


class FlowState(NamedTuple):
    """The known facts at one point in a function."""

    names: Names
    known: set[str]


class KnownFlow:
    """The known facts at the next statement."""

    def __init__(self) -> None:
        self.names: Names = {}
        self.known: set[str] = set()
        """Expressions that are not None here: local names and fields."""
        self.left: dict[str, list[FlowState]] = {}
        """The known facts at each jump to a label."""
        self._decided: dict[ast.AST, tuple[Names, Names]] = {}
        """What is known if an `and` or an `or` that was lowered is true, and if it is false."""

    # What is known at a place ----------------------------------------------------------------------------

    def way(self) -> FlowState:
        """Return the known facts at this point."""
        return FlowState(dict(self.names), set(self.known))

    def go_on_from(self, ways: Sequence[FlowState]) -> None:
        """Continue where these branches meet. A name that has the same meaning in all of them stays known."""
        first, *rest = ways
        self.names = common([each.names for each in ways])
        self.known = first.known.intersection(*(way.known for way in rest))

    def forget(self, target: ast.AST) -> None:
        """Forget the facts about a name or an attribute that is assigned, and about everything that is found through
        it."""
        if isinstance(target, ast.Name):
            self.known = without_name(self.known, target.id)
        elif isinstance(target, ast.Attribute):
            self.known = {each for each in self.known if f"attr='{target.attr}'" not in each}

    def proved(self, term: Term, node: ast.AST) -> Term:
        """Return an optional term as its value if it is proved not to be None here. Return any other term unchanged. A
        property is never proved, because it may return another value each time."""
        if not (isinstance(term, Code) and isinstance(term.type, OptionalType)):
            return term
        lasting = isinstance(node, ast.Name) or (
            isinstance(node, ast.Attribute) and isinstance(root(term.value), Field)
        )
        return Code(term.type.of, inside(term.value)) if lasting and expression_text(node) in self.known else term

    def only(self, names: Names) -> None:
        """Keep only the names that still have the same meaning."""
        self.names = common([names, self.names])

    def forget_fields(self) -> None:
        """Forget the facts about fields, because each may have changed."""
        self.known = {each for each in self.known if each.startswith("Name(")}

    # Names that a condition gives a value (`:=`) ----------------------------------------------------------

    def decide(self, node: ast.BoolOp, both: bool, early: Sequence[Names], last: tuple[Names, Names]) -> None:
        """Record the known names after `and` (`both`) or `or`. `early` are the names where an operand before the last
        one has decided the result; the others are those where the last operand is true or false."""
        when_true, when_false = last
        if both:
            when_false = common([*early, when_false])
        else:
            when_true = common([*early, when_true])
        self._decided[node] = when_true, when_false
        self.names = common([when_true, when_false])

    def names_if(self, test: ast.AST) -> tuple[Names, Names]:
        """Return the known names for the case that a condition is true, and for the case that it is false. The
        condition must be the last one that was lowered."""
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            when_true, when_false = self.names_if(test.operand)
            return when_false, when_true
        found = self._decided.pop(test, None)
        return found or (dict(self.names), dict(self.names))


def proved_by(test: ast.AST) -> set[str]:
    """Return the expressions that are not None if a condition holds, in the notation of `expression_text`."""
    if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And):
        return set().union(*map(proved_by, test.values))
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return disproved_by(test.operand)
    if _compares_none(test, ast.IsNot):
        return {expression_text(test.left)}  # type: ignore[attr-defined]
    return {expression_text(test)} if isinstance(test, ast.Name | ast.Attribute) else set()


def disproved_by(test: ast.AST) -> set[str]:
    """Return the expressions that are not None if a condition does not hold."""
    if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):
        return set().union(*map(disproved_by, test.values))
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return proved_by(test.operand)
    return {expression_text(test.left)} if _compares_none(test, ast.Is) else set()  # type: ignore[attr-defined]


def expression_text(node: ast.AST) -> str:
    """Return a unique text for an expression. A place has the same text when it is set and when it is read."""
    if isinstance(node, ast.Name):
        return f"Name(id={node.id!r})"
    if isinstance(node, ast.Attribute):
        return f"Attribute(value={expression_text(node.value)}, attr={node.attr!r})"
    return ast.dump(node)


def without_name(known: Set[str], name: str) -> set[str]:
    """Return the expressions that do not contain this name."""
    return {each for each in known if f"id='{name}'" not in each}


def common(ways: Sequence[Names]) -> Names:
    """Return the names that have the same meaning at all of these points."""
    first, *rest = ways
    return {name: each for name, each in first.items() if all(way.get(name) == each for way in rest)}


def _compares_none(test: ast.AST, sign: type[ast.cmpop]) -> bool:
    if not (isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], sign)):
        return False
    other = test.comparators[0]
    return isinstance(other, ast.Constant) and other.value is None
