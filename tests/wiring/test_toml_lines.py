"""The lines of the keys of a wiring or a recipe."""

from __future__ import annotations

import pytest

from umo.toml_lines import LONGEST, line_of, lines_of

TEXT = '''# a comment
fault_seed = 7
[wire]
"z.motor" = { driver = "box", channel = "dac:1" }
z.encoder.driver = "box"

[drivers."box.a"]
channels = [
  "a",  # [
  { deep = 1 },
]
text = """
[wire]
"""
last = 1
[[many]]
each = 1
[[many]]
each = 2
'''


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("fault_seed", 2),
        ('wire."z.motor"', 4),
        ('wire."z.motor".channel', 4),
        ('wire."z.encoder".driver', 5),
        ('wire."z.encoder"', 5),
        ("drivers.box.a", 7),
        ("drivers.box.a.channels", 8),
        ("drivers.box.a.text", 12),
        ("drivers.box.a.last", 15),
        ("many.each", 17),
    ],
)
def test_a_key_has_the_line_at_which_it_begins(key: str, line: int) -> None:
    assert line_of(key, lines_of(TEXT)) == line


@pytest.mark.parametrize(("key", "line"), [("drivers.box.a.type", 7), ("wire.'x'", 3), ("other", None), ("", None)])
def test_a_key_that_is_missing_has_the_line_of_its_table(key: str, line: int | None) -> None:
    assert line_of(key, lines_of(TEXT)) == line


def test_behind_a_value_of_very_many_lines_no_key_has_a_line() -> None:
    text = "a = 1\nb = [\n" + "1,\n" * LONGEST + "]\nc = 1\n"
    assert lines_of(text) == {"a": 1}
