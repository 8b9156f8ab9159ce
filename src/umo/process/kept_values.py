"""The values that a run takes over from the last run of its station and wiring, and the notices about them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from umo.cycle.connect import connect
from umo.cycle.events import Event
from umo.errors import text_of
from umo.process import kept_file
from umo.process.job import Plan
from umo.process.kept_file import KeptFileError, KeptValues
from umo.system import calls

LOCK_TIMEOUT = 2.0
"""The timeout in s at the start for the keeper of an earlier run, which may still be writing its last values."""
MAX_TOLD = 5
"""The number of values for which the terminal shows why they were not taken over. The events show all of them."""
Say = Callable[[str], object]
Sections = dict[str, dict[str, Any]]


def file_of(plan: Plan) -> Path | None:
    """Return the file of a run; None if there is no folder for it."""
    with suppress(OSError):
        return kept_file.path_of(plan.name, plan.wiring_name)
    return None


def title_of(plan: Plan) -> KeptValues:
    return KeptValues(plan.name, plan.wiring_name, str(plan.place))


def take_over(plan: Plan, say: Say) -> Sections:
    """Return the values that the last run in real time has kept, by section. This function raises no error: a section
    that cannot be read is set aside, and its values are lost."""
    path = file_of(plan)
    try:
        if path is None or not (path.exists() or kept_file.lock_of(path).exists()):  # nothing was ever kept
            return {}
        if not os.access(path.parent, os.W_OK):
            return _read(plan, path, say, aside=False)
        with kept_file.locked(path, LOCK_TIMEOUT) as mine:
            if not mine:
                say(f"another run of this station with this wiring keeps its values: {path}")
            elif plan.job.fresh and path.exists():
                say(f"this run starts without the kept values of the last run, which are now in {_aside(path)}")
                return {}
            return {} if plan.job.fresh else _read(plan, path, say, aside=mine)
    except Exception as error:
        say(f"the kept values are not used: {text_of(error)}")
        return {}


def copy(plan: Plan, say: Say) -> dict[str, Any]:
    """Return the kept numbers of the last run in real time. They are for a run in virtual time, which writes no kept
    numbers and moves no file."""
    path = file_of(plan)
    kept = {} if path is None or plan.job.fresh else _read(plan, path, say, aside=False)
    return kept.get(kept_file.NUMBERS, {})


def _read(plan: Plan, path: Path, say: Say, *, aside: bool) -> Sections:
    try:
        values = kept_file.read(path)
        if values is None:
            return {}
        if (values.station, values.wiring) != (plan.name, plan.wiring_name):
            raise KeptFileError(f"the file belongs to {values.station!r} with the wiring {values.wiring!r}")
    except KeptFileError as error:
        where = f"moved to {_aside(path)}" if aside else str(path)
        say(f"the kept values of the last run are lost: {error}; the file: {where}")
        return {}
    if values.place != str(plan.place):
        say(f"the kept values come from the station in {values.place}")
    return values.sections


def _aside(path: Path) -> Path:
    return kept_file.set_aside(path, calls.wall_time())


def tell(connection: connect[Any]) -> Iterator[str]:
    """Add an event of the connected machine for each kept value that was not used. Yield the notices for the user: the
    kept values with which the run begins, and those that were not used."""
    refused = connection.not_restored
    if taken := [f"{path} = {entry['value']}" for path, entry in connection.kept.items() if path not in refused]:
        more = f" and {len(taken) - MAX_TOLD} more" if len(taken) > MAX_TOLD else ""
        yield f"kept from the last run: {', '.join(taken[:MAX_TOLD])}{more} (--fresh starts without them)"
    for number, (path, why) in enumerate(refused.items()):
        connection.machine.events.add(Event(connection.machine.clock.now, path, f"the kept value is not used: {why}"))
        if number < MAX_TOLD:
            yield f"the kept value of {path} is not used: {why}"
    if len(refused) > MAX_TOLD:
        yield f"{len(refused) - MAX_TOLD} more kept values are not used: the events of the run name them"
