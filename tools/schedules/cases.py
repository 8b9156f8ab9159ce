"""Schedules that are named: one or more for each row of the table of ends, what was once wrong, and what a process does
that nobody but it is left to do."""

from __future__ import annotations

from collections.abc import Iterator

from tools.schedules.ends import UNSAFE
from tools.schedules.faults import Schedule, parsed

DRIVEN = "at worker:20"
"""A moment at which both outputs are driven."""


def _all(what: str, *who: str, after: str = "") -> str:
    """The same happens to all of them at that moment, or later."""
    return "; ".join(f"{what} {each} {DRIVEN}{after}" for each in who)


GUARDIANS = ("guardian", "standby", "reserve")
ROWS = {
    "application ends": "0:",
    "asked to stop": f"0 long: ask {DRIVEN}",
    "control killed": f"0 long: kill control {DRIVEN}",
    "control stopped": f"0 long: stop control {DRIVEN}",
    "guardian killed": f"0 long: kill guardian {DRIVEN}",
    "guardian stopped": f"0 long: stop guardian {DRIVEN}",
    "starter killed": f"0 long: kill starter {DRIVEN}",
    "silent": f"0 long: silent d2 600ms {DRIVEN}; kill control {DRIVEN}",
    "standby follows a dead one": f"0 long: {_all('kill', 'guardian', 'control')}",
    "standby follows a stopped one": f"0 long: {_all('stop', 'guardian', 'control')}",
    "reserve follows dead ones": f"0 long: {_all('kill', 'guardian', 'control')}; stop standby {DRIVEN}",
    "reserve follows stopped ones": f"0 long: {_all('stop', 'guardian', 'control')}; kill standby {DRIVEN}",
    "resetter killed": f"0 long: {_all('kill', 'reserve', 'control')}",
    "resetter stopped": f"0 long: stop reserve {DRIVEN}; kill control {DRIVEN}",
    "worker killed": "0: kill worker at worker:24",
    "worker stopped": f"0 long: stop worker {DRIVEN}; kill control {DRIVEN}",
    "all stopped": f"0 long: stop guardian {DRIVEN}; {_all('kill', 'standby', 'reserve', 'control')}",
    "stopped within a reset": f"0 long: kill control {DRIVEN}; stop reserve {DRIVEN}; stop guardian {DRIVEN}+200ms",
    "all killed": f"0 long: {_all('kill', *GUARDIANS, 'control')}",
}
"""A schedule for each row of the table of ends that has a key."""
ONCE_WRONG = (
    "0: ask at guardian:5",  # while the start is recorded
    "0: ask at guardian:5; ask at guardian:6",
    "0: kill guardian at worker:5; stop worker at worker:5",  # the starter knows no other process
    "0: kill guardian at control:5; stop control at control:5",
    "0: stop control at control:5",  # it holds its lock, and is not admitted
    "0: stop guardian at control:30; kill control at control:30; kill standby at control:30",
    "0: hold guardian 60ms at guardian:30; kill guardian at guardian:30+60ms; kill control at guardian:30+60ms",
    "0: kill guardian at control:30; kill standby at control:30; kill reserve at control:30",
    "0: kill guardian at control:30; kill standby at control:30; kill worker at control:30",
    "0: silent d2 600ms at control:24; kill control at control:24",
    "0: no-fork guardian at guardian:10",
    "0 frames: kill keeper at keeper:5; kill control at keeper:5",
    f"0 long: stop reserve {DRIVEN}; kill guardian {DRIVEN}",  # it was left behind, and held the devices
    "0: kill guardian at guardian:79; stop standby at guardian:79",  # so was the standby guardian, after a good end
    "0: kill guardian at guardian:76; kill standby at guardian:76",  # the record of a good end was gone
    "37315: stop reserve at control:39; kill worker at worker:24",
    "37549: kill reserve at guardian:45+43ms; kill control at reserve:7",
    # a worker that was stopped while it tested the lock of a standby guardian kept the one that waits from going on
    "18656: stop worker at worker:30; ask at worker:30; kill guardian at reserve:3",
    # a worker held the pipe that tells the clients of a run its end
    "0 clients: kill control at operator:12",
    # a late heartbeat of the former holder of the lease had the machine refuse the holder as dead
    "0 clients: hold operator 22ms at operator:41",
    # who took over told the service manager of a life that the guardian had passed on
    "0 clients: kill guardian at guardian:125; stop control at guardian:125",
    # a worker whose outputs should be reset: the table had less time than it takes
    "5388: kill worker at guardian:50+51ms; kill control at guardian:44+54ms",
    "7191: stop standby at starter:21+78ms; kill control at starter:21+78ms; stop reserve at guardian:63+4ms",
    "515: kill worker at worker:25; kill standby at guardian:31+77ms; stop guardian at guardian:31+77ms",
    # the starter did not know the standby guardian, whose guardian was killed before it told
    "83454: ask at starter:52+77ms; stop standby at starter:52+77ms; kill guardian at standby:4",
    # a control process that had not reached every output was given the time of a report that is slow
    "81947: stop worker at guardian:4+62ms; stop guardian at control:48; stop control at control:48",
    # a process that is stopped is killed with its parent, too: the schedules let it live
    "99844: kill guardian at worker:24+60ms; stop reserve at guardian:60; kill control at control:21",
    # the next one that waits to reset waited for the place of a stopped one
    f"0 long: stop reserve {DRIVEN}; kill control {DRIVEN}; {_all('kill', 'guardian', 'standby', after='+200ms')}",
)
"""Also what the table of ends once had as unsafe."""
ALONE = (
    # control is the only one left, and the worker is dead, or the guardian stopped
    f"0 long: {_all('kill', *GUARDIANS, 'worker')}",
    f"0 long: stop guardian {DRIVEN}; {_all('kill', 'standby', 'reserve', 'worker')}",
    f"0 long: {_all('stop', *GUARDIANS)}; kill worker {DRIVEN}",
    # the worker is, and its device does not answer at once
    f"0 long: {_all('kill', *GUARDIANS, 'control')}; silent d2 150ms {DRIVEN}",
    # the process that waits while another one resets is
    f"0 long: kill control {DRIVEN}; {_all('kill', 'guardian', 'standby', after='+100ms')}",
    f"0 long: kill control {DRIVEN}; stop standby {DRIVEN}; stop guardian {DRIVEN}+100ms",
    # one guardian goes on when another one has begun to reset
    f"0 long: kill control {DRIVEN}; hold guardian 700ms {DRIVEN}",
    f"0 long: kill control {DRIVEN}; hold guardian 800ms {DRIVEN}",
    f"0 long: {_all('stop', 'guardian', 'control')}; {_all('continue', 'guardian', 'control', after='+850ms')}",
    f"0 long: hold control 150ms {DRIVEN}",
    f"0 long: hold control 131ms {DRIVEN}",
    f"0 long: {_all('kill', 'guardian', 'standby')}; hold control 131ms {DRIVEN}",
    # all go on after a while in which nobody did
    f"0 long: {_all('hold', 'guardian 200ms', 'control 200ms', 'standby 200ms', 'reserve 200ms')}",
    # no process can be had
    f"0 long: no-fork guardian {DRIVEN}; {_all('kill', 'control', 'reserve')}",
    f"0 long: stop worker {DRIVEN}; stop reserve {DRIVEN}; kill control {DRIVEN}",
    f"0 long: {_all('kill', 'control', 'worker')}",
    f"0 long: silent d1 150ms {DRIVEN}; {_all('kill', 'control')}",
    f"0 long: silent d2 260ms {DRIVEN}; {_all('kill', 'control')}",
    "0: kill guardian at control:8",
    "0: stop guardian at control:8",
    "0: stop standby at standby:2",
    "0: stop reserve at reserve:2",
    "0 frames: kill control at keeper:9",
    "0 frames: kill keeper at keeper:9",
    "0 frames: stop keeper at keeper:9",
    "0 frames:",
)


def cases() -> Iterator[Schedule]:
    """All of them; the one that lasts long is the last one."""
    unsafe = (line for row in UNSAFE for line in row.schedules)
    lines = [*ROWS.values(), *ONCE_WRONG, *ALONE, *unsafe]
    return map(parsed, sorted(lines, key=lambda line: line == ROWS["stopped within a reset"]))
