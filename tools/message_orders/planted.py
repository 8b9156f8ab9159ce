"""Faults that are planted in either end of a link, and of a fleet's feed and commands: which schedules find each?"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from signal import SIGXCPU
from subprocess import TimeoutExpired
from typing import ClassVar

from tools.planted_faults import PlantedFault, copied, played_with

DEPTH, RANDOM = 3, 2000
"""What each fault is tried by: all schedules to this depth, and so many at random."""
TIMEOUT = 90
"""Time of a processor in s after which an end counts as one that waits for ever; other work of the computer does not
count."""
LATEST = 20.0 * TIMEOUT
"""The same of a clock."""
FOR_EVER = "an end waits for ever"


class Planted(PlantedFault):
    """A fault of an end of `SUBJECT`."""

    SUBJECT: ClassVar[str] = "link"


class InController(Planted):
    ROOM = "src/umo/generate/boards/link"


class InHost(Planted):
    ROOM = "src/umo/generate/split"


class InFleet(Planted):
    ROOM = "src/umo/clients/fleet"
    SUBJECT = "feed"


PLANTED: Sequence[Planted] = (
    InController("no CRC", "umo_frames.c", "if (r->bytes[body + i] != (uint8_t)(crc >> 8 * i))", "if (r->bad && crc)"),
    InController("no check of repeated frames", "umo_link.c", " || !is_after(number, l->heard)) {", ") {"),
    InController("no check of the session", "umo_link.c", "!l->session || session != l->session ||", "!l->session ||"),
    InController("frames without a session", "umo_link.c",
        "!l->session || session != l->session ||", "session != l->session ||",
        "no host says session 0; the rule `silence` of umo.testing (tests/generate/split/test_link_conformance.py)"),
    InController("START of any session", "umo_link.c",
        "session && session == l->offered && session != l->begun", "session && session != l->begun"),
    InController("a session begins again", "umo_link.c", "session != l->begun)", "session != l->session)"),
    InController("the items of START twice", "umo_link.c", "length = FIRST; /*", "; /*"),
    InController("given items twice", "umo_link.c",
        "if (!check && body[at] == LINK_GIVEN", "if (0 && body[at] == LINK_GIVEN"),
    InController("given items never", "umo_link.c",
        "&& !is_after(number, l->heard))\n            return true;", ")\n            return true;"),
    InController("no host timeout", "umo_link.c", "if (l->silent <= LINK_HOST_TIMEOUT)", "if (l->silent <= 1000000)"),
    InController("a host timeout twice as long", "umo_link.c",
        "if (l->silent <= LINK_HOST_TIMEOUT)", "if (l->silent <= 2 * LINK_HOST_TIMEOUT)"),
    InController("a session that goes on after the timeout", "umo_link.c",
        "        l->session = 0;\n        ends", "        ends"),
    InController("damaged frames count as a heartbeat", "umo_link.c",
        "            continue;\n        uint8_t kind",
        "            { l->silent = 0; continue; }\n        uint8_t kind"),
    InController("left out frames count as a heartbeat", "umo_link.c",
        "    bool stops = body[0] == LINK_STOP;\n", "    bool stops = body[0] == LINK_STOP;\n    l->silent = 0;\n"),
    InController("each greeting offers a session", "umo_link.c",
        "if (!l->offered || memcmp(l->nonce, &body[1], sizeof l->nonce) != 0)", "if (1)",
        "both ends greet again; the rule `greeting` of umo.testing", ["the guardian does not greet again"]),
    InController("one session for all greetings", "umo_link.c",
        "        if (++l->offered == 0)\n", "        if (l->offered == 0)\n"),
    InController("STOP does not stop", "umo_link.c", "        l->mode = LINK_RESTING;\n", ""),
    InController("a number that is not taken over", "umo_link.c", "    l->heard = number;\n", ""),
    InController("no answer to a frame that comes first", "umo_link.c",
        "    l->asked = true;\n", "    l->asked = l->silent > 0;\n"),
    InController("items that are not checked", "umo_link.c",
        " || (!stops && !items(l, body, FIRST, length, true))", "",
        "a host sends items that are right; the rule `items` of umo.testing "
        "(tests/generate/split/test_link_conformance.py)"),
    InHost("no CRC in the host", "link_frames.py",
        'if crc32(body).to_bytes(CRC_BYTES, "little") == found[-CRC_BYTES:]:', "if True:"),
    InHost("no check of the nonce", "link_host.py", "if welcome.nonce != self._nonce:", "if False:"),
    InHost("no check of the session in the host", "link_host.py", "if state.session != self.session:", "if False:",
        "an answer counts if this process still waits for its number; that two processes give the same number within "
        "the time of a late copy takes one that dies at its start"),
    InHost("overtaken answers count", "link_host.py",
        "        if asked is None:\n            return",
        "        if asked is None:\n            asked = self._now()\n        if False:\n            return"),
    InHost("the age counts from the arrival", "link_host.py",
        "self.state, self._asked = state, asked", "self.state, self._asked = state, self._now()"),
    InHost("no limit of the age", "controller_driver.py", "link.age > max(self.timeout, self.host_timeout)", "False"),
    InHost("an age twice as long", "controller_driver.py",
        "link.age > max(self.timeout, self.host_timeout)", "link.age > 2 * max(self.timeout, self.host_timeout)"),
    InHost("any answer confirms", "controller_driver.py",
        "            if not link.awaited:\n", "            if True:\n"),
    InHost("what was not answered is forgotten", "part_mirror.py", "        if self._items:\n", "        if False:\n"),
    InHost("what was not answered is new", "part_mirror.py",
        "return [item(FrameItem.GIVEN, self._first), *self._items]", "return self._items"),
    InHost("what was not answered is of this frame", "part_mirror.py",
        "return [item(FrameItem.GIVEN, self._first), *self._items]",
        "return [item(FrameItem.GIVEN, frame), *self._items]"),
    InHost("the host takes what it has changed itself", "part_mirror.py",
        "known is not None and each.live() == known:", "True:"),
    InHost("no new start after a lost link", "controller_driver.py", "        mirror.forget()\n", ""),
    InHost("a START is said once", "link_host.py", "min(deadline, self._now() + self._patience)", "deadline",
        "it takes longer: another session is asked for after the host timeout"),
    InHost("no other session where START is not answered", "link_host.py",
        "                self._forget()\n                self._ask_for_session(deadline)\n", "",
        by="guardian .CEHRC.S.H.E..S.H...E..E.HC..RS.H"),
    InHost("a lost answer is waited for", "link_host.py",
        "(not self.awaited or self._now() - self._sent[self._number] >= self._patience)", "not self.awaited"),
    InHost("the guardian takes any answer", "link_stop.py",
        "return bool(of == session and mode == ControllerMode.RESTING)", "return True", by="guardian .SLL..L"),
    InHost("the guardian takes any welcome", "link_stop.py", "welcome.nonce == nonce and ", "",
        "it greets again where its STOP is not answered", ["the guardian does not greet again"]),
    InHost("the guardian does not ask again", "link_stop.py",
        "    until = calls.now() + retry\n", "    until = deadline\n"),
    InHost("the guardian does not greet again", "link_stop.py", "            session = 0  #", "            pass  #"),
    InFleet("a delta is taken twice", "run_feed.py", "if head.number < self.delta:", "if False:"),
    InFleet("deltas in the order in which they come", "run_feed.py",
        "self._held.pop(self.delta, None)", "self._held.pop(min(self._held, default=-1), None)"),
    InFleet("nothing is asked for", "run_feed.py",
        "return self.delta <= self._last_delta or self.event <= self._last_event", "return False"),
    InFleet("events behind a gap are taken", "run_feed.py", "if int(events[0][0]) <= self.event:", "if True:"),
    InFleet("events are taken twice", "run_feed.py",
        "if (number := int(event[0])) >= self.event:", "if (number := int(event[0])) >= 0:"),
    InFleet("a question is not asked again", "run_feed.py", "now - self._asked < RETRY_DELAY:", "self._asked > 0:"),
    InFleet("a silent run is not asked for", "run_feed.py", "if now - self._heard < self._silence:", "if True:"),
    InFleet("the last delta does not wait for its events", "run_feed.py",
        "            if self.event <= self._last_event:\n", "            if False:\n"),
    InFleet("a delta that does not follow is applied", "fleet_mirror.py",
        "if delta.number != self._number + 1 and not delta.is_full:", "if False:"),
    InFleet("an older delta is applied", "fleet_mirror.py", "if delta.number <= self._number:", "if False:"),
    InFleet("lost deltas are not counted", "fleet_mirror.py", "self.lost += max(0, number - self._number - 1)", "pass"),
    InFleet("nothing grows stale", "fleet_mirror.py",
        "if not self._is_stale and time.monotonic() - self._heard > self._limit:", "if False:"),
    InFleet("an age counts from the arrival", "fleet_mirror.py",
        "self._heard = now - self._ages.age(int(self._image.view(\"<i8\")[self._began]))", "self._heard = now"),
    InFleet("a declaration is of when it comes", "fleet_mirror.py",
        "asked - round(age * 1e9)", "time.monotonic_ns()"),
    InFleet("clocks are compared by when the answer comes", "fleet_mirror.py",
        "asked - round(age * 1e9)", "time.monotonic_ns() - round(age * 1e9)"),
    InFleet("what comes late is fresh", "fleet_mirror.py",
        "self._add(Quality.STALE if self._is_stale else Quality.GOOD)", "self._add(Quality.GOOD)"),
    InFleet("no difference of clocks is known", "arrival_ages.py",
        "return (now - made - self._difference) * 1e-9", "return 0.0"),
    InFleet("events are not told again", "station_publisher.py",
        'events = self.reader.events(int(asked.get("event") or 0))[:MAX_DELTAS]', "events = []"),
    InFleet("the last delta does not say so", "station_publisher.py", "self._rest_of(), LAST)", "self._rest_of(), 0)"),
    InFleet("deltas are not kept", "station_publisher.py", "        self.kept.add(delta, data)\n", ""),
    InFleet("an end is told twice", "mirror_commands.py",
        "if not command.number or self._forget(command.number):",
        "if not command.number or (self._forget(command.number) and False):"),
    InFleet("what was not answered is done", "mirror_commands.py",
        '{"error": "no answer: it is not known whether the command was carried out", "kind": "TaskFailed"}',
        '{"result": 1}'),
    InFleet("no answer after an answer", "mirror_commands.py",
        "            if not wait[1]:\n", "            if True:\n"),
    InFleet("each last answer is told", "mirror_commands.py",
        "if reply.ok is None or wait[1]:", "if reply.ok is None:"),
    InFleet("a copy of a command is carried out", "fleet_commands.py",
        "        if told is not None:\n            if", "        if told is not None and False:\n            if"),
    InFleet("a command is valid for ever", "fleet_commands.py", "if not now <= until + CLOCK_ERROR:", "if False:"),
    InFleet("a copy does not wait for the end", "fleet_commands.py", "            await told.done.wait()\n", ""),
    InFleet("commands are not remembered", "fleet_commands.py", "            self._told[this] = told\n", ""),
    InFleet("a refusal is told as done", "fleet_commands.py",
        'told.answer = {"error": str(error), "kind": type(error).__name__}', 'told.answer = {"result": 1}'),
)  # fmt: skip


def measure(only: str = "") -> int:
    """Each of these faults in a copy of umo, and the schedule that finds it."""
    chosen = [each for each in PLANTED if only in each.what]
    with tempfile.TemporaryDirectory(prefix="umo-messages-") as folder:
        tree = copied(Path(folder))
        if said := "".join(_said_of([], tree, subject, "--depth", "1") for subject in ("link", "feed")):
            raise RuntimeError(f"without a fault: {said}")
        missed = [each for each in chosen if not _is_found([each], tree)]
        covered = [each for each in missed if _is_covered(each, tree)]
    print(f"{len(chosen) - len(missed)} of {len(chosen)} found, {len(covered)} covered by another layer")
    return int(len(covered) < len(missed))


def _is_covered(fault: Planted, tree: Path) -> bool:
    """True if another layer covers it: without that, it is found."""
    others = [each for each in PLANTED if each.what in fault.also]
    return _is_found([fault, *others], tree) if others else bool(fault.layer)


def _is_found(faults: Sequence[Planted], tree: Path) -> bool:
    fault = faults[0]
    named = [("--replay", each.by) for each in faults if each.by]
    ways = [*named, ("--depth", str(DEPTH)), ("--random", str(RANDOM))]
    said = next(filter(None, (_said_of(faults, tree, fault.SUBJECT, *way) for way in ways)), "")
    also = "".join(f" (with: {each.what})" for each in faults[1:])
    print(fault.line(bool(said), said + also), flush=True)
    return bool(said)


def _said_of(faults: Sequence[Planted], tree: Path, subject: str, *way: str) -> str:
    """The first finding; "": there is none."""
    words = f"--{subject}", "--first", "--cpu", str(TIMEOUT), *way
    try:
        done = played_with(faults, tree, LATEST, "tools.message_orders", *words)
    except TimeoutExpired:
        return FOR_EVER
    if done.returncode == -SIGXCPU:
        return FOR_EVER
    if not done.returncode:
        return ""
    return done.stdout.partition("\n")[0] or done.stderr.strip().rpartition("\n")[2]
