"""The devices of one run: held, and with a record on disk, from before they are driven to their safe end."""

from __future__ import annotations

from collections.abc import Iterable

from umo.system.device_lock import DeviceLock
from umo.system.device_record import INSPECT, DeviceRecord


class DeviceClaim:
    """Created before a driver is opened: raises DeviceHeld, or AcknowledgeRequired unless `acknowledge`. One of its
    methods ends it. If a process ends without that, its record shows an unsafe end.
    """

    def __init__(self, devices: Iterable[str], station: str, wiring: str = "", *, acknowledge: bool = False) -> None:
        self._devices = devices = tuple(devices)
        self.hold = DeviceLock(devices, f"{station}, {wiring}" if wiring else station)
        self._record = DeviceRecord(devices, station, wiring)
        try:
            self._record.begin(acknowledge)
        except BaseException:
            self.hold.release()
            raise

    def finish(self) -> None:
        """Every actuator is at its default, by the ordinary way."""
        self._record.finish()
        self.hold.release()

    def abandon(self) -> None:
        """The machine was not connected: an earlier unsafe end stays to be acknowledged."""
        self._record.abandon()
        self.hold.release()

    def stopped(self, what: str, unreached: list[str]) -> str:
        """The devices stand stopped until somebody acknowledges it. In words: what could not be written down, and what
        is to be done; empty where no device was driven."""
        if not self._devices:
            return ""
        try:
            self._record.stopped(what, unreached)
        except OSError as error:  # the record of the start stands all the same
            return f"this could not be recorded: {error.strerror or error}; {INSPECT}"
        finally:
            self.hold.release()
        return INSPECT
