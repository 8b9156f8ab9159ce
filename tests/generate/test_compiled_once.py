"""The compiler of a session of the tests (tests/helpers/once/cc): it compiles the files of umo's runtime once."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from umo.generate.controller_folder import BOARDS, RUNTIME
from umo.generate.law_library import ON_HOST

ONCE = Path(__file__).parents[1] / "helpers" / "once" / "cc"
Compile = Callable[..., tuple[int, str]]
needs_it = pytest.mark.skipif(
    not ("COMPILED_BY" in os.environ and shutil.which("sha256sum")), reason="needs cc and sha256sum"
)


@pytest.fixture
def compile_and_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Compile:
    """Compiles a program of one file of the runtime: its status, and what the compiler says."""
    monkeypatch.setenv("COMPILED_ONCE", str(tmp_path / "kept"))
    (tmp_path / "main.c").write_text("int umo_sum(void);\nint main(void)\n{\n    return umo_sum();\n}\n")

    def call(number: int = 1, *flags: str, also: str = "") -> tuple[int, str]:
        (tmp_path / "umo.h").write_text(f"#define NUMBER {number}\n#ifndef ADDED\n#define ADDED 0\n#endif\n")
        source = f'#include "umo.h"\nint umo_sum(void);\nint umo_sum(void)\n{{\n    {also}return NUMBER + ADDED;\n}}\n'
        (tmp_path / "umo_sums.c").write_text(source)
        words = [ONCE, "-Wall", *flags, "-o", "program", "main.c", "umo_sums.c", "-lm"]
        done = subprocess.run(words, cwd=tmp_path, check=False, capture_output=True, text=True)
        return subprocess.run([tmp_path / "program"], check=False).returncode, done.stderr

    return call


@needs_it
def test_the_same_contents_with_the_same_flags_are_one_object(compile_and_run: Compile, tmp_path: Path) -> None:
    numbers = [compile_and_run(*given)[0] for given in ((1,), (2,), (2, "-DADDED=5"), (1,))]
    assert numbers == [1, 2, 7, 1]
    assert len([*(tmp_path / "kept").iterdir()]) == 3


@needs_it
def test_what_the_compiler_says_something_about_is_not_kept(compile_and_run: Compile) -> None:
    for _ in range(2):
        _, said = compile_and_run(1, also="int unused; ")
        assert "unused" in said
    _, said = compile_and_run(1, "-Werror", also="int unused; ")
    assert "error: unused variable" in said


def test_the_files_that_are_compiled_once_include_only_headers_that_are_the_same_for_every_machine() -> None:
    """Each is in the sum of the contents, as its name begins with umo."""
    names = re.findall(r"\*(umo_\w+\.c)", ONCE.read_text("utf-8"))
    places = RUNTIME, ON_HOST, BOARDS / "link"
    headers = {each.name: each.read_text("utf-8") for place in places for each in place.glob("*.h")}
    of_c = {each.name: each.read_text("utf-8") for place in places for each in place.glob("*.c")}
    waiting, seen = list(names), {"umo_target.h"}
    assert {each.name for each in RUNTIME.glob("umo_*.c")} <= {*names}
    while waiting:
        text = (of_c | headers)[waiting.pop()]
        more = {*re.findall(r'#include "([^"]+)"', text)} - seen
        assert all(each.startswith("umo") for each in more)
        seen |= more
        waiting += more
