"""The fewest transfers that serve a period's channels on registers: pure functions, no device."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

from umo.drivers.registers.map import Register, RegisterChannel


class BlockPart(NamedTuple):
    """A register in a block: where its bytes begin, and its channels with their places among the values of the call."""

    register: Register
    start: int
    channels: tuple[tuple[int, RegisterChannel], ...]
    whole: bool
    """All of its bits are written."""


class RegisterBlock(NamedTuple):
    """Registers that follow each other: one transfer."""

    page: int | None
    address: int
    size: int
    parts: tuple[BlockPart, ...]
    places: tuple[Hashable, ...]
    """Of its bytes in the chip."""

    @property
    def first(self) -> int:
        return min(i for part in self.parts for i, _ in part.channels)


def plan(channels: Sequence[RegisterChannel], *, joined: bool, longest: int) -> tuple[RegisterBlock, ...]:
    """Each register once, with all of its fields. `joined`: those that follow each other go in one block of at most
    `longest` bytes. Blocks are in the order of the channels."""
    of: dict[Register, list[tuple[int, RegisterChannel]]] = {}
    for placed in enumerate(channels):
        of.setdefault(placed[1].register, []).append(placed)
    runs: list[list[Register]] = []
    for register in sorted(of, key=lambda each: (-1 if each.page is None else each.page, each.address)):
        run = runs[-1] if runs else []
        if joined and run and _follows(register, run) and register.address + register.size - run[0].address <= longest:
            run.append(register)
        else:
            runs.append([register])
    blocks = [_block(run, of, joined) for run in runs]
    return tuple(sorted(blocks, key=lambda block: block.first))


def _follows(register: Register, run: list[Register]) -> bool:
    return register.page == run[-1].page and register.address == run[-1].address + run[-1].size


def places_of(page: int | None, address: int, size: int, *, joined: bool) -> tuple[Hashable, ...]:
    """The places of bytes in a chip, which counts its addresses in bytes (`joined`) or in registers."""
    return tuple((page, address + i) if joined else (page, address, i) for i in range(size))


def _block(run: list[Register], of: dict[Register, list[tuple[int, RegisterChannel]]], joined: bool) -> RegisterBlock:
    first, last = run[0], run[-1]
    size = last.address - first.address + last.size
    parts = tuple(_part(register, register.address - first.address, tuple(of[register])) for register in run)
    return RegisterBlock(
        first.page, first.address, size, parts, places_of(first.page, first.address, size, joined=joined)
    )


def _part(register: Register, start: int, channels: tuple[tuple[int, RegisterChannel], ...]) -> BlockPart:
    return BlockPart(register, start, channels, any(channel.whole for _, channel in channels))
