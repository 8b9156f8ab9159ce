"""A mirror of a station whose gateway does not answer any more."""

from __future__ import annotations

import sys
import threading
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleet_histories import KnownRun
from helpers.fleets import PLANT
from helpers.waiting import until
from umo.clients.fleet import run_feed
from umo.clients.fleet.fleet_mirror import FleetMirror

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


class Session:
    """Of a station that declares itself once, and then answers nothing."""

    def __init__(self, declaration: bytes) -> None:
        self._declarations = [declaration]
        self.put: dict[str, Any] = {}

    def declare_subscriber(self, key: str, put: Any) -> Any:
        self.put[key] = put
        return SimpleNamespace(undeclare=lambda: None)

    def get(self, key: Any, handler: Any = None, **more: Any) -> Any:
        if handler is not None:
            handler.drop()
            return None
        found, self._declarations = self._declarations, []
        return [SimpleNamespace(ok=SimpleNamespace(payload=each)) for each in found]

    def close(self) -> None:
        pass

    def __getattr__(self, name: str) -> Any:
        return lambda *args, **more: self

    def come(self, data: bytes) -> None:
        self.put[PLANT.key("delta")](SimpleNamespace(payload=data))


def test_the_last_delta_ends_a_mirror_also_if_what_is_before_it_does_not_come_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_feed, "RETRY_DELAY", 0.0)
    known, threads = KnownRun(), threading.active_count()
    session = Session(known.declaration(0))
    mirror = FleetMirror(session, PLANT, "ann")  # type: ignore[arg-type]
    session.come(known.delta(1))
    session.come(known.delta(3, is_last=True))
    until(lambda: threading.active_count() == threads)
    mirror.close()
