"""Expressions that translate, by their types: what they give in Python always has this type."""

from __future__ import annotations

from collections.abc import Sequence

from tools.fuzz.writer import Kind, Write, Writer

SIGNS = "<", "<=", ">", ">=", "==", "!="
REALS = "0.0", "1.0", "-1.0", "0.5", "2.5", "-2.0", "3.0", "100.0", "1e300", "0.1", "-0.0"
WHOLES = "0", "1", "2", "3", "-1", "7", "-5", "100", "65536"
TEXTS = "'idle'", "'heat'", "'hold'", "''"
MODES, LEVELS = ("OFF", "HEAT", "COOL"), ("NONE", "SOME", "MORE")
LISTS: dict[Kind, str] = {"real": "self.row", "whole": "self.cells", "truth": "self.marks"}


def sign(w: Writer) -> str:
    return w.pick(*SIGNS)


def mode(w: Writer) -> str:
    return f"Mode.{w.pick(*MODES)}"


def level(w: Writer) -> str:
    return w.pick("self.level", *(f"Level.{each}" for each in LEVELS))


def some_list(w: Writer) -> str:
    """A list or a tuple of real numbers."""
    return w.pick("self.row", f"({w.real()}, {w.real()})", "TABLE", "self.recent", "reversed(self.row)", "self.row[1:]")


def _generator(w: Writer, over: str) -> str:
    """One that does something with each."""
    with w.without_calls():
        return f"each * {w.real()} for each in {over}"


def _weighted(w: Writer) -> str:
    name = w.new("e")
    with w.without_calls():
        return f"sum({name} * other for {name}, other in zip(self.row, {w.pick('TABLE', 'self.recent')}, strict=True))"


def _listed(w: Writer) -> str:
    with w.without_calls():
        return (
            f"[number * {w.real()} for number, _ in enumerate({w.pick('self.row', 'reversed(self.row)')})]"
            f"[{w.pick('0', '1', '2', '-1')}]"
        )


def _any(w: Writer) -> str:
    """Its name may be one of the function, too, which stays what it is."""
    each = [*w.names["real"], "each"][0]
    with w.without_calls():
        tests = w.pick(f"{each} {sign(w)} {w.real()}", f"{each} > {w.real(0)} and {w.truth(0)}")
        left_out = w.pick("", f" if {each} {sign(w)} {w.pick('0.0', '1.0')}")
    return f"{w.pick('any', 'all')}({tests} for {each} in {some_list(w)}{left_out})"


def _no_division(w: Writer) -> str:
    """A quotient of numbers that the filter lets pass."""
    with w.without_calls():
        return f"any({w.real()} / each > 1.0 for each in (self.u, {w.real()}) if each > {w.pick('0.0', '1.0')})"


LEAVES: dict[Kind, Sequence[Write]] = {
    "real": [
        lambda w: w.local("real", "self.u"),
        lambda w: w.local("real", "self.s"),
        lambda w: w.pick("self.u", "self.v", "self.s", "self.t", "self.u", "self.s"),
        lambda w: w.pick("self.part.gain", "self.pair.first", "self.row[1]", "self.part.half", "self.recent[0]"),
        lambda w: w.pick(*REALS),
        lambda w: w.pick("self.x.read()", "self.a.pending", "self.a.minimum", "self.now", "self.dt", "self.bias"),
    ],
    "whole": [
        lambda w: w.local("whole", "self.n"),
        lambda w: w.pick("self.n", "self.i", "self.c", "self.d"),
        lambda w: w.pick("self.cells[2]", "self.part.count", "self.two[0]", "self.step"),
        lambda w: w.pick(*WHOLES),
    ],
    "truth": [
        lambda w: w.local("truth", "self.on"),
        lambda w: w.pick("self.on", "self.yes", "self.marks[0]", "(self.maybe is None)", "(self.last is not None)"),
    ],
}
EXPRESSIONS: dict[Kind, Sequence[Write]] = {
    "real": [
        lambda w: f"({w.real()} {w.pick('+', '-', '*', '/', '//', '%')} {w.real()})",
        lambda w: f"({w.real()} {w.pick('+', '-', '*', '/')} {w.real()})",
        lambda w: f"({w.real()} {w.pick('+', '-', '*', '/', '//', '%')} {w.whole()})",
        lambda w: f"({w.whole()} {w.pick('+', '-', '*', '/', '//', '%')} {w.real()})",
        lambda w: f"({w.whole()} / {w.whole()})",
        lambda w: f"(-{w.real()})",
        lambda w: f"abs({w.real()})",
        lambda w: f"{w.pick('max', 'min')}({w.real()}, {w.real()})",
        lambda w: f"{w.pick('max', 'min')}({w.real()}, {w.real()}, {w.real()})",
        lambda w: f"max({w.real()}, min({w.real()}, {w.real()}))",
        lambda w: f"float({w.pick(w.whole(), w.truth(), w.real(), f'max(0, {w.real()})')})",
        lambda w: f"({w.real()} if {w.truth()} else {w.real()})",
        lambda w: f"({w.real()} {w.pick('and', 'or')} {w.real()})",
        lambda w: f"math.{w.pick('sqrt', 'fabs', 'log', 'exp', 'sin', 'cos', 'tan', 'atan')}({w.real()})",
        lambda w: f"math.{w.pick('asin', 'acos', 'log10', 'degrees', 'radians')}({w.real()})",
        lambda w: f"math.{w.pick('hypot', 'fmod', 'atan2', 'copysign')}({w.real()}, {w.real()})",
        lambda w: f"self.row[{w.pick('0', '-1', w.whole(), f'{w.whole()} % 3')}]",
        lambda w: f"sum({w.pick('self.row', f'({w.real()}, {w.real()})', 'self.recent')})",
        lambda w: f"{w.pick('max', 'min')}({w.pick('self.row', 'TABLE', 'self.recent')})",
        lambda w: f"float(sum({_generator(w, some_list(w))}))",
        lambda w: f"{w.pick('sum', 'max', 'min')}([each + {w.real()} for each in {w.pick('self.row', 'TABLE')}])",
        _weighted,
        _listed,
        lambda w: f"Pair({w.real()}, {w.real()}).{w.pick('first', 'second')}",
        lambda w: f"float(self.array[{w.pick('0', '1', '-1')}])",
        lambda w: f"float(self.array.{w.pick('sum', 'max', 'min')}())",
        lambda w: f"({w.pick('self.maybe', 'self.last')} or {w.real()})",
        lambda w: f"({w.real()} if self.last is None else self.last)",
        lambda w: f"({w.real()} ** {w.pick('2', '3', '-1', '2.0', '0.5', '-1.0', w.real())})",
        lambda w: f"round({w.real()}, {w.pick('0', '1', '3')})",
        lambda w: f"TABLE[{w.pick('self.n % 3', w.whole(), 'self.level')}]",
        lambda w: "GAINS[self.mode]",
        lambda w: "float(GAINS.get(self.mode, 0.5))",
        lambda w: f"sum(self.row[{w.pick('1:', ':2', '-2:', '::-1', '::2')}])",
        lambda w: f"max((*self.row[:1], {w.real()}, *TABLE[1:])[{w.pick('1:', '::2')}])",
        lambda w: f"({w.real()}, {w.real()})[{w.pick('0', '1', w.whole())}]",
    ],
    "whole": [
        lambda w: f"({w.whole()} {w.pick('+', '-', '*', '//', '%')} {w.whole()})",
        lambda w: f"({w.whole()} {w.pick('+', '-')} {w.whole()})",
        lambda w: f"({w.whole()} {w.pick('//', '%')} {w.pick('3', '-3', '7', w.whole())})",
        lambda w: f"(-{w.whole()})",
        lambda w: f"abs({w.whole()})",
        lambda w: f"{w.pick('max', 'min')}({w.whole()}, {w.whole()})",
        lambda w: f"{w.pick('int', 'round', 'math.floor', 'math.ceil', 'math.trunc')}(self.u + {w.real()})",
        lambda w: f"int({w.truth()})",
        lambda w: f"({w.whole()} if {w.truth()} else {w.whole()})",
        lambda w: f"({w.whole()} {w.pick('and', 'or')} {w.whole()})",
        lambda w: f"self.cells[{w.pick('0', '-1', f'{w.whole()} % 4', w.whole(), 'self.level')}]",
        lambda w: f"len({w.pick('self.row', 'self.cells', 'self.array', 'TABLE')})",
        lambda w: f"sum({w.pick('self.cells', 'self.marks')})",
        lambda w: f"({w.truth()}) + ({w.truth()}) + ({w.truth()})",
        lambda w: f"({w.whole()} + ({w.truth()}))",
        lambda w: f"STEPS[{w.whole()} % 3]",
        lambda w: w.pick("self.level.value", "self.mode.value"),
        lambda w: f"({level(w)} {w.pick('+', '-', '*', '//', '%', '&')} {w.pick(w.whole(), 'Level.MORE')})",
        lambda w: f"(self.n {w.pick('&', '|', '^')} {w.whole()})",
        lambda w: f"({w.whole()} {w.pick('&', '|', '^')} {w.whole()})",
        lambda w: f"(self.n {w.pick('<<', '>>')} {w.pick('1', '3', '31', '40', w.whole(), f'({w.whole()} & 7)')})",
        lambda w: f"(~{w.whole()})",
        lambda w: f"(self.i ** {w.pick('0', '1', '2', '3', '5')})",
        lambda w: f"sum({_number(w)})",
    ],
    "truth": [
        lambda w: f"({w.real()} {sign(w)} {w.real()})",
        lambda w: f"({w.whole()} {sign(w)} {w.whole()})",
        lambda w: f"({w.whole()} {sign(w)} {w.real()})",
        lambda w: f"({w.real()} {w.pick('<', '<=')} {w.real()} {w.pick('<', '<=')} {w.real()})",
        lambda w: f"({w.whole()} {w.pick('<', '==')} {w.whole()} {w.pick('<', '!=')} {w.whole()} < {w.whole()})",
        lambda w: f"({w.truth()} {w.pick('and', 'or')} {w.truth()})",
        lambda w: f"({w.truth()} {w.pick('and', 'or')} {w.truth()} {w.pick('and', 'or')} {w.truth()})",
        lambda w: f"(not {w.truth()})",
        lambda w: f"(self.level {sign(w)} {w.pick('Level.SOME', w.whole(), w.real())})",
        lambda w: f"(bool({w.truth()}) {w.pick('is', 'is not')} {w.pick('True', 'False')})",
        lambda w: f"({w.truth()} {w.pick('==', '!=')} {w.pick(w.truth(), w.whole(0))})",
        lambda w: f"(self.phase {w.pick('==', '!=')} {w.pick(*TEXTS)})",
        lambda w: f"(self.phase {w.pick('in', 'not in')} ({w.pick(*TEXTS)}, {w.pick(*TEXTS)}))",
        lambda w: "bool(self.phase)",
        lambda w: f"(bool({w.truth()}) {w.pick('&', '|', '^')} bool({w.truth()}))",
        lambda w: f"bool({w.pick(w.real(), w.whole())})",
        lambda w: f"(self.mode {w.pick('is', 'is not', '==', '!=')} {mode(w)})",
        lambda w: f"(self.side {w.pick('is', 'is not', '==', '!=')} {w.pick(mode(w), 'None')})",
        lambda w: f"(self.side {w.pick('in', 'not in')} (Mode.OFF, {w.pick('None', 'Mode.HEAT')}))",
        lambda w: f"({w.whole()} {w.pick('in', 'not in')} ({w.whole()}, {w.whole()}, 3))",
        lambda w: f"({w.whole()} in {w.pick('self.cells', 'self.cells[1:]', 'STEPS')})",
        lambda w: f"({w.pick('self.maybe', 'self.last')} {w.pick('is', 'is not', '==', '!=')} None)",
        lambda w: f"({w.pick('self.maybe', 'self.count')} {w.pick('==', '!=')} {w.pick(w.real(), w.whole())})",
        lambda w: f"{w.pick('any', 'all')}({w.pick('self.row', 'self.marks', 'self.cells')})",
        _any,
        _no_division,
        lambda w: f"math.{w.pick('isfinite', 'isnan', 'isinf')}({w.real()})",
        lambda w: f"(self.maybe is not None and self.maybe > {w.real()})",
        lambda w: f"(self.last is None or self.last < {w.real()})",
        lambda w: f"(self.fan.pending is OnOff.{w.pick('ON', 'OFF')})",
        lambda w: f"(state_of(self.door) is PassFail.{w.pick('PASS', 'FAIL')})",
        lambda w: f"({w.pick('self.x', 'self.y')}.quality {w.pick('==', 'is', 'is not')} Quality.{quality(w)})",
        lambda w: f"({w.pick('self.a', 'self.fan')}.inhibited is None)",
    ],
}
CALLS: dict[Kind, Sequence[Write]] = {
    "real": [
        lambda w: f"self.{w.pick('part', 'spare')}.scaled({w.real()})",
        lambda w: f"self.pairs({w.real()}, n={w.whole()})[0]",
        lambda w: f"self.pairs({w.real()})[0]",
        lambda w: f"self.helped({w.real()})",
        lambda w: f"clamped({w.real()}, {w.real(0)}, {w.real(0)})",
        lambda w: f"Part.weight({w.real()})",
        lambda w: f"(self.spare.half + self.part.scaled({w.real()}) - self.part.count)",
        lambda w: f"value_of({w.pick('self.x', 'self.y', 'self.x, Quality.OUT_OF_RANGE')})",
    ],
    "whole": [
        lambda w: "self.bump()",
        lambda w: f"self.pairs({w.real()}, {w.whole()})[1]",
        lambda w: f"(self.c {w.pick('+', '-', '*')} self.bump())",
        lambda w: "self.cells[self.bump()]",
    ],
    "truth": [
        lambda w: f"self.level.above({w.whole()})",
        lambda w: "self.clears()",
        lambda w: f"(self.bump() {sign(w)} self.c)",
        lambda w: f"({w.truth()} {w.pick('and', 'or')} self.clears())",
        lambda w: f"self.{w.pick('a', 'b')}.write({w.real()})",
        lambda w: f"self.fan.write(OnOff.{w.pick('ON', 'OFF')})",
    ],
}
ARRAY_LEAVES: Sequence[Write] = [lambda w: w.pick("self.array", "self.other", "np.zeros(3)", "np.ones(3)")]
ARRAYS: Sequence[Write] = [
    lambda w: f"({w.array(1)} {w.pick('+', '-', '*', '/')} {w.pick(w.array(0), w.real(1))})",
    lambda w: f"np.where({w.array(1)} > {w.real(1)}, {w.array(1)}, {w.pick(w.array(0), '0.0')})",
    lambda w: f"np.clip({w.array(1)}, -1.0, {w.real(0)})",
    lambda w: f"np.{w.pick('maximum', 'minimum')}({w.array(1)}, {w.pick(w.array(0), w.real(0))})",
    lambda w: f"np.{w.pick('abs', 'floor', 'nan_to_num', 'sqrt', 'ceil')}({w.array(1)})",
    lambda w: f"{w.array(0)}.copy()",
    lambda w: f"np.where(np.isfinite({w.array(0)}), {w.array(0)}, {w.real(0)})",
    lambda w: f"np.array([{w.real(1)}, {w.real(0)}, {w.real(0)}])",
]


def _number(w: Writer) -> str:
    with w.without_calls():
        return f"each {sign(w)} {w.whole(0)} for each in self.cells"


def quality(w: Writer) -> str:
    return w.pick("GOOD", "BAD", "STALE", "OUT_OF_RANGE")


def optional(w: Writer) -> str:
    """A real number or None."""
    return w.pick("None", w.real(1), "self.maybe", "self.last", f"(None if {w.truth(1)} else {w.real(1)})")
