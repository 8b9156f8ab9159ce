"""Finds what statements may change and where they may lead."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from umo.generate.form import (
    Address,
    Assign,
    CallStatement,
    CheckedArithmetic,
    Choose,
    CountedLoop,
    Element,
    Elements,
    EndlessLoop,
    Fail,
    Field,
    Finally,
    FormNode,
    If,
    Labelled,
    Leave,
    Local,
    MachineForm,
    Member,
    NextTurn,
    Object,
    ObjectOf,
    OfObject,
    Return,
    Runtime,
    RuntimeCall,
    Statement,
    Temporary,
    TextStatement,
    Try,
    Value,
    WholeMachine,
    root,
    statements,
    walk,
)

ASSIGNS = "an attribute is assigned"
"""The effect of a function that assigns fields."""
JUMPS = Return, Fail, Leave, NextTurn


def changes(statement: Statement) -> bool:
    """True if the value of an expression computed before this statement may be different after it."""
    return any(map(_changes, statements(statement)))


def _changes(node: FormNode) -> bool:
    if isinstance(node, Assign | CheckedArithmetic | Choose):
        return not _is_own(root(node.place))
    if isinstance(node, RuntimeCall):
        filled = [each.place for each in node.call.arguments if isinstance(each, Address)]
        return not filled or not all(_is_own(root(each)) for each in filled)
    return isinstance(node, CallStatement)


def _is_own(place: Value) -> bool:
    """True if no expression before this statement can have read the place."""
    return isinstance(place, Temporary) or (isinstance(place, Local) and place.of_generator)


def changes_machine(statement: Statement) -> bool:
    """True if a function is called that may change fields or objects."""
    return any(_changes(each) for each in statements(statement) if isinstance(each, CallStatement | RuntimeCall))


def calls(body: Iterable[Statement]) -> bool:
    """True if a function is called that may change anything."""
    return any(isinstance(each, CallStatement) for each in statements(*body))


def leaves(label: str, body: Iterable[Statement]) -> bool:
    """True if one of these statements leaves the statement with this label."""
    return any(isinstance(each, Leave) and each.label == label for each in statements(*body))


def may_fail(body: Iterable[Statement]) -> bool:
    """True if a failure may leave these statements. A failure inside `try` also leaves them if no handler matches."""
    return any(isinstance(each, Fail | CallStatement | CheckedArithmetic | TextStatement) for each in statements(*body))


def returns(body: Iterable[Statement]) -> bool:
    """True if these statements may return from the function."""
    return any(isinstance(each, Return) for each in statements(*body))


def goes_on(body: Iterable[Statement]) -> bool:
    """True if the code after these statements may be reached."""
    return all(map(_goes_on, body))


def _goes_on(statement: Statement) -> bool:
    if isinstance(statement, JUMPS):
        return False
    if isinstance(statement, If):
        return goes_on(statement.body) or goes_on(statement.orelse)
    if isinstance(statement, Labelled):
        return goes_on(statement.body) or leaves(statement.label, statement.body)
    if isinstance(statement, EndlessLoop):
        return leaves(statement.label, statement.body)
    if isinstance(statement, Try):
        way = goes_on((*statement.body, *statement.orelse))
        return way or any(goes_on(each.body) for each in statement.handlers)
    if isinstance(statement, Finally):
        return goes_on(statement.last) and goes_on(statement.body)
    return True


# What one statement reads and writes ------------------------------------------------------------------------


def own_values(statement: Statement) -> Iterator[Value]:
    """Return the values in a statement, without those of the statements inside it."""
    return (each for each in statement.children if isinstance(each, Value))


def indices(place: Value) -> Iterator[Value]:
    """Return the values that are computed to find a place."""
    while isinstance(place, Member | Element):
        if isinstance(place, Element):
            yield place.index
        place = place.whole


def read_values(statement: Statement) -> Iterator[Value]:
    """Return the values that a statement itself reads."""
    if isinstance(statement, Assign):
        yield from (statement.value, *indices(statement.place))
    elif isinstance(statement, CheckedArithmetic):
        yield from (statement.left, statement.right, *indices(statement.place))
    elif isinstance(statement, Choose):
        yield from (*statement.values, statement.index, *indices(statement.place))
    elif isinstance(statement, CallStatement):
        yield from statement.arguments
    elif not isinstance(statement, Try | Finally):
        yield from own_values(statement)


def written(statement: Statement) -> set[Value]:
    """Return the variables and fields that a statement, or a statement inside it, writes itself. A called function may
    write any field."""
    return {root(place) for each in walk(statement) for place in _places(each)}


def _places(node: FormNode) -> Iterator[Value]:
    if isinstance(node, Assign | CheckedArithmetic | Choose | Address):
        yield node.place
    elif isinstance(node, CallStatement) and node.out is not None:
        yield node.out.array if isinstance(node.out, Elements) else node.out
    elif isinstance(node, CountedLoop):
        yield node.turn
    elif isinstance(node, Try):
        yield node.caught
    elif isinstance(node, Finally):
        yield from (each for each in (node.pending, node.returning) if each is not None)


def effects_of(program: MachineForm) -> dict[str, set[str | int]]:
    """Return the effects of each function, including those of the functions that it calls. The effects are the
    functions of the runtime that are called, the members of objects that are read, ASSIGNS, and the numbers of the
    texts that are made."""
    forms = {each.name: each for each in program.functions}
    found: dict[str, set[str | int]] = {}

    def of(name: str) -> set[str | int]:
        if name not in found:
            own = {effect for each in walk(forms[name]) for effect in _effects(each)}
            found[name] = own.union(*(of(each) for each in own & forms.keys()))  # type: ignore[arg-type]
        return found[name]

    return {name: of(name) for name in forms}


def _effects(node: FormNode) -> Iterator[str | int]:
    if isinstance(node, CallStatement):
        yield node.function
    elif isinstance(node, Runtime | OfObject):
        yield node.name
    elif isinstance(node, TextStatement):
        yield node.number
    if any(isinstance(root(each), Field) for each in _places(node)):
        yield ASSIGNS


def reads_machine(value: Value) -> bool:
    """True if a called function may change this value."""
    return any(isinstance(each, Field | Object | ObjectOf | WholeMachine) for each in walk(value))
