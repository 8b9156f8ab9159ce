"""`umo show stations --fleet`: the stations of all computers."""

from __future__ import annotations

import json
import time
from typing import Any

from umo.clients.fleet import fleet_settings
from umo.clients.fleet.fleet_presence import statuses
from umo.clients.fleet.fleet_session import anybody, opened_client
from umo.objects.presentation.run_facts import since
from umo.text import printable
from umo_command.console import out, plain_table

COLUMNS = ("station", "since", "state", "mode", "lease", "missed", "alarms", "progress")
SEARCH_TIME = 3.0
"""Time in s for which the command waits for stations."""
SEARCH_PAUSE = 0.05


def ps_fleet(as_json: bool) -> None:
    settings = fleet_settings.load()
    session = opened_client(settings.network)
    try:
        until = time.monotonic() + SEARCH_TIME
        while not (there := anybody(session)) and time.monotonic() < until:
            time.sleep(SEARCH_PAUSE)
        found = statuses(session) if there else {}
    finally:
        session.close()
    told: dict[str, dict[str, Any]] = {str(key): found.get(key, {}) for key in there}
    if as_json:
        out.print_json(json.dumps(told), ensure_ascii=True)
        return
    if not told:
        out.print(f"no station is in the fleet; {settings.why_none}", soft_wrap=True, highlight=False)
        return
    table = plain_table()
    for title in COLUMNS:
        table.add_column(title, overflow="fold", no_wrap=title != "progress")
    for name, status in told.items():
        table.add_row(name, *(printable(_text(title, status)) for title in COLUMNS[1:]))
    out.print(table)


def _text(title: str, status: dict[str, Any]) -> str:
    """Return one field of a station; "?" if it did not answer."""
    if not status:
        return "?"
    value = status.get(title)
    if title == "since":
        lasted = status.get("run_time_s")
        return since(float(value or 0.0), lasted if isinstance(lasted, int | float) else None)
    if title == "alarms" and status.get("faults"):
        return f"{value}, {len(status['faults'])} in fault"
    return "" if value in (None, 0) else str(value)
