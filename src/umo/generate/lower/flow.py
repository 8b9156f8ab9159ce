"""What is known at a place of a function: what each name stands for, and what is not None."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import NamedTuple

from umo.generate.c_types import (
    CType,
)
from umo.generate.form import (
    Field,
    root,
)
from umo.generate.lower.terms import Code, Known


class Way(NamedTuple):
    """What is known at a place of a function."""

    names: dict[str, CType | Known]
    known: set[str]


class KnownFlow:
    """What is known where the next statement stands."""

    def __init__(self) -> None:
        self.names: dict[str, CType | Known] = {}
        """Local names: their types, or the live object that each stands for."""
        self.known: set[str] = set()
        """Expressions that are not None here: local names, and fields."""
        self.left: dict[str, list[Way]] = {}
        """What was known where each label is left to."""

    # What is known at a place ----------------------------------------------------------------------------

    def way(self) -> Way:
        """What is known here."""
        return Way(dict(self.names), set(self.known))

    def go_on_from(self, ways: Sequence[Way]) -> None:
        """What is known where these ways meet: names that have the same on all of them."""
        first, *rest = ways
        self.names = {
            name: each for name, each in first.names.items() if all(way.names.get(name) == each for way in rest)
        }
        self.known = first.known.intersection(*(way.known for way in rest))

    def forget(self, target: ast.AST) -> None:
        """A name or an attribute has another value from here on, and so has what is found through it."""
        if isinstance(target, ast.Name):
            self.known = {each for each in self.known if f"id='{target.id}'" not in each}
        elif isinstance(target, ast.Attribute):
            self.known = {each for each in self.known if f"attr='{target.attr}'" not in each}

    def is_proved(self, code: Code, node: ast.AST) -> bool:
        """Whether it is not None here. What a property gives may be something else each time."""
        lasting = isinstance(node, ast.Name) or (
            isinstance(node, ast.Attribute) and isinstance(root(code.value), Field)
        )
        return lasting and ast.dump(node) in self.known

    def only(self, names: dict[str, CType | Known]) -> None:
        """Of these names those that still have the same."""
        self.names = {name: of for name, of in names.items() if self.names.get(name) == of}

    def forget_fields(self) -> None:
        """Any field may have another value from here on."""
        self.known = {each for each in self.known if each.startswith("Name(")}

    # What a condition proves ---------------------------------------------------------------------------

    def proved(self, test: ast.AST) -> set[str]:
        """What is not None where the condition holds."""
        if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And):
            return set().union(*map(self.proved, test.values))
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            return self.disproved(test.operand)
        if _compares_none(test, ast.IsNot):
            return {ast.dump(test.left)}  # type: ignore[attr-defined]
        return {ast.dump(test)} if isinstance(test, ast.Name | ast.Attribute) else set()

    def disproved(self, test: ast.AST) -> set[str]:
        """What is not None where it does not hold."""
        if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):
            return set().union(*map(self.disproved, test.values))
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            return self.proved(test.operand)
        return {ast.dump(test.left)} if _compares_none(test, ast.Is) else set()  # type: ignore[attr-defined]


def _compares_none(test: ast.AST, sign: type[ast.cmpop]) -> bool:
    if not (isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], sign)):
        return False
    other = test.comparators[0]
    return isinstance(other, ast.Constant) and other.value is None
