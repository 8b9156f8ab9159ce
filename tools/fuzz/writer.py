"""What writes a program at random: choices, names that have values, fields, and typed expressions and statements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from random import Random
from typing import Literal

Kind = Literal["real", "whole", "truth"]
Write = Callable[["Writer"], str]
"""An expression."""
WriteLines = Callable[["Writer"], list[str]]
"""Statements."""
LEAF = 0.25
"""The share of expressions that go no deeper."""
COMPOUND = 0.35
"""The share of statements that have statements in them."""
IDIOM = 0.15
DEEPEST = 3


class Writer:
    """The text of one program."""

    def __init__(self, random: Random, grammar: Grammar) -> None:
        self.random, self._grammar = random, grammar
        self.setup: list[str] = []
        """Statements of `setup`."""
        self.names: dict[Kind, list[str]] = {"real": [], "whole": [], "truth": []}
        """Local names that have a value here, by their types."""
        self.turns: set[str] = set()
        """Those that count the turns of loops: nothing is assigned to them, so that loops end."""
        self.may_return = True
        self._may_call = True
        self._left = 2
        self._depth = self._number = 0

    # Choices ---------------------------------------------------------------------------------------------

    def pick(self, *options: str) -> str:
        return self.random.choice(options)

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def new(self, stem: str) -> str:
        """A name that nothing has yet."""
        self._number += 1
        return f"{stem}{self._number}"

    def field(self, stem: str, value: str) -> str:
        """A new attribute, with this value at first."""
        name = f"self.{self.new(stem)}"
        self.setup.append(f"{name} = {value}")
        return name

    def once(self, line: str) -> None:
        """A statement of `setup`, which is there once."""
        if line not in self.setup:
            self.setup.append(line)

    def assignable(self, kind: Kind) -> list[str]:
        return [name for name in self.names[kind] if name not in self.turns]

    # Expressions -----------------------------------------------------------------------------------------

    def real(self, depth: int | None = None) -> str:
        return self._expression("real", depth)

    def whole(self, depth: int | None = None) -> str:
        return self._expression("whole", depth)

    def truth(self, depth: int | None = None) -> str:
        return self._expression("truth", depth)

    def array(self, depth: int = 2) -> str:
        """An array of three real numbers."""
        deeper = depth > 0 and not self.chance(LEAF)
        return self.random.choice(self._grammar.arrays if deeper else self._grammar.array_leaves)(self)

    @contextmanager
    def without_calls(self) -> Iterator[None]:
        """What is written meanwhile calls nothing that may change something: it stands in a generator."""
        before, self._may_call = self._may_call, False
        yield
        self._may_call = before

    def _expression(self, kind: Kind, depth: int | None) -> str:
        before = self._left
        self._left = before - 1 if depth is None else min(depth, before) - 1
        if self._left < 0 or self.chance(LEAF):
            options = self._grammar.leaves[kind]
        else:
            options = self._grammar.expressions[kind]
            if self._may_call and self.chance(0.2):
                options = self._grammar.calls[kind]
        found = self.random.choice(options)(self)
        self._left = before
        return found

    def local(self, kind: Kind, otherwise: str) -> str:
        return self.pick(*self.names[kind]) if self.names[kind] else otherwise

    # Statements ------------------------------------------------------------------------------------------

    def statement(self) -> list[str]:
        if self.chance(IDIOM) and self._depth < 2:
            return self.random.choice(self._grammar.idioms)(self)
        if self._depth < DEEPEST and self.chance(COMPOUND):
            return self.random.choice(self._grammar.compound)(self)
        return self.random.choice(self._grammar.simple)(self)

    def block(self, most: int = 3) -> list[str]:
        """Some statements, one deeper; local names that they make are not used after it."""
        self._depth += 1
        with self.scope():
            lines = [line for _ in range(self.random.randint(1, most)) for line in self.statement()]
        self._depth -= 1
        return indented(lines)

    @contextmanager
    def scope(self) -> Iterator[None]:
        """Names that get a value meanwhile are not used afterwards."""
        kept = {kind: list(names) for kind, names in self.names.items()}
        yield
        self.names = kept  # type: ignore[assignment]

    @contextmanager
    def in_finally(self) -> Iterator[None]:
        """What is written meanwhile does not return, which would forget an error."""
        before, self.may_return = self.may_return, False
        yield
        self.may_return = before


class Grammar:
    """What a writer chooses from."""

    def __init__(
        self,
        leaves: dict[Kind, Sequence[Write]],
        expressions: dict[Kind, Sequence[Write]],
        calls: dict[Kind, Sequence[Write]],
        arrays: tuple[Sequence[Write], Sequence[Write]],
        simple: Sequence[WriteLines],
        compound: Sequence[WriteLines],
        idioms: Sequence[WriteLines],
    ) -> None:
        self.leaves, self.expressions, self.calls = leaves, expressions, calls
        self.array_leaves, self.arrays = arrays
        self.simple, self.compound, self.idioms = simple, compound, idioms


def indented(lines: Sequence[str], by: int = 1) -> list[str]:
    return [f"{'    ' * by}{line}" for line in lines]
