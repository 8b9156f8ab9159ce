"""Prints values of the form as C, with the parentheses that C needs and those that compilers recommend."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from umo.generate.c_types import BOOL, MASK, REAL, StateType
from umo.generate.emit.c_text import real, truth
from umo.generate.form import (
    Address,
    Conditional,
    Conversion,
    Element,
    Elements,
    Field,
    Literal,
    Local,
    Member,
    NoneValue,
    Null,
    Object,
    ObjectOf,
    OfObject,
    Operator,
    OptionalValue,
    Reals,
    Runtime,
    SlotTable,
    Temporary,
    TupleOf,
    Unary,
    Value,
    WholeMachine,
)
from umo.generate.names import member_name
from umo.generate.translation import ControllerTarget

RANKS = {"*": 6, "/": 6, "+": 5, "-": 5, "<": 4, "<=": 4, ">": 4, ">=": 4, "==": 4, "!=": 4, "&&": 3, "||": 2}
"""The precedence of operators. Other operators stand in parentheses, and so do their operands."""
LEAST_INT = -(2**31)


class FormValues:
    """Prints values for one target."""

    def __init__(self, target: ControllerTarget) -> None:
        self._target = target

    def text(self, value: Value) -> str:
        return PRINTED[type(value)](self, value)

    def texts(self, values: tuple[Value, ...]) -> str:
        return ", ".join(map(self.text, values))

    def literal(self, value: Literal) -> str:
        if value.of == REAL:
            return real(value.value, self._target)
        if value.of == BOOL:
            return truth(value.value)
        if value.of == MASK:
            return f"{value.value}u"
        return "INT32_MIN" if value.value == LEAST_INT else str(value.value)

    def unary(self, value: Unary) -> str:
        operand = self._tight(value.operand)
        return f"{value.sign}({operand})" if operand.startswith(value.sign) else f"{value.sign}{operand}"

    def binary(self, value: Operator) -> str:
        left = self._operand(value.left, value.sign, True)
        return f"{left} {value.sign} {self._operand(value.right, value.sign, False)}"

    def conditional(self, value: Conditional) -> str:
        test = self._tight(value.test)
        one, other = (
            f"({self.text(each)})" if isinstance(each, Conditional) else self.text(each)
            for each in (value.one, value.other)
        )
        text = f"{test} ? {one} : {other}"
        if isinstance(value.one, Literal) and isinstance(value.one.of, StateType):
            # gcc makes a shift of `x < 0 ? 1 : 0`, and warns that its int becomes a state
            return f"({value.one.of.name})({text})"
        return text

    def _tight(self, value: Value) -> str:
        """Return the text in parentheses where operators around it could bind more tightly."""
        text = self.text(value)
        return f"({text})" if isinstance(value, Operator | Conditional) else text

    def _operand(self, value: Value, sign: str, is_left: bool) -> str:
        if isinstance(value, Unary) and value.sign == "!" and sign not in ("&&", "||"):
            return f"({self.text(value)})"
        if not isinstance(value, Operator):
            return self._tight(value)
        own, around = RANKS.get(value.sign, 0), RANKS.get(sign, 0)
        if not own or not around:
            return self._tight(value)
        is_chain = is_left and own == around and (own > 4 or value.sign == sign in ("&&", "||"))
        is_tighter = own > around and not (value.sign == "&&" and sign == "||")
        return self.text(value) if is_chain or is_tighter else self._tight(value)

    def object(self, value: Value) -> str:
        """Return an atomic object itself, not its address."""
        if isinstance(value, ObjectOf):
            return f"m->objects[{value.table}[{self.text(value.index)}]]"
        assert isinstance(value, Object)
        return f"m->objects[{value.slot}]"

    def reals(self, value: Reals) -> str:
        return f"(umo_real[]){{{self.texts(value.parts) or '0'}}}"


PRINTED: dict[type[Value], Callable[[FormValues, Any], str]] = {
    Literal: FormValues.literal,
    Local: lambda _, value: value.name,
    Temporary: lambda _, value: value.name,
    Field: lambda _, value: f"m->{value.struct}.{member_name(value.name)}",
    Member: lambda c, value: f"{c.text(value.whole)}.{member_name(value.name)}",
    Element: lambda c, value: f"{c.text(value.whole)}.at[{c.text(value.index)}]",
    Elements: lambda c, value: f"{c.text(value.array)}.at",
    Unary: FormValues.unary,
    Operator: FormValues.binary,
    Conditional: FormValues.conditional,
    Runtime: lambda c, value: f"{value.name}({c.texts(value.arguments)})",
    Conversion: lambda c, value: f"({value.of.name}){c._tight(value.operand)}",
    TupleOf: lambda c, value: f"({value.of.name}){{{c.texts(value.parts)}}}",
    NoneValue: lambda _, value: f"({value.of.name}){{.has = false}}",
    OptionalValue: lambda c, value: f"({value.of.name}){{true, {c.text(value.value)}}}",
    WholeMachine: lambda _, value: "m",
    Object: lambda c, value: f"&{c.object(value)}",
    ObjectOf: lambda c, value: f"&{c.object(value)}",
    OfObject: lambda c, value: f"{c.object(value.object)}.{value.name}",
    SlotTable: lambda _, value: value.name,
    Address: lambda c, value: f"&{c.text(value.place)}",
    Null: lambda _, value: "NULL",
    Reals: FormValues.reals,
}
"""The printer of each kind of value."""
