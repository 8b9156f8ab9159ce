"""The signs of life of the control process, as its guardian sees them: when is it hung?"""

from __future__ import annotations

from umo.cycle.stage import Stage
from umo.process.life import Life

LOOK = 0.02
"""s between two looks of the guardian."""
LOOKS = 3
"""The minimum number of looks without a sign of life before the control process counts as hung."""
STARTING_LIMIT = 30.0
"""Timeout in s of a step of connecting, in addition to two periods."""
REPORTING_LIMIT = 5.0
"""s that the control process may take for its report when the machine has been reset."""


class Silence:
    """How long the control process has given no sign of life. `hang`: limit in s while it runs; `period` in s."""

    def __init__(self, life: Life, hang: float, period: float) -> None:
        self._life = life
        self._hang = hang
        self._period = period
        self._beat = self._looks = 0

    def look(self) -> str:
        """One look, every `LOOK` s: empty, or in words that the control process hangs."""
        self._looks = self._looks + 1 if self._beat == self._life.last_beat else 0
        self._beat, limit = self._life.last_beat, self.limit
        # several looks: if the whole computer stood still, the control process gets time to report that itself
        if self._life.silence > limit and self._looks >= max(LOOKS, limit / LOOK):
            return f"no sign of life for {limit * 1e3:g} ms while {self._life.stage}"
        return ""

    @property
    def limit(self) -> float:
        """The limit in s in the present stage of the run."""
        if self._life.stage is Stage.STARTING:
            return STARTING_LIMIT + 2 * self._period
        return REPORTING_LIMIT if self._life.stage is Stage.ENDED else self._hang
