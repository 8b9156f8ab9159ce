"""One machine at the box, started as a user would: by a program with `umo.start` in it, or by `umo run`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from random import Random
from time import monotonic, sleep, time

import umo
from bench.kills import kept, processes
from bench.kills.box import Box
from bench.kills.station import disk, journal
from bench.kills.station.cells import CONTROL, FILE, GUARDIAN, KEPT, MAX_AGE, OPERATED, PERIODS, WRONG

HERE = Path(__file__).parent
NOBODY = 65534
START_LIMIT = 60.0
"""s."""
WIRING = """\
[drivers.box]
type = "modbus"
port = {port}
timeout = "{timeout}"
{more}
[process]
hang_timeout = "{hang_timeout}"
reset_for = "{reset_for}"

[wire]
timer = {{ driver = "timerfd", period = "5 ms" }}
"""
OFF_CYCLE = """\
off_cycle = true
period = "20 ms"
max_age = "200 ms"
"""
AGES = {False: 1000, True: 300}
"""Age in ms that no good reading may have, on the cycle and off it: what the wiring allows, and time in which this
process did not run."""
OF_PARTS = "".join(
    f'"{part}.{item}" = {{ driver = "simulated" }}\n' for part in ("filler", "brewer") for item in ("valve", "speed")
)
AFTERWARDS = 40
"""Periods of the run that takes over what another one has kept."""
TRIES = 3
"""Such runs at most: one may fail as the box, a process of this busy computer, does not answer in time."""
WIRES = {"motors": (2, "holding"), "valves": (10, "coil"), "switches": (8, "discrete"), "counts": (4, "input")}


class How(Enum):
    """How the machine is started."""

    PROGRAM = "umo.start"
    COMMAND = "umo run"


@dataclass(frozen=True)
class Setting:
    """The settings of every try of a kind."""

    hang_timeout: str = "1 s"
    timeout: str = "100 ms"
    """Timeout of the driver."""
    reset_for: str = "10 s"
    off_cycle: bool = False
    """Whether a worker process serves the box."""
    kept: bool = False
    """Whether the machine has kept numbers."""
    operated: bool = False
    """Whether it has all that can be kept, and a journal."""
    keeper_killed: bool = False
    """Whether nobody is left who writes the last values: then a run shorter than a second may have kept none."""
    disk_pause: float = 0.0
    """s that each call of the disk under the kept values takes."""
    power_cut: bool = False
    """Whether of the kept values that is left which is on the disk after a power cut."""
    nohup: bool = False
    plain: bool = False
    """Whether it runs as a user without privileges."""
    arguments: Sequence[str] = ()
    """Arguments of the program."""


class NotStruck(Exception):
    """The machine ended before anything was done to it."""


class Run:
    """The processes of one machine."""

    journal: kept.Journal | None = None
    _client: subprocess.Popen[bytes] | None = None
    moments = Random(0)
    """For what a power cut leaves."""
    kept_age = 0.0
    """s from the period of what was kept to the last one; known after `wrong_kept`."""

    def __init__(self, how: How, box: Box, folder: Path, setting: Setting) -> None:
        self.how, self.box, self.folder, self.setting = how, box, folder, setting
        self._said = folder / "said.txt"
        self._certain = folder / "certain"
        station = _write_station(folder, box.port, setting)
        box.cells[MAX_AGE] = AGES[setting.off_cycle]
        own = {"UMO_STATE": folder / "state", "UMO_FRAMES": folder / "frames", FILE: box.file}
        environment = os.environ | {name: str(path) for name, path in own.items()} | {"PYTHONPATH": _path()}
        environment |= {KEPT: "1"} if setting.kept else {}
        environment |= self._operated() if setting.operated else {}
        if setting.plain:
            _hand_over(folder)
        with self._said.open("wb") as said:
            self.starter = subprocess.Popen(
                [*_wrapped(setting), *_command(how, station, setting)],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                start_new_session=True,  # a Ctrl-C at this terminal is for the campaign
            )
        if setting.operated:
            del environment[FILE]  # it is no process of the machine's
            self._client = subprocess.Popen(
                [sys.executable, str(HERE / "client.py")], env=environment, stderr=subprocess.DEVNULL
            )

    # Its processes ---------------------------------------------------------------------------------------

    @property
    def control(self) -> int:
        """0 before the application has begun."""
        return self.box.cells[CONTROL]

    @property
    def guardian(self) -> int:
        """0 before there is one."""
        told = self.box.cells[GUARDIAN]
        return told or next(iter(processes.children(self.starter.pid)), 0)

    def process(self, which: str) -> int:
        """The starter, the guardian, its standby, the reset process that waits behind both ("reserve") or the control
        process as soon as there is one; 0 if all ended before."""
        find: dict[str, Callable[[], int]] = {
            "starter": lambda: self.starter.pid,
            "guardian": lambda: self.guardian,
            "control": lambda: self.control or processes.child(self.guardian, "umo control"),
            "standby": lambda: processes.child(self.guardian, "umo standby"),
            "reserve": lambda: processes.child(self.guardian, "umo reset"),
            "keeper": lambda: processes.child(self.guardian, "umo keeper"),
            "worker": lambda: processes.child(self.guardian, "umo worker"),
        }
        until = monotonic() + START_LIMIT
        while not (pid := find[which]()) and self.starter.poll() is None and monotonic() < until:
            sleep(processes.LOOK)
        return pid

    @property
    def all(self) -> list[int]:
        """Starter, guardian, standby guardian, the reset process behind both, and control process."""
        return [self.starter.pid, self.guardian, self.process("standby"), self.process("reserve"), self.control]

    # Its course ------------------------------------------------------------------------------------------

    def wait_running(self) -> None:
        """Until every output has left its default; NotStruck if that never comes."""
        until = monotonic() + START_LIMIT
        while not (self.control and all(self.box.values)):
            if self.starter.poll() is not None or monotonic() > until:
                raise NotStruck(f"it did not come to run: {self.said()}")
            sleep(0.001)

    def wait_end(self, limit: float) -> bool:
        """Until the starter, the guardian and the control process are gone; whether they were within `limit` s."""
        until = monotonic() + limit
        watched = [pid for pid in (self.guardian, self.control) if pid]
        while self.starter.poll() is None or any(map(processes.alive, watched)):
            if monotonic() > until:
                return False
            sleep(processes.LOOK)
        return not processes.marked(self._mark) or self._wait_rest(until)

    def _wait_rest(self, until: float) -> bool:
        """For a process that was not known, or a child that has not been taken down yet."""
        while processes.marked(self._mark):
            if monotonic() > until:
                return False
            sleep(processes.LOOK)
        return True

    @property
    def status(self) -> int | None:
        """Exit status of the starter, or less than 0 for the signal that killed it."""
        return self.starter.poll()

    @property
    def told_for(self) -> float:
        """s since its end was recorded, right after the last reset; 0 where there is no record."""
        written = [file.stat().st_mtime for file in (self.folder / "state").rglob("*") if file.is_file()]
        return max(0.0, time() - max(written)) if written else 0.0

    @property
    def wrong_readings(self) -> int:
        """Good readings that were not what the box has."""
        return self.box.cells[WRONG]

    def wrong_kept(self) -> str:
        """What is wrong with the file of kept values: it is not of one moment, or of one too long ago. "": nothing."""
        setting = self.setting
        if setting.kept:
            return kept.wrong_numbers(kept.read(self.folder), self.box.cells[PERIODS], setting.keeper_killed)
        if self.journal is None:
            return ""
        if setting.power_cut:
            kept.cut_power(self.folder, self._certain, self.moments)
        allowed = kept.MAX_AGE + kept.CALLS * setting.disk_pause if setting.keeper_killed else 0.0
        values = kept.read(self.folder)
        self.kept_age = kept.age(values, self.journal) if self.journal.begun else 0.0
        return kept.wrong_moment(values, self.journal, allowed)

    def wrong_start(self) -> str:
        """What is wrong with a run of the same station after this one: it has not taken over what was kept, or does not
        keep its own last period. "": nothing."""
        if self.journal is None or not self.journal.begun:
            return ""
        for _ in range(TRIES):
            values = kept.read(self.folder)
            run = self._next_run()
            try:
                ended = run.wait_end(START_LIMIT)
                assert run.journal is not None
                if run.journal.begun and (wrong := kept.wrong_start(values, run.journal) or run.wrong_kept()):
                    return wrong
                if ended and run.status == 0:
                    return ""
            finally:
                run.close()
        return f"the next run did not end as it must, but with the status {run.status}: {run.said()}"

    def _next_run(self) -> Run:
        """Some periods of the same station, at the same box."""
        for cell in (CONTROL, GUARDIAN):
            self.box.cells[cell] = 0
        self.box.heal()
        last = str(self.box.cells[PERIODS] + AFTERWARDS)
        setting = Setting(operated=True, timeout="300 ms", arguments=("--periods", last))
        return Run(How.PROGRAM, self.box, self.folder, setting)

    def said(self) -> str:
        """The last of what it has written that is not a table, in one line."""
        lines = [line.strip() for line in self._said.read_text(errors="replace").splitlines()]
        told = [line for line in lines if line and not "\u2500" <= line[0] <= "\u257f"]
        return " / ".join(told[-3:])[-300:]

    @property
    def _mark(self) -> str:
        return f"{FILE}={self.box.file}"

    def close(self) -> None:
        """End what is left of it."""
        processes.end_marked(self._mark)
        self.starter.wait()
        if self._client is not None:
            self._client.kill()
            self._client.wait()

    def _operated(self) -> dict[str, str]:
        """The environment of a machine with a journal."""
        self._certain.mkdir(exist_ok=True)
        self.journal = kept.Journal(self.folder / f"{len([*self.folder.glob('*.rows')])}.rows")
        return {
            KEPT: OPERATED,
            journal.FILE: str(self.journal.file),
            disk.FOLDER: str(self._certain),
            disk.PAUSE: str(self.setting.disk_pause),
        }


def _write_station(folder: Path, port: int, setting: Setting) -> Path:
    station = folder / "station"
    (station / "wiring").mkdir(parents=True, exist_ok=True)
    for file in (HERE / "station").glob("*.py"):
        shutil.copy(file, station)
    more = OFF_CYCLE if setting.off_cycle else ""
    limits = {"timeout": setting.timeout, "hang_timeout": setting.hang_timeout, "reset_for": setting.reset_for}
    text = WIRING.format(more=more, port=port, **limits)
    for name, (count, table) in WIRES.items():
        text += "".join(f'"{name}.{i}" = {{ driver = "box", channel = "{table}:{i}" }}\n' for i in range(count))
    text += f'clock = {{ driver = "box", channel = "input:{WIRES["counts"][0]}" }}\n'
    text += OF_PARTS if setting.operated else ""
    (station / "wiring" / "box.toml").write_text(text)
    return station


def _path() -> str:
    """This umo for the processes, too."""
    return os.pathsep.join(filter(None, [str(Path(umo.__file__).parents[1]), os.environ.get("PYTHONPATH")]))


def _command(how: How, station: Path, setting: Setting) -> list[str]:
    if how is How.COMMAND:
        return [str(Path(sys.executable).with_name("umo")), "run", str(station), "-w", "box", "--acknowledge"]
    return [sys.executable, str(HERE / "program.py"), str(station), *setting.arguments]


def _wrapped(setting: Setting) -> list[str]:
    return (["nohup"] if setting.nohup else []) + (list(as_nobody() or ()) if setting.plain else [])


@cache
def as_nobody() -> tuple[str, ...] | None:
    """The words that make a command run without privileges; None where that cannot be done. Where nobody may not even
    read this Python (it lies in root's home), reading everything is the one privilege that is left."""
    if os.getuid() != 0:
        return ()
    plain = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    reading = (*plain, "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")
    environment = os.environ | {"PYTHONPATH": _path()}
    again = "import subprocess, sys, umo; subprocess.run([sys.executable, '-c', 'import umo'], check=True)"
    for words in (plain, reading):
        try:
            tried = subprocess.run([*words, sys.executable, "-c", again], capture_output=True, env=environment)
        except OSError:  # no setpriv
            return None
        if tried.returncode == 0:
            return words
    return None


def _hand_over(folder: Path) -> None:
    if os.getuid() == 0:
        for path in (folder, *folder.rglob("*")):
            os.chown(path, NOBODY, NOBODY)
