"""A real station of the bench: `python -m bench.fleet.station FILE`. Each command that it carries out is a line of the
file."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

import umo
from bench.face_process import Many
from bench.fleet.rings import OBJECTS
from umo import DigitalSensor, Range, action
from umo.control import next_period

PERIOD = "10 ms"
CARRIED_OUT = "UMO_BENCH_CARRIED_OUT"
"""The environment variable that names the file."""
LARGEST = 1e9


class Plant(Many):
    """Half of its values are others in each period."""

    @action(harmless=True, number=Range("", 0.0, LARGEST))
    def note(self, number: float) -> float:
        """Note the number of a command."""
        file = os.open(os.environ[CARRIED_OUT], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        os.write(file, b"%d\n" % number)
        os.close(file)
        return number


def machine() -> Plant:
    return Plant(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.0, resolution=1.0, synchronous=False),
        zones=[DigitalSensor("degC", minimum=0.0, maximum=1000.0, resolution=1.0) for _ in range(OBJECTS - 1)],
    )


async def application(m: Plant) -> None:
    while True:
        await next_period()


def main(file: Path) -> None:
    """Run it until SIGTERM, or until it has ended."""
    os.environ[CARRIED_OUT] = str(file)
    told = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: told.set())
    wire = {"timer": {"driver": "timerfd", "period": PERIOD}, "zones.*": {"driver": "box"}}
    wiring = {"drivers": {"box": {"type": "bench.face_process:Half"}}, "wire": wire}
    with umo.start(machine, wiring, application, acknowledge=True) as started:
        while not told.wait(0.2) and started.outcome is None:
            started.poll()


if __name__ == "__main__":
    from bench.fleet import station  # not __main__: another process imports the machine

    station.main(Path(sys.argv[1]))
