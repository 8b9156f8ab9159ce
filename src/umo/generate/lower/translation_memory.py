"""What is learnt of the types while code is translated, again and again until nothing is new."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from umo.generate.c_types import CType, TextType, joined
from umo.generate.form import Value
from umo.generate.lower.terms import UnknownText
from umo.generate.names import identifier

MOST_PASSES = 12


@dataclass
class TranslationMemory:
    """Types of fields by object and name, of local names and results by function; which fields are assigned."""

    assigned: set[tuple[int, str]] = field(default_factory=set)
    texts: set[tuple[int, str]] = field(default_factory=set)
    """Fields to which a text is assigned: they do not exist on a controller, but for those that code asks."""
    asked: set[tuple[int, str]] = field(default_factory=set)
    """Those of them by which code decides: each is one of the texts of the machine."""
    told: dict[tuple[int, str], UnknownText] = field(default_factory=dict)
    """The texts of those that code only tells so far."""
    made: set[tuple[int, str]] = field(default_factory=set)
    """Those of them whose text is made at run time."""
    words: list[str] = field(default_factory=list)
    """The texts of the machine; a text is its number among them."""
    shared: set[Any] = field(default_factory=set)
    """Arrays that may have several names: fields; function and name of local ones, where it is in a loop."""
    fields: dict[tuple[int, str], CType] = field(default_factory=dict)
    locals: dict[tuple[Any, str], CType] = field(default_factory=dict)
    results: dict[Any, CType] = field(default_factory=dict)
    of_numpy: set[tuple[int, str]] = field(default_factory=set)
    """Fields that numbers of numpy are assigned to."""
    records: dict[Any, str] = field(default_factory=dict)
    """Names in C of NamedTuples, by class and members."""
    arrays: dict[tuple[Hashable, int], Any] = field(default_factory=dict)
    """The arrays and lists that fields, and places in their values, were, by the place and their ids."""
    rings: dict[int, Any] = field(default_factory=dict)
    """What has the fields of a deque, by its id."""
    rebound: set[Value] = field(default_factory=set)
    """Fields to which another array is assigned."""
    changed: bool = False

    def record_name(self, kind: type, members: Any) -> str:
        """The name in C of a NamedTuple: no other one has it, and no other type."""
        key = kind, members
        if key not in self.records:
            name = f"machine_{kind.__name__}"
            if not re.fullmatch("[A-Z][A-Za-z0-9]*", kind.__name__) or name in self.records.values():
                name = f"machine_record_{len(self.records)}_{identifier(kind.__name__)}"
            self.records[key] = name
        return self.records[key]

    def place_known(self, value: Any) -> None:
        """Numbers of a list or an array are taken as they are when the code is generated: nothing changes them."""
        self.place_arrays(("known", id(value)), value)

    def place_arrays(self, place: Hashable, value: Any) -> None:
        """A field has this value: a list or an array, or one with such in it."""
        if isinstance(value, list | np.ndarray):
            self.place_array(place, value)
        if isinstance(value, list | tuple):
            for number, each in enumerate(value):
                self.place_arrays((place, number), each)

    def place_array(self, place: Hashable, value: Any) -> None:
        """A field has this array or list: one that is found at another place, too, has several names."""
        if (place, id(value)) in self.arrays:
            return
        for (each, _), one in self.arrays.items():
            if each != place and (one is value or _overlap(one, value)):
                self.share(each)
                self.share(place)
        self.arrays[place, id(value)] = value
        self.changed = True

    def rebind(self, place: Value) -> None:
        if place not in self.rebound:
            self.rebound.add(place)
            self.changed = True

    def assign(self, owner: object, name: str) -> None:
        self._note(self.assigned, owner, name)

    def add_text(self, owner: object, name: str) -> None:
        self._note(self.texts, owner, name)

    def told_text(self, owner: object, name: str) -> UnknownText:
        """The text of a field that is only told, as far as is known."""
        key = id(owner), name
        return self.told.setdefault(key, UnknownText.of(key))

    def ask_text(self, text: UnknownText) -> None:
        """Code decides by this text."""
        if text.field is not None and text.field not in self.asked:
            self.asked.add(text.field)
            self.changed = True

    def take_text(self, owner: object, name: str, text: UnknownText) -> None:
        """A field is assigned a text that is no state so far: it is none either, unless the text becomes one."""
        if text.field is None or text.field in self.made:
            self._note(self.made, owner, name)
        elif (id(owner), name) in self.asked:
            self.ask_text(text)

    def _note(self, where: set[tuple[int, str]], owner: object, name: str) -> None:
        if (id(owner), name) not in where:
            where.add((id(owner), name))
            self.changed = True

    def is_text_state(self, owner: object, name: str) -> bool:
        """Whether a field is one of several texts that are written down, and is read."""
        is_one = (id(owner), name) in self.asked and (id(owner), name) not in self.made
        return is_one and type(getattr(owner, name, None)) is str

    def text_type(self, *texts: str) -> TextType:
        """The type of a text that may be one of these, or of the others of the machine."""
        for each in texts:
            if each not in self.words:
                self.words.append(each)
                self.changed = True
        return TextType("uint8_t", tuple(self.words))

    def share(self, place: object) -> None:
        if place not in self.shared:
            self.shared.add(place)
            self.changed = True

    def learn(self, where: dict[Any, Any], key: Any, new: CType, refuse: Callable[[], None]) -> CType:
        """The type of this after it has this one too; `refuse` is called if there is none for both."""
        before = where.get(key)
        try:
            after = new if before is None else joined(before, new)
        except TypeError:
            refuse()
            return new
        if after != before:
            where[key] = after
            self.changed = True
        return after


def _overlap(one: Any, other: Any) -> bool:
    """Whether two arrays are views of the same numbers."""
    return isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and bool(np.may_share_memory(one, other))
