"""The intermediate form of translated code: typed values, places, statements and functions.

Python is lowered to the form (`umo.generate.lower`). The form is analysed and simplified (`umo.generate.check`), and
printed as C (`umo.generate.emit`). A value has no effects: whatever changes something or may fail is a statement. A
statement has the line of Python from which it comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from operator import is_
from typing import Any, Self, get_args, get_type_hints

from umo.generate.c_types import BOOL, INT, CType


class FormNode:
    """A part of the form. Nodes are equal if all their parts are equal."""

    @cached_property
    def children(self) -> tuple[FormNode, ...]:
        """The nodes directly in this node."""
        found: list[FormNode] = []
        kind: Any = type(self)
        for name in _parts(kind):
            part = getattr(self, name)
            if isinstance(part, tuple):
                found += part
            elif isinstance(part, FormNode):
                found.append(part)
        return tuple(found)

    @cached_property
    def inner(self) -> tuple[Statement | ErrorHandler, ...]:
        """The statements directly in this node, and the handlers, which contain statements."""
        return tuple(each for each in self.children if isinstance(each, Statement | ErrorHandler))

    @cached_property
    def mentioned(self) -> frozenset[Local | Temporary]:
        """The local names and temporaries in the node."""
        return frozenset[Local | Temporary]().union(*(each.mentioned for each in self.children))


class Value(FormNode):
    """An expression without effects."""


@dataclass(frozen=True)
class Literal(Value):
    """A number, a bool, the number of a state, or accepted qualities as bits."""

    value: float
    of: CType


@dataclass(frozen=True)
class Local(Value):
    """A local name or a parameter of Python. It may be assigned several times."""

    name: str
    of_generator: bool = False
    """True if the name belongs to a generator, outside of which no code reads it."""

    @property
    def mentioned(self) -> frozenset[Local | Temporary]:
        return frozenset((self,))


@dataclass(frozen=True)
class Temporary(Value):
    """A name for a value that is computed once. The name is not assigned after its first use."""

    name: str

    @property
    def mentioned(self) -> frozenset[Local | Temporary]:
        return frozenset((self,))


@dataclass(frozen=True)
class Field(Value):
    """An attribute of a live object: a field of its struct in the machine."""

    struct: str
    name: str


@dataclass(frozen=True)
class Member(Value):
    """A member of a tuple; `has` or `value` of an optional value."""

    whole: Value
    name: str


@dataclass(frozen=True)
class Element(Value):
    """An element of an array. Its index is within the bounds."""

    whole: Value
    index: Value


@dataclass(frozen=True)
class CurrentIndex(Value):
    """The current index in code that computes an array element by element."""


@dataclass(frozen=True)
class Unary(Value):
    """`-` or `!`."""

    sign: str
    operand: Value


@dataclass(frozen=True)
class Operator(Value):
    """An operator of C. Its operands have the type of the computation. `&&` and `||` compute the second operand only if
    needed."""

    sign: str
    left: Value
    right: Value


@dataclass(frozen=True)
class Conditional(Value):
    """One of two values, chosen by a condition."""

    test: Value
    one: Value
    other: Value


@dataclass(frozen=True)
class Runtime(Value):
    """A call of a runtime function that changes nothing and has no fault."""

    name: str
    arguments: tuple[Value, ...]


@dataclass(frozen=True)
class Conversion(Value):
    """A number converted to another type."""

    of: CType
    operand: Value


@dataclass(frozen=True)
class TupleOf(Value):
    """A tuple."""

    of: CType
    parts: tuple[Value, ...]


@dataclass(frozen=True)
class NoneValue(Value):
    """The value None, as an optional value."""

    of: CType


@dataclass(frozen=True)
class OptionalValue(Value):
    """A value, as an optional value."""

    of: CType
    value: Value


@dataclass(frozen=True)
class WholeMachine(Value):
    """The machine as a whole."""


@dataclass(frozen=True)
class Object(Value):
    """An atomic object, by its slot."""

    slot: int


@dataclass(frozen=True)
class ObjectOf(Value):
    """The object of a Vector at this place in a table of slots."""

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
    """The address of a place, for a function of the runtime that fills it."""

    place: Value


@dataclass(frozen=True)
class Elements(Value):
    """The address of the first element of an array."""

    array: Value


@dataclass(frozen=True)
class Null(Value):
    """The null pointer."""


@dataclass(frozen=True)
class Reals(Value):
    """Real numbers in a constant array."""

    parts: tuple[Value, ...]


ZERO, ONE = Literal(0, INT), Literal(1, INT)
TRUE, FALSE = Literal(True, BOOL), Literal(False, BOOL)
LEAST_INT = Literal(-(2**31), INT)


# Statements -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Statement(FormNode):
    line: int = field(default=0, kw_only=True, compare=False)
    """The line number of Python in the file of the function."""

    def at(self, line: int) -> Self:
        """Return the statement with this line number."""
        new = object.__new__(type(self))
        vars(new).update(vars(self), line=line)
        return new


Statements = tuple[Statement, ...]


@dataclass(frozen=True)
class Assign(Statement):
    place: Value
    value: Value


@dataclass(frozen=True)
class Begin(Statement):
    """The declaration of a variable with a value. The value is None if the variable begins with zero or None."""

    place: Value
    of: CType
    value: Value | None


@dataclass(frozen=True)
class RuntimeCall(Statement):
    """A call of a runtime function that changes something and has no fault."""

    call: Runtime


@dataclass(frozen=True)
class CallStatement(Statement):
    """A call of the runtime or of a translated function that may fail. The failure continues from here."""

    function: str
    arguments: tuple[Value, ...]
    out: Value | None = None
    """The place for its result; `Elements` for the elements of an array."""


@dataclass(frozen=True)
class TextStatement(Statement):
    """A statement at which Python makes the text with this number from these variables. Nothing in the form reads the
    text. The statement may fail."""

    number: int
    given: tuple[Value, ...]


@dataclass(frozen=True)
class CheckedArithmetic(Statement):
    """Arithmetic of integers: "add", "sub", "mul" or "shift_left", with a fault if the result leaves 32 bits."""

    what: str
    place: Value
    left: Value
    right: Value
    fault: int


@dataclass(frozen=True)
class Choose(Statement):
    """Assigns one of several values of a type to a place. The value is chosen by its number in a table."""

    place: Value
    table: str
    """The name of the table."""
    of: CType
    values: tuple[Value, ...]
    index: Value


@dataclass(frozen=True)
class If(Statement):
    test: Value
    body: Statements
    orelse: Statements = ()


@dataclass(frozen=True)
class EndlessLoop(Statement):
    """An endless loop. `Leave` with this label ends it; `NextTurn` continues at its beginning."""

    label: str
    body: Statements


@dataclass(frozen=True)
class CountedLoop(Statement):
    """A loop that counts `turn` from `first` while it is below `end`, or above `end` if the step is negative."""

    label: str
    turn: Value
    first: Value
    end: Value
    step: int
    body: Statements
    of: CType | None = None
    """The type of `turn`, if the loop declares it."""


@dataclass(frozen=True)
class Labelled(Statement):
    """Statements with a label. `Leave` with this label leaves them."""

    label: str
    body: Statements


@dataclass(frozen=True)
class Leave(Statement):
    label: str


@dataclass(frozen=True)
class NextTurn(Statement):
    """Continues with the next turn of a loop."""

    label: str


@dataclass(frozen=True)
class Fail(Statement):
    """Raises the fault with this number, or raises a caught fault again."""

    fault: int | Value


@dataclass(frozen=True)
class ErrorHandler(FormNode):
    """The statements that are carried out at a fault of one of these classes."""

    kinds: tuple[type[BaseException], ...]
    body: Statements


@dataclass(frozen=True)
class Try(Statement):
    """A failure in `body` goes to the first handler that matches its class, or continues if no handler matches.
    `orelse` follows if there was no failure."""

    caught: Temporary
    body: Statements
    orelse: Statements
    handlers: tuple[ErrorHandler, ...]


@dataclass(frozen=True)
class Finally(Statement):
    """`last` is carried out on every way out of `body`: after a failure, which is in `pending`, and after a return,
    which sets `returning` (None if there is no return)."""

    pending: Temporary | None
    returning: Temporary | None
    body: Statements
    last: Statements


@dataclass(frozen=True)
class Return(Statement):
    value: Value | None = None


@dataclass(frozen=True)
class FunctionForm(FormNode):
    """A function. In C it returns its fault, and stores its result in `out`."""

    name: str
    title: str
    """Name of the function in Python."""
    file: str
    line: int
    parameters: tuple[tuple[str, CType], ...]
    variables: tuple[tuple[str, CType], ...]
    """Local names and temporaries."""
    result: CType
    body: Statements


BODIES = "body", "orelse", "last"
"""Names of the bodies of statements."""


# Walks ------------------------------------------------------------------------------------------------------


@cache
def _parts(kind: Any) -> tuple[str, ...]:
    """Return the names of the fields of a node class that hold nodes or tuples of nodes."""
    return tuple(name for name, hint in get_type_hints(kind).items() if _is_of_nodes(hint))


def _is_of_nodes(hint: Any) -> bool:
    return (isinstance(hint, type) and issubclass(hint, FormNode)) or any(map(_is_of_nodes, get_args(hint)))


def walk(*nodes: FormNode) -> Iterator[FormNode]:
    """Return all nodes in these nodes, including the nodes themselves."""
    waiting = [*reversed(nodes)]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)


def statements(*nodes: Statement | FunctionForm) -> Iterator[FormNode]:
    """Return all statements and handlers in these nodes, including these nodes themselves, but not the values in
    them."""
    waiting: list[FormNode] = [*reversed(nodes)]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.inner)


def rebuilt(node: Any, change: Callable[[Any], Any]) -> Any:
    """Return a copy in which each node is replaced by `change(node)`, inner nodes first."""
    if not node.children:
        return change(node)
    kind: Any = type(node)
    new: dict[str, Any] = {}
    for name in _parts(kind):
        found = getattr(node, name)
        if isinstance(found, FormNode):
            new[name] = rebuilt(found, change)
        elif found:
            new[name] = tuple([rebuilt(each, change) for each in found])
    return change(_with(node, new))


def _with(node: Any, parts: Mapping[str, Any]) -> Any:
    """Return the node with these parts."""
    new = {name: each for name, each in parts.items() if not _is_same(getattr(node, name), each)}
    return replace(node, **new) if new else node


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(is_, one, other))
    return one is other


def with_bodies(statement: Statement, change: Callable[[Statements], Statements]) -> Statement:
    """Return the statement with its bodies replaced by `change(body)`."""
    if not statement.inner:
        return statement
    new: dict[str, Any] = {name: change(getattr(statement, name)) for name in BODIES if getattr(statement, name, ())}
    if isinstance(statement, Try):
        new["handlers"] = tuple(_with(each, {"body": change(each.body)}) for each in statement.handlers)
    return _with(statement, new)  # type: ignore[no-any-return]


def bodies(statement: Statement) -> Iterator[Statements]:
    """Return the bodies in a statement."""
    yield from (getattr(statement, name) for name in BODIES if getattr(statement, name, ()))
    if isinstance(statement, Try):
        yield from (each.body for each in statement.handlers)


def placed(value: Value, index: Value) -> Value:
    """Return the value of an element at this index."""
    found: Value = rebuilt(value, lambda each: index if isinstance(each, CurrentIndex) else each)
    return found


def root(place: Value) -> Value:
    """Return the variable or field that contains a place."""
    while isinstance(place, Member | Element):
        place = place.whole
    return place


def is_place(value: Value) -> bool:
    """True if this is a variable, a field, or a part of one."""
    return isinstance(root(value), Local | Temporary | Field)


def is_named(value: Value) -> bool:
    """True if this is a variable, a field, or a member of one. Nothing is then computed to find it."""
    while isinstance(value, Member):
        value = value.whole
    return isinstance(value, Local | Temporary | Field)


def is_settled(value: Value) -> bool:
    """True if the value is not changed by any computation before it is used."""
    while isinstance(value, Member):
        value = value.whole
    return isinstance(value, Literal | Temporary)


def whole(place: Value) -> Value:
    """Return the optional place if this place is the value in it, otherwise the place itself."""
    return place.whole if isinstance(place, Member) and place.name == "value" else place


def joined(sign: str, values: Sequence[Value]) -> Value:
    """Return a condition that holds if all (`&&`) or at least one (`||`) of these conditions hold."""
    first, *rest = values
    for each in rest:
        first = Operator(sign, first, each)
    return first


def as_value(truth: Value | bool) -> Value:
    """Return a condition as a value, even if its result is already known."""
    return Literal(truth, BOOL) if isinstance(truth, bool) else truth


def negated(value: Value) -> Value:
    return Unary("!", value)


def differs(value: Value) -> Value:
    """Return the condition that a number is not 0."""
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
    """The types of arrays and tuples, each after the types of its parts."""
    structs: Sequence[Struct] = ()
    tables: Mapping[str, Sequence[int]] = field(default_factory=dict)
    """Slots of the objects of Vectors, by the names of their tables."""
    functions: Sequence[FunctionForm] = ()
    begin: Statements = ()
    """The statements that set the initial values of the fields."""
    faults: Mapping[int, str] = field(default_factory=dict)
    """The names of the faults of the functions, by number."""
    handled: Mapping[tuple[type[BaseException], ...], Sequence[str]] = field(default_factory=dict)
    """The names of the faults that a handler catches, by its classes."""
    limits: Sequence[str] = ()
    """The names of the faults that do not exist in Python. `finally` does nothing for them."""

    @cached_property
    def files(self) -> list[str]:
        """The source files of the functions, in their order."""
        return list(dict.fromkeys(one.file for one in self.functions))

    @cached_property
    def own(self) -> frozenset[str]:
        """The names of the translated functions. Other names belong to the runtime."""
        return frozenset(one.name for one in self.functions)
