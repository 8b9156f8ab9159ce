"""The face EPICS keeps the contract of faces, with pvapy as its client. p4p is imported by the test: make test collects
this module in each of its processes."""

from __future__ import annotations

import asyncio
import sys
from importlib.util import find_spec

import pytest

from umo.clients.faces.conformance import RULES, TriedFace, try_rule

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(find_spec("p4p") is None, reason="the face EPICS needs p4p: pip install '.[epics]'"),
    pytest.mark.slow,
]


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.smoke) if each == "kinds" else each for each in RULES]
)
def test_the_face_keeps_the_contract(name: str) -> None:
    from helpers.epics import Pvapy, clients_python, epics

    clients_python()
    face = TriedFace("epics", epics, Pvapy.of, is_named=False)  # the account is that of the process, for all
    assert asyncio.run(try_rule(face, RULES[name])) in (None, "")
