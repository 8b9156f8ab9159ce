"""Prints functions of the form as C: declarations, statements, and jumps at faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from umo.generate.c_types import BOOL, NOTHING, ArrayType, CType, OptionalType, TupleType
from umo.generate.check.form_effects import goes_on
from umo.generate.emit.c_text import comment
from umo.generate.emit.fault_tests import IS_LIMIT, tests_of
from umo.generate.emit.form_values import FormValues
from umo.generate.form import (
    Address,
    Assign,
    Begin,
    CallStatement,
    CheckedArithmetic,
    Choose,
    CountedLoop,
    Elements,
    EndlessLoop,
    Fail,
    Field,
    Finally,
    FunctionForm,
    If,
    Labelled,
    Leave,
    Literal,
    Local,
    MachineForm,
    NextTurn,
    Object,
    ObjectOf,
    OfObject,
    Return,
    RuntimeCall,
    Statement,
    Statements,
    Temporary,
    TextStatement,
    Try,
    TupleOf,
    Value,
    WholeMachine,
    walk,
)
from umo.generate.translation import ControllerTarget

INDENT = "    "
OVERFLOWS = {name: f"__builtin_{name}_overflow" for name in ("add", "sub", "mul")} | {"shift_left": "!umo_shift_left"}
"""Conditions in C. Each is true if the result exceeds 32 bits, and otherwise stores the result."""
OF_MACHINE = WholeMachine, Field, Object, ObjectOf, OfObject
"""Classes of values whose text in C names the machine."""


@dataclass
class FaultTarget:
    """The label to which faults lead inside `try`."""

    label: str
    variable: str
    """The variable that keeps the fault."""
    returning: str = ""
    """The variable that records a return; "" if nothing is done on the way out."""


@dataclass
class FunctionText:
    """The text of one function while it is printed."""

    function: FunctionForm
    program: MachineForm
    values: FormValues
    lines: list[str] = field(default_factory=list)
    depth: int = 1
    ways: list[FaultTarget] = field(default_factory=list)
    loops: list[str] = field(default_factory=list)
    """The labels of the loops that contain the statement."""
    leads_to: set[str] = field(default_factory=set)
    """The labels to which a `goto` leads."""
    has_fault: bool = False
    line: int = 0
    """The line of Python of the statement."""
    shown: int = 0
    """The line printed last."""
    records_places: bool = False
    """True if Python needs the place at which a fault of the runtime occurred."""

    def text(self) -> str:
        """Return the whole function."""
        one = self.function
        self.body(one.body)
        if not one.body or not isinstance(one.body[-1], Return | Fail):
            self.put("return UMO_OK;")
        out = [] if one.result == NOTHING else [f"{one.result.name} *out"]
        parameters = ["umo_machine *m", *(f"{of.name} {name}" for name, of in one.parameters), *out]
        place = f": {comment(one.file)}:{one.line}" if one.line else ""
        head = [f"/* {comment(one.title)}{place} */", f"static umo_fault {one.name}({', '.join(parameters)})", "{"]
        return "\n".join([*head, *self._declared(), *self.lines, "}"]) + "\n"

    def _declared(self) -> Iterator[str]:
        used = list(walk(*self.function.body))
        names = {each.name for each in used if isinstance(each, Local | Temporary)}
        for name, of in self.function.variables:
            if name in names:
                yield f"{INDENT}{_declaration(name, of)}"
        if self.has_fault:
            yield f"{INDENT}umo_fault fault = UMO_OK;"
        if not any(isinstance(each, OF_MACHINE) for each in used):
            yield f"{INDENT}(void)m;"
        for name, _ in self.function.parameters:
            if name not in names:
                yield f"{INDENT}(void){name};"

    # Lines ---------------------------------------------------------------------------------------------

    def put(self, text: str) -> None:
        """Add a line. The first line of each new line of Python has a comment with its number."""
        told = ""
        if self.line and self.line != self.shown:
            self.shown = self.line
            told = f" /* {comment(self.function.file.rpartition('/')[2])}:{self.line} */"
        self.lines.append(f"{INDENT * self.depth}{text}{told}")

    @contextmanager
    def block(self, head: str, tail: str = "}") -> Iterator[None]:
        self.put(f"{head} {{")
        self.depth += 1
        yield
        self.depth -= 1
        self.lines.append(f"{INDENT * self.depth}{tail}")

    def place(self, label: str) -> None:
        """Add a label if something jumps to it."""
        if label in self.leads_to:
            self.put(f"{label}:;")

    def go(self, label: str) -> None:
        self.leads_to.add(label)
        self.put(f"goto {label};")

    def body(self, statements: Statements) -> None:
        rest = list(statements)
        while rest:
            each = rest.pop(0)
            self.line = each.line or self.line
            if isinstance(each, CallStatement) and not self.ways and rest and rest[0] == Return():
                self.put(f"return {self.call(each)};")
                rest.pop(0)
            else:
                PRINTED[type(each)](self, each)

    # Ways out ------------------------------------------------------------------------------------------

    def fail(self, fault: str) -> None:
        if not self.ways:
            self.put(f"return {fault};")
            return
        self.put(f"{self.ways[-1].variable} = {fault};")
        self.go(self.ways[-1].label)

    def fails(self, each: Fail) -> None:
        named = isinstance(each.fault, int)
        self.fail(self.program.faults[each.fault] if named else f"(umo_fault){self.values.text(each.fault)}")  # type: ignore[index,arg-type]

    def returns(self, each: Return) -> None:
        if each.value is not None:
            self.put(f"*out = {self.values.text(each.value)};")
        self.leave_function()

    def leave_function(self) -> None:
        around = [way for way in self.ways if way.returning]
        if not around:
            self.put("return UMO_OK;")
            return
        self.put(f"{around[-1].returning} = true;")
        self.go(around[-1].label)

    def tried(self, each: Try) -> None:
        number, caught = self._number(), each.caught.name
        way, after = FaultTarget(f"except_{number}", caught), f"after_{number}"
        self.ways.append(way)
        self.body(each.body)
        self.ways.pop()
        self.body(each.orelse)
        if goes_on((*each.body, *each.orelse)):
            self.go(after)
        self.place(way.label)
        tests = tests_of(self.program)
        head = "if"
        for handler in each.handlers:
            self.put(f"{head} ({tests[handler.kinds]}({caught})) {{")
            self._inner(handler.body)
            head = "} else if"
        self.put("} else {")
        self.depth += 1
        self.fail(f"(umo_fault){caught}")
        self.depth -= 1
        self.put("}")
        self.place(after)

    def _inner(self, body: Statements) -> None:
        self.depth += 1
        self.body(body)
        self.depth -= 1

    def finally_(self, each: Finally) -> None:
        returning = "" if each.returning is None else each.returning.name
        pending = "" if each.pending is None else each.pending.name
        way = FaultTarget(f"finally_{self._number()}", pending, returning)
        if pending:
            self.put(f"{pending} = UMO_OK;")
        if returning:
            self.put(f"{returning} = false;")
        self.ways.append(way)
        self.body(each.body)
        self.ways.pop()
        self.place(way.label)
        if pending and self.program.limits:
            with self.block(f"if ({IS_LIMIT}({pending}))"):
                self.fail(f"(umo_fault){pending}")
        self.body(each.last)
        if not goes_on(each.last):
            for name in filter(None, (pending, returning)):
                self.put(f"(void){name};")
            return
        if pending:
            with self.block(f"if ({pending} != UMO_OK)"):
                self.fail(f"(umo_fault){pending}")
        if returning:
            with self.block(f"if ({returning})"):
                self.leave_function()

    def _number(self) -> int:
        self.tries += 1
        return self.tries

    tries: int = 0
    """The number of `try` statements so far."""

    # Statements ----------------------------------------------------------------------------------------

    def assign(self, each: Assign) -> None:
        self.put(f"{self.values.text(each.place)} = {self.values.text(each.value)};")

    def call(self, each: CallStatement) -> str:
        arguments = [self.values.text(one) for one in each.arguments]
        if each.out is not None:
            arguments.append(self.values.text(each.out if isinstance(each.out, Elements) else Address(each.out)))
        called = f"{each.function}({', '.join(arguments)})"
        if not self.records_places or each.function in self.program.own:
            return called
        return f"umo_at(m, {self.program.files.index(self.function.file)}, {self.line}, {called})"

    def called(self, each: CallStatement) -> None:
        self._tried(self.call(each))

    def text_statement(self, each: TextStatement) -> None:
        given = ", ".join(f"&{self.values.text(one)}" for one in each.given) or "NULL"
        self._tried(f"umo_tell(m, {each.number}, (const void *const[]){{{given}}})")

    def _tried(self, call: str) -> None:
        self.has_fault = True
        self.put(f"fault = {call};")
        with self.block("if (fault != UMO_OK)"):
            self.fail("fault")

    def checked(self, each: CheckedArithmetic) -> None:
        operands = self.values.texts((each.left, each.right, Address(each.place)))
        with self.block(f"if ({OVERFLOWS[each.what]}({operands}))"):
            self.fail(self.program.faults[each.fault])

    def choose(self, each: Choose) -> None:
        is_constant = all(isinstance(one, Literal | TupleOf) for one in walk(*each.values))
        kind = "static const " if is_constant else ""
        values = ", ".join(map(self.initial, each.values))
        self.put(f"{kind}{each.of.name} {each.table}[{len(each.values)}] = {{{values}}};")
        self.put(f"{self.values.text(each.place)} = {each.table}[{self.values.text(each.index)}];")

    def initial(self, value: Value) -> str:
        """Return an initial value, in braces if it needs them."""
        if isinstance(value, TupleOf):
            return f"{{{', '.join(map(self.initial, value.parts))}}}"
        return self.values.text(value)

    def if_(self, each: If, head: str = "if") -> None:
        self.put(f"{head} ({self.values.text(each.test)}) {{")
        self._inner(each.body)
        if len(each.orelse) == 1 and isinstance(each.orelse[0], If):
            self.line = each.orelse[0].line or self.line
            self.if_(each.orelse[0], "} else if")
            return
        if each.orelse:
            self.lines.append(f"{INDENT * self.depth}}} else {{")
            self._inner(each.orelse)
        self.lines.append(f"{INDENT * self.depth}}}")

    def forever(self, each: EndlessLoop) -> None:
        self._loop("for (;;)", each)

    def count(self, each: CountedLoop) -> None:
        turn, first, end = (self.values.text(one) for one in (each.turn, each.first, each.end))
        sign = "<" if each.step > 0 else ">"
        step = {1: f"{turn}++", -1: f"{turn}--"}.get(each.step, f"{turn} += {each.step}")
        declared = "" if each.of is None else f"{each.of.name} "
        self._loop(f"for ({declared}{turn} = {first}; {turn} {sign} {end}; {step})", each)

    def _loop(self, head: str, each: EndlessLoop | CountedLoop) -> None:
        self.loops.append(each.label)
        with self.block(head):
            self.body(each.body)
        self.loops.pop()
        self.place(each.label)

    def labelled(self, each: Labelled) -> None:
        self.body(each.body)
        self.place(each.label)

    def leave(self, each: Leave) -> None:
        if self.loops and self.loops[-1] == each.label:
            self.put("break;")
        else:
            self.go(each.label)

    def next(self, each: NextTurn) -> None:
        assert self.loops[-1] == each.label
        self.put("continue;")

    def begin(self, each: Begin) -> None:
        name = self.values.text(each.place)
        if each.value is None:
            self.put(_declaration(name, each.of))
        else:
            self.put(f"{each.of.name} {name} = {self.values.text(each.value)};")

    def do(self, each: RuntimeCall) -> None:
        self.put(f"{self.values.text(each.call)};")


PRINTED: dict[type[Statement], Callable[[FunctionText, Any], None]] = {
    Assign: FunctionText.assign,
    Begin: FunctionText.begin,
    RuntimeCall: FunctionText.do,
    CallStatement: FunctionText.called,
    TextStatement: FunctionText.text_statement,
    CheckedArithmetic: FunctionText.checked,
    Choose: FunctionText.choose,
    If: FunctionText.if_,
    EndlessLoop: FunctionText.forever,
    CountedLoop: FunctionText.count,
    Labelled: FunctionText.labelled,
    Leave: FunctionText.leave,
    NextTurn: FunctionText.next,
    Fail: FunctionText.fails,
    Try: FunctionText.tried,
    Finally: FunctionText.finally_,
    Return: FunctionText.returns,
}
"""The printer of each kind of statement."""


def function_text(function: FunctionForm, program: MachineForm, target: ControllerTarget) -> str:
    return FunctionText(function, program, FormValues(target), records_places=target.makes_texts).text()


def statements_text(statements: Sequence[Statement], target: ControllerTarget) -> list[str]:
    """Return assignments, one per line."""
    function = FunctionForm("", "", "", 0, (), (), NOTHING, tuple(statements))
    printed = FunctionText(function, MachineForm(), FormValues(target))
    printed.body(function.body)
    return printed.lines


def _declaration(name: str, of: CType) -> str:
    if isinstance(of, ArrayType):
        return f"{of.name} {name} = {{{{0}}}};"
    if isinstance(of, OptionalType):
        return f"{of.name} {name} = {{.has = false}};"
    zero = "{0}" if isinstance(of, TupleType) else "false" if of == BOOL else "0"
    return f"{of.name} {name} = {zero};"
