"""The two drivers of the Python rows: a circuit of registers, moved one by one or as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from umo.drivers import Channel, Direction, Driver


@dataclass(frozen=True)
class Register(Channel):
    address: int = 0


class Loop(Driver):
    """A driver in plain Python: one register after the other. Channels `in:0`, `out:0` and so on."""

    def __init__(self, inputs: int, outputs: int) -> None:
        self.inputs: Any = [0] * inputs
        self.outputs: Any = [0] * outputs

    def channel(self, text: str) -> Register:
        kind, _, number = text.partition(":")
        return Register(text, Direction.INPUT if kind == "in" else Direction.OUTPUT, 64, True, int(number))

    def read(self, channel: Any) -> int:
        return int(self.inputs[channel.address])

    def write(self, channel: Any, raw: int) -> None:
        self.outputs[channel.address] = raw

    def read_many(self, channels: Sequence[Any], out: Any) -> None:
        inputs = self.inputs
        for i, channel in enumerate(channels):
            out[i] = inputs[channel.address]

    def write_many(self, channels: Sequence[Any], raws: Any) -> None:
        outputs = self.outputs
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            outputs[channel.address] = raw


class Fill(Loop):
    """A driver that fills arrays: the registers stand in an int64 array, as a fieldbus' image does; one copy moves
    all. Where the channels stand is worked out once for each tuple of them."""

    def __init__(self, inputs: int, outputs: int) -> None:
        self.inputs = np.zeros(inputs, np.int64)
        self.outputs = np.zeros(outputs, np.int64)
        self._places: dict[Direction, tuple[Sequence[Any], Any]] = {}

    def read_many(self, channels: Sequence[Any], out: Any) -> None:
        out[:] = self.inputs[self._where(channels, Direction.INPUT)]

    def write_many(self, channels: Sequence[Any], raws: Any) -> None:
        self.outputs[self._where(channels, Direction.OUTPUT)] = raws

    def _where(self, channels: Sequence[Any], direction: Direction) -> Any:
        known, where = self._places.get(direction, (None, None))
        if known is not channels:
            places = [channel.address for channel in channels]
            consecutive = places == list(range(places[0], places[0] + len(places)))
            where = slice(places[0], places[0] + len(places)) if consecutive else np.array(places)
            self._places[direction] = channels, where
        return where
