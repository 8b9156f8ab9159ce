"""The page's JavaScript without a browser: its unit tests, in node."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from helpers.tiers import first, named

FOLDER = Path(__file__).parent / "javascript"


TOGETHER = ["--input-type=module", "--eval", "for (const file of process.argv.slice(1)) await import(file);"]
"""All files in one process of node, in place of one for each."""


@pytest.mark.parametrize("words", first(1, named(["together", "apart"], [TOGETHER, ["--test"]])))
def test_the_unit_tests_of_the_javascript_pass(words: list[str]) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("the unit tests of the page's JavaScript need node 20 or newer")
    files = sorted(map(str, FOLDER.glob("*.test.js")))
    done = subprocess.run([node, *words, *files], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout
    assert re.search(r"^\S+ pass [1-9]\d+$", done.stdout, re.MULTILINE), done.stdout
