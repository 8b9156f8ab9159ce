"""Loops with a count, loops over arrays, and loops over objects, whose turns are written out."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from umo.generate.c_types import INT, LONG
from umo.generate.form import (
    ZERO,
    Conversion,
    CountedLoop,
    EndlessLoop,
    Labelled,
    Leave,
    Literal,
    NextTurn,
    Statement,
    Value,
    negated,
)
from umo.generate.lower.flow import FlowState
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.lowered_expressions import NUMBERS
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Known, Term, TupleTerm, Turns

MOST_UNROLLED = 256
"""Maximum number of turns of a loop over objects. Each turn is written out."""


@dataclass(frozen=True)
class LoopAround:
    """A loop that is being lowered: the labels for `continue` and `break`, and the number of `try` statements that
    contain it."""

    again: str
    out: str
    end: str
    """The label of the end of the loop itself, before its `else`."""
    tries: int
    is_written_out: bool
    """True if each turn is written out, so that `continue` leaves the statements of a turn."""


class LoweredLoops(LoweredSubject):
    """The loops of a function."""

    def __init__(self, f: FunctionBuilder) -> None:
        super().__init__(f)
        self.around: list[LoopAround] = []
        """The loops around the statement that is being lowered."""

    def lower_while(self, node: ast.While) -> bool | None:
        self._forget(node.body)
        start, ways = dict(self.f.flow.names), []
        loop = self._loop_of_c(node)
        with self.f.body_of() as body:
            truth = self.f.values.truth(self.f.term(node.test), node.test)
            in_turn, at_end = self.f.flow.names_if(node.test)
            if truth is False:
                self.f.add(Leave(loop.end))
            elif truth is not True:
                self.f.add_if(negated(truth), Leave(loop.end))
            if truth is not True:
                ways.append(FlowState(at_end, set(self.f.flow.known)))
            self.f.flow.names = in_turn
            _, left = self._turns(node, start, loop)
        return self._after_loop(node, loop, EndlessLoop(loop.end, tuple(body)), ways, left)

    def _loop_of_c(self, node: ast.For | ast.While) -> LoopAround:
        """Return a loop of the form. `break` leads to after the `else`, if there is one."""
        end = self.f.label("left")
        out = self.f.label("past") if node.orelse else end
        return LoopAround(self.f.label("turn"), out, end, self.f.errors.tries, False)

    def _after_loop(
        self,
        node: ast.For | ast.While,
        loop: LoopAround,
        whole: Statement,
        ends: Sequence[FlowState],
        left: Sequence[FlowState],
    ) -> bool | None:
        """Lower a loop and what follows it: its `else` where it ends, and the point that `break` leads to. Return False
        if nothing after it is reached."""
        ways = list(ends)
        with self.f.gathered() as found:
            self.f.add(whole)
            if node.orelse and ends:
                self._end(ends)
                ways = [self.f.flow.way()] if self.f.body(node.orelse) is not False else []
        self.f.statements += [Labelled(loop.out, tuple(found), line=self.f.line)] if node.orelse else found
        if not (ways or left):
            return False
        self._end([*ways, *left])
        return None

    def _turn(self, statements: Sequence[ast.stmt], loop: LoopAround) -> bool:
        """Lower one turn of a loop. Return True if its end is reached."""
        self.around.append(loop)
        goes_on = self.f.body(statements)
        self.around.pop()
        return goes_on is not False

    def _turns(
        self, node: ast.For | ast.While, start: dict[str, Any], loop: LoopAround
    ) -> tuple[list[FlowState], list[FlowState]]:
        """Return the known facts at the ends of turns, and at the points where the loop is left. `start`: the names at
        the beginning of the first turn."""
        goes_on = self._turn(node.body, loop)
        again = [*([self.f.flow.way()] if goes_on else []), *self.f.flow.left.pop(loop.again, [])]
        for each in again:
            for name, of in each.names.items():
                if name in start and start[name] != of:
                    told = f"{name!r} means another object in the next turn"
                    raise self.f.refused(node.body[0], told, "one name per object")
        return again, self.f.flow.left.pop(loop.out, [])

    def _end(self, ways: Sequence[FlowState]) -> None:
        """After a loop, forget what a turn may change."""
        self.f.flow.go_on_from(ways)
        self.f.flow.known.clear()

    def _meet(self, label: str, goes_on: bool) -> bool:
        """Join the branches that lead to a label. Return False if there are none."""
        ways = [*([self.f.flow.way()] if goes_on else []), *self.f.flow.left.pop(label, [])]
        if ways:
            self.f.flow.go_on_from(ways)
        return bool(ways)

    def _forget(self, statements: Sequence[ast.stmt]) -> None:
        """Forget at the beginning of a loop what is assigned in it."""
        self.f.flow.known.clear()

    def _make_variables(self, target: ast.AST) -> None:
        """Make variables for the names of a loop that were known numbers before, as after a loop that was written
        out."""
        for each in ast.walk(target):
            known = self.f.flow.names.get(each.id) if isinstance(each, ast.Name) else None
            if isinstance(known, Known) and type(known.value) in NUMBERS:
                self.f.assignments.store(each, self.f.values.code(known, each), each)

    def lower_for(self, node: ast.For) -> bool | None:
        if self.is_range(node.iter):
            return self._count(node)
        turns = self.f.sequences.over(node.iter)
        is_open = turns.until is not None
        if turns.find_at is not None and (is_open or not (_is_numbered(turns) and _indexes_objects(node))):
            return self._each(node, turns, turns.find_at)
        return self._unroll(node, turns)

    def is_range(self, node: ast.AST) -> bool:
        """True if this is a call of `range`."""
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"):
            return False
        if "range" in self.f.flow.names or self.f.source.is_local("range"):
            return False
        return self.f.source.meaning("range") is range and not node.keywords

    def _count(self, node: ast.For) -> bool | None:
        assert isinstance(node.iter, ast.Call)
        terms = self.f.ordered(node.iter.args)
        if any(isinstance(each, Known) and type(each.value) not in (int, bool) for each in terms):
            raise self.f.refused(node, "the range is not of integers", "int(...)")
        if all(isinstance(each, Known) for each in terms) and isinstance(node.target, ast.Name):
            numbers = range(*(each.value for each in terms))  # type: ignore[union-attr,arg-type]
            if len(numbers) <= MOST_UNROLLED and _indexes_objects(node):
                return self._unroll(node, Turns(len(numbers), lambda n: Known(numbers[n])))
        first, last, step = (Known(0), *terms, Known(1)) if len(terms) == 1 else (*terms, Known(1))[:3]
        if not (isinstance(step, Known) and type(step.value) is int and step.value):
            raise self.f.refused(node, "the step of a range is not known")
        one_by_one = abs(step.value) == 1
        turn = self.f.temporary(INT if one_by_one else LONG, "i")
        begin = self.f.values.as_type(self.f.values.settled(first), INT, node)
        end = self.f.values.kept(Code(INT, self.f.values.as_type(last, INT, node)), "end").value
        self._forget(node.body)
        self._make_variables(node.target)
        start, loop = self.f.flow.way(), self._loop_of_c(node)
        with self.f.body_of() as body:
            self.f.assignments.store(node.target, Code(INT, turn if one_by_one else Conversion(INT, turn)), node)
            again, left = self._turns(node, start.names, loop)
        whole = CountedLoop(loop.end, turn, begin, end, step.value, tuple(body))
        return self._after_loop(node, loop, whole, again if _has_a_turn(terms) else [start], left)

    def _each(self, node: ast.For, turns: Turns, find_at: Callable[[Value], Term]) -> bool | None:
        turn = self.f.temporary(INT, "i")
        self._forget(node.body)
        self._make_variables(node.target)
        start, rebound, loop = self.f.flow.way(), len(self.f.aliases.rebound), self._loop_of_c(node)
        with self.f.body_of() as body, self.f.rings.held(turns, node):
            self.f.assignments.store(node.target, find_at(turn), node)
            again, left = self._turns(node, start.names, loop)
        self.f.sequences.check_same(turns, body, rebound, node)
        whole = CountedLoop(loop.end, turn, ZERO, turns.until or Literal(turns.count, INT), 1, tuple(body))
        ends = again if turns.count and turns.until is None else [start]
        return self._after_loop(node, loop, whole, ends, left)

    def _unroll(self, node: ast.For, turns: Turns) -> bool | None:
        """Write out each turn of a loop over objects."""
        if turns.count > MOST_UNROLLED:
            raise self.f.refused(
                node, f"the loop over objects has {turns.count} turns", f"at most {MOST_UNROLLED}, or a Vector"
            )
        out, rebound = self.f.label("done"), len(self.f.aliases.rebound)
        goes_on = True
        with self.f.gathered() as written:
            for number in range(turns.count):
                loop = LoopAround(self.f.label("next"), out, out, self.f.errors.tries, True)
                with self.f.gathered() as turn, self.bound_to(node.target, turns.find(number)):
                    goes_on = self._turn(node.body, loop)
                self.f.add(Labelled(loop.again, tuple(turn)))
                goes_on = self._meet(loop.again, goes_on)
                if not goes_on:
                    break
            self.f.sequences.check_same(turns, written, rebound, node)
            if goes_on and node.orelse:
                goes_on = self.f.body(node.orelse) is not False
        self.f.add(Labelled(out, tuple(written)))
        return None if self._meet(out, goes_on) else False

    @contextmanager
    def bound_to(self, target: ast.AST, term: Term) -> Iterator[None]:
        """Return a context in which the loop variable means one object."""
        if isinstance(target, ast.Name) and isinstance(term, Known) and self.f.values.type_of(term) is None:
            self.f.flow.names[target.id] = term
        elif isinstance(target, ast.Tuple):
            for each, part in zip(target.elts, self.f.calls.parts(term, target), strict=True):
                if isinstance(each, ast.Name) and isinstance(part, Known):
                    self.f.flow.names[each.id] = part
                elif isinstance(each, ast.Tuple):
                    with self.bound_to(each, part):
                        continue
                else:
                    self.f.assignments.store(each, part, target)
        elif isinstance(target, ast.Name) and isinstance(term, Known):
            self.f.flow.names[target.id] = term
        else:
            self.f.assignments.store(target, term, target)
        yield

    def lower_break(self, node: ast.Break) -> bool:
        self._leave(node, self.around[-1].out)
        self.f.add(Leave(self.around[-1].out))
        return False

    def lower_continue(self, node: ast.Continue) -> bool:
        loop = self.around[-1]
        self._leave(node, loop.again)
        self.f.add(Leave(loop.again) if loop.is_written_out else NextTurn(loop.end))
        return False

    def _leave(self, node: ast.AST, label: str) -> None:
        if self.f.errors.tries > self.around[-1].tries:
            raise self.f.refused(node, "the loop jumps out of a `try`", "a flag")
        self.f.flow.left.setdefault(label, []).append(self.f.flow.way())


def _has_a_turn(terms: Sequence[Term]) -> bool:
    """True if a range of these numbers is known to have at least one turn."""
    numbers = [each.value for each in terms if isinstance(each, Known)]
    return len(numbers) == len(terms) and len(range(*numbers)) > 0


def _is_numbered(turns: Turns) -> bool:
    """True if a part of the value in each turn is known, such as the number of the turn."""
    return turns.count <= MOST_UNROLLED and _has_known(turns.find(0))


def _has_known(term: Term) -> bool:
    return any(map(_has_known, term.terms)) if isinstance(term, TupleTerm) else isinstance(term, Known)


def _indexes_objects(node: ast.For) -> bool:
    """True if the counter of a loop may be an index into a list of objects, so that each turn is written out."""
    names = {each.id for each in ast.walk(node.target) if isinstance(each, ast.Name)}
    indexed = [each.slice for part in node.body for each in ast.walk(part) if isinstance(each, ast.Subscript)]
    return any(isinstance(each, ast.Name) and each.id in names for index in indexed for each in ast.walk(index))
