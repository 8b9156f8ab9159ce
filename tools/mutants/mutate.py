"""The changes of a source file that are tried, one at a time."""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
CALCULATED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr, ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}  # fmt: skip
Change = tuple[str, ast.AST, str]
"""Kind, node, and the text in its place."""
Placed = tuple[str, int, Change]
"""A change with the function and the first line of the statement in which it is."""


@dataclass(frozen=True)
class Mutation:
    """One change. `key` is the same in another version of the file, as long as line and function are."""

    file: str
    line: int
    statement: int
    """The first line of the statement: coverage may know that one only."""
    kind: str
    key: str
    begin: tuple[int, int]
    end: tuple[int, int]
    text: str

    def applied(self, source: str) -> str:
        lines = [line.encode() for line in source.splitlines(keepends=True)]
        before = b"".join(lines[: self.begin[0] - 1]) + lines[self.begin[0] - 1][: self.begin[1]]
        after = lines[self.end[0] - 1][self.end[1] :] + b"".join(lines[self.end[0] :])
        return (before + self.text.encode() + after).decode()


def mutations(root: Path, file: str) -> list[Mutation]:
    """Every change of a file, in the order of its lines. Functions alone are changed: what stands outside of them runs
    when the module is imported, and no test is known to reach it."""
    source = (root / file).read_text("utf-8")
    lines, seen = source.splitlines(), Counter[str]()
    found = []
    for where, statement, (kind, node, text) in _changes(ast.parse(source), ""):
        assert isinstance(node, ast.stmt | ast.expr)
        assert node.end_lineno is not None and node.end_col_offset is not None
        name = f"{file} {where} {kind} {lines[node.lineno - 1].strip()}"
        seen[name] += 1
        begin, end = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
        found.append(Mutation(file, node.lineno, statement, kind, f"{name} #{seen[name]}", begin, end, text))
    return found


def _changes(node: ast.AST, where: str) -> Iterator[Placed]:
    """The changes in a node and below."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = f"{where}.{child.name}".lstrip(".")
            for statement in child.body:
                if isinstance(child, ast.ClassDef):
                    yield from _changes(ast.Module([statement], []), inner)
                else:
                    yield from ((inner, line, change) for line, change in _in_statement(statement, statement.lineno))
        elif not isinstance(child, ast.expr):
            yield from _changes(child, where)


def _in_statement(node: ast.AST, line: int) -> Iterator[tuple[int, Change]]:
    """The changes within a function, with the lines of their statements. Annotations and strings stay."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return
    line = node.lineno if isinstance(node, ast.stmt) else line
    yield from ((line, change) for change in _of(node))
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list", "args" if isinstance(node, ast.FunctionDef) else ""):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _in_statement(child, line)


def _of(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                new = copy.deepcopy(node)
                new.ops[place] = COMPARED[type(operator)]()
                yield "comparison", node, f"({ast.unparse(new)})"
        case ast.BinOp() if type(node.op) in CALCULATED:
            new = copy.deepcopy(node)
            new.op = CALCULATED[type(node.op)]()
            yield "arithmetic", node, f"({ast.unparse(new)})"
        case ast.AugAssign() if type(node.op) in CALCULATED:
            new = copy.deepcopy(node)
            new.op = CALCULATED[type(node.op)]()
            yield "arithmetic", node, ast.unparse(new)
            yield "deleted", node, "pass"
        case ast.BoolOp():
            new = copy.deepcopy(node)
            new.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield "and, or", node, f"({ast.unparse(new)})"
        case ast.UnaryOp(op=ast.Not()):
            yield "not", node, f"({ast.unparse(node.operand)})"
        case ast.Constant(value=bool()):
            yield "constant", node, str(not node.value)
        case ast.Constant(value=int() | float()):
            yield "constant", node, f"({node.value + 1!r})"
            yield "constant", node, f"({node.value - 1!r})"
        case ast.If() | ast.While() | ast.IfExp():
            yield "condition", node.test, f"(not ({ast.unparse(node.test)}))"
        case ast.Return(value=ast.expr()):
            yield "return", node, "return None"
        case ast.Expr() | ast.Raise() | ast.Delete() | ast.Break() | ast.Continue():
            yield "deleted", node, "pass"
        case ast.Assign() if not any(isinstance(target, ast.Name | ast.Tuple) for target in node.targets):
            yield "deleted", node, "pass"
