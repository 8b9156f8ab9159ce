"""Names and fields that may stand for one list or array: only what has one name is changed in place."""

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
from umo.generate.lower.terms import Code, Elementwise, Many, SliceView, Term


class LoweredAliases(LoweredSubject):
    """What is known of the arrays of a function."""

    def __init__(self, f: FunctionBuilder) -> None:
        super().__init__(f)
        self.shared: set[Value] = set()
        """Arrays that have several names."""
        self.sole: set[Value] = set()
        """Temporary arrays that nobody else has."""
        self.sole_result = True
        """Whether nobody else has an array that the function returns."""
        self.rebound: list[Value] = []
        """Arrays that were assigned as a whole."""
        self.changes: set[Value] = set()
        """Arrays that are changed in place, here and in what is called."""
        self.keeps = False
        """Whether an array that it was given is had by others after it."""

    def check_sole(self, place: Code, node: ast.AST) -> None:
        """That nobody else has this array; one that may be None is not looked at."""
        if isinstance(place, Elementwise) or place.value != whole(place.value) or self.shares(place.value):
            nearest = "a new array: x = x + 1, np.where, a copy"
            raise self.f.refused(node, "an array is changed in place, and may have another name", nearest)

    def shares(self, place: Value) -> bool:
        """Whether an array may be had by others too."""
        if isinstance(root(place), Field):
            return place in self.f.world.memory.shared
        if isinstance(place, Temporary) and place not in self.sole:
            return True  # it was copied from somewhere
        return (
            place in self.shared or (self.f.key, place) in self.f.world.memory.shared or place in self.f.own_parameters
        )

    def is_sole(self, term: Term) -> bool:
        """Whether nobody else has an array."""
        if isinstance(term, SliceView):
            return False
        is_list = isinstance(term, Code) and isinstance(plain(term.type), ArrayType)
        if not (is_list or self.f.arrays.is_array(term)) or isinstance(term, Elementwise):
            return True
        return isinstance(term, Code) and not self.shares(term.value)

    def is_copied(self, term: Term) -> bool:
        """Whether this is computed, and no other name for what there is."""
        return not isinstance(term, Code) or (isinstance(term, Elementwise) and not isinstance(term, SliceView))

    def is_new(self, term: Term) -> bool:
        """Whether an array was made here, and has no name yet."""
        return isinstance(term, Code) and isinstance(term.value, Temporary) and not self.shares(term.value)

    def share(self, term: Term) -> None:
        """Another name is given to an array: neither is changed in place from now on."""
        if isinstance(term, Many):
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
