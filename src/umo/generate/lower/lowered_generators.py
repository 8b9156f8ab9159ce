"""Functions that take a generator, such as any and all, and generators with conditions, if the number of elements is
not known. They become the loop that Python would run."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from umo.generate.c_types import (
    BOOL,
    INT,
    MIXED,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    OptionalType,
    joined,
    list_of,
    plain,
    plain_number,
)
from umo.generate.form import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    Address,
    Assign,
    CheckedArithmetic,
    Conditional,
    Element,
    If,
    Labelled,
    Leave,
    Literal,
    Operator,
    Runtime,
    RuntimeCall,
    Temporary,
    Value,
    as_value,
    negated,
)
from umo.generate.lower.flow import Names, common, proved_by
from umo.generate.lower.lowered_builtins import SUM_COMPENSATES
from umo.generate.lower.lowered_conditions import calls_in
from umo.generate.lower.lowered_sequences import mark_of, with_own_names, without_own
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Known, Selection, Term, Turns
from umo.generate.translation import ControllerLimit
from umo.generate.value_kinds import is_ring

Generator = ast.GeneratorExp | ast.ListComp
Act = Callable[[Term, ast.AST], None]
"""Function that handles an element, given as an expression."""
ELEMENTS = "the number of elements is not known, and the elements are of several classes or of numpy"
OVER = any, all, sum, min, max, len, next


class TurnOf(ast.Expr):
    """The innermost statement of the loops that implement a generator."""

    act: Act


class LoweredGenerators(LoweredSubject):
    """Lowers generators that are passed directly to a function."""

    def over(self, target: Any, node: ast.Call) -> Term | None:
        """Return the result of any, all, sum, min, max, len or next of a generator. Return None for other calls, or if
        the number of elements is known."""
        generator = node.args[0] if node.args else None
        if target not in OVER or generator is None:
            return None
        if target in (min, max) and len(node.args) == 1 and [each.arg for each in node.keywords] == ["key"]:
            return self._by_key(target, generator, node.keywords[0].value, node)
        if target in (any, all, sum, min, max) and self._is_open(generator) and (target is sum or len(node.args) == 1):
            each, over = ast.Name("element", ast.Load()), ast.Name("element", ast.Store())
            generator = _placed(ast.GeneratorExp(each, [ast.comprehension(over, generator, [], 0)]), node)
        if not isinstance(generator, Generator):
            return None
        is_open = any(self._is_open(each.iter) for each in generator.generators[:1])
        is_counted = len(generator.generators) == 1 and not generator.generators[0].ifs and not is_open
        if isinstance(generator, ast.GeneratorExp) and target in (any, all):
            return self._in_loop(target, generator) if is_open else self._any_or_all(target, generator, node)
        if isinstance(generator, ast.GeneratorExp) and target is next:
            return self._first(generator, node)
        if is_counted or target is next or (target is len and isinstance(generator, ast.GeneratorExp)):
            return None
        if target in (min, max):
            return self._extreme(target, generator, node)
        return self._sum(generator, node) if target is sum else self._of_list(target, generator)

    def _by_key(self, target: Any, over: ast.expr, key: ast.expr, node: ast.Call) -> Term:
        """Return `min` or `max` of a known number of elements by a key function."""
        if isinstance(over, Generator):
            raise self.f.refused(
                node, "a minimum or maximum of a generator is chosen by a key", "a list, a tuple, a loop"
            )
        if isinstance(key, ast.Lambda) and _takes_one(key):
            name, value = key.args.args[0].arg, key.body
        elif isinstance(key, ast.Name | ast.Attribute):
            name, value = "an element", ast.Call(key, [ast.Name("an element", ast.Load())], [])
        else:
            raise self.f.refused(key, "the key function is computed", "lambda each: ..., the name of a function")
        each = ast.Tuple([ast.Name(name, ast.Load()), value], ast.Load())
        turns = [ast.comprehension(ast.Name(name, ast.Store()), over, [], 0)]
        pairs = self.f.sequences.gone_through(_placed(ast.GeneratorExp(each, turns), node))
        terms, keys = zip(*(self.f.calls.parts(each, node) for each in pairs), strict=True) if pairs else ((), ())
        if not terms:
            raise self.f.refused(node, "the minimum or maximum has no elements", "elements")
        return self.f.builtins.first_of(target, terms, keys, node)

    def _is_open(self, node: ast.expr) -> bool:
        """True if the number of turns of a loop over this is not known, as for a deque or a computed range."""
        if isinstance(node, ast.Call) and (self.f.sequences.is_iterator(node) or self.f.loops.is_range(node)):
            return any(map(self._is_open, node.args)) or (self.f.loops.is_range(node) and self._is_computed(node.args))
        if not isinstance(node, ast.Name | ast.Attribute):
            return False
        term = self._looked_at(node)
        return isinstance(term, Selection) or is_ring(getattr(term, "value", None))

    def _is_computed(self, nodes: Sequence[ast.expr]) -> bool:
        return not all(isinstance(self._looked_at(each), Known) for each in nodes)

    def _looked_at(self, node: ast.expr) -> Term:
        """Return the term of an expression without adding its statements. The expression is lowered again at its
        place."""
        with self.f.gathered():
            return self.f.term(node)

    # Turns ---------------------------------------------------------------------------------------------

    def _any_or_all(self, target: Any, generator: ast.GeneratorExp, node: ast.Call) -> Term:
        """Return `any` or `all` with each turn written out."""
        first, *more = generator.generators
        if more:  # any(a > b for a in x for b in y): any(any(a > b for b in y) for a in x)
            inner = ast.Call(node.func, [ast.GeneratorExp(generator.elt, more)], [])
            generator = _placed(ast.GeneratorExp(inner, [first]), generator)
        own, turns = self.f.sequences.opened(generator)
        at = len(self.f.statements)
        found = self._decided(target, own, turns)
        self.f.sequences.check_unchanged(turns, self.f.statements[at:], node)
        return found

    def _decided(self, target: Any, own: Generator, turns: Turns) -> Term:
        first = own.generators[0]
        result, end, ways = self.f.temporary(BOOL, "c"), self.f.label("found"), list[Names]()
        self.f.assign(result, Literal(target is all, BOOL))
        with self.f.gathered() as written:
            for each in map(turns.find, range(turns.count)):
                on, known, skipped = self.f.label("next"), set(self.f.flow.known), list[Names]()
                with self.f.one_of_two() as turn, self.f.loops.bound_to(first.target, each):
                    for test in first.ifs:
                        self.f.add_if(negated(self._truth(test)), Leave(on))
                        self.f.flow.names, otherwise = self.f.flow.names_if(test)
                        skipped.append(otherwise)
                        self.f.flow.known |= proved_by(test) if not calls_in(test) else set()
                    truth = self._truth(own.elt)
                    found = Assign(result, Literal(target is any, BOOL)), Leave(end)
                    self.f.add_if(truth if target is any else negated(truth), *found)
                    when_true, when_false = self.f.flow.names_if(own.elt)
                    leaves, goes_on = (when_true, when_false) if target is any else (when_false, when_true)
                    ways.append(leaves)
                    self.f.flow.names = common([goes_on, *skipped])
                self.f.flow.known &= known
                self.f.add(Labelled(on, tuple(turn)))
        self.f.add(Labelled(end, tuple(written)))
        self.f.flow.names = without_own(common([self.f.flow.names, *ways]), own)
        return Code(BOOL, result)

    def _in_loop(self, target: Any, generator: ast.GeneratorExp) -> Term:
        """Return `any` or `all` for a varying number of elements, as a loop that is left early."""
        result = self.f.temporary(BOOL, "c")
        self.f.assign(result, Literal(target is all, BOOL))
        if len(generator.generators) > 1:
            raise self.f.refused(generator, "the expression has two loops", "a loop for each")
        test = generator.elt if target is any else ast.UnaryOp(ast.Not(), generator.elt)
        (each,) = generator.generators
        turns = ast.comprehension(each.target, each.iter, [*each.ifs, test], 0)
        marked = _placed(ast.GeneratorExp(ast.Constant(True), [turns]), generator)
        self._loops(marked, lambda *_: self.f.assign(result, Literal(target is any, BOOL)), ast.Break())
        return Code(BOOL, result)

    def _truth(self, node: ast.expr) -> Value:
        return as_value(self.f.values.truth(self.f.term(node), node))

    def _loops(self, generator: Generator, act: Act, *then: ast.stmt) -> None:
        """Add the loops of a generator, with `act` for each element."""
        own = with_own_names(generator)
        turn = TurnOf(own.elt)
        turn.act = act
        body: list[ast.stmt] = [turn, *then]
        for each in reversed(own.generators):
            for test in reversed(each.ifs):
                body = [ast.If(test, body, [])]
            body = [ast.For(each.target, each.iter, body, [])]
        self.f.body([_placed(each, generator) for each in body])
        self.f.flow.names = without_own(self.f.flow.names, own)

    def lower_turn(self, node: TurnOf) -> None:
        node.act(self.f.term(node.value), node.value)

    # What is made of the elements -------------------------------------------------------------------------

    def _number(self, term: Term, node: ast.AST) -> Code:
        """Return an element as a number that is not None."""
        code = self.f.values.code(term, node)
        if isinstance(code.type, OptionalType):
            raise self.f.refused(node, "an element may be None", "`if x is not None`")
        self.f.values.number(code, node)
        return code

    def _type_so_far(self, generator: Generator) -> CType:
        """Return the type of the result for the elements so far; an integer at first."""
        return self.f.world.memory.locals.get(self._key(generator)) or INT

    def _learnt(self, generator: Generator, of: CType) -> CType:
        """Return the type of the result after an element of this type."""

        def refuse() -> None:
            raise self.f.refused(generator, ELEMENTS, "float(...), one type for all")

        return self.f.world.memory.learn(self.f.world.memory.locals, self._key(generator), of, refuse)

    def _key(self, generator: Generator) -> tuple[Any, str]:
        return self.f.key, mark_of(generator)

    def _sum(self, generator: Generator, node: ast.Call) -> Term:
        """Return the sum in the order of the elements; the integer 0 if there are none."""
        start = self._beside("start", 1, node) or Known(0)
        begin = self.f.values.number(start, node)
        is_zero = isinstance(start, Known) and start.value == 0 and type(start.value) is int
        of = REAL if begin.type == REAL else plain_number(self._type_so_far(generator))
        total, lost = self.f.temporary(of, "sum"), self.f.temporary(REAL, "lost")
        self.f.assign(total, self.f.values.as_type(begin, of, node))
        self.f.assign(lost, ZERO)

        def add(term: Term, at: ast.AST) -> None:
            code = self._number(term, at)
            one = INT if code.type == BOOL else code.type
            found = self._learnt(generator, one if is_zero else joined(one, begin.type))
            if isinstance(found, MixedNumber | NumpyNumber):
                raise self.f.refused(at, ELEMENTS, "float(...)")
            if found != of:
                return  # in the next pass it is
            value = self.f.values.as_type(code, of, at)
            if of == INT:
                self.f.add(CheckedArithmetic("add", total, total, value, self.f.fault(ControllerLimit, node)))
            elif SUM_COMPENSATES:
                self.f.add(RuntimeCall(Runtime("umo_add", (Address(total), Address(lost), value))))
            else:
                self.f.assign(total, Operator("+", total, value))

        self._loops(generator, add)
        if of == INT:
            return Code(INT, total)
        value = Runtime("umo_added", (total, lost)) if SUM_COMPENSATES else total
        return Code(REAL if begin.type == REAL else MIXED, value)

    def _extreme(self, target: Any, generator: Generator, node: ast.Call) -> Term:
        default = self._beside("default", 0, node)
        kind = self._type_so_far(generator)
        of = plain_number(kind)
        found, there = self.f.temporary(of, "found"), self.f.temporary(BOOL, "any")
        self.f.assign(there, FALSE)
        name = f"umo_{target.__name__}{'' if of == REAL else '_int'}"

        def take(term: Term, at: ast.AST) -> None:
            code = self._number(term, at)
            if isinstance(code.type, NumpyNumber) and code.type.of == BOOL:
                raise self.f.refused(
                    at, "a minimum or maximum of numpy bools cannot be translated", "and, or, bool(...)"
                )
            if self._learnt(generator, code.type) == kind:
                value = self.f.values.kept(Code(of, self.f.values.as_type(code, of, at))).value
                self.f.assign(found, Conditional(there, Runtime(name, (found, value)), value))
                self.f.assign(there, TRUE)

        self._loops(generator, take)
        return self._or_default(Code(kind, found), there, default, node)

    def _first(self, generator: ast.GeneratorExp, node: ast.Call) -> Term:
        """Return `next` of a new generator: its first element."""
        default = self._beside("", 1, node)
        if default is None or len(generator.generators) > 1:
            raise self.f.refused(
                node, "`next` is applied to a generator that may be empty or has two loops", "next(..., 0.0), a loop"
            )
        kind = self._type_so_far(generator)
        found, there = self.f.temporary(kind, "found"), self.f.temporary(BOOL, "any")
        self.f.assign(there, FALSE)

        def take(term: Term, at: ast.AST) -> None:
            code = self.f.values.code(term, at)
            if isinstance(plain(code.type), ArrayType):
                raise self.f.refused(at, "the element found is a list or an array", "one of its elements")
            if self._learnt(generator, code.type) == kind:
                self.f.assign(found, self.f.values.as_type(code, kind, at))
                self.f.assign(there, TRUE)

        self._loops(generator, take, ast.Break())
        return self._or_default(Code(kind, found), there, default, node)

    def _or_default(self, found: Code, there: Temporary, default: Term | None, node: ast.Call) -> Term:
        """Return the element found, or the default. Raises ValueError if there is neither."""
        if default is None:
            self.f.raises(ValueError, node, negated(there))
            return found
        of = self.f.values.type_of(default)
        with suppress(TypeError):
            kind = joined(found.type, found.type if of is None else of)
            if of is not None:
                result = self.f.temporary(kind, "v")
                a, b = (self.f.values.as_type(each, kind, node) for each in (found, default))
                self.f.add(If(there, (Assign(result, a),), (Assign(result, b),)))
                return Code(kind, result)
        raise self.f.refused(node, "the two values have different types", "one type for both")

    def chosen(self, generator: ast.ListComp) -> Selection:
        """Return a list of the numbers for which the conditions hold."""
        first, most = self._first_of(generator)
        kind = self._learnt(generator, first)
        of = list_of(plain_number(kind), most)
        at, count = self.f.temporary(of, "chosen"), self.f.temporary(INT, "count")
        self.f.assign(count, ZERO)

        def take(term: Term, node: ast.AST) -> None:
            code = self._number(term, node)
            found = self._learnt(generator, code.type)
            if isinstance(found, MixedNumber | NumpyNumber):
                raise self.f.refused(node, ELEMENTS, "float(...)")
            if found == kind:
                self.f.assign(Element(at, count), self.f.values.as_type(code, of.of, node))
                self.f.assign(count, Operator("+", count, ONE))

        self._loops(generator, take)
        return Selection(at, count, of)

    def _first_of(self, generator: ast.ListComp) -> tuple[CType, int]:
        """Return the type of the first element and the maximum number of elements. The statements lowered for this are
        discarded."""
        names = dict(self.f.flow.names)
        with self.f.gathered():
            own, turns = self.f.sequences.opened(generator)
            with self.f.loops.bound_to(own.generators[0].target, turns.find(0)):
                term = self.f.term(own.elt)
                if isinstance(term, Known) and self.f.values.type_of(term) is None:
                    told = "the number of objects is not known"
                    raise self.f.refused(generator, told, "a loop; min or max by a key")
                of = self._number(term, own.elt).type
        self.f.flow.names = names
        return of, turns.count

    def _of_list(self, target: Any, generator: Generator) -> Term:
        """Return `len`, `any` or `all` of a list that is made first."""
        result = self.f.temporary(INT if target is len else BOOL, "n")
        self.f.assign(result, ZERO if target is len else Literal(target is all, BOOL))

        def take(term: Term, at: ast.AST) -> None:
            if target is len:
                self.f.values.settled(term)
                self.f.assign(result, Operator("+", result, ONE))
                return
            test = as_value(self.f.values.truth(term, at))
            self.f.add_if(test if target is any else negated(test), Assign(result, Literal(target is any, BOOL)))

        self._loops(generator, take)
        return Code(INT if target is len else BOOL, result)

    def _beside(self, name: str, place: int, node: ast.Call) -> Term | None:
        """Return the argument beside the generator, by name or position. Python computes it before the first
        element."""
        given = [each.value for each in node.keywords if each.arg == name] + node.args[1 : 1 + place]
        if len(given) != len(node.args) + len(node.keywords) - 1 or len(given) > 1:
            raise self.f.refused(node, "an argument that cannot be translated is passed", name)
        if not given:
            return None
        with self.f.gathered() as needed:
            term = self.f.values.settled(self.f.term(given[0]))
        if any(not isinstance(each, Assign) for each in needed):
            raise self.f.refused(node, "an argument is computed", "assign it to a name first")
        self.f.statements += needed
        return term


def _takes_one(function: ast.Lambda) -> bool:
    """Return True if the function has one argument and no other local name."""
    own = [each for each in ast.walk(function) if isinstance(each, ast.arg | ast.NamedExpr | ast.Starred)]
    return own == function.args.args and not function.args.defaults


def _placed(new: Any, node: ast.AST) -> Any:
    return ast.fix_missing_locations(ast.copy_location(new, node))
