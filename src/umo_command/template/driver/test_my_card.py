"""Tests of the driver `my_card`: run `pytest test_my_card.py`.

The conformance kit drives the outputs that SUBJECT lists, within their limits, and
brings them to their defaults at the end. With the real device, list only outputs that
may move, and connect the loop-backs by wires.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from umo.errors import ChannelError, DeviceTimeout, WiringError
from umo.testing.conformance import Input, Output, Subject, conform

from my_card import CHANNELS, Device, MyCard


@contextmanager
def switched_off() -> Iterator[None]:
    """Return a context in which the device is switched off."""
    Device.silent = True
    try:
        yield
    finally:
        Device.silent = False


SUBJECT = Subject(
    name="my_card",
    make=MyCard,
    outputs=(Output("dac:0", default=0, least=0, greatest=4095), Output("relay:0")),
    inputs=(Input("adc:0"), Input("switch:0")),
    loopbacks=(("dac:0", "adc:0"), ("relay:0", "switch:0")),
    gone=switched_off,
)


def test_the_driver_keeps_its_contract() -> None:
    certificate = conform(SUBJECT, cycles=1000)
    assert certificate.passed, str(certificate)


def test_an_unknown_channel_is_answered_with_those_that_exist() -> None:
    with pytest.raises(ChannelError) as error:
        MyCard().channel("no such channel")
    assert all(text in str(error.value) for text in CHANNELS)


@pytest.mark.parametrize("address", [-1, 128])
def test_a_wrong_address_is_refused(address: int) -> None:
    with pytest.raises(WiringError, match="must be from 0 to 127"):
        MyCard(address=address)


def test_a_device_that_is_silent_times_out_and_is_used_again_when_it_answers() -> None:
    driver = MyCard()
    driver.open()
    try:
        channel = driver.channel("adc:0")
        with switched_off(), pytest.raises(DeviceTimeout):
            driver.read(channel)
        assert driver.read(channel) == 0
    finally:
        driver.close()
