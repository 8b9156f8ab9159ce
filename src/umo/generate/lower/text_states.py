"""Strings as states: an attribute to which only strings written in the code are assigned, and which is only compared,
becomes a number: an index among all strings of the machine."""

from __future__ import annotations

import ast

from umo.generate.c_types import BOOL, INT, TextType
from umo.generate.form import Literal, Operator, Value, negated
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Known, Term
from umo.generate.value_kinds import MOST_STATES


def is_text_state(term: Term) -> bool:
    """True if a term is a string that is chosen at run time."""
    return isinstance(term, Code) and isinstance(term.type, TextType)


def as_text(f: FunctionBuilder, term: Term, node: ast.AST) -> Code | None:
    """Return a term as a string literal, or as a choice between several string literals. Return None for other terms,
    and for texts that are made at run time."""
    if isinstance(term, Code):
        return term if isinstance(term.type, TextType) else None
    if not (isinstance(term, Known) and type(term.value) is str):
        return None
    of = f.world.memory.text_type(term.value)
    if len(of.kind) > MOST_STATES:
        raise f.refused(node, f"the machine has more than {MOST_STATES} texts", "members of an Enum")
    return Code(of, Literal(of.kind.index(term.value), of))


def compared_texts(f: FunctionBuilder, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code:
    """Return the condition that two strings are equal. At least one of them is chosen at run time."""
    one, other = as_text(f, left, node), as_text(f, right, node)
    if one is None or other is None or not isinstance(sign, ast.Eq | ast.NotEq):
        raise f.refused(
            node, "a string is compared with something other than a string, or by order", "==, with a string"
        )
    one = f.values.copied(one) if one.value == other.value else one
    test = Operator("==", one.value, other.value)
    return Code(BOOL, test if isinstance(sign, ast.Eq) else negated(test))


def truth_of_text(f: FunctionBuilder, code: Code) -> Value:
    """Return the truth of a string: False for the empty string."""
    empty = f.world.memory.text_type("").kind.index("")
    return Operator("!=", code.value, Literal(empty, INT))
