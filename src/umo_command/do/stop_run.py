"""`umo do STATION stop`: stops a run and reports whether its actuators are at their defaults."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Sequence
from itertools import chain

from umo.clients.remote import RemoteStation
from umo.exit_status import ExitStatus
from umo.system.device_lock import is_held
from umo.system.device_record import INSPECT, Ended, standing
from umo.system.processes import user_name
from umo.system.streams import limit_waits
from umo.text import printable, some
from umo_command.console import err, out, say
from umo_command.show.stations import attach, how_ended

PAUSE = 0.05
"""Time in s between two looks at a run that is stopping."""
PATIENCE = 0.5
"""Time in s after the end of the control process from which on a notice says that the devices are still in use."""


def stop(name: str) -> int:
    """Stop a run, wait until its processes have released its devices, and print how it ended. Return the exit status:
    `UNREACHED` if an actuator may not be at its default."""
    limit_waits()
    with RemoteStation(attach(name)) as station:
        about = station.reader.about
        title, devices = printable(str(about["station"])), [str(each) for each in about["devices"]]
        began = {ended.began for ended in _records(devices, title)}
        station.stop(f"{user_name()}, umo do {title} stop (pid {os.getpid()})")
        while station.running:
            time.sleep(PAUSE)
        _await_release(title, devices, began)
        out.print(how_ended(station.reader), soft_wrap=True)
        unsafe = [ended for ended in _records(devices, title) if ended.began in began]
    for ended in unsafe:
        err.print(f"{ended.brief}; {INSPECT}", style="red", soft_wrap=True, markup=False)
    reached = all(ended.state == "stopped" and not ended.unreached for ended in unsafe)
    return ExitStatus.DONE if reached else ExitStatus.UNREACHED


def _records(devices: Sequence[str], station: str) -> list[Ended]:
    """Return the records of a station on its devices: of a run that has them, or that ended unsafely."""
    found = chain.from_iterable(standing(device) for device in devices)
    return [ended for ended in found if printable(ended.station) == station]


def _await_release(station: str, devices: Sequence[str], began: Collection[float]) -> None:
    """Wait until a run, whose control process has ended, has recorded its end or has released its devices. `began`: the
    times in its records at which it took the devices."""

    def held_devices() -> list[str]:
        records = (each for each in _records(devices, station) if each.state == "running" and each.began in began)
        return [each.device for each in records if is_held(each.device)]

    since, is_told = time.monotonic(), False
    while held := held_devices():
        if not is_told and time.monotonic() - since > PATIENCE:
            say(f"{station}: not all actuators are at their defaults yet; umo tries again to reach {some(held)}")
            is_told = True
        time.sleep(PAUSE)
