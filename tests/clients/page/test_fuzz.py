"""Hostile messages on the websocket of a page: each is answered or passed over, and the page goes on."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed

from umo.testing import Scripted

from .conftest import Client, opened, running, serving

pytestmark = pytest.mark.full

ODD = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20),
    st.sampled_from([10**400, -(2**63), "__proto__", "\ud800", "encoder", "valve", "press", [], {}, ["encoder"] * 70]),
)  # fmt: skip
DEEP = st.recursive(
    ODD, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
)
KINDS = ("watch", "live", "stop", "window", "measure", "command", "touch", "server", "state", "")
NAMES = (
    "id", "name", "paths", "span", "width", "trigger", "start", "stop", "do", "path", "value", "arguments", "over",
    "who", "number", "held",
)  # fmt: skip
WHOLE = st.fixed_dictionaries(
    {"type": st.sampled_from(KINDS) | ODD, "id": st.integers(0, 99) | ODD},
    optional={
        name: DEEP
        | {
            "paths": st.lists(st.sampled_from(["encoder", "valve", "none"]), max_size=4),
            "do": st.sampled_from(["lease", "stop", "write", "tune", "call", "acknowledge", "mode", "keep"]),
            "trigger": st.fixed_dictionaries({"path": st.just("encoder"), "kind": st.just("rising"), "level": ODD}),
        }.get(name, st.floats(-1e6, 1e6))
        for name in NAMES
        if name != "id"
    },
)
MESSAGES = st.one_of(
    WHOLE.map(json.dumps), DEEP.map(json.dumps), st.text(max_size=60), st.sampled_from(["[" * 9000, '{"type":', "\0"])
)


def is_there(client: Client) -> bool:
    """It still gets the states of the station that it chooses."""
    client.send(type="watch", name="press")
    client.get("description")
    return bool(client.get("state")["values"])


def test_a_page_goes_on_after_whatever_it_was_sent(capfd: pytest.CaptureFixture[str]) -> None:
    @settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.lists(MESSAGES, min_size=5, max_size=40))
    def hold(messages: list[str]) -> None:
        with opened(served.socket) as client:
            for message in messages:
                client.send_text(message.encode(errors="replace").decode())
            assert is_there(client)

    with running(box=Scripted({"encoder": range(1, 100_000)})), serving() as served:
        hold()
        with opened(served.socket) as another:
            assert is_there(another)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("data, text", [(b"", False), (b"\0\1", False), (bytes(70_000), False), (b"\xee", True)])
def test_a_message_that_is_no_text_or_too_long_ends_the_page_that_sent_it_only(
    data: bytes, text: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    with running(), serving() as served, opened(served.socket) as other:
        with opened(served.socket) as client:
            client.get("server")
            client.send_text(data, text=text)
            with pytest.raises(ConnectionClosed):
                client.get("nothing")
        assert is_there(other)
    assert capfd.readouterr().err == ""
