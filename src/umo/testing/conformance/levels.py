"""Raw levels to try: ends, powers of two and their neighbours, every value of every byte."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

FEW_LEVELS = 300
"""Levels of a range up to which all are tried."""
BYTE_VALUES = 256
STRIDES = (1, 77, 151, 203, 99, 235, 173, 59)
"""Odd numbers: number * stride runs through all values of a byte, in another order for each byte of a level."""


def levels(least: int, greatest: int, default: int) -> tuple[int, ...]:
    """Levels of the range, no one twice: the default, the ends, a shuffled mixture of the others."""
    if greatest - least < FEW_LEVELS:
        mixed = list(range(least, greatest + 1))
    else:
        mixed = [*_powers(least, greatest), *_bytes(least, greatest)]
    Random(1998).shuffle(mixed)
    return tuple(dict.fromkeys((default, greatest, least, *mixed)))


def _powers(least: int, greatest: int) -> Iterator[int]:
    for bit in range(64):
        for sign in (1, -1):
            for beside in (-1, 0, 1):
                if least <= (raw := sign * (1 << bit) + beside) <= greatest:
                    yield raw


def _bytes(least: int, greatest: int) -> Iterator[int]:
    """Levels whose bytes each run through all their values, as far as the range has them."""
    bits = max(least.bit_length(), greatest.bit_length()) + (least < 0)
    size = -(-bits // 8)
    for number in range(BYTE_VALUES):
        word = bytes((number * STRIDES[i % len(STRIDES)] + 31 * i) % BYTE_VALUES for i in range(size))
        for kept in (bits, bits - 1):  # the lower bytes stay if the level does not fit
            raw = int.from_bytes(word, "little") & ((1 << kept) - 1)
            if least < 0 and raw >> (kept - 1):
                raw -= 1 << kept
            if least <= raw <= greatest:
                break
        else:
            raw = least + raw % (greatest - least + 1)
        yield raw
