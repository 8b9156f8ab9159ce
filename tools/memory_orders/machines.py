"""Two machines: which steps can be next, and what loads return.

A state is (points, memory, private, lock). The point of a thread is (node, number of its next operation, parts of it
that are done); `private` has what belongs to each thread: its store buffer (x86-64), or what it has seen (ARM).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from tools.memory_orders.threads import Node, Nodes

State = tuple[Any, ...]
KILLED = (None, 0, ())
FREE = -1


class Machine:
    """What both have in common."""

    name = ""

    def __init__(self, nodes: Nodes, pauses: bool = True) -> None:
        """`pauses`: whether a wait lets a thread see all that was stored before; else it is no fence at all."""
        self.nodes, self.pauses = nodes, pauses

    def begin(self) -> State:
        raise NotImplementedError

    def steps(self, state: State) -> Iterator[tuple[tuple[Any, ...], State]]:
        """Each next step, as (thread, what it does), and the state after it."""
        for number, point in enumerate(state[0]):
            node, at, done = point
            if node is None:
                continue
            thread = self.nodes.threads[number]
            waits = thread.after is not None and not at and not self._has_ended(state, thread.after)
            if not waits:
                yield from self._of_thread(state, number, node, at, done)
                if thread.killable and (at < len(node.ops) or node.load):
                    yield (number, "is killed"), self._killed(state, number)

    def is_over(self, state: State) -> bool:
        return all(self._has_ended(state, number) for number in range(len(self.nodes.threads)))

    def memory(self, state: State) -> list[int]:
        """What is in each place when everything is visible."""
        raise NotImplementedError

    def _has_ended(self, state: State, number: int) -> bool:
        node, at, _ = state[0][number]
        return node is None or (at == len(node.ops) and not node.load)

    def _of_thread(
        self, state: State, number: int, node: Node, at: int, done: Any
    ) -> Iterator[tuple[tuple[Any, ...], State]]:
        raise NotImplementedError

    def _killed(self, state: State, number: int) -> State:
        raise NotImplementedError

    def _moved(self, state: State, number: int, node: Node | None, at: int, done: Any = ()) -> tuple[Any, ...]:
        points = state[0]
        return (*points[:number], (node, at, done), *points[number + 1 :])


def _with(values: tuple[Any, ...], place: int, value: Any) -> tuple[Any, ...]:
    return (*values[:place], value, *values[place + 1 :])


class Tso(Machine):
    """x86-64: stores wait in a buffer of their processor, from which they become visible in order; those of one copy
    in any order, as of `rep movs`. Loads are made in order, those of one copy in any order."""

    name = "x86-64"

    def begin(self) -> State:
        count = len(self.nodes.threads)
        points = tuple((self.nodes.root(number), 0, ()) for number in range(count))
        return points, self.nodes.initial(), ((),) * count, FREE

    def steps(self, state: State) -> Iterator[tuple[tuple[Any, ...], State]]:
        yield from super().steps(state)
        points, memory, buffers, lock = state
        for number, buffer in enumerate(buffers):
            for entry in buffer[0] if buffer else ():
                left = tuple(each for each in buffer[0] if each is not entry)
                rest = (left, *buffer[1:]) if left else buffer[1:]
                shown = _with(memory, entry[0], entry[1])
                yield (number, "shows", entry), (points, shown, _with(buffers, number, rest), lock)

    def is_over(self, state: State) -> bool:
        return super().is_over(state) and not any(state[2])

    def memory(self, state: State) -> list[int]:
        return list(state[1])

    def _has_ended(self, state: State, number: int) -> bool:
        return super()._has_ended(state, number) and not state[2][number]

    def _of_thread(
        self, state: State, number: int, node: Node, at: int, done: Any
    ) -> Iterator[tuple[tuple[Any, ...], State]]:
        _, memory, buffers, lock = state
        if at == len(node.ops):
            if node.load:
                yield from self._loads(state, number, node, at, done)
            return
        kind, *rest = node.ops[at]
        on = self._moved(state, number, node, at + 1)
        if kind == "store":
            yield (number, "stores", rest[0]), (on, memory, _with(buffers, number, (*buffers[number], rest[0])), lock)
        elif buffers[number] and (kind != "pause" or self.pauses):
            return
        elif kind in ("pause", "begin"):
            yield (number, "waits"), (on, memory, buffers, lock)
        elif kind == "lock" and lock == FREE:
            yield (number, "locks"), (on, memory, buffers, number)
        elif kind == "unlock":
            yield (number, "unlocks"), (on, memory, buffers, FREE)

    def _loads(
        self, state: State, number: int, node: Node, at: int, done: Any
    ) -> Iterator[tuple[tuple[Any, ...], State]]:
        _, memory, buffers, lock = state
        own = {place: value for group in buffers[number] for place, value in group}
        done = done or (None,) * len(node.load)
        for each, place in enumerate(node.load):
            if done[each] is None:
                value = own.get(place, memory[place])
                now = _with(done, each, value)
                whole = None not in now
                after = (self.nodes.after(number, node, now), 0, ()) if whole else (node, at, now)
                label = (number, "loads", ((place, value),))
                yield label, (self._moved(state, number, *after), memory, buffers, lock)

    def _killed(self, state: State, number: int) -> State:
        _, memory, buffers, lock = state  # what is in its buffer it has not come to, in one of these states
        return self._moved(state, number, *KILLED), memory, _with(buffers, number, ()), _freed(lock, number)


class Arm(Machine):
    """ARM: each place has its own order of stores. A load returns any of them that is not older than what its thread
    has seen at that place, so stores become visible, and loads are satisfied, in any order. More than any processor
    does; what it leaves out, a store that is made before an earlier load, does not happen where the store depends on
    that load."""

    name = "ARM"

    def begin(self) -> State:
        count, initial = len(self.nodes.threads), self.nodes.initial()
        points = tuple((self.nodes.root(number), 0, ()) for number in range(count))
        nothing = (0,) * len(initial)
        return points, tuple((value,) for value in initial), (nothing,) * count, (FREE, nothing)

    def memory(self, state: State) -> list[int]:
        return [stores[-1] for stores in state[1]]

    def _of_thread(
        self, state: State, number: int, node: Node, at: int, done: Any
    ) -> Iterator[tuple[tuple[Any, ...], State]]:
        _, memory, seen, (holder, handed_on) = state
        if at == len(node.ops):
            if node.load:
                yield from self._loads(state, number, node)
            return
        kind, *rest = node.ops[at]
        on = self._moved(state, number, node, at + 1)
        mine = seen[number]
        if kind == "store":
            yield from self._stores(state, number, node, at, done, rest[0])
        elif kind in ("pause", "begin"):
            fences = self.pauses or kind == "begin"
            latest = tuple(len(stores) - 1 for stores in memory) if fences else mine
            yield (number, "waits"), (on, memory, _with(seen, number, latest), state[3])
        elif kind == "lock" and holder == FREE:
            joined = tuple(map(max, mine, handed_on))
            yield (number, "locks"), (on, memory, _with(seen, number, joined), (number, handed_on))
        elif kind == "unlock":
            yield (number, "unlocks"), (on, memory, seen, (FREE, tuple(map(max, mine, handed_on))))

    def _stores(
        self, state: State, number: int, node: Node, at: int, done: Any, group: Any
    ) -> Iterator[tuple[tuple[Any, ...], State]]:
        """One store of a group: after what its thread has seen at its place, and perhaps before those of others."""
        _, memory, seen, lock = state
        left = [each for each in range(len(group)) if each not in done]
        for each in left if self.nodes.threads[number].killable else left[:1]:  # who cannot be killed makes them all
            place, value = group[each]
            now = tuple(sorted((*done, each)))
            points = self._moved(state, number, node, *((at + 1, ()) if len(left) == 1 else (at, now)))
            for where in range(seen[number][place] + 1, len(memory[place]) + 1):
                stores = (*memory[place][:where], value, *memory[place][where:])
                views = [_with(view, place, view[place] + (view[place] >= where)) for view in seen]
                views[number] = _with(views[number], place, where)
                handed_on = _with(lock[1], place, lock[1][place] + (lock[1][place] >= where))
                after = points, _with(memory, place, stores), tuple(views), (lock[0], handed_on)
                yield (number, "stores", ((place, value),)), after

    def _loads(self, state: State, number: int, node: Node) -> Iterator[tuple[tuple[Any, ...], State]]:
        _, memory, seen, lock = state
        mine = seen[number]
        for chosen in product(*(range(mine[place], len(memory[place])) for place in node.load)):
            values, view = tuple(memory[place][each] for place, each in zip(node.load, chosen, strict=True)), list(mine)
            for place, each in zip(node.load, chosen, strict=True):
                view[place] = each
            points = self._moved(state, number, self.nodes.after(number, node, values), 0)
            label = (number, "loads", tuple(zip(node.load, values, strict=True)))
            yield label, (points, memory, _with(seen, number, tuple(view)), lock)

    def _killed(self, state: State, number: int) -> State:
        _, memory, seen, (holder, handed_on) = state
        if holder == number:
            holder, handed_on = FREE, tuple(map(max, seen[number], handed_on))
        return self._moved(state, number, *KILLED), memory, seen, (holder, handed_on)


def _freed(holder: int, number: int) -> int:
    """The lock of one that dies ends with it."""
    return FREE if holder == number else holder


MACHINES = (Tso, Arm)
