"""The driver boundary: the paper's five code segments, in integers."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field

import numpy as np
import pytest

from umo.drivers import Channel, Direction, Driver
from umo.drivers.simulated import Simulated
from umo.testing import Scripted


class Least(Driver):
    """What a driver must have and no more."""

    def __init__(self):
        self.written = []

    def channel(self, text):
        return Channel(text, Direction.BOTH, 8)

    def read(self, channel):
        return int(channel.text)

    def write(self, channel, raw):
        self.written.append((channel.text, raw))


CHANNELS = [Channel(str(i), Direction.BOTH, 8) for i in range(3)]


def test_a_driver_needs_channel_and_what_its_directions_need():
    assert Driver.__abstractmethods__ == {"channel"}
    with pytest.raises(TypeError):
        Driver()


def test_the_contract_is_the_five_segments_and_what_is_derived_from_them():
    public = [name for name, item in vars(Driver).items() if inspect.isfunction(item) and not name.startswith("_")]
    assert public == ["channel", "initialize", "finalize", "reset", "read", "write", "devices",
                      "physical_scale", "read_many", "write_many", "open", "close", "ages", "look", "stop_waiting",
                      "watchdog", "check_watchdog", "inspect", "report"]  # fmt: skip


def test_an_output_is_initialised_and_reset_by_writing_its_default_alone():
    driver = Least()
    driver.initialize(CHANNELS[1], 5)
    driver.reset(CHANNELS[1], 6)
    assert driver.written == [("1", 5), ("1", 6)]


def test_a_sensor_is_initialised_and_reset_without_a_write():
    driver = Least()
    driver.initialize(CHANNELS[1], None)
    driver.reset(CHANNELS[1], None)
    driver.finalize(CHANNELS[1])
    driver.open()
    driver.close()
    assert driver.written == []


def test_read_many_fills_the_buffer_in_place_from_read():
    out = np.full(3, -1, np.int64)
    Least().read_many(CHANNELS, out)
    assert out.tolist() == [0, 1, 2]


def test_write_many_hands_plain_integers_to_write_in_order():
    driver = Least()
    driver.write_many(CHANNELS, np.array([7, 8, 9]))
    assert driver.written == [("0", 7), ("1", 8), ("2", 9)]
    assert all(type(raw) is int for _, raw in driver.written)


def test_a_buffer_of_another_length_is_an_error_not_a_silent_half():
    with pytest.raises(ValueError):
        Least().write_many(CHANNELS, np.array([7, 8]))


def test_a_reading_that_is_no_integer_is_not_truncated():
    driver = Scripted({"0": 2.5})
    with pytest.raises(TypeError):
        Driver.read_many(driver, CHANNELS[:1], np.zeros(1, np.int64))


def test_a_direction_without_its_function_says_so():
    class Nothing(Driver):
        def channel(self, text):
            return Channel(text, Direction.BOTH, 1)

    with pytest.raises(NotImplementedError, match="Nothing has no inputs"):
        Nothing().read(CHANNELS[0])
    with pytest.raises(NotImplementedError, match="Nothing has no outputs"):
        Nothing().write(CHANNELS[0], 1)
    with pytest.raises(NotImplementedError, match="Nothing has no watchdog"):
        Nothing().watchdog(1.0)


@pytest.mark.parametrize(
    ("bits", "signed", "lowest", "highest"),
    [
        (1, False, 0, 1),
        (8, False, 0, 255),
        (8, True, -128, 127),
        (16, True, -32768, 32767),
        (64, True, -(2**63), 2**63 - 1),
    ],
)
def test_a_channel_knows_what_its_bits_hold(bits, signed, lowest, highest):
    channel = Channel("x", Direction.BOTH, bits, signed)
    assert (channel.lowest, channel.highest) == (lowest, highest)


def test_a_channel_is_frozen_and_takes_up_its_text():
    channel = Channel("holding:0", Direction.OUTPUT, 16)
    with pytest.raises(AttributeError):
        channel.bits = 8
    assert channel.places == ("holding:0",)
    assert channel == Channel("holding:0", Direction.OUTPUT, 16)


def test_directions_contain_each_other():
    assert Direction.INPUT in Direction.BOTH and Direction.OUTPUT in Direction.BOTH
    assert Direction.INPUT not in Direction.OUTPUT


def test_the_simulated_driver_is_a_driver_like_any_other():
    assert issubclass(Simulated, Driver)


def test_a_derived_channel_hashes_by_its_text_unless_it_has_a_hash_of_its_own():
    @dataclass(frozen=True)
    class Placed(Channel):
        table: dict[str, int] = field(default_factory=dict)  # which has no hash

    class Own(Channel):
        def __hash__(self):
            return 7

    assert hash(Placed("a", Direction.INPUT, 8)) == hash(Channel("a", Direction.INPUT, 8)) == hash("a")
    assert hash(Own("a", Direction.INPUT, 8)) == 7


@pytest.mark.parametrize(("bits", "signed"), [(64, False), (64, True), (80, True), (80, False)])
def test_the_limits_of_a_channel_are_those_of_a_transfer_at_most(bits, signed):
    channel = Channel("a", Direction.BOTH, bits, signed)
    assert (channel.lowest, channel.highest) == (-(2**63) if signed else 0, 2**63 - 1)
