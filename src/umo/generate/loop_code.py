"""Loops: counted ones, those over arrays, and those over objects, whose turns are written out."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from umo.generate.assignment_code import AssignmentCode
from umo.generate.c_types import INT, ArrayType
from umo.generate.expression_code import of_element
from umo.generate.terms import Code, Elements, Known, Many, Term

MOST_UNROLLED = 256
"""Turns of a loop over objects, each written out."""


class LoopCode(AssignmentCode):
    """The part of a function that is loops."""

    def body(self, statements: Sequence[ast.stmt]) -> bool:
        raise NotImplementedError

    def _While(self, node: ast.While) -> None:
        if node.orelse:
            raise self.refused(node, "`else` of a loop", "a flag")
        self._forget(node.body)
        with self.block("for (;;)"):
            truth = self.truth(self.term(node.test), node.test)
            if truth is False:
                self.line("break;", pure=True)
            elif truth is not True:
                self.line(f"if (!({truth}))", pure=True)
                self.line("    break;", pure=True)
            self._turn(node.body, "", "")

    def _turn(self, statements: Sequence[ast.stmt], on: str, out: str) -> None:
        before = dict(self.names)
        self.loops.append((on, out, len(self.handlers)))
        self.body(statements)
        self.loops.pop()
        if not on:
            self._end_turn(before, statements[0])

    def _end_turn(self, before: dict[str, Any], node: ast.AST) -> None:
        """A name that stands for an object does so in each turn, and after a loop of no turn."""
        new = {name: each for name, each in self.names.items() if before.get(name) != each}
        for name, each in new.items():
            if isinstance(each, Known) and name in before:
                raise self.refused(node, f"{name!r} stands for another object in the next turn", "a name for each")
            if isinstance(each, Known):
                del self.names[name]

    def _meet(self, label: str) -> None:
        """The ways that come here: what a name stands for on all of them."""
        for names in self.left.pop(label, []):
            self.names = {name: each for name, each in self.names.items() if names.get(name) == each}

    def _forget(self, statements: Sequence[ast.stmt]) -> None:
        """What is assigned in a loop is not known to be there at its beginning."""
        self.known.clear()

    def _For(self, node: ast.For) -> None:
        if node.orelse:
            raise self.refused(node, "`else` of a loop", "a flag")
        if self._is_range(node.iter):
            self._count(node)
            return
        term = self.term(node.iter)
        if isinstance(term, Code) and isinstance(term.type, ArrayType):
            self._each(node, self.kept(term) if isinstance(term, Elements) else term)
            return
        self._unroll(node, self.elements(term, node.iter))

    def _is_range(self, node: ast.AST) -> bool:
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"):
            return False
        return self.source.meaning("range") is range

    def _count(self, node: ast.For) -> None:
        assert isinstance(node.iter, ast.Call)
        terms = self.ordered(node.iter.args)
        if all(isinstance(each, Known) for each in terms) and isinstance(node.target, ast.Name):
            numbers = range(*(each.value for each in terms))  # type: ignore[union-attr]
            if len(numbers) <= MOST_UNROLLED and _indexes_objects(node):
                self._unroll(node, [Known(each) for each in numbers])
                return
        first, last, step = (Known(0), *terms, Known(1)) if len(terms) == 1 else (*terms, Known(1))[:3]
        if not (isinstance(step, Known) and step.value):
            raise self.refused(node, "the step of a range is not known")
        turn = self.temporary(INT, "i")
        end = self.kept(Code(INT, self.as_type(last, INT, node)), "end").text
        self._forget(node.body)
        sign = "<" if step.value > 0 else ">"
        head = f"for ({turn} = {self.as_type(first, INT, node)}; {turn} {sign} {end}; {turn} += {step.value})"
        with self.block(head):
            self.store(node.target, Code(INT, turn), node)
            self._turn(node.body, "", "")

    def _each(self, node: ast.For, values: Code) -> None:
        assert isinstance(values.type, ArrayType)
        self.check_length(values.type, node)
        turn = self.temporary(INT, "i")
        self._forget(node.body)
        with self.block(f"for ({turn} = 0; {turn} < {values.type.length}; {turn}++)"):
            self.store(node.target, Code(of_element(values.type), f"{values.text}.at[{turn}]"), node)
            self._turn(node.body, "", "")

    def _unroll(self, node: ast.For, elements: list[Term]) -> None:
        """A loop over objects: each turn is written out."""
        if len(elements) > MOST_UNROLLED:
            raise self.refused(
                node, f"a loop of {len(elements)} turns over objects", f"at most {MOST_UNROLLED}, or a Vector"
            )
        out = self.label("done")
        at = len(self.lines)
        for each in elements:
            on = self.label("next")
            with self.bound_to(node.target, each):
                self._turn(node.body, on, out)
            if any(f"goto {on};" in line for line in self.lines[at:]):
                self.line(f"{on}:;", pure=True)
            self._meet(on)
        if any(f"goto {out};" in line for line in self.lines[at:]):
            self.line(f"{out}:;", pure=True)
        self._meet(out)

    def elements(self, term: Term, node: ast.AST) -> list[Term]:
        if isinstance(term, Many) or (isinstance(term, Code) and isinstance(term.type, ArrayType)):
            return self.parts(term, node)
        if isinstance(term, Known):
            with suppress(TypeError):
                return [Known(each) for each in term.value]
        raise self.refused(
            node, "what it goes through is not known when the code is generated", "a list of parts, range"
        )

    @contextmanager
    def bound_to(self, target: ast.AST, term: Term) -> Iterator[None]:
        """The name of a loop stands for one object."""
        if isinstance(target, ast.Name) and isinstance(term, Known) and self.type_of(term) is None:
            self.names[target.id] = term
        elif isinstance(target, ast.Tuple):
            for each, part in zip(target.elts, self.parts(term, target), strict=True):
                if isinstance(each, ast.Name) and isinstance(part, Known):
                    self.names[each.id] = part
                elif isinstance(each, ast.Tuple):
                    with self.bound_to(each, part):
                        continue
                else:
                    self.store(each, part, target)
        elif isinstance(target, ast.Name) and isinstance(term, Known):
            self.names[target.id] = term
        else:
            self.store(target, term, target)
        yield

    def _Break(self, node: ast.Break) -> bool:
        return self._leave(node, 1, "break;")

    def _Continue(self, node: ast.Continue) -> bool:
        return self._leave(node, 0, "continue;")

    def _leave(self, node: ast.AST, which: int, plain: str) -> bool:
        loop = self.loops[-1]
        if len(self.handlers) > loop[2]:
            raise self.refused(node, "it leaves a `try`", "a flag")
        label = loop[which]
        if isinstance(label, str) and label:
            self.left.setdefault(label, []).append(dict(self.names))
        self.line(f"goto {label};" if label else plain, pure=True)
        return False


def _indexes_objects(node: ast.For) -> bool:
    """Whether the number of a loop is a place in a list: of objects, perhaps, so that each turn is written out."""
    assert isinstance(node.target, ast.Name)
    name = node.target.id
    indexed = [each.slice for part in node.body for each in ast.walk(part) if isinstance(each, ast.Subscript)]
    return any(isinstance(each, ast.Name) and each.id == name for index in indexed for each in ast.walk(index))
