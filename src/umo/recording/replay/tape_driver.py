"""Drivers that answer from a tape and replace those of the wiring."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from umo.cycle.callees import BlockTransfer
from umo.cycle.columns import Block
from umo.cycle.journal import Kind
from umo.cycle.transfer import Transfer
from umo.drivers.contract import Channel, Driver, IntArray
from umo.drivers.faults.wrapper import Injection
from umo.drivers.off_cycle import OffCycle
from umo.drivers.optional import Looks, answers_for_device
from umo.drivers.wrapping import bare
from umo.recording.replay.player import Player
from umo.recording.replay.tape_off_cycle import TapeOffCycle
from umo.wiring.wired import Wired


class TapeDriver(Driver[Any], Looks):
    """A driver that returns the recorded answers of another driver. Like a driver with injected faults, it always has
    `look`."""

    def __init__(self, driver: Driver[Any], player: Player, slots: Mapping[int, int]) -> None:
        """`slots`: the recorded slot of each channel, by its id. The caller may still add slots later."""
        self._driver, self._player, self._slots = driver, player, slots
        self.timeout, self.period = driver.timeout, driver.period
        self._blocks: dict[int, tuple[IntArray, list[str]]] = {}
        self.mine: set[int] = set()
        """The recorded slots of its objects."""

    def channel(self, text: str) -> Channel:
        channel: Channel = self._driver.channel(text)
        return channel

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._player.bring_to_default(self._slots[id(channel)], Kind.INITIALIZE)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._player.bring_to_default(self._slots[id(channel)], Kind.RESET)

    def read(self, channel: Channel) -> int:
        return self._player.read(self._slots[id(channel)])

    def write(self, channel: Channel, raw: int) -> None:
        self._player.write(self._slots[id(channel)], raw)

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        slots, texts = self._block(channels)
        if self._player.whole is channels:
            self._player.read_block(slots, texts, out)
        else:
            self._player.read_group(slots.tolist(), texts, out)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        slots, texts = self._block(channels)
        if self._player.whole is channels:
            self._player.write_block(slots, texts)
        else:
            self._player.write_group(slots.tolist(), texts)

    @property
    def answers_for_device(self) -> bool:
        return answers_for_device(self._driver)

    def look(self) -> bool | None:
        return self._player.looked(self.mine)

    def _block(self, channels: Sequence[Channel]) -> tuple[IntArray, list[str]]:
        found = self._blocks.get(id(channels))
        if found is None or self._player.whole is not channels:
            slots = np.array([self._slots[id(channel)] for channel in channels], np.int64)
            found = slots, [channel.text for channel in channels]
            if self._player.whole is channels:  # it lives as long as the machine
                self._blocks[id(channels)] = found
        return found


class TapeTimer(TapeDriver):
    """Replaces the timer's driver: a tick is the next recorded period."""

    timer: int
    """The id of the timer's channel."""

    def read(self, channel: Channel) -> int:
        if id(channel) != self.timer:
            return super().read(channel)
        if self._player.period is None and self._player.skipped > 0:
            skipped, self._player.skipped = self._player.skipped, 0
            return skipped
        return self._player.tick().missed


class TapeInjection(Injection):
    """Replaces the injection of faults. No fault is active. At the end of the recorded run the actuators may have been
    reset once more because of injected faults."""

    def __init__(self, texts: Sequence[str], player: Player) -> None:
        super().__init__(texts, 0, False)
        self._player = player

    def end(self) -> bool:
        self.clock = None
        return self._player.resets_again


def taped(wired: Wired, player: Player, recorded: Mapping[str, int], faults: Sequence[str] = ()) -> Wired:
    """Return the wiring with tapes in place of its drivers, so that no device is used. `recorded`: the slot of each
    path; `faults`: the injected faults of the recorded run."""
    timer = wired.timer_wire
    slots = {id(wire.channel): recorded[wire.path] for wire in wired.wires}
    tapes: dict[int, TapeDriver | TapeOffCycle] = {}
    for driver in wired.drivers.values():
        tapes[id(driver)] = _tape_of(driver, player, slots, timer is not None and timer.driver is driver)
    if timer is not None and id(timer.driver) not in tapes:  # a timer in wall-clock time, before its driver
        tapes[id(timer.driver)] = _tape_of(timer.driver, player, slots, True)
    wires = []
    for wire in wired.wires:
        tape = tapes[id(wire.driver)]
        tape.mine.add(slots[id(wire.channel)])
        if isinstance(tape, TapeOffCycle) and wire.item.synchronous:
            tape.in_blocks.add(slots[id(wire.channel)])
        if isinstance(tape, TapeTimer) and timer is not None and wire.item is timer.item:
            tape.timer = id(wire.channel)
        wires.append(dataclasses.replace(wire, driver=tape))
    drivers: dict[str, Driver[Any]] = {name: tapes[id(driver)] for name, driver in wired.drivers.items()}
    injection = TapeInjection(faults, player) if faults else None
    return dataclasses.replace(
        wired, drivers=drivers, wires=wires, hardware={}, watchdogs={}, injection=injection, paced=False
    )


def count_as_hardware(transfer: Transfer, wired: Wired, tapes: Mapping[str, Driver[Any]]) -> None:
    """Let drivers that used devices in the recorded run count as hardware. Failed writes to hardware may be carried out
    later, so everything is reset twice."""
    transfer._real = {id(tapes[name]) for name in wired.hardware}


def _tape_of(
    driver: Driver[Any], player: Player, slots: Mapping[int, int], is_timer: bool
) -> TapeDriver | TapeOffCycle:
    if isinstance(driver, OffCycle):
        return TapeOffCycle(driver, player, slots)
    return (TapeTimer if is_timer else TapeDriver)(bare(driver), player, slots)


def watch_blocks(transfer: Transfer, player: Player) -> None:
    """Report to the player which transfer of a block is the first one in a period, because that transfer has no
    entries."""
    inner = transfer.callees.watched

    def watched(block: Block, call: BlockTransfer) -> BlockTransfer:
        within, start, seen = inner(block, call), block.start, player.seen

        def transferred(channels: Any, raws: Any) -> None:
            if start in seen:
                within(channels, raws)
                return
            seen.add(start)
            player.whole = channels
            try:
                within(channels, raws)
            finally:
                player.whole = None

        return transferred

    transfer.callees.watched = watched
