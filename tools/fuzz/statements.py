"""Statements that translate."""

from __future__ import annotations

from collections.abc import Sequence

from tools.fuzz.expressions import LEVELS, LISTS, MODES, TEXTS, mode, optional, quality
from tools.fuzz.writer import Kind, WriteLines, Writer, indented


def _named(w: Writer, kind: Kind, value: str) -> list[str]:
    others = w.assignable(kind)
    name = w.new(kind[0]) if w.chance(0.6) or not others else w.pick(*others)
    w.names[kind].append(name)
    return [f"{name} = {value}"]


def _changed(w: Writer) -> list[str]:
    target = w.pick("self.s", "self.t", "self.part.gain", "self.spare.half", "self.row[0]", *w.assignable("real"))
    return [f"{target} {w.pick('+=', '-=', '*=', '/=', '//=', '%=')} {w.real()}"]


def _counted(w: Writer) -> list[str]:
    target = w.pick("self.c", "self.d", "self.part.count", "self.cells[1]", *w.assignable("whole"))
    return [f"{target} {w.pick('+=', '-=', '+=', '*=', '//=', '%=', '&=', '>>=')} {w.whole()}"]


def _element(w: Writer) -> list[str]:
    """An array is changed in place only where nobody else may have it."""
    array = w.new("self.only")
    w.once(f"{array} = np.array([1.0, 2.0, 3.0])")
    return [f"{array}[{w.pick('0', '1', '2', 'self.n % 3')}] {w.pick('=', '+=', '-=')} {w.real(1)}",
            f"self.s = float({array}[{w.pick('0', '1', '-1')}])"]  # fmt: skip


SIMPLE: Sequence[WriteLines] = [
    lambda w: _named(w, "real", w.real()),
    lambda w: _named(w, "real", w.real()),
    lambda w: _named(w, "whole", w.whole()),
    lambda w: _named(w, "truth", w.truth()),
    _changed,
    _counted,
    lambda w: [f"{w.pick('self.s', 'self.t', 'self.part.gain', 'self.spare.half')} = {w.real()}"],
    lambda w: [f"{w.pick('self.c', 'self.d')} = {w.whole()}"],
    lambda w: [f"self.yes = {w.truth()}"],
    lambda w: [f"self.last = {optional(w)}"],
    lambda w: [f"self.count = {w.pick('None', w.whole(1))}"],
    lambda w: [f"self.mode = {mode(w)} if {w.truth(1)} else Mode.{w.pick(*MODES)}"],
    lambda w: [f"self.level = Level.{w.pick(*LEVELS)} if {w.truth(1)} else Level.MORE"],
    lambda w: [f"self.phase = {w.pick(*TEXTS)}{w.pick('', f' if {w.truth(1)} else self.phase')}"],
    lambda w: [f"self.side = {w.pick('None', 'Mode.OFF', 'Mode.COOL', 'self.mode')}"],
    lambda w: [f"self.row[{w.pick('0', '1', '-1', w.whole(1))}] = {w.real(1)}"],
    lambda w: [f"self.cells[{w.pick('0', '1', '-1', w.whole(1))}] = {w.whole(1)}"],
    lambda w: [f"self.marks[{w.pick('0', '1')}] = {w.truth(1)}"],
    lambda w: [f"self.recent = (*self.recent[1:], {w.real(1)})"],
    lambda w: [f"self.{w.pick('array', 'other')} = {w.array()}"],
    _element,
    lambda w: [f"self.pair = Pair({w.real(1)}, {w.real(1)})"],
    lambda w: [f"self.a.write({w.real()})"],
    lambda w: [f"self.b.write({w.pick(w.real(1), w.whole(1), f'max(0, {w.real(1)})')})"],
    lambda w: [f"self.fan.write(OnOff.ON if {w.truth(1)} else OnOff.OFF)"],
    lambda w: [f"self.yes = self.{w.pick('a', 'b')}.write({w.real(1)})"],
    lambda w: [f"self.s, self.t = {w.real(1)}, {w.real(1)}"],
    lambda w: ["self.s, self.t = self.t, self.s"],
    lambda w: [f"self.{w.pick('bump', 'clears')}()"],
    lambda w: [f"self.two = ({w.whole(1)}, {w.real(1)})"],
    lambda w: ["self.c, self.s = self.two"],
    lambda w: [f"assert {w.truth(1)}"],
    lambda w: ["self.cycle.progress(f'{self.s} of {self.c}')"],
]


def _if(w: Writer) -> list[str]:
    lines = [f"if {w.truth()}:", *w.block()]
    if w.chance(0.3):
        lines += [f"elif {w.truth()}:", *w.block(2)]
    return [*lines, "else:", *w.block()] if w.chance(0.5) else lines


def _loop(w: Writer, head: str, name: str, kind: Kind) -> list[str]:
    with w.scope():
        w.names[kind].append(name)
        w.turns.add(name)
        body = w.block()
        if w.chance(0.4):
            body += indented([f"if {w.truth(1)}:", f"    {w.pick('break', 'continue')}"])
            body += w.block(1)
    return [head, *body, "else:", *w.block(1)] if w.chance(0.2) else [head, *body]


def _range(w: Writer) -> list[str]:
    name = w.new("k")
    ends = w.pick("3", f"{w.whole(1)} % 5", f"1, {w.whole(0)} % 6, 2", f"{w.whole(0)} % 5, 0, -1")
    return _loop(w, f"for {name} in range({ends}):", name, "whole")


def _over(w: Writer) -> list[str]:
    name, kind = w.new("e"), w.random.choice([*LISTS])
    over = w.pick(LISTS[kind], f"reversed({LISTS[kind]})")
    if kind == "real":
        over = w.pick(over, f"({w.real(1)}, 2.0)", "TABLE", "self.recent", "self.row[1:]")
    return _loop(w, f"for {name} in {over}:", name, kind)


def _zip(w: Writer) -> list[str]:
    number, name, other = w.new("k"), w.new("e"), w.new("e")
    w.turns |= {name, other}
    one, two = (w.pick("self.row", "self.cells", "TABLE", "reversed(self.cells)", f"({w.real(1)}, 2.0)") for _ in "12")
    turns = f"enumerate(zip({one}, {two}, strict=False))"
    lines = _loop(w, f"for {number}, ({name}, {other}) in {turns}:", number, "whole")
    return [lines[0], f"    self.s += {name} - {other}", *lines[1:]]


def _while(w: Writer) -> list[str]:
    name = w.new("q")
    first = f"{name} = {w.whole(1)} % 4"
    loop = _loop(w, f"while {name} > 0:", name, "whole")
    return [first, loop[0], f"    {name} -= 1", *loop[1:]]


def _try(w: Writer) -> list[str]:
    kind = w.pick("ZeroDivisionError", "ArithmeticError", "(ValueError, TypeError)", "Exception", "IndexError",
                  "RangeError", "BadInput", "LookupError")  # fmt: skip
    lines = ["try:", *w.block()]
    if w.chance(0.7):
        lines += [f"except {kind}:", *w.block(2)]
        if w.chance(0.2):
            lines += ["else:", *w.block(1)]
        if not w.chance(0.3):
            return lines
    with w.in_finally():
        return [*lines, "finally:", *w.block(2)]


def _function(w: Writer) -> list[str]:
    """A function in the function, which is called once or twice; it sees the names around it as they are then."""
    name, x, changed = w.new("f"), w.new("x"), w.new("v")
    value = w.real(1)
    w.names["real"].append(changed)
    with w.scope():
        w.names["real"].append(x)
        lines = [f"def {name}({x}: float, n: int = 2) -> float:", f"    if {w.truth(1)}:"]
        lines += [f"        return {w.real(1)}", f"    return {x} * {w.real(1)} * n"]
    lines += [f"self.s = {name}({w.real(1)})", f"{changed} = {w.real(1)}"]
    return [f"{changed} = {value}", *lines, f"self.t = {name}({changed}, n=3)"]


def _match(w: Writer) -> list[str]:
    subject, cases = w.random.choice([
        ("self.mode", ("Mode.OFF | Mode.HEAT", "Mode.COOL")), ("self.side", ("None", "Mode.OFF", "Mode.COOL")),
        ("self.step", ("0", "1 | 2", "3")), ("self.phase", ("'idle'", "'heat' | 'hold'")),
        ("self.cells[0]", ("1", "2 | 3", "-1")),
    ])  # fmt: skip
    lines = [f"match {subject}:"]
    for case in cases:
        lines += [f"    case {case}{f' if {w.truth(1)}' if w.chance(0.2) else ''}:", *indented(w.block(2))]
    return [*lines, "    case _:", *indented(w.block(2))] if w.chance(0.7) else lines


def _returned(w: Writer) -> list[str]:
    if not w.may_return:
        return [f"self.yes = {w.truth()}"]
    return [f"if {w.truth(1)}:", *w.block(1), "    return"]


def _raised(w: Writer) -> list[str]:
    if not w.may_return:
        return [f"self.c = {w.whole()}"]
    return [f"if {w.truth(1)}:", f"    raise {w.pick('ValueError', 'ZeroDivisionError', 'RangeError')}('no')"]


def _walrus(w: Writer) -> list[str]:
    name = w.new("found")
    with w.scope():
        test = f"if ({name} := {w.real(1)}) > 1.0:"
        w.names["real"].append(name)
        return [test, f"    self.s = {name}", *w.block(1)]


def _parts(w: Writer) -> list[str]:
    name = w.new("part")
    return [f"for {name} in self.parts:", *w.block(2), f"    {name}.gain += {w.real(1)}"]


OF_MAYBE = (
    "self.s += self.maybe", "self.recent = (*self.recent[1:], self.maybe)", "self.pair = Pair(self.maybe, self.s)",
    "self.row[0] = max([self.maybe, 1.0])",
)  # fmt: skip
"""Statements where it is not None."""
COMPOUND: Sequence[WriteLines] = [
    _if,
    _if,
    _if,
    _range,
    _over,
    _zip,
    _while,
    _try,
    _match,
    _walrus,
    _returned,
    _raised,
    _function,
    lambda w: ["with suppress(ZeroDivisionError, ValueError):", *w.block(2)],
    _parts,
    lambda w: [f"if self.x.quality is Quality.{quality(w)}:", *w.block(2)],
    lambda w: ["if self.maybe is not None:", f"    {w.pick(*OF_MAYBE)}", *w.block(1)],
]
