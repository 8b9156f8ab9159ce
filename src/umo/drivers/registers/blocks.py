"""The fewest transfers that serve a period's channels on registers: pure functions, which use no device."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from operator import itemgetter
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from umo.drivers.contract import IntArray
from umo.drivers.registers.map import Register, RegisterChannel

_CODES = {8: "b", 16: "h", 32: "i", 64: "q"}
"""Codes of struct and numpy by width in bits; unsigned ones are in upper case."""


class BlockPart(NamedTuple):
    """A register in a block: the place of its bytes, and its channels. Each channel has its index among the values of
    the call."""

    register: Register
    start: int
    channels: tuple[tuple[int, RegisterChannel], ...]
    whole: bool
    """True if all bits of the register are written."""


class LikeRegisters:
    """Registers of a block that have the same width, byte order and sign, each moved as a whole by one channel. Their
    values are converted together. The results are those of decode and encode of each channel, but the conversion is
    faster."""

    def __init__(self, code: str, places: Sequence[int]) -> None:
        """`code`: the format of one register, such as ">h". `places`: the indices of the channels among the values of
        the call."""
        in_order = list(places) == list(range(places[0], places[0] + len(places)))
        self._places: Any = slice(places[0], places[-1] + 1) if in_order else np.array(places)
        self._pick: Callable[..., Any] = itemgetter(self._places) if in_order else itemgetter(*places)
        self._dtype = np.dtype(code)
        self._pack = Struct(f"{code[0]}{len(places)}{code[1]}").pack

    def decode(self, data: bytes, out: IntArray) -> None:
        out[self._places] = np.frombuffer(data, self._dtype)

    def encode(self, raws: Sequence[int]) -> bytes:
        return self._pack(*self._pick(raws))


class RegisterBlock(NamedTuple):
    """Consecutive registers, which are moved in one transfer."""

    page: int | None
    address: int
    size: int
    parts: tuple[BlockPart, ...]
    places: tuple[Hashable, ...]
    """The places of the block's bytes in the chip."""
    like: LikeRegisters | None
    """The registers as `LikeRegisters`; None if they differ and are converted individually."""

    @property
    def first(self) -> int:
        return min(i for part in self.parts for i, _ in part.channels)


def plan(channels: Sequence[RegisterChannel], *, joined: bool, max_size: int) -> tuple[RegisterBlock, ...]:
    """Return the blocks. Each register is in one block, with all of its fields. `joined`: consecutive registers are
    combined into blocks of at most `max_size` bytes. Blocks are in the order of the channels."""
    of: dict[Register, list[tuple[int, RegisterChannel]]] = {}
    for placed in enumerate(channels):
        of.setdefault(placed[1].register, []).append(placed)
    runs: list[list[Register]] = []
    for register in sorted(of, key=lambda each: (-1 if each.page is None else each.page, each.address)):
        run = runs[-1] if runs else []
        follows = run and (register.page, register.address) == (run[-1].page, run[-1].address + run[-1].size)
        if joined and follows and register.address + register.size - run[0].address <= max_size:
            run.append(register)
        else:
            runs.append([register])
    blocks = [_block(run, of, joined) for run in runs]
    return tuple(sorted(blocks, key=lambda block: block.first))


def places_of(page: int | None, address: int, size: int, *, joined: bool) -> tuple[Hashable, ...]:
    """Return the places of bytes in a chip, which counts its addresses in bytes (`joined`) or in registers."""
    return tuple((page, address + i) if joined else (page, address, i) for i in range(size))


def _block(run: list[Register], of: dict[Register, list[tuple[int, RegisterChannel]]], joined: bool) -> RegisterBlock:
    first, last = run[0], run[-1]
    size = last.address - first.address + last.size
    parts = tuple(
        BlockPart(each, each.address - first.address, tuple(of[each]), any(channel.whole for _, channel in of[each]))
        for each in run
    )
    places = places_of(first.page, first.address, size, joined=joined)
    return RegisterBlock(first.page, first.address, size, parts, places, _like(parts))


def _like(parts: Sequence[BlockPart]) -> LikeRegisters | None:
    codes = {_code(part) for part in parts}
    code = codes.pop()
    return LikeRegisters(code, [part.channels[0][0] for part in parts]) if code and not codes else None


def _code(part: BlockPart) -> str:
    """Return the code of struct and numpy for this part; empty if they have none.

    An unsigned value of 64 bits may not fit an int64."""
    register = part.register
    fits = register.bits in _CODES and (register.signed or register.bits < 64)
    if not fits or register.shift or not part.whole or len(part.channels) > 1:
        return ""
    code = _CODES[register.bits]
    return (">" if register.byte_order == "big" else "<") + (code if register.signed else code.upper())
