"""Lowers the conditions and steps of a machine in passes, until all types and facts looked up in a pass are still valid
at its end."""

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
from umo.generate.lower.translation_memory import MOST_PASSES, Learner, TranslationMemory
from umo.generate.translation import CFunction, ControllerTarget, Untranslatable
from umo.objects import Compound


class Lowered(NamedTuple):
    """The form of a machine, with notes and obstacles."""

    program: MachineForm
    entry: Mapping[Any, CFunction]
    world: CodeWorld


def lowered(
    machine: Compound,
    conditions: Sequence[Callable[[], Any]],
    steps: Sequence[Callable[[], Any]],
    target: ControllerTarget,
) -> Lowered:
    """Return the conditions and steps of a machine, in the form. Conditions return a bool; the results of steps are
    ignored. Passes are repeated until all facts that a pass has looked up are still valid at its end."""
    memory, entries = TranslationMemory(), [*conditions, *steps]
    for _ in range(MOST_PASSES):
        world = CodeWorld(memory, target)
        found, learners = _pass(world, machine, conditions, steps)
        if not any(each.is_stale for each in learners):
            break
        _learn(world, entries, learners)
    return Lowered(world.program(), found, world)


def _pass(
    world: CodeWorld, machine: Any, conditions: Sequence[Callable[..., Any]], steps: Sequence[Callable[..., Any]]
) -> tuple[dict[Any, CFunction], list[Learner]]:
    world.fields.known(machine, "")
    found, learners = {}, []
    for number, each in enumerate([*conditions, *steps]):
        if number == len(conditions):
            world.refused_conditions = bool(world.problems)
        learners.append(_new_learner(world))
        if (entry := _entry(world, each, is_condition=number < len(conditions))) is not None:
            found[each] = entry
    return found, learners


def _learn(world: CodeWorld, entries: Sequence[Callable[..., Any]], learners: list[Learner]) -> None:
    """Lower the stale entries again, so that the next pass over all entries is probably the last one. Only a pass over
    all entries gives C, because it assigns numbers and names in order. If all entries are stale, do nothing, because
    the next pass lowers all of them anyway."""
    for _ in range(MOST_PASSES):
        stale = [each.is_stale for each in learners]
        if all(stale) or not any(stale):
            return
        for number, each in enumerate(entries):
            if learners[number].is_stale:
                world.forget_stale()
                learners[number] = _new_learner(world)
                _entry(world, each, is_condition=False)


def _new_learner(world: CodeWorld) -> Learner:
    world.memory.current.learner = new = Learner()
    return new


def _entry(world: CodeWorld, function: Callable[..., Any], is_condition: bool) -> CFunction | None:
    """Return how a condition or a step is called, or None if it cannot be translated."""
    try:
        found = bound(function)
        parameters = inspect.signature(found.source.function, follow_wrapped=False).parameters
        given = {n: Known(each.default) for n, each in parameters.items() if each.default is not each.empty}
        given |= dict(zip(parameters, map(Known, found.given), strict=False))
        given |= {n: Known(v) for n, v in found.named}
        for live in given.values():
            if hasattr(live.value, "_path"):
                world.fields.known(live.value, "")
        translated = world.translated(found.source, given, found.source.tree, None)
    except NoSource as error:
        name = getattr(function, "__qualname__", str(function))
        world.problems.append(Untranslatable("", 0, name, str(error), ""))
        return None
    except NoTranslation as refused:
        source = found.source
        line = getattr(refused.node, "lineno", 0)
        world.problems.append(Untranslatable(source.file, line, source.name, refused.reason, refused.nearest))
        return None
    if is_condition and translated.form is not None and translated.result not in (BOOL, NOTHING):
        world.problems.append(_no_condition(found.source))
    return _wrapped(world, translated, found.source.name, is_condition)


def _no_condition(source: SourcedFunction) -> Untranslatable:
    """Return the obstacle that a condition does not return a bool. In Python such a value counts as true."""
    reason = "the condition of an interlock may return something other than True or False"
    text = source.segment(source.tree.body) if isinstance(source.tree, ast.Lambda) else source.name
    return Untranslatable(source.file, source.tree.lineno, text, reason, "a comparison, or bool(...)")


def _wrapped(world: CodeWorld, translated: TranslatedFunction, what: str, is_condition: bool) -> CFunction:
    """Return a C function with the parameter `m` and, for a condition, a pointer to a bool. The result of a step is
    ignored; a value that is not a bool counts as true (`umo.cycle.inhibition`)."""
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
