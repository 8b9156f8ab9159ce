"""A text of one of several objects."""

from __future__ import annotations

from typing import Any

from helpers.written_programs import Program


class TextPart:
    def __init__(self, value: Any) -> None:
        self.value = value


class OneOfSeveralTexts(Program):
    def begin(self) -> None:
        self.parts = TextPart("a"), TextPart("b")

    def control(self) -> None:
        # refused: it is a different object or text for each of several objects; a loop
        self.yes = self.parts[self.n].value == "a"
