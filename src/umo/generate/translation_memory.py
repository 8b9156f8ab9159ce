"""What is learnt of the types while code is translated, again and again until nothing is new."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from umo.generate.c_types import CType, joined
from umo.generate.terms import Known

MOST_PASSES = 12


@dataclass
class TranslationMemory:
    """Types of fields by object and name, of local names and results by function; which fields are assigned."""

    assigned: set[tuple[int, str]] = field(default_factory=set)
    texts: set[tuple[int, str]] = field(default_factory=set)
    """Fields to which a text is assigned: they do not exist on a controller."""
    shared: set[Any] = field(default_factory=set)
    """Arrays that may have several names: texts of fields; function and name of local ones, where it is in a loop."""
    fields: dict[tuple[int, str], CType] = field(default_factory=dict)
    locals: dict[tuple[Any, str], CType | Known] = field(default_factory=dict)
    results: dict[Any, CType] = field(default_factory=dict)
    of_numpy: set[tuple[int, str]] = field(default_factory=set)
    """Fields that numbers of numpy are assigned to."""
    changed: bool = False

    def assign(self, owner: object, name: str) -> None:
        if (id(owner), name) not in self.assigned:
            self.assigned.add((id(owner), name))
            self.changed = True

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
