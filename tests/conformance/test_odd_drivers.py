"""The kit blames no driver that keeps the contract in an unusual way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import sleep
from typing import Any

import pytest

from conformance.careful import Careful, Place
from conformance.subjects import HASTE, careful
from umo.drivers.contract import Channel, Direction, Driver
from umo.errors import ChannelError, DriverError
from umo.testing.conformance import Input, Judgement, Output, Subject, conform, examine

LEVELS = {"wide": 0, "switch": 0}


@pytest.fixture(autouse=True)
def not_for_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examine, "on_certificate", [])


class Memory(Driver):
    """Channels of 64 bits and of one."""

    CHANNELS = {
        "wide": Channel("wide", Direction.BOTH, 64, signed=True),
        "switch": Channel("switch", Direction.OUTPUT, 1),
    }

    def channel(self, text: str) -> Channel:
        if text not in self.CHANNELS:
            raise ChannelError(text, self.CHANNELS)
        return self.CHANNELS[text]

    def read(self, channel: Channel) -> int:
        return LEVELS[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        if not channel.lowest <= raw <= channel.highest:
            raise DriverError(f"{raw} does not fit {channel.text}")
        LEVELS[channel.text] = raw


class NearItsTimeout(Careful):
    """Each exchange takes most of the timeout."""

    def exchange(self, function: int, channels: Sequence[Place], raws: Sequence[int]) -> list[tuple[int, int]]:
        sleep(0.7 * HASTE)
        return super().exchange(function, channels, raws)


class SendsChangesOnly(Careful):
    """A level that the device has confirmed is not sent again on the same connection."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = 4000) -> None:
        super().__init__(host=host, port=port)
        self.confirmed: dict[Place, int] = {}

    def drop(self) -> None:
        super().drop()
        self.confirmed = {}

    def initialize(self, channel: Place, default: int | None) -> None:
        self.confirmed.pop(channel, None)
        super().initialize(channel, default)

    def reset(self, channel: Place, default: int | None) -> None:
        self.confirmed.pop(channel, None)
        super().reset(channel, default)

    def write_raws(self, channels: Sequence[Place], raws: list[int]) -> None:
        new = {c: raw for c, raw in zip(channels, raws, strict=True) if self.confirmed.get(c) != raw}
        for channel in new:
            self.confirmed.pop(channel, None)
        super().write_raws(list(new), list(new.values()))
        self.confirmed |= new


def wide() -> Subject:
    return Subject("wide", make=Memory, outputs=(Output("wide", -7, -(2**63), 2**63 - 1),))


def switch() -> Subject:
    return Subject("switch", make=Memory, outputs=(Output("switch"),), levels=lambda text: [LEVELS[text]])


@pytest.mark.parametrize("subject", [wide, switch])
def test_a_channel_of_64_bits_and_a_single_binary_output_pass(subject: Callable[[], Subject]) -> None:
    certificate = conform(subject(), cycles=20)
    assert certificate.passed, str(certificate)


ODD: dict[str, dict[str, Any]] = {
    "read only": {"outputs": (), "loopbacks": (), "refused": ("in:40",)},
    "write only": {
        "outputs": (Output("out:0", 5, 0, 255), Output("out:1")),
        "inputs": (),
        "loopbacks": (),
        "refused": (),
    },
    "a single output": {"outputs": (Output("out:0"),), "inputs": (), "loopbacks": (), "refused": ()},
}


@pytest.mark.parametrize("what", ODD)
def test_a_driver_with_channels_of_one_kind_passes(what: str) -> None:
    with careful(**ODD[what]) as subject:
        certificate = conform(subject, cycles=20)
    assert certificate.passed, str(certificate)


def test_a_driver_that_sends_only_changes_passes() -> None:
    with careful(SendsChangesOnly) as subject:
        certificate = conform(subject, cycles=10)
    assert certificate.passed, str(certificate)


def test_a_driver_whose_calls_take_most_of_their_timeout_passes() -> None:
    with careful(NearItsTimeout) as subject:
        rules = ["timeout", "patience", "late answer", "answer in pieces", "vanish"]
        certificate = conform(subject, only=rules, cycles=10)
    assert certificate.passed, str(certificate)


def test_a_device_that_brings_its_outputs_to_their_defaults_while_its_line_is_silent_passes() -> None:
    with careful(watchdog=HASTE / 2) as subject:
        rules = ["timeout", "late answer", "short answer", "garbled answer", "error answer", "vanish"]
        certificate = conform(subject, only=rules, cycles=10)
    assert certificate.passed, str(certificate)


def test_a_loop_back_that_follows_late_and_with_noise_passes() -> None:
    class Lagging(Careful):
        """in:0 follows out:0 two reads later, and its last digit varies."""

        seen: list[int] = [5, 5, 5]
        noise = 0

        def read_many(self, channels: Sequence[Place], out: Any) -> None:
            super().read_many(channels, out)
            for i, channel in enumerate(channels):
                if channel.text == "in:0":
                    self.seen[:] = [*self.seen[1:], int(out[i])]
                    Lagging.noise = (self.noise + 1) % 3
                    out[i] = self.seen[0] + self.noise

    with careful(
        Lagging, inputs=(Input("in:0"), Input("in:9")), agree=lambda one, raw, other, seen: 0 <= seen - raw <= 2
    ) as subject:
        lines = ["late answer", "short answer", "garbled answer", "error answer", "answer in pieces"]
        certificate = conform(subject, only=lines, cycles=10)
    assert certificate.passed, str(certificate)
    assert {each.verdict for each in certificate.findings} == {Judgement.PASSED}
