"""Statements of Python as C."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from umo.generate.c_types import BOOL, INT, NOTHING, REAL, ArrayType, CType, NumpyNumber, array, plain, plain_number
from umo.generate.call_code import CallCode
from umo.generate.expression_code import of_element
from umo.generate.function_scope import TELLS, NoTranslation, TryBlock
from umo.generate.terms import Code, Elements, Known, Many, Present, Term
from umo.objects import Quality

MOST_UNROLLED = 256
"""Turns of a loop over objects, each written out."""


class StatementCode(CallCode):
    """The part of a function that is statements."""

    def body(self, statements: Sequence[ast.stmt]) -> bool:
        """Statements in a row; False if nothing after them is reached."""
        for each in statements:
            method = getattr(self, f"_{type(each).__name__}", None)
            if method is None:
                raise self.refused(
                    each, "this statement does not translate", "if, for, while, try, raise, return, assignments"
                )
            if method(each) is False:
                return False
        return True

    def _Pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        term = self.term(node.value)
        if isinstance(term, Code) and term.text.endswith(")"):
            self.line(f"(void){term.text};")

    def _Import(self, node: ast.Import | ast.ImportFrom) -> None:
        scope: dict[str, Any] = {}
        exec(compile(ast.Module([node], []), "<import>", "exec"), {"__name__": self.source.function.__module__}, scope)
        self.names |= {name: Known(value, name=name) for name, value in scope.items()}

    _ImportFrom = _Import

    # Assignments ---------------------------------------------------------------------------------------

    def _Assign(self, node: ast.Assign) -> None:
        term = self.term(node.value)
        if isinstance(term, Code) and ast.dump(node.value) in self.known:
            term = self.present(term, node.value)
        if len(node.targets) > 1 or not isinstance(node.targets[0], ast.Name):
            term = self._settled(term)
        for each in node.targets:
            self.store(each, term, node)

    def _settled(self, term: Term) -> Term:
        """The same, which no assignment changes any longer."""
        if isinstance(term, Code):
            if not isinstance(term, Elements) and isinstance(plain(term.type), ArrayType):
                self.share(term)
            return self.kept(term)
        if isinstance(term, Many):
            return Many(tuple(map(self._settled, term.terms)), term.names, term.kind)
        return term

    def _AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.store(node.target, self.term(node.value), node)

    def _AugAssign(self, node: ast.AugAssign) -> None:
        load = ast.copy_location(_loaded(node.target), node.target)
        left, right = self.ordered([load, node.value])
        if self.is_array(left):
            place = self.array(left, node.target)
            self.overwrite(place, self.of_arrays(node.op, place, right, node), node)
            return
        if self.is_array(right):
            self.store(node.target, self.of_arrays(node.op, left, right, node), node)
            return
        result = self.of_numbers(node.op, left, right, (node.target, node.value), node)
        self.store(node.target, result, node)

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None:
        self.known.discard(ast.dump(_loaded(target)))
        if isinstance(target, ast.Tuple | ast.List):
            parts = self.parts(term, node)
            if len(parts) != len(target.elts) or any(isinstance(each, ast.Starred) for each in target.elts):
                raise self.refused(node, f"{len(parts)} values for {len(target.elts)} names")
            for each, part in zip(target.elts, map(self._settled, parts), strict=True):
                self.store(each, part, node)
        elif isinstance(target, ast.Name):
            self._store_local(target.id, term, node)
        elif isinstance(target, ast.Attribute):
            self._store_field(target, term, node)
        elif isinstance(target, ast.Subscript):
            self._store_element(target, term, node)
        else:
            raise self.refused(node, "it cannot be assigned to this", "names, attributes, elements")
        if not isinstance(term, Known) or term.value is not None:
            self.known.add(ast.dump(_loaded(target)))

    def _store_local(self, name: str, term: Term, node: ast.AST) -> None:
        if isinstance(term, Many) and term.terms and all(map(_is_quality, term.terms)):
            term = Known(tuple(each.value for each in term.terms))  # type: ignore[union-attr]
            self.names[name] = term
            return
        of = self.type_of(term)
        key = (self.key, name)
        before = self.world.memory.locals.get(key)
        if of is None or (of == NOTHING and before is None):
            texts = isinstance(term, Known) and isinstance(term.value, str)
            if isinstance(term, Known) and (before is None or before == term or texts):
                self.names[name] = term
                return
            raise self.refused(node, f"{name!r} stands for different objects", "a name for each")
        if isinstance(before, Known):
            raise self.refused(node, f"{name!r} stands for different objects", "a name for each")
        of = self.world.memory.learn(self.world.memory.locals, key, of, lambda: self._odd(name, node))
        self.names[name] = of
        if isinstance(of, ArrayType) and isinstance(term, Code) and self._is_same(name, term):
            self.same[name] = term.text
            return
        text = self.c_local(name)
        if text not in self.given:
            self.temporaries.setdefault(text, of)
            self.temporaries[text] = of
        if not (isinstance(term, Code) and term.text in self.sole):
            self.share(term)
            if isinstance(term, Code) and not isinstance(term, Elements) and isinstance(plain(of), ArrayType):
                self.share(Code(of, text))
        if isinstance(of, ArrayType) and isinstance(term, Elements):
            self.fill(text, Elements(of, self.at(term, of.of, of.length)))
            self.impure += 1
            return
        value = self.as_type(term, of, node)
        if value != text:
            self.line(f"{text} = {value};")

    def _is_same(self, name: str, term: Code) -> bool:
        """Whether both names stand for one array from here on: each is assigned once, and not in a loop or a branch."""
        others = [each for each in self.names if self.c_local(each) == term.text and each != name]
        if not others or self.depth > 1 or term.text in self.given:
            return False
        assigned = [each.id for each in _assigned(self.source.tree)]
        return all(assigned.count(each) == 1 for each in (name, *others))

    def _odd(self, name: str, node: ast.AST) -> None:
        raise self.refused(node, f"{name!r} has values of different types", "one type for each name")

    def type_of(self, term: Term) -> CType | None:
        """The type of what a term is; None: it is no value of a controller."""
        if isinstance(term, Code):
            return term.type
        if isinstance(term, Many):
            types = [self.type_of(each) for each in term.terms]
            return self.world.fields.tuple_type(types, term.names, term.kind or tuple)
        if isinstance(term, Present):
            return None
        found = self.world.fields.type_of_value(term.value)
        return None if isinstance(found, ArrayType) and not isinstance(term.value, np.ndarray) else found

    def _store_field(self, target: ast.Attribute, term: Term, node: ast.AST) -> None:
        base = self.term(target.value)
        if not isinstance(base, Known):
            raise self.refused(node, "an attribute of something that is not known when the code is generated")
        owner, name = base.value, target.attr
        if isinstance(term, Known) and isinstance(term.value, str):
            self.world.memory.texts.add((id(owner), name))
            self.world.note(f"{self.source.segment(target)} is a text: a controller does not have it")
            return
        self.world.memory.assign(owner, name)
        new = self.type_of(term)
        key = id(owner), name
        if new is None:
            raise self.refused(
                node, f"{self.source.segment(target)} is no number or state", "numbers, states, tuples of them"
            )
        if isinstance(new, NumpyNumber):
            self.world.memory.changed |= key not in self.world.memory.of_numpy
            self.world.memory.of_numpy.add(key)
        self.world.memory.learn(self.world.memory.fields, key, plain_number(new), lambda: self._odd(name, node))
        place = self.field(owner, name, base, target)
        if not isinstance(place, Code):
            return  # in the next pass it is a field
        if isinstance(plain(place.type), ArrayType):
            if isinstance(getattr(owner, name), list):
                raise self.refused(node, "a list is assigned as a whole", "its elements, one by one")
            if isinstance(term, Code) and not isinstance(term, Elements):
                self.share(term)
                self.share(place)
            if isinstance(place.type, ArrayType) and isinstance(term, Elements):
                self.fill(place.text, Elements(place.type, self.at(term, place.type.of, place.type.length)))
                self.impure += 1
                return
        self.line(f"{place.text} = {self.as_type(term, place.type, node)};")

    def _store_element(self, target: ast.Subscript, term: Term, node: ast.AST) -> None:
        term = self._settled(term)
        base, index = self.ordered([target.value, target.slice])
        if not (isinstance(base, Code) and isinstance(base.type, ArrayType)):
            raise self.refused(node, "an element of something that is not a list of numbers")
        if isinstance(target.value, ast.Attribute) and isinstance(owner := self.term(target.value.value), Known):
            self.world.memory.assign(owner.value, target.value.attr)
        self.check_sole(base, node)
        if isinstance(index, Code) and index.type == array(BOOL, base.type.length):
            self.overwrite(base, term, node, where=index)
            return
        if not base.type.listed and base.type.of != REAL and plain_number(self.code(term, node).type) == REAL:
            raise self.refused(node, "numbers of another type are set in the array", "int(...)")
        self.line(f"{base.text}.at[{self.index(base.type, index, node)}] = {self.as_type(term, base.type.of, node)};")

    # Ways ----------------------------------------------------------------------------------------------

    def _If(self, node: ast.If) -> bool | None:
        try:
            truth = self.truth(self.term(node.test), node.test)
        except NoTranslation as refused:
            if refused.reason != TELLS or self._does_something([*node.body, *node.orelse]):
                raise
            self.world.note(f"{self.source.segment(node.test)} decides only what is told: it is left out")
            return None
        if isinstance(truth, bool):
            self.known |= self.proved(node.test) if truth else self.disproved(node.test)
            return self.body(node.body if truth else node.orelse)
        before, names = set(self.known), dict(self.names)
        self.known |= self.proved(node.test)
        with self.block(f"if ({truth})", "}"):
            goes_on = self.body(node.body)
        after, self.known = self.known, before | self.disproved(node.test)
        one = self.names
        self.names = names
        other = True
        if node.orelse:
            self.lines.pop()
            self.line("} else {", pure=True)
            self.depth += 1
            other = self.body(node.orelse)
            self.depth -= 1
            self.line("}", pure=True)
        self._join(one, goes_on, other)
        self.known = self.known if not goes_on else after if not other else after & self.known
        return None if goes_on or other else False

    def _does_something(self, statements: Sequence[ast.stmt]) -> bool:
        """Whether more is left of statements than a text: a line, or a way out."""
        before = len(self.lines)
        goes_on = self.body(statements)
        return not goes_on or len(self.lines) > before

    def _join(self, one: dict[str, Any], goes_on: bool, other: bool) -> None:
        """The names after two ways, of which each may have ended."""
        if not goes_on:
            return
        if not other:
            self.names = one
            return
        self.names = {name: self.names[name] for name in one if self.names.get(name) == one[name]}

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
        self.loops.append((on, out, len(self.handlers)))
        self.body(statements)
        self.loops.pop()

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
        if any(f"goto {out};" in line for line in self.lines[at:]):
            self.line(f"{out}:;", pure=True)

    def elements(self, term: Term, node: ast.AST) -> list[Term]:
        if isinstance(term, Many):
            return list(term.terms)
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
        self.line(f"goto {label};" if label else plain, pure=True)
        return False

    def _Return(self, node: ast.Return) -> bool:
        term = Known(None) if node.value is None else self.term(node.value)
        self.results.append(term)
        self.sole_result = self.sole_result and self.is_sole(term)
        self.share(term)
        result = self.world.result_of(self, term, node)
        if result:
            self.line(f"*out = {result};")
        returning = [each for each in self.handlers if each.returning]
        if returning:
            returning[-1].uses += 1
            self.line(f"{returning[-1].returning} = true;", pure=True)
            self.line(f"goto {returning[-1].label};", pure=True)
        else:
            self.line("return UMO_OK;", pure=True)
        return False

    # Errors --------------------------------------------------------------------------------------------

    def _Raise(self, node: ast.Raise) -> bool:
        if node.exc is None:
            if not self.world.caught:
                raise self.refused(node, "`raise` outside of `except`")
            self.fail(self.world.caught[-1])
            return False
        error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        kind = self.term(error)
        if isinstance(kind, Known) and isinstance(kind.value, type) and issubclass(kind.value, BaseException):
            self.raises(kind.value, node, text=_said(node.exc, self.source.segment(node.exc)))
            return False
        raise self.refused(node, "the class of the error is not known when the code is generated", "raise Error(...)")

    def _Assert(self, node: ast.Assert) -> None:
        truth = self.truth(self.term(node.test), node.test)
        if truth is not True:
            self.raises(AssertionError, node, "true" if truth is False else f"!({truth})")
        self.known |= self.proved(node.test)

    def _Try(self, node: ast.Try) -> bool | None:
        returns = any(isinstance(each, ast.Return) for part in node.body + node.orelse for each in ast.walk(part))
        returns |= any(isinstance(each, ast.Return) for part in node.handlers for each in ast.walk(part))
        if node.finalbody:
            pending = self.temporary(INT, "pending")
            returning = self.temporary(BOOL, "returning") if returns else ""
            return self._with_finally(node, TryBlock(self.label("finally"), pending, returning=returning))
        return self._with_except(node)

    def _with_finally(self, node: ast.Try, handler: TryBlock) -> bool | None:
        self.line(f"{handler.variable} = UMO_OK;", pure=True)
        if handler.returning:
            self.line(f"{handler.returning} = false;", pure=True)
        self.handlers.append(handler)
        goes_on = self._with_except(node) if node.handlers or node.orelse else self.body(node.body)
        self.handlers.pop()
        if handler.uses:
            self.line(f"{handler.label}:;", pure=True)
        self.known.clear()
        self.body(node.finalbody)
        self.fail(f"(umo_fault){handler.variable}", f"{handler.variable} != UMO_OK")
        if handler.returning:
            outer = [each for each in self.handlers if each.returning]
            with self.block(f"if ({handler.returning})"):
                if outer:
                    outer[-1].uses += 1
                    self.line(f"{outer[-1].returning} = true;", pure=True)
                    self.line(f"goto {outer[-1].label};", pure=True)
                else:
                    self.line("return UMO_OK;", pure=True)
        return None if goes_on is not False else False

    def _with_except(self, node: ast.Try) -> bool | None:
        if not node.handlers:
            return self.body([*node.body, *node.orelse])
        caught, after = self.temporary(INT, "caught"), self.label("after")
        handler = TryBlock(self.label("except"), caught)
        self.handlers.append(handler)
        names = dict(self.names)
        goes_on = self.body(node.body)
        self.handlers.pop()
        if goes_on and node.orelse:
            goes_on = self.body(node.orelse)
        if not handler.uses:
            return None if goes_on else False
        after_body = self.names
        if goes_on:
            self.line(f"goto {after};", pure=True)
        self.line(f"{handler.label}:;", pure=True)
        others = self._caught(node.handlers, caught, after, names)
        self.known.clear()
        if goes_on or others:
            self.line(f"{after}:;", pure=True)
        self._join(after_body, goes_on is not False, others)
        return None if goes_on or others else False

    def _caught(self, handlers: list[ast.ExceptHandler], caught: str, after: str, names: dict[str, Any]) -> bool:
        goes_on = False
        first = True
        for each in handlers:
            kinds = self._kinds(each)
            self.names = dict(names)
            if each.name:
                self.names[each.name] = Known(object())
            self.world.caught.append(f"(umo_fault){caught}")
            with self.block(f"if ({self.world.is_a(caught, kinds)})"):
                if self.body(each.body):
                    goes_on = True
                    self.line(f"goto {after};", pure=True)
            self.world.caught.pop()
            first = False
        assert not first
        self.fail(f"(umo_fault){caught}")
        return goes_on

    def _kinds(self, handler: ast.ExceptHandler) -> tuple[type[BaseException], ...]:
        if handler.type is None:
            return (BaseException,)
        term = self.term(handler.type)
        found = term.value if isinstance(term, Known) else tuple(getattr(each, "value", None) for each in term.terms)  # type: ignore[union-attr]
        return found if isinstance(found, tuple) else (found,)

    def _With(self, node: ast.With) -> bool | None:
        """`with suppress(...)`."""
        call = node.items[0].context_expr
        if len(node.items) == 1 and isinstance(call, ast.Call):
            func = self.term(call.func)
            if isinstance(func, Known) and func.value is suppress:
                kinds = ast.Tuple(call.args, ast.Load())
                handler = ast.ExceptHandler(ast.copy_location(kinds, call), None, [ast.copy_location(ast.Pass(), node)])
                tried = ast.Try(node.body, [ast.copy_location(handler, node)], [], [])
                return self._Try(ast.copy_location(tried, node))
        raise self.refused(node, "`with` does not translate", "with suppress(...)")


def _is_quality(term: Term) -> bool:
    return isinstance(term, Known) and isinstance(term.value, Quality)


def _assigned(tree: ast.AST) -> list[ast.Name]:
    """The names to which a function assigns; what is changed in place is not among them."""
    changed = {id(each.target) for each in ast.walk(tree) if isinstance(each, ast.AugAssign)}
    names = (each for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    return [each for each in names if id(each) not in changed]


def _loaded(target: ast.AST) -> ast.expr:
    """The same place, to be read."""
    kind = type(target)
    fields = {name: value for name, value in ast.iter_fields(target) if name != "ctx"}
    found: ast.expr = kind(**fields, ctx=ast.Load()) if "ctx" in target._fields else target  # type: ignore[assignment,call-arg]
    return ast.copy_location(found, target)


def _said(error: ast.AST, text: str) -> str:
    """The message of an error as it is written."""
    if isinstance(error, ast.Call) and error.args:
        return (
            ast.unparse(error.args[0]).strip("'\"")
            if isinstance(error.args[0], ast.Constant)
            else ast.unparse(error.args[0])
        )
    return text


def _indexes_objects(node: ast.For) -> bool:
    """Whether the number of a loop is a place in a list: of objects, perhaps, so that each turn is written out."""
    assert isinstance(node.target, ast.Name)
    name = node.target.id
    indexed = [each.slice for part in node.body for each in ast.walk(part) if isinstance(each, ast.Subscript)]
    return any(isinstance(each, ast.Name) and each.id == name for index in indexed for each in ast.walk(index))
