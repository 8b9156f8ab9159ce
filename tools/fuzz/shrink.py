"""A program that is wrong, reduced to the fewest statements that still are."""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from itertools import islice

from tools.fuzz.batches import SIZE, Batch, play
from tools.fuzz.program import Program
from tools.fuzz.verdict import Verdict

ROUNDS = 60
REDUCED = "control", "interlocks"
"""The functions that are reduced."""
SHOWN = "setup", *REDUCED


def shrunk(batch: Batch, tell: Callable[[str], object] = lambda _: None) -> tuple[Program, Verdict]:
    """The least program found of a batch of one, and its verdict."""
    (one,) = batch.programs
    (verdict,) = play(batch)
    if not verdict.is_wrong:
        return one, verdict
    found = one
    for _ in range(ROUNDS):
        smaller = _first_wrong(batch, found, verdict)
        if smaller is None:
            break
        found, verdict = smaller
        tell(body_of(found))
    return found, verdict


def _first_wrong(batch: Batch, one: Program, verdict: Verdict) -> tuple[Program, Verdict] | None:
    """The first of the smaller programs that is wrong in the same way; many are played at once."""
    smaller = (one.changed(text, number) for number, text in enumerate(_smaller(one.text), 1))
    while some := list(islice(smaller, SIZE)):
        for each, found in zip(some, play(batch.of(some)), strict=True):
            if found.outcome == verdict.outcome and _reason(found) == _reason(verdict):
                return each, found
    return None


def _reason(verdict: Verdict) -> str:
    """A refusal without what is refused."""
    return verdict.told.rpartition(": ")[2] if verdict.outcome.startswith("refused") else ""


def body_of(one: Program) -> str:
    """What is of this program alone: its control code and interlocks, and attributes of its own."""
    functions = {each.name: each for each in ast.walk(ast.parse(one.text)) if isinstance(each, ast.FunctionDef)}
    setup = ast.unparse(functions["setup"]).splitlines()
    control = "\n".join(ast.unparse(functions[name]) for name in REDUCED if name in functions)
    own = [line for line in setup[_COMMON:] if line.split("=")[0].strip() in control]
    return "\n".join([*own, control])


_COMMON = 12
"""Lines of `setup` that all programs have."""


# Smaller programs -------------------------------------------------------------------------------------------


def _smaller(text: str) -> Iterator[str]:
    tree = ast.parse(text)
    for name in REDUCED:
        if _function(tree, name) is not None:
            for each in _changed(tree, name):
                try:
                    made = ast.unparse(ast.fix_missing_locations(each))
                    compile(made, "", "exec")
                except (SyntaxError, ValueError):
                    continue
                yield made


def _function(tree: ast.Module, name: str) -> ast.FunctionDef | None:
    found = (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name == name)
    return next(found, None)


def _changed(tree: ast.Module, name: str) -> Iterator[ast.Module]:
    """With a statement less, with the body of one in its place, or with a part of an expression for it."""
    sizes = [len(block) for block in _blocks(tree, name)]
    for change in (_removed, _unwrapped):
        for number, size in enumerate(sizes):
            for place in range(size):
                copied = copy.deepcopy(tree)
                if change([*_blocks(copied, name)][number], place):
                    yield copied
    for number, _ in enumerate(_expressions(tree, name)):
        for part in range(3):
            copied = copy.deepcopy(tree)
            if _simpler(*[*_expressions(copied, name)][number], part):
                yield copied


def _blocks(tree: ast.Module, name: str) -> Iterator[list[ast.stmt]]:
    function = _function(tree, name)
    for each in ast.walk(function) if function is not None else ():
        for part in ("body", "orelse", "finalbody"):
            found = getattr(each, part, None)
            if isinstance(found, list) and found:
                yield found


def _removed(block: list[ast.stmt], place: int) -> bool:
    if len(block) == 1:
        if isinstance(block[0], ast.Pass):
            return False
        block[0] = ast.Pass()
    else:
        del block[place]
    return True


def _unwrapped(block: list[ast.stmt], place: int) -> bool:
    inner = getattr(block[place], "body", None)
    if not isinstance(inner, list):
        return False
    block[place : place + 1] = inner
    return True


def _expressions(tree: ast.Module, name: str) -> Iterator[tuple[ast.AST, str, int | None]]:
    function = _function(tree, name)
    assert function is not None
    for each in ast.walk(function):
        for field, value in ast.iter_fields(each):
            if isinstance(value, ast.expr) and _has_parts(value):
                yield each, field, None
            elif isinstance(value, list):
                yield from (
                    (each, field, n) for n, one in enumerate(value) if isinstance(one, ast.expr) and _has_parts(one)
                )


def _has_parts(node: ast.expr) -> bool:
    loaded = not isinstance(getattr(node, "ctx", ast.Load()), ast.Store)
    return loaded and any(isinstance(each, ast.expr) for each in ast.iter_child_nodes(node))


def _simpler(owner: ast.AST, field: str, at: int | None, part: int) -> bool:
    value = getattr(owner, field)
    node = value if at is None else value[at]
    parts = [each for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)]
    if part >= len(parts):
        return False
    if at is None:
        setattr(owner, field, parts[part])
    else:
        value[at] = parts[part]
    return True
