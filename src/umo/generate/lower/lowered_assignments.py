"""Assignments to names, fields, elements and tuples of these."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import Any

from umo.generate.c_types import (
    BOOL,
    NOTHING,
    REAL,
    ArrayType,
    NumpyNumber,
    OptionalType,
    TupleType,
    array,
    may_be_bool,
    of_python,
    plain,
    plain_number,
)
from umo.generate.check.form_effects import changes
from umo.generate.form import Element, Field
from umo.generate.lower.flow import expression_text
from umo.generate.lower.lowered_expressions import is_float, is_of_numpy
from umo.generate.lower.lowered_sequences import is_sequence
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.lowered_values import NO_ELEMENTS, only_asked
from umo.generate.lower.state_members import as_number
from umo.generate.lower.terms import Code, Elementwise, Known, NullTest, OneOf, Selection, Term, TruthTest, TupleTerm
from umo.generate.lower.text_states import as_text
from umo.generate.value_kinds import attribute_kind, is_plain_dataclass, is_ring, refused_store, static_attribute
from umo.objects import Quality

WHOLE_LIST = "a list is assigned as a whole", "its elements, one by one: x[:] = ..."
"""The reason why a list cannot be assigned to an attribute."""
CHOSEN = ast.Name("the chosen object", ast.Load())
"""The name for the chosen object whose attribute is changed."""


class LoweredAssignments(LoweredSubject):
    """Lowers the assignments of a function."""

    def lower_assign(self, node: ast.Assign) -> None:
        if isinstance(node.value, ast.GeneratorExp) and isinstance(node.targets[0], ast.Tuple | ast.List):
            term: Term = TupleTerm(tuple(self.f.sequences.gone_through(node.value)))
        else:
            term = self.f.term(node.value)
        if len(node.targets) == 1 and isinstance(term, Elementwise) and self.f.aliases.is_copied(term):
            term = self._made(term, node.targets[0])
        if len(node.targets) > 1 or not self._is_stored_at_once(node.targets[0], term):
            term = self.f.values.settled(term)
        for each in node.targets:
            self.store(each, term, node)

    def _made(self, term: Elementwise, target: ast.expr) -> Code:
        """Return a computed array for an attribute. It is computed before the object is found, and has no other
        reference."""
        if not isinstance(target, ast.Attribute):
            return term
        found = self.f.values.kept(term)
        self.f.aliases.sole.add(found.value)
        return found

    def _is_stored_at_once(self, target: ast.expr, term: Term) -> bool:
        """True if finding this place cannot change the value, and the value has no other name. For a tuple of places
        `store` copies the parts."""
        is_slice = isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice)
        is_attribute = isinstance(target, ast.Attribute) and self.f.aliases.is_new(term)
        return isinstance(target, ast.Name | ast.Tuple | ast.List) or is_slice or is_attribute

    def lower_ann_assign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.store(node.target, self.f.term(node.value), node)

    def lower_aug_assign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Subscript):
            self._aug_element(node, node.target)
            return
        if isinstance(node.target, ast.Attribute):
            node = self._found_once(node, node.target)
        left = self.f.term(ast.copy_location(loaded(node.target), node.target))
        left, right = self._after(left, node.value)
        self._change(node, left, right)
        self.f.flow.forget(CHOSEN)
        self.f.flow.names.pop(CHOSEN.id, None)

    def _found_once(self, node: ast.AugAssign, target: ast.Attribute) -> ast.AugAssign:
        """Return the assignment with its object evaluated once, for reading and setting. One of several objects gets a
        name."""
        at = len(self.f.statements)
        base = self.f.term(target.value)
        if self.f.changed_since(at):
            raise self.f.refused(node, "finding the target runs code that would run twice", "assign it to a name first")
        if not isinstance(base, OneOf):
            return node
        self.f.flow.names[CHOSEN.id] = base
        of = ast.copy_location(ast.Attribute(CHOSEN, target.attr, ast.Store()), target)
        return ast.copy_location(ast.AugAssign(of, node.op, node.value), node)

    def lower_named_expr(self, node: ast.NamedExpr) -> Term:
        term = self.f.term(node.value)
        self.store(node.target, term, node)
        return self.f.term(loaded(node.target))

    def _after(self, left: Term, node: ast.AST) -> tuple[Term, Term]:
        """Return a term and an expression that is computed after it."""
        with self.f.gathered() as rest:
            right = self.f.term(node)
        if any(map(changes, rest)):
            left = self.f.values.settled(left)
        self.f.statements += rest
        return left, right

    def _aug_element(self, node: ast.AugAssign, target: ast.Subscript) -> None:
        """Lower `x[i] += value`. The index is computed once, before the value."""
        if isinstance(target.slice, ast.Slice):
            self._aug_slice(node, target, target.slice)
            return
        base, index = self.f.expressions.base_and_index(target)
        is_array = isinstance(base, Code) and isinstance(base.type, ArrayType)
        if not (is_array or (isinstance(base, Known) and is_ring(base.value))):
            raise self.f.refused(node, *NO_ELEMENTS)
        if _is_mask(index, base):
            self._aug_masked(node, target, base, index)  # type: ignore[arg-type]
            return
        index = self.f.values.settled(index)
        left, right = self._after(self.f.values.settled(self.f.expressions.element(base, index, target)), node.value)
        right = as_number(self.f, right, node.value)
        result = self.f.expressions.of_numbers(node.op, left, right, (target, node.value), node)
        self._set_element(target, base, index, self.f.values.settled(result), node)

    def _aug_masked(self, node: ast.AugAssign, target: ast.Subscript, base: Code, mask: Code) -> None:
        """Lower an augmented assignment with a number to the elements that a mask selects."""
        with self.f.gathered() as needed:
            right = self.f.term(node.value)
        is_real = plain_number(self.f.arrays.of(base)) == REAL
        if any(map(changes, needed)) or self.f.arrays.is_array(right) or not is_real:
            told = "elements selected by a mask are changed by a call, by an array, or are not floats"
            raise self.f.refused(node, told, "assign the number to a name first, np.where")
        self.f.statements += needed
        self._note_assigned(target)
        new = self.f.arrays.of_arrays(node.op, base, right, node)
        self.f.arrays.overwrite(base, new, node, where=mask, by_place=True)

    def _aug_slice(self, node: ast.AugAssign, target: ast.Subscript, ends: ast.Slice) -> None:
        base, part = self.f.expressions.base_and_slice(target, ends)
        if not (isinstance(base, Code) and self.f.arrays.is_array(base)):
            raise self.f.refused(node, "the slice is not that of an array", "its elements, one by one")
        with self.f.gathered() as needed:
            right = self.f.term(node.value)
        if any(map(changes, needed)):
            raise self.f.refused(node, "computing the value changes something", "assign it to a name first")
        self.f.statements += needed
        self._note_assigned(target)
        left = self.f.arrays.sliced(base, part, node)
        self.f.arrays.set_slice(base, part, self.f.arrays.of_arrays(node.op, left, right, node), node)

    def _change(self, node: ast.AugAssign, left: Term, right: Term) -> None:
        if isinstance(left, Known) and self.f.arrays.is_array(left):
            raise self.f.refused(node, "an array that is known when the code is generated is changed", "a new array")
        if self.f.arrays.is_array(left):
            place = self.f.arrays.array(left, node.target)
            self.f.arrays.overwrite(place, self.f.arrays.of_arrays(node.op, place, right, node), node)
            return
        if self.f.arrays.is_array(right):
            self.store(node.target, self.f.arrays.of_arrays(node.op, left, right, node), node)
            return
        left, right = as_number(self.f, left, node.target), as_number(self.f, right, node.value)
        result = self.f.expressions.of_numbers(node.op, left, right, (node.target, node.value), node)
        self.store(node.target, result, node)

    def _unpacked(self, targets: list[ast.expr], parts: list[Term], node: ast.AST) -> Iterator[tuple[ast.expr, Term]]:
        """Yield the value for each target of an assignment. A starred target gets a new list of the remaining
        values."""
        starred = [place for place, each in enumerate(targets) if isinstance(each, ast.Starred)]
        rest = len(parts) - len(targets) + len(starred)
        if rest < 0 or (rest and not starred):
            raise self.f.refused(node, f"{len(parts)} values for {len(targets)} names")
        for place in starred:
            of = targets[place].value  # type: ignore[attr-defined]
            parts = [*parts[:place], TupleTerm(tuple(parts[place : place + rest]), kind=list), *parts[place + rest :]]
            targets = [*targets[:place], of, *targets[place + 1 :]]
        yield from zip(targets, parts, strict=True)

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None:
        self.f.flow.forget(target)
        if isinstance(target, ast.Tuple | ast.List):
            parts = [self.f.values.settled(one) for one in self.f.calls.parts(term, node)]
            for each, part in self._unpacked(target.elts, parts, node):
                self.store(each, part, node)
        elif isinstance(target, ast.Name):
            self._store_local(target.id, term, node)
        elif isinstance(target, ast.Attribute):
            self._store_field(target, term, node)
        elif isinstance(target, ast.Subscript):
            self._store_element(target, term, node)
        else:
            raise self.f.refused(node, "this cannot be assigned to", "names, attributes, elements")
        if isinstance(target, ast.Name | ast.Attribute) and _is_there(term):
            self.f.flow.known.add(expression_text(target))

    def _store_local(self, name: str, term: Term, node: ast.AST) -> None:
        if isinstance(term, TupleTerm) and self._is_of_objects(term):
            term = Known(tuple(each.value for each in term.terms))  # type: ignore[union-attr]
            self.f.flow.names[name] = term
            return
        if isinstance(term, OneOf | Selection):
            if self.f.world.memory.locals.get((self.f.key, name)) is not None:
                raise self.f.refused(node, f"{name!r} means different objects", "one name per object")
            self.f.flow.names[name] = term
            return
        if isinstance(term, NullTest | TruthTest):
            raise self.f.refused(node, *only_asked(term))
        if isinstance(term, TupleTerm) and term.kind is list and name in _changed_in_place(self.f.source.tree):
            term = self.f.values.new_list(term.terms, node) or term
        of = self.f.values.type_of(term)
        key, types = (self.f.key, name), self.f.world.memory.locals
        if of is None or (of == NOTHING and types.get(key) is None):
            texts = isinstance(term, Known) and isinstance(term.value, str)
            if isinstance(term, Known) and (texts or types.get(key) is None):
                self.f.flow.names[name] = term
                return
            raise self.f.refused(node, f"{name!r} means different objects", "one name per object")
        of = self.f.world.memory.learn(types, key, of, lambda: self._odd(name, node))
        if isinstance(of, ArrayType) and isinstance(term, Code) and self._is_same(name, term):
            self.f.flow.names[name] = Code(of, term.value)
            return
        self.f.flow.names[name] = of
        place = self.f.local(name)
        if place not in self.f.given:
            self.f.variables[place] = of
        if isinstance(plain(of), ArrayType):
            self.f.aliases.rebound.append(place)
        if not self.f.aliases.is_new(term):
            self.f.aliases.share(term)
            if not self.f.aliases.is_copied(term) and isinstance(plain(of), ArrayType):
                self.f.aliases.share(Code(of, place))
        if isinstance(of, ArrayType) and isinstance(term, Elementwise):
            self.f.arrays.fill(place, Elementwise(of, self.f.arrays.at(term, of.of, of.length)))
            return
        value = self.f.values.as_type(term, of, node)
        if value != place:
            self.f.assign(place, value)

    def _is_of_objects(self, term: TupleTerm) -> bool:
        """True if this is a tuple of live objects or of accepted qualities."""
        if not term.terms or not all(isinstance(each, Known) for each in term.terms):
            return False
        is_tuple = term.kind is None and self.f.values.type_of(term) is None
        return is_tuple or all(map(_is_quality, term.terms))

    def _is_same(self, name: str, term: Code) -> bool:
        """True if both names refer to one array from here on: each is assigned once, not in a loop or a branch. An
        attribute must never be assigned again."""
        others = [each for each in self.f.flow.names if self.f.local(each) == term.value and each != name]
        of_field = isinstance(term.value, Field) and term.value not in self.f.world.memory.rebound
        if not (others or of_field) or self.f.depth or {term.value, self.f.local(name)} & self.f.given.keys():
            return False
        assigned = [each.id for each in _assigned(self.f.source.tree)]
        return all(assigned.count(each) == 1 for each in (name, *others))

    def _odd(self, name: str, node: ast.AST) -> None:
        told = f"{name.partition(' ')[0]!r} has values of different types"  # that of a generator has a mark
        raise self.f.refused(node, told, "one type for each name")

    def _store_field(self, target: ast.Attribute, term: Term, node: ast.AST) -> None:
        base = self.f.term(target.value)
        if isinstance(base, OneOf):
            new = self.f.values.settled(term)
            self.f.choices.each(base, lambda each: self._set_field(each, target, new, node), node)
        else:
            self._set_field(base, target, term, node)

    def _set_field(self, base: Term, target: ast.Attribute, term: Term, node: ast.AST) -> Known:
        """Set an attribute of one object."""
        if not isinstance(base, Known):
            raise self.f.refused(node, "the object of this attribute is not known when the code is generated")
        self._set_attribute(base, target, term, node)
        return Known(None)

    def _set_attribute(self, base: Known, target: ast.Attribute, term: Term, node: ast.AST) -> None:
        owner, name = base.value, target.attr
        if type(static := static_attribute(type(owner), target.attr)) is property:
            if static.fset is None:
                raise self.f.refused(node, f"the property {name} has no setter", "an attribute")
            self.f.calls.function(static.fset, [base, term], {}, node)
            self.f.flow.forget_fields()
            return
        if reason := refused_store(owner, name) or _odd_attribute(owner, name):
            raise self.f.refused(node, reason, "the attribute belongs to another object")
        text = as_text(self.f, term, node)
        if text is not None or (isinstance(term, Known) and isinstance(term.value, str)):
            self.f.world.memory.add_text(owner, name)
            if text is None:
                self.f.world.memory.take_text(owner, name, term.value)  # type: ignore[union-attr,arg-type]
            if text is None or not self.f.world.memory.is_text_state(owner, name):
                if self.f.texts.python_sets_field(term, node, target, owner):
                    return
                self.f.world.note(f"{self.f.source.segment(target)} is a text: a controller does not have it")
                return
            term = text
        if isinstance(term, NullTest | TruthTest):
            raise self.f.refused(node, *only_asked(term))
        self.f.world.memory.assign(owner, name)
        if isinstance(term, Known) and is_plain_dataclass(type(term.value)):
            term = self.f.values.code(term, node)
        new = self.f.values.type_of(term)
        key = id(owner), name
        if isinstance(new, TupleType) and new.kind is list:
            is_made = isinstance(term, TupleTerm) and not self.f.world.target.makes_texts
            made = self.f.values.new_list(term.terms, node) if is_made else None  # type: ignore[union-attr]
            if made is None:
                raise self.f.refused(node, *WHOLE_LIST)
            term, new = made, made.type
        if new is None:
            raise self.f.refused(
                node, f"{self.f.source.segment(target)} is not a number or a state", "numbers, states, tuples of these"
            )
        if isinstance(plain(new), NumpyNumber):
            self.f.world.memory.of_numpy.add(key)
        self.f.world.memory.learn(self.f.world.memory.fields, key, of_python(new), lambda: self._odd(name, node))
        if key in self.f.world.memory.texts and text is None:
            raise self.f.refused(node, f"{name} has texts and other values", "one name per type")
        place = self.f.attributes.field(owner, name, base, target)
        if not isinstance(place, Code):
            if not self.f.world.memory.current.learner.is_stale and new != NOTHING:
                raise self.f.refused(node, f"{name} does not become a field", "another name, or one type")
            return  # in the next pass it is a field
        if isinstance(plain(place.type), ArrayType):
            if isinstance(getattr(owner, name), list) and self.f.world.target.makes_texts:
                raise self.f.refused(node, *WHOLE_LIST)  # whoever has the list before would have the new one
            self.f.world.memory.rebind(place.value)
            self.f.aliases.rebound.append(place.value)
            if not (self.f.aliases.is_copied(term) or self.f.aliases.is_new(term)):
                self.f.aliases.share(term)
                self.f.aliases.share(place)
            if isinstance(place.type, ArrayType) and isinstance(term, Elementwise):
                self.f.arrays.fill(
                    place.value, Elementwise(place.type, self.f.arrays.at(term, place.type.of, place.type.length))
                )
                return
        self.f.assign(place.value, self.f.values.as_type(term, place.type, node))

    def _store_element(self, target: ast.Subscript, term: Term, node: ast.AST) -> None:
        if isinstance(target.slice, ast.Slice):
            self._store_slice(target, target.slice, term, node)
            return
        term = self.f.values.settled(term)
        base, index = self.f.expressions.base_and_index(target)
        self._set_element(target, base, index, term, node)

    def _store_slice(self, target: ast.Subscript, ends: ast.Slice, term: Term, node: ast.AST) -> None:
        """Set a slice: the elements of an array, or of a list by as many elements."""
        base, part = self.f.expressions.base_and_slice(target, ends)
        if not (isinstance(base, Code) and isinstance(base.type, ArrayType)):
            raise self.f.refused(node, "the slice is not that of a list or an array of numbers")
        if not base.type.listed:
            self._note_assigned(target)
            self.f.arrays.set_slice(base, part, term, node)
            return
        places = range(base.type.length)[part]
        parts = [self.f.values.settled(each) for each in self.f.calls.parts(term, node)]
        if len(parts) != len(places) or not is_sequence(term):
            raise self.f.refused(node, "the slice changes the length of its list", "as many elements")
        for place, each in zip(places, parts, strict=True):
            self._set_element(target, base, Known(place), each, node)

    def _note_assigned(self, target: ast.Subscript) -> None:
        """Record that elements of an attribute are assigned."""
        if isinstance(target.value, ast.Attribute) and isinstance(owner := self.f.term(target.value.value), Known):
            self.f.world.memory.assign(owner.value, target.value.attr)

    def _set_element(self, target: ast.Subscript, base: Term, index: Term, term: Term, node: ast.AST) -> None:
        if isinstance(base, Known) and is_ring(base.value):
            self.f.rings.set_element(base, as_number(self.f, index, node), term, node)
            return
        if not (isinstance(base, Code) and isinstance(base.type, ArrayType)):
            raise self.f.refused(node, *NO_ELEMENTS)
        self._note_assigned(target)
        self.f.aliases.check_sole(base, node)
        if _is_mask(index, base):
            self.f.arrays.overwrite(base, term, node, where=index)  # type: ignore[arg-type]
            return
        self.f.arrays.check_length(base.type, node)
        self.f.values.check_there(self.f.values.type_of(term), "in a list or an array", node)
        if base.type.listed and is_of_numpy(term):
            raise self.f.refused(node, "a list cannot contain a number of numpy", "float(...), int(...), bool(...)")
        if base.type.listed and base.type.of != BOOL and may_be_bool(self.f.values.type_of(term) or NOTHING):
            raise self.f.refused(node, "a bool is put into a list of numbers", "int(...)")
        if base.type.listed and base.type.of == REAL and not is_float(term):
            raise self.f.refused(node, "an int is put into a list of floats", "0.0, float(...)")
        if not base.type.listed and base.type.of != REAL and plain_number(self.f.values.code(term, node).type) == REAL:
            raise self.f.refused(node, "the array is assigned numbers of another type", "int(...)")
        place = Element(base.value, self.f.expressions.index(base.type, index, node))
        self.f.aliases.changes.add(base.value)
        self.f.assign(place, self.f.values.as_type(term, base.type.of, node))


def _is_mask(index: Term, of: Term) -> bool:
    """True if the index is an array of bools, which selects elements. A list has no such indices."""
    if not (isinstance(of, Code) and isinstance(of.type, ArrayType) and isinstance(index, Code)):
        return False
    return not of.type.listed and index.type.name == array(BOOL, of.type.length).name


def _is_there(term: Term) -> bool:
    """True if a value is never None."""
    if isinstance(term, Code):
        return not isinstance(term.type, OptionalType)
    return isinstance(term, TupleTerm) or (isinstance(term, Known) and term.value is not None)


def _odd_attribute(owner: Any, name: str) -> str:
    """Return why an assigned attribute is not a plain one; empty if it is."""
    found = attribute_kind(owner, name)
    return "" if found == "value" else f"{name} is a {found}" if found in ("function", "property") else found


def _is_quality(term: Term) -> bool:
    return isinstance(term, Known) and isinstance(term.value, Quality)


def _assigned(tree: ast.AST) -> list[ast.Name]:
    """Return the names that a function assigns, without those that it only changes in place."""
    changed = {id(each.target) for each in ast.walk(tree) if isinstance(each, ast.AugAssign)}
    names = (each for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    return [each for each in names if id(each) not in changed]


def _changed_in_place(tree: ast.AST) -> set[str]:
    """Return the names whose elements a function sets."""
    set_ones = (each for each in ast.walk(tree) if isinstance(each, ast.Subscript) and isinstance(each.ctx, ast.Store))
    return {each.value.id for each in set_ones if isinstance(each.value, ast.Name)}


def loaded(target: ast.AST) -> ast.expr:
    """Return the same place as an expression to read."""
    kind = type(target)
    fields = {name: value for name, value in ast.iter_fields(target) if name != "ctx"}
    found: ast.expr = kind(**fields, ctx=ast.Load()) if "ctx" in target._fields else target  # type: ignore[assignment,call-arg]
    return ast.copy_location(found, target)
