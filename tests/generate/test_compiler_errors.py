"""What a compiler says of generated C is told as a fault of umo, with the line of Python."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.generating import needs_a_compiler
from tools.compiled_machine import compiled
from umo.errors import DeclarationError
from umo.generate.compiler_errors import compiler_message

SOURCE = """\
#include <stdint.h>

/* Pump.control: pump/control.py:12 */
static int py_control(void)
{
    return nothing;
}

/* Pump.stop: pump/control.py:30 */
static int py_stop(void)
{
    int32_t done = 0;
    if (done) { /* control.py:33 */
        done = 1; /* control.py:34 */
        done = nothing;
    }
    return nothing; /* control.py:36 */
}

static int outside(void)
{
    return nothing;
}
"""


def told_of(line: int) -> str:
    return compiler_message(
        f"/tmp/x/machine.c: In function 'f':\n/tmp/x/machine.c:{line}:12: error: 'nothing' undeclared", _source
    )


def _source(name: str) -> str:
    if name != "machine.c":
        raise FileNotFoundError(name)
    return SOURCE


def test_the_function_of_python_is_told() -> None:
    assert told_of(6) == (
        "pump/control.py:12: the compiler rejected the C that umo generated from Pump.control, which is a fault of "
        "umo; write this code differently\nmachine.c:6: 'nothing' undeclared"
    )


@pytest.mark.parametrize(("line", "of_python"), [(12, 30), (13, 33), (14, 34), (15, 34), (17, 36)])
def test_the_line_of_the_statement_is_told(line: int, of_python: int) -> None:
    assert told_of(line).startswith(
        f"pump/control.py:{of_python}: the compiler rejected the C that umo generated from Pump.stop"
    )


def test_what_was_made_of_no_function_is_told_by_its_file() -> None:
    assert told_of(22).startswith(
        "the compiler rejected the C that umo generated in machine.c, which is a fault of umo"
    )
    assert compiler_message("umo_gone.c:3: error: no", _source).startswith(
        "the compiler rejected the C that umo generated in umo_gone.c"
    )


@pytest.mark.parametrize("said", ["", "ld: cannot find -lm\n" * 50])
def test_what_names_no_line_is_told_in_short(said: str) -> None:
    found = compiler_message(said, _source)
    assert found.startswith("the compiler rejected the C that umo generated, which is a fault of umo")
    assert len(found) < 400
    assert "\n" not in found


@needs_a_compiler
def test_a_compiler_that_refuses_a_folder_is_told_in_two_lines(tmp_path: Path) -> None:
    (tmp_path / "machine.c").write_text(SOURCE, "utf-8")
    with pytest.raises(DeclarationError) as raised:
        compiled(tmp_path)
    lines = str(raised.value).splitlines()
    assert lines[0].startswith("pump/control.py:12: the compiler rejected the C that umo generated from Pump.control")
    assert len(lines) == 2
