"""Tracks names and fields that may refer to the same list or array. A list or array is changed in place only if it has
one name."""

from __future__ import annotations

import ast

from umo.generate.c_types import (
    ArrayType,
    plain,
)
from umo.generate.form import (
    Field,
    Temporary,
    Value,
    root,
    whole,
)
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Elementwise, SliceView, Term, TupleTerm


class LoweredAliases(LoweredSubject):
    """Lowers references to the arrays of a function, as far as they are known."""

    def __init__(self, f: FunctionBuilder) -> None:
        super().__init__(f)
        self.shared: set[Value] = set()
        """Arrays that have several names."""
        self.sole: set[Value] = set()
        """Temporary arrays without another reference."""
        self.sole_result = True
        """True if an array that the function returns has no other reference."""
        self.rebound: list[Value] = []
        """Arrays that were assigned as a whole."""
        self.changes: set[Value] = set()
        """Arrays that are changed in place, here and in called functions."""
        self.keeps = False
        """True if an array argument may have another reference after the call."""

    def check_sole(self, place: Code, node: ast.AST) -> None:
        """Refuse an array that may have another reference. An array that may be None is not checked."""
        if isinstance(place, Elementwise) or place.value != whole(place.value) or self.shares(place.value):
            nearest = "a new array: x = x + 1, np.where, a copy"
            raise self.f.refused(node, "an array that may have another name is changed in place", nearest)

    def shares(self, place: Value) -> bool:
        """True if an array may have other references."""
        if isinstance(root(place), Field):
            return place in self.f.world.memory.shared
        if isinstance(place, Temporary) and place not in self.sole:
            return True  # it was copied from somewhere
        return (
            place in self.shared or (self.f.key, place) in self.f.world.memory.shared or place in self.f.own_parameters
        )

    def is_sole(self, term: Term) -> bool:
        """True if an array has no other reference."""
        if isinstance(term, SliceView):
            return False
        is_list = isinstance(term, Code) and isinstance(plain(term.type), ArrayType)
        if not (is_list or self.f.arrays.is_array(term)) or isinstance(term, Elementwise):
            return True
        return isinstance(term, Code) and not self.shares(term.value)

    def is_copied(self, term: Term) -> bool:
        """True if this is a computed value and not another name for an existing array."""
        return not isinstance(term, Code) or (isinstance(term, Elementwise) and not isinstance(term, SliceView))

    def is_new(self, term: Term) -> bool:
        """True if an array was made here and has no name yet."""
        return isinstance(term, Code) and isinstance(term.value, Temporary) and not self.shares(term.value)

    def share(self, term: Term) -> None:
        """Record that an array gets another name. From now on the array is not changed in place."""
        if isinstance(term, TupleTerm):
            for each in term.terms:
                self.share(each)
        if isinstance(term, SliceView):
            term = Code(term.type, term.base)
        if not (isinstance(term, Code) and isinstance(plain(term.type), ArrayType)) or isinstance(term, Elementwise):
            return
        place = whole(term.value)
        self.shared.add(place)
        if place in self.f.own_parameters:
            self.keeps = True
        if isinstance(root(place), Field):
            self.f.world.memory.share(place)
        elif self.f.loops.around:
            self.f.world.memory.share((self.f.key, place))
