"""Answers a page's question about the tuning of a law with the gains and the data for the drawings. Needs the extra
`tune`."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from umo.clients.page.subscriptions import BadRequest, HistoryPart
from umo.clients.page.watched_run import Watched
from umo.errors import UmoError, text_of
from umo.system.packages import how_to_install

MOST_POINTS = 300
"""Largest number of points of a curve."""
MAX_RESPONSE_TIME = 3600.0
"""Longest time in s of a response."""


class TuningQuestion:
    """The question of a page for the gains of a law, computed from the history. `message`: `facts` as the law's action
    `law` returns them, `start`, `stop` (s), `relay`. Raises BadRequest for an invalid message."""

    def __init__(self, watched: Watched, message: dict[str, Any]) -> None:
        try:
            from umo.commissioning.tuning.law_facts import LawFacts
        except ImportError:
            raise BadRequest(f"tuning needs scipy: {how_to_install('tune')}") from None
        try:
            facts = LawFacts.of(message["facts"])
        except (KeyError, TypeError, ValueError):
            raise BadRequest("facts must be the facts of a law") from None
        self._part = HistoryPart.of(watched, message | {"paths": facts.columns})
        if self._part.stop - self._part.start > MAX_RESPONSE_TIME:
            raise BadRequest(f"a response may be at most {MAX_RESPONSE_TIME:g} s long")
        try:
            self._facts = facts.described(watched.entries)
        except (UmoError, KeyError) as error:
            raise BadRequest(str(error)) from None
        self._relay = message.get("relay") is True

    def answer(self, head: dict[str, Any]) -> str:
        """Return the answer, which may be an error as text. Any thread may call it."""
        try:
            return json.dumps(head | self._found())
        except ImportError:
            text = f"tuning needs scipy: {how_to_install('tune')}"
        except Exception as error:  # of numbers that a page has given: the others are shown
            text = str(error) if isinstance(error, UmoError) else f"no gains were found: {text_of(error)}"
        return json.dumps({"type": "error", "id": head.get("id"), "text": text})

    def _found(self) -> dict[str, Any]:
        from umo.commissioning.tuning.measured_response import MeasuredResponse
        from umo.commissioning.tuning.plain_result import as_data, finite
        from umo.commissioning.tuning.tuning_result import tuned

        part = self._part
        measured = MeasuredResponse.of_history(part.watched.history, part.columns, part.start, part.stop)
        result = tuned(self._facts, measured, self._relay)
        response = result.response.thinned()
        curves = {"times": response.times, "measured": response.measurements, "predicted": result.identified.predicted}
        steps = {name: {"times": _few(s.times), "values": _few(s.measurements)} for name, s in result.steps.items()}
        found: dict[str, Any] = finite({name: _few(curve) for name, curve in curves.items()} | {"steps": steps})
        return as_data(result) | found


def _few(curve: Any) -> list[float]:
    every = -(-len(curve) // MOST_POINTS)
    few: list[float] = np.asarray(curve)[:: max(every, 1)].tolist()
    return few
