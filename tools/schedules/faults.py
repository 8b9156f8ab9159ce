"""A schedule: a seed, and the faults that come at certain moments. Its text is one line, which replays it:

    0: kill control at guardian:12; hold guardian 60ms at guardian:12; ask at 31.5ms; silent d2 500ms at control:9+2ms

After the seed, `frames` says that the run publishes frames, has a keeper and writes black boxes, `long` that its
application goes on for longer than any process is waited for that is to end it, and `clients` that it has frames,
programs that attach to it, and a service manager: `0 frames: ...`, `0 long: ...`, `0 clients: ...`.

A moment is a gate of a process, by its number from 1; or a time after that; or a time since the start of the world.
Faults of one moment come together.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

MS = 1_000_000
"""ns."""


class What(StrEnum):
    """The kinds of faults."""

    KILL = "kill"
    """SIGKILL."""
    STOP = "stop"
    """SIGSTOP."""
    CONTINUE = "continue"
    """SIGCONT."""
    HOLD = "hold"
    """The process gets no processor, for a time."""
    ASK = "ask"
    """The starter is asked to stop the machine; or a client, which then asks the machine."""
    NO_FORK = "no-fork"
    """The next fork of the process fails."""
    NO_FORKS = "no-forks"
    """Every fork of the process fails, for a time."""
    NO_DISK = "no-disk"
    """Whatever is written to a disk fails, for a time."""
    SILENT = "silent"
    """A device does not answer, for a time."""


OF_NOBODY = (What.ASK, What.NO_DISK)
"""Those that may be of no process."""
KINDS = ("frames", "long", "clients")
"""The kinds of worlds beside the simple one, by the attributes of a schedule."""
LASTING = (What.HOLD, What.NO_FORKS, What.NO_DISK, What.SILENT)


class ScheduleError(ValueError):
    """A line is not a schedule."""


@dataclass(frozen=True)
class Moment:
    """When faults come."""

    who: str = ""
    """The process at whose gate; "": none."""
    gate: int = 0
    after: int = 0
    """ns from then on, or from the start of the world."""

    def __str__(self) -> str:
        if not self.who:
            return _span(self.after)
        return f"{self.who}:{self.gate}" + (f"+{_span(self.after)}" if self.after else "")


@dataclass(frozen=True)
class Fault:
    what: What
    who: str
    """The process, or the device; "" where there is none."""
    moment: Moment
    lasting: int = 0
    """ns."""

    def __str__(self) -> str:
        words = [self.what, self.who, _span(self.lasting) if self.what in LASTING else "", f"at {self.moment}"]
        return " ".join(filter(None, words))


@dataclass(frozen=True)
class Schedule:
    """`seed`: of the order of the processes; 0: each in turn. `frames`: whether the run publishes them. `long`: whether
    its application goes on for long. `clients`: frames, an application that goes on until the programs that attach to
    it are done, and these."""

    seed: int = 0
    faults: Sequence[Fault] = ()
    frames: bool = False
    long: bool = False
    clients: bool = False

    def __str__(self) -> str:
        kinds = [name for name in KINDS if getattr(self, name)]
        return f"{' '.join([str(self.seed), *kinds])}: {'; '.join(map(str, self.faults))}".strip()

    def is_gentle_to(self, kind: str) -> bool:
        """Whether its faults are kills and requests to stop alone, and of the processes of this kind one dies at
        most."""
        killed = [fault for fault in self.faults if fault.who.startswith(kind)]
        return all(fault.what in (What.KILL, What.ASK) for fault in self.faults) and len(killed) <= 1

    def with_faults(self, faults: Sequence[Fault]) -> Schedule:
        return replace(self, faults=tuple(faults))


_MOMENT = re.compile(r"(?:(?P<who>[a-z]+\d*):(?P<gate>\d+)(?:\+(?P<after>[\d.]+)ms)?|(?P<time>[\d.]+)ms)")
_BEGIN = re.compile(rf"(?P<seed>\d+){''.join(f'(?P<{kind}> {kind})?' for kind in KINDS)}:")
_FAULT = re.compile(r"(?P<what>[a-z-]+)(?: (?P<who>[a-z]+\d*))?(?: (?P<lasting>[\d.]+)ms)? at (?P<moment>\S+)")


def parsed(line: str) -> Schedule:
    """The schedule of a line; ScheduleError says which part is none."""
    found = _BEGIN.match(line.strip())
    if not found:
        raise ScheduleError(f"{line!r} does not begin with a seed, as in `0: kill control at guardian:12`")
    parts = filter(None, map(str.strip, line.strip()[found.end() :].split(";")))
    return Schedule(int(found["seed"]), tuple(map(_fault, parts)), **{kind: bool(found[kind]) for kind in KINDS})


def _fault(text: str) -> Fault:
    found = _FAULT.fullmatch(text)
    if not found or found["what"] not in list(What):
        raise ScheduleError(f"{text!r} is no fault; kinds: {', '.join(What)}")
    what, who, lasting = What(found["what"]), found["who"] or "", found["lasting"]
    is_wrong = what not in OF_NOBODY if not who else what is What.NO_DISK
    if is_wrong or (lasting is not None) != (what in LASTING):
        raise ScheduleError(f"{text!r} has not the words of {what}")
    return Fault(what, who, _moment(found["moment"]), round(float(lasting or 0) * MS))


def _moment(text: str) -> Moment:
    found = _MOMENT.fullmatch(text)
    if not found:
        raise ScheduleError(f"{text!r} is no moment: `guardian:12`, `guardian:12+60ms` or `31.5ms`")
    if found["time"]:
        return Moment(after=round(float(found["time"]) * MS))
    return Moment(found["who"], int(found["gate"]), round(float(found["after"] or 0) * MS))


def _span(ns: int) -> str:
    return f"{ns / MS:.6f}".rstrip("0").rstrip(".") + "ms"
