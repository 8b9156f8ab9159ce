"""The passes over a machine: its conditions and steps are lowered again and again, until no type is new."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from umo.generate.c_types import BOOL, NOTHING
from umo.generate.form import (
    CallStatement,
    FunctionForm,
    Literal,
    MachineForm,
    Return,
    Statement,
    Temporary,
    WholeMachine,
)
from umo.generate.function_source import NoSource, SourcedFunction, bound
from umo.generate.lower.code_world import CodeWorld, TranslatedFunction
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.terms import Known
from umo.generate.lower.translation_memory import MOST_PASSES, TranslationMemory
from umo.generate.translation import CFunction, ControllerTarget, Untranslatable
from umo.objects import Compound


class Lowered(NamedTuple):
    """The form of a machine, and what is to be told of it."""

    program: MachineForm
    entry: Mapping[Any, CFunction]
    world: CodeWorld


def lowered(
    machine: Compound,
    conditions: Sequence[Callable[[], Any]],
    steps: Sequence[Callable[[], Any]],
    target: ControllerTarget,
) -> Lowered:
    """The conditions of a machine, which give a bool, and the steps, whose results are left out: pass after pass until
    no type is new."""
    memory = TranslationMemory()
    for _ in range(MOST_PASSES):
        memory.changed = False
        world = CodeWorld(memory, target)
        entry = _pass(world, machine, conditions, steps)
        if not memory.changed:
            break
    return Lowered(world.program(), entry, world)


def _pass(
    world: CodeWorld, machine: Any, conditions: Sequence[Callable[..., Any]], steps: Sequence[Callable[..., Any]]
) -> dict[Any, CFunction]:
    world.fields.known(machine, "")
    entry = {}
    for number, each in enumerate([*conditions, *steps]):
        if number == len(conditions):
            world.refused_conditions = bool(world.problems)
        try:
            found = bound(each)
            parameters = inspect.signature(found.source.function, follow_wrapped=False).parameters
            given = {n: Known(each.default) for n, each in parameters.items() if each.default is not each.empty}
            given |= dict(zip(parameters, map(Known, found.given), strict=False))
            given |= {n: Known(v) for n, v in found.named}
            for live in given.values():
                if hasattr(live.value, "_path"):
                    world.fields.known(live.value, "")
            translated = world.translated(found.source, given, found.source.tree, None)
        except NoSource as error:
            world.problems.append(Untranslatable("", 0, getattr(each, "__qualname__", str(each)), str(error), ""))
            continue
        except NoTranslation as refused:
            source = found.source
            line = getattr(refused.node, "lineno", 0)
            world.problems.append(Untranslatable(source.file, line, source.name, refused.reason, refused.nearest))
            continue
        if number < len(conditions) and translated.form is not None and translated.result not in (BOOL, NOTHING):
            world.problems.append(_no_condition(found.source))
        entry[each] = _wrapped(world, translated, found.source.name, number < len(conditions))
    return entry


def _no_condition(source: SourcedFunction) -> Untranslatable:
    """In Python what is no bool counts as true."""
    reason = "the condition of an interlock gives something that is not always True or False"
    text = source.segment(source.tree.body) if isinstance(source.tree, ast.Lambda) else source.name
    return Untranslatable(source.file, source.tree.lineno, text, reason, "a comparison, or bool(...)")


def _wrapped(world: CodeWorld, translated: TranslatedFunction, what: str, is_condition: bool) -> CFunction:
    """A function with `m` and, of a condition, a place for a bool. The result of a step is left out; what is no bool
    counts as true (`umo.cycle.inhibition`)."""
    of = translated.result
    if translated.form is not None and of == (BOOL if is_condition else NOTHING):
        return CFunction(translated.name)
    name, result = f"entry_{translated.name}", Temporary("result")
    body: list[Statement] = []
    if translated.form is not None:
        body.append(CallStatement(translated.name, (WholeMachine(),), None if of == NOTHING else result))
    holds = Literal(translated.live is None or translated.live.value is not False, BOOL) if is_condition else None
    variables = () if of == NOTHING or translated.form is None else ((result.name, of),)
    form = FunctionForm(name, what, "", 0, (), variables, BOOL if is_condition else NOTHING, (*body, Return(holds)))
    world.functions[name] = TranslatedFunction(name, form.result, None, form)
    return CFunction(name)
