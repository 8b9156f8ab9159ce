"""The Modbus driver's options for outputs: function 23, which reads back what was written, and unchanged outputs, which
are left out for a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from helpers.opened_modbus import Start, starting
from umo.drivers.modbus import Modbus
from umo.drivers.modbus import driver as modbus
from umo.errors import ChannelsFailed, DriverError


@pytest.fixture
def start() -> Iterator[Start]:
    with starting() as start:
        yield start


def write(driver: Modbus, *raws: int, texts: tuple[str, ...] = ()) -> None:
    """To the holding registers from 0 on, or to these channels."""
    channels = [driver.channel(text) for text in texts or [f"holding:{i}" for i in range(len(raws))]]
    driver.write_many(channels, np.array(raws, np.int64))


# Function 23 ---------------------------------------------------------------------------------------


def test_registers_are_written_and_read_back_in_one_request_and_coils_as_ever(start: Start) -> None:
    driver, peer = start(read_write=True)
    write(driver, 7, -8, 1, texts=("holding:3", "holding:4:int32", "coil:2"))
    driver.write(driver.channel("holding:9"), 5)
    assert peer.requests() == [(23, 3, 3, 7, 65535, 65528), (5, 2, 1, 1), (23, 9, 1, 5)]
    assert driver.read(driver.channel("holding:4:int32")) == -8


def test_a_value_that_the_unit_did_not_take_fails_for_its_channel_and_the_next_request_goes_on(start: Start) -> None:
    driver, peer = start("1:refuses=99", read_write=True)
    with pytest.raises(ChannelsFailed) as caught:
        write(driver, 7, 8, 9, texts=("holding:3", "holding:4", "holding:8"))
    assert caught.value.causes == {"holding:3": "the unit reads back [99] in place of [7]"}
    assert peer.requests() == [(23, 3, 2, 7, 8), (23, 8, 1, 9)]
    write(driver, 7, 8, texts=("holding:3", "holding:4"))


def test_more_registers_than_function_23_may_write_are_split(start: Start) -> None:
    driver, peer = start(read_write=True)
    write(driver, *range(130))
    assert [request[:3] for request in peer.requests()] == [(23, 0, 121), (23, 121, 9)]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("exception=1", "writing holding registers 0 to 1: exception 1, illegal function"),
        ("fewer", "writing holding registers 0 to 1: a byte count of 2 in place of 4"),
        ("function=16", "writing holding registers 0 to 1: an answer to function 16 in place of 23"),
        ("tail", "an answer of 7 bytes in place of 6"),
    ],
)
def test_a_wrong_answer_to_function_23_is_an_error(start: Start, fault: str, words: str) -> None:
    driver, _ = start(f"1:{fault}", read_write=True)
    with pytest.raises(DriverError, match=words):
        write(driver, 1, 2)


# Unchanged outputs ---------------------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """The time at which the driver takes writes to be made."""
    now = [1000.0]
    monkeypatch.setattr(modbus, "monotonic", lambda: now[0])
    yield now


def test_unchanged_outputs_are_sent_again_after_the_time_and_changed_ones_at_once(
    start: Start, clock: list[float]
) -> None:
    driver, peer = start(skip_unchanged="200 ms")
    for later, raws in ((0.0, (1, 2)), (0.1, (1, 2)), (0.05, (1, 2)), (0.04, (1, 3)), (0.19, (1, 3)), (0.02, (1, 3))):
        clock[0] += later
        write(driver, *raws)
    assert peer.requests() == [(16, 0, 2, 1, 2), (16, 0, 2, 1, 3), (16, 0, 2, 1, 3)]


def test_only_the_requests_whose_values_changed_are_sent(start: Start, clock: list[float]) -> None:
    driver, peer = start(skip_unchanged=0.2)
    texts = ("holding:0", "holding:1", "holding:5", "coil:0")
    write(driver, 1, 2, 3, 0, texts=texts)
    write(driver, 1, 2, 4, 0, texts=texts)
    write(driver, 1, 2, 4, 1, texts=texts)
    assert peer.requests()[3:] == [(6, 5, 1, 4), (5, 0, 1, 1)]


def test_a_single_write_and_a_reset_are_always_sent_and_what_they_overwrote_is_sent_again(
    start: Start, clock: list[float]
) -> None:
    driver, peer = start(skip_unchanged="200 ms")
    register = driver.channel("holding:1")
    write(driver, 1, 2)
    driver.reset(register, 2)
    driver.write(register, 0)
    write(driver, 1, 2)
    assert peer.requests() == [(16, 0, 2, 1, 2), (6, 1, 1, 2), (6, 1, 1, 0), (16, 0, 2, 1, 2)]


@pytest.mark.parametrize("fault", ["exception=4", "close", "hangup"])
def test_after_any_error_or_a_new_connection_everything_is_sent_again(
    start: Start, clock: list[float], fault: str
) -> None:
    driver, peer = start(f"2:{fault}", skip_unchanged="200 ms")
    write(driver, 1, 2)
    if fault == "hangup":
        driver.read(driver.channel("input:0"))
        peer.wait_for("closed")
    else:
        with pytest.raises(DriverError):
            driver.read(driver.channel("input:0"))
    write(driver, 1, 2)
    assert peer.requests()[2:] == [(16, 0, 2, 1, 2)]


def test_a_write_that_failed_is_not_taken_for_confirmed(start: Start, clock: list[float]) -> None:
    driver, peer = start("1:exception=4", skip_unchanged="200 ms")
    with pytest.raises(DriverError):
        write(driver, 1, 2)
    write(driver, 1, 2)
    write(driver, 1, 2)
    assert len(peer.requests()) == 2


def test_the_time_must_be_shorter_than_the_watchdog(start: Start) -> None:
    driver, peer = start(skip_unchanged="200 ms", watchdog_register=400)
    driver.period = 0.01
    with pytest.raises(
        DriverError, match=r"skip_unchanged and a period, 210 ms, are not shorter than the watchdog, 210"
    ):
        driver.watchdog(0.21)
    driver.watchdog(0.22)
    driver.watchdog(0.0)
    assert peer.requests() == [(6, 400, 1, 220), (6, 400, 1, 0)]
