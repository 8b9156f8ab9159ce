"""What a function that is being translated asks of all the others (`umo.generate.code_world.CodeWorld`)."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from umo.generate.function_source import SourcedFunction
from umo.generate.known_values import KnownValues
from umo.generate.live_fields import LiveFields
from umo.generate.terms import Term
from umo.generate.translation import Untranslatable
from umo.generate.translation_memory import TranslationMemory
from umo.objects.atomic import Atomic


class CodeContext(Protocol):
    """The machine and its other functions."""

    memory: TranslationMemory
    fields: LiveFields
    known: KnownValues
    """What is taken as known."""
    on_host: list[Untranslatable]
    """What works on this computer only."""

    def place(self, owner: Atomic) -> str:
        """The text of an atomic object."""

    def table(self, slots: Sequence[int]) -> str:
        """The name of a table of the numbers of objects."""

    def fault(self, kind: type[BaseException], text: str, file: str, line: int) -> int:
        """The number of a fault."""

    def note(self, text: str) -> None:
        """Something that is to be said of the C."""

    def note_inexact(self, name: str) -> None:
        """This function may differ from Python's."""

    def is_a(self, fault: str, kinds: tuple[type[BaseException], ...]) -> str:
        """The condition that a fault is of one of these classes."""

    def host_call(self, owner: Any, name: str) -> int:
        """The number of what the host is asked for."""

    def result_of(self, scope: Any, term: Term, node: ast.AST) -> str:
        """The text of a result; "": there is none."""

    def invoke(self, caller: Any, source: SourcedFunction, terms: Mapping[str, Term], node: ast.AST) -> Term:
        """A call of a function: its result."""
