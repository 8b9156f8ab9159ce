"""Which writes may be left out, as the device has confirmed the same cells a short time ago: no device, no clock."""

from __future__ import annotations

from umo.drivers.modbus.plan import Request

_MAX_REQUESTS = 256
"""Requests that are remembered."""


class WriteCache:
    """Cells that the device has confirmed, by request. `keep`: time in s after which a write is repeated."""

    def __init__(self, keep: float) -> None:
        self._keep = keep
        self._confirmed: dict[tuple[str, int, int], tuple[list[int], float]] = {}

    def covers(self, request: Request, cells: list[int], now: float) -> bool:
        """Whether these very cells were confirmed less than `keep` s ago, and nothing was written on them since."""
        cells_then, then = self._confirmed.get(_key(request), ((), 0.0))
        return cells_then == cells and now - then < self._keep

    def begins(self, request: Request) -> None:
        """The request is about to be written: until it is confirmed, nothing is known of its cells."""
        end = request.address + request.count
        for key in [key for key in self._confirmed if key[0] == request.table.name]:
            if key[1] < end and request.address < key[1] + key[2]:
                del self._confirmed[key]

    def confirmed(self, request: Request, cells: list[int], now: float) -> None:
        """`now`: when the request began."""
        if len(self._confirmed) >= _MAX_REQUESTS:
            self._confirmed.clear()
        self._confirmed[_key(request)] = cells, now

    def forget(self) -> None:
        """Nothing is known."""
        self._confirmed.clear()


def _key(request: Request) -> tuple[str, int, int]:
    return request.table.name, request.address, request.count
