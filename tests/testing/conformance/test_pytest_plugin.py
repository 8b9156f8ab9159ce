"""The kit in pytest: a test for each rule, certificates as files. pytest runs in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import TypeAdapter

import umo
from umo.testing.conformance import Certificate

PLUGIN = "umo_pytest"
MODULE = """
import pytest
from umo.drivers.simulated import Simulated
from umo.testing.conformance import Output, Subject, conform

memory = {}

class Card(Simulated):
    def __init__(self):
        super().__init__(history=10)
        self._raws = memory

    def reset(self, channel, default):
        self.write(channel, RESET)

@pytest.fixture(scope="module")
def umo_subject():
    return Subject("card", make=Card, outputs=(Output("valve", 0, 0, 1),))

def test_conformance(umo_conformance):
    umo_conformance.check()
"""
OTHER = """
import sys
import pytest

@pytest.fixture
def conformance():
    return 1

@pytest.fixture
def certificate():
    return 2

def test_of_another_project(conformance, certificate):
    assert conformance + certificate == 3
    assert not [name for name in sys.modules if name.partition(".")[0] in ("umo", "numpy", "rich")]
"""


def run(folder: Path, module: str, *words: str) -> str:
    (folder / "test_card.py").write_text(module)
    (folder / "pytest.ini").write_text("[pytest]\n")
    environment = os.environ | {"PYTHONPATH": str(Path(umo.__file__).parents[1]), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-p", PLUGIN, "-rs", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True).stdout


def test_each_rule_is_a_test_and_those_that_cannot_be_tried_are_skipped(tmp_path: Path) -> None:
    words = ("-v", "--umo-minutes", "0.05", "--umo-certificates", "made")
    said = run(tmp_path, MODULE.replace("RESET", "default"), *words)
    assert "test_conformance[block-write] PASSED" in said
    assert "test_conformance[late-answer] SKIPPED" in said
    assert "there is no line between driver and device" in said
    assert " failed" not in said.splitlines()[-1]
    certificate = TypeAdapter(Certificate).validate_json((tmp_path / "made" / "card.json").read_text())
    assert certificate.passed and certificate.name == "card"


@pytest.mark.full
def test_a_broken_rule_fails_its_test_in_words(tmp_path: Path) -> None:
    said = run(tmp_path, MODULE.replace("RESET", "1"), "--umo-minutes", "0.05", "-k", "reset or end or range")
    assert "card: valve reads 1 after reset(0) from 1, not 0" in said
    assert "1 failed" in said.splitlines()[-1]
    assert "Traceback" not in said


def test_a_project_that_does_not_use_it_has_nothing_of_it(tmp_path: Path) -> None:
    assert "1 passed" in run(tmp_path, OTHER).splitlines()[-1]
