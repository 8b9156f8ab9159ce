"""The face OPC UA with node-opcua as its client."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install 'umo[opcua]'")

from helpers.opcua import OpcUaClient, QuickOpcUa, let_in, named
from umo.testing.faces import RULES, TriedFace, try_rule

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]


async def client(face: Any, user: str) -> OpcUaClient:
    return await OpcUaClient.connect(face.address, named(user))


OPCUA = TriedFace("opcua", lambda: QuickOpcUa(port=0), client)


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.smoke) if each == "kinds" else each for each in RULES]
)
def test_the_face_keeps_the_contract(name: str) -> None:
    assert asyncio.run(try_rule(OPCUA, RULES[name])) in (None, "")
