"""`umo new service`: writes a systemd unit for a station, and prints the next steps."""

from __future__ import annotations

import getpass
import os
import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from umo.errors import OptionError
from umo.process.job import Job, Plan
from umo.process.station import Station
from umo.system import folders
from umo.system.device_record import standing
from umo.system.packages import SHIPPED
from umo.text import some
from umo_command.new.service_hints import groups_for, hints
from umo_command.new.systemd_unit import ServiceUnit
from umo_command.station_named import station_named

SYSTEMD = Path("/run/systemd/system")
"""The folder that exists if systemd runs (sd_booted(3))."""
REFUSED = {
    "acknowledge": "a service must not acknowledge an unsafe end by itself",
    "fault": "faults are injected by hand",
    "fault_seed": "faults are injected by hand",
    "fresh": "each start would set the kept values aside; to do this once, use `umo run STATION --fresh`",
    "full_traceback": "failure.txt in the run's folder has the traceback",
    "help_": "`umo run STATION --help` shows the options",
}
"""Options of `umo run` that a service does not accept, by parameter."""
KEEP, KEEP_RUNS = "200 MB", "20"
"""Defaults of a service: the size of the trace of every period, and the number of runs that are kept."""


def write_unit(
    station: str,
    wiring: str | None,
    words: Sequence[str],
    *,
    name: str | None = None,
    user: str | None = None,
    own_manager: bool = False,
    output: Path | None = None,
) -> None:
    """Check the station with the wiring and the options of `umo run`, write or print the unit, and print the next
    steps."""
    from umo_command.console import out, say

    if own_manager and user is not None:
        raise OptionError("give --as or --user, not both")
    found = station_named(station)
    command, plan = _command(found, wiring, words)
    groups, missing = groups_for(plan.wired.devices)
    unit = ServiceUnit(
        _name(name or f"umo-{found.name}", given=name is not None),
        f"umo run {plan.name}" + (f", {plan.wiring_name}" if plan.wiring_name else ""),
        command,
        str(Path.cwd()),
        plan.wired,
        None if own_manager else user or _caller(),
        groups,
        {key: os.environ[key] for key in (folders.STATE_VARIABLE, "UMO_FRAMES") if key in os.environ},
    )
    text = unit.text()
    if output is None:
        out.file.write(text)
        out.file.flush()
    else:
        output.write_text(text, encoding="utf-8")
    for line in [*_next_steps(unit, output), *missing, *hints(plan.wired.devices), *_standing(plan)]:
        say(line)


def _command(found: Station, wiring: str | None, words: Sequence[str]) -> tuple[list[str], Plan]:
    """Return the command line of the run, with absolute paths, and the plan of the run."""
    from umo_command.run.faces_beside import faces_of, wiring_of
    from umo_command.station_options import parse

    station = found.name if found.path.parent == SHIPPED else str(found.path)
    given, rest, of_run = _options_of_run(station, words)
    for parameter, why in REFUSED.items():
        if given[parameter]:
            raise OptionError(f"--{parameter.strip('_').replace('_', '-').replace('full-', '')}: {why}")
    options = parse(found, wiring, rest, of_run)
    realtime = bool(given["realtime"] or given["manual"])
    plan = Plan(Job(station, wiring=wiring, options=options | ({"realtime": True} if realtime else {})))
    if not given["no_faces"]:
        faces_of(wiring_of(plan), plan.wired.faces)
    line = [sys.executable, "-P", "-m", "umo_command", "run"]
    line.append(station)
    if wiring is not None:
        line += ["--wiring", wiring if wiring in found.wirings else str(Path(wiring).resolve())]
    line += words
    if not plan.wired.realtime and not realtime:  # only a guardian reports to the systemd manager
        line.append("--realtime")
    line += [] if given["no_plot"] else ["--no-plot"]
    if given["no_record"] and (given["keep"] or given["keep_runs"]):
        raise OptionError("--keep and --keep-runs are for the record: leave out --no-record")
    if not given["no_record"]:
        line += [] if given["keep"] else ["--keep", KEEP]
        line += [] if given["keep_runs"] else ["--keep-runs", KEEP_RUNS]
    return line, plan


def _options_of_run(station: str, words: Sequence[str]) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return the parameters of `umo run`, checked as `umo run` checks them, the remaining words, which are for the
    station, and the options of `umo run`."""
    import typer

    from umo_command.app import FIRST_LEVEL
    from umo_command.shared import options_of_command

    alone = typer.Typer(add_completion=False)
    alone.registered_commands = [FIRST_LEVEL["run"]]
    command = typer.main.get_command(alone)
    context = command.make_context("umo run", [station, *words])
    return context.params, context.args, options_of_command(context)


def _name(name: str, *, given: bool) -> str:
    name = name.removesuffix(".service")
    fitting = re.sub(r"[^A-Za-z0-9_.-]", "-", name)
    if given and fitting != name:
        raise OptionError(f"--name: {name!r} is not a name of a unit: letters, digits, _ . - only")
    return fitting


def _caller() -> str:
    """Return the user who calls this command, even if it is called by sudo."""
    return os.environ.get("SUDO_USER") or getpass.getuser()


def _next_steps(unit: ServiceUnit, output: Path | None) -> list[str]:
    file = f"{unit.name}.service"
    if not SYSTEMD.is_dir():
        line = f"cd {shlex.quote(unit.folder)} && {shlex.join(unit.command)}"
        without = "at all, because umo does not record how a run without hardware ended"
        never = "after status 2, 3 or 4" if unit.wired.hardware else without
        return [
            f"systemd does not run here; the command line for the foreground or another supervisor: {line}",
            f"a supervisor must not restart the station {never} (docs/howto-run-as-a-service.md)",
        ]
    own = " --user" if unit.user is None else ""
    folder, sudo = ("~/.config/systemd/user", "") if own else ("/etc/systemd/system", "sudo ")
    copy = f"save it as {file} (-o {file}), " if output is None else ""
    steps = [
        f"{copy}{sudo}cp {shlex.quote(file if output is None else str(output))} {folder}/{file}",
        f"{sudo}systemctl{own} daemon-reload",
        f"{sudo}systemctl{own} enable --now {file}",
    ]
    linger = "so that the unit starts at boot, and survives a logout: loginctl enable-linger"
    stays = (
        f"so that `umo show stations` finds the station also after a logout of {unit.user}: sudo loginctl "
        f"enable-linger {unit.user}"
    )
    return [
        f"next: {' && '.join(steps)}",
        f"then: systemctl{own} status {unit.name}; journalctl{own} -u {unit.name} -f; umo show stations",
        *([f"{linger}; for real-time priority: set LimitRTPRIO of user@.service"] if own else []),
        *([stays] if unit.user not in (None, "root") else []),
    ]


def _standing(plan: Plan) -> list[str]:
    """Return what must be acknowledged before the first start."""
    ended = [each.brief for device in plan.wired.devices for each in standing(device) if each.state == "stopped"]
    return (
        [f"acknowledge these devices before the first start: {some(ended)}; `umo do {plan.name} acknowledge`"]
        if ended
        else []
    )
