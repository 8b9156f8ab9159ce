"""`umo do STATION stop`: stops a run and reports whether its actuators are at their defaults."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from typing import Any

from umo.clients.remote import RemoteStation
from umo.exit_status import ExitStatus
from umo.system.device_lock import is_held
from umo.system.device_record import INSPECT, Ended, left_by
from umo.system.processes import user_name
from umo.system.streams import limit_waits
from umo.text import printable, reason_of, some
from umo_command.console import err, out, say
from umo_command.show.stations import attach, how_ended

PAUSE = 0.05
"""Time in s between two looks at a run that is stopping."""
PATIENCE = 0.5
"""Time in s after the end of the control process from which on a notice says that the devices are still in use."""


def stop(name: str) -> int:
    """Stop a run, wait until its processes have released their devices of this computer, and print how the run ended.
    Return the exit status: `UNREACHED` if an actuator may not be at its default."""
    limit_waits()
    with RemoteStation(attach(name)) as station:
        about = station.reader.about
        title = printable(str(about["station"]))
        station.stop(f"{user_name()}, umo do {title} stop (pid {os.getpid()})")
        while station.running:
            time.sleep(PAUSE)
        try:
            unsafe = _unsafe_ends(about, title)
        except OSError as error:
            say(f"{title}: it is not known whether its actuators are at their defaults: {reason_of(error)}")
            return ExitStatus.UNREACHED
        out.print(how_ended(station.reader), soft_wrap=True)
    for ended in unsafe:
        err.print(f"{ended.brief}; {INSPECT}", style="red", soft_wrap=True, markup=False)
    reached = all(ended.state == "stopped" and not ended.unreached for ended in unsafe)
    return ExitStatus.DONE if reached else ExitStatus.UNREACHED


def _unsafe_ends(about: Mapping[str, Any], title: str) -> list[Ended]:
    """Wait until a run, whose control process has ended, has recorded its end or has released its devices. Return the
    records of an unsafe end. Raises OSError if the records cannot be read."""
    since, is_told = time.monotonic(), False
    while True:
        left = left_by(about)
        held = [ended.device for ended in left if ended.state == "running" and is_held(ended.device)]
        if not held:
            return left
        if not is_told and time.monotonic() - since > PATIENCE:
            say(f"{title}: its devices are still in use: {some(held)}; this command waits until they are released")
            is_told = True
        time.sleep(PAUSE)
