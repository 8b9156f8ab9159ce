"""The ends of a run, as docs/howto-stop-safely.md has them in its table: who resets the outputs, within which time, how
that is told. The page shows these rows, and the promises of `tools.schedules` are held to them.

A time is from the last signal that a row names (or the end of the application) to the last output that goes to its
default, where processors are free and devices answer at once. `Times.seconds` reads its text.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import prod

UNITS = {"ms": 1e-3, "s": 1.0}
QUANTITY = re.compile(r"([\d.]+) (ms|s)\b")
NAME = re.compile(r"`(\w+)`")
WORDS = re.compile(r" more|, from when it answers|, and what the row of the control process says")


@dataclass(frozen=True)
class Times:
    """What the times of the table are made of, in s."""

    period: float
    hang_timeout: float
    timeout: float
    """The longest timeout of a driver."""

    @property
    def watch_timeout(self) -> float:
        """That of a guardian's signs of life."""
        return max(self.hang_timeout, 0.5)

    @property
    def call_timeout(self) -> float:
        """That of a call while a machine is reset."""
        return 1.0 + 2 * self.timeout

    def seconds(self, within: str) -> float:
        """A time of the table: a sum of times with a unit, names of settings, and multiples. ValueError where the text
        is none."""
        text = WORDS.sub("", within.replace("at once", "0 s"))
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
    End("the application ends", "control process", "at once", "0", "no", "application ends"),
    End("an exception in application, control or a driver", "control process", "at once", "1", "no"),
    End(
        "Ctrl-C, SIGTERM, the terminal closes (SIGHUP)",
        "control process, between two periods",
        "`period` + 20 ms", "130, 143, 129", "no", "asked to stop",
    ),
    End(
        "a further signal, if there is only one process: code that does not end by itself is interrupted, and the "
        "message names it",
        "the same process",
        "", "that of the signal", "no",
    ),
    End(
        "its time limit, `umo run --until`",
        "control process, between two periods",
        "at once", "124", "no",
    ),
    End(
        "the program ends while a machine is connected in another thread than the main one, also in a daemon thread: "
        "by its last line, `sys.exit`, an exception, Ctrl-C",
        "that thread, and the end waits for it; the main thread, if that one does not begin to leave within 10 s and "
        "the time of a call that hangs",
        "", "that of the program", "no",
    ),
    End(
        "*End the run* on the page, `umo do STATION stop`, `umo.attach(...).stop()` *",
        "control process, as after SIGTERM; the message says who it was",
        "`period` + 20 ms", "143", "no",
    ),
    End("the control process is killed or crashes *", "guardian", "at once", "1", "yes", "control killed"),
    End(
        "the control process hangs: SIGSTOP, an endless loop, a driver call that never returns *",
        "guardian, after `hang_timeout`",
        "`hang_timeout` + 40 ms", "1", "yes", "control stopped",
    ),
    End(
        "other processes keep the control process from running *",
        "guardian, after three times `hang_timeout`; the message names who had its core",
        "3 * `hang_timeout` + 40 ms", "1", "yes",
    ),
    End("the guardian is killed *", "control process", "`period`", "1", "yes", "guardian killed"),
    End(
        "the guardian is stopped (SIGSTOP) for longer than both `hang_timeout` and 0.5 s *",
        "control process",
        "`watch_timeout` + `period`", "1", "yes", "guardian stopped",
    ),
    End(
        "no period ends for longer than `hang_timeout` or the watchdog of a circuit, then the processes continue: "
        "SIGSTOP and SIGCONT, a suspended computer, slow code *",
        "control process",
        "`period`", "1", "no",
    ),
    End(
        "the command `umo run` is killed, also under `nohup` *",
        "control process, on request of the guardian; its trace so far stays in `runs/`",
        "`period` + 20 ms", "", "no", "starter killed",
    ),
    End(
        "the device does not answer when the actuators are reset",
        "guardian, retrying for `reset_for` *",
        "500 ms more, from when it answers",
        "1 if a retry succeeds; otherwise 3, and the actuators not reached are listed", "yes", "silent",
    ),
    End(
        "guardian and control process are killed, at once or one after the other *",
        "standby guardian",
        "at once", "1", "yes", "standby follows a dead one",
    ),
    End(
        "the guardian is killed, and the control process stopped (SIGSTOP) *",
        "standby guardian",
        "`hang_timeout` + 40 ms", "1", "yes",
    ),
    End(
        "the guardian is stopped (SIGSTOP), and the control process killed or stopped *",
        "standby guardian",
        "`watch_timeout` + 200 ms, and what the row of the control process says", "1", "yes",
        "standby follows a stopped one",
    ),
    End(
        "the guardian is killed, the standby guardian killed or stopped (SIGSTOP), and perhaps the control process, in "
        "any order *",
        "the reset process, which becomes the standby guardian; a control process that lives stops by itself",
        "200 ms, and what the row of the control process says", "1", "yes", "reserve follows dead ones",
    ),
    End(
        "the guardian is stopped (SIGSTOP), the standby guardian killed or stopped, and perhaps the control process, "
        "in any order *",
        "the reset process, 1 s after the standby guardian would have been due; a control process that lives stops by "
        "itself",
        "`watch_timeout` + 1.3 s, and what the row of the control process says", "1", "yes",
        "reserve follows stopped ones",
    ),
    End(
        "guardian, standby guardian and reset process are killed *",
        "control process; it retries for `reset_for` as a guardian does, and opens devices off the cycle itself if "
        "their worker is dead",
        "`period`", "1 if a retry succeeds; otherwise 3", "yes",
    ),
    End(
        "the standby guardian, or the reset process while it waits, is killed or stopped *",
        "the run goes on; the guardian starts another one",
        "", "", "no",
    ),
    End(
        "the reset process is killed when it is to work *",
        "guardian, by another one",
        "200 ms more", "1", "yes", "resetter killed",
    ),
    End(
        "the reset process is stopped (SIGSTOP) when it is to work *",
        "guardian, by another one",
        "`call_timeout` + 200 ms more", "1", "yes", "resetter stopped",
    ),
    End(
        "a [worker process](howto-slow-devices.md) is killed when its outputs are to be reset *",
        "whoever resets, by opening the device itself",
        "350 ms more", "1", "yes", "worker killed",
    ),
    End(
        "a worker process is stopped (SIGSTOP) when its outputs are to be reset *",
        "guardian, when it has ended the worker, by opening the device itself",
        "`call_timeout` + 700 ms more", "1", "yes", "worker stopped",
    ),
    End(
        "a guardian is stopped (SIGSTOP) in the middle of a reset",
        "the standby guardian; 1 s later, where it is dead or stopped too, the reset process",
        "31.3 s", "1", "yes", "stopped within a reset",
    ),
    End(
        "control process, guardian, standby guardian and reset process are all stopped (SIGSTOP), or some are killed "
        "and the others stopped *",
        "nobody until one continues; `umo run` names them, and lets them continue when it is to stop",
        "", "1", "no", "all stopped",
    ),
    End(
        "control process, guardian, standby guardian and reset process are killed at once, or the computer goes down",
        "a worker process that lives, for its own devices [off the cycle](howto-slow-devices.md); else the circuit's "
        "own watchdog, if it has one",
        "at once", "3", "yes", "all killed",
    ),
)  # fmt: skip
BY_KEY = {end.key: end for end in ENDS if end.key}
AT = "at worker:20"
ALL = ("control", "guardian", "standby", "reserve")
UNSAFE = (
    Unsafe(
        "control process, guardian, standby guardian and reset process are killed at once",
        "outputs on the cycle; if the worker is killed too, those off the cycle",
        "no process of the run is left, and one that is started later may not use a device without being asked to",
        {
            "0 long: " + "; ".join(f"kill {who} {AT}" for who in ALL): "d1",
            "0 long: " + "; ".join(f"kill {who} {AT}" for who in (*ALL, "worker")): "d1 d2",
        },
    ),
    Unsafe(
        "all of them are stopped (SIGSTOP), or some are killed and the others stopped",
        "all outputs, until one continues",
        "a process that is stopped does nothing, and whoever stopped it may want to look at it",
        {
            "0 long: " + "; ".join(f"stop {who} {AT}" for who in ALL): "d1 d2",
            f"0 long: kill control {AT}; kill guardian {AT}; kill standby {AT}; stop reserve {AT}": "d1 d2",
        },
        until="asked",
    ),
    Unsafe(
        "a device does not answer for the last 0.5 s of the resets",
        "its outputs; they are reported as not reached",
        "nothing reaches it; a limit is needed, as others wait for the end of the run",
        {f"0 long: silent d1 30000ms {AT}; kill control {AT}": "d1", f"0 long: silent d2 30000ms {AT}; ask {AT}": "d2"},
    ),
)
