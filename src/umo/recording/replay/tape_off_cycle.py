"""Replaces a driver off the cycle in a replay. The driver's values arrive in the recorded periods, without a worker
process.

The image works as usual: it posts values, gives orders and checks ages. The journal has the decisions of the worker
process: which values arrived and when they were read, when outputs were initialised again, and which orders were
carried out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Any

import numpy as np

from umo.cycle.journal import ErrorKind, Kind
from umo.drivers.contract import Channel, IntArray
from umo.drivers.off_cycle import NO_TIME, DeviceServer, OffCycle
from umo.drivers.off_cycle.shared_memory import Row
from umo.drivers.optional import Looks, answers_for_device
from umo.errors import ChannelsFailed
from umo.objects.scaling import FloatArray
from umo.recording.replay.player import CAUSE, Player


class TapeOffCycle(OffCycle, Looks):
    """Returns the recorded answers of one driver off the cycle. Stamps are consecutive numbers here. They stand for
    exactly the times in the recording."""

    shared = False  # a snapshot of the debugger keeps the values of its moment

    def __init__(self, driver: OffCycle, player: Player, slots: Mapping[int, int]) -> None:
        """`slots`: the recorded slot of each channel, by its id."""
        super().__init__(driver.driver, driver.own_period, driver.max_age)
        self._player = player
        self.meet(driver.exchange.channels, (), ())
        self.server = _TapeServer(self)
        channels = self.exchange.channels
        self._slots = {channel.text: slots[id(channel)] for channel in channels}
        self._place = {slots[id(channel)]: number for number, channel in enumerate(channels)}
        self.mine: set[int] = set()
        """The recorded slots of its objects."""
        self.in_blocks: set[int] = set()
        """The recorded slots of the channels that arrive, or are confirmed, in each transfer of the driver."""
        self._rows = self.exchange.arrivals.read()[1]
        """The newest values, with their stamps."""
        self._times = np.full(len(channels), np.nan)
        """The time of each value in s on the cycle's clock, by place."""
        self._stamp = 0

    @property
    def answers_for_device(self) -> bool:
        return answers_for_device(self.driver)

    # While nothing is controlled -----------------------------------------------------------------------

    def request(self, call: str, **content: Any) -> Any:
        player = self._player
        if call in ("initialize", "reset"):
            kind = Kind.INITIALIZE if call == "initialize" else Kind.RESET
            player.bring_to_default(self._slots[content["channel"]], kind)
        elif call == "read":
            return player.read(self._slots[content["channel"]])
        elif call == "write":
            player.write(self._slots[content["channel"]], content["raw"])
        elif call == "look":
            return player.looked(self.mine)
        return None

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        slots = [self._slots[channel.text] for channel in channels]
        if not self.running:
            self._player.read_group(slots, [channel.text for channel in channels], out)
            return
        failed = {}
        for number, (entry, time) in enumerate(self._player.readings(slots)):
            if entry is None:
                out[number] = self._player.raws[slots[number]]
            elif entry[2] != ErrorKind.NONE:
                failed[channels[number].text] = CAUSE
            else:
                out[number] = entry[3]
                self._set(slots[number], entry[3], time)
        self.read_rows = self._rows.copy()
        if failed:
            raise ChannelsFailed(failed)

    # While the machine runs ------------------------------------------------------------------------------

    def read(self, channel: Channel) -> int:
        slot = self._slots[channel.text]
        if self.running:
            ((entry, time),) = self._player.readings([slot])
            if entry is not None and entry[2] == ErrorKind.NONE:
                self._set(slot, entry[3], time)
            self.read_rows = self._rows.copy()
        return self._player.read(slot)

    def write(self, channel: Channel, raw: int) -> None:
        if self.running:
            self._player.write(self._slots[channel.text], raw)
        super().write(channel, raw)

    def initialize(self, channel: Channel, default: int | None) -> None:
        if self.running:
            self._player.bring_to_default(self._slots[channel.text], Kind.INITIALIZE)
        super().initialize(channel, default)

    def reset(self, channel: Channel, default: int | None) -> None:
        if self.running:
            self._player.bring_to_default(self._slots[channel.text], Kind.RESET)
        super().reset(channel, default)

    def bring(self) -> None:
        """Deliver the values that arrived at this place of the recording."""
        entries = self._player.arrivals(self.mine, self.in_blocks)
        if not entries:
            return
        for entry in entries:
            if entry[1] == Kind.RENEWED:
                self._rows[Row.GENERATION] += 1
            else:
                self._set(entry[0], entry[3], entry[5])
        self.exchange.arrivals.post(self._rows)

    def carried_out(self, number: int, place: int, rows: IntArray) -> bool:
        slot = next(slot for slot, each in self._place.items() if each == place)
        entry = self._player.carried_out(slot)
        if entry is None:
            return False
        self._set(slot, entry[3], np.nan if entry[2] != ErrorKind.NONE else entry[5])
        rows[Row.STAMP, place] = self._rows[Row.STAMP, place]
        return True

    def times(self, places: IntArray, stamps: IntArray, now: float, now_ns: int) -> FloatArray:
        return self._times[places]

    def cause(self, number: int) -> str:
        return CAUSE

    def _set(self, slot: int, raw: int, time: float) -> None:
        place = self._place[slot]
        self._rows[Row.RAW, place] = raw
        if isnan(time):
            self._rows[Row.STAMP, place] = NO_TIME
        elif time != self._times[place]:
            self._stamp += 1
            self._rows[Row.STAMP, place] = self._stamp
        self._times[place] = time


class _TapeServer(DeviceServer):
    """Replaces the server of the driver. The tape contains the results of the server's transfers."""

    def __init__(self, tape: TapeOffCycle) -> None:
        super().__init__(tape.driver, tape.exchange, tape.own_period)
        self._tape = tape

    def work(self) -> None:
        self._tape.bring()
