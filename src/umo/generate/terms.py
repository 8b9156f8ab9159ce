"""What an expression is while it is translated: a text of C, a live object, or several of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from umo.generate.c_types import CType


@dataclass(frozen=True)
class Code:
    """A value that the controller computes."""

    type: CType
    text: str
    stable: bool = False
    """Whether it is the same whatever is computed before it is used: a literal, or a name that nothing assigns."""


@dataclass(frozen=True)
class Elements(Code):
    """An array that is computed element by element: `text` is one element, with `@` for its place."""


@dataclass(frozen=True, eq=False)
class Known:
    """Something that is known when the code is generated."""

    value: Any
    owner: Any = None
    """The live object whose attribute it is."""
    name: str = ""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Known) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


class UnknownText(str):
    """A text that is made at run time: a controller has none. It may be the message of an error."""

    __slots__ = ()


TEXT = UnknownText()


@dataclass(frozen=True)
class Many:
    """A tuple of terms."""

    terms: tuple[Term, ...]
    names: tuple[str, ...] = ()
    kind: Any = None


@dataclass(frozen=True)
class Present:
    """Something that is only asked for whether it is None, such as the reason of an inhibition."""

    text: str
    """The condition in C under which it is not None."""


Term = Code | Known | Many | Present
