"""Texts of the page: how objects are wired, and what the newest black box says."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from umo.errors import FramesError, UmoError
from umo.frames import Reader
from umo.latency import blackbox
from umo.latency.causes import explain, missed_rows, sentence, tally
from umo.process.station import Station, find
from umo.wiring.patterns import expand
from umo.wiring.source import read
from umo.wiring.wire_text import wire_of

OCCASIONS = 3
"""The last missed periods of a black box that are told."""
given: dict[str, Station] = {}
"""Stations in folders of a user's, by name: that `umo view` was given, or whose frames name their folder."""
wirings: dict[str, str] = {}
"""Wirings that `umo view` was given, by the name of the station."""


def station_named(name: str) -> Station | None:
    """The station in a user's folder that is known, or a shipped one; None for any other."""
    if name in given:
        return given[name]
    try:
        return find(name)
    except UmoError:
        return None


def wires(about: dict[str, Any], paths: Iterable[str]) -> dict[str, str]:
    """How each object is wired, such as `modbus:holding:3`; empty if the station's folder is not known."""
    name = str(about["station"])
    if place := about.get("place"):
        given[name] = Station(name, Path(place))
    station = station_named(name)
    try:
        file = None if station is None else station.wiring(wirings.get(name) or about["wiring"] or None)
        if file is None:
            return {}
        source = read(file)
        expand(source, list(paths))
        return {path: wire_of(path, entry) for path, entry in source.entries.items()}
    except (UmoError, OSError):
        return {}


def newest_box(name: str) -> Path | None:
    """The newest black box of a station."""
    try:
        found = blackbox.boxes(blackbox.folder())
    except FramesError:
        return None
    return next((path for path in reversed(found) if blackbox.station_of(path) == name), None)


def box_in_words(path: Path) -> str:
    """When and why the black box was written, and the causes of the last missed periods in it."""
    try:
        with Reader(path) as reader:
            frames, about = reader.read(), reader.about
            verdicts = [explain(frames, reader.layout, row) for row in missed_rows(frames)]
            lines = [f"{blackbox.kept_at(about)}: {about.get('reason', '')}"]
            lines += [sentence(frames, verdict) for verdict in verdicts[-OCCASIONS:]]
            if len(verdicts) > 1:
                counts = ", ".join(f"{cause} {count}" for cause, count in tally(verdicts).items())
                lines.append(f"all {len(verdicts)} occasions: {counts}")
            return "\n".join(lines)
    except Exception as error:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return f"{path.name} cannot be read ({type(error).__name__})"
