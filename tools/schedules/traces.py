"""Is the trace of a play a path of the model? Where it is not, either the code or the model is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from tools.schedules.faults import Schedule, What
from tools.schedules.model import ASKED, Model, State
from tools.schedules.shared import DEVICES

Event = frozenset[str]
"""What the model calls it: one of these."""
OUTPUTS = dict(zip(DEVICES, ("fast", "slow"), strict=True))
FORKED = {"worker", "control", "reserve", "standby", "reset"}
RESETS = ("reserve", "resetter", "standby")
"""What a child may be that was forked to wait for a reset: it waits, works, or has taken the place of a guardian."""
FAULT = re.compile(r"fault: (kill|stop|hold) (\w+) ")
FORK = re.compile(r"\w+: fork (\w+) ")
SIGNAL = re.compile(r"\w+: signal (\w+) SIG(KILL|CONT) ")
END = re.compile(r"(\w+): (?:exit|gets SIGKILL) ")
MOVE = re.compile(r"\w+: (d\d) (?:WRITE|RESET|INITIALIZE) (-?\d+) ")


def is_in_model(schedule: Schedule) -> bool:
    """Whether the model has all of its faults."""
    kinds = {fault.what for fault in schedule.faults}
    return kinds <= {What.KILL, What.STOP, What.HOLD} and not (schedule.frames or schedule.clients)


def follow(schedule: Schedule, lines: Sequence[str]) -> str:
    """The first line of a trace which is no step of the model, with what was before; "": it is a path of the model."""
    counts = {what: sum(fault.what is what for fault in schedule.faults) for what in What}
    begin = State(ends=True, kills=counts[What.KILL], stops=counts[What.STOP], holds=counts[What.HOLD])
    model = Model()
    states, before = _unseen(model, {begin}), ""
    for line, event in events(lines):
        coming = {after for state in states for seen, after in _all(model, state) if seen in event}
        if not coming:
            return f"after {before!r} the model has no {line!r} ({', '.join(sorted(event))})"
        states, before = _unseen(model, coming), line
    return ""


def _all(model: Model, state: State) -> Iterator[tuple[str, State]]:
    yield from model.steps(state)
    yield from model.faults(state)


def _unseen(model: Model, states: set[State]) -> set[State]:
    """These states, and those to which steps lead that nobody sees."""
    known, coming = set(states), list(states)
    while coming:
        for seen, after in model.steps(coming.pop()):
            if seen in ("", ASKED) and after not in known:
                known.add(after)
                coming.append(after)
    return known


def events(lines: Iterable[str]) -> Iterator[tuple[str, Event]]:
    """What the model knows of a trace, up to a process that is continued."""
    living, stopped, names = set[str](), set[str](), list[str]()
    levels = dict.fromkeys(DEVICES, 0)
    for line in lines:
        text = line.partition(" ")[2]
        if found := FORK.match(text):
            kind = found[1]
            if kind == "guardian" or kind in FORKED:
                names.append(kind)
                count = names.count(kind)
                living.add(kind if count == 1 else f"{kind}{count}")
            if kind in FORKED:
                yield line, frozenset({f"fork {'resetter' if kind == 'reset' else kind}"})
        elif found := FAULT.match(text):
            what, who = found.groups()
            if who in living and who not in (stopped if what != "kill" else ()):
                if what == "kill":
                    living.discard(who)
                elif what == "stop":
                    stopped.add(who)
                yield line, _fault(what, who)
        elif found := SIGNAL.match(text):
            if found[2] == "CONT":
                return
            living.discard(found[1])
        elif found := END.match(text):
            living.discard(found[1])
        elif found := MOVE.match(text):
            before, levels[found[1]] = levels[found[1]], int(found[2])
            if bool(before) != bool(levels[found[1]]):
                yield line, frozenset({f"{'down' if before else 'up'} {OUTPUTS[found[1]]}"})
        elif text.startswith("guardian: admit "):
            yield line, frozenset({"admit"})
        elif ": note_told " in text:
            yield line, frozenset({"told"})


def _fault(what: str, who: str) -> Event:
    kind = who.rstrip("0123456789")
    kinds = RESETS if kind in ("reserve", "reset") else (kind,)
    return frozenset(f"{what} {each}" for each in kinds)
