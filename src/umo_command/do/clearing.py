"""`umo do STATION acknowledge` and `umo do STATION clear`: acknowledge and clear conditions of a station, or of parts
of it, that only an operator may end."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from umo.clients.remote import RemoteStation
from umo.errors import FramesError
from umo.process.frames import RunReader
from umo.process.frames.search import is_path, meant_by
from umo.system.device_record import DeviceClaim
from umo.text import did_you_mean
from umo.wiring.patterns import chosen
from umo_command.console import out
from umo_command.do.commanding import leased, let_pass, station_of
from umo_command.show.stations import attach, readers, standing

REACTION_PERIODS, REACTION_TIME = 3, 5.0
"""The number of periods after a clear in which an application may restart its units, and the longest wait for them in
s."""


def acknowledge(name: str, paths: Sequence[str], over: bool) -> None:
    """Acknowledge latched interlocks of a station that runs. For a station that does not run, or for a device,
    acknowledge the unsafe end of the last run."""
    try:
        reader = attach(name)
    except FramesError:
        if paths or meant_by(name, readers()):  # several runs of this name go on
            raise
        _acknowledge_ends(name)
        return
    with RemoteStation(reader) as station:
        parts = _parts(reader, paths) if paths else [""]
        with leased(station, over):
            for part in parts:
                what = "acknowledged" if station.acknowledge(part) else "nothing was latched"
                out.print(f"{part or reader.about['station']}: {what}", soft_wrap=True)


def _acknowledge_ends(name: str) -> None:
    """Acknowledge the unsafe ends of the last runs of a station, or on a device."""
    records = standing()
    names = (name, Path(name).resolve().name) if is_path(name) else (name,)
    stopped = [each for each in records if each.device == name or each.station in names]
    if not stopped:
        near = did_you_mean(name, [each.station for each in records])
        raise FramesError(f"no station or device {name!r} is running or must be acknowledged{near}") from None
    for ended in stopped:
        DeviceClaim([ended.device], ended.station, ended.wiring, acknowledge=True).finish()
        out.print(f"acknowledged: {ended.brief}", soft_wrap=True)


def clear(name: str, paths: Sequence[str], over: bool) -> None:
    """Clear faults of equipment. For each unit that then stays Stopped, say how to go on."""
    with station_of(name) as station:
        aborted = _units_in(station.reader, "aborted")
        parts = _equipment(station.reader, paths) if paths else [""]
        with leased(station, over):
            for part in parts:
                answer = station.clear(part)  # it names what was cleared
                out.print(answer if answer.startswith("cleared") or not part else f"{part}: {answer}", soft_wrap=True)
        if not parts:
            out.print(f"{', '.join(paths)}: not part of any equipment", soft_wrap=True)
        for unit in _left_stopped(station.reader, aborted):
            steps = (f"`umo do {name} call {unit}.{command}`" for command in ("reset", "start"))
            out.print(f"{unit} is stopped: go on with {', then '.join(steps)}", soft_wrap=True)


def _units_in(reader: RunReader, state: str) -> set[str]:
    """Return the paths of the units that are in this state."""
    return {path for path, now in reader.unit_states(reader.latest()).items() if now == state}


def _left_stopped(reader: RunReader, units: Collection[str]) -> list[str]:
    """Return which of these units are Stopped after the application could restart them."""
    if not units:
        return []
    let_pass(reader, REACTION_PERIODS, REACTION_TIME)
    return sorted(_units_in(reader, "stopped").intersection(units))


def _parts(reader: RunReader, paths: Sequence[str]) -> list[str]:
    """Return the objects and compounds that paths and patterns name; for a list, each of its members. Raises PathError
    for a path or pattern that names nothing."""
    split = [path.split(".") for path in reader.paths]
    compounds = dict.fromkeys(".".join(names[:count]) for names in split for count in range(1, len(names)))
    found: dict[str, None] = {}
    for path in paths:
        depth = path.count(".") + 1
        places = chosen([*reader.paths, *compounds], [path], str(reader.about["station"]))
        for names in (split[place] for place in places if place < len(split)):
            in_list = names[depth : depth + 1] and names[depth].isdigit()
            found[".".join(names[: depth + bool(in_list)])] = None
    return list(found)


def _equipment(reader: RunReader, paths: Sequence[str]) -> list[str]:
    """Return the equipment at and below the parts that paths and patterns name. For a part without equipment, return
    the innermost equipment that contains the part. Raises PathError for a path or pattern that names nothing."""
    known = [str(entry["path"]) for entry in reader.layout.equipment]
    found: dict[str, None] = {}
    for part in _parts(reader, paths):
        below = [each for each in known if _is_within(each, part)]
        around = [each for each in known if _is_within(part, each)]
        found.update(dict.fromkeys(below or around[-1:]))
    return [each for each in found if not any(_is_within(each, other) for other in found if other != each)]


def _is_within(path: str, part: str) -> bool:
    return f"{path}.".startswith(f"{part}.")
