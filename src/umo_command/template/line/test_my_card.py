"""Tests of the driver `my_card`: run `pytest test_my_card.py`.

During the tests my_card_device.py runs in another process. A tap between this device
and the driver loses, delays, shortens and garbles answers for the conformance kit. The
kit drives the outputs that the subject lists, within their limits, and brings them to
their defaults at the end. With the real device, list only outputs that may move, and
connect the loop-backs by wires.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from umo.errors import ChannelError, ChannelsFailed
from umo.testing.conformance import Input, Output, Subject, TcpTap, conform

from my_card import CHANNELS, GET, MyCard, found, framed

DEVICE = Path(__file__).with_name("my_card_device.py")


@pytest.fixture(scope="module")
def subject() -> Iterator[Subject]:
    words = [sys.executable, str(DEVICE)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as device:
        assert device.stdout is not None
        port = int(device.stdout.readline())
        with TcpTap("127.0.0.1", port) as tap:
            yield Subject(
                name="my_card",
                make=lambda: MyCard(host=tap.host, port=tap.port),
                outputs=(Output("dac:0", greatest=4095), Output("relay:0")),
                inputs=(Input("adc:0"), Input("switch:0")),
                loopbacks=(("dac:0", "adc:0"), ("relay:0", "switch:0")),
                refused=("spare:0",),
                checksum=True,
                line=tap,
            )
        device.kill()


def test_the_driver_keeps_its_contract(subject: Subject) -> None:
    certificate = conform(subject, cycles=300)
    assert certificate.passed, str(certificate)


def test_an_unknown_channel_is_answered_with_those_that_exist() -> None:
    with pytest.raises(ChannelError) as error:
        MyCard().channel("no such channel")
    assert all(text in str(error.value) for text in CHANNELS)


def test_a_channel_that_the_device_does_not_have_fails_alone(subject: Subject) -> None:
    driver = subject.make()
    driver.timeout = 3.0
    driver.open()
    try:
        channels = [driver.channel(text) for text in ("spare:0", "adc:0")]
        levels = np.array([-1, -1])
        with pytest.raises(ChannelsFailed) as error:
            driver.read_many(channels, levels)
        why = "the device answers: there is no such channel"
        assert error.value.causes == {"spare:0": why}
        assert levels.tolist() == [-1, driver.read(channels[1])]
    finally:
        driver.close()


def test_an_answer_is_found_among_other_bytes_and_no_other_is_taken() -> None:
    items = [(2, 0, 1234)]
    answer = framed(7, GET, items)
    assert found(b"\xff\x00" + framed(6, GET, items) + answer, 7, GET, [2]) == items
    assert found(answer[:-1], 7, GET, [2]) is None
    for place in range(len(answer)):
        damaged = bytearray(answer)
        damaged[place] ^= 0x10
        assert found(bytes(damaged), 7, GET, [2]) is None
