"""Fields of one wide value at a plant's box: the registers are written one by one, as the Modbus driver does."""

from __future__ import annotations

from typing import Any, cast

from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.plant.box import Box
from umo.plant.register_map import register_maps
from umo.plant.simulation import Simulation
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer
from umo.wiring import resolve


class Machine(Compound):
    count: DigitalActuator
    bit: BinaryActuator[OnOff]
    whole: DigitalActuator
    timer: DigitalSensor


class Plant:
    """What the box writes, by slot."""

    def __init__(self) -> None:
        self.levels: dict[int, int] = {}

    def write(self, slot: int, level: int) -> None:
        self.levels[slot] = level

    def clock(self) -> float:
        return 0.0

    def catch_up(self) -> None: ...


def machine() -> Machine:
    return Machine(
        count=DigitalActuator("count", default=0, minimum=0, maximum=255, resolution=1),
        bit=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        whole=DigitalActuator("count", default=0, minimum=0, maximum=255, resolution=1),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )


def opened_box() -> tuple[Box, Plant]:
    plant_wiring = {
        "drivers": {"box": Scripted({}), "clock": VirtualTimer()},
        "wire": {path: {"driver": "box"} for path in ("count", "bit", "whole")}
        | {"timer": {"driver": "clock", "period": "10 ms"}},
    }
    channels = {"count": "holding:4:uint32.19:12", "bit": "holding:4:uint32.3", "whole": "holding:8:uint32"}
    bus_wiring: dict[str, Any] = {
        "drivers": {"io": {"type": "modbus"}},
        "wire": {path: {"driver": "io", "channel": channel} for path, channel in channels.items()}
        | {"timer": {"driver": "timerfd", "period": "50 ms"}},
    }
    (registers,) = register_maps(resolve(machine(), plant_wiring), resolve(machine(), bus_wiring))
    plant = Plant()
    return Box(cast(Simulation, plant), registers), plant


def asked(box: Box, function: int, *words: int) -> bytes:
    return box.request(bytes([function]) + b"".join(word.to_bytes(2, "big") for word in words))


def test_one_register_of_a_field_in_two_is_written_alone() -> None:
    box, plant = opened_box()
    assert asked(box, 6, 4, 0x000A)[0] == 6
    assert asked(box, 6, 5, 0x5008)[0] == 6
    assert sorted(plant.levels.values()) == [1, 0xA5]
    assert asked(box, 22, 5, 0x0FFF, 0x3000)[0] == 22
    assert sorted(plant.levels.values()) == [1, 0xA3]
    assert asked(box, 3, 4, 2) == bytes([3, 4, 0x00, 0x0A, 0x30, 0x08])


def test_half_of_a_whole_value_is_refused() -> None:
    box, plant = opened_box()
    assert asked(box, 6, 9, 1) == bytes([0x86, 2])
    assert plant.levels == {}
