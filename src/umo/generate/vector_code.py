"""Vectors of objects as C: read and written at once, by the numbers of the objects."""

from __future__ import annotations

import ast
from typing import Any

from umo.errors import StateError
from umo.generate.array_code import HERE, ArrayCode
from umo.generate.c_types import BOOL, INT, MASK, REAL, ArrayType, CType, OptionalType, array
from umo.generate.terms import Code, Elements, Known, Many, Term
from umo.objects import Vector
from umo.objects.atomic import Atomic, Binary


class VectorCode(ArrayCode):
    """The part of a function that reads and writes Vectors."""

    def table(self, vector: Vector[Any]) -> str:
        """The numbers of the objects of a Vector, as a table in C."""
        return self.world.table([item._slot for item in vector])

    def attribute_of_vector(self, vector: Vector[Any], name: str, node: ast.AST) -> Term:
        if name == "quality":
            return self.of_each(vector, INT, f"umo_quality(&m->objects[{self.table(vector)}[{HERE}]])")
        if name == "pending":
            return self.of_each(vector, REAL, f"umo_pending(&m->objects[{self.table(vector)}[{HERE}]])")
        if name == "all_good":
            qualities = self.of_each(vector, INT, f"umo_quality(&m->objects[{self.table(vector)}[{HERE}]])")
            count = self.reduced("count", qualities, node)
            return Code(BOOL, f"{count.text} == 0")
        if name in ("read", "write", "mask", "_located"):
            return Known(getattr(vector, name), vector, name)
        raise self.refused(node, f"`{name}` of a Vector does not translate", "read, write, quality, pending, all_good")

    def of_each(self, vector: Vector[Any], of: CType, text: str) -> Code:
        """A number of each object, as it is now."""
        found = self.kept(Elements(array(of, len(vector)), text))
        self.sole.add(found.text)
        return found

    def method_of_vector(
        self, vector: Vector[Any], name: str, arguments: list[Term], named: dict[str, Term], node: ast.AST
    ) -> Term:
        if name == "read" and not arguments:
            return self.of_each(vector, REAL, f"umo_value(&m->objects[{self.table(vector)}[{HERE}]])")
        if name == "_located":
            return Known(vector._located())
        if name == "mask":
            return self._mask(vector, arguments[0], node)
        if name == "write" and len(arguments) == 1:
            return self._written(vector, arguments[0], named.get("where", Known(None)), node)
        raise self.refused(node, f"`{name}` of a Vector does not translate", "read, write, quality, pending, all_good")

    def _mask(self, vector: Vector[Any], term: Term, node: ast.AST) -> Code:
        code = self.array(term, node)
        if code.type != array(BOOL, len(vector)):
            raise self.refused(node, f"a mask that is no array of {len(vector)} booleans")
        return code

    def _chosen(self, vector: Vector[Any], where: Term, node: ast.AST) -> str:
        """The text of a mask as a pointer."""
        if isinstance(where, Known) and where.value is None:
            return "NULL"
        if isinstance(where, Code) and isinstance(where.type, OptionalType):
            code = self.place(where)
            self._mask(vector, Code(where.type.of, f"{code.text}.value"), node)
            return f"{code.text}.has ? {code.text}.value.at : NULL"
        return f"{self.kept_place(self._mask(vector, where, node))}.at"

    def values_of(self, vector: Vector[Any], more: list[Term], named: dict[str, Term], node: ast.AST) -> Code:
        """`value_of` of a Vector."""
        accept = more[0] if more else named.get("accept", Known(()))
        mask, chosen = self.as_type(accept, MASK, node), self._chosen(vector, named.get("where", Known(None)), node)
        result = self.temporary(array(REAL, len(vector)))
        self.called(f"umo_values_of(m, {self.table(vector)}, {len(vector)}, {mask}, {chosen}, {result}.at)")
        self.sole.add(result)
        return Code(array(REAL, len(vector)), result, stable=True)

    def _written(self, vector: Vector[Any], values: Term, where: Term, node: ast.AST) -> Code:
        first = vector[0]
        kind = array(REAL, len(vector))
        code = self._levels(vector, values, node) if isinstance(first, Binary) else self.array(values, node)
        self._check_values(vector, code, node)
        text = self.kept_place(Code(kind, self.as_type(code, kind, node)))
        chosen = self._chosen(vector, where, node)
        taken = self.temporary(BOOL)
        self.called(f"umo_write_many(m, {self.table(vector)}, {len(vector)}, {text}.at, {chosen}, &{taken})")
        return Code(BOOL, taken, stable=True)

    def _check_values(self, vector: Vector[Any], values: Term, node: ast.AST) -> None:
        """What `write` refuses in Python."""
        of = values.type if isinstance(values, Code) else None
        if isinstance(of, ArrayType):
            self.check_length(of, node)
            if of.length != len(vector):
                raise self.refused(node, f"{of.length} values for {len(vector)} objects")
        if not isinstance(vector[0], Binary) and (of == BOOL or (isinstance(of, ArrayType) and of.of == BOOL)):
            raise self.refused(node, "booleans for objects with numbers", "astype(np.float64)")

    def _levels(self, vector: Vector[Any], values: Term, node: ast.AST) -> Term:
        """States, or an array of levels."""
        if self.is_array(values):
            return values
        given: list[Term]
        if isinstance(values, Many):
            given = list(values.terms)
        elif isinstance(values, Known) and isinstance(values.value, list | tuple):
            given = [Known(each) for each in values.value]
        else:
            given = [values for _ in vector]
        if len(given) != len(vector):
            self.raises(StateError, node)
            return self._listed(Many(tuple(Known(0.0) for _ in vector)), node)
        levels = tuple(self._level(item, each, node) for item, each in zip(list(vector), given, strict=True))
        return self._listed(Many(levels), node)

    def _level(self, item: Atomic, state: Term, node: ast.AST) -> Term:
        assert isinstance(item, Binary)
        code = self.code(state, node)
        if isinstance(code.type, OptionalType):
            raise self.refused(node, "a state that may be None is written to a Vector", "a condition before it")
        one = [*item.states].index(item.one)  # type: ignore[misc]
        if code.type != self.code(Known(item.one), node).type:
            self.raises(StateError, node)
            return Known(0.0)
        return Code(REAL, f"({code.text} == {one} ? 1 : 0)")
