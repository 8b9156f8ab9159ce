"""A program that is wrong, reduced to the least that is wrong in the same way.

Statements are left out, halves first; then compound ones become their bodies, and expressions a part of them, or a
constant, whose values had the same classes in Python. So what is left is a program of the same kind.
"""

from __future__ import annotations

import ast
import copy
import logging
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

from tools.fuzz.batches import SIZE, Batch, play
from tools.fuzz.machine import Side
from tools.fuzz.program import Program
from tools.fuzz.stimuli import stimuli, ticks
from tools.fuzz.target import PERIODS
from tools.fuzz.verdict import Verdict

ROUNDS = 60
REDUCED = "control", "interlocks"
"""The functions that are reduced."""
CONSTANTS = {"float": ("1.0", "0.0"), "int": ("1", "0"), "bool": ("True",)}
PARTS = 4
"""Parts of an expression that are tried for it."""
BLOCKS = "body", "orelse", "finalbody"
WHOLE = ast.Starred | ast.Slice | ast.JoinedStr | ast.FormattedValue
"""Expressions that are no values."""
SEEN = "_seen_"

Found = tuple[Program, Verdict]
Edits = Mapping[int, Any]
"""What stands in the place of nodes, by their numbers: statements, an expression, None for nothing."""


def shrunk(batch: Batch, tell: Callable[[str], object] = lambda _: None) -> tuple[Program, Verdict]:
    """The least program found of a batch of one, and its verdict."""
    (one,) = batch.programs
    (verdict,) = play(batch)
    for _ in range(ROUNDS if verdict.is_wrong else 0):
        tries = (_first(batch, one, way(one), verdict.kind) for way in (_without, _unwrapped, _simpler))
        smaller = next(filter(None, tries), None)
        if smaller is None:
            break
        one, verdict = smaller
        tell(body_of(one))
    return one, verdict


def body_of(one: Program) -> str:
    """What is of this program alone: its control code and interlocks, and attributes of its own."""
    functions = {each.name: each for each in ast.walk(ast.parse(one.text)) if isinstance(each, ast.FunctionDef)}
    setup = ast.unparse(functions["setup"]).splitlines()
    control = "\n".join(ast.unparse(functions[name]) for name in REDUCED if name in functions)
    own = [line for line in setup[_COMMON:] if line.split("=")[0].strip() in control]
    return "\n".join([*own, control])


_COMMON = 12
"""Lines of `setup` that all programs have."""


# Which edits are tried ----------------------------------------------------------------------------------------


def _first(batch: Batch, one: Program, edits: Iterator[Edits], kind: str) -> Found | None:
    """The program with the first edits that leave it wrong in this way, or with all of those that were played at once
    with them and do so, too."""
    while some := [*islice(edits, SIZE)]:
        if wrong := _wrong(batch, one, some, kind):
            all_of_them = {number: new for each, _ in reversed(wrong) for number, new in each.items()}
            together = _wrong(batch, one, [all_of_them], kind) if len(wrong) > 1 else []
            return (together or wrong)[0][1]
    return None


def _wrong(batch: Batch, one: Program, some: Sequence[Edits], kind: str) -> list[tuple[Edits, Found]]:
    """Those of these edits that leave a program wrong in this way."""
    tree = numbered(one.text)
    texts = [(each, text) for each in some if (text := _edited(tree, each)) is not None]
    made = [one.changed(text, number) for number, (_, text) in enumerate(texts, 1)]
    verdicts = play(batch.of(made)) if made else []
    found = zip([each for each, _ in texts], made, verdicts, strict=True)
    return [(each, (program, verdict)) for each, program, verdict in found if verdict.kind == kind]


def _without(one: Program) -> Iterator[Edits]:
    """Statements are left out: all, a half of them, a quarter, and so on."""
    nodes = sorted(_nodes(numbered(one.text), ast.stmt), key=lambda each: each.lineno)
    numbers = [each.number for each in nodes if not isinstance(each, ast.Pass)]
    size = len(numbers)
    while size:
        yield from (dict.fromkeys(numbers[at : at + size]) for at in range(0, len(numbers), size))
        size //= 2


def _unwrapped(one: Program) -> Iterator[Edits]:
    """Compound statements become their bodies."""
    for each in _nodes(numbered(one.text), ast.stmt):
        yield from ({each.number: block} for name in BLOCKS if (block := getattr(each, name, None)))


def _simpler(one: Program) -> Iterator[Edits]:
    """Expressions become constants, or parts of them, of the same classes."""
    tree = numbered(one.text)
    classes = classes_of(one.seed, tree)
    for each in filter(_is_value, _nodes(tree, ast.expr)):
        own = classes[each.number]
        if isinstance(each, ast.Constant) or not own:
            continue
        for text in CONSTANTS.get("".join(own), ()):
            yield {each.number: ast.parse(text, mode="eval").body}
        inner = (part for part in ast.walk(each) if part is not each and _is_value(part))
        same = (part for part in inner if classes[part.number] == own)  # type: ignore[attr-defined]
        yield from ({each.number: part} for part in islice(same, PARTS))


# Trees --------------------------------------------------------------------------------------------------------


SHARED = (ast.expr_context, ast.boolop, ast.operator, ast.unaryop, ast.cmpop)
"""Nodes of which Python has one object for all trees."""


def numbered(text: str) -> ast.Module:
    """The tree of a program, each of whose nodes that may be edited has a number."""
    tree = ast.parse(text)
    functions = [each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name in REDUCED]
    nodes = (each for function in functions for part in function.body for each in ast.walk(part))
    for number, each in enumerate(each for each in nodes if not isinstance(each, SHARED)):
        each.number = number  # type: ignore[attr-defined]
    return tree


def _nodes(tree: ast.Module, kind: type[ast.AST]) -> Iterator[Any]:
    return (each for each in ast.walk(tree) if isinstance(each, kind) and hasattr(each, "number"))


def _is_value(node: ast.AST) -> bool:
    is_value = isinstance(node, ast.expr) and not isinstance(node, WHOLE)
    return is_value and isinstance(getattr(node, "ctx", ast.Load()), ast.Load)


class _Edited(ast.NodeTransformer):
    def __init__(self, edits: Edits) -> None:
        self._edits = edits

    def visit(self, node: ast.AST) -> Any:
        number = getattr(node, "number", None)
        return self._edits[number] if number in self._edits else self.generic_visit(node)


def _edited(tree: ast.Module, edits: Edits) -> str | None:
    """The text of the program; None: it is none."""
    new = _Edited(copy.deepcopy(dict(edits))).visit(copy.deepcopy(tree))
    for each in ast.walk(new):
        if getattr(each, "body", None) == []:
            each.body.append(ast.Pass())
        if isinstance(each, ast.ClassDef):
            each.body = [one for one in each.body if not _does_nothing(one)]
    try:
        text = ast.unparse(ast.fix_missing_locations(new))
        compile(text, "", "exec")
    except (SyntaxError, ValueError):
        return None
    return text


def _does_nothing(node: ast.stmt) -> bool:
    """Whether these are interlocks of which none is left."""
    is_one = isinstance(node, ast.FunctionDef) and node.name == "interlocks"
    return is_one and not any(isinstance(each, ast.Yield) for each in ast.walk(node))


# Classes of values ----------------------------------------------------------------------------------------------


class _Told(ast.NodeTransformer):
    """Each expression tells its value."""

    def visit(self, node: ast.AST) -> Any:
        if isinstance(node, ast.pattern):
            return node
        new = self.generic_visit(node)
        if not (hasattr(node, "number") and _is_value(node)):
            return new
        return ast.Call(ast.Name(SEEN, ast.Load()), [ast.Constant(node.number), new], [])


def classes_of(seed: int, tree: ast.Module) -> Mapping[int, set[str]]:
    """The classes of the values that each expression has in Python, by its number."""
    found: dict[int, set[str]] = defaultdict(set)

    def seen(number: int, value: Any) -> Any:
        found[number].add(type(value).__name__)
        return value

    text = ast.unparse(ast.fix_missing_locations(_Told().visit(copy.deepcopy(tree))))
    module = Program(seed, text).loaded({SEEN: seen})
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings(), Side([module], ticks(PERIODS)) as python:
        warnings.simplefilter("ignore")
        for given in stimuli(seed, PERIODS, module):
            if python.in_fault(0):
                python.clear(0)
            for name, value in given.sets.items():
                python.set(0, name, value)
            python.give([given])
            python.step()
    logging.disable(logging.NOTSET)
    return found
