"""Loops: counted ones, those over arrays, and those over objects, whose turns are written out."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from umo.generate.assignment_code import AssignmentCode
from umo.generate.c_types import INT, LONG, ArrayType
from umo.generate.expression_code import of_element
from umo.generate.function_scope import Way
from umo.generate.terms import Code, Elements, Known, Many, Term
from umo.generate.value_kinds import is_container

MOST_UNROLLED = 256
"""Turns of a loop over objects, each written out."""


class Left(NamedTuple):
    """Where `break` leads, and what is known there."""

    label: str
    ways: list[Way]


class LoopCode(AssignmentCode):
    """The part of a function that is loops."""

    def body(self, statements: Sequence[ast.stmt]) -> bool:
        raise NotImplementedError

    def _While(self, node: ast.While) -> bool | None:
        self._forget(node.body)
        start, ways = dict(self.names), []
        with self.block("for (;;)"):
            truth = self.truth(self.term(node.test), node.test)
            if truth is False:
                self.line("break;", pure=True)
            elif truth is not True:
                self.line(f"if (!({truth}))", pure=True)
                self.line("    break;", pure=True)
            if truth is not True:
                ways.append(self.way())
            left = self._turns(node, start)
        return self._after_loop(node, ways, left)

    def _turn(self, statements: Sequence[ast.stmt], on: str, out: str) -> bool:
        """One turn, with the labels to which `continue` and `break` lead. Whether its end is reached."""
        self.loops.append((on, out, len(self.handlers)))
        goes_on = self.body(statements)
        self.loops.pop()
        return goes_on is not False

    def _turns(self, node: ast.For | ast.While, start: dict[str, Any]) -> Left:
        """The turns of a loop in C, whose first one begins with these names; what is known where `break` leaves
        it."""
        on, out = self.label("turn"), self._out_of(node)
        goes_on = self._turn(node.body, f"{on} ", out)
        again = [*([self.way()] if goes_on else []), *self.left.pop(f"{on} ", [])]
        for each in again:
            for name, of in each.names.items():
                if name in start and start[name] != of:
                    told = f"{name!r} stands for another object in the next turn"
                    raise self.refused(node.body[0], told, "a name for each")
        return Left(out, self.left.pop(out, []))

    def _out_of(self, node: ast.For | ast.While) -> str:
        """Where `break` leads: past the `else`, if there is one."""
        return self.label("left") + ("" if node.orelse else " ")

    def _after_loop(self, node: ast.For | ast.While, ends: Sequence[Way], left: Left) -> bool | None:
        """What follows where the loop ends, its `else`, and where `break` leaves it. False: nothing is reached."""
        ways = list(ends)
        if node.orelse and ends:
            self._end(ends)
            ways = [self.way()] if self.body(node.orelse) is not False else []
        if node.orelse and left.ways:
            self.line(f"{left.label}:;", pure=True)
        if not (ways or left.ways):
            return False
        self._end([*ways, *left.ways])
        return None

    def _end(self, ways: Sequence[Way]) -> None:
        """After a loop: nothing is known to be there that a turn may change."""
        self.go_on_from(ways)
        self.known.clear()

    def _meet(self, label: str, goes_on: bool) -> bool:
        """The ways that come to a label; False if there are none."""
        ways = [*([self.way()] if goes_on else []), *self.left.pop(label, [])]
        if ways:
            self.go_on_from(ways)
        return bool(ways)

    def _forget(self, statements: Sequence[ast.stmt]) -> None:
        """What is assigned in a loop is not known to be there at its beginning."""
        self.known.clear()

    def _For(self, node: ast.For) -> bool | None:
        if self._is_range(node.iter):
            return self._count(node)
        term = self.term(node.iter)
        if isinstance(term, Code) and isinstance(term.type, ArrayType):
            return self._each(node, self.kept(term) if isinstance(term, Elements) else term)
        return self._unroll(node, [self.settled(each) for each in self.elements(term, node.iter)])

    def _is_range(self, node: ast.AST) -> bool:
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"):
            return False
        if "range" in self.names or "range" in self.source.function.__code__.co_varnames:
            return False
        return self.source.meaning("range") is range and not node.keywords

    def _count(self, node: ast.For) -> bool | None:
        assert isinstance(node.iter, ast.Call)
        terms = self.ordered(node.iter.args)
        if any(isinstance(each, Known) and type(each.value) not in (int, bool) for each in terms):
            raise self.refused(node, "a range of something else than whole numbers", "int(...)")
        if all(isinstance(each, Known) for each in terms) and isinstance(node.target, ast.Name):
            numbers = range(*(each.value for each in terms))  # type: ignore[union-attr]
            if len(numbers) <= MOST_UNROLLED and _indexes_objects(node):
                return self._unroll(node, [Known(each) for each in numbers])
        first, last, step = (Known(0), *terms, Known(1)) if len(terms) == 1 else (*terms, Known(1))[:3]
        if not (isinstance(step, Known) and type(step.value) is int and step.value):
            raise self.refused(node, "the step of a range is not known")
        one_by_one = abs(step.value) == 1
        turn = self.temporary(INT if one_by_one else LONG, "i")
        first = self.settled(first)
        end = self.kept(Code(INT, self.as_type(last, INT, node)), "end").text
        self._forget(node.body)
        sign = "<" if step.value > 0 else ">"
        head = f"for ({turn} = {self.as_type(first, INT, node)}; {turn} {sign} {end}; {turn} += {step.value})"
        start = self.way()
        with self.block(head):
            self.store(node.target, Code(INT, turn if one_by_one else f"(int32_t){turn}"), node)
            left = self._turns(node, start.names)
        return self._after_loop(node, [start], left)

    def _each(self, node: ast.For, values: Code) -> bool | None:
        assert isinstance(values.type, ArrayType)
        self.check_length(values.type, node)
        turn = self.temporary(INT, "i")
        self._forget(node.body)
        start, at, rebound = self.way(), len(self.lines), len(self.rebound)
        with self.block(f"for ({turn} = 0; {turn} < {values.type.length}; {turn}++)"):
            self.store(node.target, Code(of_element(values.type), f"{values.text}.at[{turn}]"), node)
            left = self._turns(node, start.names)
        self._check_same_array(values, at, rebound, node)
        return self._after_loop(node, [start], left)

    def _check_same_array(self, values: Code, at: int, rebound: int, node: ast.For) -> None:
        """Python goes through the array that was there at the beginning."""
        calls = any(line.strip().startswith("fault = ") for line in self.lines[at:])
        if values.text in self.rebound[rebound:] or (calls and values.text in self.world.memory.rebound):
            raise self.refused(node, "what the loop goes through is assigned in it", "another name for the new one")

    def _unroll(self, node: ast.For, elements: list[Term]) -> bool | None:
        """A loop over objects: each turn is written out."""
        if len(elements) > MOST_UNROLLED:
            raise self.refused(
                node, f"a loop of {len(elements)} turns over objects", f"at most {MOST_UNROLLED}, or a Vector"
            )
        out = self.label("done")
        at = len(self.lines)
        goes_on = True
        for each in elements:
            on = self.label("next")
            with self.bound_to(node.target, each):
                goes_on = self._turn(node.body, on, out)
            if any(f"goto {on};" in line for line in self.lines[at:]):
                self.line(f"{on}:;", pure=True)
            goes_on = self._meet(on, goes_on)
            if not goes_on:
                break
        if goes_on and node.orelse:
            goes_on = self.body(node.orelse) is not False
        if any(f"goto {out};" in line for line in self.lines[at:]):
            self.line(f"{out}:;", pure=True)
        return None if self._meet(out, goes_on) else False

    def elements(self, term: Term, node: ast.AST) -> list[Term]:
        if isinstance(term, Many) or (isinstance(term, Code) and isinstance(term.type, ArrayType)):
            return self.parts(term, node)
        if isinstance(term, Known) and is_container(term.value):
            self.world.memory.place_known(term.value)
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
        label = str(loop[which])
        self.left.setdefault(label, []).append(self.way())
        self.line(plain if label.endswith(" ") else f"goto {label};", pure=True)  # C's own loops need no labels
        return False


def _indexes_objects(node: ast.For) -> bool:
    """Whether the number of a loop is a place in a list: of objects, perhaps, so that each turn is written out."""
    assert isinstance(node.target, ast.Name)
    name = node.target.id
    indexed = [each.slice for part in node.body for each in ast.walk(part) if isinstance(each, ast.Subscript)]
    return any(isinstance(each, ast.Name) and each.id == name for index in indexed for each in ast.walk(index))
