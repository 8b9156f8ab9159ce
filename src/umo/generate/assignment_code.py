"""Assignments: to names, fields, elements and tuples of these."""

from __future__ import annotations

import ast
import inspect
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    NOTHING,
    REAL,
    ArrayType,
    CType,
    NumpyNumber,
    OptionalType,
    TupleType,
    array,
    may_be_bool,
    plain,
    plain_number,
)
from umo.generate.call_code import CallCode
from umo.generate.expression_code import is_of_numpy
from umo.generate.terms import Code, Elements, Known, Many, Present, Term
from umo.generate.value_kinds import attribute_kind, refused_store
from umo.objects import Quality


class AssignmentCode(CallCode):
    """The part of a function that is assignments."""

    def _Assign(self, node: ast.Assign) -> None:
        term = self.term(node.value)
        if isinstance(term, Code) and ast.dump(node.value) in self.known:
            term = self.present(term, node.value)
        if len(node.targets) > 1 or not isinstance(node.targets[0], ast.Name):
            term = self.settled(term)
        for each in node.targets:
            self.store(each, term, node)

    def _AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.store(node.target, self.term(node.value), node)

    def _AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Subscript):
            self._aug_element(node, node.target)
            return
        before = self.impure
        load = ast.copy_location(loaded(node.target), node.target)
        left = self.term(load)
        if self.impure != before and isinstance(node.target, ast.Attribute):
            raise self.refused(node, "what is changed is found by code that would run twice", "a name for it first")
        right = self._after(left, node.value)
        if right[0] is not left:
            left = right[0]
        self._change(node, left, right[1])

    def _after(self, left: Term, node: ast.AST) -> tuple[Term, Term]:
        """A term, and an expression that is computed after it."""
        at, before = len(self.lines), self.impure
        right = self.term(node)
        if self.impure != before:
            rest, self.lines = self.lines[at:], self.lines[:at]
            left = self.settled(left)
            self.lines += rest
        return left, right

    def _aug_element(self, node: ast.AugAssign, target: ast.Subscript) -> None:
        """The place is found once, before the value is computed."""
        base, index = self.base_and_index(target)
        if not (isinstance(base, Code) and isinstance(base.type, ArrayType)):
            raise self.refused(node, "an element of something that is not a list of numbers")
        index = self.settled(index)
        if isinstance(index, Code) and index.type.name == array(BOOL, base.type.length).name:
            raise self.refused(node, "what a mask chooses is changed", "x[mask] = value, np.where")
        left, right = self._after(self.settled(self.element(base, index, target)), node.value)
        result = self.of_numbers(node.op, left, right, (target, node.value), node)
        self._set_element(target, base, index, self.settled(result), node)

    def _change(self, node: ast.AugAssign, left: Term, right: Term) -> None:
        if isinstance(left, Known) and self.is_array(left):
            raise self.refused(node, "an array that is known when the code is generated is changed", "a new array")
        if self.is_array(left):
            place = self.array(left, node.target)
            self.overwrite(place, self.of_arrays(node.op, place, right, node), node)
            return
        if self.is_array(right):
            self.store(node.target, self.of_arrays(node.op, left, right, node), node)
            return
        if not isinstance(node.target, ast.Name | ast.Attribute):
            raise self.refused(node, "it cannot be assigned to this", "names, attributes, elements")
        result = self.of_numbers(node.op, left, right, (node.target, node.value), node)
        self.store(node.target, result, node)

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None:
        self.forget(target)
        if isinstance(target, ast.Tuple | ast.List):
            parts = self.parts(term, node)
            if len(parts) != len(target.elts) or any(isinstance(each, ast.Starred) for each in target.elts):
                raise self.refused(node, f"{len(parts)} values for {len(target.elts)} names")
            for each, part in zip(target.elts, [self.settled(one) for one in parts], strict=True):
                self.store(each, part, node)
        elif isinstance(target, ast.Name):
            self._store_local(target.id, term, node)
        elif isinstance(target, ast.Attribute):
            self._store_field(target, term, node)
        elif isinstance(target, ast.Subscript):
            self._store_element(target, term, node)
        else:
            raise self.refused(node, "it cannot be assigned to this", "names, attributes, elements")
        if isinstance(target, ast.Name | ast.Attribute) and _is_there(term):
            self.known.add(ast.dump(loaded(target)))

    def _store_local(self, name: str, term: Term, node: ast.AST) -> None:
        if isinstance(term, Many) and term.terms and all(map(_is_quality, term.terms)):
            term = Known(tuple(each.value for each in term.terms))  # type: ignore[union-attr]
            self.names[name] = term
            return
        of = self.type_of(term)
        key = (self.key, name)
        before = self.world.memory.locals.get(key)
        if of is None or (of == NOTHING and before is None):
            texts = isinstance(term, Known) and isinstance(term.value, str)
            if isinstance(term, Known) and (before is None or before == term or texts):
                self.names[name] = term
                return
            raise self.refused(node, f"{name!r} stands for different objects", "a name for each")
        if isinstance(before, Known):
            raise self.refused(node, f"{name!r} stands for different objects", "a name for each")
        of = self.world.memory.learn(self.world.memory.locals, key, of, lambda: self._odd(name, node))
        self.names[name] = of
        if isinstance(of, ArrayType) and isinstance(term, Code) and self._is_same(name, term):
            self.same[name] = term.text
            return
        text = self.c_local(name)
        if text not in self.given:
            self.temporaries.setdefault(text, of)
            self.temporaries[text] = of
        if isinstance(plain(of), ArrayType):
            self.rebound.append(text)
        if not (isinstance(term, Code) and term.text in self.sole):
            self.share(term)
            if isinstance(term, Code) and not isinstance(term, Elements) and isinstance(plain(of), ArrayType):
                self.share(Code(of, text))
        if isinstance(of, ArrayType) and isinstance(term, Elements):
            self.fill(text, Elements(of, self.at(term, of.of, of.length)))
            self.impure += 1
            return
        value = self.as_type(term, of, node)
        if value != text:
            self.line(f"{text} = {value};")

    def _is_same(self, name: str, term: Code) -> bool:
        """Whether both names stand for one array from here on: each is assigned once, and not in a loop or a branch."""
        others = [each for each in self.names if self.c_local(each) == term.text and each != name]
        if not others or self.depth > 1 or term.text in self.given:
            return False
        assigned = [each.id for each in _assigned(self.source.tree)]
        return all(assigned.count(each) == 1 for each in (name, *others))

    def _odd(self, name: str, node: ast.AST) -> None:
        raise self.refused(node, f"{name!r} has values of different types", "one type for each name")

    def type_of(self, term: Term) -> CType | None:
        """The type of what a term is; None: it is no value of a controller."""
        if isinstance(term, Code):
            return term.type
        if isinstance(term, Many):
            types = [self.type_of(each) for each in term.terms]
            return self.world.fields.tuple_type(types, term.names, term.kind or tuple)
        if isinstance(term, Present):
            return None
        found = self.world.fields.type_of_value(term.value)
        return None if isinstance(found, ArrayType) and not isinstance(term.value, np.ndarray) else found

    def _store_field(self, target: ast.Attribute, term: Term, node: ast.AST) -> None:
        base = self.term(target.value)
        if not isinstance(base, Known):
            raise self.refused(node, "an attribute of something that is not known when the code is generated")
        owner, name = base.value, target.attr
        if type(static := inspect.getattr_static(type(owner), target.attr, None)) is property:
            if static.fset is None:
                raise self.refused(node, f"the property {name} has no setter", "an attribute")
            self.function(static.fset, [base, term], {}, node)
            self.known = {each for each in self.known if each.startswith("Name(")}
            return
        if reason := refused_store(owner, name) or _odd_attribute(owner, name):
            raise self.refused(node, reason, "an attribute of an object of its own")
        if isinstance(term, Known) and isinstance(term.value, str):
            self.world.memory.add_text(owner, name)
            self.world.note(f"{self.source.segment(target)} is a text: a controller does not have it")
            return
        self.world.memory.assign(owner, name)
        new = self.type_of(term)
        key = id(owner), name
        if isinstance(new, TupleType) and new.kind is list:
            raise self.refused(node, "a list is assigned as a whole", "its elements, one by one")
        if new is None:
            raise self.refused(
                node, f"{self.source.segment(target)} is no number or state", "numbers, states, tuples of them"
            )
        if isinstance(new, NumpyNumber):
            self.world.memory.changed |= key not in self.world.memory.of_numpy
            self.world.memory.of_numpy.add(key)
        of = plain_number(new) if isinstance(new, NumpyNumber) else new
        self.world.memory.learn(self.world.memory.fields, key, of, lambda: self._odd(name, node))
        if key in self.world.memory.texts:
            raise self.refused(node, f"{name} has texts and other values", "a name for each")
        place = self.field(owner, name, base, target)
        if not isinstance(place, Code):
            if not self.world.memory.changed and new != NOTHING:
                raise self.refused(node, f"{name} does not become a field", "another name, or one type")
            return  # in the next pass it is a field
        if isinstance(plain(place.type), ArrayType):
            if isinstance(getattr(owner, name), list):
                raise self.refused(node, "a list is assigned as a whole", "its elements, one by one")
            self.world.memory.rebind(place.text)
            self.rebound.append(place.text)
            if isinstance(term, Code) and not isinstance(term, Elements):
                self.share(term)
                self.share(place)
            if isinstance(place.type, ArrayType) and isinstance(term, Elements):
                self.fill(place.text, Elements(place.type, self.at(term, place.type.of, place.type.length)))
                self.impure += 1
                return
        self.line(f"{place.text} = {self.as_type(term, place.type, node)};")

    def _store_element(self, target: ast.Subscript, term: Term, node: ast.AST) -> None:
        term = self.settled(term)
        base, index = self.base_and_index(target)
        self._set_element(target, base, index, term, node)

    def _set_element(self, target: ast.Subscript, base: Term, index: Term, term: Term, node: ast.AST) -> None:
        if not (isinstance(base, Code) and isinstance(base.type, ArrayType)):
            raise self.refused(node, "an element of something that is not a list of numbers")
        if isinstance(target.value, ast.Attribute) and isinstance(owner := self.term(target.value.value), Known):
            self.world.memory.assign(owner.value, target.value.attr)
        self.check_sole(base, node)
        if isinstance(index, Code) and index.type.name == array(BOOL, base.type.length).name:
            self.overwrite(base, term, node, where=index)
            return
        self.check_length(base.type, node)
        if base.type.listed and is_of_numpy(term):
            raise self.refused(node, "a number of numpy in a list", "float(...), int(...), bool(...)")
        if base.type.listed and base.type.of != BOOL and may_be_bool(self.type_of(term) or NOTHING):
            raise self.refused(node, "a bool in a list of numbers", "int(...)")
        if not base.type.listed and base.type.of != REAL and plain_number(self.code(term, node).type) == REAL:
            raise self.refused(node, "numbers of another type are set in the array", "int(...)")
        place = f"{base.text}.at[{self.index(base.type, index, node)}]"
        self.changes.add(base.text)
        self.line(f"{place} = {self.as_type(term, base.type.of, node)};")


def _is_there(term: Term) -> bool:
    """Whether a value is never None."""
    if isinstance(term, Code):
        return not isinstance(term.type, OptionalType)
    return isinstance(term, Many) or (isinstance(term, Known) and term.value is not None)


def _odd_attribute(owner: Any, name: str) -> str:
    """Why an attribute that is assigned is no plain one; empty: it is."""
    found = attribute_kind(owner, name)
    return "" if found == "value" else f"{name} is a {found}" if found in ("function", "property") else found


def _is_quality(term: Term) -> bool:
    return isinstance(term, Known) and isinstance(term.value, Quality)


def _assigned(tree: ast.AST) -> list[ast.Name]:
    """The names to which a function assigns; what is changed in place is not among them."""
    changed = {id(each.target) for each in ast.walk(tree) if isinstance(each, ast.AugAssign)}
    names = (each for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    return [each for each in names if id(each) not in changed]


def loaded(target: ast.AST) -> ast.expr:
    """The same place, to be read."""
    kind = type(target)
    fields = {name: value for name, value in ast.iter_fields(target) if name != "ctx"}
    found: ast.expr = kind(**fields, ctx=ast.Load()) if "ctx" in target._fields else target  # type: ignore[assignment,call-arg]
    return ast.copy_location(found, target)
