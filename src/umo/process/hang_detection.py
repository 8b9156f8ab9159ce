"""The decision, from the heartbeats of the control process, whether it hangs or is kept from running."""

from __future__ import annotations

from umo.cycle.stage import Stage
from umo.duration import duration
from umo.process.outcome import Outcome
from umo.process.processor_share import ProcessorShare
from umo.process.run_state import RunState

LOOK_INTERVAL = 0.02
"""Time in s between two looks of the guardian."""
MIN_SILENT_LOOKS = 3
"""The minimum number of looks without a heartbeat before the control process counts as hung."""
STARVED_LIMITS = 3
"""The number of hang limits after which a control process that other processes prevent from running is ended, because
nothing controls the machine during this time."""
STARTING_LIMIT = 30.0
"""Timeout in s of a step of connecting, in addition to two periods."""
REPORTING_LIMIT = 5.0
"""Timeout in s for the report of a control process that has reset the machine."""

MIN_GUARDIAN_LIMIT = 0.5
"""The minimum time in s without a heartbeat before a guardian counts as lost. It is this long because a busy computer
delays a guardian."""


def guardian_limit(hang: float) -> float:
    """Return the limit in s for a guardian's heartbeats. `hang`: the limit for the heartbeats of its control
    process."""
    return max(hang, MIN_GUARDIAN_LIMIT)


class HangDetector:
    """The measurement of the time for which the control process has given no heartbeat. `hang`: the limit in s while it
    runs; `period` is in s. The time in which other processes kept the control process from running is not counted, up
    to `STARVED_LIMITS` times the limit."""

    def __init__(self, run_state: RunState, share: ProcessorShare, hang: float, period: float) -> None:
        self._run_state = run_state
        self._share = share
        self._hang = hang
        self._period = period
        self._beat = self._looks = 0

    def look(self) -> str:
        """Check once; call this every `LOOK_INTERVAL` s. Return a text if the control process hangs, otherwise ""."""
        run_state, share = self._run_state, self._share
        if self._beat != run_state.last_beat:
            self._beat, self._looks = run_state.last_beat, 0
            share.begin()
            run_state.excuse(0.0)
            return ""
        self._looks += 1
        share.look()
        run_state.excuse(share.kept_waiting)
        silence, limit = run_state.silence, self.limit
        # several looks: if the whole computer stood still, the control process gets time to report that itself
        if silence <= limit or self._looks < max(MIN_SILENT_LOOKS, limit / LOOK_INTERVAL):
            return ""
        waited = share.kept_waiting
        if silence - waited <= limit and silence <= STARVED_LIMITS * limit:
            return ""
        if waited > silence / 2:
            return f"was kept from running for {waited:.2f} s while {run_state.stage}: {share.by_whom}"
        return f"hung: no heartbeat for {duration(limit)} while {run_state.stage}"

    @property
    def limit(self) -> float:
        """The limit in s in the present stage of the run."""
        stage = self._run_state.stage
        if stage is Stage.STARTING:
            return STARTING_LIMIT + 2 * self._period
        return REPORTING_LIMIT if stage is Stage.ENDED and self._is_reset else self._hang

    @property
    def _is_reset(self) -> bool:
        """True if the control process has reported that it has reset the machine. Otherwise the guardian resets what is
        left, and waits no longer than for a control process that drives."""
        outcome = Outcome.decode(self._run_state.reported())
        return outcome is not None and not outcome.unreached
