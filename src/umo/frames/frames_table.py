"""Tables of the frames of a run in HTML, for notebooks: a running station, a black box."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from umo.cycle.facts import facts_of
from umo.cycle.stage import Progress, Stage
from umo.errors import FramesError
from umo.objects.html_table import TableRow, html_table, inhibition
from umo.wiring.patterns import chosen

if TYPE_CHECKING:
    from umo.frames.reader import Reader

SILENT = 1.0
"""s without a frame, and 10 periods, after which a running station is said to be silent."""


def html_of_frames(reader: Reader, wanted: Sequence[str] = (), more: Mapping[str, str] = MappingProxyType({})) -> str:
    """The last frame: objects, signals and tunable numbers, or those at paths and patterns. `more`: facts for the
    heading."""
    if reader.closed:
        raise FramesError(f"{title_of(reader)} is detached")
    frame = reader.latest()
    rows = _rows(reader, frame)
    places = chosen([row.about["path"] for row in rows], wanted, str(reader.about["station"]))
    return html_table(title_of(reader), facts_of_frames(reader, frame) | dict(more), [rows[place] for place in places])


def title_of(reader: Reader) -> str:
    """Station and wiring."""
    about = reader.about
    return f"{about['station']} ({about['wiring']})" if about.get("wiring") else str(about["station"])


def progress_of(frame: Any) -> Progress:
    """The progress that the machine had told last; none without a frame."""
    if frame is None:
        return Progress()
    return Progress(frame["progress"].decode(errors="replace"), int(frame["done"]), int(frame["total"]))


def facts_of_frames(reader: Reader, frame: Any) -> dict[str, str]:
    """The facts about the run at this frame, in words."""
    if frame is None:
        return {"stage": str(reader.state), "progress": "no period has ended yet"}
    progress = progress_of(frame)
    stage, reason = reader.state, reader.about.get("reason", "")
    facts = facts_of(stage, reader.mode, reader.holder, progress, float(frame["time"]), reader.missed)
    silent = (time.monotonic_ns() - int(frame["began"])) * 1e-9
    if stage is Stage.RUNNING and silent > max(SILENT, 10 * reader.about["period"]):
        facts["no frame for"] = f"{silent:.1f} s"
    return facts | ({"kept because": reason} if reason else {})


def _rows(reader: Reader, frame: Any) -> list[TableRow]:
    layout, numbers = reader.layout, reader.tunables()
    tunables = [TableRow(about, numbers[about["path"]], note=_limits(about)) for about in layout.tunables]
    if frame is None:
        return [*map(TableRow, (*layout.objects, *layout.signals)), *tunables]
    values, qualities, raws = (frame[name].tolist() for name in ("values", "quality", "raws"))
    notes = [inhibition(reader.inhibited(frame, place)) for place in range(len(values))]
    objects = map(TableRow, layout.objects, values, qualities, raws, notes)
    return [*objects, *map(TableRow, layout.signals, frame["signals"].tolist()), *tunables]


def _limits(about: Mapping[str, Any]) -> str:
    bounds = (
        f"{word} {about[bound]:g}"
        for word, bound in (("from", "minimum"), ("to", "maximum"))
        if about[bound] is not None
    )
    return " ".join(["tunable", *bounds])
