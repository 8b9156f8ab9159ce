"""One unit of a serial line (Modbus over Serial Line V1.02, RTU), for one driver."""

from __future__ import annotations

from time import monotonic, sleep

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU

from umo.drivers.modbus.answer import Recovering
from umo.drivers.modbus.serial_line import SerialLine, UnitFunction
from umo.drivers.streams import Gone, Lost, Serial
from umo.duration import duration

_LOOK_INTERVAL = 0.005
"""Time in s between two looks at a line while a unit recovers."""


class Rtu:
    """One unit of a serial line, for one driver. Every method except `close` may raise Lost."""

    def __init__(self, place: Serial, unit: int, recovery: float) -> None:
        self.framer = FramerRTU(DecodePDU(False))
        self._line = SerialLine.join(place)
        self._unit = unit
        self._recovery = recovery
        self._deadline = 0.0
        self._is_asked = False
        """True if a look has sent its request."""
        self._known_opening = 0.0
        """The time at which the line that was used last was opened."""

    def close(self) -> None:
        self._line.leave()

    def begin(self, deadline: float) -> bool:
        """Open the line if needed. All calls until the next `begin` end by this deadline. Return True if the line was
        opened again."""
        self._deadline, self._is_asked = deadline, False
        self._line.open(deadline)
        known, self._known_opening = self._known_opening, self._line.opened_at
        return known != self._line.opened_at

    def look(self, request: ModbusPDU, seconds: float) -> bool | None:
        """Return whether the unit answers this request, without waiting; None if this is not known yet.

        A line has one master, and one request at a time. On a line with other units, their requests would have to wait
        for the answer to this one. So on such a line True is returned, and a transfer is tried, which may take its
        timeout."""
        line = self._line
        if line.is_shared:
            return True
        line.open(0.0)
        line.discard()
        frame = self.framer.buildFrame(request)
        asked = frame[0], frame[1]
        if (owed := line.owed(asked)) is not None and monotonic() < owed.since + self._recovery:
            return None
        line.settle(asked)
        if self._is_asked:
            self._is_asked = False
            return owed is None
        if line.is_silent:
            line.ask(frame)
            self._is_asked = True
        return None

    def recover(self, deadline: float) -> None:
        """Wait until the recovery after opening the line is over, or until the deadline."""
        until = min(self._line.opened_at + self._recovery, deadline)
        while (left := until - monotonic()) > 0:
            sleep(min(left, _LOOK_INTERVAL))
            self._line.discard()

    def exchange(self, request: ModbusPDU) -> bytes:
        """Send the request. Return unit, function and data of its answer, which may be an exception answer."""
        frame = self.framer.buildFrame(request)
        self._recover((frame[0], frame[1]))
        return self._line.exchange(frame, self._deadline)

    def _recover(self, asked: UnitFunction) -> None:
        """Wait until no late answer is pending that could be mistaken for the answer to this request. Raises Recovering
        if this would take more than half of the remaining time."""
        line, latest = self._line, (monotonic() + self._deadline) / 2
        while (owed := line.owed(asked)) is not None:
            line.discard()
            left = owed.since + self._recovery - monotonic()
            if left <= 0:
                line.settle(asked)
            elif owed.since + self._recovery > latest and line.owed(asked) is not None:
                raise Recovering(f"a late answer may still come, for {duration(round(left, 3))}")
            else:
                sleep(min(left, _LOOK_INTERVAL))

    def failed(self, error: Lost) -> None:
        """Record a failure of the line or of the unit. The unit's answer may then still come."""
        if isinstance(error, Gone):
            self._line.close()
