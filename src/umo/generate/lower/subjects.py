"""What the subjects of the lowering of a function ask of one another."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

from umo.generate.c_types import ArrayType, CType
from umo.generate.form import Statement, Value
from umo.generate.lower.terms import (
    ArrayMethod,
    Code,
    Elementwise,
    Known,
    Many,
    OneOf,
    RingMethod,
    Selection,
    Term,
    Turns,
)
from umo.objects import Vector
from umo.objects.atomic import Atomic


class AskedOfValues(Protocol):
    """The values of a function."""

    def type_of(self, term: Term) -> CType | None:
        """The type of what a term is; None: it is no value of a controller."""

    def kept(self, code: Code, what: str = "t") -> Code:
        """The same value under a name of its own."""

    def copied(self, code: Code) -> Code:
        """The same value under another name than it has."""

    def new_list(self, terms: Sequence[Term], node: ast.AST) -> Code | None:
        """A list of its own with these numbers; None: they are of several classes, or none."""

    def literal(self, value: Any, of: CType, node: ast.AST) -> Value: ...

    def is_list_itself(self, term: Term) -> bool:
        """Whether it is the list of an attribute, which stays that list: what changes in it is seen by all."""

    def settled(self, term: Term) -> Term:
        """The same, which nothing changes any longer."""

    def code(self, term: Term, node: ast.AST) -> Code:
        """A term as a value in C."""

    def as_type(self, term: Term, of: CType, node: ast.AST) -> Value:
        """A term as a value of this type."""

    def present(self, code: Code, node: ast.AST) -> Code:
        """The value of what may be None: TypeError where it is."""

    def check_there(self, of: CType | None, where: str, node: ast.AST) -> None:
        """That a value of this type is never None."""

    def number(self, term: Term, node: ast.AST) -> Code: ...

    def truth(self, term: Term, node: ast.AST) -> Value | bool:
        """A condition; a bool if it is known already."""


class AskedOfAliases(Protocol):
    """What is known of the arrays of a function."""

    sole: set[Value]

    sole_result: bool

    rebound: list[Value]

    changes: set[Value]

    keeps: bool

    def check_sole(self, place: Code, node: ast.AST) -> None:
        """That nobody else has this array."""

    def is_sole(self, term: Term) -> bool:
        """Whether nobody else has an array."""

    def is_copied(self, term: Term) -> bool:
        """Whether this is computed, and no other name for what there is."""

    def is_new(self, term: Term) -> bool:
        """Whether an array was made here, and has no name yet."""

    def share(self, term: Term) -> None:
        """Another name is given to an array: neither is changed in place from now on."""


class AskedOfTelling(Protocol):
    """What is left out of a function."""

    def check_told(self, nodes: Sequence[ast.AST]) -> None:
        """That what is left out, as it only tells something, does nothing else: it changes nothing and cannot fail."""

    def does_nothing(self, test: ast.expr) -> bool:
        """Whether evaluating a condition only looks at what there is."""

    def check_decided(self, term: Term, node: ast.AST) -> None:
        """That code does not decide by a text that is only told."""

    def is_text(self, node: ast.AST) -> bool:
        """Whether an expression makes a text at run time."""

    def tell_error(self, node: ast.expr, kind: type[BaseException], said: str, fault: int) -> None:
        """Python makes the error of a fault, where it is there."""

    def tell_field(self, term: Term, node: ast.AST, target: ast.Attribute, owner: Any) -> bool:
        """Whether Python assigns a text that is made at run time."""

    def tell_call(self, node: ast.Call) -> bool:
        """Whether Python calls a function that only tells."""

    def text(self, node: ast.expr) -> Known:
        """The text that an expression makes at run time."""


class AskedOfExpressions(Protocol):
    """The part of a function that is expressions."""

    def lower_name(self, node: ast.Name) -> Term: ...

    def place(self, code: Code) -> Code:
        """The same as something that has members."""

    def check_elements(self, term: Term, node: ast.AST) -> None:
        """That it has elements."""

    def base_and_slice(self, node: ast.Subscript, ends: ast.Slice) -> tuple[Term, slice]:
        """What has the elements, and which of them a slice is."""

    def base_and_index(self, node: ast.Subscript) -> tuple[Term, Term]:
        """What has the element, as itself and not as a copy, and its place."""

    def element(self, base: Term, index: Term, node: ast.AST) -> Term:
        """One element of a tuple, a list or an array, or of what is known."""

    def index(self, of: ArrayType, index: Term, node: ast.AST) -> Value:
        """A place in an array; IndexError beyond it."""

    def place_in(self, code: Code, length: int, node: ast.AST) -> Value:
        """A place among so many, counted from the end where it is negative; IndexError beyond them."""

    def of_numbers(
        self, sign: ast.operator, left: Term, right: Term, nodes: tuple[ast.AST, ast.AST], node: ast.AST
    ) -> Code:
        """An operator between numbers; between those of numpy nothing is raised."""

    def check_sure(self, terms: Sequence[Term], node: ast.AST) -> None:
        """That the result of arithmetic is a float whenever it is a real in C, and exact."""

    def arithmetic(self, sign: ast.operator, left: Code, right: Code, node: ast.AST) -> Code: ...


class AskedOfArrays(Protocol):
    """The arrays of a function."""

    def is_array(self, term: Term) -> bool: ...

    def array(self, term: Term, node: ast.AST) -> Code:
        """An array, or a number; TypeError where it is None."""

    def check_length(self, of: ArrayType, node: ast.AST) -> None:
        """The length is known."""

    def length_of(self, code: Code, node: ast.AST) -> int:
        """The length of one array, which is known."""

    def each_place(self, length: int) -> AbstractContextManager[Value]:
        """A loop over the places of an array."""

    def at(self, code: Code, of: CType, length: int) -> Value:
        """An element, as this type."""

    def kept_place(self, code: Code) -> Value:
        """An array as a variable or a field."""

    def fill(self, place: Value, code: Elementwise, test: Value | None = None) -> None:
        """A loop that sets the elements of an array, those for which the condition holds."""

    def as_array(self, term: Term, of: ArrayType, node: ast.AST) -> Value:
        """A term as an array of this type."""

    def of_arrays(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Code:
        """An operator between arrays, or an array and a number."""

    def of(self, code: Code) -> CType:
        """The type of its elements."""

    def of_array(self, sign: ast.unaryop, term: Term, node: ast.AST) -> Code:
        """An operator before an array."""

    def compared_arrays(self, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code: ...

    def of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """A function of numpy with these arguments; None: it has no translation."""

    def listed(self, term: Many, node: ast.AST) -> Code: ...

    def reduced(self, what: str, code: Code, node: ast.AST) -> Code:
        """One number of an array."""

    def attribute_of_array(self, code: Code, name: str, node: ast.AST) -> Term: ...

    def method_of_array(self, method: ArrayMethod, arguments: list[Term], node: ast.AST) -> Code: ...

    def sliced(self, term: Term, part: slice, node: ast.AST) -> Term:
        """A part of an array: other names for its elements."""

    def set_slice(self, base: Code, part: slice, value: Term, node: ast.AST) -> None:
        """The elements of a slice become others, which are computed before."""

    def overwrite(
        self, place: Code, value: Term, node: ast.AST, where: Code | None = None, by_place: bool = False
    ) -> None:
        """The elements of an array become others: all, or those that a mask chooses, each that of its place."""


class AskedOfVectors(Protocol):
    """The part of a function that reads and writes Vectors."""

    def attribute_of_vector(self, vector: Vector[Any], name: str, node: ast.AST) -> Term: ...

    def method_of_vector(
        self, vector: Vector[Any], name: str, arguments: list[Term], named: dict[str, Term], node: ast.AST
    ) -> Term: ...

    def values_of(self, vector: Vector[Any], more: list[Term], named: dict[str, Term], node: ast.AST) -> Code:
        """`value_of` of a Vector."""


class AskedOfAttributes(Protocol):
    """The part of a function that is attributes."""

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term: ...

    def field(self, owner: Any, name: str, base: Known, node: ast.AST) -> Term:
        """An attribute that is a number is a field; another one is known."""

    def check_in_c(self, name: str, node: ast.AST) -> None:
        """That the runtime in C has what is asked of an object: beside Python it has not."""

    def object(self, owner: Atomic, node: ast.AST) -> Value:
        """The object; a controller samples those that are synchronous."""

    def got_by(self, function: str, *arguments: Value, of: CType) -> Code:
        """The result of a function of the runtime that may fail."""


class AskedOfCalls(Protocol):
    """The part of a function that is calls and attributes."""

    def is_super(self, node: ast.AST) -> bool:
        """Whether this is `super()`."""

    def of_super(self, node: ast.Attribute) -> Term:
        """A method, a property or a value of the classes above."""

    def parts(self, term: Term, node: ast.AST) -> list[Term]:
        """The elements of a tuple, or of a list of numbers."""

    def members(self, term: Term, node: ast.AST) -> list[Term]:
        """The same, and the values of the fields of a dataclass."""

    def function(
        self, target: Callable[..., Any], arguments: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> Term: ...


class AskedOfBuiltins(Protocol):
    """The part of a function that calls min, max, abs, round, len, any, math ..."""

    def of_python(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """A function of Python itself, or of math; None: it is another one."""

    def first_of(self, target: Any, terms: Sequence[Term], keys: Sequence[Term], node: ast.Call) -> Term:
        """The first element whose key, a number or an ordered state, is the least (`min`), or the greatest."""


class AskedOfChoices(Protocol):
    """The objects of a function that are chosen when it runs."""

    def of_table(self, table: Any, index: Term, node: ast.AST) -> OneOf | None:
        """The object at a computed place, or of a computed key; None: the table has none, or numbers and states."""

    def each(self, choice: OneOf, what: Callable[[Known], Term], node: ast.AST) -> Term:
        """What is found for each of the objects, of the one that it is."""


class AskedOfGenerators(Protocol):
    """The generators of a function that something is made of at once."""

    def over(self, target: Any, node: ast.Call) -> Term | None:
        """any, all, sum, min, max, len or next of a generator; None: it is another call, or the number of elements is
        known."""

    def chosen(self, generator: ast.ListComp) -> Selection:
        """A list of the numbers for which the conditions hold."""


class AskedOfAssignments(Protocol):
    """The part of a function that is assignments."""

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None: ...


class AskedOfLoops(Protocol):
    """The loops of a function."""

    @property
    def around(self) -> Sequence[object]:
        """The loops around what is being lowered."""

    def is_range(self, node: ast.AST) -> bool:
        """Whether this is a call of `range`."""

    def bound_to(self, target: ast.AST, term: Term) -> AbstractContextManager[None]:
        """The name of a loop stands for one object."""


class AskedOfSequences(Protocol):
    """What is gone through in a function."""

    def over(self, node: ast.expr) -> Turns:
        """What a loop with this head goes through."""

    def is_iterator(self, node: ast.AST) -> bool:
        """Whether this is a call of `zip`, `enumerate` or `reversed`."""

    def check_same(self, turns: Turns, body: Sequence[Statement], rebound: int, node: ast.AST) -> None:
        """Python goes through the arrays that were there at the beginning."""

    def spread(self, nodes: Sequence[ast.expr]) -> list[Term]:
        """Elements that are written down, or arguments; those after a `*` are several ones."""

    def part_of(self, terms: Sequence[Term], node: ast.AST) -> slice:
        """The ends and the step of a slice."""

    def sliced(self, node: ast.Subscript, ends: ast.Slice) -> Term:
        """A part of a tuple or a list, as a copy."""

    def of_sequences(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Term | None:
        """Tuples or lists one after the other, or one several times; None: it is another operator."""

    def gone_through(self, node: ast.expr) -> list[Term]:
        """What a comprehension, a generator or an iterator gives, computed in its order."""

    def opened(self, node: ast.ListComp | ast.GeneratorExp) -> tuple[ast.ListComp | ast.GeneratorExp, Turns]:
        """A comprehension or generator, whose names are its own, and what it goes through."""

    def terms_of(self, node: ast.ListComp | ast.GeneratorExp, turns: Turns) -> Iterator[Term]:
        """What the expression of a generator gives in each turn."""

    def check_unchanged(self, turns: Turns, body: Sequence[Statement], node: ast.AST) -> None:
        """That no function which an expression calls changes what the expression goes through."""


class AskedOfRings(Protocol):
    """The deques of a function."""

    def count(self, term: Term, node: ast.AST) -> Code:
        """`len` of a deque."""

    def turns(self, term: Term, node: ast.AST) -> Turns:
        """What a loop over a deque finds."""

    def held(self, turns: Turns, node: ast.AST) -> AbstractContextManager[None]:
        """A loop over a deque: it does not change it, as Python raises there."""

    def element(self, term: Term, index: Term, node: ast.AST) -> Code:
        """IndexError beyond its ends."""

    def element_among(self, chosen: Selection, index: Term, node: ast.AST) -> Code:
        """The same of a list of those that were chosen."""

    def set_element(self, term: Term, index: Term, value: Term, node: ast.AST) -> None: ...

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term: ...

    def call(self, method: RingMethod, given: Sequence[Term], node: ast.AST) -> Term: ...


class AskedOfErrors(Protocol):
    """The errors of a function: raise, try, assert, with."""

    tries: int
