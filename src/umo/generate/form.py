"""The intermediate form of translated code: values, places, statements and functions, each of one type.

Python is lowered to it (`umo.generate.lower`), it is looked through and simplified (`umo.generate.check`), and C is
printed from it (`umo.generate.emit`). A value has no effects: what changes something, or may fail, is a statement. A
statement knows the line of Python that it comes from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from operator import is_
from typing import Any

from umo.generate.c_types import BOOL, INT, CType


class FormNode:
    """A part of the form. Nodes are equal where all that they are made of is."""


class Value(FormNode):
    """An expression without effects."""


@dataclass(frozen=True)
class Literal(Value):
    """A number, a bool, the number of a state, or qualities that are accepted, as bits."""

    value: float
    of: CType


@dataclass(frozen=True)
class Local(Value):
    """A local name of Python, or a parameter: it may be assigned again and again."""

    name: str
    of_generator: bool = False
    """Whether it is one of a generator, outside of which nothing reads it."""


@dataclass(frozen=True)
class Temporary(Value):
    """A name for a value that is computed once: nothing assigns it after its first use."""

    name: str


@dataclass(frozen=True)
class Field(Value):
    """An attribute of a live object: a field of its struct in the machine."""

    struct: str
    name: str


@dataclass(frozen=True)
class Member(Value):
    """A member of a tuple; `has` and `value` of what may be None."""

    whole: Value
    name: str


@dataclass(frozen=True)
class Element(Value):
    """An element of an array, whose index is within its bounds."""

    whole: Value
    index: Value


@dataclass(frozen=True)
class Here(Value):
    """The place at which an array is computed element by element."""


@dataclass(frozen=True)
class Unary(Value):
    """`-` or `!`."""

    sign: str
    operand: Value


@dataclass(frozen=True)
class Operator(Value):
    """An operator of C, whose operands have the type that it is to compute in; `&&` and `||` compute the second one
    only if they need it."""

    sign: str
    left: Value
    right: Value


@dataclass(frozen=True)
class Conditional(Value):
    """One of two values."""

    test: Value
    one: Value
    other: Value


@dataclass(frozen=True)
class Runtime(Value):
    """What a function of the runtime gives: it changes nothing and has no fault."""

    name: str
    arguments: tuple[Value, ...]


@dataclass(frozen=True)
class Conversion(Value):
    """A number as another type."""

    of: CType
    operand: Value


@dataclass(frozen=True)
class TupleOf(Value):
    """A tuple."""

    of: CType
    parts: tuple[Value, ...]


@dataclass(frozen=True)
class Absent(Value):
    """None, where another value may be."""

    of: CType


@dataclass(frozen=True)
class Given(Value):
    """A value where None may be."""

    of: CType
    value: Value


@dataclass(frozen=True)
class WholeMachine(Value):
    """The machine."""


@dataclass(frozen=True)
class Object(Value):
    """An atomic object, by its slot."""

    slot: int


@dataclass(frozen=True)
class ObjectOf(Value):
    """An object of a Vector: the one at this place of a table of slots."""

    table: str
    index: Value


@dataclass(frozen=True)
class OfObject(Value):
    """A member of an atomic object."""

    object: Value
    name: str


@dataclass(frozen=True)
class SlotTable(Value):
    """A table of slots."""

    name: str


@dataclass(frozen=True)
class Address(Value):
    """Where something is, for a function of the runtime that fills it."""

    place: Value


@dataclass(frozen=True)
class Elements(Value):
    """Where the elements of an array begin."""

    array: Value


@dataclass(frozen=True)
class Null(Value):
    """No address."""


@dataclass(frozen=True)
class Reals(Value):
    """Real numbers in a row."""

    parts: tuple[Value, ...]


ZERO, ONE = Literal(0, INT), Literal(1, INT)
TRUE, FALSE = Literal(True, BOOL), Literal(False, BOOL)
LEAST_INT = Literal(-(2**31), INT)


# Statements -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Statement(FormNode):
    line: int = field(default=0, kw_only=True, compare=False)
    """The line of Python, in the file of the function."""


Statements = tuple[Statement, ...]


@dataclass(frozen=True)
class Assign(Statement):
    place: Value
    value: Value


@dataclass(frozen=True)
class Begin(Statement):
    """A variable begins, with this value; None: with zero, or None."""

    place: Value
    of: CType
    value: Value | None


@dataclass(frozen=True)
class Do(Statement):
    """A function of the runtime that changes something, and has no fault."""

    call: Runtime


@dataclass(frozen=True)
class CallStatement(Statement):
    """A function that may fail: of the runtime, or one that is translated too. The failure goes on from here."""

    function: str
    arguments: tuple[Value, ...]
    out: Value | None = None
    """Where its result goes; the elements of an array as `Elements`."""


@dataclass(frozen=True)
class TellStatement(Statement):
    """Python makes the text of this number, of these variables: nothing of the form reads it. It may fail."""

    number: int
    given: tuple[Value, ...]


@dataclass(frozen=True)
class Checked(Statement):
    """Arithmetic of whole numbers: "add", "sub", "mul" or "shift_left"; the fault where it leaves 32 bits."""

    what: str
    place: Value
    left: Value
    right: Value
    fault: int


@dataclass(frozen=True)
class Choose(Statement):
    """A place gets one of several values of a type, by its number in the table of them."""

    place: Value
    table: str
    """A name for it."""
    of: CType
    values: tuple[Value, ...]
    index: Value


@dataclass(frozen=True)
class If(Statement):
    test: Value
    body: Statements
    orelse: Statements = ()


@dataclass(frozen=True)
class Forever(Statement):
    """A loop that is left by `Leave` of this label; `NextTurn` goes to its beginning."""

    label: str
    body: Statements


@dataclass(frozen=True)
class CountedLoop(Statement):
    """A loop whose `turn` goes from `first` on, while it is below `end`; above, with a negative step."""

    label: str
    turn: Value
    first: Value
    end: Value
    step: int
    body: Statements
    of: CType | None = None
    """Where the loop declares its `turn`, the type of it."""


@dataclass(frozen=True)
class Labelled(Statement):
    """Statements that `Leave` of this label leaves."""

    label: str
    body: Statements


@dataclass(frozen=True)
class Leave(Statement):
    label: str


@dataclass(frozen=True)
class NextTurn(Statement):
    """Go on with the next turn of a loop."""

    label: str


@dataclass(frozen=True)
class Fail(Statement):
    """The fault of this number, or one that was caught."""

    fault: int | Value


@dataclass(frozen=True)
class ErrorHandler(FormNode):
    """What is done at a fault of one of these classes."""

    kinds: tuple[type[BaseException], ...]
    body: Statements


@dataclass(frozen=True)
class Try(Statement):
    """A failure in `body` goes to the first handler that it is for, else on; `orelse` follows where there was none."""

    caught: Temporary
    body: Statements
    orelse: Statements
    handlers: tuple[ErrorHandler, ...]


@dataclass(frozen=True)
class Finally(Statement):
    """`last` is done on every way out of `body`: at a failure, which is in `pending`, and at a return, which is marked
    in `returning`; None: there is none."""

    pending: Temporary | None
    returning: Temporary | None
    body: Statements
    last: Statements


@dataclass(frozen=True)
class Return(Statement):
    value: Value | None = None


@dataclass(frozen=True)
class FunctionForm(FormNode):
    """A function. It returns its fault; its result goes to `out`."""

    name: str
    title: str
    """What it is in Python."""
    file: str
    line: int
    parameters: tuple[tuple[str, CType], ...]
    variables: tuple[tuple[str, CType], ...]
    """Local ones and temporaries."""
    result: CType
    body: Statements


BODIES = "body", "orelse", "last"
"""Names of the bodies of statements."""


# Walks ------------------------------------------------------------------------------------------------------


@cache
def _parts(kind: Any) -> tuple[str, ...]:
    return tuple(each.name for each in fields(kind))


def _inner(node: FormNode) -> Iterator[tuple[str, Any]]:
    kind: Any = type(node)
    return ((name, getattr(node, name)) for name in _parts(kind))


def children(node: FormNode) -> Iterator[FormNode]:
    """The nodes that a node is made of."""
    kind: Any = type(node)
    for name in _parts(kind):
        found = getattr(node, name)
        if isinstance(found, FormNode):
            yield found
        elif isinstance(found, tuple):
            for each in found:
                if isinstance(each, FormNode):
                    yield each


def walk(*nodes: FormNode) -> Iterator[FormNode]:
    """Every node in these, themselves included."""
    waiting = [*reversed(nodes)]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed([*children(node)])


def rebuilt(node: Any, change: Callable[[Any], Any]) -> Any:
    """The same, in which each node became what `change` makes of it, the inner ones first."""
    new = {}
    for name, found in _inner(node):
        after = found
        if isinstance(found, FormNode):
            after = rebuilt(found, change)
        elif isinstance(found, tuple) and any(isinstance(each, FormNode) for each in found):
            after = tuple(rebuilt(each, change) for each in found)
            after = found if all(map(is_, found, after)) else after
        if after is not found:
            new[name] = after
    return change(replace(node, **new) if new else node)


def with_bodies(statement: Statement, change: Callable[[Statements], Statements]) -> Statement:
    """The same statement, whose bodies became what `change` makes of them."""
    new: dict[str, Any] = {name: change(getattr(statement, name)) for name in BODIES if getattr(statement, name, ())}
    if isinstance(statement, Try):
        new["handlers"] = tuple(replace(each, body=change(each.body)) for each in statement.handlers)
    return replace(statement, **new) if new else statement


def bodies(statement: Statement) -> Iterator[Statements]:
    """The bodies in a statement."""
    yield from (getattr(statement, name) for name in BODIES if getattr(statement, name, ()))
    if isinstance(statement, Try):
        yield from (each.body for each in statement.handlers)


def placed(value: Value, index: Value) -> Value:
    """The value of an element at this place."""
    found: Value = rebuilt(value, lambda each: index if isinstance(each, Here) else each)
    return found


def root(place: Value) -> Value:
    """The variable or field that a place is in."""
    while isinstance(place, Member | Element):
        place = place.whole
    return place


def is_place(value: Value) -> bool:
    """Whether this is a variable, a field, or a part of one."""
    return isinstance(root(value), Local | Temporary | Field)


def is_named(value: Value) -> bool:
    """Whether this is a variable, a field, or a member of one: to find it computes nothing."""
    while isinstance(value, Member):
        value = value.whole
    return isinstance(value, Local | Temporary | Field)


def is_settled(value: Value) -> bool:
    """Whether it stays the same whatever is computed before it is used."""
    while isinstance(value, Member):
        value = value.whole
    return isinstance(value, Literal | Temporary)


def whole(place: Value) -> Value:
    """The place itself, where this is the value of what may be None."""
    return place.whole if isinstance(place, Member) and place.name == "value" else place


def joined(sign: str, values: Sequence[Value]) -> Value:
    """Several conditions, of which all (`&&`) or one (`||`) hold."""
    first, *rest = values
    for each in rest:
        first = Operator(sign, first, each)
    return first


def as_value(truth: Value | bool) -> Value:
    """A condition, also one that is known already."""
    return Literal(truth, BOOL) if isinstance(truth, bool) else truth


def negated(value: Value) -> Value:
    return Unary("!", value)


def differs(value: Value) -> Value:
    """Whether a number is not 0."""
    return Operator("!=", value, ZERO)


def has(value: Value) -> Value:
    return Member(value, "has")


def inside(value: Value) -> Value:
    return Member(value, "value")


# A whole machine ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Struct(FormNode):
    """The fields of a live object."""

    name: str
    """The member of the machine's struct."""
    title: str
    fields: tuple[tuple[str, CType], ...]


@dataclass
class MachineForm:
    """The translated functions of one machine."""

    records: Sequence[CType] = ()
    """The types of arrays and tuples, each after what it is made of."""
    structs: Sequence[Struct] = ()
    tables: Mapping[str, Sequence[int]] = field(default_factory=dict)
    """Slots of the objects of Vectors, by the name of their table."""
    functions: Sequence[FunctionForm] = ()
    begin: Statements = ()
    """What gives the fields their values."""
    faults: Mapping[int, str] = field(default_factory=dict)
    """The names of the faults of the functions, by number."""
    handled: Mapping[tuple[type[BaseException], ...], Sequence[str]] = field(default_factory=dict)
    """The names of the faults that a handler of these classes catches."""

    @cached_property
    def files(self) -> list[str]:
        """Of the functions, in their order."""
        return list(dict.fromkeys(one.file for one in self.functions))

    @cached_property
    def own(self) -> frozenset[str]:
        """The names of the functions; others are the runtime's."""
        return frozenset(one.name for one in self.functions)
