"""Places the declaration of each variable at its first use, in the innermost body that contains all its uses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from umo.generate.c_types import CType
from umo.generate.check.form_effects import own_values, read_values
from umo.generate.form import (
    Assign,
    Begin,
    CallStatement,
    Choose,
    CountedLoop,
    EndlessLoop,
    FormNode,
    FunctionForm,
    Local,
    Statement,
    Statements,
    Temporary,
    bodies,
    walk,
    with_bodies,
)

Types = Mapping[str, CType]


def scoped(function: FunctionForm) -> FunctionForm:
    """Return the function with each variable declared at its first use."""
    body = _body(function.body, dict(function.variables))
    count = Counter(each for each in walk(*body) if isinstance(each, Temporary))
    return replace(function, variables=(), body=_without_copies(body, count))


def _names(*nodes: FormNode) -> set[str]:
    return {each.name for node in nodes for each in node.mentioned}


def _body(body: Statements, types: Types) -> Statements:
    """`types`: types of the variables that are used in this body only."""
    used = [_names(each) for each in body]
    begun: set[str] = set()
    found: list[Statement] = []
    for place, each in enumerate(body):
        new = {name: of for name, of in types.items() if name in used[place] and name not in begun}
        begun |= new.keys()
        later = set[str]().union(*used[place + 1 :])
        own, within = _names(*own_values(each)), [(one, _names(*one)) for one in bodies(each)]
        alone = {name: of for name, of in new.items() if name not in later and name not in own}
        inner = {name: of for name, of in alone.items() if _is_of_one_body(name, each, within)}
        here = {name: of for name, of in new.items() if name not in inner}
        each = with_bodies(each, lambda one, inner=inner: _body(one, _of(inner, one)))  # type: ignore[misc]
        found += _begin(each, here, later)
    return tuple(found)


def _without_copies(body: Statements, count: Counter[Temporary]) -> Statements:
    """Store the result of a call directly in the variable that would begin with a copy of it."""
    found: list[Statement] = []
    for each in (with_bodies(one, lambda inner: _without_copies(inner, count)) for one in body):
        if isinstance(each, Begin) and len(found) > 1:
            begin, call = found[-2:]
            if isinstance(begin, Begin) and isinstance(call, CallStatement) and _is_given(each, begin, call, count):
                found[-2:] = [replace(begin, place=each.place), replace(call, out=each.place)]
                continue
        found.append(each)
    return tuple(found)


def _is_given(copy: Begin, begin: Begin, call: CallStatement, count: Counter[Temporary]) -> bool:
    """True if a temporary is declared, filled by a call, copied once, and not used otherwise."""
    temporary = begin.place
    if not isinstance(temporary, Temporary) or begin.value is not None or count[temporary] != 3:
        return False
    return call.out == temporary and copy.value == temporary and copy.of == begin.of


def _of(types: Types, body: Statements) -> Types:
    names = _names(*body)
    return {name: of for name, of in types.items() if name in names}


def _is_of_one_body(name: str, statement: Statement, within: Sequence[tuple[Statements, set[str]]]) -> bool:
    """True if a variable is used in one body of a statement only. In a loop it then has a new value in each turn.
    `within`: the bodies, with the names used in each."""
    users = [body for body, names in within if name in names]
    if len(users) != 1:
        return False
    return not isinstance(statement, EndlessLoop | CountedLoop) or _is_set_first(name, users[0])


def _is_set_first(name: str, body: Statements) -> bool:
    first = next(each for each in body if name in _names(each))
    place = first.place if isinstance(first, Assign | Choose) else None
    place = first.out if isinstance(first, CallStatement) else place
    is_set = isinstance(place, Local | Temporary) and place.name == name
    return is_set and name not in _names(*read_values(first))


def _begin(statement: Statement, types: Types, later: set[str]) -> list[Statement]:
    """Return a statement with the declarations of these variables before it or in it."""
    before: list[Statement] = []
    for name, of in types.items():
        if isinstance(statement, CountedLoop) and _is_turn(statement, name) and name not in later:
            statement = replace(statement, of=of)
        elif isinstance(statement, Assign) and _is_set_first(name, (statement,)):
            return [Begin(statement.place, of, statement.value, line=statement.line)]
        else:
            before.append(Begin(_variable(statement, name), of, None, line=statement.line))
    return [*before, statement]


def _is_turn(loop: CountedLoop, name: str) -> bool:
    return isinstance(loop.turn, Temporary) and loop.turn.name == name and name not in _names(loop.first, loop.end)


def _variable(statement: Statement, name: str) -> Local | Temporary:
    found = (each for each in walk(statement) if isinstance(each, Local | Temporary) and each.name == name)
    return next(found)
