"""The helpers of these tests end in time and say so, instead of hanging."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from . import conftest
from .conftest import Client, serving


class Chatty:
    """A socket on which states keep coming."""

    def recv(self, timeout: float) -> str:
        return '{"type": "state"}'


def test_a_message_that_does_not_come_ends_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conftest, "PATIENCE", 0.05)
    with pytest.raises(TimeoutError, match="no description"):
        Client(Chatty()).get("description")


class Endless:
    """A server that does not end when it is told to."""

    should_exit = False

    def __init__(self, options: Any, ready: Any) -> None:
        self._ready = ready
        self.end = threading.Event()

    def run(self, sockets: Any) -> None:
        self._ready()
        self.end.wait(conftest.PATIENCE * 100)


def test_a_server_that_does_not_end_fails_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conftest, "PATIENCE", 0.2)
    made: list[Endless] = []
    monkeypatch.setattr("umo.clients.page.server.server", lambda *given: made.append(Endless(*given)) or made[0])
    with pytest.raises(AssertionError, match="the server did not end"), serving():
        pass
    made[0].end.set()
