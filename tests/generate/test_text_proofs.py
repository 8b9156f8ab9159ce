"""Texts that are left out of C: what they are made of is proved to have no effect and not to fail, wherever it lies."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np
import pytest

from helpers.side_by_side import HOST, Rig, connected_rig
from helpers.written_programs import Program
from umo.generate.translator import translate


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"

    def __str__(self) -> str:
        return self.name.lower()


class Counted:
    """Its text has an effect."""

    shown = 0

    def __str__(self) -> str:
        self.shown += 1
        return f"{self.shown}"


class Texts(Program):
    found: float | None

    def begin(self) -> None:
        self.side, self.counted, self.title = Side.LEFT, Counted(), "tank"
        self.row, self.numbers = [1.0, 2.0], np.array([1.0, 2.0])
        self.found = None

    @property
    def state(self) -> str:
        if self.found is None:
            return "nothing"
        text = f"{self.found:.1f}"
        text += " mm"
        return text if self.side is Side.LEFT else text.upper()

    @property
    def next_state(self) -> str:
        self.title = "next"
        return self.title

    def named(self, chosen: object) -> str:
        places = np.flatnonzero(chosen)
        return f"zone{'s' * (len(places) > 1)} {', '.join(map(str, places[:3]))}" if len(places) else ""

    def first_of(self, chosen: object) -> str:
        return f"{np.flatnonzero(chosen)[0]}"

    def proved(self) -> None:
        high = self.numbers > 1.5
        print(f"{self.side} {self.title!r} {self.k:+08.3f} {self.n:3d} {self.state}")
        print(self.named(high), self.numbers.max(), len(self.row), self.row[-1], f"{self.k / 4.0 + 1.0:.2f}")
        print(", ".join(f"{each:.1f}" for each in self.row if each > 1.0), "{}: {:.1f}".format("k", self.k))
        print(f"{self.found:.1f}" if self.found is not None else "none")

    def of_an_effect(self) -> None:
        print(f"{self.counted}")

    def of_a_property_that_assigns(self) -> None:
        print(self.next_state)

    def of_a_place_that_may_be_missing(self) -> None:
        print(self.first_of(self.numbers > 1.5))

    def of_an_element_beyond_the_end(self) -> None:
        print(self.row[2])

    def of_what_may_be_none(self) -> None:
        print(f"{self.found:.1f}")

    def with_another_value(self, found: float | None) -> str:
        if found is not None:
            found = self.found
            return f"{found:.1f}"
        return ""

    def with_another_value_by_a_condition(self, found: float | None) -> str:
        if found is None:
            return ""
        if self.k > 0.0:
            found = self.found
        return f"{found:.1f}"

    def of_a_name_that_has_another_value(self) -> None:
        print(self.with_another_value(self.found))

    def of_a_name_that_may_have_another_value(self) -> None:
        print(self.with_another_value_by_a_condition(self.found))

    def of_a_call_with_too_few_arguments(self) -> None:
        print(f"{abs()}")  # type: ignore[call-arg]

    def of_a_method_with_too_few_arguments(self) -> None:
        print(self.title.replace("a"))  # type: ignore[call-arg]

    def of_a_quotient(self) -> None:
        print(f"{self.k / self.u}")


@pytest.fixture(scope="module")
def texts() -> Iterator[tuple[Rig, Texts]]:
    with connected_rig() as (machine, _):
        yield machine, Texts(machine)


def test_what_is_proved_is_left_out(texts: tuple[Rig, Texts]) -> None:
    machine, program = texts
    assert translate(machine, [], [program.proved], HOST).problems == []


REFUSED = {
    "of_an_effect": "self.shown += 1",
    "of_a_property_that_assigns": "self.title: it may change something or fail",
    "of_a_place_that_may_be_missing": "it may not have this element",
    "of_an_element_beyond_the_end": "it may not have this element",
    "of_what_may_be_none": "does not suit all possible values",
    "of_a_name_that_has_another_value": "does not suit all possible values",
    "of_a_name_that_may_have_another_value": "does not suit all possible values",
    "of_a_call_with_too_few_arguments": "it may change something or fail",
    "of_a_method_with_too_few_arguments": "replace expected",
    "of_a_quotient": "it may change something or fail",
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_proved_is_refused_with_its_reason(texts: tuple[Rig, Texts], name: str) -> None:
    machine, program = texts
    (problem,) = translate(machine, [], [getattr(program, name)], HOST).problems
    assert "it is not proved that the text has no effect and cannot fail" in problem.reason
    assert REFUSED[name] in problem.reason
