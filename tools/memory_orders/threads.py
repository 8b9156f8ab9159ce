"""Threads of a model: real code, run again and again up to its next load."""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Op = tuple[Any, ...]
"""("store", ((place, value), ...)): in any order; ("lock",), ("unlock",); ("pause",): a wait; ("begin",): of a process
that was forked after the death of the one before."""


class Broken(AssertionError):
    """What must hold does not."""


def demand(holds: object, what: str) -> None:
    if not holds:
        raise Broken(what)


class Shape:
    """A memory cut into places: each has a name, and is loaded and stored at once. What has no name is never stored."""

    def __init__(self, size: int, names: Mapping[int, str], initial: bytes = b"") -> None:
        """`names`: the name of the place that begins at an offset and ends at the next one; "": of none."""
        self.starts = sorted({0, *names})
        self.stops = [*self.starts[1:], size]
        self.names = [names.get(start, "") for start in self.starts]
        initial = initial.ljust(size, b"\0")
        self.initial = [initial[start:stop] for start, stop in zip(self.starts, self.stops, strict=True)]

    def covered(self, start: int, stop: int) -> range:
        """The places that have anything of these bytes."""
        return range(bisect_left(self.starts, start + 1) - 1, bisect_left(self.starts, stop))


class NextLoad(BaseException):
    """The value of the next load is not known: the run ends here."""

    def __init__(self, places: tuple[int, ...]) -> None:
        self.places = places


class Access:
    """The memory as one run of a thread's code sees it. `values`: what its loads have returned so far."""

    def __init__(self, shape: Shape, values: Sequence[Sequence[bytes]]) -> None:
        self.shape = shape
        self._values = iter(values)
        self.ops: list[Op] = []
        """What is done after the last load whose value is known."""
        self._over = False

    def load(self, start: int, stop: int) -> bytes:
        covered = self.shape.covered(start, stop)
        named = tuple(place for place in covered if self.shape.names[place])
        found: Sequence[bytes] = ()
        if named:
            values = next(self._values, None)
            if values is None:
                self._over = True
                raise NextLoad(named)
            self.ops, found = [], values
        known = dict(zip(named, found, strict=True))
        data = b"".join(known.get(place, self.shape.initial[place]) for place in covered)
        first = self.shape.starts[covered.start]
        return data[start - first : stop - first]

    def store(self, start: int, data: bytes) -> None:
        shape, stop, stores = self.shape, start + len(data), []
        for place in shape.covered(start, stop):
            first, last = shape.starts[place], shape.stops[place]
            assert shape.names[place] and first >= start and last <= stop, f"a store of a part of {shape.names[place]}"
            stores.append((place, data[first - start : last - start]))
        if stores:
            self.do("store", tuple(stores))

    def do(self, *op: Any) -> None:
        if not self._over:  # else code that ends the run, as that of a `finally`
            self.ops.append(op)

    def view(self, start: int = 0, stop: int | None = None, item: str = "") -> Any:
        """As a `View`, which stands for a mapping, a memoryview or an array."""
        return View(self, start, self.shape.stops[-1] if stop is None else stop, item)


class View:
    """A part of the memory, as a mapping (`item` is "") or as a memoryview of such items."""

    def __init__(self, access: Access, start: int, stop: int, item: str) -> None:
        self._access, self._start, self._stop, self._item = access, start, stop, item
        self._size = struct.calcsize(item) if item else 1

    def __len__(self) -> int:
        return (self._stop - self._start) // self._size

    def _range(self, key: Any) -> tuple[int, int]:
        begin, end, _ = (key if isinstance(key, slice) else slice(key, key + 1)).indices(len(self))
        return self._start + begin * self._size, self._start + end * self._size

    def __getitem__(self, key: Any) -> Any:
        start, stop = self._range(key)
        if not isinstance(key, slice):
            return struct.unpack(self._item or "B", self._access.load(start, stop))[0]
        return View(self._access, start, stop, self._item) if self._item else self._access.load(start, stop)

    def __setitem__(self, key: Any, value: Any) -> None:
        start, stop = self._range(key)
        data = bytes(value) if isinstance(key, slice) else struct.pack(self._item or "B", value)
        assert len(data) == stop - start
        self._access.store(start, data)

    def __bytes__(self) -> bytes:
        return self._access.load(self._start, self._stop)

    @property
    def data(self) -> View:
        """As of an array of numpy's."""
        return self


Call = Callable[[Access, Any], Any]
"""A step of a thread, as a look: of the memory and what the thread knows (hashable) to what it knows afterwards.
`Broken` if what it has read is not true."""


@dataclass(frozen=True)
class Thread:
    name: str
    calls: Sequence[Call]
    """One after the other, with a pause between two."""
    begin: Hashable = None
    """What it knows before the first."""
    killable: bool = False
    """Whether it may be killed between any two of its stores, and before the first."""
    after: int | None = None
    """The number of the thread whose end, or death, it waits for."""


def with_reader(writer: Thread, look: Call, looks: int, begin: Hashable) -> list[Thread]:
    """A writer, and a reader that looks so often; none if it does not."""
    return [writer, *([Thread("reader", [look] * looks, begin)] if looks else [])]


@dataclass(eq=False)
class Node:
    """A point in a thread: what it does up to its next load."""

    ops: tuple[Op, ...]
    load: tuple[int, ...] = ()
    """The places that are loaded then; none: the thread ends."""
    result: Hashable = None
    broken: str = ""
    at: tuple[int, Hashable, tuple[Any, ...]] = (0, None, ())
    next: dict[tuple[int, ...], Node] = field(default_factory=dict)


class Nodes:
    """The points of the threads of one model, made as they are reached."""

    def __init__(self, shape: Shape, threads: Sequence[Thread]) -> None:
        self.shape, self.threads = shape, threads
        self.values: list[bytes] = []
        """All values by number."""
        self._numbers: dict[bytes, int] = {}
        self._known: list[dict[Any, Node]] = [{} for _ in threads]

    def number(self, value: bytes) -> int:
        if value not in self._numbers:
            self._numbers[value] = len(self.values)
            self.values.append(value)
        return self._numbers[value]

    def initial(self) -> tuple[int, ...]:
        return tuple(map(self.number, self.shape.initial))

    def root(self, thread: int) -> Node:
        return self._node(thread, 0, self.threads[thread].begin, ())

    def after(self, thread: int, node: Node, values: tuple[int, ...]) -> Node:
        """The point that is reached when the load of a node returns these values."""
        if values not in node.next:
            call, state, before = node.at
            node.next[values] = self._node(thread, call, state, (*before, values))
        return node.next[values]

    def _node(self, thread: int, call: int, state: Hashable, values: tuple[tuple[int, ...], ...]) -> Node:
        key = call, state, values
        if key not in self._known[thread]:
            self._known[thread][key] = self._run(thread, call, state, values)
        return self._known[thread][key]

    def _run(self, thread: int, call: int, state: Hashable, values: tuple[tuple[int, ...], ...]) -> Node:
        calls = self.threads[thread].calls
        access = Access(self.shape, [[self.values[number] for number in each] for each in values])
        load: tuple[int, ...] = ()
        result, broken = state, ""
        try:
            result = calls[call](access, state)
        except NextLoad as wanted:
            load = wanted.places
        except Broken as error:
            broken = str(error)
        ops = tuple(self._numbered(op) for op in access.ops)
        if load or broken or call + 1 == len(calls):
            return Node(ops, load, result, broken, (call, state, values))
        following = self._node(thread, call + 1, result, ())
        return Node(
            (*ops, ("pause",), *following.ops), following.load, following.result, following.broken, following.at
        )

    def _numbered(self, op: Op) -> Op:
        return (op[0], tuple((place, self.number(value)) for place, value in op[1])) if op[0] == "store" else op

    def final(self, call: Callable[[Access, Any], object], memory: Sequence[int], results: Sequence[Hashable]) -> str:
        """What is broken when every thread has ended, or was killed, and everything is visible; "": nothing."""
        values: list[list[bytes]] = []
        while True:
            try:
                call(Access(self.shape, values), results)
                return ""
            except NextLoad as wanted:
                values.append([self.values[memory[place]] for place in wanted.places])
            except Broken as error:
                return str(error)
