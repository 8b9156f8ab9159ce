"""A run in virtual time in which nothing moves any more: it may wait for ever."""

from __future__ import annotations

from collections.abc import Callable

from umo.cycle import Frame

STILL_TIME = 600.0
"""s on the machine's clock without a change after which it is said."""
LOOK_PERIODS = 997
"""Periods between two looks: a prime number, so that a machine that repeats itself is hardly taken for a still one."""


class Stillness:
    """An observer that says once that no value has changed for a long time, and where the application waits."""

    def __init__(self, say: Callable[[str], object], places: Callable[[], list[str]]) -> None:
        self._say = say
        self._places = places
        self._periods = 0
        self._before: object = None
        self._since = 0.0

    def __call__(self, frame: Frame) -> None:
        self._periods += 1
        if self._periods % LOOK_PERIODS:
            return
        now = (list(frame.raws), frame.progress)
        if now != self._before:
            self._before, self._since = now, frame.time
        elif frame.time - self._since >= STILL_TIME:
            places = ", ".join(filter(None, self._places()))
            where = f"the application waits at {places}" if places else "there is no application"
            self._say(
                f"nothing has changed for {STILL_TIME:g} s of the machine's time: {where}; "
                "Ctrl-C ends the run (--until TIME would)"
            )
            self._since = float("inf")
