"""Broken drivers that are generated: eight correct ones with one change of their syntax tree each.

An operator stands for a kind of mistake (`KINDS`). `generated(seed, count)` gives so many mutants, the kinds and the
drivers in turns, `later()` all of the kinds that were found to be missed later; `Generated.name` tells one. Some change
nothing that a driver promises: they stand in equivalent.txt, each with its argument.
"""

from __future__ import annotations
import __future__

import ast
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from conformance import careful as careful_module
from conformance import odd as odd_module
from conformance import plain as plain_module
from conformance.subjects import careful, memory, of_plain
from umo.testing.conformance import Certificate, Subject, all_rules, conform
from umo.testing.conformance.rules import THEMES

SOURCES = {module.__name__: module for module in (careful_module, odd_module, plain_module)}
EQUIVALENT = Path(__file__).with_name("equivalent.txt")


@dataclass(frozen=True)
class Correct:
    """A correct driver, the classes whose code is changed, and its subject."""

    name: str
    subject: Callable[[type[Any]], AbstractContextManager[Subject]]
    classes: tuple[str, ...]
    """MODULE:CLASS, the driver's own first, then those that it is derived from."""

    def unchanged(self) -> type[Any]:
        """The driver, made as a mutant is made."""
        return _made(self)


def _derived(name: str) -> Correct:
    return Correct(name, careful, (f"conformance.odd:{name}", "conformance.careful:Careful"))


DRIVERS = (
    Correct("Careful", careful, ("conformance.careful:Careful",)),
    _derived("OneByOne"),
    _derived("SendsChangesOnly"),
    _derived("ChecksWhatItWrote"),
    _derived("GreetsTheDevice"),
    Correct("TwoBytes", of_plain, ("conformance.plain:TwoBytes", "conformance.plain:Bytes", "conformance.plain:Plain")),
    Correct("Scpi", of_plain, ("conformance.plain:Scpi", "conformance.plain:Plain")),
    Correct("Memory", memory, ("conformance.odd:Memory",)),
)
SIZES = (1, 2, 4, 8, 12, 16, 64, 65535)
"""Numbers that stand for a width."""
STAGES = ("open", "close", "drop", "begin", "connect", "connected", "initialize", "reset")
Change = Callable[[ast.AST], Iterator[ast.AST]]
"""Function that gives what may stand in the place of a node."""


# The operators ------------------------------------------------------------------------------------


def order(node: ast.AST) -> Iterator[ast.AST]:
    """The order of bytes, channels, statements and arguments."""
    match node:
        case ast.Constant(value="big"):
            yield ast.Constant("little")
        case ast.Call(func=ast.Name(id="zip"), args=[first, second, *rest]):
            backwards = ast.Call(ast.Name("reversed", ast.Load()), [second], [])
            yield ast.Call(node.func, [first, backwards, *rest], node.keywords)
        case ast.For(iter=ast.Name()):
            yield ast.For(node.target, ast.Call(ast.Name("reversed", ast.Load()), [node.iter], []), node.body, [])
        case ast.FunctionDef(body=[*before, first, second]) if not isinstance(second, ast.Return):
            yield _with(node, body=[*before, second, first])
        case ast.Tuple(elts=[first, second], ctx=ast.Load()):
            yield ast.Tuple([second, first], ast.Load())


def width(node: ast.AST) -> Iterator[ast.AST]:
    """Numbers of bits and bytes, and where a part of the data ends."""
    match node:
        case ast.Constant(value=int(number)) if not isinstance(number, bool) and number in SIZES:
            yield ast.Constant(number - 1 if number > 1 else 2)
            yield ast.Constant(number // 2)
        case ast.Subscript(slice=ast.Slice(lower=lower, upper=upper)) if lower or upper:
            yield ast.Subscript(node.value, ast.Slice(upper, None), node.ctx) if upper else node.value
        case ast.Call(func=ast.Attribute(attr="recv"), args=[most]):
            yield ast.Call(node.func, [ast.BinOp(most, ast.Add(), ast.Constant(1))], [])


def sign(node: ast.AST) -> Iterator[ast.AST]:
    """The sign of levels and readings."""
    match node:
        case ast.Constant(value=bool(flag)):
            yield ast.Constant(not flag)
        case ast.Name(id="raw", ctx=ast.Load()):
            yield ast.Call(ast.Name("abs", ast.Load()), [node], [])
            yield ast.UnaryOp(ast.USub(), node)
        case ast.UnaryOp(op=ast.USub()):
            yield node.operand
        case ast.Call(func=ast.Name(id="int"), args=[ast.expr()]):
            yield ast.UnaryOp(ast.USub(), node)


def scale(node: ast.AST) -> Iterator[ast.AST]:
    """Levels that are off by one or a factor."""
    match node:
        case ast.Name(id="raw", ctx=ast.Load()):
            yield ast.BinOp(node, ast.Add(), ast.Constant(1))
            yield ast.BinOp(node, ast.Mult(), ast.Constant(2))
        case ast.Attribute(attr="lowest" | "highest", ctx=ast.Load()):
            yield ast.BinOp(node, ast.Add(), ast.Constant(1))
            yield ast.BinOp(node, ast.Sub(), ast.Constant(1))
        case ast.Attribute(attr="number", ctx=ast.Load()):
            yield ast.BinOp(node, ast.Add(), ast.Constant(1))


def time(node: ast.AST) -> Iterator[ast.AST]:
    """Timeouts and deadlines."""
    match node:
        case ast.Attribute(attr="timeout" | "deadline", ctx=ast.Load()) if isinstance(node.value, ast.Name):
            yield ast.BinOp(node, ast.Mult(), ast.Constant(10))
            yield ast.BinOp(node, ast.Mult(), ast.Constant(0.1))
        case ast.Call(func=ast.Attribute(attr="left")):
            yield ast.Attribute(ast.Name("self", ast.Load()), "timeout", ast.Load())
            yield ast.Constant(5.0)
        case ast.Call(func=ast.Attribute(attr="settimeout")):
            yield ast.Constant(None)
        case ast.Compare(left=ast.Call(func=ast.Name(id="monotonic")), ops=[ast.Gt()]):
            yield ast.Constant(False)
        case ast.ExceptHandler(type=ast.Name(id="TimeoutError")):
            yield _with(node, type=ast.Name("ZeroDivisionError", ast.Load()))


def buffer(node: ast.AST) -> Iterator[ast.AST]:
    """What has come in, and the arrays of blocks."""
    match node:
        case ast.AugAssign(op=ast.Add(), target=ast.Name(id=name)):
            yield ast.Assign([node.target], node.value)
            yield ast.Assign([node.target], ast.BinOp(node.value, ast.Add(), ast.Name(name, ast.Load())))
        case ast.Subscript(value=ast.Name(id="out"), slice=ast.Name()):
            yield ast.Subscript(node.value, ast.Constant(0), node.ctx)
        case ast.While(test=ast.Compare()):
            yield ast.If(node.test, node.body, [])
        case ast.Compare(left=ast.Call(func=ast.Name(id="len")), ops=[ast.Lt() | ast.GtE() | ast.NotEq()]):
            yield _with(node, comparators=[ast.BinOp(node.comparators[0], ast.Sub(), ast.Constant(1))])
        case ast.Call(func=ast.Name(id="enumerate"), args=[items]):
            yield ast.Call(node.func, [items, ast.Constant(1)], [])
        case ast.For(iter=items):
            yield _with(node, body=[*node.body, ast.Break()])
            yield _with(node, iter=_cut(ast.Call(ast.Name("list", ast.Load()), [items], []), ast.Constant(1), None))
        case ast.Name(id="data" | "answer" | "raws", ctx=ast.Load()):
            yield _cut(node, None, ast.Constant(-1))
        case ast.Call(func=ast.Attribute(attr="tolist")):
            yield ast.Call(ast.Name("sorted", ast.Load()), [node], [])


def state(node: ast.AST) -> Iterator[ast.AST]:
    """What a driver keeps between two calls."""
    match node:
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]) | ast.AugAssign(target=ast.Attribute()):
            yield ast.Pass()
        case ast.Expr(value=ast.Call(func=ast.Attribute(attr="pop"))):
            yield ast.Pass()
        case ast.Compare(ops=[ast.IsNot()]):
            yield _with(node, ops=[ast.Is()])
        case ast.Compare(ops=[ast.Is()]):
            yield _with(node, ops=[ast.IsNot()])


def life(node: ast.AST) -> Iterator[ast.AST]:
    """Opening, closing, initialising and resetting: one step of it is left out."""
    match node:
        case ast.FunctionDef() if node.name in STAGES:
            for number, step in enumerate(node.body):
                if not isinstance(step, ast.Assert | ast.Return):
                    yield _with(node, body=[ast.Pass() if i == number else each for i, each in enumerate(node.body)])
        case ast.Expr(value=ast.Call(func=ast.Attribute(attr="drop" | "close"))):
            yield ast.Pass()


def lines(node: ast.AST) -> Iterator[ast.AST]:
    """What is wrong with an answer is not noticed, or not told."""
    match node:
        case ast.If(body=[*_, ast.Raise()]):
            yield ast.If(ast.Constant(False), node.body, node.orelse)
        case ast.Raise(exc=None):
            yield ast.Return(ast.List([ast.Tuple([ast.Constant(0)] * 2, ast.Load())], ast.Load()))
        case ast.Raise():
            yield ast.Pass()
        case ast.BoolOp(values=[first, *rest]):
            yield first
            yield rest[-1]
        case ast.Compare(left=ast.Tuple(elts=[_, *left]), comparators=[ast.Tuple(elts=[_, *right])]):
            yield ast.Compare(ast.Tuple(left, ast.Load()), node.ops, [ast.Tuple(right, ast.Load())])


KINDS: dict[str, Change] = {
    each.__name__: each for each in (order, width, sign, scale, time, buffer, state, life, lines)
}


# Operators of later kinds: what is added to a function --------------------------------------------


def _code(text: str) -> list[ast.stmt]:
    return ast.parse(text).body


def form(node: ast.AST) -> Iterator[ast.AST]:
    """The form of a block differs from that of single transfers."""
    match node:
        case ast.FunctionDef(name="write_many", body=body):
            yield _with(node, body=[*_code(UNCHANGED_LEFT_OUT), *body, *_code("self.__dict__['old'] = now")])
            yield _with(node, body=[ast.Try(body, _code("try: pass\nexcept TimeoutError: pass")[0].handlers, [], [])])  # type: ignore[attr-defined]
        case ast.FunctionDef(name="read_many", body=body):
            again = _code("try: pass\nexcept OSError: pass")[0].handlers[0]  # type: ignore[attr-defined]
            yield _with(node, body=[ast.Try(body, [_with(again, body=body)], [], [])])


def kept(node: ast.AST) -> Iterator[ast.AST]:
    """What is done with is kept for as long as the driver is."""
    match node:
        case ast.Expr(value=ast.Call(func=ast.Attribute(attr="close", value=ast.Attribute() as what))):
            yield _code(f"self.__dict__.setdefault('_kept', []).append({ast.unparse(what)})")[0]
        case ast.FunctionDef(name="read" | "write", body=body, args=ast.arguments(args=[_, channel, *_])):
            yield _with(node, body=[*_code(f"self.__dict__.setdefault('_seen', []).append([{channel.arg}])"), *body])


def stages(node: ast.AST) -> Iterator[ast.AST]:
    """Each stage of a call has the timeout."""
    match node:
        case ast.Expr(value=ast.Call(func=ast.Attribute(attr="connect"))):
            yield ast.If(ast.Constant(True), [node, *_code("self.begin()")], [])
        case ast.Assign(value=ast.Call(func=ast.Attribute(attr="connected"))):
            yield ast.If(ast.Constant(True), [node, *_code("deadline = monotonic() + self.timeout")], [])


def thread(node: ast.AST) -> Iterator[ast.AST]:
    """A thread of the driver asks the device while nothing is called."""
    match node:
        case ast.FunctionDef(name="open", body=body):
            yield _with(node, body=[*body, *_code(ASKS_BY_ITSELF)])
        case ast.FunctionDef(name="close", body=body):
            yield _with(node, body=[*_code("import threading\nthreading.Thread(target=threading.Event().wait, "
                                           "args=(20.0,), daemon=True).start()"), *body])  # fmt: skip


UNCHANGED_LEFT_OUT = """
now = dict(zip((c.text for c in channels), raws.tolist()))
new = [i for i, c in enumerate(channels) if self.__dict__.get('old', {}).get(c.text) != now[c.text]]
channels, raws = tuple(channels[i] for i in new), raws[new]
"""
ASKS_BY_ITSELF = """
import threading, time
def ask():
    from conformance.device import READ, frame
    while self.is_open:
        time.sleep(0.02)
        try:
            with socket.create_connection((self.host, self.port), 0.1) as own:
                own.settimeout(0.1)
                own.sendall(frame(1, READ, [(40, 0)]))
                own.recv(100)
        except OSError:
            pass
threading.Thread(target=ask, daemon=True).start()
"""
LATER_KINDS: dict[str, Change] = {each.__name__: each for each in (form, kept, stages, thread)}
ALL_KINDS = KINDS | LATER_KINDS
ANY_KIND = {"answers", "kind of errors", "range"}
"""Rules that any change may break: nothing works, another exception than an OSError is raised, levels are wrong."""
RIGHT_RULES = {
    "order": {"one beyond", "directions", "block read", "block write", "block failures", "reopen", "look"},
    "width": {"one beyond", "reading", "garbled answer", "short answer", "answer in pieces", "look", "long run"},
    "sign": {"one beyond", "block read", "block write", "reading", "reset", "look"},
    "scale": {"one beyond", "directions", "block read", "block write", "old answer"},
    "time": {"timeout", "one deadline", "patience", "late answer", "look", "idle"},
    "buffer": {
        "one beyond", "directions", "block read", "block write", "block buffers", "block failures", "short answer",
        "garbled answer", "answer in pieces", "error answer",
    },
    "state": {
        "block failures", "reset", "reopen", "reset after failure", "timeout", "late answer", "old answer", "vanish",
        "two clients", "fresh", "look", "levels kept",
    },
    "life": {
        "block failures", "initialise", "reset", "finalise", "reopen", "reset after failure", "timeout", "late answer",
        "vanish", "look", "levels kept", "idle", "descriptors", "end",
    },
    "lines": {
        "channels", "one beyond", "directions", "block failures", "timeout", "one deadline", "late answer",
        "old answer", "short answer", "garbled answer", "error answer", "vanish", "look", "watchdog", "idle",
    },
    "form": {"block write", "timeout", "retry", "reset after failure", "vanish", "two clients"},
    "kept": {"descriptors", "long run", "memory"},
    "stages": {"one deadline"},
    "thread": {"watchdog", "descriptors"},
}  # fmt: skip
"""The rules that are right to catch a mutant of this kind, beside those for any kind."""


def _with(node: Any, **fields: Any) -> ast.AST:
    """A copy of a node with other fields."""
    return type(node)(**{name: getattr(node, name) for name in node._fields} | fields)


def _cut(node: ast.expr, lower: ast.expr | None, upper: ast.expr | None) -> ast.Subscript:
    """A part of a sequence."""
    return ast.Subscript(node, ast.Slice(lower, upper), ast.Load())


# The mutants --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Generated:
    """One change of one correct driver."""

    correct: Correct
    kind: str
    owner: str
    """MODULE:CLASS whose code is changed."""
    site: int
    choice: int
    """Number of the node in the class, and of what may stand in its place."""
    words: str

    @property
    def name(self) -> str:
        return f"{self.correct.name}, {self.kind}: {self.owner.partition(':')[2]}.{self.words}"

    def driver(self) -> type[Any]:
        """The driver with this change."""
        return _made(self.correct, self)


class _Replaced(ast.NodeTransformer):
    """Puts a node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> Any:
        return self.new if node is self.old else self.generic_visit(node)


@cache
def _source(owner: str) -> str:
    """The text of a class."""
    module, _, name = owner.partition(":")
    text = Path(SOURCES[module].__file__ or "").read_text("utf-8")
    tree = next(each for each in ast.parse(text).body if isinstance(each, ast.ClassDef) and each.name == name)
    return ast.get_source_segment(text, tree) or ""


def _class(owner: str) -> ast.ClassDef:
    tree = ast.parse(_source(owner)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return tree


def _replaced(owners: tuple[str, ...]) -> set[str]:
    """Functions that derived classes have in the place of those that they are derived from, and do not call."""
    found = set[str]()
    for owner in owners:
        names = vars(vars(SOURCES[owner.partition(":")[0]])[owner.partition(":")[2]])
        found |= {name for name in names if f"super().{name}(" not in _source(owner)}
    return found


def _made(correct: Correct, mutant: Generated | None = None) -> type[Any]:
    """A driver whose classes are made anew, one of them with a change."""
    made: dict[str, Any] = {}
    for owner in reversed(correct.classes):
        module, _, name = owner.partition(":")
        tree = _class(owner)
        if mutant is not None and owner == mutant.owner:
            node = list(ast.walk(tree))[mutant.site]
            tree = _Replaced(node, list(ALL_KINDS[mutant.kind](node))[mutant.choice]).visit(tree)
        made[name] = _executed(module, tree, made)[name]
    kept: type[Any] = made[correct.classes[0].partition(":")[2]]
    return kept


def _executed(module: str, tree: ast.ClassDef, made: dict[str, Any]) -> dict[str, Any]:
    """The names of the module, with the class made anew, derived from those that were."""
    names = vars(SOURCES[module]) | made
    whole = ast.fix_missing_locations(ast.Module([tree], []))
    exec(compile(whole, SOURCES[module].__file__ or "", "exec", __future__.annotations.compiler_flag), names)
    return names


def _sites(correct: Correct, kind: str) -> Iterator[Generated]:
    """Every change of this kind of the driver."""
    for place, owner in enumerate(correct.classes):
        tree, dead = _class(owner), _replaced(correct.classes[:place])
        bodies = [each for each in tree.body if isinstance(each, ast.FunctionDef) and each.name not in dead]
        functions = {id(node): each.name for each in bodies for node in ast.walk(each)}
        left_out = set(_left_out(tree))
        for site, node in enumerate(ast.walk(tree)):
            if id(node) not in functions or id(node) in left_out:
                continue
            for choice, new in enumerate(ALL_KINDS[kind](node)):
                line = f"{functions[id(node)]}:{getattr(node, 'lineno', 0) - tree.lineno}"
                words = f"{line}: {_words(node, new)}"
                yield Generated(correct, kind, owner, site, choice, words)


def _left_out(tree: ast.ClassDef) -> Iterator[int]:
    """Nodes of texts, annotations and `strict=True`, which never matters."""
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        if isinstance(node, ast.JoinedStr):
            parts = [node]
        elif isinstance(node, ast.arg | ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, ast.FunctionDef):
            parts = [node.returns, *node.decorator_list]
        elif isinstance(node, ast.keyword) and node.arg == "strict":
            parts = [node.value]
        for part in filter(None, parts):
            yield from map(id, ast.walk(part))


def _words(old: ast.AST, new: ast.AST) -> str:
    """Both in one line; of a function only the lines that differ."""
    one, other = (ast.unparse(ast.fix_missing_locations(each)).splitlines() for each in (old, new))
    if len(one) > 1:
        one, other = [each for each in one if each not in other], [each for each in other if each not in one]
    if not one and not other:
        return "its last two statements exchanged"
    texts = (" / ".join(map(str.strip, each))[:100] for each in (one, other))
    return " -> ".join(texts)


@cache
def later() -> tuple[Generated, ...]:
    """Every mutant of the later kinds. Only a device of requests has what a thread asks for."""
    found = [each for kind in LATER_KINDS for correct in DRIVERS for each in _sites(correct, kind)]
    asking = [each for each in found if "def ask" not in each.words or each.correct.subject is careful]
    return tuple({(each.correct, each.kind, each.words): each for each in asking}.values())


@cache
def generated(seed: int, count: int) -> tuple[Generated, ...]:
    """So many mutants: each kind of each driver in turns, no change twice."""
    found = dict[tuple[str, str, str], Generated]()
    pools = {(kind, correct.name): list(_sites(correct, kind)) for kind in KINDS for correct in DRIVERS}
    for name, pool in pools.items():
        Random(f"{seed} {name}").shuffle(pool)
    while len(found) < count and any(pools.values()):
        for pool in pools.values():
            while pool and len(found) < count:
                each = pool.pop()
                if found.setdefault((each.owner, each.kind, each.words), each) is each:
                    break
    return tuple(found.values())


def equivalent() -> dict[str, str]:
    """Why a mutant breaks no promise, by its name: two lines of equivalent.txt each, the second with the argument."""
    lines = [each for each in EQUIVALENT.read_text("utf-8").splitlines() if each and not each.startswith("#")]
    return dict(zip(lines[::2], map(str.strip, lines[1::2]), strict=True))


def rightly_caught(mutant: Generated, certificate: Certificate) -> bool:
    """Whether the certificate names a rule that is right for the kind, or a call that hangs, which any rule names."""
    right = ANY_KIND | RIGHT_RULES[mutant.kind]
    return any(each.rule in right or "did not end within" in each.why for each in certificate.failed)


STAGED = (("channel", "value", "block", "lifecycle", "general"), tuple(THEMES))
"""Themes of rules that are tried first, as they take little time, and if these are kept."""
CYCLES = 300
"""Cycles of a run at most: what adds up is seen after so many."""


def judged(mutant: Generated) -> Certificate:
    """The certificate of a mutant, of the first stage that fails: the quick rules, all of them with a bounded number of
    cycles, the long run in its whole length."""
    for themes in STAGED:
        rules = [rule.id for rule in all_rules() if rule.theme in themes]
        certificate = _certificate(mutant, rules, CYCLES)
        if not certificate.passed:
            return certificate
    return _certificate(mutant, ["long run"], None)


def _certificate(mutant: Generated, rules: list[str], cycles: int | None) -> Certificate:
    with mutant.correct.subject(mutant.driver()) as subject:
        return conform(subject, only=rules, cycles=cycles)
