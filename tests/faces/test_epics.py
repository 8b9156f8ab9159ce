"""The face EPICS with pvapy as its client, and with ophyd-async and bluesky."""

from __future__ import annotations

import asyncio
import sys

import pytest

pytest.importorskip("p4p", reason="the face EPICS needs p4p: pip install 'umo[epics]'")

from helpers.epics import Pvapy, epics, foreign_python
from umo.testing.faces import RULES, TriedFace, try_rule

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]
EPICS = TriedFace("epics", epics, Pvapy.of, is_named=False)  # the account is that of the process, for all


@pytest.fixture(autouse=True, scope="module")
def clients() -> None:
    foreign_python()


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.smoke) if each == "kinds" else each for each in RULES]
)
def test_the_face_keeps_the_contract(name: str) -> None:
    assert asyncio.run(try_rule(EPICS, RULES[name])) in (None, "")
