"""The ends of a run, as docs/howto-stop-safely.md has them in its table: who resets the outputs, within which time, how
that is told. The page shows these rows, and the promises of `tools.schedules` are held to them.

A time is from the last signal that a row names (or the end of the application) to the last output that goes to its
default, where processors are free and devices answer immediately. `Times.seconds` reads its text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import prod

UNITS = {"ms": 1e-3, "s": 1.0}
QUANTITY = re.compile(r"([\d.]+) (ms|s)\b")
NAME = re.compile(r"`(\w+)`")
WORDS = re.compile(r"within | more|, after the device answers|, plus the time in the row of the control process")


@dataclass(frozen=True)
class Times:
    """What the times of the table are made of, in s."""

    period: float
    hang_timeout: float
    timeout: float
    """The longest timeout of a driver."""

    @property
    def watch_timeout(self) -> float:
        """That of a guardian's heartbeats."""
        return max(self.hang_timeout, 0.5)

    @property
    def call_timeout(self) -> float:
        """That of a call while a machine is reset."""
        return 1.0 + 2 * self.timeout

    def seconds(self, within: str) -> float:
        """A time of the table: a sum of times with a unit, names of settings, and multiples. ValueError where the text
        is none."""
        text = WORDS.sub("", within.replace("immediately", "0 s"))
        text = QUANTITY.sub(lambda found: str(float(found[1]) * UNITS[found[2]]), text)
        text = NAME.sub(lambda found: str(getattr(self, found[1])), text)
        return sum(prod(map(float, product.split("*"))) for product in text.split("+"))


@dataclass(frozen=True)
class End:
    """A row. `within`: "" where no time can be told. `key`: its name in `tools.schedules`; "" where there is one
    process, or none can be stopped there."""

    what: str
    who: str
    within: str
    status: str
    acknowledged: str
    key: str = ""

    @property
    def row(self) -> str:
        return _row(self.what, self.who, self.within, self.status, self.acknowledged)

    @property
    def statuses(self) -> set[int]:
        return {int(number) for number in re.findall(r"\b\d+\b", self.status)}


@dataclass(frozen=True)
class Unsafe:
    """A row of the table of what cannot be made safe. `schedules` show it: the devices (`driven`) of which stay driven,
    and to when: "told", or until somebody "asked" for a stop."""

    what: str
    driven: str
    why: str
    schedules: dict[str, str]
    until: str = "told"

    @property
    def row(self) -> str:
        return _row(self.what, self.driven, self.why)


def _row(*cells: str) -> str:
    return f"|{'|'.join(f' {cell} ' if cell else ' ' for cell in cells)}|"


ENDS = (
    End("the application ends", "control process", "immediately", "0", "no", "application ends"),
    End(
        "the application, `control` or a driver raises an exception",
        "control process",
        "immediately", "1", "no",
    ),
    End(
        "somebody presses Ctrl-C, the run gets SIGTERM, or the terminal closes (SIGHUP)",
        "control process, between two periods",
        "within `period` + 20 ms", "Ctrl-C 130, SIGTERM 143, SIGHUP 129", "no", "asked to stop",
    ),
    End(
        "a further signal arrives, and there is only one process: code that does not end by itself is interrupted, and "
        "the message names this code",
        "the same process",
        "", "the status of the signal", "no",
    ),
    End(
        "the time limit of the run, `umo run --until`, is over",
        "control process, between two periods",
        "immediately", "124", "no",
    ),
    End(
        "the program ends (by its last line, `sys.exit`, an exception or Ctrl-C) while a machine is connected in a "
        "thread other than the main thread, also in a daemon thread",
        "the thread of the machine, for which the end of the program waits; or the main thread, if the thread of the "
        "machine does not begin to disconnect it within 10 s plus the time of a call that hangs",
        "", "the status of the program", "no",
    ),
    End(
        "a client ends the run: *End the run* on the page, `umo do STATION stop`, `umo.attach(...).stop()` *",
        "control process, as after SIGTERM; the message says who ended the run",
        "within `period` + 20 ms", "143", "no",
    ),
    End("the control process is killed or crashes *", "guardian", "immediately", "1", "yes", "control killed"),
    End(
        "the control process hangs, because of SIGSTOP, an endless loop, or a driver call that never returns *",
        "guardian, after `hang_timeout`",
        "within `hang_timeout` + 40 ms", "1", "yes", "control stopped",
    ),
    End(
        "other processes keep the control process from running *",
        "guardian, after three times `hang_timeout`; the message names the processes that had its core",
        "within 3 * `hang_timeout` + 40 ms", "1", "yes",
    ),
    End("the guardian is killed *", "control process", "within `period`", "1", "yes", "guardian killed"),
    End(
        "the guardian is stopped (SIGSTOP) for longer than both `hang_timeout` and 0.5 s *",
        "control process",
        "within `watch_timeout` + `period`", "1", "yes", "guardian stopped",
    ),
    End(
        "no period ends for longer than `hang_timeout` or the time of a circuit's watchdog, and then the processes "
        "continue: after SIGSTOP and SIGCONT, a suspended computer, or slow code *",
        "control process",
        "within `period`", "1", "no",
    ),
    End(
        "the command `umo run` is killed, also under `nohup` *",
        "control process, on request of the guardian; the trace of the run so far stays in `runs/`",
        "within `period` + 20 ms", "", "no", "starter killed",
    ),
    End(
        "the device does not answer when the actuators are reset",
        "guardian, which retries for `reset_for` *",
        "within 500 ms more, after the device answers",
        "1 if a retry succeeds; otherwise 3, and the message lists the actuators that were not reached",
        "yes", "silent",
    ),
    End(
        "guardian and control process are killed, simultaneously or one after the other *",
        "standby guardian",
        "immediately", "1", "yes", "standby follows a dead one",
    ),
    End(
        "the guardian is killed, and the control process is stopped (SIGSTOP) *",
        "standby guardian",
        "within `hang_timeout` + 40 ms", "1", "yes",
    ),
    End(
        "the guardian is stopped (SIGSTOP), and the control process is killed or stopped *",
        "standby guardian",
        "within `watch_timeout` + 200 ms, plus the time in the row of the control process", "1", "yes",
        "standby follows a stopped one",
    ),
    End(
        "the guardian is killed, the standby guardian is killed or stopped (SIGSTOP), and perhaps the control process "
        "is killed or stopped too, in any order *",
        "the reset process, which becomes the standby guardian; a control process that lives stops by itself",
        "within 200 ms, plus the time in the row of the control process", "1", "yes", "reserve follows dead ones",
    ),
    End(
        "the guardian is stopped (SIGSTOP), the standby guardian is killed or stopped, and perhaps the control process "
        "is killed or stopped too, in any order *",
        "the reset process, 1 s after the time at which the standby guardian should have reset; a control process that "
        "lives stops by itself",
        "within `watch_timeout` + 1.3 s, plus the time in the row of the control process", "1", "yes",
        "reserve follows stopped ones",
    ),
    End(
        "guardian, standby guardian and reset process are killed *",
        "control process; like a guardian it retries for `reset_for`, and it opens devices off the cycle itself if "
        "their worker is dead",
        "within `period`", "1 if a retry succeeds; otherwise 3", "yes",
    ),
    End(
        "the standby guardian, or the reset process while it waits, is killed or stopped *",
        "nobody: the run continues, and the guardian starts the process again",
        "", "", "no",
    ),
    End(
        "the reset process is killed when it should reset *",
        "the guardian starts another reset process, which resets",
        "within 500 ms more", "1", "yes", "resetter killed",
    ),
    End(
        "the reset process is stopped (SIGSTOP) when it should reset *",
        "the guardian starts another reset process, which resets",
        "within `call_timeout` + 500 ms more", "1", "yes", "resetter stopped",
    ),
    End(
        "a [worker process](howto-slow-devices.md) is killed when its outputs should be reset *",
        "the guardian, or the process that takes its place; it opens the device of the worker itself",
        "within 500 ms more", "1", "yes", "worker killed",
    ),
    End(
        "a worker process is stopped (SIGSTOP) when its outputs should be reset *",
        "the guardian, or the process that takes its place; it ends the worker and then opens the device itself",
        "within `call_timeout` + 700 ms more", "1", "yes", "worker stopped",
    ),
    End(
        "a guardian is stopped (SIGSTOP) in the middle of a reset",
        "the standby guardian; if it is dead or stopped too, the reset process 1 s later",
        "within 31.3 s", "1", "yes", "stopped within a reset",
    ),
    End(
        "control process, guardian, standby guardian and reset process are all stopped (SIGSTOP), or some are killed "
        "and the others are stopped *",
        "nobody until one of them continues; `umo run` names the stopped processes, and lets them continue when the "
        "run is asked to stop",
        "", "1", "no", "all stopped",
    ),
    End(
        "control process, guardian, standby guardian and reset process are killed simultaneously, or the computer goes "
        "down",
        "for devices [off the cycle](howto-slow-devices.md), their worker process, if it lives; for other devices, the "
        "watchdog of the circuit, if it has one",
        "immediately", "3", "yes", "all killed",
    ),
)  # fmt: skip
BY_KEY = {end.key: end for end in ENDS if end.key}
AT = "at worker:20"
ALL = ("control", "guardian", "standby", "reserve")
UNSAFE = (
    Unsafe(
        "control process, guardian, standby guardian and reset process are killed simultaneously",
        "outputs on the cycle; if the worker is killed too, also outputs off the cycle",
        "no process of the run is left, and a process that is started later must not use a device unless somebody "
        "asks for it",
        {
            "0 long: " + "; ".join(f"kill {who} {AT}" for who in ALL): "d1",
            "0 long: " + "; ".join(f"kill {who} {AT}" for who in (*ALL, "worker")): "d1 d2",
        },
    ),
    Unsafe(
        "these four processes are all stopped (SIGSTOP), or some are killed and the others are stopped",
        "all outputs, until one of the processes continues",
        "a stopped process does nothing, and the person who stopped it may want to examine it",
        {
            "0 long: " + "; ".join(f"stop {who} {AT}" for who in ALL): "d1 d2",
            f"0 long: kill control {AT}; kill guardian {AT}; kill standby {AT}; stop reserve {AT}": "d1 d2",
        },
        until="asked",
    ),
    Unsafe(
        "a device does not answer for the last 0.5 s of the resets",
        "the outputs of this device; they are reported as not reached",
        "nothing can reach the device; the resets need a time limit, because other programs wait for the end of the "
        "run",
        {f"0 long: silent d1 30000ms {AT}; kill control {AT}": "d1", f"0 long: silent d2 30000ms {AT}; ask {AT}": "d2"},
    ),
)
