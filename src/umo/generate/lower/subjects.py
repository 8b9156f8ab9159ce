"""The protocols by which the subjects of a lowering use one another."""

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
    OneOf,
    RingMethod,
    Selection,
    Term,
    TupleTerm,
    Turns,
)
from umo.objects import Vector
from umo.objects.atomic import Atomic


class AskedOfValues(Protocol):
    """Lowers the values of a function."""

    def type_of(self, term: Term) -> CType | None:
        """Return the type of a term, or None if the term is not a value that a controller can have."""

    def kept(self, code: Code, what: str = "t") -> Code:
        """Return the value under a new name, if it has none."""

    def copied(self, code: Code) -> Code:
        """Return the value copied to a new name."""

    def new_list(self, terms: Sequence[Term], node: ast.AST) -> Code | None:
        """Return a new list with these numbers, or None if the numbers have different classes, or if there are none."""

    def literal(self, value: Any, of: CType, node: ast.AST) -> Value: ...

    def is_list_itself(self, term: Term) -> bool:
        """True if the term is the list of an attribute itself, so that changes of the list are seen here."""

    def settled(self, term: Term) -> Term:
        """Return the term with its values stored such that later statements cannot change them."""

    def code(self, term: Term, node: ast.AST) -> Code:
        """Return a term as a value in C."""

    def as_type(self, term: Term, of: CType, node: ast.AST) -> Value:
        """Return a term as a value of this type."""

    def present(self, code: Code, node: ast.AST) -> Code:
        """Return the value of an optional term. Raises TypeError if it is None."""

    def check_there(self, of: CType | None, where: str, node: ast.AST) -> None:
        """Refuse a type whose values may be None."""

    def number(self, term: Term, node: ast.AST) -> Code: ...

    def truth(self, term: Term, node: ast.AST) -> Value | bool:
        """Return the truth of a term as a condition; as a bool if it is already known."""


class AskedOfAliases(Protocol):
    """The questions about references to the arrays of a function."""

    sole: set[Value]

    sole_result: bool

    rebound: list[Value]

    changes: set[Value]

    keeps: bool

    def check_sole(self, place: Code, node: ast.AST) -> None:
        """Refuse an array that may have another reference."""

    def is_sole(self, term: Term) -> bool:
        """True if an array has no other reference."""

    def is_copied(self, term: Term) -> bool:
        """True if this is a computed value and not another name for an existing array."""

    def is_new(self, term: Term) -> bool:
        """True if an array was made here and has no name yet."""

    def share(self, term: Term) -> None:
        """Record that an array gets another name. From now on the array is not changed in place."""


class AskedOfTexts(Protocol):
    """Lowers or leaves out the texts of a function."""

    def check_removable(self, nodes: Sequence[ast.AST]) -> None:
        """Refuse expressions whose evaluation for a text may change something or fail."""

    def does_nothing(self, test: ast.expr) -> bool:
        """True if evaluating a condition has no effect and cannot fail."""

    def check_decided(self, term: Term, node: ast.AST) -> None:
        """Refuse a condition that depends on a text made at run time."""

    def is_text(self, node: ast.AST) -> bool:
        """True if an expression makes a text at run time."""

    def python_makes_error(self, node: ast.expr, kind: type[BaseException], said: str, fault: int) -> None:
        """Let Python make the error of a fault if Python calls the code."""

    def python_sets_field(self, term: Term, node: ast.AST, target: ast.Attribute, owner: Any) -> bool:
        """Let Python assign a text made at run time, and return True. Return False if the assignment is left out."""

    def python_calls(self, node: ast.Call) -> bool:
        """Let Python call a function that only makes texts, and return True. Return False if the call is left out."""

    def text(self, node: ast.expr) -> Known:
        """Return the text that an expression makes at run time."""


class AskedOfExpressions(Protocol):
    """Lowers the expressions of a function."""

    def lower_name(self, node: ast.Name) -> Term: ...

    def place(self, code: Code) -> Code:
        """Return the value in a form whose members can be read."""

    def check_elements(self, term: Term, node: ast.AST) -> None:
        """Refuse a term without elements."""

    def base_and_slice(self, node: ast.Subscript, ends: ast.Slice) -> tuple[Term, slice]:
        """Return the term that has the elements, and the slice."""

    def base_and_index(self, node: ast.Subscript) -> tuple[Term, Term]:
        """Return the term that has the element, without copying it, and the index."""

    def element(self, base: Term, index: Term, node: ast.AST) -> Term:
        """Return one element of a tuple, a list, an array or a known value."""

    def index(self, of: ArrayType, index: Term, node: ast.AST) -> Value:
        """Return an index into an array. Raises IndexError beyond its ends."""

    def place_in(self, code: Code, length: int, node: ast.AST) -> Value:
        """Return an index into `length` elements, counted from the end if negative. Raises IndexError beyond the
        ends."""

    def of_numbers(
        self, sign: ast.operator, left: Term, right: Term, nodes: tuple[ast.AST, ast.AST], node: ast.AST
    ) -> Code:
        """Return the result of an operator on numbers. Operators on numpy numbers raise nothing."""

    def check_sure(self, terms: Sequence[Term], node: ast.AST) -> None:
        """Refuse arithmetic whose result is a real in C but, in Python, might not be a float or might not be exact."""

    def arithmetic(self, sign: ast.operator, left: Code, right: Code, node: ast.AST) -> Code: ...


class AskedOfArrays(Protocol):
    """The arrays of a function."""

    def is_array(self, term: Term) -> bool: ...

    def array(self, term: Term, node: ast.AST) -> Code:
        """Return an array or a number. Raises TypeError for None."""

    def check_length(self, of: ArrayType, node: ast.AST) -> None:
        """Refuse an array whose length is not known."""

    def length_of(self, code: Code, node: ast.AST) -> int:
        """Return the known length of an array."""

    def each_place(self, length: int) -> AbstractContextManager[Value]:
        """Return a context for a loop over the indices of an array."""

    def at(self, code: Code, of: CType, length: int) -> Value:
        """Return an element as this type."""

    def kept_place(self, code: Code) -> Value:
        """Return an array as a variable or a field."""

    def fill(self, place: Value, code: Elementwise, test: Value | None = None) -> None:
        """Add a loop that sets the elements of an array for which the condition holds."""

    def as_array(self, term: Term, of: ArrayType, node: ast.AST) -> Value:
        """Return a term as an array of this type."""

    def of_arrays(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Code:
        """Return the result of an operator between arrays, or an array and a number."""

    def of(self, code: Code) -> CType:
        """Return the type of the elements of an array."""

    def of_array(self, sign: ast.unaryop, term: Term, node: ast.AST) -> Code:
        """Return the result of a unary operator on an array."""

    def compared_arrays(self, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code: ...

    def of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """Return the result of a numpy function, or None if the function cannot be translated."""

    def listed(self, term: TupleTerm, node: ast.AST) -> Code: ...

    def reduced(self, what: str, code: Code, node: ast.AST) -> Code:
        """Reduce an array to one number."""

    def attribute_of_array(self, code: Code, name: str, node: ast.AST) -> Term: ...

    def method_of_array(self, method: ArrayMethod, arguments: list[Term], node: ast.AST) -> Code: ...

    def sliced(self, term: Term, part: slice, node: ast.AST) -> Term:
        """Return a slice of an array: the elements of the array under other indices."""

    def set_slice(self, base: Code, part: slice, value: Term, node: ast.AST) -> None:
        """Set the elements of a slice to values that are computed first."""

    def overwrite(
        self, place: Code, value: Term, node: ast.AST, where: Code | None = None, by_place: bool = False
    ) -> None:
        """Replace all elements of an array, or those that a mask selects, each by the value at its index."""


class AskedOfVectors(Protocol):
    """Lowers reads and writes of Vectors."""

    def attribute_of_vector(self, vector: Vector[Any], name: str, node: ast.AST) -> Term: ...

    def method_of_vector(
        self, vector: Vector[Any], name: str, arguments: list[Term], named: dict[str, Term], node: ast.AST
    ) -> Term: ...

    def values_of(self, vector: Vector[Any], more: list[Term], named: dict[str, Term], node: ast.AST) -> Code:
        """Return `value_of` of a Vector."""


class AskedOfAttributes(Protocol):
    """Lowers the attributes of a function."""

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term: ...

    def field(self, owner: Any, name: str, base: Known, node: ast.AST) -> Term:
        """Return a field if the attribute is a number, otherwise a known value."""

    def check_in_c(self, name: str, node: ast.AST) -> None:
        """Refuse an attribute of an object if Python evaluates it when laws are compiled."""

    def object(self, owner: Atomic, node: ast.AST) -> Value:
        """Return the object. A note is added for an asynchronous sensor, because a controller does not read it."""

    def got_by(self, function: str, *arguments: Value, of: CType) -> Code:
        """Return the result of a runtime function that may fail."""


class AskedOfCalls(Protocol):
    """Lowers the calls and attributes of a function."""

    def is_super(self, node: ast.AST) -> bool:
        """True if this is `super()`."""

    def of_super(self, node: ast.Attribute) -> Term:
        """Return a method, a property or a value of a base class."""

    def parts(self, term: Term, node: ast.AST) -> list[Term]:
        """Return the elements of a tuple or of a list of numbers."""

    def members(self, term: Term, node: ast.AST) -> list[Term]:
        """Return the members of a value, and the values of the fields of a dataclass."""

    def function(
        self, target: Callable[..., Any], arguments: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> Term: ...


class AskedOfBuiltins(Protocol):
    """Lowers the calls of min, max, abs, round, len, any, math and others."""

    def of_python(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """Return the result of a built-in function or of a function of math, or None for other functions."""

    def first_of(self, target: Any, terms: Sequence[Term], keys: Sequence[Term], node: ast.Call) -> Term:
        """Return the first element with the smallest (`min`) or largest key. A key is a number or an ordered state."""


class AskedOfChoices(Protocol):
    """Lowers the use of objects that are chosen at run time."""

    def of_table(self, table: Any, index: Term, node: ast.AST) -> OneOf | None:
        """Return the object at a computed index or key, or None if the table has numbers or states, or is empty."""

    def each(self, choice: OneOf, what: Callable[[Known], Term], node: ast.AST) -> Term:
        """Return the result of `what` for the object that is chosen at run time."""


class AskedOfGenerators(Protocol):
    """Lowers generators that are passed directly to a function."""

    def over(self, target: Any, node: ast.Call) -> Term | None:
        """Return the result of any, all, sum, min, max, len or next of a generator. Return None for other calls, or if
        the number of elements is known."""

    def chosen(self, generator: ast.ListComp) -> Selection:
        """Return a list of the numbers for which the conditions hold."""


class AskedOfAssignments(Protocol):
    """Lowers the assignments of a function."""

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None: ...


class AskedOfLoops(Protocol):
    """The loops of a function."""

    @property
    def around(self) -> Sequence[object]:
        """The loops that contain the statement that is being lowered."""

    def is_range(self, node: ast.AST) -> bool:
        """True if this is a call of `range`."""

    def bound_to(self, target: ast.AST, term: Term) -> AbstractContextManager[None]:
        """Return a context in which the loop variable means one object."""


class AskedOfSequences(Protocol):
    """Lowers the iterables of a function."""

    def over(self, node: ast.expr) -> Turns:
        """Return the iterations of a loop with this header."""

    def is_iterator(self, node: ast.AST) -> bool:
        """True if this is a call of `zip`, `enumerate` or `reversed`."""

    def check_same(self, turns: Turns, body: Sequence[Statement], rebound: int, node: ast.AST) -> None:
        """Check that arrays are not replaced during a loop, because Python iterates over the arrays that existed at the
        beginning."""

    def spread(self, nodes: Sequence[ast.expr]) -> list[Term]:
        """Return the elements or arguments that are written out, including those after a `*`."""

    def part_of(self, terms: Sequence[Term], node: ast.AST) -> slice:
        """Return the ends and the step of a slice."""

    def sliced(self, node: ast.Subscript, ends: ast.Slice) -> Term:
        """Return a part of a tuple or a list, as a copy."""

    def of_sequences(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Term | None:
        """Return tuples or lists joined by `+` or repeated by `*`. Return None for other operators."""

    def gone_through(self, node: ast.expr) -> list[Term]:
        """Return the values of a comprehension, a generator or an iterator, computed in order."""

    def opened(self, node: ast.ListComp | ast.GeneratorExp) -> tuple[ast.ListComp | ast.GeneratorExp, Turns]:
        """Return a comprehension or generator whose names differ from those of the function, and its turns."""

    def terms_of(self, node: ast.ListComp | ast.GeneratorExp, turns: Turns) -> Iterator[Term]:
        """Return the values of a generator's expression for each turn."""

    def check_unchanged(self, turns: Turns, body: Sequence[Statement], node: ast.AST) -> None:
        """Refuse a call in an expression that changes what the expression iterates over."""


class AskedOfRings(Protocol):
    """The deques of a function."""

    def count(self, term: Term, node: ast.AST) -> Code:
        """Return `len` of a deque."""

    def turns(self, term: Term, node: ast.AST) -> Turns:
        """Return the turns of a loop over a deque."""

    def held(self, turns: Turns, node: ast.AST) -> AbstractContextManager[None]:
        """Return a context for a loop over a deque. In the loop the deque must not be changed, because Python raises an
        error there."""

    def element(self, term: Term, index: Term, node: ast.AST) -> Code:
        """Return an element. Raises IndexError beyond the ends."""

    def element_among(self, chosen: Selection, index: Term, node: ast.AST) -> Code:
        """Return an element of a list that conditions have selected. Raises IndexError beyond the ends."""

    def set_element(self, term: Term, index: Term, value: Term, node: ast.AST) -> None: ...

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term: ...

    def call(self, method: RingMethod, given: Sequence[Term], node: ast.AST) -> Term: ...


class AskedOfErrors(Protocol):
    """Lowers raise, try, assert and with."""

    tries: int
