"""The page's JavaScript without a browser: its unit tests, in node."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "javascript"


def test_the_unit_tests_of_the_javascript_pass() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("the unit tests of the page's JavaScript need node 20 or newer")
    files = sorted(map(str, FOLDER.glob("*.test.js")))
    done = subprocess.run([node, "--test", *files], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout
