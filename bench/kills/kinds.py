"""The kinds of kill, stop and fault, each with the status that it must end with (docs/howto-stop-safely.md).

The orders of the processes, and what each does when another one is killed or stopped at one of its calls, are tried by
`tools.schedules`, in virtual time. Here is what that cannot see. So one try of each kind is enough to see that it is so
with a kernel, a terminal and a device that are real; there are more of those in which these count:

- the control process is killed while its memory is locked and its requests are under way: between its lock and its end
  lie up to 30 ms, and what it has sent may be carried out later (alone, with its guardian, shortly after one another);
- real time: hangs by the limits of a processor that others use, outages around the limits of a reset;
- the device: requests that are carried out late, connections that are refused or closed;
- disks: kept values after a power cut, with a disk that is slow;
- the start of programs, terminals, the want of privileges, processes and descriptors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bench.kills import limits
from bench.kills.run import How, Setting, as_nobody
from bench.kills.strikes import (
    HUP,
    INT,
    KILL,
    STOP,
    TERM,
    Strike,
    again_and_again,
    aged,
    all_of,
    all_stopped_then,
    asleep,
    at_once,
    at_work,
    each,
    ending,
    faulty,
    guardian_stopped_then,
    interrupted_while_retrying,
    neighbours_loop,
    one,
    outage,
    standby_killed_then_both,
    starting,
    stopped_then_killed,
    stopping,
    then_stopped,
    together,
    twice,
    without_descriptors,
    without_processes,
)

PROGRAM, COMMAND = How.PROGRAM, How.COMMAND
BOTH = (PROGRAM, COMMAND)
LOST = (1,)
"""The control process was lost, or the machine failed: the guardian or the control process reset it."""
KILLED = (-KILL,)
"""The starter is gone, nobody is left to be told."""
PATIENT = 25.0
"""s, where `reset_for` (10 s) may be spent."""
VERY_PATIENT = 45.0
"""s, where a guardian may stand still that has begun to reset: it is given 30 s."""
USUAL = Setting()
STALL = (50, 600)
"""ms."""


@dataclass(frozen=True)
class Kind:
    """One row of the table."""

    name: str
    strike: Strike
    statuses: Sequence[int] | Mapping[How, Sequence[int]]
    """The exit statuses of the starter that are right, less than 0 for a signal that killed it."""
    count: int
    how: Sequence[How] = (PROGRAM,)
    """How the machine is started, in turns."""
    setting: Setting = USUAL
    beforehand: tuple[str, int] | None = None
    """A fault of the box that is there before the machine starts."""
    limit: float = 15.0
    """s after the strike within which all processes must have ended."""
    resets: bool = True
    """Whether a process is left that resets the machine."""
    takes: float = 0.0
    """s that a try takes beyond starting the machine and ending it."""

    def right(self, how: How) -> Sequence[int]:
        return self.statuses[how] if isinstance(self.statuses, Mapping) else self.statuses


HANG = Setting(hang_timeout="100 ms", timeout="30 ms")
NOHUP, PLAIN = Setting(nohup=True), Setting(plain=True)

KILLS = [
    Kind("SIGKILL of the control process", one("control", KILL), LOST, 10),
    Kind("SIGSTOP of it, hang_timeout 100 ms", one("control", STOP), LOST, 4, setting=HANG),
    Kind("SIGKILL of the guardian", one("guardian", KILL), LOST, 3),
    Kind("SIGSTOP of the guardian", one("guardian", STOP), LOST, 1, takes=1),
    Kind("SIGSTOP of the guardian, INT to the starter", guardian_stopped_then("starter", INT), (1, 130, -INT), 1),
    Kind("SIGSTOP of the guardian, SIGKILL of the starter", guardian_stopped_then("starter", KILL), KILLED, 1),
    Kind("SIGKILL of the starter", one("starter", KILL), KILLED, 1, BOTH),
    Kind("SIGKILL of the starter under nohup", one("starter", KILL), KILLED, 1, BOTH, NOHUP),
    Kind("SIGSTOP of all for 3 s", asleep(3.0), LOST, 1, takes=3),
]
SHORTLY = (0.0, 0.06)
"""s."""
TOGETHER = [
    Kind("SIGKILL of guardian and control at once", together("guardian", "control"), LOST, 6),
    Kind("SIGKILL of the guardian, then control", together("guardian", "control", apart=SHORTLY), LOST, 4),
    Kind("SIGKILL of control, then the guardian", together("control", "guardian", apart=SHORTLY), LOST, 4),
    Kind("SIGKILL of the guardian's group", together("guardian", group=True), LOST, 1),
    Kind("SIGKILL of the control process's group", together("control", group=True), LOST, 1),
    Kind("SIGKILL of standby and guardian at once", together("standby", "guardian"), LOST, 1),
    Kind("SIGKILL of standby and control at once", together("standby", "control"), LOST, 1),
    Kind("SIGKILL of standby, TERM", then_stopped(together("standby")), (-TERM,), 1),
    Kind("SIGKILL of standby, then of guardian and control", standby_killed_then_both, LOST, 1),
    Kind("SIGKILL of guardian, standby and control", together("guardian", "standby", "control"), LOST, 3),
    Kind("SIGKILL of guardian and standby", all_of(("guardian", KILL), ("standby", KILL)), LOST, 1),
    Kind("SIGKILL of all guardians", together("guardian", "standby", "reserve"), LOST, 1),
    Kind(
        "SIGKILL of guardians and control",
        together("guardian", "standby", "reserve", "control"),
        (1, 3),
        1,
        resets=False,
    ),
    Kind(
        "SIGSTOP of the guardian, SIGKILL of standby and control",
        all_of(("guardian", STOP), ("standby", KILL), ("control", KILL)),
        LOST,
        1,
        limit=VERY_PATIENT,
        takes=2.5,
    ),
    Kind(
        "SIGSTOP of the standby, SIGKILL of guardian and control",
        all_of(("standby", STOP), ("guardian", KILL), ("control", KILL)),
        LOST,
        1,
        limit=VERY_PATIENT,
        takes=2.5,
    ),
    Kind(
        "SIGSTOP of guardian, standby and control",
        all_of(("standby", STOP), ("guardian", STOP), ("control", STOP)),
        LOST,
        1,
        limit=VERY_PATIENT,
        takes=3.5,
    ),
    Kind("SIGSTOP of guardian and control", together("guardian", "control", number=STOP), LOST, 1, takes=3),
    Kind("SIGSTOP of all but umo run, TERM to it", all_stopped_then(TERM), (1, 143), 1, (COMMAND,)),
]
PATIENTLY = Setting(timeout="300 ms")
"""The box is an ordinary process of the computer on which the stations loop."""
NEIGHBOURS = [
    Kind("two other stations loop for ever, TERM", neighbours_loop, (-TERM,), 1, setting=PATIENTLY, takes=6),
    Kind(
        "os.fork in control code, TERM", then_stopped(at_work), (-TERM,), 1, setting=Setting(arguments=("--fork", "1"))
    ),
]
STOPS = [
    Kind("INT to the starter", one("starter", INT), {COMMAND: (130,), PROGRAM: (-INT,)}, 1, BOTH),
    Kind("TERM to the starter", one("starter", TERM), {COMMAND: (143,), PROGRAM: (-TERM,)}, 1, BOTH),
    Kind("HUP to the starter", one("starter", HUP), {COMMAND: (129,), PROGRAM: (-HUP,)}, 1, BOTH),
    Kind("TERM to the starter under nohup", one("starter", TERM), (143,), 1, (COMMAND,), NOHUP),
    Kind("INT twice, 5 to 60 ms apart", twice(INT), {COMMAND: (130,), PROGRAM: (-INT, 130)}, 2, (COMMAND, PROGRAM)),
    Kind("TERM to all at once", each(TERM), {COMMAND: (143,), PROGRAM: (-TERM,)}, 1, (COMMAND, PROGRAM)),
    Kind(
        "leaving the block as the application ends",
        ending,
        (0, 143),
        1,
        setting=Setting(arguments=("--periods", "20", "--leave", "0.07", "0.13")),
    ),
    Kind("SIGKILL of any at start-up", starting, (1, -KILL, 143, -TERM), 5, BOTH, takes=1),
    Kind("SIGKILL of any while stopping", stopping, (1, 143, -KILL), 3, (COMMAND,)),
]
DEVICE = [
    Kind("control killed, box stalled", faulty("stall", STALL, then=at_once("control", KILL)), LOST, 6, takes=1),
    Kind("control killed, box refusing", faulty("refuse", then=at_once("control", KILL)), LOST, 4, takes=1),
    Kind(
        "control killed, box with one connection",
        one("control", KILL),
        LOST,
        1,
        beforehand=("one", 1000),
        limit=PATIENT,
        takes=3,
    ),
    Kind("INT while the guardian retries", interrupted_while_retrying, (1, 130), 1, (COMMAND,), takes=1),
]
SHORT = Setting(reset_for="3 s")
SECONDS = (0.1, 0.4, 1.6, 3.0, 3.4, 4.0, 6.0)
"""s of the limits of a reset: the timeouts of its attempts, `reset_for`, the end of the attempts that begin then."""
OUTAGES = [
    Kind("outage, control killed", outage("control", KILL, SECONDS), (1, 3), 14, setting=SHORT, limit=PATIENT, takes=4),
    Kind(
        "outage, off the cycle, control killed",
        outage("control", KILL, SECONDS),
        (1, 3),
        6,
        setting=replace(SHORT, off_cycle=True),
        limit=PATIENT,
        takes=4,
    ),
]
WANT = [
    Kind("without privileges: control killed", one("control", KILL), LOST, 2, setting=PLAIN),
    Kind("without privileges: guardian killed", one("guardian", KILL), LOST, 1, setting=PLAIN),
    Kind("without privileges: starter killed", one("starter", KILL), KILLED, 1, BOTH, PLAIN),
    Kind("pids.max reached: control killed", without_processes, LOST, 2, takes=1),
    Kind("0 to 3 descriptors left: control killed", without_descriptors("control"), LOST, 1, takes=1),
    Kind("0 to 3 descriptors left: guardian killed", without_descriptors("guardian"), LOST, 1),
]
FAULTS: list[tuple[str, str, int]] = [
    ("silent", "silent", 0),
    ("does it and is silent", "mute", 0),
    ("late by 250 ms", "late", 250),
    ("refuses connections", "refuse", 0),
    ("closes the connection", "close", 0),
    ("closes it after answering", "hangup", 0),
    ("resets the connection", "reset", 0),
    ("answers in two pieces", "split", 20),
    ("answers byte by byte", "trickle", 20),
    ("answers twice", "twice", 0),
    ("an old answer first", "stale", 0),
    ("exception 4", "exception", 4),
    ("exception 6, busy", "exception", 6),
    ("garbage", "garbage", 0),
    ("cut answers, closed", "cut", 9),
    ("cut answers, left open", "half", 8),
    ("another transaction", "transaction", 0),
    ("another unit", "unit", 0),
    ("another protocol", "protocol", 0),
    ("another function", "function", 43),
    ("too long by the header", "length", 1),
    ("too short by the header", "length", -1),
    ("byte count 0 of bits", "bitcount", 0),
    ("byte count 200 of bits", "bitcount", 200),
    ("byte count 7 of registers", "count", 7),
    ("a byte too few", "fewer", 0),
    ("two bytes too many", "trailing", 0),
    ("confirms another address", "echo", 0),
    ("confirms another value", "value", 0),
]
EACH_FAULT = 1
PROTOCOL = [
    Kind(f"box: {text}", faulty(name, value), (1, -TERM), EACH_FAULT, limit=PATIENT, takes=1.0)
    for text, name, value in FAULTS
]
PROTOCOL += [
    Kind("box: stalled, then the newest first", faulty("stall", STALL), (1, -TERM), 5, limit=PATIENT, takes=1.0),
    Kind(
        "box: confirms a coil as 0x1234, TERM",
        faulty("coil", then=at_once("starter", TERM)),
        (-TERM,),
        EACH_FAULT,
        limit=PATIENT,
        takes=0.5,
    ),
]
OFF_CYCLE = Setting(off_cycle=True)
WORKERS = [
    Kind("off the cycle: SIGKILL of the worker, TERM", then_stopped(together("worker")), (-TERM,), 3),
    Kind("off the cycle: SIGSTOP of the worker, TERM", then_stopped(together("worker", number=STOP)), (-TERM,), 1),
    Kind("off the cycle: SIGKILL of control", one("control", KILL), LOST, 3),
    Kind("off the cycle: SIGKILL of the guardian", one("guardian", KILL), LOST, 1),
    Kind("off the cycle: SIGKILL of worker and control", together("worker", "control"), LOST, 1),
    Kind("off the cycle: SIGKILL of control, then the worker", together("control", "worker", apart=SHORTLY), LOST, 1),
    Kind("off the cycle: SIGKILL of guardian and control", together("guardian", "control"), LOST, 1),
    Kind("off the cycle: SIGKILL of guardian, control, worker", together("guardian", "control", "worker"), LOST, 1),
    Kind("off the cycle: SIGKILL of guardian, control, standby", together("guardian", "control", "standby"), LOST, 1),
    Kind(
        "off the cycle: SIGKILL of all but the worker",
        together("guardian", "control", "standby", "reserve"),
        (1, 3),
        1,
    ),
    Kind("off the cycle: SIGKILL of guardian, standby, worker", together("guardian", "standby", "worker"), LOST, 1),
    Kind(
        "off the cycle: SIGKILL of all but control",
        together("guardian", "standby", "reserve", "worker"),
        LOST,
        1,
    ),
    Kind(
        "off the cycle: SIGSTOP of the guardian, SIGKILL of standby and control",
        all_of(("guardian", STOP), ("standby", KILL), ("control", KILL)),
        LOST,
        1,
        limit=VERY_PATIENT,
    ),
    Kind("off the cycle: SIGKILL of each worker, TERM", then_stopped(again_and_again("worker", KILL, 5)), (-TERM,), 1),
    Kind("off the cycle: box silent", faulty("silent"), (1, -TERM), 1, limit=PATIENT, takes=1.0),
    Kind("off the cycle: box refusing", faulty("refuse"), (1, -TERM), 1, limit=PATIENT, takes=1.0),
    Kind("off the cycle: control killed, box stalled", faulty("stall", STALL, then=at_once("control", KILL)), LOST, 3),
]
WORKERS = [replace(kind, setting=OFF_CYCLE) for kind in WORKERS]
KEPT = [
    Kind("kept: SIGKILL of control", aged(one("control", KILL)), LOST, 3, takes=1.5),
    Kind("kept: SIGKILL of the guardian", one("guardian", KILL), LOST, 1),
    Kind("kept: SIGKILL of guardian and control", aged(together("guardian", "control")), LOST, 1, takes=1.5),
    Kind(
        "kept: SIGKILL of control, then the guardian",
        aged(together("control", "guardian", apart=SHORTLY)),
        LOST,
        1,
        takes=1.5,
    ),
    Kind("kept: SIGKILL of the keeper, TERM", then_stopped(together("keeper")), (-TERM,), 1),
    Kind("kept: SIGKILL of keeper and control", together("keeper", "control"), LOST, 1),
    Kind(
        "kept: SIGKILL of guardians and control",
        aged(
            together("guardian", "standby", "reserve", "control")
        ),  # before there is a keeper nobody is left who could make one
        (1, 3),
        1,
        resets=False,
        takes=1.5,
    ),
    Kind("kept: SIGKILL of the starter", one("starter", KILL), KILLED, 1, BOTH),
]
KEPT = [replace(kind, setting=Setting(kept=True)) for kind in KEPT]
KEPT += [
    Kind(
        "kept: SIGKILL of all but the starter",
        aged(together("keeper", "guardian", "standby", "reserve", "control")),
        (1, 3),
        2,
        setting=Setting(kept=True, keeper_killed=True),
        resets=False,
        takes=1.5,
    )
]
AGED, AGED_MORE = (0.2, 2.0), (1.0, 3.2)
"""s that an operated machine runs before it is struck; the longer where its last values are not written."""
ALL = ("keeper", "guardian", "standby", "reserve", "control")
OPERATED = Setting(operated=True, timeout="300 ms")
"""The machine, its operator and the run that takes over share the computer with the box."""
SLOW_DISK = replace(OPERATED, disk_pause=0.04)
EVERYTHING = replace(OPERATED, keeper_killed=True)


def _operated(name: str, strike: Strike, statuses: Sequence[int], count: int, setting: Setting = OPERATED) -> Kind:
    resets = not setting.keeper_killed
    struck = aged(strike, *(AGED if resets else AGED_MORE))
    return Kind(f"operated: {name}", struck, statuses, count, setting=setting, resets=resets, takes=1.3)


AT_WORK = [
    _operated("SIGKILL of control", one("control", KILL), LOST, 3),
    _operated("SIGKILL of the guardian", one("guardian", KILL), LOST, 3),
    _operated("SIGKILL of guardian and control", together("guardian", "control"), LOST, 1),
    _operated("SIGKILL of control, then the guardian", together("control", "guardian", apart=SHORTLY), LOST, 4),
    _operated("SIGKILL of the keeper, TERM", then_stopped(together("keeper")), (-TERM,), 1),
    _operated("SIGKILL of keeper and control", together("keeper", "control"), LOST, 1),
    _operated("SIGKILL of the starter", one("starter", KILL), KILLED, 1),
    _operated("SIGSTOP, SIGKILL of control", stopped_then_killed("control"), LOST, 1),
    _operated("SIGSTOP, SIGKILL of guardian and control", stopped_then_killed("guardian", "control"), LOST, 1),
    _operated("SIGSTOP, SIGKILL of keeper and control", stopped_then_killed("keeper", "control"), LOST, 1),
    _operated("slow disk, SIGKILL of control", one("control", KILL), LOST, 3, SLOW_DISK),
    _operated("SIGKILL of all but the starter", together(*ALL), (1, 3), 3, EVERYTHING),
    _operated("power cut", together(*ALL), (1, 3), 6, replace(EVERYTHING, power_cut=True)),
    _operated("power cut, slow disk", together(*ALL), (1, 3), 6, replace(EVERYTHING, power_cut=True, disk_pause=0.04)),
    _operated("TERM", one("starter", TERM), (-TERM,), 1),
]
KINDS = KILLS + TOGETHER + WORKERS + KEPT + AT_WORK + NEIGHBOURS + STOPS + DEVICE + OUTAGES + WANT + PROTOCOL


def possible(kind: Kind) -> bool:
    """Whether this computer can do it."""
    if kind.setting.plain and as_nobody() is None:
        return False
    return kind.strike is not without_processes or limits.can_take_processes()
