"""Damage to files by a seed, and the fewest places of it that still show a fault."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from umo.recording.mcap_reader import McapReader

KINDS = ("bit", "byte", "hole", "cut", "end", "swapped", "repeated", "moved end", "garbage")


class Damage(NamedTuple):
    """One place: its kind, and where and how much as shares of the file, or which chunks."""

    kind: str
    at: float
    much: float
    bit: int


def damages(seed: int) -> list[Damage]:
    """One to three places."""
    luck = random.Random(seed)
    few = luck.choice([1, 1, 1, 2, 3])
    return [Damage(luck.choice(KINDS), luck.random(), luck.random(), luck.randrange(255)) for _ in range(few)]


def applied(content: bytes, places: Sequence[Damage], chunks: Sequence[tuple[int, int]]) -> bytes:
    """A file with this damage. `chunks`: begin and end of each chunk with its indexes in the sound file."""
    for place in places:
        content = _applied(content, place, chunks)
    return content


def _applied(content: bytes, place: Damage, chunks: Sequence[tuple[int, int]]) -> bytes:
    kind, at = place.kind, int(place.at * len(content))
    size = 1 + int(place.much**4 * len(content) / 2)
    data = bytearray(content)
    if kind == "bit" and data:
        data[at] ^= 1 << place.bit % 8
    elif kind == "byte" and data:
        data[at] ^= 1 + place.bit % 255
    elif kind == "hole":
        data[at : at + size] = bytes(len(data[at : at + size]))
    elif kind == "garbage":
        data[at : at + size] = random.Random(place.bit).randbytes(len(data[at : at + size]))
    elif kind == "cut":
        del data[at : at + size]
    elif kind == "end":
        del data[at:]
    elif kind == "moved end":
        data[at:at] = bytes(place.bit + 1)
    elif len(chunks) > 1:
        _chunks(data, place, chunks)
    return bytes(data)


def _chunks(data: bytearray, place: Damage, chunks: Sequence[tuple[int, int]]) -> None:
    """Two chunks change places, or one stands there once more."""
    one, other = sorted((int(place.at * len(chunks)), int(place.much * len(chunks))))
    (a, b), (c, d) = chunks[one], chunks[other]
    if place.kind == "repeated":
        data[d:d] = data[a:b]
    elif one != other:
        data[a:d] = data[c:d] + data[b:c] + data[a:b]


def chunks_of(path: Path) -> list[tuple[int, int]]:
    """Begin and end of each chunk, with the message indexes behind it."""
    file = McapReader(path)
    try:
        begins = file.chunks
        ends = [*begins[1:], begins[-1] + len(file.raw(begins[-1]))] if begins else []
        return list(zip(begins, ends, strict=True))
    finally:
        file.close()


def fewest(places: list[Damage], fails: Callable[[list[Damage]], bool]) -> list[Damage]:
    """The fewest of these places that still fail, each as small as it can be."""
    for place in list(places):
        rest = [each for each in places if each is not place]
        if rest and fails(rest):
            places = rest
    for number, place in enumerate(places):
        while place.much > 1e-3:
            smaller = place._replace(much=place.much / 2)
            if not fails([*places[:number], smaller, *places[number + 1 :]]):
                break
            places[number] = place = smaller
    return places
