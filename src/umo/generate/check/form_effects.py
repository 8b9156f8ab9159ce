"""What statements may change, and where they may lead."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from umo.generate.form import (
    Address,
    Assign,
    CallStatement,
    Checked,
    Choose,
    CountedLoop,
    Do,
    Element,
    Elements,
    Fail,
    Field,
    Finally,
    Forever,
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
    Statement,
    TellStatement,
    Temporary,
    Try,
    Value,
    WholeMachine,
    children,
    root,
    walk,
)

ASSIGNS = "an attribute is assigned"
"""One of the effects of a function."""
JUMPS = Return, Fail, Leave, NextTurn


def changes(statement: Statement) -> bool:
    """Whether what an expression before this statement has seen may be another one after it."""
    return any(map(_changes, walk(statement)))


def _changes(node: FormNode) -> bool:
    if isinstance(node, Assign | Checked | Choose):
        return not _is_own(root(node.place))
    if isinstance(node, Do):
        filled = [each.place for each in node.call.arguments if isinstance(each, Address)]
        return not filled or not all(_is_own(root(each)) for each in filled)
    return isinstance(node, CallStatement)


def _is_own(place: Value) -> bool:
    """Whether no expression before has seen it."""
    return isinstance(place, Temporary) or (isinstance(place, Local) and place.of_generator)


def changes_machine(statement: Statement) -> bool:
    """Whether a function is called that may change fields and objects."""
    return any(_changes(each) for each in walk(statement) if isinstance(each, CallStatement | Do))


def calls(statements: Iterable[Statement]) -> bool:
    """Whether a function is called that may change anything."""
    return any(isinstance(each, CallStatement) for each in walk(*statements))


def leaves(label: str, statements: Iterable[Statement]) -> bool:
    """Whether one of these statements leaves what has this label."""
    return any(isinstance(each, Leave) and each.label == label for each in walk(*statements))


def may_fail(statements: Iterable[Statement]) -> bool:
    """Whether a failure comes out of these statements. One that is caught goes on where no handler is for it."""
    return any(isinstance(each, Fail | CallStatement | Checked | TellStatement) for each in walk(*statements))


def returns(statements: Iterable[Statement]) -> bool:
    """Whether the function may return in these statements."""
    return any(isinstance(each, Return) for each in walk(*statements))


def goes_on(statements: Iterable[Statement]) -> bool:
    """Whether what stands after these statements may be reached."""
    return all(map(_goes_on, statements))


def _goes_on(statement: Statement) -> bool:
    if isinstance(statement, JUMPS):
        return False
    if isinstance(statement, If):
        return goes_on(statement.body) or goes_on(statement.orelse)
    if isinstance(statement, Labelled):
        return goes_on(statement.body) or leaves(statement.label, statement.body)
    if isinstance(statement, Forever):
        return leaves(statement.label, statement.body)
    if isinstance(statement, Try):
        way = goes_on((*statement.body, *statement.orelse))
        return way or any(goes_on(each.body) for each in statement.handlers)
    if isinstance(statement, Finally):
        return goes_on(statement.last) and goes_on(statement.body)
    return True


# What one statement reads and writes ------------------------------------------------------------------------


def own_values(statement: Statement) -> Iterator[Value]:
    """The values of a statement itself, without those of statements in it."""
    return (each for each in children(statement) if isinstance(each, Value))


def indices(place: Value) -> Iterator[Value]:
    """What is computed to find a place."""
    while isinstance(place, Member | Element):
        if isinstance(place, Element):
            yield place.index
        place = place.whole


def read_values(statement: Statement) -> Iterator[Value]:
    """What a statement itself computes with."""
    if isinstance(statement, Assign):
        yield from (statement.value, *indices(statement.place))
    elif isinstance(statement, Checked):
        yield from (statement.left, statement.right, *indices(statement.place))
    elif isinstance(statement, Choose):
        yield from (*statement.values, statement.index, *indices(statement.place))
    elif isinstance(statement, CallStatement):
        yield from statement.arguments
    elif not isinstance(statement, Try | Finally):
        yield from own_values(statement)


def written(statement: Statement) -> set[Value]:
    """The variables and fields that a statement, or one in it, writes itself; a function that is called may write any
    field."""
    return {root(place) for each in walk(statement) for place in _places(each)}


def _places(node: FormNode) -> Iterator[Value]:
    if isinstance(node, Assign | Checked | Choose | Address):
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
    """What each function and those that it calls do: the functions of the runtime that are called, the members of
    objects that are read, ASSIGNS, the numbers of texts that are told."""
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
    elif isinstance(node, TellStatement):
        yield node.number
    if any(isinstance(root(each), Field) for each in _places(node)):
        yield ASSIGNS


def reads_machine(value: Value) -> bool:
    """Whether a function that is called may change what this is."""
    return any(isinstance(each, Field | Object | ObjectOf | WholeMachine) for each in walk(value))
