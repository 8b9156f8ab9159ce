"""The passes over the intermediate form: what may be computed later, where a variable begins, what has no effect."""

from __future__ import annotations

import pytest

from umo.generate.c_types import BOOL, INT, NOTHING, REAL, CType
from umo.generate.check.form_effects import changes, goes_on
from umo.generate.check.forwarding import forwarded
from umo.generate.check.scopes import scoped
from umo.generate.check.shape import shaped
from umo.generate.emit.function_text import function_text
from umo.generate.form import (
    ONE,
    TRUE,
    ZERO,
    Assign,
    Begin,
    CallStatement,
    CountedLoop,
    Fail,
    Field,
    FunctionForm,
    If,
    Labelled,
    Leave,
    Literal,
    Local,
    MachineForm,
    Operator,
    Return,
    Runtime,
    Statement,
    Temporary,
    Try,
    Unary,
    Value,
    WholeMachine,
    negated,
)
from umo.generate.translation import ControllerTarget

T, U, X, GAIN, OTHER = Temporary("t"), Temporary("u"), Local("v_x"), Field("part", "gain"), Field("part", "other")
CALL = CallStatement("py_f", (WholeMachine(),))
HOST = ControllerTarget("host")


def function(*body: Statement, **types: CType) -> FunctionForm:
    return FunctionForm("f", "f", "file.py", 1, (), tuple(types.items()), NOTHING, body)


def printed(value: Value) -> str:
    text = function_text(function(Assign(X, value), v_x=REAL), MachineForm(), HOST)
    return text.partition("v_x = ")[2].partition("v_x = ")[2].partition(";")[0]


@pytest.mark.parametrize(
    ("between", "moves"),
    [
        (Assign(OTHER, ONE), True),
        (Assign(GAIN, ONE), False),
        (CALL, False),
        (If(TRUE, (Assign(GAIN, ONE),)), False),
        (If(TRUE, (Fail(32),)), True),
    ],
)
def test_a_value_is_computed_later_unless_something_between_changes_it(between: Statement, moves: bool) -> None:
    body = (Assign(T, GAIN), between, Assign(X, Operator("+", T, ONE)))
    later = between, Assign(X, Operator("+", GAIN, ONE))
    assert forwarded(function(*body)).body == (later if moves else body)


def test_what_is_read_twice_or_in_a_loop_keeps_its_name() -> None:
    twice = function(Assign(T, GAIN), Assign(X, Operator("+", T, T)))
    loop = function(Assign(T, GAIN), CountedLoop("l", U, ZERO, Literal(3, INT), 1, (Assign(OTHER, T),)))
    assert forwarded(twice) == twice
    assert forwarded(loop) == loop


def test_a_comparison_with_itself_or_a_constant_keeps_the_name() -> None:
    itself = function(Assign(T, X), Assign(OTHER, Operator("<", T, X)))
    constant = function(Assign(T, Operator("<", X, GAIN)), Assign(OTHER, Operator("==", T, ONE)))
    assert forwarded(itself) == itself
    assert forwarded(constant) == constant


def test_a_variable_begins_in_the_innermost_body_that_has_all_its_uses() -> None:
    inside = If(TRUE, (Assign(T, GAIN), Assign(OTHER, T), Assign(GAIN, T)))
    assert scoped(function(inside, t=REAL)).body == (
        If(TRUE, (Begin(T, REAL, GAIN), Assign(OTHER, T), Assign(GAIN, T))),
    )
    after = If(TRUE, (Assign(T, GAIN),)), Assign(OTHER, T)
    assert scoped(function(*after, t=REAL)).body == (Begin(T, REAL, None), *after)


def test_a_variable_that_a_turn_reads_before_it_sets_it_begins_before_the_loop() -> None:
    loop = CountedLoop("l", U, ZERO, Literal(3, INT), 1, (Assign(GAIN, T), Assign(T, ONE)))
    found = scoped(function(loop, t=REAL, u=INT)).body
    assert found[0] == Begin(T, REAL, None)
    assert isinstance(found[1], CountedLoop) and found[1].of == INT and found[1].body == loop.body


def test_what_nothing_reads_is_left_out_with_what_is_computed_for_it() -> None:
    body = Assign(T, GAIN), If(T, (Assign(X, T),)), Assign(X, Operator("+", X, ONE)), Assign(GAIN, ONE)
    program = shaped(MachineForm(functions=[function(*body, Return(), t=BOOL, v_x=REAL)]), ["f"])
    assert program.functions[0].body == (Assign(GAIN, ONE), Return())


def test_a_call_changes_what_was_seen_and_a_temporary_does_not() -> None:
    assert changes(CALL) and changes(Assign(GAIN, ONE)) and changes(If(TRUE, (Assign(X, ONE),)))
    assert not changes(Assign(T, GAIN)) and not changes(If(TRUE, (Fail(32),)))


def test_what_a_label_is_left_to_goes_on() -> None:
    assert goes_on([Labelled("l", (If(TRUE, (Leave("l"),)), Return()))])
    assert not goes_on([Labelled("l", (Return(),))])
    assert not goes_on([Try(T, (Fail(32),), (), ())])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Operator("-", X, Operator("-", GAIN, OTHER)), "v_x - (m->part.gain - m->part.other)"),
        (Operator("-", Operator("-", X, GAIN), OTHER), "v_x - m->part.gain - m->part.other"),
        (Operator("*", Operator("+", X, GAIN), OTHER), "(v_x + m->part.gain) * m->part.other"),
        (Operator("||", Operator("&&", T, U), T), "(t && u) || t"),
        (Operator("&", Operator("<<", X, ONE), U), "(v_x << 1) & u"),
        (Operator("==", negated(T), U), "(!t) == u"),
        (Unary("-", Literal(-1.5, REAL)), "-(-1.5)"),
        (negated(Operator("<", X, GAIN)), "!(v_x < m->part.gain)"),
        (Operator("<", Runtime("umo_fabs", (X,)), Literal(2.0, REAL)), "umo_fabs(v_x) < 2.0"),
    ],
)
def test_values_have_the_parentheses_that_they_need(value: Value, text: str) -> None:
    assert printed(value) == text
