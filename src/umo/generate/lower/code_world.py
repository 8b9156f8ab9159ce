"""The functions of one machine while they are translated, once for each object and each combination of argument
types."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence, Set
from contextlib import suppress
from types import FunctionType
from typing import Any

from umo.errors import TaskFailed
from umo.generate.c_types import (
    BOOL,
    NOTHING,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    OptionalType,
    is_number,
    joined,
    plain,
)
from umo.generate.form import (
    CallStatement,
    ErrorHandler,
    Field,
    FunctionForm,
    Local,
    MachineForm,
    Return,
    Statement,
    Struct,
    Temporary,
    TextStatement,
    Value,
    WholeMachine,
    root,
    statements,
    whole,
)
from umo.generate.function_source import SourcedFunction
from umo.generate.known_values import KnownValues, Unwatchable
from umo.generate.lower.function_builder import FunctionBuilder, NoTranslation
from umo.generate.lower.function_lowering import FunctionLowering
from umo.generate.lower.live_fields import LiveFields, LiveStruct, _hinted_parameter
from umo.generate.lower.lowered_values import only_asked
from umo.generate.lower.terms import NO_VALUE, Code, Known, NullTest, SliceView, Term, TruthTest, TupleTerm, UnknownText
from umo.generate.lower.translation_memory import Learner, TranslationMemory
from umo.generate.names import identifier
from umo.generate.translation import (
    FIRST_FAULT,
    NO_HOST,
    RUNTIME_FAULTS,
    CodeFault,
    ControllerLimit,
    ControllerTarget,
    TextMaker,
    Untranslatable,
)


class TranslatedFunction:
    """A function of the form, and the result of a call of this function."""

    def __init__(
        self,
        name: str,
        result: CType,
        live: Known | None,
        form: FunctionForm | None,
        scope: FunctionBuilder | None = None,
    ) -> None:
        self.name, self.result, self.live, self.form = name, result, live, form
        self.keeps = scope is not None and scope.aliases.keeps
        """True if arguments that are arrays may have other references after the call."""
        self.changes: set[Value] = set() if scope is None else scope.aliases.changes
        """Arrays that a call changes in place."""
        self.sole = scope is not None and scope.aliases.sole_result
        """True if an array that the function returns has no other reference."""


class CodeWorld:
    """One pass over the functions of a machine."""

    def __init__(self, memory: TranslationMemory, target: ControllerTarget) -> None:
        self.memory, self.target = memory, target
        self.fields = LiveFields(memory)
        self.known = KnownValues()
        self.functions: dict[Any, TranslatedFunction] = {}
        self._learners: dict[Any, Learner] = {}
        """The lowering of each function, by key."""
        self.faults: list[CodeFault] = []
        self._faults: dict[tuple[str, str, str, int], int] = {}
        """The numbers of faults, by class, text, file and line."""
        self.kinds: dict[int, type[BaseException]] = {
            n: _class(kind) for n, (_, kind, _) in enumerate(RUNTIME_FAULTS, 1)
        }
        self.problems: list[Untranslatable] = []
        self.refused_conditions = False
        self.notes: list[str] = []
        self.on_host: list[Untranslatable] = []
        self.hosts: list[tuple[Any, str]] = []
        self.text_makers: list[TextMaker] = []
        self._under_way: list[Any] = []
        self._names: set[str] = set()
        self._kept: list[Any] = []
        self._tables: dict[tuple[int, ...], str] = {}
        """The names of tables of slots."""

    # What functions ask for ----------------------------------------------------------------------------

    def fault(self, kind: type[BaseException], text: str, source: SourcedFunction, line: int) -> int:
        key = kind.__name__, text, source.file, line
        if key in self._faults:
            return self._faults[key]
        number = self._faults[key] = FIRST_FAULT + len(self.faults)
        name = f"FAULT_{number}_{identifier(source.name).upper()}_{identifier(kind.__name__)}"
        self.faults.append(CodeFault(number, kind.__name__, text, source.file, line, name))
        self.kinds[number] = kind
        return number

    def note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)

    def note_inexact(self, name: str) -> None:
        if not self.target.exact_libm:
            self.note(f"{name} may differ from Python in its last bit: it is a function of the target's library")

    def host_call(self, owner: Any, name: str) -> int:
        found = next((n for n, (each, called) in enumerate(self.hosts) if each is owner and called == name), None)
        if found is None:
            self.hosts.append((owner, name))
            found = len(self.hosts) - 1
        return found

    def text_maker(self, text_maker: TextMaker) -> int:
        self.text_makers.append(text_maker)
        return len(self.text_makers) - 1

    def only_makes_texts(self, statements: Iterable[Statement]) -> bool:
        """True if these statements only make texts."""
        return all(map(self._tells, statements))

    def _tells(self, statement: Statement) -> bool:
        if isinstance(statement, CallStatement):
            called = next((each.form for each in self.functions.values() if each.name == statement.function), None)
            return called is not None and statement.out is None and self.only_makes_texts(called.body)
        return isinstance(statement, TextStatement) or statement == Return()

    def result_of(self, scope: FunctionBuilder, term: Term, node: ast.AST) -> Value | None:
        """Return a result as a value, or None if there is no result."""
        of = scope.values.type_of(term)
        if isinstance(term, NullTest | TruthTest):
            raise scope.refused(node, *only_asked(term))
        if of is None:
            if isinstance(term, Known):
                if any(map(_is_code, scope.results)):
                    raise scope.refused(
                        node, "the function returns an object here and a number elsewhere", "only one of the two"
                    )
                return None
            if isinstance(term, TupleTerm) and any(
                isinstance(scope.values.type_of(each), MixedNumber) for each in term.terms
            ):
                raise scope.refused(node, "the tuple has a number that may be an int or a float", "0.0, float(...)")
            raise scope.refused(node, "the result is not a number, a state or a tuple of these")
        of = self.memory.learn(self.memory.results, scope.key, of, lambda: _odd(node))
        return None if of == NOTHING else scope.values.as_type(term, of, node)

    # Functions -----------------------------------------------------------------------------------------

    def invoke(self, caller: Any, source: SourcedFunction, terms: Mapping[str, Term], node: ast.AST) -> Term:
        """Return the result of a call of a function. The function is translated first if necessary."""
        given: dict[str, CType | Known] = {}
        arguments: list[Value] = []
        for name, term in terms.items():
            of = self._parameter(caller, source.function, name, term, node)
            given[name] = of
            if not isinstance(of, Known):
                arguments.append(caller.values.as_type(term, of, node))
        shared = [term for term in terms.values() if isinstance(term, Code)]
        found = self.translated(source, given, node, caller)
        for term in shared:
            place = term.base if isinstance(term, SliceView) else term.value
            if isinstance(plain(term.type), ArrayType) and whole(place) in found.changes:
                raise NoTranslation(node, "the function changes an array that also has another name in it", "a copy")
        caller.aliases.changes |= {each for each in found.changes if isinstance(root(each), Field)}
        for term in shared if found.keeps else []:
            caller.aliases.share(term)
        if found.live is not None and found.form is None:
            return found.live
        if found.result == NOTHING:
            caller.called(found.name, WholeMachine(), *arguments)
            return found.live or Known(None)
        result = caller.temporary(found.result)
        caller.called(found.name, WholeMachine(), *arguments, out=result)
        if found.sole:
            caller.aliases.sole.add(result)
        return Code(found.result, result)

    def changed_by(self, functions: Set[str]) -> set[Value]:
        """Return the arrays that these C functions change in place."""
        return set[Value]().union(*(each.changes for each in self.functions.values() if each.name in functions))

    def _parameter(
        self, caller: FunctionBuilder, function: FunctionType, name: str, term: Term, node: ast.AST
    ) -> CType | Known:
        hinted = _hinted_parameter(function, name) if name in function.__annotations__ else None
        if isinstance(term, Known):
            self._kept.append(term.value)
            if isinstance(hinted, OptionalType) and term.value is None:
                return hinted
            if type(term.value) in (int, float, bool):
                return self._as_hinted(self.fields.type_of_value(term.value) or NOTHING, hinted)
            return term
        if isinstance(term, TupleTerm):
            if term.kind in (None, list) and all(isinstance(each, Known) for each in term.terms):
                live = tuple(each.value for each in term.terms)  # type: ignore[union-attr]
                self._kept.append(live)
                return Known(live)
            of = caller.values.type_of(term)
            if of is not None:
                return of
        if isinstance(term, Code):
            return self._as_hinted(term.type, hinted)
        raise NoTranslation(node, f"the argument {name!r} is not a value that a controller can hold")

    @staticmethod
    def _as_hinted(of: CType, hinted: CType | None) -> CType:
        """Return the type of an argument whose parameter is annotated with another type. A bool stays a bool."""
        if of == BOOL:
            return of
        if (hinted == REAL and is_number(of)) or (
            isinstance(hinted, OptionalType) and (of == hinted.of or is_number(of))
        ):
            with suppress(TypeError):
                return joined(of, hinted)
        return of

    def translated(
        self,
        source: SourcedFunction,
        given: Mapping[str, CType | Known],
        node: ast.AST,
        caller: FunctionBuilder | None,
    ) -> TranslatedFunction:
        self._kept += source.enclosed
        key = (
            source.function.__code__,
            tuple(_identity(each) for each in source.enclosed),
            tuple((n, ("live", _identity(g.value)) if isinstance(g, Known) else g) for n, g in given.items()),
        )
        if key in self.functions:
            self._learners[key].used_by(self.memory.current.learner)
            return self.functions[key]
        if key in self._under_way:
            raise NoTranslation(node, "the function calls itself", "a loop")
        try:
            self.known.function(source.function, (source.file, source.tree.lineno))
        except Unwatchable as error:
            raise NoTranslation(node, str(error), "a tuple") from None
        self._under_way.append(key)
        try:
            self.functions[key] = found = self._translate(source, given, key)
            self._learners[key] = self.memory.current.learner
        finally:
            self._under_way.pop()
        return found

    def _translate(self, source: SourcedFunction, given: Mapping[str, CType | Known], key: Any) -> TranslatedFunction:
        scope = FunctionLowering(self, source, key, self._name(source, given))
        try:
            return self._lowered(scope, source, given, key)
        finally:
            scope.end()

    def _lowered(
        self, scope: FunctionBuilder, source: SourcedFunction, given: Mapping[str, CType | Known], key: Any
    ) -> TranslatedFunction:
        for name, of in given.items():
            scope.flow.names[name] = of
            if not isinstance(of, Known):
                scope.add_parameter(name, of, self.memory.learn(self.memory.locals, (key, name), of, lambda: None))
        statements = source.tree.body
        if isinstance(statements, ast.expr):
            statements = [ast.copy_location(ast.Return(statements), statements)]
        problems, ends = len(self.problems), True
        for each in statements:
            try:
                ends = scope.body([each])
            except NoTranslation as refused:
                self._told(scope, refused, problems)
            if ends is False:
                break
        if ends is not False:
            scope.results.append(Known(None))
            value = None
            gives = (self.memory.results.get(key) or NOTHING) != NOTHING or any(map(_is_code, scope.results))
            if gives and len(self.problems) == problems:
                value = self.result_of(scope, Known(None), source.tree)
            scope.add(Return(value))
        result = self.memory.results.get(key) or NOTHING
        for of in (*scope.variables.values(), *scope.given.values(), result):
            self.fields.use(of)
        live = self._live_result(scope, result)
        is_left_out = live is not None and all(isinstance(each, Return) for each in scope.statements)
        form = None if is_left_out else _function(scope, source, result)
        return TranslatedFunction(scope.c_name, result, live, form, scope)

    def _told(self, scope: FunctionBuilder, refused: NoTranslation, before: int) -> None:
        """Record an obstacle once per place. Obstacles that only follow from it are not reported."""
        if NO_VALUE[0] in refused.reason and len(self.problems) > before:
            return
        line = getattr(refused.node, "lineno", 0)
        source = scope.source.segment(refused.node) if line else scope.source.name
        new = Untranslatable(scope.source.file, line, source, refused.reason, refused.nearest)
        if new not in self.problems:
            self.problems.append(new)

    def _live_result(self, scope: FunctionBuilder, result: CType) -> Known | None:
        first, *rest = [*scope.results, None][:-1] or [Known(None)]
        if isinstance(first, Known) and all(each == first for each in rest):
            return first
        objects = [each for each in scope.results if isinstance(each, Known) and self._is_object(each.value)]
        if objects and result != NOTHING:
            told = scope.refused(
                scope.source.tree, "the function returns an object here and a number elsewhere", "only one of the two"
            )
            self._told(scope, told, len(self.problems))
        if result == NOTHING and any(isinstance(each, Known) and each.value is not None for each in scope.results):
            told = scope.refused(scope.source.tree, "the function returns different objects", "one object per call")
            self._told(scope, told, len(self.problems))
        return None

    def _is_object(self, value: Any) -> bool:
        return value is not None and self.fields.type_of_value(value) is None

    def _name(self, source: SourcedFunction, given: Mapping[str, CType | Known]) -> str:
        first = next(iter(given.values()), None)
        owner = first.value if isinstance(first, Known) else None
        known = self.fields.structs.get(id(owner))
        stem = source.name.rpartition(".")[2].strip("_")
        base = f"py_{known.member}_{identifier(stem)}" if known is not None else f"py_{identifier(stem)}"
        name, number = base, 2
        while name in self._names:
            name, number = f"{base}_{number}", number + 1
        self._names.add(name)
        return name

    def forget_stale(self) -> None:
        """Forget the functions whose lowering may now give a different result."""
        for key in [key for key, learner in self._learners.items() if learner.is_stale]:
            del self.functions[key], self._learners[key]

    # The whole -----------------------------------------------------------------------------------------

    def table(self, slots: Sequence[int]) -> str:
        return self._tables.setdefault(tuple(slots), f"vector_{len(self._tables)}")

    def program(self) -> MachineForm:
        """Return the functions of the machine, in the form."""
        functions = [each.form for each in self.functions.values() if each.form is not None]
        names = {each.number: each.name for each in self.faults}
        handled = dict.fromkeys(each.kinds for each in statements(*functions) if isinstance(each, ErrorHandler))
        return MachineForm(
            records=self.fields.records(),
            structs=[_struct(each) for each in self.fields.filled],
            tables={name: slots for slots, name in self._tables.items()},
            functions=functions,
            begin=tuple(self.fields.begin()) if not self.problems else (),
            faults=names,
            handled={kinds: self._caught(kinds) for kinds in handled},
            limits=[names[n] for n, kind in self.kinds.items() if issubclass(kind, ControllerLimit)],
        )

    def _caught(self, kinds: tuple[type[BaseException], ...]) -> list[str]:
        """Return the names of the faults that a handler of these classes catches."""
        names = {n: name for n, (name, _, _) in enumerate(RUNTIME_FAULTS, 1)} | {
            each.number: each.name for each in self.faults
        }
        return [
            names[n] for n, kind in self.kinds.items() if issubclass(kind, kinds) and self._is_caught(n, kind, kinds)
        ]

    def _is_caught(self, number: int, kind: type[BaseException], kinds: tuple[type[BaseException], ...]) -> bool:
        """True if a handler of these classes catches a fault. A ControllerLimit is never caught, and a missing host
        only by a handler that names TaskFailed."""
        return not issubclass(kind, ControllerLimit) and (number != NO_HOST or TaskFailed in kinds)


def _odd(node: ast.AST) -> None:
    raise NoTranslation(node, "the results have different types", "one type")


def _is_code(term: Term | None) -> bool:
    return isinstance(term, Code | TupleTerm)


def _identity(value: Any) -> Any:
    """Return what distinguishes two live values. A tuple is made again in each pass, so its elements are compared."""
    if type(value) is tuple:
        return tuple(map(_identity, value))
    is_plain = value is None or (isinstance(value, str | bytes) and not isinstance(value, UnknownText))
    return value if is_plain else id(value)


def _class(name: str) -> type[BaseException]:
    import umo.errors

    return getattr(umo.errors, name)  # type: ignore[no-any-return]


def _function(scope: FunctionBuilder, source: SourcedFunction, result: CType) -> FunctionForm:
    def named(found: Mapping[Value, CType]) -> tuple[tuple[str, CType], ...]:
        return tuple((each.name, of) for each, of in found.items() if isinstance(each, Local | Temporary))

    variables = {each: of for each, of in scope.variables.items() if each not in scope.given}
    line = source.function.__code__.co_firstlineno
    body = tuple(scope.statements)
    return FunctionForm(
        scope.c_name, source.name, source.file, line, named(scope.given), named(variables), result, body
    )


def _struct(live: LiveStruct) -> Struct:
    title = f"{live.path or 'the machine'}: {type(live.owner).__qualname__}"
    return Struct(live.member, title, tuple(live.fields.items()))
