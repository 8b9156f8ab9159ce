"""The graph of the sequences of a machine that wait for each other. With this graph, a wait that cannot end is found
when it begins.

A sequence waits for a lock, for a started sequence, or for the sequences that it runs in parallel. Before a sequence
waits, umo finds the sequences that cannot continue before this sequence has ended. If the sequence waits for one of
these, the wait would never end, and TaskFailed is raised instead. A sequence that waits for a time or a condition can
continue. A sequence with a time limit can continue, too, and so can a sequence that `first` or `unless` may cancel,
unless this would also cancel the sequence that begins to wait."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence, Sized
from typing import Any, NamedTuple, Protocol

from umo.text import in_brackets, some


class Claimed(Protocol):
    """An object that only one sequence at a time can have: a lock."""

    @property
    def _owner(self) -> Waiter | None:
        """The sequence that has the object, or None."""

    @property
    def _queue(self) -> Iterable[Waiter]:
        """The sequences that wait for the object."""

    @property
    def _users(self) -> Container[Waiter]:
        """The sequences that have had the object."""


class ParallelParts(NamedTuple):
    """The sequences that another sequence runs in parallel."""

    tasks: Sequence[Waiter]
    hold_up: Callable[[Iterable[bool]], bool]
    """The function that decides whether the parts prevent the other sequence from continuing: `any` if this sequence
    waits for all parts, `all` if the parts are alternatives."""


class Waiter(ABC):
    """A sequence in the graph of waits."""

    def __init__(self, parent: Waiter | None) -> None:
        self.parent = parent
        """The sequence that runs this one in parallel with others; None if this one was started."""
        self.awaited_by: list[Any] = []
        """The sequences that await this one."""
        self.waits_for: Claimed | Waiter | ParallelParts | None = None
        """The object for which the sequence waits; None for a time or a condition, or if it does not wait."""
        self.holds: list[Claimed] = []
        """The locks that the sequence has."""
        self.paused = False
        """True if the sequence is not advanced, so that no time passes for it."""
        self.limits: Sized = ()
        """The time limits of the blocks in which the sequence is."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the waiter in messages."""

    @property
    @abstractmethod
    def details(self) -> str:
        """Text that distinguishes this waiter from others of the same name."""

    @property
    def shown(self) -> Waiter:
        """The sequence that messages name: in place of a function of umo, the sequence that runs the function."""
        return self

    @property
    def lineage(self) -> list[Waiter]:
        """The sequence itself, the sequence that runs it, and so on up to the started sequence."""
        found, each = [self], self.parent
        while each is not None:
            found.append(each)
            each = each.parent
        return found


def circle(waiting: Waiter, target: Waiter, wait: str) -> str | None:
    """Return a sentence that says why a wait of one sequence for another would never end, or None if it can end.
    `wait`: the beginning of the sentence, such as "{waiting} awaits {target}"."""
    stuck = _stuck_behind(waiting)
    if target not in stuck:
        return None
    names = _names(stuck | {waiting, target})
    begun = wait.format(waiting=names[waiting], target=names[target])
    words = some(_words_from(target, waiting, stuck, names))
    return f"{begun}: it would wait for itself{words and f' ({words})'}"


def awaits(waiting: Waiter, target: Waiter) -> bool:
    """Return True if a sequence continues only when another one has ended, because the first awaits the other or runs
    it in parallel."""
    return waiting in _reached([target], _bound_to)


def _names(waiters: Iterable[Waiter]) -> dict[Waiter, str]:
    """Return the names of sequences in one message. Sequences with the same name get their details."""
    asked = {each: None for waiter in waiters for each in (waiter, waiter.shown)}
    shared = Counter(each.name for each in {each.shown for each in asked})
    return {each: each.name + (in_brackets(each.details) if shared[each.name] > 1 else "") for each in asked}


def _stuck_behind(waiting: Waiter) -> set[Waiter]:
    """Return the sequences that cannot continue before this one has ended."""
    bound = _reached([waiting], _bound_to)
    stuck = _reached(bound, _behind)
    while free := {each for each in stuck - bound if not _is_stuck(each, stuck)}:
        stuck -= free
    return stuck


def _bound_to(each: Waiter) -> Iterator[Waiter]:
    """Return the sequences that continue when this one has ended, or that cancel it."""
    if each.parent is not None:
        yield each.parent
    yield from each.awaited_by


def _behind(each: Waiter) -> Iterator[Waiter]:
    """Return the sequences that wait for this one, or for a lock that it has."""
    yield from _bound_to(each)
    for claimed in each.holds:
        yield from claimed._queue


def _reached(first: Iterable[Waiter], following: Callable[[Waiter], Iterable[Waiter]]) -> set[Waiter]:
    found, left = set(first), list(first)
    while left:
        new = set(following(left.pop())) - found
        found |= new
        left += new
    return found


def _is_stuck(each: Waiter, stuck: set[Waiter]) -> bool:
    """Return True if a sequence cannot continue while those in `stuck` cannot, and if no sequence that can continue may
    cancel it."""
    if each.limits or any(other not in stuck for other in _bound_to(each)):
        return False
    awaited = each.waits_for
    if isinstance(awaited, ParallelParts):
        return awaited.hold_up(part in stuck for part in awaited.tasks)
    target = awaited if awaited is None or isinstance(awaited, Waiter) else awaited._owner
    return target in stuck and target is not each


def _words_from(target: Waiter, waiting: Waiter, stuck: set[Waiter], names: Mapping[Waiter, str]) -> list[str]:
    """Return the shortest way from `target` to `waiting` in the graph, as sentences."""
    ways: dict[Waiter, list[str]] = {target: []}
    for each in (queue := [target]):
        if each is waiting:
            break
        for other, words in _steps(each, names):
            if other in stuck and other not in ways:
                ways[other] = [*ways[each], words] if words else ways[each]
                queue.append(other)
    return ways.get(waiting, [])


def _steps(each: Waiter, names: Mapping[Waiter, str]) -> Iterator[tuple[Waiter, str]]:
    awaited, name = each.waits_for, _called(each.shown, names)
    if isinstance(awaited, ParallelParts):
        for part in awaited.tasks:
            yield part, "" if part.shown is each.shown else f"{name} runs {_called(part.shown, names)}"
    elif isinstance(awaited, Waiter):
        yield awaited, f"{name} awaits {_called(awaited, names)}"
    elif awaited is not None and awaited._owner is not None:
        yield awaited._owner, f"{name} waits for a Lock that {_called(awaited._owner, names)} has"


def _called(each: Waiter, names: Mapping[Waiter, str]) -> str:
    """Return the name of a sequence in the message; without an entry in `names`, its own name."""
    return names.get(each, each.name)
