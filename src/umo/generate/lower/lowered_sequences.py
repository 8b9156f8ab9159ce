"""Iterables of loops, comprehensions and functions with a known number of turns: tuples, lists, arrays, ranges, and
`zip`, `enumerate` and `reversed` of these. An element of a list or an array is read in the turn that uses it."""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from umo.generate.c_types import INT, ArrayType, TupleType
from umo.generate.check.form_effects import calls
from umo.generate.form import ONE, CallStatement, Element, Literal, Operator, Statement, Value, walk, whole
from umo.generate.lower.flow import Names
from umo.generate.lower.lowered_expressions import of_element
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Elementwise, Known, Selection, SliceView, Term, TupleTerm, Turns
from umo.generate.value_kinds import is_container, is_ring

ITERATORS = zip, enumerate, reversed
"""Functions whose result can be iterated only once. It must be iterated where it is made."""
CONSUMERS = any, all, sum, min, max, sorted, list, tuple
"""Functions that iterate over their argument."""
MOST_TURNS = 256
"""Maximum number of turns in one expression. Each turn is written out."""
MOST_START = 2**30


class LoweredSequences(LoweredSubject):
    """Lowers the iterables of a function."""

    def over(self, node: ast.expr) -> Turns:
        """Return the iterations of a loop with this header."""
        leaves: list[ast.expr] = []
        turns = self._planned(node, leaves)
        return turns(iter(self.f.ordered(leaves)))

    def is_iterator(self, node: ast.AST) -> bool:
        """True if this is a call of `zip`, `enumerate` or `reversed`."""
        return self._iterator(node) is not None

    def _iterator(self, node: ast.AST) -> Any:
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            return None
        if node.func.id in self.f.flow.names or self.f.source.is_local(node.func.id):
            return None
        found = self.f.source.meaning(node.func.id)
        return next((each for each in ITERATORS if each is found), None)

    def _planned(self, node: ast.expr, leaves: list[ast.expr]) -> Callable[[Iterator[Term]], Turns]:
        """Return a function from the iterables, which Python evaluates in order, to the turns."""
        target = self._iterator(node)
        if target is None:
            leaves.append(node)
            return lambda terms: self.turns_of(next(terms), node)
        assert isinstance(node, ast.Call)
        self.f.term(node.func)  # its name is taken as known
        named = {str(each.arg): each.value for each in node.keywords}
        if target is enumerate:
            return self._numbered(node, named, leaves)
        if named.keys() - ({"strict"} if target is zip else set()):
            raise self.f.refused(
                node, f"an argument is given by keyword to `{target.__name__}`", "a positional argument"
            )
        if target is reversed and (len(node.args) != 1 or self.is_iterator(node.args[0])):
            raise self.f.refused(
                node,
                "`reversed` is applied to something that is not a list, a tuple or a range",
                "a list, a tuple, range",
            )
        inner = [self._planned(each, leaves) for each in node.args]
        if target is reversed:
            return lambda terms: self._reversed(inner[0](terms), node)
        strict = named.get("strict", ast.Constant(False))
        leaves.append(ast.copy_location(strict, node))
        return lambda terms: self._zipped([each(terms) for each in inner], next(terms), node)

    def _numbered(
        self, node: ast.Call, named: dict[str, ast.expr], leaves: list[ast.expr]
    ) -> Callable[[Iterator[Term]], Turns]:
        over, *start = [*node.args, *named.values()]
        if len(start) > 1 or named.keys() - {"start"} or any(isinstance(each, ast.Starred) for each in node.args):
            raise self.f.refused(node, "an argument is given by keyword to `enumerate`", "a positional argument")
        inner = self._planned(over, leaves)
        leaves += start

        def turns(terms: Iterator[Term]) -> Turns:
            found = inner(terms)
            first = next(terms) if start else Known(0)
            if not (isinstance(first, Known) and type(first.value) is int and abs(first.value) < MOST_START):
                raise self.f.refused(node, "`enumerate` starts from an unknown number", "i + start")
            return _numbered(found, first.value)

        return turns

    def _zipped(self, parts: Sequence[Turns], strict: Term, node: ast.AST) -> Turns:
        counts = {each.count for each in parts} or {0}
        if any(each.until is not None for each in parts):
            raise self.f.refused(
                node, "`zip` is applied to something with a varying number of elements", "a loop over range(len(...))"
            )
        truth = self.f.values.truth(strict, node)
        if truth is not False and len(counts) > 1:
            raise self.f.refused(node, "`zip` with strict=True has arguments of different lengths", "strict=False")
        found = Turns(min(counts), lambda n: TupleTerm(tuple(each.find(n) for each in parts)))
        finds = [each.find_at for each in parts if each.find_at is not None]
        arrays = tuple(array for each in parts for array in each.arrays)
        if len(finds) < len(parts):
            return replace(found, arrays=arrays)
        return replace(found, find_at=lambda at: TupleTerm(tuple(find(at) for find in finds)), arrays=arrays)

    def _reversed(self, turns: Turns, node: ast.AST) -> Turns:
        find_at, last = turns.find_at, turns.count - 1
        found = replace(turns, find=lambda n: turns.find(last - n))
        if find_at is None:
            return found
        end = Literal(last, INT) if turns.until is None else Operator("-", turns.until, ONE)
        return replace(found, find_at=lambda at: find_at(Operator("-", end, at)))

    def turns_of(self, term: Term, node: ast.AST) -> Turns:
        """Return the turns of a loop over this term."""
        if isinstance(term, Known) and is_ring(term.value):
            return self.f.rings.turns(term, node)
        if isinstance(term, Selection):
            chosen = term
            return Turns(
                chosen.of.length,
                lambda n: Code(chosen.of.of, Element(chosen.at, Literal(n, INT))),
                lambda at: Code(chosen.of.of, Element(chosen.at, at)),
                (chosen.at,),
                chosen.count,
            )
        if isinstance(term, SliceView):
            of = of_element(term.type)  # type: ignore[arg-type]

            def find_at(at: Value) -> Term:
                return Code(of, Element(term.base, term.place(at)))

            return Turns(term.type.length, lambda n: find_at(Literal(n, INT)), find_at, (whole(term.base),))  # type: ignore[attr-defined]
        if isinstance(term, Code) and isinstance(term.type, ArrayType):
            return self._turns_of_array(self.f.values.kept(term) if isinstance(term, Elementwise) else term, node)
        elements = [self.f.values.settled(each) for each in self._elements(term, node)]
        return Turns(len(elements), elements.__getitem__)

    def _turns_of_array(self, code: Code, node: ast.AST) -> Turns:
        assert isinstance(code.type, ArrayType)
        self.f.arrays.check_length(code.type, node)
        of = of_element(code.type)

        def find_at(at: Value) -> Term:
            return Code(of, Element(code.value, at))

        return Turns(code.type.length, lambda n: find_at(Literal(n, INT)), find_at, (whole(code.value),))

    def _elements(self, term: Term, node: ast.AST) -> list[Term]:
        if isinstance(term, TupleTerm) or (isinstance(term, Code) and isinstance(term.type, TupleType)):
            return self.f.calls.parts(term, node)
        if isinstance(term, Known) and is_container(term.value):
            self.f.world.memory.place_known(term.value)
            return [Known(each) for each in term.value]
        raise self.f.refused(
            node, "the elements of the loop are not known when the code is generated", "a list of parts, range"
        )

    def check_same(self, turns: Turns, body: Sequence[Statement], rebound: int, node: ast.AST) -> None:
        """Check that arrays are not replaced during a loop, because Python iterates over the arrays that existed at the
        beginning. `rebound`: the number of assignments before the loop."""
        later, told = self.f.aliases.rebound[rebound:], "the loop assigns the name that it iterates over"
        for each in turns.arrays:
            if each in later or (calls(body) and each in self.f.world.memory.rebound):
                raise self.f.refused(node, told, "another name for the new value")

    # Tuples and lists as wholes ------------------------------------------------------------------------

    def spread(self, nodes: Sequence[ast.expr]) -> list[Term]:
        """Return the elements or arguments that are written out, including those after a `*`."""
        found: list[Term] = []
        for each, term in zip(nodes, self.f.ordered(nodes, self._unpacked), strict=True):
            found += term.terms if isinstance(each, ast.Starred) else [term]  # type: ignore[union-attr]
        return found

    def _unpacked(self, node: ast.AST) -> Term:
        if isinstance(node, ast.Starred):
            return TupleTerm(tuple(self.f.calls.parts(self.f.term(node.value), node)))
        return self.f.term(node)

    def part_of(self, terms: Sequence[Term], node: ast.AST) -> slice:
        """Return the ends and the step of a slice."""
        if not all(isinstance(each, Known) and type(each.value) in (int, bool, type(None)) for each in terms):
            raise self.f.refused(node, "the ends of the slice are not known", "numbers, or a loop")
        part = slice(*[each.value for each in terms])  # type: ignore[union-attr,arg-type]
        if part.step is not None and not part.step:
            raise self.f.refused(node, "the step of the slice is 0", "another step")
        return part

    def sliced(self, node: ast.Subscript, ends: ast.Slice) -> Term:
        """Return a part of a tuple or a list, as a copy."""
        given = [each or ast.copy_location(ast.Constant(None), node) for each in (ends.lower, ends.upper, ends.step)]
        base, *terms = self.f.ordered([node.value, *given])
        part = self.part_of(terms, node)
        if self.f.arrays.is_array(base):
            return self.f.arrays.sliced(base, part, node)
        if not is_sequence(base):
            raise self.f.refused(
                node, "the slice is not that of a tuple, a list or an array", "a tuple, a list; a loop"
            )
        kind = list if _is_list(base) else None
        return TupleTerm(tuple(self.f.calls.parts(base, node)[part]), kind=kind)

    def of_sequences(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Term | None:
        """Return tuples or lists joined by `+` or repeated by `*`. Return None for other operators."""
        if isinstance(sign, ast.Add) and is_sequence(left) and is_sequence(right):
            if _is_list(left) != _is_list(right):
                raise self.f.refused(node, "a list and a tuple are added", "two lists, two tuples")
            parts = [*self.f.calls.parts(left, node), *self.f.calls.parts(right, node)]
        elif isinstance(sign, ast.Mult) and is_sequence(left) and isinstance(right, Known) and type(right.value) is int:
            parts = self.f.calls.parts(left, node) * min(right.value, MOST_TURNS + 1)
        else:
            return None
        if len(parts) > MOST_TURNS:
            raise self.f.refused(node, f"the sequence has more than {MOST_TURNS} elements", "a shorter one, an array")
        return TupleTerm(tuple(parts), kind=list if _is_list(left) else None)

    # Comprehensions ------------------------------------------------------------------------------------

    def lower_list_comp(self, node: ast.ListComp) -> Term:
        if self._chooses(node):
            return self.f.generators.chosen(node)
        return TupleTerm(tuple(self.gone_through(node)), kind=list)

    def _chooses(self, node: ast.ListComp) -> bool:
        """True if conditions decide at run time which elements a list has. The statements lowered for this are
        discarded."""
        if len(node.generators) != 1 or not node.generators[0].ifs:
            return False
        names, known = dict(self.f.flow.names), set(self.f.flow.known)
        with self.f.gathered():
            own, turns = self.opened(node)
            first = own.generators[0]
            found = False
            for number in range(turns.count):
                with self.f.loops.bound_to(first.target, turns.find(number)):
                    truths = (self.f.values.truth(self.f.term(each), each) for each in first.ifs)
                    found = found or next((each for each in truths if each is not True), False) is not False
        self.f.flow.names, self.f.flow.known = names, known
        return found

    def gone_through(self, node: ast.expr) -> list[Term]:
        """Return the values of a comprehension, a generator or an iterator, computed in order."""
        if not isinstance(node, ast.ListComp | ast.GeneratorExp):
            turns = self.over(node)
            self._check_count(turns, node)
            return [self.f.values.settled(turns.find(n)) for n in range(turns.count)]
        inner, turns = self.opened(node)
        at = len(self.f.statements)
        found = list(self.terms_of(inner, turns))
        self.check_unchanged(turns, self.f.statements[at:], node)
        return found

    def opened(self, node: ast.ListComp | ast.GeneratorExp) -> tuple[ast.ListComp | ast.GeneratorExp, Turns]:
        """Return a comprehension or generator whose names differ from those of the function, and its turns."""
        if len(node.generators) != 1 or node.generators[0].is_async:
            raise self.f.refused(node, "the expression has two loops", "a loop for each")
        node = with_own_names(node)
        turns = self.over(node.generators[0].iter)
        self._check_count(turns, node)
        return node, turns

    def _check_count(self, turns: Turns, node: ast.AST) -> None:
        if turns.until is not None:
            told = "the number of elements of the expression varies"
            raise self.f.refused(node, told, "any, all, sum, min, max, len or next of it; a loop")
        if turns.count > MOST_TURNS:
            told = f"the expression has {turns.count} numbers"
            raise self.f.refused(node, told, f"at most {MOST_TURNS}, or a loop")

    def terms_of(self, node: ast.ListComp | ast.GeneratorExp, turns: Turns) -> Iterator[Term]:
        """Return the values of a generator's expression for each turn in which the conditions hold."""
        first = node.generators[0]
        for number in range(turns.count):
            with self.f.loops.bound_to(first.target, turns.find(number)):
                if all(self._is_known(each, node) for each in first.ifs):
                    yield self.f.values.settled(self.f.term(node.elt))  # the names stand for others in the next turn
            self.f.flow.names = without_own(self.f.flow.names, node)

    def _is_known(self, test: ast.expr, node: ast.AST) -> bool:
        """Return the truth of a condition that is known when the code is generated."""
        truth = self.f.values.truth(self.f.term(test), test)
        if not isinstance(truth, bool):
            told = "the comprehension has an `if`, so its length is not known"
            raise self.f.refused(node, told, "any, all, sum, min, max, len or next of it; a loop")
        return truth

    def check_unchanged(self, turns: Turns, body: Sequence[Statement], node: ast.AST) -> None:
        """Refuse a call in an expression that changes what the expression iterates over."""
        called = {each.function for each in walk(*body) if isinstance(each, CallStatement)}
        changed, rebound = self.f.world.changed_by(called), self.f.world.memory.rebound
        if called and any(each in changed or each in rebound for each in turns.arrays):
            raise self.f.refused(node, "a call may change the elements of the generator", "a loop")


def is_sequence(term: Term) -> bool:
    """True if the value is a tuple or a list of Python."""
    if isinstance(term, Code):
        return isinstance(term.type, TupleType) or (isinstance(term.type, ArrayType) and term.type.listed)
    if isinstance(term, Known):
        return isinstance(term.value, tuple | list) and is_container(term.value)
    return isinstance(term, TupleTerm)


def _is_list(term: Term) -> bool:
    if isinstance(term, Code):
        return isinstance(term.type, ArrayType) or (isinstance(term.type, TupleType) and term.type.kind is list)
    return (
        isinstance(term.value, list) if isinstance(term, Known) else isinstance(term, TupleTerm) and term.kind is list
    )


def _numbered(turns: Turns, first: int) -> Turns:
    find_at = turns.find_at
    found = replace(turns, find=lambda n: TupleTerm((Known(first + n), turns.find(n))))
    if find_at is None:
        return found
    begin = Literal(first, INT)
    return replace(found, find_at=lambda at: TupleTerm((Code(INT, Operator("+", at, begin)), find_at(at))))


def mark_of(generator: ast.ListComp | ast.GeneratorExp) -> str:
    """Return a suffix for the names of a generator. No name of the function has this suffix."""
    return f" {generator.lineno} {generator.col_offset}"


def with_own_names(generator: ast.ListComp | ast.GeneratorExp) -> ast.ListComp | ast.GeneratorExp:
    """Return the generator with names that differ from those of the function."""
    copied, mark = copy.deepcopy(generator), mark_of(generator)
    first, *more = copied.generators
    targets = [each.target for each in copied.generators]
    own = {each.id for part in targets for each in ast.walk(part) if isinstance(each, ast.Name)}
    inner = [first.target, *first.ifs, *more, copied.elt]
    for each in (one for part in inner for one in ast.walk(part)):
        if isinstance(each, ast.Name) and each.id in own:
            each.id += mark
    return copied


def without_own(names: Names, generator: ast.ListComp | ast.GeneratorExp) -> Names:
    """Return the names without those of a generator."""
    return {name: of for name, of in names.items() if not name.endswith(mark_of(generator))}
