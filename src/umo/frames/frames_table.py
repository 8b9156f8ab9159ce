"""What the frames of a run say, in words: facts and rows of a table, for a running station and a black box."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from umo.cycle.client_commands import Mode
from umo.cycle.stage import Progress, Stage
from umo.presentation import run_facts
from umo.presentation.in_words import span

SILENT = 1.0
"""s without a frame, and 10 periods, after which a running station is said to be silent."""


def progress_of(frame: Any) -> Progress:
    """The progress that the machine had told last; none without a frame."""
    if frame is None:
        return Progress()
    return Progress(frame["progress"].decode(errors="replace"), int(frame["done"]), int(frame["total"]))


def facts_of_frame(
    about: Mapping[str, Any], stage: Stage, mode: Mode | None, holder: str, missed: int, frame: Any
) -> dict[str, str]:
    """The facts of a run at this frame; None: it has none yet."""
    moment, period = None if frame is None else float(frame["time"]), about.get("period") or None
    facts = run_facts.facts_of(stage, mode, holder, progress_of(frame), time=moment, period=period, missed=missed)
    if frame is None:
        return facts | {"progress": "no period has ended yet"}
    silent = (time.monotonic_ns() - int(frame["began"])) * 1e-9
    if stage is Stage.RUNNING and silent > max(SILENT, 10 * about["period"]):
        facts["no frame for"] = f"{silent:.1f} s"
    return facts | {"kept because": about.get("reason", "")}


def limits(about: Mapping[str, Any]) -> str:
    """The note on a tunable number."""
    bounds = span(about["minimum"], about["maximum"])
    return f"tunable, {bounds}" if bounds else "tunable"
