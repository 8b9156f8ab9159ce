"""The server of the page ends at a signal, whatever its loop is at work with."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
import uvicorn
from starlette.applications import Starlette

from umo.clients.page.server import Server
from umo.errors import Interrupted


@pytest.fixture
def serving() -> Iterator[Server]:
    """One that has the signals, as uvicorn lets it have them while it serves."""
    serving = Server(uvicorn.Config(Starlette(), log_level="error"), lambda: None)
    before = signal.signal(signal.SIGTERM, serving.handle_exit)
    yield serving
    signal.signal(signal.SIGTERM, before)


def test_the_first_signal_asks_a_page_to_end_and_the_second_is_without_grace(serving: Server) -> None:
    found = []
    for _ in range(2):
        signal.raise_signal(signal.SIGTERM)
        found.append((serving.should_exit, serving.force_exit))
    assert found == [(True, False), (True, True)]


def test_a_further_signal_ends_a_page_that_hangs_and_says_where(serving: Server) -> None:
    for _ in range(2):
        signal.raise_signal(signal.SIGTERM)
    said = r"^the page does not end \(.*test_server_signals.py:\d+\)$"
    with pytest.raises(Interrupted, match=said) as told:
        signal.raise_signal(signal.SIGTERM)
    assert told.value.number == signal.SIGTERM
