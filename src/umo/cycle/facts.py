"""The state of a run in words, for headings."""

from __future__ import annotations

from umo.cycle.hand_commands import Mode
from umo.cycle.stage import Progress, Stage


def facts_of(
    stage: Stage, mode: Mode | None, holder: str, progress: Progress, time: float, missed: int
) -> dict[str, str]:
    """By name, in the order in which they are shown; empty: there is nothing to say. `time` in s on the cycle's clock,
    `holder` of the lease, `missed` periods."""
    work = f"{progress.text}, {progress.done} of {progress.total}" if progress.total else progress.text
    return {
        "stage": str(stage),
        "mode": "" if mode is None else str(mode),
        "lease": "" if mode is None else holder or "free",
        "progress": work.removeprefix(", "),
        "time": f"{time:.3f} s",
        "missed": f"{missed:,}",
    }
