"""The facts about types that are learnt while code is translated, and the translations that a new fact makes
invalid."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from umo.generate.c_types import CType, TextType, joined
from umo.generate.form import Value
from umo.generate.lower.terms import UnknownText
from umo.generate.names import identifier

MOST_PASSES = 12
K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
T = TypeVar("T")


class Learner:
    """One lowering of a condition or a step. It looks facts up."""

    def __init__(self) -> None:
        self.is_stale = False
        """True if something that it has looked up has changed since, so that its result may change too."""
        self._users: set[Learner] = set()
        """The lowerings of functions that call the functions of this one."""

    def used_by(self, other: Learner) -> None:
        if other is not self:
            self._users.add(other)
            if self.is_stale:
                other.was_wrong()

    def was_wrong(self) -> None:
        waiting = [self]
        while waiting:
            each = waiting.pop()
            waiting += each._users if not each.is_stale else ()
            each.is_stale = True


@dataclass
class CurrentLearner:
    """Holds the current lowering."""

    learner: Learner = field(default_factory=Learner)


class Facts(Generic[K, V]):
    """The facts about one subject, by key. A lowering that has looked up a fact is invalid once the fact changes.
    Learning a fact that was not looked up before makes nothing invalid."""

    def __init__(self, current: CurrentLearner) -> None:
        self._current = current
        self._values: dict[K, V] = {}
        self._looks: dict[K, list[tuple[Callable[[V | None], Any], Any, Learner]]] = {}
        """The lookups of each key: the question, the answer, and the lowering that asked."""

    def look(self, key: K, ask: Callable[[V | None], T]) -> T:
        """Return a fact about a value. The lowering stays valid if the value changes and the fact does not."""
        answer = ask(self._values.get(key))
        self._looks.setdefault(key, []).append((ask, answer, self._current.learner))
        return answer

    def get(self, key: K) -> V | None:
        return self.look(key, _itself)

    def __contains__(self, key: Any) -> bool:
        return self.get(key) is not None

    def before(self, key: K) -> V | None:
        """Return the fact so far, so that it can be combined with a new one. This does not count as looking it up."""
        return self._values.get(key)

    def put(self, key: K, value: V) -> None:
        if self._values.get(key) != value:
            self._values[key] = value
            for ask, answer, learner in self._looks.get(key, ()):
                if ask(value) != answer:
                    learner.was_wrong()


def _itself(value: V) -> V:
    return value


class FactSet(Facts[K, bool]):
    """The keys for which something is true."""

    def add(self, key: K) -> None:
        self.put(key, True)


class TranslationMemory:
    """The types of fields by object and name, of local names and results by function, and which fields are assigned."""

    def __init__(self) -> None:
        self.current = now = CurrentLearner()
        self.assigned = FactSet[tuple[int, str]](now)
        self.texts = FactSet[tuple[int, str]](now)
        """Fields that are assigned a text. A controller does not have them, unless code depends on them."""
        self.asked = FactSet[tuple[int, str]](now)
        """The fields on which code depends; each has one of the texts of the machine."""
        self.told: dict[tuple[int, str], UnknownText] = {}
        """The texts of those fields on which code does not depend so far."""
        self.made = FactSet[tuple[int, str]](now)
        """The fields whose text is made at run time."""
        self.words = Facts[None, tuple[str, ...]](now)
        """The texts of the machine. A text is its index among them."""
        self.shared = FactSet[Any](now)
        """Arrays that may have several names: fields, or the function and name of local arrays, if in a loop."""
        self.fields = Facts[tuple[int, str], CType](now)
        self.locals = Facts[tuple[Any, str], CType](now)
        self.results = Facts[Any, CType](now)
        self.of_numpy = FactSet[tuple[int, str]](now)
        """Fields that are assigned numpy numbers."""
        self.records: dict[Any, str] = {}
        """Names in C of NamedTuples, by class and members."""
        self.arrays: dict[tuple[Hashable, int], Any] = {}
        """The arrays and lists that were found in fields and in the places of their values, by the place and their
        ids."""
        self.rings: dict[int, Any] = {}
        """The object with the fields of a deque, by its id."""
        self.hints: dict[tuple[type, str], CType | None] = {}
        """The types that classes declare for attributes."""
        self.rebound = FactSet[Value](now)
        """Fields that are assigned another array."""

    def record_name(self, kind: type, members: Any) -> str:
        """Return the name in C of a NamedTuple. No other NamedTuple or type has this name."""
        key = kind, members
        if key not in self.records:
            name = f"machine_{kind.__name__}"
            if not re.fullmatch("[A-Z][A-Za-z0-9]*", kind.__name__) or name in self.records.values():
                name = f"machine_record_{len(self.records)}_{identifier(kind.__name__)}"
            self.records[key] = name
        return self.records[key]

    def place_known(self, value: Any) -> None:
        """Record that the numbers of a list or an array are taken as known when the code is generated. No code changes
        them."""
        self.place_arrays(("known", id(value)), value)

    def place_arrays(self, place: Hashable, value: Any) -> None:
        """Record that a field has this value, which may contain lists or arrays."""
        if isinstance(value, list | np.ndarray):
            self.place_array(place, value)
        if isinstance(value, list | tuple):
            for number, each in enumerate(value):
                self.place_arrays((place, number), each)

    def place_array(self, place: Hashable, value: Any) -> None:
        """Record that a field has this array or list. If the same array or list is found in another place too, it has
        several names."""
        if (place, id(value)) in self.arrays:
            return
        for (each, _), one in self.arrays.items():
            if each != place and (one is value or _overlap(one, value)):
                self.share(each)
                self.share(place)
        self.arrays[place, id(value)] = value

    def rebind(self, place: Value) -> None:
        self.rebound.add(place)

    def assign(self, owner: object, name: str) -> None:
        self.assigned.add((id(owner), name))

    def add_text(self, owner: object, name: str) -> None:
        self.texts.add((id(owner), name))

    def shown_text(self, owner: object, name: str) -> UnknownText:
        """Return the text of a field that is only shown, as far as it is known."""
        key = id(owner), name
        return self.told.setdefault(key, UnknownText.of(key))

    def ask_text(self, text: UnknownText) -> None:
        """Record that the result of a decision in the code depends on this text."""
        if text.field is not None:
            self.asked.add(text.field)

    def take_text(self, owner: object, name: str, text: UnknownText) -> None:
        """Record that a text that is not yet a state is assigned to a field. The field is then not a state either,
        unless the text becomes a state."""
        if text.field is None or text.field in self.made:
            self.made.add((id(owner), name))
        elif (id(owner), name) in self.asked:
            self.ask_text(text)

    def is_text_state(self, owner: object, name: str) -> bool:
        """True if a field is one of several strings written in the code, and is read."""
        is_one = (id(owner), name) in self.asked and (id(owner), name) not in self.made
        return is_one and type(getattr(owner, name, None)) is str

    def text_type(self, *texts: str) -> TextType:
        """Return the type of a string that is one of these, or one of the other strings of the machine."""
        self.words.put(None, tuple(dict.fromkeys((*(self.words.before(None) or ()), *texts))))
        return TextType("uint8_t", self.words.get(None) or ())

    def share(self, place: object) -> None:
        self.shared.add(place)

    def learn(self, where: Facts[Any, CType], key: Any, new: CType, refuse: Callable[[], None]) -> CType:
        """Return the type after this type was added. `refuse` is called if no type can hold values of both."""
        before = where.before(key)
        try:
            where.put(key, new if before is None else joined(before, new))
        except TypeError:
            where.get(key)
            refuse()
            return new
        return where.get(key) or new


def _overlap(one: Any, other: Any) -> bool:
    """True if two arrays are views of the same numbers."""
    return isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and bool(np.may_share_memory(one, other))
