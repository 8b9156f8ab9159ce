"""Finds the stations that run now, for `umo show stations`, `umo show values` and `umo show why`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from umo.cycle.events import CommandState
from umo.cycle.stage import Stage
from umo.errors import FramesError, PathError
from umo.objects.presentation.rows import ANY
from umo.objects.presentation.run_facts import ALARMS, FREE, IN_FAULT, fault_texts, since
from umo.process.frames import Reader, RunReader, search
from umo.process.frames.run_reader import progress_of
from umo.process.source_files import changed_files, changed_text
from umo.system.device_lock import holder, is_held
from umo.system.device_record import Ended, all_standing
from umo.text import count_of, printable, some
from umo.wiring.patterns import chosen
from umo_command.console import out, plain_table, say

COLUMNS = ("station", "pid", "since", "state", "mode", "period", "periods", "missed")
"""Facts that `umo show stations` shows in its table. Longer facts are shown on lines below the table."""
MAX_STOPPED = 5
"""Largest number of machines that must be acknowledged and have a line each. They are the newest of these machines."""
CHANGED = "changed"
"""Name of the fact that lists the files that have changed on disk since the run read them."""


def show_stations(as_json: bool = False) -> None:
    unread: list[str] = []
    found = list(_lines(unread.append))
    shown = [device for data, _ in found if data["state"] != str(Stage.ENDED) for device in data["devices"]]
    stopped, unseen = standing(), _unseen(shown)
    for text in unread:
        say(text)
    if as_json:
        listed = {
            "running": [data for data, _ in found],
            "unseen": unseen,
            "stopped": [vars(ended) for ended in stopped],
        }
        out.print_json(json.dumps(listed), ensure_ascii=True)
        return
    if found:
        out.print(_table([facts for _, facts in found]))
        for data, facts in found:
            _remark(data, facts, [each["station"] for each, _ in found].count(data["station"]) > 1)
    else:
        out.print("no station that can be read is running" if unread else "no station is running")
    for device, user in unseen.items():
        what = "which shows no values: a program, a run of another user, or a run that begins or ends"
        out.print(f"{printable(device)} is used by {user}, {what}", soft_wrap=True, markup=False)
    if found and len(stopped) > MAX_STOPPED:
        listing = "`umo show stations --json` lists them"
        out.print(f"must be acknowledged: {count_of(len(stopped), 'machine')}; {listing}", soft_wrap=True)
    else:
        _list_stopped(stopped)


def _list_stopped(stopped: Sequence[Ended]) -> None:
    for ended in stopped[:MAX_STOPPED]:
        out.print(f"must be acknowledged: {ended.brief}", no_wrap=True, overflow="ellipsis")
    if stopped:
        if len(stopped) > MAX_STOPPED:
            out.print(f"{len(stopped) - MAX_STOPPED} more must be acknowledged")
        out.print(
            "Inspect the machine. Then start it with --acknowledge, or use `umo do STATION acknowledge`. `umo show "
            "stations --json` shows the causes.",
            soft_wrap=True,
        )


def _lines(unread: Callable[[str], object]) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """Yield the facts of each run. If the frames of a run are damaged, `unread` is called with the error, and the other
    runs follow."""
    for reader in search.readers(unread):
        try:
            with reader, search.reading(reader.path):
                yield _told(reader)
        except FramesError as error:
            unread(str(error))


def _remark(data: dict[str, Any], facts: dict[str, str], ambiguous: bool) -> None:
    """Print lines below the table on the work of a run, its lease, driven actuators, and equipment in fault."""
    name = str(data["pid"] if ambiguous else data["station"])
    for title in ("progress", "lease", "driven", ALARMS):
        if facts.get(title) and facts[title] != FREE:
            out.print(f"{name}: {title}: {facts[title]}", soft_wrap=True)
    if facts[CHANGED]:
        out.print(f"{name}: {facts[CHANGED]}", style="yellow", soft_wrap=True)
    if states := [f"{path} {state}" for path, state in data["states"].items()]:
        out.print(f"{name}: states: {some(states)}", soft_wrap=True)
    faults: dict[str, str] = data["in_fault"]
    for text in fault_texts(faults):
        out.print(f"{name}: {IN_FAULT}: {text}", style="red", soft_wrap=True)
    if faults:
        out.print(f"{' ' * len(name)}  {how_to_clear(name, faults)}", soft_wrap=True)


def how_to_clear(name: str, faults: Iterable[str]) -> str:
    """Return a hint that names the command which clears the faults at these paths of a station."""
    paths = list(faults)
    return f"cleared by: umo do {name} clear{f' {paths[0]}' if len(paths) == 1 else ''}"


def how_ended(reader: RunReader) -> Text:
    """Return a sentence which says that a run has ended. It has the result, if the run could still report it, and is
    red after a failure."""
    name, end = reader.about["station"], reader.end
    if end is None:
        return Text(
            f"{name} has ended without a report; `umo show stations` lists the devices that must be acknowledged", "red"
        )
    return Text(f"{name} has ended: {printable(end.text)}", "red" if end.state is CommandState.FAILED else "")


def attach_first(words: list[str]) -> tuple[Reader, list[str]]:
    """Return the station that the first word names, and the words after the first. If the first word does not name a
    station, return the only station that runs, and all words."""
    try:
        return attach(words[0] if words else None), words[1:]
    except FramesError:
        found = search.readers()
        if len(found) == 1 and any(_names(found[0], word) for word in words[:1]):
            return found[0], words
        raise


def _names(reader: RunReader, word: str) -> bool:
    """True if a word names objects, compounds, signals or alarms, or is a pattern."""
    if ANY in word:
        return True
    alarms = [str(each["path"]) for each in reader.layout.alarms]
    try:
        return bool(chosen([*reader.paths, *reader.signals, *alarms], [word], ""))
    except PathError:
        return False


def readers() -> list[Reader]:
    """Return one reader for each living ring. A ring that cannot be read is reported."""
    return search.readers(say)


def attach(name: str | None) -> Reader:
    """Return the frames of one running station, by name or pid. Raises FramesError, which lists the running
    stations."""
    return search.find_running(name, say)


def standing() -> list[Ended]:
    """Return the machines that must be acknowledged: their last run ended unsafely, or all of its processes have
    ended. The newest are first."""
    found = [ended for ended in all_standing() if ended.state != "running" or not is_held(ended.device)]
    return sorted(found, key=lambda ended: ended.when, reverse=True)


def _unseen(shown: Iterable[str]) -> dict[str, str]:
    """Return the devices that are in use and belong to none of the runs that are shown, each with its user. `shown`:
    the devices of these runs."""
    used = {ended.device for ended in all_standing() if ended.state == "running" and is_held(ended.device)}
    return {device: holder(device) for device in sorted(used.difference(shown))}


def _told(reader: RunReader) -> tuple[dict[str, Any], dict[str, str]]:
    """Return a run as data, and its facts as texts."""
    about, frame, changed, now = reader.about, reader.latest(), changed_files(reader.about), reader.now()
    data = {
        "station": about["station"],
        "wiring": about["wiring"],
        "pid": about["pid"],
        "devices": list(about["devices"]),
        "since": about["started"],
        "run_time_s": reader.lasted,
        "state": str(reader.state),
        "mode": None if now.mode is None else str(now.mode),
        "lease": printable(now.holder) or None,
        "driven": reader.driven(frame) or None,
        "progress": printable(progress_of(frame).text),
        "period_s": about["period"],
        "periods": now.periods,
        "missed": now.missed,
        "changed": [printable(each.path) for each in changed],
        "states": {printable(path): printable(state) for path, state in reader.unit_states(frame).items()},
        "in_fault": {printable(path): printable(reason) for path, reason in reader.faults(frame).items()},
        "alarms": [
            {"path": printable(row.path), "state": str(row.state), "priority": str(row.priority), "text": row.text}
            for row in reader.alarms(frame)
        ],
    }
    said = {"station": reader.title, "pid": str(about["pid"]), "since": since(about["started"], reader.lasted)}
    said |= {"periods": f"{now.periods:,}", CHANGED: changed_text(changed)}
    return data, said | reader.facts(frame)


def _table(found: list[dict[str, str]]) -> Table:
    """Return a table of the runs, with the columns that are not empty."""
    table = plain_table()
    titles = [title for title in COLUMNS if any(facts[title] for facts in found)]
    for title in titles:
        table.add_column(title, overflow="fold", no_wrap=title != "station")
    for facts in found:
        table.add_row(*(facts[title] for title in titles))
    return table
