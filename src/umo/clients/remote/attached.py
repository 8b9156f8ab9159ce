"""A running station as seen from another program: its values, actions and tunable numbers."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.clients.remote.commander import Commander
from umo.clients.remote.live_view import LiveView
from umo.clients.remote.remote_objects import NoMember, RemotePart, Tree
from umo.cycle.events import Event
from umo.cycle.stage import Progress
from umo.operation.commands.verb_table import VerbTable
from umo.operation.commands.verbs import (
    ACKNOWLEDGE,
    ACKNOWLEDGE_ALARM,
    CLEAR,
    MODE,
    REMOVE_FROM_SERVICE,
    RESET_ALARM,
    RETURN_TO_SERVICE,
    SHELVE,
    UNSHELVE,
    VERBS,
    verb_of,
)
from umo.process.frames import Reader
from umo.process.frames.alarm_list import AlarmRow
from umo.process.frames.run_reader import progress_of
from umo.process.frames.search import find_running
from umo.recording.scope.history import samples
from umo.recording.scope.svg import Scope


def attach(station: str | int | None = None) -> RemoteStation:
    """Return a station that runs in real time on this computer, by name or pid; default: the only one.

        station = umo.attach("ztheta")
        station.z.encoder.read()
        with station.lease("commissioning"):
            station.mode = "manual"
            station.z.move_to(100_000)
            station.z.servo.gain = 0.004

    Raises FramesError, which lists the running stations, if no such station runs, or if no name is given and several
    run. Reading does not disturb the station. Commands need the lease, and pass the same guards as the commands of the
    program.
    """
    return RemoteStation(find_running(None if station is None else str(station)))


class RemoteStation(Commander, RemotePart):
    """A running station. Its objects, compounds, actions and tunable numbers are attributes, with the names in its
    declaration. If one has the name of a member of this class, use its path: `station["stop"]`."""

    def __init__(self, reader: Reader) -> None:
        vars(self).update(vars(Commander(reader)))  # past `__setattr__`, which tunes a number
        RemotePart.__init__(self, self, Tree(reader), "")

    @property
    def mode(self) -> str:
        """The mode: "automatic" or "manual"; "" if the station takes no commands. Setting it needs the lease."""
        return "" if (mode := self.reader.now().mode) is None else str(mode)

    @mode.setter
    def mode(self, mode: str) -> None:
        self.carry_out(MODE, "", {"mode": str(mode)})

    @property
    def progress(self) -> Progress:
        """The last progress that the machine has reported for its work."""
        return progress_of(self.reader.latest())

    @property
    def events(self) -> list[Event]:
        """The last events, oldest first: commands with their answers, and interventions of guards."""
        return [each.event for each in self.reader.events()]

    @property
    def tuned(self) -> dict[str, float]:
        """The tunable numbers that differ from their values at the start of the run, by path, in their units. Numbers
        that are kept (`reader.kept`) are the same in the next run. For the others, add a line under `[parameters]` of
        the wiring."""
        return self.reader.tuned()

    def frames(self, seconds: float) -> dict[str, npt.NDArray[np.float64]]:
        """Return the last frames in memory as arrays: "time" in s, objects and signals by path. A value of quality BAD
        is NaN."""
        reader = self.reader
        period = reader.about["period"] or 0.01
        rows = reader.last(max(1, round(seconds / period)))
        columns = zip([*reader.paths, *reader.signals], samples(rows).T, strict=True)
        return {"time": np.array(rows["time"])} | {path: column.copy() for path, column in columns}

    # In a notebook -------------------------------------------------------------------------------------

    def live(self, *paths: str) -> LiveView:
        """Show a table of the values here in the notebook, and keep the table up to date. `paths`: the paths of
        objects, compounds or signals, or patterns such as "zones.*.heater"; default: all.

        The updates end with the station, with a call of `stop()` of the result, or with this program. Raises PathError
        for an unknown path, and FramesError outside of a notebook or if the station has ended.
        """
        return LiveView(self.reader, lambda own: partial(own.html, paths))

    def scope(self, *paths: str, seconds: float = 10.0) -> LiveView:
        """Show objects and signals against time here in the notebook, as they change. `seconds` is the span, up to 300.

        Numbers of one unit share a lane; binary objects are bars. No peak is lost, because the smallest and the largest
        value are drawn for each pixel. At most 16 traces are possible. The updates end as with `live`, which also has
        the same errors. Raises RangeError for a `seconds` out of range.
        """
        return LiveView(self.reader, lambda own: Scope(own, paths, seconds).draw)

    def acknowledge(self, path: str = "") -> bool:
        """Acknowledge latched interlocks of an object or compound, or, with "", of the machine, so that the actuators
        they inhibit can be written again. Returns False if none was latched. Raises CommandRefused while the condition
        of one of these interlocks still holds. Needs the lease; possible in any mode."""
        return self.carry_out(ACKNOWLEDGE, path) is None

    @property
    def faults(self) -> dict[str, str]:
        """The reason for each equipment in fault, by path."""
        return self.reader.faults(self.reader.latest())

    def clear(self, path: str = "") -> str:
        """End the fault of the equipment that contains an object or compound, or, with "", of all equipment. Returns a
        text such as "cleared: reactors.1" or "nothing was in fault", followed by the interlocks that still inhibit
        actuators. Raises EquipmentFault while a sensor of the equipment cannot be read, and TaskFailed if an object
        cannot be initialised. The equipment then stays in fault. Needs the lease; possible in any mode."""
        return str(self.carry_out(CLEAR, path))

    @property
    def alarms(self) -> list[AlarmRow]:
        """The alarms that are not normal: unacknowledged ones first, then by priority."""
        return self.reader.alarms(self.reader.latest())

    @property
    def raised_alarms(self) -> list[AlarmRow]:
        """The alarms in `alarms`, followed by the alarms that are normal and were raised in this run. Each has the
        number of times that it was raised, and the first and last time."""
        return self.reader.alarms(self.reader.latest(), raised=True)

    def acknowledge_alarm(self, path: str = "") -> str:
        """Acknowledge an alarm, the alarms of an object or compound, those that match a pattern, or, with "", all
        alarms. Returns a text such as "acknowledged: tank.overfill". Raises CommandRefused if a single alarm needs no
        acknowledgement, and PathError if there is no such alarm. This and the following methods need the lease, and are
        possible in any mode."""
        return str(self.carry_out(ACKNOWLEDGE_ALARM, path))

    def reset_alarm(self, path: str = "") -> str:
        """Reset latched alarms that are acknowledged and no longer active."""
        return str(self.carry_out(RESET_ALARM, path))

    def shelve(self, path: str, time: str | float) -> str:
        """Shelve alarms. `time` is a number of s, or a text such as "10 min"; at most 7 days. Raises RangeError for any
        other time."""
        return str(self.carry_out(SHELVE, path, {"time": time}))

    def unshelve(self, path: str) -> str:
        """Show shelved alarms again, before their time is over."""
        return str(self.carry_out(UNSHELVE, path))

    def remove_from_service(self, path: str) -> str:
        """Remove alarms from service for maintenance, also in later runs, until they are returned to service."""
        return str(self.carry_out(REMOVE_FROM_SERVICE, path))

    def return_to_service(self, path: str) -> str:
        """Return alarms to service that were removed from it."""
        return str(self.carry_out(RETURN_TO_SERVICE, path))

    @property
    def verbs(self) -> VerbTable:
        """All verbs of the station, with their effects and the required roles. A notebook shows it as a table."""
        return VerbTable(VERBS)

    def __getattr__(self, name: str) -> Any:
        """Return a member of the machine, or a verb without a method here, as a function of its path and arguments."""
        try:
            return super().__getattr__(name)
        except NoMember:
            if (verb := verb_of(name)) is None:
                raise
            return partial(self.do, verb.name)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(verb.word for verb in VERBS.values())]

    def __setattr__(self, name: str, value: Any) -> None:
        if name in vars(self) or isinstance(getattr(RemoteStation, name, None), property):
            object.__setattr__(self, name, value)
        else:
            super().__setattr__(name, value)

    def __enter__(self) -> RemoteStation:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        about, reader = self.reader.about, self.reader
        now = "detached" if reader.closed else f"{reader.state}, {self.mode or 'no commands'}"
        return f"<{about['station']}, pid {about['pid']}, {now}>"
