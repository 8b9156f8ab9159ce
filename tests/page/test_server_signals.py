"""The server of the page ends at a signal, whatever its loop is at work with."""

from __future__ import annotations

import signal
from contextlib import closing

import pytest
import uvicorn
from starlette.applications import Starlette

from umo.errors import Interrupted
from umo.page.server import Server, listen


def hang() -> None:
    """Three signals come while a call does not end."""
    for _ in range(3):
        signal.raise_signal(signal.SIGTERM)
    pytest.fail("it goes on")


def stop_twice() -> None:
    for _ in range(2):
        signal.raise_signal(signal.SIGTERM)


def test_a_further_signal_ends_a_page_that_hangs_and_says_where() -> None:
    config = uvicorn.Config(Starlette(), lifespan="off", log_level="error")
    said = r"^the page does not end \(.*test_server_signals.py:\d+\)$"
    with closing(listen("127.0.0.1", 0)) as listening, pytest.raises(Interrupted, match=said) as told:
        Server(config, hang).run(sockets=[listening])
    assert told.value.number == signal.SIGTERM


def test_two_signals_end_a_page_that_does_not_hang() -> None:
    config = uvicorn.Config(Starlette(), lifespan="off", log_level="error")
    with closing(listen("127.0.0.1", 0)) as listening:
        serving = Server(config, stop_twice)
        serving.run(sockets=[listening])
    assert (serving.should_exit, serving.force_exit, serving.failure) == (True, True, None)
