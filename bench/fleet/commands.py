"""A client that commands a station: `python -m bench.fleet.commands REPORT ADDRESS STATION NUMBER RATE`.

Each command has an id of its own. Some are sent two or three times at once, as a network may copy them; one that has
no answer is sent again under its id until it has one or is no longer valid. The answers are noted.
"""

from __future__ import annotations

import json
import random
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import zenoh

from bench.fleet import report_file
from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey, station_key
from umo.clients.fleet.fleet_session import FleetNetwork, opened

VALID = 8.0
"""Time in s for which a command is valid."""
AGAIN = 0.7
"""Time in s after which it is sent again, if there was no answer."""
COPIES = (1, 1, 2, 3)
FAST_OR_SLOW = (0.0, 40.0, -40.0)
"""Differences of the client's clock in s of commands that must be refused, and of those that must not."""


class SentCommand:
    """`number`: its argument."""

    def __init__(self, session: zenoh.Session, key: StationKey, number: int, chance: random.Random) -> None:
        self._session, self._key = session, key.key(keys.COMMAND, "ann")
        self.number, self.result = number, ""
        self.refused: set[str] = set()
        """Why copies of it were refused."""
        self.times = 0
        now = time.time() + (0.0 if chance.random() < 0.95 else chance.choice(FAST_OR_SLOW))
        self.until = time.monotonic() + VALID
        self._text = json.dumps(
            {"id": f"{chance.getrandbits(128):032x}", "client": "bench", "sent": now, "until": now + VALID,
             "do": "call", "path": "note", "arguments": {"number": float(number)}}
        )  # fmt: skip
        self.send(chance.choice(COPIES))

    def send(self, copies: int = 1) -> None:
        self.sent = time.monotonic()
        for _ in range(copies):
            self.times += 1
            self._session.get(
                self._key, zenoh.handlers.Callback(self._replied), payload=self._text, timeout=VALID,
                consolidation=zenoh.ConsolidationMode.NONE,
            )  # fmt: skip

    def _replied(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        answer = json.loads(bytes(reply.ok.payload))
        if "error" in answer:
            self.refused.add(str(answer["error"]))
        elif "result" in answer:
            self.result = "done"

    @property
    def is_over(self) -> bool:
        return bool(self.result or self.refused) or time.monotonic() > self.until


class Commander:
    def __init__(self, session: zenoh.Session, key: StationKey, seed: int = 0) -> None:
        self._session, self._key, self._chance = session, key, random.Random(seed)
        self._waiting: list[SentCommand] = []
        self.all: list[SentCommand] = []

    def next(self) -> None:
        command = SentCommand(self._session, self._key, len(self.all), self._chance)
        self.all.append(command)
        self._waiting.append(command)

    def look(self) -> None:
        """Send again what has no answer."""
        self._waiting = [each for each in self._waiting if not each.is_over]
        for each in self._waiting:
            if time.monotonic() - each.sent > AGAIN:
                each.send()

    @property
    def is_waiting(self) -> bool:
        return bool(self._waiting)

    def found(self) -> dict[str, Any]:
        why = Counter(text for each in self.all for text in sorted(each.refused)[:1])
        return {
            "sent": len(self.all), "times": sum(each.times for each in self.all),
            "done": [each.number for each in self.all if each.result],
            "refused": [each.number for each in self.all if each.refused and not each.result],
            "not sure": [each.number for each in self.all if any("may have been" in text or "not known" in text
                                                                 for text in each.refused)],
            "why": dict(why.most_common(8)),
        }  # fmt: skip


def main(report: Path, address: str, station: str, number: int, rate: float) -> None:
    file = report_file.ReportFile(report)
    session = opened(FleetNetwork(connect=[address]), "client")
    commander, began = Commander(session, station_key(station)), time.monotonic()
    while not file.ends and (len(commander.all) < number or commander.is_waiting):
        if len(commander.all) < min(number, (time.monotonic() - began) * rate):
            commander.next()
        commander.look()
        file.write(commander.found)
        threading.Event().wait(0.01)
    file.write(commander.found, now=True)
    session.close()


def done_by(file: Path) -> Counter[int]:
    """How often a station has carried out each number."""
    return Counter(map(int, file.read_text().split())) if file.exists() else Counter()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3], int(sys.argv[4]), float(sys.argv[5]))
