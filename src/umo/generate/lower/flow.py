"""What is known at a place of a function: what each name stands for, and what is not None."""

from __future__ import annotations

import ast
from collections.abc import Sequence, Set
from typing import NamedTuple, TypeAlias

from umo.generate.c_types import CType, OptionalType
from umo.generate.form import Field, inside, root
from umo.generate.lower.terms import Code, Term

Names: TypeAlias = dict[str, CType | Term]
"""Local names: the types of those that are variables, or what each stands for: a live object, one or some of several,
the array of another name."""


class Way(NamedTuple):
    """What is known at a place of a function."""

    names: Names
    known: set[str]


class KnownFlow:
    """What is known where the next statement stands."""

    def __init__(self) -> None:
        self.names: Names = {}
        self.known: set[str] = set()
        """Expressions that are not None here: local names, and fields."""
        self.left: dict[str, list[Way]] = {}
        """What was known where each label is left to."""
        self._decided: dict[ast.AST, tuple[Names, Names]] = {}
        """The names where an `and` or an `or` that was lowered is true, and where it is false."""

    # What is known at a place ----------------------------------------------------------------------------

    def way(self) -> Way:
        """What is known here."""
        return Way(dict(self.names), set(self.known))

    def go_on_from(self, ways: Sequence[Way]) -> None:
        """What is known where these ways meet: names that have the same on all of them."""
        first, *rest = ways
        self.names = common([each.names for each in ways])
        self.known = first.known.intersection(*(way.known for way in rest))

    def forget(self, target: ast.AST) -> None:
        """A name or an attribute has another value from here on, and so has what is found through it."""
        if isinstance(target, ast.Name):
            self.known = without_name(self.known, target.id)
        elif isinstance(target, ast.Attribute):
            self.known = {each for each in self.known if f"attr='{target.attr}'" not in each}

    def proved(self, term: Term, node: ast.AST) -> Term:
        """What may be None, as what it is where it is not None here; any other term as it is. What a property gives
        may be something else each time."""
        if not (isinstance(term, Code) and isinstance(term.type, OptionalType)):
            return term
        lasting = isinstance(node, ast.Name) or (
            isinstance(node, ast.Attribute) and isinstance(root(term.value), Field)
        )
        return Code(term.type.of, inside(term.value)) if lasting and ast.dump(node) in self.known else term

    def only(self, names: Names) -> None:
        """Of these names those that still have the same."""
        self.names = common([names, self.names])

    def forget_fields(self) -> None:
        """Any field may have another value from here on."""
        self.known = {each for each in self.known if each.startswith("Name(")}

    # Names that a condition gives a value (`:=`) ----------------------------------------------------------

    def decide(self, node: ast.BoolOp, both: bool, early: Sequence[Names], last: tuple[Names, Names]) -> None:
        """`and` (`both`) or `or`: the names where it was decided `early`, and where its last part is true or false."""
        when_true, when_false = last
        if both:
            when_false = common([*early, when_false])
        else:
            when_true = common([*early, when_true])
        self._decided[node] = when_true, when_false
        self.names = common([when_true, when_false])

    def names_if(self, test: ast.AST) -> tuple[Names, Names]:
        """The names where a condition, which was lowered last, is true, and where it is false."""
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            when_true, when_false = self.names_if(test.operand)
            return when_false, when_true
        found = self._decided.pop(test, None)
        return found or (dict(self.names), dict(self.names))


def proved_by(test: ast.AST) -> set[str]:
    """What is not None where a condition holds: expressions, as `ast.dump` writes them."""
    if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And):
        return set().union(*map(proved_by, test.values))
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return disproved_by(test.operand)
    if _compares_none(test, ast.IsNot):
        return {ast.dump(test.left)}  # type: ignore[attr-defined]
    return {ast.dump(test)} if isinstance(test, ast.Name | ast.Attribute) else set()


def disproved_by(test: ast.AST) -> set[str]:
    """What is not None where it does not hold."""
    if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):
        return set().union(*map(disproved_by, test.values))
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return proved_by(test.operand)
    return {ast.dump(test.left)} if _compares_none(test, ast.Is) else set()  # type: ignore[attr-defined]


def without_name(known: Set[str], name: str) -> set[str]:
    """Of these expressions those that have no such name in them."""
    return {each for each in known if f"id='{name}'" not in each}


def common(ways: Sequence[Names]) -> Names:
    """The names that stand for the same on each of these ways."""
    first, *rest = ways
    return {name: each for name, each in first.items() if all(way.get(name) == each for way in rest)}


def _compares_none(test: ast.AST, sign: type[ast.cmpop]) -> bool:
    if not (isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], sign)):
        return False
    other = test.comparators[0]
    return isinstance(other, ast.Constant) and other.value is None
