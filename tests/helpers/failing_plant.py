"""A station whose reactors fail as often as its application lets them."""

from __future__ import annotations

from pathlib import Path

OBJECTS = '''
from umo import Compound, DigitalActuator, DigitalSensor, TaskFailed, action


class Reactor(Compound, equipment=True):
    heater: DigitalActuator

    async def stumble(self, why: str) -> None:
        raise TaskFailed(why)

    @action
    async def fail(self) -> None:
        """Come into fault."""
        self.cycle.start(self.stumble("a client has let it fail"))

    @action
    async def heat(self) -> None:
        """Heat."""
        self.heater.write(5.0)


class Plant(Compound):
    timer: DigitalSensor
    reactors: list[Reactor]


def machine() -> Plant:
    return Plant(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        reactors=[
            Reactor(heater=DigitalActuator("kW", default=0, minimum=0, maximum=10, resolution=0.01)) for _ in range(3)
        ],
    )
'''
APPLICATION = '''
from umo.control import wait


async def main(m, faults: int = 2, cleared: int = 1, rest: float = 1.0):
    """The first reactor fails so often, and is cleared so often; then they rest for so many s."""
    for number in range(faults):
        m.reactors[0].cycle.start(m.reactors[0].stumble(f"no feed {number}"))
        await wait("1 s")
        if number < cleared:
            m.reactors[0].cycle.clear()
    await wait(f"{rest} s")
'''
WIRING = """
[drivers.simulated]
type = "simulated"
[wire]
timer = { driver = "simulated", channel = "tick", period = "10 ms" }
"reactors.*.heater" = { driver = "simulated", channel = "heater:{}" }
"""


def plant(place: Path) -> Path:
    """The folder of the station."""
    folder = place / "plant"
    (folder / "wiring").mkdir(parents=True, exist_ok=True)
    (folder / "__init__.py").write_text("")
    (folder / "objects.py").write_text(OBJECTS)
    (folder / "application.py").write_text(APPLICATION)
    (folder / "wiring" / "simulated.toml").write_text(WIRING)
    return folder
