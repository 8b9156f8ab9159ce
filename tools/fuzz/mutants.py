"""Faults that are planted in a copy of the translator and its runtime: which are found, within how many programs?

Each takes a check or a refusal out, changes an operator, or is one of the faults that were found in machines as users
write them: order of evaluation, truth, identity, whole against real numbers, signs of zeros, NaN, rounding, exceptions,
names without a value, aliases, what is taken as known, missed periods, faults of equipment, interlocks.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from tools.planted_faults import PlantedFault, copied, played_with

TIMEOUT = 3600.0
"""Time in s for the programs of one fault."""


OF_COMPILED_LAWS = "compiled_laws.py", "bound_fields.py", "known_watch.py", "known_values.py"
"""Files whose faults host C does not have."""


class Planted(PlantedFault):
    """A fault of the translator."""

    ROOM = "src/umo/generate"


PLANTED = (
    Planted("a real number is cut to a whole one", "lower/lowered_values.py",
            "if not _widens(code.type, of):", "if False:"),
    Planted("the sign of a whole or real zero", "lower/lowered_expressions.py",
            "if any(map(_is_mixed, terms)) and not any(map(is_float, terms)):", "if False:"),
    Planted("a state that is None is equal to the first", "lower/lowered_conditions.py",
            'test = Operator("&&", there[0], test)', "pass"),
    Planted("an array with several names is changed", "lower/lowered_aliases.py",
            "if isinstance(place, Elementwise) or place.value != whole(place.value) or self.shares(place.value):",
            "if False:"),
    Planted("one list at two places is not seen", "lower/translation_memory.py",
            "if each != place and (one is value or _overlap(one, value)):", "if False:"),
    Planted("names after a loop of no turns", "lower/lowered_loops.py",
            "self._end([*ways, *left])", "self.f.flow.known.clear()"),
    Planted("what is not None is still so after a call", "lower/function_builder.py",
            "self.flow.forget_fields()", "pass"),
    Planted("None that is assigned counts as a number", "lower/lowered_assignments.py",
            "return not isinstance(term.type, OptionalType)", "return True"),
    Planted("the class of a number that may be real", "lower/lowered_builtins.py",
            "if len(answers) != 1 or len(wanted) != len(terms):", "if False:"),
    Planted("the counter of a class", "lower/lowered_assignments.py",
            "if reason := refused_store(owner, name) or _odd_attribute(owner, name):",
            'if reason := "":'),
    Planted("a place that is found twice", "lower/lowered_assignments.py",
            "index = self.f.values.settled(index)\n        left, right", "left, right"),
    Planted("a variable of a generator that leaks", "lower/lowered_sequences.py",
            "node = with_own_names(node)", "pass"),
    Planted("a loop in its other direction", "lower/lowered_sequences.py",
            "find=lambda n: turns.find(last - n)", "find=turns.find"),
    Planted("a filter of a generator that is not asked", "lower/lowered_generators.py",
            "self.f.add_if(negated(self._truth(test)), Leave(on))", "self._truth(test)"),
    Planted("the logarithm of NaN", "lower/lowered_builtins.py",
            'Operator("<=", kept, ZERO)', 'negated(Operator(">", kept, ZERO))'),
    Planted("an error of 32 bits is caught", "lower/code_world.py",
            "return not issubclass(kind, ControllerLimit) and (", "return ("),
    Planted("the order of arguments", "lower/function_builder.py",
            "if any(map(changes, rest)):  # what was computed before may change: it is kept under a name",
            "if False:"),
    Planted("less becomes less or equal", "lower/lowered_expressions.py", 'ast.Lt: "<"', 'ast.Lt: "<="'),
    Planted("the remainder has the sign of C", "lower/lowered_expressions.py",
            "return Code(REAL, Runtime(f\"umo_{'mod' if",
            "return Code(REAL, Runtime(f\"umo_{'fmod' if"),
    Planted("a division by zero goes on", "lower/lowered_expressions.py",
            'self.f.raises(ZeroDivisionError, node, Operator("==", named, ZERO))', "pass"),
    Planted("an index beyond the end", "lower/lowered_expressions.py",
            'self.f.raises(IndexError, node, Operator("||", below, above))', "pass"),
    Planted("`finally` is left out when it returns", "emit/function_text.py",
            "around = [way for way in self.ways if way.returning]", "around: list[FaultTarget] = []"),
    Planted("`and` computes both", "lower/lowered_conditions.py",
            "self.f.add(If(test if both else negated(test), tuple(body)))",
            "self.f.add(If(TRUE, tuple(body)))"),
    Planted("what a call changes is not seen", "check/form_effects.py",
            "return isinstance(node, CallStatement)", "return False"),
    Planted("an assignment that is read is left out", "check/shape.py",
            "new = {source for each in new for source in sources.get(each, ())} - found", "new = set()"),
    # Order of evaluation, truth, identity
    Planted("`is None` of what is not None", "lower/lowered_conditions.py",
            "return Code(BOOL, negated(there) if equal else there)",
            "return Code(BOOL, there if equal else negated(there))"),
    Planted("`or` stops at what is false", "lower/lowered_conditions.py",
            'either = Operator("&&" if both else "||", truth, second_truth)',
            'either = Operator("||" if both else "||", truth, second_truth)'),
    Planted("None is true", "lower/lowered_values.py",
            'return has(place) if isinstance(inner, bool) else Operator("&&", has(place), inner)', "return inner"),
    Planted("states of different Enums are equal", "lower/lowered_conditions.py",
            "                return Known(not equal)\n            return self._equal(a, b, equal)",
            "                return Known(equal)\n            return self._equal(a, b, equal)"),
    Planted("`not in` is `in`", "lower/lowered_conditions.py",
            'return _all_or_none(found, "||", yes) if found else Known(not yes)',
            'return _all_or_none(found, "||", True) if found else Known(not yes)'),
    Planted("a chain of comparisons ends at its first", "lower/lowered_conditions.py",
            "last = place == len(node.ops) - 1", "last = True"),
    Planted("greater or equal becomes greater", "lower/lowered_expressions.py", 'ast.GtE: ">="', 'ast.GtE: ">"'),
    Planted("`or` proves what is not None", "lower/flow.py",
            "if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):",
            "if isinstance(test, ast.BoolOp):"),
    Planted("what is None is read as a number", "lower/lowered_values.py",
            "self.f.raises(TypeError, node, negated(has(code.value)))", "pass"),
    # Integers against floats, arithmetic
    Planted("abs of a whole number keeps its sign", "lower/lowered_builtins.py",
            'Operator("<", kept, ZERO), Unary("-", kept), kept', 'Operator(">", kept, ZERO), Unary("-", kept), kept'),
    Planted("a place counted from the end", "lower/lowered_expressions.py",
            'return Conditional(Operator("<", place, ZERO), Operator("+", place, number), place)', "return place"),
    Planted("int() of NaN goes on", "lower/lowered_builtins.py",
            "self.f.raises(ValueError, node, _is_nan(kept))\n        cut", "cut"),
    Planted("int() rounds down", "lower/lowered_builtins.py", 'int: "umo_trunc"', 'int: "umo_floor"'),
    Planted("round() rounds up", "lower/lowered_builtins.py", 'round: "umo_round_even"', 'round: "umo_ceil"'),
    Planted("a root of a negative number", "lower/lowered_builtins.py",
            'self.f.raises(ValueError, node, Operator("<", kept, ZERO))\n            return', "return"),
    Planted("a power beyond all numbers is infinite", "lower/lowered_expressions.py",
            "self.f.raises(OverflowError, node, joined(", "(lambda *_: None)(OverflowError, node, joined("),
    Planted("zero to a negative power", "lower/lowered_expressions.py",
            "self.f.raises(ZeroDivisionError, node, joined(", "(lambda *_: None)(ZeroDivisionError, node, joined("),
    Planted("a whole number wraps around", "emit/function_text.py",
            'OVERFLOWS = {name: f"__builtin_{name}_overflow"', 'OVERFLOWS = {name: f"0 & __builtin_{name}_overflow"'),
    Planted("the sign of a known zero is lost", "emit/c_text.py",
            "        return repr(float(number))\n", "        return repr(float(number) + 0.0)\n"),
    Planted("the quotient of reals is that of whole numbers", "lower/lowered_expressions.py",
            "if isinstance(sign, ast.Div) or REAL in (left.type, right.type):", "if REAL in (left.type, right.type):"),
    # Tables, errors
    Planted("a key that is missing", "lower/known_tables.py",
            'f.raises(KeyError, node, Operator("<", place, ZERO))', "pass"),
    Planted("the default of get", "lower/known_tables.py",
            'f.add_if(Operator(">=", place, ZERO), *there)', "f.statements += there"),
    Planted("`else` of a loop after break", "lower/lowered_loops.py",
            'out = self.f.label("past") if node.orelse else end', "out = end"),
    Planted("continue ends the loop", "lower/lowered_loops.py",
            "self.f.add(Leave(loop.again) if loop.is_written_out else NextTurn(loop.end))",
            "self.f.add(Leave(loop.again if loop.is_written_out else loop.end))"),
    Planted("an assertion that fails goes on", "lower/lowered_errors.py",
            "self.f.raises(AssertionError, node, TRUE if truth is False else negated(truth), said)", "pass"),
    Planted("a handler catches everything", "lower/code_world.py",
            "return not issubclass(kind, ControllerLimit) and (", "return True or ("),
    Planted("names that a handler may not have", "lower/lowered_errors.py",
            "in names.items() if self.f.flow.names.get(name, of) == of}\n            self",
            "in self.f.flow.names.items()}\n            self"),
    Planted("a condition of `if` that changes something proves", "lower/lowered_branches.py",
            "shown = not self.f.changed_since(at)", "shown = True"),
    Planted("a guard of `case` is not asked", "lower/lowered_branches.py",
            "test = test if case.guard is None else ast.BoolOp(ast.And(), [test, case.guard])", "pass"),
    Planted("a state of another object is quality", "lower/lowered_attributes.py",
            'Code(state(Quality), Runtime("umo_quality", (place,)))', "Known(Quality.GOOD)"),
    Planted("a property that is not asked again", "lower/lowered_builtins.py",
            'found = Runtime(f"umo_{target.__name__}{\'\' if of == REAL else \'_int\'}", (found, each))',
            'found = Runtime(f"umo_{target.__name__}{\'\' if of == REAL else \'_int\'}", (each, found))'),
    # The runtime in C
    Planted("floor division rounds to zero", "runtime/umo_python.h",
            "return a % b != 0 && (a < 0) != (b < 0) ? quotient - 1 : quotient;", "return quotient;"),
    Planted("the remainder of negative numbers", "runtime/umo_python.h",
            "return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;", "return rest;"),
    Planted("a shift of a negative number", "runtime/umo_python.h",
            "return a >= 0 ? a >> b : ~(~a >> b);", "return a >= 0 ? a >> b : -(-a >> b);"),
    Planted("a shift by more than its bits", "runtime/umo_python.h",
            "    if (b > 31)\n        b = 31;\n    return a >= 0", "    b &= 31;\n    return a >= 0"),
    Planted("max of equal numbers, and of NaN", "runtime/umo_python.h",
            "static inline umo_real umo_max(umo_real a, umo_real b)\n{\n    return b > a ? b : a;",
            "static inline umo_real umo_max(umo_real a, umo_real b)\n{\n    return a > b ? a : b;"),
    Planted("np.maximum of NaN", "runtime/umo_python.h", "return a > b || isnan(a) ? a : b;", "return a > b ? a : b;"),
    Planted("the zero of a floor division", "runtime/umo_python.h",
            "        floored = umo_copysign((umo_real)0, a / b);", "        floored = 0;"),
    Planted("the slew rate of a missed period", "runtime/umo_outputs.c",
            "way = rate * step_time(o);", "way = rate * (c->ticks > 1 ? c->plan->period : step_time(o));"),
    Planted("time stands in missed periods", "runtime/umo_inputs.c",
            "    c->number += ticks;", "    c->number += 1;"),
    Planted("dt of a missed period", "runtime/umo_inputs.c",
            "    c->dt = (umo_real)ticks * c->plan->period;", "    c->dt = c->plan->period;"),
    Planted("the last fault of a period is told", "runtime/umo_equipment.c",
            "    if (equipment->raised)\n        return;\n", "",
            "a part has one law here (tests/generate/test_generated_equipment.py has two)"),
    Planted("equipment in fault keeps its outputs", "runtime/umo_equipment.c",
            "        if (begins(c, o->traits->equipment))\n            umo_rest(o);",
            "        (void)begins(c, o->traits->equipment);"),
    Planted("equipment is cleared while a sensor is BAD", "runtime/umo_equipment.c",
            "                return false;\n    }\n    for", "                continue;\n    }\n    for"),
    Planted("an interlock that stops only inhibits", "runtime/umo_outputs.c",
            "output->stopping = output->stopping || of->stops;", "output->stopping = false;"),
    Planted("a latched interlock lets go", "runtime/umo_outputs.c",
            "interlock->inhibits = holds || interlock->latched;", "interlock->inhibits = holds;"),
    Planted("an expiry before the interlocks", "runtime/umo_outputs.c",
            "    interlocked(c);\n    expire(c);", "    expire(c);\n    interlocked(c);"),
    Planted("a failed condition does not hold", "runtime/umo_outputs.c",
            "        holds = true;\n        c->fault_object = fault_object;",
            "        holds = false;\n        c->fault_object = fault_object;"),
    Planted("a held value is never too old", "runtime/umo_inputs.c",
            "umo_since(o->core, o->time) <= o->traits->max_age) {", "true) {"),
    Planted("a value that is held is GOOD", "runtime/umo_inputs.c",
            "            o->quality = UMO_STALE;\n        return UMO_OK;\n    }\n    o->quality = UMO_BAD;\n    if",
            "            o->quality = UMO_GOOD;\n        return UMO_OK;\n    }\n    o->quality = UMO_BAD;\n    if"),
    Planted("a value that was clamped was taken", "runtime/umo_access.c",
            "    fault = memory_command(o, clamped(o, value), taken);\n    *taken = false;",
            "    fault = memory_command(o, clamped(o, value), taken);"),
    Planted("OUT_OF_RANGE is accepted", "runtime/umo_access.c",
            "accept_mask | 1u << UMO_GOOD | 1u << UMO_STALE;",
            "accept_mask | 1u << UMO_GOOD | 1u << UMO_STALE | 1u << UMO_OUT_OF_RANGE;"),
    Planted("a Vector writes before it is judged", "runtime/umo_access.c",
            "return memory_refused_many(m, objects, n, values, where, taken, umo_failed(o, fault));", "continue;"),
    Planted("the debounce of a missed period", "runtime/umo_inputs.c",
            "of->since = o->core->number;\n    }", "of->since = o->core->number - o->core->ticks + 1;\n    }"),
    Planted("the filter takes each period as one", "runtime/umo_inputs.c",
            "of->value += share(dt, filter) * (value - of->value);",
            "of->value += share(c->plan->period, filter) * (value - of->value);"),
    Planted("an error of finally replaces a limit of the controller", "emit/function_text.py",
            'f"if ({IS_LIMIT}({pending}))"', 'f"if ({IS_LIMIT}({pending}) && false)"'),
    # Compiled laws
    Planted("what was taken as known is not watched", "compiled_laws.py",
            "self._look_first(self._look if self._deques else self._watch.look)", "self._look_first(lambda: True)"),
)  # fmt: skip


def measure(count: int, jobs: int, only: str = "") -> int:
    """Each fault in a copy of the tree, and the programs until one is wrong."""
    chosen = [each for each in PLANTED if only in each.what and each.place()]
    trees: SimpleQueue[Path] = SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="umo-fuzz-") as folder, ThreadPoolExecutor(jobs) as threads:
        for number in range(jobs):
            trees.put(copied(Path(folder) / str(number)))
        found = [*threads.map(lambda each: _is_found(each, trees, count), chosen)]
    print(f"{sum(found)} of {len(chosen)} found within {count} programs each")
    return int(not all(is_found or each.layer for each, is_found in zip(chosen, found, strict=True)))


def _is_found(fault: Planted, trees: SimpleQueue[Path], count: int) -> bool:
    tree = trees.get()
    target = "compiled" if fault.file in OF_COMPILED_LAWS else "host"
    words = ["tools.fuzz", str(count), "--until-wrong", "--jobs", "1", "--target", target]
    try:
        done = played_with([fault], tree, TIMEOUT, *words)
    finally:
        trees.put(tree)
    said = (done.stdout or done.stderr).strip().splitlines() or [""]
    found = done.returncode == 1 and said[-1].startswith("python -m tools.fuzz --replay")
    found = found and ": not compiled: " not in said[-1]  # any program would find that
    print(fault.line(found, said[-1][:160]), flush=True)
    return found
