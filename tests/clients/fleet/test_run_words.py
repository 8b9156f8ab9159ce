"""Runs as words, and what has changed of them."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.clients.fleet.message_parts import packed, unpacked
from umo.clients.fleet.run_words import FULL, HEADER, Delta, Head, RunMetadata, WordFrame, peek
from umo.errors import FramesError
from umo.process.frames.layout import Layout

RUN = b"12345678"


def layout(objects: int = 3) -> Layout:
    described = tuple({"path": f"o{number}"} for number in range(objects))
    return Layout(described, ("read",), {}, tunables=({"path": "gain"},))


def frame(words: WordFrame, seed: int) -> np.ndarray:  # type: ignore[type-arg]
    made = np.zeros(1, words.dtype)
    rng = np.random.default_rng(seed)
    made["values"] = rng.normal(size=made["values"].shape)
    made["quality"] = rng.integers(0, 5, size=made["quality"].shape)
    made["number"], made["sequence"], made["checksum"] = seed, 2 * seed + 2, 99
    return made


@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=20), st.integers(1, 200))
def test_a_chain_of_deltas_gives_the_frames_but_for_what_is_of_the_ring(seeds: list[int], objects: int) -> None:
    words = WordFrame(layout(objects))
    there, before = np.zeros(words.count, np.uint64), None
    for number, seed in enumerate(seeds):
        sent = frame(words, seed)
        now = words.words(sent[0])
        places, changed = words.changed(now, before)
        flags = FULL if before is None else 0
        delta = words.parse(Delta(RUN, number, flags, places, changed, b"rest").packed())
        words.apply(delta, there)
        before = now
        got = words.frame(there)
        assert (got["values"] == sent["values"][0]).all()
        assert (got["quality"] == sent["quality"][0]).all()
        assert (got["number"], got["sequence"], got["checksum"]) == (seed, 0, 0)
        assert (delta.number, delta.rest, delta.run) == (number, b"rest", RUN)


def test_a_delta_holds_the_changed_words_only() -> None:
    words = WordFrame(layout())
    first, second = frame(words, 1), frame(words, 1)
    second["values"][0][1] = 7.0
    places, changed = words.changed(words.words(second[0]), words.words(first[0]))
    assert len(changed) == 1
    assert len(Delta(RUN, 1, 0, places, changed, b"").packed()) == HEADER.size + 2 + 8


@given(st.data())
def test_a_message_that_is_cut_or_changed_at_its_head_is_refused_or_fits(data: st.DataObject) -> None:
    words = WordFrame(layout())
    places, changed = words.changed(words.words(frame(words, 2)[0]), words.words(frame(words, 1)[0]))
    message = Delta(RUN, 1, 0, places, changed, b"").packed()
    cut = data.draw(st.integers(0, len(message) - 1))
    with pytest.raises(FramesError):
        words.parse(message[:cut])
    at = data.draw(st.integers(8, HEADER.size + len(changed) * 2 - 1))
    torn = bytearray(message)
    torn[at] ^= data.draw(st.integers(1, 255))
    with suppress(FramesError):
        words.apply(words.parse(bytes(torn)), np.zeros(words.count, np.uint64))


def test_run_and_number_are_read_without_the_declaration() -> None:
    words = WordFrame(layout())
    message = Delta(RUN, 7, FULL, *words.changed(words.words(frame(words, 1)[0]), None), b"").packed()
    assert peek(message) == Head(RUN, 7, FULL)
    with pytest.raises(FramesError):
        peek(b"short")


def test_the_rest_is_read_as_it_was_packed() -> None:
    rest = RunMetadata(1, 0, 12, 3, b"ann", b"12345678")
    assert RunMetadata.parse(rest.packed()) == rest
    with pytest.raises(FramesError):
        RunMetadata.parse(b"123")


@given(st.lists(st.binary(max_size=50), max_size=8))
def test_parts_are_unpacked_as_they_were_packed(parts: list[bytes]) -> None:
    assert unpacked(packed(*parts)) == parts


@given(st.lists(st.binary(max_size=50), max_size=8), st.data())
def test_parts_that_are_cut_are_refused(parts: list[bytes], data: st.DataObject) -> None:
    whole = packed(*parts)
    with pytest.raises(FramesError):
        unpacked(whole[: data.draw(st.integers(0, len(whole) - 1))])
