"""Helpers for users' tests: a scripted circuit, virtual time, a function that runs the loop, and the conformance kit
for drivers. The kit for faces is in `umo.clients.faces.conformance`.

    def test_the_valve_closes_when_the_pressure_is_high():
        box = Scripted()
        wiring = {
            "drivers": {"box": box, "clock": VirtualTimer()},
            "wire": {
                "timer": {"driver": "clock", "period": "1 ms"},
                "pressure": {"driver": "box"},
                "valve": {"driver": "box"},
            },
        }
        with connect(press(), wiring) as m:
            put(m.pressure, 6.5)
            periods(m, 2)
            assert m.valve.read() is OpenClosed.CLOSED

In a wiring given as a dict, a driver object may stand in place of its table, or be the `type` in a table that has a
`timeout` or `watchdog`. Tests do not sleep, because the timer is a wired device.
"""

from umo.testing.own_station import station
from umo.testing.periods import periods, put
from umo.testing.replays import assert_no_error, assert_replays
from umo.testing.scripted import Call, Scripted
from umo.testing.virtual import VirtualTimer

__all__ = ["Call", "Scripted", "VirtualTimer", "assert_no_error", "assert_replays", "periods", "put", "station"]
