"""Outputs on parts of one register: a driver writes the whole register, so they must be of one driver."""

from __future__ import annotations

from typing import Any

import pytest

from umo import BinaryActuator, BinarySensor, Compound, DigitalSensor, check
from umo.states import OnOff


class Machine(Compound):
    a: BinaryActuator[OnOff]
    b: BinaryActuator[OnOff]
    seen: BinarySensor[OnOff]
    timer: DigitalSensor


def machine() -> Machine:
    def output() -> BinaryActuator[OnOff]:
        return BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)

    timer = DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False)
    return Machine(a=output(), b=output(), seen=BinarySensor(OnOff, one=OnOff.ON), timer=timer)


def mistakes(box: dict[str, Any], channels: tuple[str, str, str], **of_slow: Any) -> list[tuple[str, str]]:
    wiring = {
        "drivers": {"fast": box, "slow": box | of_slow, "clock": {"type": "timerfd"}},
        "wire": {
            "a": {"driver": "fast", "channel": channels[0]},
            "b": {"driver": "slow", "channel": channels[1]},
            "seen": {"driver": "slow", "channel": channels[2]},
            "timer": {"driver": "clock", "period": "10 ms"},
        },
    }
    return [(each.key, each.message) for each in check(machine(), wiring)]


BUS = {"type": "modbus", "host": "127.0.0.1"}
CHIP = {"type": "i2c", "bus": 1, "address": 0x20}


@pytest.mark.parametrize(
    ("box", "a", "b", "seen"), [(BUS, "holding:5.0", "holding:5.1", "holding:5.2"), (CHIP, "5:8.0", "5:8.1", "5:8.2")]
)
def test_outputs_on_one_register_are_of_one_driver(box: dict[str, Any], a: str, b: str, seen: str) -> None:
    why = "which writes the whole register for"
    assert mistakes(box, (a, b, seen)) == [
        ('wire."a".driver', f"channel {a!r} of fast is overwritten by slow, {why} b ({b!r}); wire both to one driver"),
        ('wire."b".driver', f"channel {b!r} of slow is overwritten by fast, {why} a ({a!r}); wire both to one driver"),
    ]


def test_a_driver_that_writes_its_bits_alone_does_not_overwrite() -> None:
    channels = "holding:5.0", "holding:5.1", "holding:5.2"
    assert mistakes(BUS | {"mask_write": True}, channels) == []
    (one,) = mistakes(BUS, channels, mask_write=True)
    assert one[0] == 'wire."b".driver'
    assert "is overwritten by fast" in one[1]


@pytest.mark.parametrize("other", ["holding:6.1", "holding:6", "coil:5"])
def test_other_registers_may_be_of_another_driver(other: str) -> None:
    assert mistakes(BUS, ("holding:5.0", other, "holding:5.2")) == []


def test_other_units_may_be_of_another_driver() -> None:
    assert mistakes(BUS, ("holding:5.0", "holding:5.1", "holding:5.2"), unit=2) == []
