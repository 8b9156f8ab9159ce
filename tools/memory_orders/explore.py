"""Every order of a model's steps, the shortest first."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

from tools.memory_orders.machines import Machine, State
from tools.memory_orders.threads import Access, Nodes, Shape, Thread


@dataclass(frozen=True)
class Model:
    shape: Shape
    threads: Sequence[Thread]
    final: Callable[[Access, Sequence[Hashable]], object] = lambda memory, results: None
    """What must hold at the end, of the memory and what the threads know; None: one was killed."""


@dataclass
class Found:
    """What came of it. `broken`: what does not hold; "": everything does in every order."""

    states: int
    seconds: float
    """CPU time."""
    broken: str = ""
    schedule: Sequence[str] = ()
    """The steps that lead there."""


class TooMany(Exception):
    """There are more states than were allowed."""


def explore(model: Model, machine: type[Machine], *, pauses: bool = True, most: int = 3_000_000) -> Found:
    began = time.process_time()
    nodes = Nodes(model.shape, model.threads)
    on = machine(nodes, pauses)
    first = on.begin()
    came: dict[State, tuple[State, Any] | None] = {first: None}
    todo = deque([first])
    while todo:
        state = todo.popleft()
        if broken := _broken(model, nodes, on, state):
            schedule = _schedule(nodes, came, state)
            return Found(len(came), time.process_time() - began, broken, schedule)
        for label, after in on.steps(state):
            if after not in came:
                came[after] = state, label
                todo.append(after)
        if len(came) > most:
            raise TooMany(f"more than {most} states")
    return Found(len(came), time.process_time() - began)


def _broken(model: Model, nodes: Nodes, on: Machine, state: State) -> str:
    for node, _, _ in state[0]:
        if node is not None and node.broken:
            return str(node.broken)
    if not on.is_over(state):
        return ""
    results = [None if node is None else node.result for node, _, _ in state[0]]
    return nodes.final(model.final, on.memory(state), results)


def _schedule(nodes: Nodes, came: dict[State, tuple[State, Any] | None], state: State) -> list[str]:
    steps = []
    while (before := came[state]) is not None:
        state, label = before
        steps.append(_in_words(nodes, *label))
    return steps[::-1]


def _in_words(nodes: Nodes, thread: int, does: str, what: Any = None) -> str:
    who = nodes.threads[thread].name
    if what is None:
        return f"{who} {does}"
    pairs = (what,) if does == "shows" else what
    text = ", ".join(f"{nodes.shape.names[place]} = {_value(nodes.values[value])}" for place, value in pairs)
    return f"{who} {does} {text}"


def _value(data: bytes) -> str:
    number = int.from_bytes(data, "little", signed=len(data) == 8)
    return str(number) if len(data) <= 8 and abs(number) < 1 << 32 else f"{data.rstrip(bytes(1))[-8:]!r}"
