"""The text of a systemd unit for `umo run` (systemd.service(5), systemd.exec(5), systemd.kill(5)).

The processes of a run reset the machine when one of them is killed, and need time for this. So the manager asks them to
stop by SIGTERM, even when its watchdog expires. It waits for as long as the limits of the wiring allow, and only then
kills the processes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from umo.cycle.segments import settling
from umo.errors import OptionError
from umo.exit_status import ExitStatus
from umo.process.frame_watcher import BLACK_BOX_TIMEOUT
from umo.process.hang_detection import REPORTING_LIMIT, STARTING_LIMIT, STARVED_LIMITS
from umo.process.keeper import LAST_TIMEOUT
from umo.process.reset import DEATH_TIMEOUT
from umo.wiring.process_table import longest_period
from umo.wiring.wired import Wired
from umo_command.run.faces_beside import END_TIMEOUT
from umo_command.run.process_beside import KILL_TIMEOUT

NO_RESTART = (ExitStatus.MISTAKE, ExitStatus.UNREACHED, ExitStatus.NOT_RECORDED)
"""Exit statuses after which a person is needed, so that the service is not restarted. After an end that must be
acknowledged, the next start ends with status 2."""
SUCCESS = (ExitStatus.TIME_OVER, 129, 130, 143)
"""Exit statuses, other than 0, of a run that was ended on purpose."""
RESTART_PAUSE = 10
"""Time in s from the end of a run to the start of the next one."""
MAX_STARTS, STARTS_WITHIN = 5, 600
"""Number of starts within this time in s after which the manager gives up."""
RECORD_TIME = 30.0
"""Time in s for writing the record of a run to a slow disk."""
IMPORT_TIME = 60.0
"""Time in s for the imports when a station starts."""
MIN_WATCHDOG = 10.0
WATCHDOG_LIMITS = 8
"""The time of systemd's watchdog, as a multiple of the control process's hang limit. When a heartbeat is passed on,
it may be as old as half of the watchdog's time. The guardian itself needs up to three hang limits to detect a hang."""
HARDENING = {
    "NoNewPrivileges": "yes",
    "ProtectSystem": "full",
    "ProtectKernelModules": "yes",
    "ProtectKernelLogs": "yes",
    "ProtectControlGroups": "yes",
    "RestrictNamespaces": "yes",
    "RestrictSUIDSGID": "yes",
    "LockPersonality": "yes",
}
"""Restrictions that still permit access to devices, real-time priority, and writing to /sys (iio, counter)."""
READ_ONLY = ("/usr", "/boot", "/efi", "/etc")
"""Places that ProtectSystem=full makes read-only."""


@dataclass(frozen=True)
class ServiceUnit:
    """The contents of the unit. `command`: the words of the command line. `folder`: the working directory."""

    name: str
    description: str
    command: Sequence[str]
    folder: str
    wired: Wired
    user: str | None = None
    """The user of the service; None for a unit of the user's systemd manager, where the service has this user's groups
    and limits."""
    groups: Sequence[str] = ()
    environment: Mapping[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """Return the file's content."""
        sections = {"Unit": self._unit(), "Service": self._service(), "Install": self._install()}
        return "\n".join(f"[{title}]\n" + "".join(f"{line}\n" for line in lines) for title, lines in sections.items())

    def _unit(self) -> list[str]:
        uses_network = any({"tcp", "udp"} & {*each.split()[:2]} for each in self.wired.devices)  # "modbus tcp host:502"
        network = ["Wants=network-online.target", "After=network-online.target"]
        return [
            f"Description={plain(self.description)}",
            *(network if uses_network and self.user is not None else []),
            f"StartLimitIntervalSec={STARTS_WITHIN}",
            f"StartLimitBurst={MAX_STARTS}",
        ]

    def _service(self) -> list[str]:
        return [
            "# The guardian, a child of umo run, reports to systemd that the machine runs.",
            "Type=notify",
            "NotifyAccess=all",
            f"WatchdogSec={watchdog(self.wired)}",
            f"ExecStart={' '.join(map(quoted, self.command))}",
            f"WorkingDirectory={plain(self.folder)}",
            *(f"Environment={quoted(f'{name}={value}', variables=False)}" for name, value in self.environment.items()),
            "SyslogIdentifier=" + plain(self.name),
            "UMask=0022",
            "",
            *self._restart(),
            f"SuccessExitStatus={' '.join(map(str, map(int, SUCCESS)))}",
            "",
            "# All processes are asked to stop. The time that they have is the sum of the time limits in the wiring.",
            "KillMode=control-group",
            "KillSignal=SIGTERM",
            "WatchdogSignal=SIGTERM",
            f"TimeoutStartSec={start_limit(self.wired)}",
            f"TimeoutStopSec={stop_limit(self.wired)}",
            f"TimeoutAbortSec={stop_limit(self.wired)}",
            "OOMPolicy=continue",
            *([] if self.user is None else self._of_system(self.user)),
        ]

    def _restart(self) -> list[str]:
        if not self.wired.hardware:
            return [
                "# No driver names a device, so umo does not record how a run ended: the unit is not restarted.",
                "Restart=no",
            ]
        return [
            f"# No restart after {', '.join(map(str, map(int, NO_RESTART)))}: a wrong option or wiring, a machine that "
            f"must be acknowledged, an actuator not at its default, no record.",
            "Restart=on-failure",
            f"RestartSec={RESTART_PAUSE}",
            f"RestartPreventExitStatus={' '.join(map(str, map(int, NO_RESTART)))}",
        ]

    def _of_system(self, user: str) -> list[str]:
        closed = any(self.folder == each or self.folder.startswith(f"{each}/") for each in READ_ONLY)
        hardening = {name: value for name, value in HARDENING.items() if not (closed and name == "ProtectSystem")}
        return [
            "",
            f"User={plain(user)}",
            *([f"SupplementaryGroups={' '.join(self.groups)}"] if self.groups else []),
            "LimitRTPRIO=99",
            "LimitMEMLOCK=infinity",
            "",
            "# umo records how runs ended in /var/tmp: a private /var/tmp would hide these records.",
            "PrivateTmp=no",
            *(f"{name}={value}" for name, value in hardening.items()),
        ]

    def _install(self) -> list[str]:
        return ["WantedBy=" + ("default.target" if self.user is None else "multi-user.target")]


def watchdog(wired: Wired) -> int:
    """Return the time in s without a heartbeat after which the manager asks the service to stop."""
    return math.ceil(max(MIN_WATCHDOG, WATCHDOG_LIMITS * wired.process.hang_timeout))


def start_limit(wired: Wired) -> int:
    """Return the longest time in s from the start to the first period."""
    return math.ceil(IMPORT_TIME + 2 * STARTING_LIMIT + 2 * longest_period(wired))


def stop_limit(wired: Wired) -> int:
    """Return the maximum time in s from the request to stop to the end of the last process. It allows for a stop during
    a step of connecting, a control process that hangs, a reset that is repeated for as long as the wiring permits, the
    writing of kept values and of the record, and the end of the faces."""
    process = wired.process
    until_dead = STARTING_LIMIT + 2 * longest_period(wired) + STARVED_LIMITS * process.hang_timeout + DEATH_TIMEOUT
    reset = 2 * process.reset_for + settling(wired) + DEATH_TIMEOUT + REPORTING_LIMIT
    faces = END_TIMEOUT + KILL_TIMEOUT if wired.faces else 0.0
    return math.ceil(until_dead + reset + BLACK_BOX_TIMEOUT + LAST_TIMEOUT + faces + RECORD_TIME)


def quoted(word: str, *, variables: bool = True) -> str:
    """Return a word quoted for systemd: `%` and, in a command line, `$` are doubled."""
    text = plain(word).replace("\\", "\\\\").replace('"', '\\"')
    if variables:
        text = text.replace("$", "$$")
    return text if re.fullmatch(r"[\w%$@+=:,./-]+", text, re.ASCII) else f'"{text}"'


def plain(text: str) -> str:
    """Return a value that systemd uses unchanged, with `%` doubled. Raises OptionError if a line cannot contain it."""
    if not text.isprintable() or text != text.strip() or text.endswith("\\"):
        raise OptionError(
            f"{text!r} cannot be written in a systemd unit: it must not contain a line break, begin or end with a "
            f"blank, or end with \\"
        )
    return text.replace("%", "%%")
