"""An operator beside an operated machine: `python client.py`. It waits for the only run of the folder `UMO_FRAMES`.
Then it gives commands at random, through the queue of all clients, until it is killed or the run has ended."""

from __future__ import annotations

from random import Random
from time import sleep

import umo
from umo.clients.remote.attached import RemoteStation
from umo.errors import FramesError, UmoError

PAUSE = 0.02
"""s between two commands."""
UNITS = ("filler.unit", "brewer.unit")


def main() -> None:
    chance = Random()
    while True:
        try:
            station = umo.attach()
        except FramesError:
            sleep(PAUSE)
            continue
        with station, station.lease("operator"):
            while station.running:
                try:
                    one_command(station, chance)
                except UmoError:  # refused, or the machine has just ended
                    sleep(PAUSE)
        return


def one_command(station: RemoteStation, chance: Random) -> None:
    """Any command for alarms, units or a tunable number."""
    alarms = [row.path for row in station.alarms] or [""]
    unit = station[chance.choice(UNITS)]
    commands = (
        lambda: station.acknowledge_alarm(chance.choice(alarms)),
        lambda: station.reset_alarm(chance.choice(alarms)),
        lambda: station.shelve(chance.choice(alarms), chance.uniform(0.05, 0.5)),
        lambda: station.unshelve(chance.choice(alarms)),
        lambda: setattr(station, "target", chance.uniform(-1e6, 1e6)),
        lambda: getattr(unit, chance.choice(("start", "reset", "hold", "clear", "stop", "abort")))(),
    )
    chance.choice(commands)()


if __name__ == "__main__":
    main()
