"""Make batches in both reactors, side by side."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from umo.control import together, until
from umo.errors import TimeExpired
from umo.operation import ProcedureState

from .batch_recipes import Name, in_words
from .control import BatchPlant, Making, Reactor
from .errors import BatchesLost

USUAL: Sequence[Name] = ("glue", "soap")
"""The recipes that are made if none is given."""
ENDED = (ProcedureState.COMPLETE, ProcedureState.STOPPED, ProcedureState.ABORTED)
"""The states in which a reactor makes no further batch until it is reset."""


async def main(m: BatchPlant, recipe: Sequence[Name] = (), batches: int = 2, patience: float = 600.0) -> dict[str, Any]:
    """Make batches. Each reactor takes the recipes in turn; the second one begins with the second recipe.

    Options:
        recipe: one or several recipes, in the order in which they are made; they replace the recipe that a client chose
            in an earlier run. Default: glue, then soap, or the recipe that a client chose.
        batches: the number of batches of each reactor.
        patience: the time in s within which a fault must be cleared; otherwise the batches of this reactor are not
            made.

    A batch that a fault has interrupted is dumped and made again when the fault is cleared; a batch that an operator
    has stopped is made again when the operator resets the reactor. Raises BatchesLost at the end if a fault was not
    cleared in time.
    """
    m.book.begin()
    if recipe:
        m.book.follow_plan()
    for reactor in m.reactors:
        reactor.begin()
    m.cycle.progress("", done=0, total=batches * len(m.reactors))
    names = recipe or USUAL
    plans = [[names[(first + number) % len(names)] for number in range(batches)] for first in range(len(m.reactors))]
    made: Counter[str] = Counter()
    lost = await together(
        *(work(m, reactor, plan, patience, made) for reactor, plan in zip(m.reactors, plans, strict=True))
    )
    if reasons := list(filter(None, lost)):
        raise BatchesLost("; ".join(reasons))
    dumped = sum(reactor.dumped for reactor in m.reactors)
    return {"batches_made": made.total(), "made": in_words(made), "batches_dumped": dumped, "recipes": m.book.record}


async def work(m: BatchPlant, reactor: Reactor, plan: list[Name], patience: float, done: Counter[str]) -> str:
    """Make the batches of one reactor, by the plan or by the choice of a client, and count them.

    Return the reason why some batches were not made; empty if all were made."""
    for number, planned in enumerate(plan):
        recipe = m.book.next(planned)
        reactor.unit.take(recipe, m.book.begun)
        while not await made(reactor.unit):
            try:
                await ready(reactor.unit, patience)
            except TimeExpired:
                left = f"{len(plan) - number} of {len(plan)} batches not made"
                return f"reactor {reactor.number}: {left}: {reactor.cycle.fault or reactor.activity}"
        done[recipe.name] += 1
    return ""


async def made(unit: Making) -> bool:
    """Make one batch. Return False if the reactor failed or was stopped."""
    if unit.state is ProcedureState.IDLE:  # or an operator was quicker
        unit.start()
    await until(lambda: unit.state in ENDED)
    if unit.state is not ProcedureState.COMPLETE:
        return False
    unit.reset()
    return True


async def ready(unit: Making, patience: float) -> None:
    """Wait until the reactor can be started again. After a fault this is when the fault is cleared; after a stop by an
    operator, when the operator resets the reactor. Raises TimeExpired after `patience`."""
    failed = unit.state is ProcedureState.ABORTED
    await until(lambda: unit.state is not ProcedureState.ABORTED, timeout=patience)
    if failed and unit.state is ProcedureState.STOPPED:
        unit.reset()
    await until(lambda: unit.state not in ENDED, timeout=patience)
