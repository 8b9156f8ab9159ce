"""What befalls the fleet of the bench, one thing after the other, at random moments of one seed."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from bench.fleet.history import Disk
from bench.fleet.parts import Part
from bench.fleet.plant import PUBLISHES, ROUTERS, ROUTES, FleetPlant

SHORTEST, LONGEST = 0.5, 6.0
"""Time in s that something stays away, at random."""


@dataclass
class Strike:
    """`sites`: those whose stations are away meanwhile. Times: s of the monotonic clock."""

    kind: str
    sites: list[str] = field(default_factory=list)
    struck: float = 0.0
    over: float = 0.0
    """When what was struck was back."""
    made_only: bool = False
    """Whether the real station of the site went on."""
    real_only: bool = False


class Striker:
    """`others`: processes that only follow, by name: recorder, checker."""

    def __init__(self, plant: FleetPlant, others: dict[str, Part], disk: Disk, seed: int) -> None:
        self._plant, self._others, self._disk = plant, others, disk
        self._chance = random.Random(seed)
        self.done: list[Strike] = []

    @property
    def kinds(self) -> dict[str, Callable[[], Strike]]:
        return {
            "router killed": self._router,
            "gateway killed": self._gateway,
            "recorder killed": self._recorder,
            "stations killed": self._stations,
            "cable pulled": self._cable,
            "clocks stepped": self._clocks,
            "subscriber stopped": self._subscriber,
            "disk full": self._full,
            "gateway with commands killed": self._own_gateway,
        }

    def order(self, times: int) -> list[Callable[[], Strike]]:
        """Each kind so many times, mixed."""
        order = [kind for kind in self.kinds.values() for _ in range(times)]
        self._chance.shuffle(order)
        return order

    def pause(self, shortest: float = SHORTEST, longest: float = LONGEST) -> None:
        until = time.monotonic() + self._chance.uniform(shortest, longest)
        while time.monotonic() < until:
            self._plant.look()
            time.sleep(0.05)

    # Each ------------------------------------------------------------------------------------------------

    def _kill(self, part: Part, strike: Strike, is_back: Callable[[], bool]) -> Strike:
        self._plant.look()
        strike.struck = time.monotonic()
        part.kill()
        self.pause()
        part.start()
        self._plant.wait(is_back, f"{part.name} is back")
        strike.over = time.monotonic()
        return strike

    def _router(self) -> Strike:
        number = self._chance.randrange(ROUTERS)
        sites = [site for place, site in enumerate(self._plant.sites) if number in (place % ROUTERS, 1)]
        if number == 0:  # who looks is connected to it
            sites = self._plant.sites
        part = self._plant.routers[number]
        return self._kill(part, Strike("router killed", sites), self._saying(part, ROUTES))

    def _gateway(self) -> Strike:
        number = self._chance.randrange(self._plant.computers)
        part = self._plant.gateways[number]
        return self._kill(part, Strike("gateway killed", [self._plant.sites[number]]), self._saying(part, PUBLISHES))

    def _own_gateway(self) -> Strike:
        part = self._plant.own_gateway
        return self._kill(part, Strike("gateway with commands killed"), self._saying(part, PUBLISHES))

    def _recorder(self) -> Strike:
        part = self._others["recorder"]
        return self._kill(part, Strike("recorder killed"), lambda: part.is_running)

    def _stations(self) -> Strike:
        plant = self._plant
        places = [*range(plant.computers)] + [-1 - number for number in range(len(plant.stations))]
        place = self._chance.choice(places)
        site, is_real = plant.sites[place if place >= 0 else -1 - place], place < 0
        part = plant.stations[-1 - place] if is_real else plant.rings[place]
        before = set(plant.truths)
        count = 1 if is_real else plant.made[place]

        def is_back() -> bool:
            return len(set(plant.truths) - before) >= count

        strike = Strike("stations killed", [site], made_only=not is_real, real_only=is_real)
        return self._kill(part, strike, is_back)

    def _cable(self) -> Strike:
        number = self._chance.randrange(self._plant.computers)
        strike = Strike("cable pulled", [self._plant.sites[number]], time.monotonic())
        self._plant.network.unplug(number)
        try:
            self.pause(SHORTEST, 2 * LONGEST)
        finally:
            self._plant.network.plug(number)
        strike.over = time.monotonic()
        return strike

    def _clocks(self) -> Strike:
        part = self._chance.choice(self._plant.rings)
        strike = Strike("clocks stepped", struck=time.monotonic())
        numbers = [signal.SIGUSR1, signal.SIGUSR2]
        self._chance.shuffle(numbers)
        for number in numbers:
            part.signal(number)
            self.pause()
        strike.over = time.monotonic()
        return strike

    def _subscriber(self) -> Strike:
        part = self._others["checker"]
        strike = Strike("subscriber stopped", struck=time.monotonic())
        part.signal(signal.SIGSTOP)
        self.pause(SHORTEST, 2 * LONGEST)
        part.signal(signal.SIGCONT)
        strike.over = time.monotonic()
        return strike

    def _full(self) -> Strike:
        strike = Strike("disk full", struck=time.monotonic())
        self._disk.fill()
        self.pause(SHORTEST, 2 * LONGEST)
        self._disk.empty()
        strike.over = time.monotonic()
        return strike

    @staticmethod
    def _saying(part: Part, words: str) -> Callable[[], bool]:
        """Whether it says this from now on."""
        at = len(part.said)
        return lambda: words in part.said[at:]
