"""The description of a recording, as text and as plain data (`umo recording info`)."""

from __future__ import annotations

import shlex
import time
from typing import Any

from umo.duration import duration
from umo.process.frames.layout import SHRUNK
from umo.recording.recording import Recording
from umo.text import count_of
from umo.wiring.parameters import option_words

MAX_DAMAGE = 5
"""Number of the last damaged places that are listed."""
NAMED = ("umo", "python", "numpy", "platform")


def facts_of(recording: Recording) -> dict[str, Any]:
    """Return the facts of a recording as plain data. Times are in s on the machine's clock, `started` is in s since
    1970, and `size` in bytes."""
    about, job = recording.about, recording.job
    first, last = recording.span
    end = None if recording.end is None else recording.end.event
    return {
        "file": str(recording.path),
        "parts": len(recording.parts),
        "size": sum(part.stat().st_size for part in recording.parts),
        "station": about.get("station"),
        "wiring": about.get("wiring"),
        "options": dict(job.get("options", {}).get("given", {})),
        "host": job.get("host"),
        "versions": dict(job.get("versions", {})),
        "realtime": bool(about.get("realtime")),
        "started": about.get("started"),
        "period": about.get("period"),
        "first": first,
        "last": last,
        "periods": recording.periods,
        "shrunk_from": about.get(SHRUNK),
        "lost": recording.lost,
        "gap_count": recording.gap_count,
        "gaps": [[gap.first, gap.count] for gap in recording.gaps],
        "objects": len(recording.layout.objects),
        "signals": len(recording.layout.signals),
        "events": recording.events_told,
        "events_lost": recording.events_lost,
        "commands": recording.commands_taken,
        "black_box_count": recording.black_box_count,
        "black_boxes": [box._asdict() for box in recording.black_boxes],
        "end": end and {"time": end.time, "text": end.text, "state": str(end.state)},
        "whole": recording.is_whole and not recording.damage,
        "damage": recording.damage,
        "complete": recording.complete,
        "replayable": recording.replayable_from is None,
        "not_replayable": recording.replayable_from,
    }


def lines_of(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the facts as lines of text, each with its name."""
    started = facts["started"]
    when = "" if started is None else time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(float(started)))
    kind = "in real time" if facts["realtime"] else "in virtual time"
    options = shlex.join(word for name, value in facts["options"].items() for word in option_words(name, value))
    period = float(facts["period"] or 0.0)
    each = f" of {duration(period)}" if period else ""
    none = "none known, see damage" if facts["damage"] else "none"
    lost = none if not facts["lost"] else f"{facts['lost']:,} in {count_of(facts['gap_count'], 'gap')}"
    end, lost_events = facts["end"], facts["events_lost"]
    last = "not in it" if end is None else f"{end['text']} ({end['state']}, at {end['time']:g} s)"
    versions = ", ".join(f"{name} {facts['versions'][name]}" for name in NAMED if name in facts["versions"])
    size = f"{facts['size'] / 1e6:,.2f} MB" + (f" in {facts['parts']} files" if facts["parts"] > 1 else "")
    found = [
        ("station", f"{facts['station']}, wiring {facts['wiring']}, {kind}"),
        ("options", options),
        ("started", " on ".join(filter(None, [when, facts["host"]]))),
        ("length", f"{duration(facts['last'] - facts['first'])}: {facts['first']:g} s to {facts['last']:g} s"),
        ("periods", f"{facts['periods']:,}{each}"),
        ("shrunk", _shrunk(facts["shrunk_from"])),
        ("lost", lost),
        ("values of", f"{count_of(facts['objects'], 'object')}, {count_of(facts['signals'], 'signal')}"),
        ("events", f"{facts['events']:,}" + (f", {lost_events:,} were lost" if lost_events else "")),
        ("commands", f"{facts['commands']:,}"),
        ("black boxes", _boxes(facts["black_boxes"], facts["black_box_count"])),
        ("end", last),
        ("replay", "from period 0 on" if facts["replayable"] else f"not possible: {facts['not_replayable']}"),
        ("file", f"{'whole' if facts['whole'] else 'not whole (umo recording repair)'}, {size}"),
        *(("damage", text) for text in _few(facts["damage"])),
        ("made with", versions),
    ]
    return [(name, text) for name, text in found if text]


def _shrunk(periods: object) -> str:
    """Return a text with the number of periods before the recording was shrunk, or "" if it was not shrunk."""
    if periods is None:
        return ""
    whole = count_of(periods, "period") if isinstance(periods, int) else "a longer recording"
    of_run = "times and lost periods differ from those of the run"
    return f"by umo recording shrink from {whole}, for a replay in open loop; {of_run}"


def _few(damage: list[str]) -> list[str]:
    """Return the last `MAX_DAMAGE` sentences. If there are more, the first line states the number of the others."""
    more = len(damage) - MAX_DAMAGE
    return [*([f"{more} more places"] if more > 0 else []), *damage[-MAX_DAMAGE:]]


def _boxes(boxes: list[dict[str, Any]], count: int) -> str:
    """Return the number of black boxes, and the content of the last one; "" if there are none."""
    if not boxes:
        return ""
    last = boxes[-1]
    why = " ".join(last["text"].splitlines()[-1:]) or last["reason"]
    return f"{count:,} (umo show why --file), the last one at {last['time']:g} s: {why}"
