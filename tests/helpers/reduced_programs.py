"""Programs at random, played; one that is different in C is reduced to the fewest statements that still are."""

from __future__ import annotations

import ast
import copy
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from helpers.programs import inputs, made, program
from helpers.side_by_side import Played, played

TRIALS = 25
MOST_STEPS = 400
WRONG = ("different", "not compiled")


def play_texts(texts: Sequence[str], seeds: Sequence[int], trials: int = TRIALS) -> list[Played]:
    """Programs with the inputs of their seeds."""
    makers = [made(text, f"program_{seed}") for text, seed in zip(texts, seeds, strict=True)]
    modes = [sys.modules[f"program_{seed}"].Mode for seed in seeds]
    with tempfile.TemporaryDirectory() as folder:
        return played(makers, lambda n: inputs(seeds[n], trials, modes[n]), Path(folder))


def play(seeds: Sequence[int], trials: int = TRIALS) -> list[Played]:
    """The programs of these seeds."""
    return play_texts([program(seed) for seed in seeds], seeds, trials)


def reduced(seed: int, tell: Callable[[str], Any] = lambda _: None) -> tuple[str, Played]:
    """The body of the least program that has the same outcome as that of this seed, and how it has been played."""
    text = program(seed)
    (found,) = play_texts([text], [seed])
    tree, steps, goes_on = ast.parse(text), 0, found.outcome in WRONG
    while goes_on and steps < MOST_STEPS:
        goes_on = False
        for smaller in _smaller(tree):
            steps += 1
            try:
                (other,) = play_texts([ast.unparse(smaller)], [seed])
            except (SyntaxError, NameError, AttributeError):
                continue
            if other.outcome == found.outcome:
                tree, found, goes_on = smaller, other, True
                tell(_body(tree))
                break
            if steps >= MOST_STEPS:
                break
    return _body(tree), found


def _body(tree: ast.Module) -> str:
    return "\n".join(map(ast.unparse, _control(tree).body))


def _control(tree: ast.Module) -> ast.FunctionDef:
    return next(each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.name == "control")


def _smaller(tree: ast.Module) -> Iterator[ast.Module]:
    """Programs with a statement less, with the body of one in its place, or with a part of an expression for it."""
    count = sum(1 for _ in _blocks(_control(tree)))
    for block in range(count):
        length = len(list(_blocks(_control(tree)))[block])
        for place in range(length):
            for change in (_removed, _unwrapped):
                copied = copy.deepcopy(tree)
                if change(list(_blocks(_control(copied)))[block], place):
                    yield ast.fix_missing_locations(copied)
    expressions = sum(1 for _ in _expressions(_control(tree)))
    for number in range(expressions):
        for part in range(3):
            copied = copy.deepcopy(tree)
            owner, name, at = list(_expressions(_control(copied)))[number]
            if _simpler(owner, name, at, part):
                yield ast.fix_missing_locations(copied)


def _blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    for each in ast.walk(node):
        for name in ("body", "orelse", "finalbody"):
            found = getattr(each, name, None)
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


def _expressions(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    for each in ast.walk(node):
        for name, value in ast.iter_fields(each):
            if isinstance(value, ast.expr) and _has_parts(value):
                yield each, name, None
            elif isinstance(value, list):
                yield from (
                    (each, name, n) for n, one in enumerate(value) if isinstance(one, ast.expr) and _has_parts(one)
                )


def _has_parts(node: ast.expr) -> bool:
    loaded = not isinstance(getattr(node, "ctx", ast.Load()), ast.Store)
    return loaded and any(isinstance(each, ast.expr) for each in ast.iter_child_nodes(node))


def _simpler(owner: ast.AST, name: str, at: int | None, part: int) -> bool:
    value: Any = getattr(owner, name)
    node = value if at is None else value[at]
    parts = [each for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)]
    if part >= len(parts):
        return False
    if at is None:
        setattr(owner, name, parts[part])
    else:
        value[at] = parts[part]
    return True


def told(seed: int) -> str:
    """One line that plays it again, and the reduced program."""
    body, found = reduced(seed)
    line = f"python -m tools.programs replay {seed}"
    return f"{line}\n{found.outcome}: {found.difference or found.reasons}\n{body}"
