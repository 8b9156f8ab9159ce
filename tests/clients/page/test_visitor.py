"""The address of a visitor that comes through a proxy."""

from __future__ import annotations

import pytest

from umo.clients.page.visitor import PageToken, Visitor, visitor_of

pytestmark = pytest.mark.full

NOT_TOLD = "a proxy at 127.0.0.1"


def told(*headers: tuple[str, str]) -> str:
    scope = {
        "type": "websocket",
        "client": ("127.0.0.1", 4711),
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers],
    }
    asked = visitor_of(scope, PageToken("a token", is_own=True), is_proxied=True)
    with pytest.raises(StopIteration) as ended:  # it waits for nothing; a test in a browser leaves its loop running
        asked.send(None)
    visitor: Visitor = ended.value.value
    return visitor.address


@pytest.mark.parametrize(
    ("headers", "address"),
    [
        ((), NOT_TOLD),
        ((("x-forwarded-for", "1.2.3.4, 10.0.0.7"),), "10.0.0.7"),
        ((("x-forwarded-for", "1.2.3.4"), ("x-forwarded-for", "10.0.0.7")), "10.0.0.7"),
        ((("forwarded", 'for=1.2.3.4, For="[2001:db8::7]";proto=https'),), "[2001:db8::7]"),
        ((("forwarded", "for=1.2.3.4"), ("forwarded", "proto=https;for=10.0.0.7")), "10.0.0.7"),
        ((("forwarded", "for=10.0.0.7"), ("x-forwarded-for", "10.0.0.7")), "10.0.0.7"),
        ((("forwarded", "for=10.0.0.7"), ("x-forwarded-for", "1.2.3.4")), NOT_TOLD),
        ((("x-forwarded-for", "10.0.0.7,"),), NOT_TOLD),
        ((("x-forwarded-for", "\xe4" * 90),), "?" * 39),
    ],
)
def test_the_address_is_the_one_that_the_nearest_proxy_tells(
    headers: tuple[tuple[str, str], ...], address: str
) -> None:
    assert told(*headers) == address
