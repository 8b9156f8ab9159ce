"""Vectors of objects in C. They are read and written as a whole, by slots."""

from __future__ import annotations

import ast
from typing import Any

from umo.errors import StateError
from umo.generate.c_types import BOOL, INT, MASK, REAL, ArrayType, CType, OptionalType, array
from umo.generate.form import (
    ONE,
    ZERO,
    Conditional,
    CurrentIndex,
    Elements,
    Literal,
    Null,
    ObjectOf,
    Operator,
    Runtime,
    SlotTable,
    Value,
    WholeMachine,
    has,
    inside,
)
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Elementwise, Known, Term, TupleTerm
from umo.objects import Vector
from umo.objects.atomic import Atomic, Binary


class LoweredVectors(LoweredSubject):
    """Lowers reads and writes of Vectors."""

    def table(self, vector: Vector[Any]) -> str:
        """Return the slots of the objects of a Vector, as a table in C."""
        return self.f.world.table([item._slot for item in vector])

    def attribute_of_vector(self, vector: Vector[Any], name: str, node: ast.AST) -> Term:
        if name == "quality":
            return self.of_each(vector, INT, "umo_quality")
        if name == "pending":
            return self.of_each(vector, REAL, "umo_pending")
        if name == "all_good":
            count = self.f.arrays.reduced("count", self.of_each(vector, INT, "umo_quality"), node)
            return Code(BOOL, Operator("==", count.value, ZERO))
        if name in ("read", "write", "mask", "_located"):
            return Known(getattr(vector, name), vector, name)
        raise self.f.refused(
            node, f"`{name}` of a Vector cannot be translated", "read, write, quality, pending, all_good"
        )

    def of_each(self, vector: Vector[Any], of: CType, function: str) -> Code:
        """Return the result of a runtime function for each object."""
        item = ObjectOf(self.table(vector), CurrentIndex())
        found = self.f.values.kept(Elementwise(array(of, len(vector)), Runtime(function, (item,))))
        self.f.aliases.sole.add(found.value)
        return found

    def method_of_vector(
        self, vector: Vector[Any], name: str, arguments: list[Term], named: dict[str, Term], node: ast.AST
    ) -> Term:
        if name == "read" and not arguments:
            return self.of_each(vector, REAL, "umo_value")
        if name == "_located":
            return Known(vector._located())
        if name == "mask":
            return self._mask(vector, arguments[0], node)
        if name == "write" and len(arguments) == 1:
            return self._written(vector, arguments[0], named.get("where", Known(None)), node)
        raise self.f.refused(
            node, f"`{name}` of a Vector cannot be translated", "read, write, quality, pending, all_good"
        )

    def _mask(self, vector: Vector[Any], term: Term, node: ast.AST) -> Code:
        code = self.f.arrays.array(term, node)
        if code.type != array(BOOL, len(vector)):
            raise self.f.refused(node, f"the mask is not an array of {len(vector)} bools")
        return code

    def _chosen(self, vector: Vector[Any], where: Term, node: ast.AST) -> Value:
        """Return the elements that a mask selects."""
        if isinstance(where, Known) and where.value is None:
            return Null()
        if isinstance(where, Code) and isinstance(where.type, OptionalType):
            place = self.f.expressions.place(where).value
            self._mask(vector, Code(where.type.of, inside(place)), node)
            return Conditional(has(place), Elements(inside(place)), Null())
        return Elements(self.f.arrays.kept_place(self._mask(vector, where, node)))

    def values_of(self, vector: Vector[Any], more: list[Term], named: dict[str, Term], node: ast.AST) -> Code:
        """Return `value_of` of a Vector."""
        accept = more[0] if more else named.get("accept", Known(()))
        mask, chosen = (
            self.f.values.as_type(accept, MASK, node),
            self._chosen(vector, named.get("where", Known(None)), node),
        )
        result = self.f.temporary(array(REAL, len(vector)))
        self.f.called("umo_values_of", *self._objects(vector), mask, chosen, out=Elements(result))
        self.f.aliases.sole.add(result)
        return Code(array(REAL, len(vector)), result)

    def _objects(self, vector: Vector[Any]) -> tuple[Value, ...]:
        """Return the first arguments of a runtime function for several objects."""
        return WholeMachine(), SlotTable(self.table(vector)), Literal(len(vector), INT)

    def _written(self, vector: Vector[Any], values: Term, where: Term, node: ast.AST) -> Code:
        first = vector[0]
        kind = array(REAL, len(vector))
        code = self._levels(vector, values, node) if isinstance(first, Binary) else self.f.arrays.array(values, node)
        self._check_values(vector, code, node)
        place = self.f.arrays.kept_place(Code(kind, self.f.values.as_type(code, kind, node)))
        chosen = self._chosen(vector, where, node)
        taken = self.f.temporary(BOOL)
        self.f.called("umo_write_many", *self._objects(vector), Elements(place), chosen, out=taken)
        return Code(BOOL, taken)

    def _check_values(self, vector: Vector[Any], values: Term, node: ast.AST) -> None:
        """Refuse values that `write` refuses in Python."""
        of = values.type if isinstance(values, Code) else None
        if isinstance(of, ArrayType):
            self.f.arrays.check_length(of, node)
            if of.length != len(vector):
                raise self.f.refused(node, f"{of.length} values for {len(vector)} objects")
        if not isinstance(vector[0], Binary) and (of == BOOL or (isinstance(of, ArrayType) and of.of == BOOL)):
            raise self.f.refused(node, "bools for digital objects", "astype(np.float64)")

    def _levels(self, vector: Vector[Any], values: Term, node: ast.AST) -> Term:
        """Return states, or an array of levels."""
        if self.f.arrays.is_array(values):
            return values
        given: list[Term]
        if isinstance(values, TupleTerm):
            given = list(values.terms)
        elif isinstance(values, Known) and isinstance(values.value, list | tuple):
            given = [Known(each) for each in values.value]
        else:
            given = [values for _ in vector]
        if len(given) != len(vector):
            self.f.raises(StateError, node)
            return self.f.arrays.listed(TupleTerm(tuple(Known(0.0) for _ in vector)), node)
        levels = tuple(self._level(item, each, node) for item, each in zip(list(vector), given, strict=True))
        return self.f.arrays.listed(TupleTerm(levels), node)

    def _level(self, item: Atomic, state: Term, node: ast.AST) -> Term:
        assert isinstance(item, Binary)
        code = self.f.values.code(state, node)
        if isinstance(code.type, OptionalType):
            raise self.f.refused(node, "a state that may be None is written to a Vector", "check it first")
        one = [*item.states].index(item.one)  # type: ignore[misc]
        if code.type != self.f.values.code(Known(item.one), node).type:
            self.f.raises(StateError, node)
            return Known(0.0)
        return Code(REAL, Conditional(Operator("==", code.value, Literal(one, INT)), ONE, ZERO))
