"""A program moves the same raw integers alone, beside a device that does not answer, and with a client."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Annotated, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.letters import Letters
from helpers.machines import actuator, relay, sensor, timer
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, Number, action, connect
from umo.control import next_period, until, value_of, wait
from umo.errors import DeviceTimeout
from umo.objects import atoms
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer

PERIODS = 60


class Working(Compound):
    """A law and two sequences, by the seed."""

    motor: DigitalActuator
    heater: DigitalActuator
    valve: BinaryActuator[OnOff]
    level: DigitalSensor
    seed: int = 0

    def setup(self) -> None:
        self.random, self.limit = Random(self.seed), 0.0

    def control(self) -> None:
        self.motor.write(value_of(self.level) / 20 - 2.0)

    async def heat(self) -> None:
        while True:
            self.heater.write(self.random.uniform(0.0, 9.0))
            await wait(self.random.choice([0.01, 0.02, 0.05]))

    async def switch(self) -> None:
        while True:
            self.limit = self.random.uniform(10.0, 90.0)
            await until(lambda: value_of(self.level) > self.limit)
            self.valve.write(self.random.choice([OnOff.ON, OnOff.OFF]))
            await next_period()


class Beside(Compound, equipment=True):
    """On the device that may be dead."""

    motor: DigitalActuator
    valve: BinaryActuator[OnOff]
    level: DigitalSensor
    marked: DigitalSensor
    gain: Annotated[float, Number("V", 0.0, 5.0, tunable=True)] = 1.0

    def control(self) -> None:
        self.motor.write(self.gain + value_of(self.level) / 100)

    @action(harmless=True)
    def count(self) -> int:
        """Nothing."""
        return 1


class Machine(Compound):
    timer: DigitalSensor
    own: Sequence[Working]
    beside: Beside


class Timed(Scripted):
    """Fails by a timeout while `dead`."""

    def __init__(self, dead: Sequence[range]) -> None:
        super().__init__()
        self.dead, self.period_number = dead, 0

    def _call(self, *arguments: Any, **more: Any) -> Any:
        answer = super()._call(*arguments, **more)
        if any(self.period_number in span for span in self.dead):
            raise DeviceTimeout("timed out")
        return answer


def trace(seeds: list[int], levels: int, dead: Sequence[range], commands: list[tuple[str, int]] | None) -> list[Any]:
    """The raw integers of the working parts after each period."""
    own = [
        Working(motor=actuator(), heater=actuator(), valve=relay(synchronous=seed % 2 > 0), level=sensor(), seed=seed)
        for seed in seeds
    ]
    beside = Beside(motor=actuator(), valve=relay(synchronous=False), level=sensor(), marked=sensor(on_error="mark"))
    m = Machine(timer=timer(), own=own, beside=beside)
    box, other = Scripted(), Timed(dead)
    random = Random(levels)
    for each in own:
        box.set(each.level.path, [random.randrange(200) for _ in range(PERIODS + 1)])
    wire: dict[str, Any] = {
        item.path: {"driver": "other" if item.path.startswith("beside") else "box"} for item in atoms(m)
    }
    wire["timer"] = {"driver": "clock", "period": "10 ms"}
    found = []
    letters = Letters()
    connection = connect(m, {"drivers": {"box": box, "other": other, "clock": VirtualTimer()}, "wire": wire})
    with connection as m:
        machine = connection.machine
        if commands is not None:
            machine.attach(ClientControl(letters, letters, Mode.AUTOMATIC, lambda: 1.0))
            letters.waiting.append(ClientCommand(0, "ann", "key", "lease"))
        for each in own:
            m.cycle.start(each.heat())
            m.cycle.start(each.switch())
        for number in range(PERIODS):
            other.period_number = number
            for do, when in commands or ():
                if when == number:
                    letters.waiting.append(asked(number + 1, do))
            m.timer.read()
            m.sample()
            m.control()
            m.update()
            found.append([box.get(item.path) for each in own for item in (each.motor, each.heater, each.valve)])
        other.dead = ()
    return found


def asked(number: int, do: str) -> ClientCommand:
    more: dict[str, Any] = {"tune": {"path": "beside.gain", "value": number % 5}, "call": {"path": "beside.count"}}.get(
        do, {}
    )
    return ClientCommand(number, "ann", "key", do, **more)


SPANS = st.builds(range, st.integers(1, PERIODS - 10), st.integers(5, PERIODS))
COMMANDS = st.lists(
    st.tuples(st.sampled_from(["tune", "call", "clear", "acknowledge", "cancel"]), st.integers(1, PERIODS))
)


@pytest.mark.full
@given(
    st.lists(st.integers(0, 1000), min_size=1, max_size=3), st.integers(0, 1000), st.lists(SPANS, max_size=2), COMMANDS
)
@settings(max_examples=40)
def test_the_raw_integers_of_a_program_do_not_depend_on_what_is_beside_it(
    seeds: list[int], levels: int, dead: list[range], commands: list[tuple[str, int]]
) -> None:
    alone = trace(seeds, levels, (), None)
    assert len({str(row) for row in alone}) > 5  # it does something
    assert trace(seeds, levels, dead, None) == alone
    assert trace(seeds, levels, dead, commands) == alone
