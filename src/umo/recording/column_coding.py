"""Encodes columns of frames as bytes that compress well: differences over time, byte by byte. Decoding restores the
columns exactly.

A column of n rows and k numbers: the first row; one bit for each of the k numbers, which is 1 if the number changes;
then, for each number that changes, the differences from row to row, folded to small positive numbers, their lowest
bytes first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
STEADY = frozenset({"number", "time", "began", "counted"})
"""Columns that grow evenly. For them the differences of the differences are stored."""


def encoded(frames: npt.NDArray[Any] | Mapping[str, Any], names: Iterable[str]) -> bytes:
    """Return these columns in encoded form, one after the other."""
    return b"".join(_encoded(_words(frames[name]), 2 if name in STEADY else 1) for name in names)


def decode(data: memoryview, frames: npt.NDArray[Any], names: Iterable[str]) -> memoryview:
    """Fill these columns of a structured array, and return the remaining data. Raises ValueError if the data do not
    fit."""
    for name in names:
        column = frames[name]
        words, data = _decoded(data, len(frames), _words(column[:1]), 2 if name in STEADY else 1)
        frames[name] = words.view(column.dtype).reshape(column.shape)
    return data


def _words(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a column as unsigned numbers, with a row for each period."""
    kind = f"u{min(column.dtype.itemsize, 8)}"
    plain = np.ascontiguousarray(column)
    return plain.view(kind).reshape(len(column), -1) if plain.size else np.zeros((len(column), 0), kind)


def _encoded(words: npt.NDArray[Any], order: int) -> bytes:
    if not words.size:
        return b""
    changes = (words[1:] != words[:1]).any(axis=0)
    head: bytes = words[0].tobytes() + np.packbits(changes).tobytes()
    if not changes.any():
        return head
    moving = np.ascontiguousarray(words[:, changes].T)
    for _ in range(order):
        moving[:, 1:] -= moving[:, :-1].copy()
    steps = np.ascontiguousarray(moving[:, 1:])
    signed = steps.view(f"i{steps.itemsize}")
    folded = (signed << 1) ^ (signed >> (8 * steps.itemsize - 1))
    lanes = folded.view(np.uint8).reshape(*steps.shape, steps.itemsize)
    return head + bytes(np.ascontiguousarray(lanes.transpose(0, 2, 1)).data)


def _decoded(data: memoryview, rows: int, like: npt.NDArray[Any], order: int) -> tuple[npt.NDArray[Any], memoryview]:
    kind, count = like.dtype, like.shape[1]
    if not count or not rows:
        return np.zeros((rows, count), kind), data
    row, data = _taken(data, count * kind.itemsize)
    bits, data = _taken(data, -(-count // 8))
    changes = np.unpackbits(bits, count=count).astype(bool)
    words = np.repeat(row.view(kind)[None, :], rows, axis=0)
    moving, steps = int(changes.sum()), rows - 1
    if moving:
        lanes, data = _taken(data, moving * steps * kind.itemsize)
        folded = np.ascontiguousarray(lanes.reshape(moving, kind.itemsize, steps).transpose(0, 2, 1)).view(kind)[..., 0]
        numbers = np.empty((moving, rows), kind)
        numbers[:, 0] = words[0, changes]
        numbers[:, 1:] = (folded >> 1) ^ (~(folded & 1) + 1)
        for _ in range(order):
            numbers = np.add.accumulate(numbers, axis=1, dtype=kind)
        words[:, changes] = numbers.T
    return words, data


def _taken(data: memoryview, size: int) -> tuple[Bytes, memoryview]:
    if size > len(data):
        raise ValueError("columns are cut short")
    return np.frombuffer(data[:size], np.uint8), data[size:]
