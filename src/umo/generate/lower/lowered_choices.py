"""Choices of one of several live objects at run time. The code that uses the object is written out for each of them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

from umo.generate.c_types import INT, CType
from umo.generate.c_types import joined as joined_type
from umo.generate.form import If, Literal, Operator, Statement
from umo.generate.lower.known_tables import element_place, is_dict, is_table, key_place
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Known, OneOf, Term
from umo.generate.value_kinds import SCALARS

MOST_OPTIONS = 32
"""Maximum number of objects from which one is chosen. The statements in C are written out for each object."""
Branch = tuple[Term, list[Statement]]


class LoweredChoices(LoweredSubject):
    """Lowers the use of objects that are chosen at run time."""

    def of_table(self, table: Any, index: Term, node: ast.AST) -> OneOf | None:
        """Return the object at a computed index or key, or None if the table has numbers or states, or is empty."""
        if not (is_table(table) or is_dict(table)) or len(table) > MOST_OPTIONS:
            return None
        options = list(table.values() if is_dict(table) else table)
        if any(type(each) in SCALARS or self.f.values.type_of(Known(each)) is not None for each in options):
            return None
        place = key_place(self.f, table, index, node) if is_dict(table) else element_place(self.f, table, index, node)
        return OneOf(self.f.values.kept(Code(INT, place)).value, tuple(map(Known, options)))

    def each(self, choice: OneOf, what: Callable[[Known], Term], node: ast.AST) -> Term:
        """Return the result of `what` for the object that is chosen at run time."""
        known, names = set(self.f.flow.known), dict(self.f.flow.names)
        branches: list[Branch] = []
        after = set(known)
        for option in choice.options:
            self.f.flow.known, self.f.flow.names = set(known), dict(names)
            with self.f.one_of_two() as statements:
                branches.append((what(option), statements))
            after &= self.f.flow.known
        self.f.flow.known, self.f.flow.names = after, names
        return self._together(choice, branches, node)

    def _together(self, choice: OneOf, branches: Sequence[Branch], node: ast.AST) -> Term:
        terms = [term for term, _ in branches]
        known = [each for each in terms if isinstance(each, Known)]
        same = len(known) == len(terms) and all(each == known[0] for each in known)
        if not same and len(known) == len(terms) and all(self.f.values.type_of(each) is None for each in known):
            if any(statements for _, statements in branches) or any(type(each.value) in SCALARS for each in known):
                raise self.f.refused(node, "it is a different object or text for each of several objects", "a loop")
            return OneOf(choice.place, tuple(known))
        if same:
            self._write_out(choice, [statements for _, statements in branches])
            return known[0]
        of = self._type_of_all(terms, node)
        result = self.f.temporary(of, "v")
        for term, statements in branches:
            self.f.aliases.share(term)
            with self.f.one_of_two() as more:
                self.f.assign(result, self.f.values.as_type(term, of, node))
            statements += more
        self._write_out(choice, [statements for _, statements in branches])
        return Code(of, result)

    def _type_of_all(self, terms: Sequence[Term], node: ast.AST) -> CType:
        with self.f.gathered():
            types = [self.f.values.code(each, node).type for each in terms]
        try:
            return reduce(joined_type, types)
        except TypeError:
            raise self.f.refused(node, "the objects have values of different types", "one type") from None

    def _write_out(self, choice: OneOf, bodies: Sequence[Sequence[Statement]]) -> None:
        """Add the statements for the object that is chosen at run time."""
        *first, last = bodies
        rest = tuple(last)
        for number, body in reversed([*enumerate(first)]):
            test = Operator("==", choice.place, Literal(number, INT))
            rest = (If(test, tuple(body), rest, line=self.f.line),)
        self.f.statements += rest
