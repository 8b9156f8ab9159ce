"""Collects the form of one function while it is lowered: statements, variables, errors and known values."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

from umo.errors import text_of
from umo.generate.c_types import (
    CType,
)
from umo.generate.check.form_effects import changes
from umo.generate.form import (
    Assign,
    CallStatement,
    Fail,
    If,
    Local,
    Statement,
    Temporary,
    Value,
)
from umo.generate.function_source import SourcedFunction
from umo.generate.known_values import KnownValues, Unwatchable
from umo.generate.lower.flow import KnownFlow
from umo.generate.lower.live_fields import LiveFields
from umo.generate.lower.subjects import (
    AskedOfAliases,
    AskedOfArrays,
    AskedOfAssignments,
    AskedOfAttributes,
    AskedOfBuiltins,
    AskedOfCalls,
    AskedOfChoices,
    AskedOfErrors,
    AskedOfExpressions,
    AskedOfGenerators,
    AskedOfLoops,
    AskedOfRings,
    AskedOfSequences,
    AskedOfTexts,
    AskedOfValues,
    AskedOfVectors,
)
from umo.generate.lower.terms import Code, Term
from umo.generate.lower.translation_memory import TranslationMemory
from umo.generate.names import identifier
from umo.generate.translation import ControllerTarget, TextMaker, Untranslatable

UNEXPECTED_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
"""Errors that the lowering of a statement may raise unexpectedly."""


class NoTranslation(Exception):
    """Raised if a piece of Python cannot be translated."""

    def __init__(self, node: ast.AST, reason: str, nearest: str = "") -> None:
        super().__init__(reason)
        self.node, self.reason, self.nearest = node, reason, nearest


class FunctionBuilder:
    """Collects the statements of one function while it is lowered. It has the subjects of the lowering."""

    values: AskedOfValues
    aliases: AskedOfAliases
    texts: AskedOfTexts
    expressions: AskedOfExpressions
    arrays: AskedOfArrays
    vectors: AskedOfVectors
    attributes: AskedOfAttributes
    calls: AskedOfCalls
    builtins: AskedOfBuiltins
    choices: AskedOfChoices
    generators: AskedOfGenerators
    assignments: AskedOfAssignments
    loops: AskedOfLoops
    sequences: AskedOfSequences
    rings: AskedOfRings
    errors: AskedOfErrors
    of_expressions: Mapping[type[ast.AST], Callable[[Any], Term]]
    """The subject of each class of expressions."""
    of_statements: Mapping[type[ast.AST], Callable[[Any], bool | None]]

    def __init__(self, world: CodeContext, source: SourcedFunction, key: Any, name: str) -> None:
        self.world, self.source, self.key, self.c_name = world, source, key, name
        self.statements: list[Statement] = []
        """The statements of the innermost body that is being lowered."""
        self.depth = 0
        """The number of bodies around it."""
        self.variables: dict[Value, CType] = {}
        """Local names and temporaries that are declared in the function."""
        self.parameters: dict[str, CType] = {}
        self.given: dict[Value, CType] = {}
        """The parameters in C."""
        self.results: list[Term | None] = []
        self.line = 0
        """The line of the statement that is being lowered."""
        self.flow = KnownFlow()
        self._locals: dict[str, Local] = {}
        self._labels = 0

    # Statements ----------------------------------------------------------------------------------------

    def add(self, statement: Statement) -> None:
        self.statements.append(statement.at(self.line))

    def changed_since(self, at: int) -> bool:
        """True if the statements of the body from this index on may change the value of an expression that was computed
        before them."""
        return any(map(changes, self.statements[at:]))

    @contextmanager
    def body_of(self) -> Iterator[list[Statement]]:
        """Return a context for the body of a branch or a loop. Facts that are proved inside hold only inside."""
        known = set(self.flow.known)
        with self.one_of_two() as found:
            yield found
        self.flow.known &= known

    @contextmanager
    def gathered(self) -> Iterator[list[Statement]]:
        """Return a context that collects statements without adding them here. They may be added later."""
        around, self.statements = self.statements, []
        try:
            yield self.statements
        finally:
            self.statements = around

    @contextmanager
    def one_of_two(self) -> Iterator[list[Statement]]:
        """Return a context that collects the statements of one of two branches."""
        self.depth += 1
        try:
            with self.gathered() as found:
                yield found
        finally:
            self.depth -= 1

    def add_if(self, test: Value, *body: Statement) -> None:
        self.add(If(test, tuple(each.at(self.line) for each in body)))

    def assign(self, place: Value, value: Value) -> None:
        self.add(Assign(place, value))

    def label(self, what: str) -> str:
        self._labels += 1
        return f"{what}_{self._labels}"

    def temporary(self, of: CType, what: str = "t") -> Temporary:
        number = 1 + len(self.variables)
        while (name := Temporary(f"{what}{number}")) in self.variables:
            number += 1
        self.variables[name] = of
        return name

    @property
    def own_parameters(self) -> list[Value]:
        return [self.local(name) for name in self.parameters]

    def local(self, name: str) -> Local:
        """Return the variable of a local name. The name is unique, because only names of locals have an underscore
        after `v`."""
        found = self._locals.get(name)
        if found is None:
            text, others = f"v_{identifier(name)}", {each.name for each in self._locals.values()}
            while text in others:
                text += "_"
            found = self._locals[name] = Local(text, of_generator=" " in name)
        return found

    def add_parameter(self, name: str, given: CType, of: CType) -> None:
        """Add a parameter. If the function assigns a wider type to the parameter, the parameter gets a variable of that
        type inside the function."""
        self.parameters[name] = self.flow.names[name] = of
        local = self.local(name)
        if of == given:
            self.given[local] = given
            return
        before = Local(f"given_{local.name}")
        self.given[before] = given
        self.variables[local] = of
        self.assign(local, self.values.as_type(Code(given, before), of, self.source.tree))

    def term(self, node: ast.AST) -> Term:
        """Return the term of an expression. If the expression is proved not to be None, the term is not optional.
        Statements that the term needs are added."""
        lower = self.of_expressions.get(type(node))
        if lower is None:
            raise self.refused(
                node, "this cannot be translated", "numbers, states, comparisons, arithmetic, calls of functions"
            )
        return self.flow.proved(lower(node), node)

    def ordered(self, nodes: Sequence[ast.AST], lower: Callable[[ast.AST], Term] | None = None) -> list[Term]:
        """Return the terms of several expressions, computed in this order."""
        terms: list[Term] = []
        for each in nodes:
            with self.gathered() as rest:
                new = (lower or self.term)(each)
            if any(map(changes, rest)):  # what was computed before may change: it is kept under a name
                terms = [old if self.values.is_list_itself(old) else self.values.settled(old) for old in terms]
            self.statements += rest
            terms.append(new)
        return terms

    def body(self, statements: Sequence[ast.stmt]) -> bool:
        """Lower statements in order. Return False if the end of the statements is not reached."""
        for each in statements:
            lower = self.of_statements.get(type(each))
            if lower is None:
                raise self.refused(
                    each, "this statement cannot be translated", "if, for, while, try, raise, return, assignments"
                )
            around, self.line = self.line, getattr(each, "lineno", self.line)
            try:
                if lower(each) is False:
                    return False
            except UNEXPECTED_ERRORS as error:
                raise self.refused(each, f"it cannot be translated ({text_of(error)})") from error
            finally:
                self.line = around
        return True

    # Faults --------------------------------------------------------------------------------------------

    def raises(
        self, kind: type[BaseException], node: ast.AST, test: Value | None = None, text: str | None = None
    ) -> None:
        """Add the error that Python raises here if the condition holds."""
        failure = Fail(self.fault(kind, node, text))
        if test is None:
            self.add(failure)
        else:
            self.add_if(test, failure)

    def fault(self, kind: type[BaseException], node: ast.AST, text: str | None = None) -> int:
        """Return the number of the fault for an error that Python raises here."""
        said = self.source.segment(node) if text is None else text
        return self.world.fault(kind, said, self.source, getattr(node, "lineno", 0))

    def called(self, function: str, *arguments: Value, out: Value | None = None) -> None:
        """Add a call that may fail."""
        self.add(CallStatement(function, arguments, out))
        self.flow.forget_fields()

    # What is taken as known ------------------------------------------------------------------------------

    def takes(self, owner: Any, name: str, node: ast.AST) -> None:
        """Record that an attribute of a live object is taken as known here."""
        self._taken(partial(self.world.known.attribute, owner, name), node)

    def takes_variable(self, name: str, node: ast.AST) -> None:
        """Record that a name of the module or of an enclosing function is taken as known here."""
        self._taken(partial(self.world.known.variable, self.source.function, name), node)

    def takes_class(self, owner: Any, name: str, node: ast.AST) -> None:
        """Record that a tracked number may be an attribute of its object's class."""
        self._taken(partial(self.world.known.tracked, owner, name), node)

    def _taken(self, take: Callable[[tuple[str, int]], None], node: ast.AST) -> None:
        try:
            take((self.source.file, getattr(node, "lineno", 0)))
        except Unwatchable as error:
            raise self.refused(node, str(error), "an ordinary attribute, or a tuple") from None

    def refused(self, node: ast.AST, reason: str, nearest: str = "") -> NoTranslation:
        return NoTranslation(node, reason, nearest)


class CodeContext(Protocol):
    """The machine and its other functions."""

    memory: TranslationMemory
    fields: LiveFields
    known: KnownValues
    """The values that are taken as known."""
    target: ControllerTarget
    on_host: list[Untranslatable]
    """Code that works only on this computer."""

    def table(self, slots: Sequence[int]) -> str:
        """Return the name of a table of slots."""

    def fault(self, kind: type[BaseException], text: str, source: SourcedFunction, line: int) -> int:
        """Return the number of a fault."""

    def note(self, text: str) -> None:
        """Add a note about the generated C for the user."""

    def note_inexact(self, name: str) -> None:
        """Add a note that the results of this function may differ from those of Python."""

    def host_call(self, owner: Any, name: str) -> int:
        """Return the number of a request to the host."""

    def text_maker(self, text_maker: TextMaker) -> int:
        """Return the number of a text that Python makes."""

    def only_makes_texts(self, statements: Iterable[Statement]) -> bool:
        """True if these statements only make texts."""

    def result_of(self, scope: FunctionBuilder, term: Term, node: ast.AST) -> Value | None:
        """Return a result as a value, or None if there is no result."""

    def invoke(
        self, caller: FunctionBuilder, source: SourcedFunction, terms: Mapping[str, Term], node: ast.AST
    ) -> Term:
        """Return the result of a call of a function."""

    def changed_by(self, functions: Set[str]) -> set[Value]:
        """Return the arrays that these C functions change in place."""
