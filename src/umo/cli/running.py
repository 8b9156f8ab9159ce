"""The stations that run now, as `umo ps`, `umo watch` and `umo why` find them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from umo.cycle.events import CommandState
from umo.errors import FramesError, PathError
from umo.frames import Reader
from umo.frames.last_event import end_of
from umo.objects.families import ANY
from umo.remote import search
from umo.system.hold import is_held
from umo.system.record import Ended, all_standing
from umo.text import printable, time_of_day
from umo.wiring.patterns import chosen

from .console import err, out

LONGEST = 1e10
"""s: 300 years."""


def ps(as_json: bool) -> None:
    """List what runs, and the devices that stand stopped."""
    unread: list[str] = []
    found = list(_lines(unread.append))
    stopped = standing()
    for text in unread:
        _say(text)
    if as_json:
        listed = {"running": found, "stopped": [vars(ended) for ended in stopped]}
        out.print_json(json.dumps(listed), ensure_ascii=True)
        return
    if found:
        out.print(_table(found))
    else:
        out.print("no station that can be read is running" if unread else "no station is running")
    for ended in stopped:
        out.print(f"stands stopped: {ended.brief}", no_wrap=True, overflow="ellipsis")
    if stopped:
        out.print(
            "Inspect it, then start it with --acknowledge, or use `umo acknowledge`; `umo ps --json` has the causes.",
            soft_wrap=True,
        )


def _lines(unread: Callable[[str], object]) -> Iterator[dict[str, Any]]:
    """A line for each run; one whose frames are damaged does not hide the others: `unread` is told of it."""
    for reader in search.readers(unread):
        try:
            with reader, search.reading(reader.path):
                yield _line(reader)
        except FramesError as error:
            unread(str(error))


def how_ended(reader: Reader) -> Text:
    """That a run has ended, and how as far as it could still tell; red where it failed."""
    name, end = reader.about["station"], end_of(reader)
    if end is None:
        return Text(f"{name} has ended without telling how; `umo ps` names what stands stopped", "red")
    return Text(f"{name} has ended: {printable(end.text)}", "red" if end.state is CommandState.FAILED else "")


def attach_first(words: list[str]) -> tuple[Reader, list[str]]:
    """The station that the first word names and the words after it; else the only one that runs, and all the words."""
    try:
        return attach(words[0] if words else None), words[1:]
    except FramesError:
        found = search.readers()
        if len(found) == 1 and any(_names(found[0], word) for word in words[:1]):
            return found[0], words
        raise


def _names(reader: Reader, word: str) -> bool:
    """Whether a word names objects, compounds or signals, or is a pattern."""
    if ANY in word:
        return True
    try:
        return bool(chosen(reader.paths + reader.signals, [word], ""))
    except PathError:
        return False


def readers() -> list[Reader]:
    """One for each living ring; one that cannot be read is named."""
    return search.readers(_say)


def attach(name: str | None) -> Reader:
    """The frames of one running station, by name or pid; FramesError lists those that run."""
    return search.find_running(name, _say)


def _say(text: str) -> None:
    err.print(f"umo: {text}", soft_wrap=True)


def standing() -> list[Ended]:
    """The machines that stand stopped, or whose processes are all gone."""
    return [ended for ended in all_standing() if ended.state != "running" or not is_held(ended.device)]


def _line(reader: Reader) -> dict[str, Any]:
    about, frame = reader.about, reader.latest()
    return {
        "station": about["station"],
        "wiring": about["wiring"],
        "pid": about["pid"],
        "since": about["started"],
        "state": reader.state.name.lower(),
        "mode": None if reader.mode is None else str(reader.mode),
        "lease": printable(reader.holder) or None,
        "progress": "" if frame is None else printable(frame["progress"].decode(errors="replace")),
        "period_s": about["period"],
        "periods": reader.head,
        "missed": reader.missed,
    }


def _table(found: list[dict[str, Any]]) -> Table:
    """The column of the lease only where somebody has one."""
    held = any(line["lease"] for line in found)
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="bold", padding=(0, 1, 0, 0))
    for title in ("station", "pid", "since", "state", "period", "periods", "missed", "lease", "progress"):
        if held or title != "lease":
            table.add_column(title, overflow="fold", no_wrap=title in ("pid", "period", "periods", "missed"))
    for line in found:
        since = time_of_day(line["since"], "%H:%M:%S")
        table.add_row(
            f"{line['station']} ({line['wiring']})" if line["wiring"] else line["station"],
            str(line["pid"]),
            f"{since} ({lasting(time.time() - line['since'])})",
            f"{line['state']}, {line['mode']}" if line["mode"] else line["state"],
            f"{line['period_s'] * 1e3:g} ms",
            f"{line['periods']:,}",
            f"{line['missed']:,}",
            *([line["lease"]] if held else []),
            line["progress"],
        )
    return table


def lasting(seconds: float) -> str:
    """`12 s`, `3 min`, `2 h 05 min`, `3 d 4 h`; `?` for what no run has lasted."""
    if not -LONGEST < seconds < LONGEST:
        return "?"
    minutes, hours, days = seconds / 60, seconds / 3600, seconds / 86400
    if minutes < 2:
        return f"{seconds:.0f} s"
    if hours < 1:
        return f"{minutes:.0f} min"
    if days < 2:
        return f"{int(hours)} h {int(minutes) % 60:02d} min"
    return f"{int(days)} d {int(hours) % 24} h"
