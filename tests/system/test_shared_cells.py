"""What one process writes into shared memory others read whole or not at all, in whatever order stores become visible.

The processor is simulated: of each word a reader sees any of the values that the writer has stored there one after the
other. That is more than any processor does, and contains a writer that is killed or stopped between any two stores.
"""

from __future__ import annotations

import mmap
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.tiers import first
from umo.drivers.off_cycle.shared_memory import NO_TIME, Banks, Cell, Exchange, Row
from umo.process.run_state import MAX_REPORT_BYTES, OUTCOME_AT, REPORT_AT, RunState
from umo.system.shared_cells import HEAD, SharedText
from umo.testing import Scripted

CHANNELS = 3
SHAPE = (len(Row), CHANNELS)


def mixed(random: Random, images: list[Any]) -> Any:
    """A memory each word of which is as in one of these images; most words are of one and the same."""
    generator = np.random.default_rng(random.getrandbits(32))
    length, kinds = len(images[0]), len(images)
    others = generator.random(length) < random.choice((0.02, 0.3, 1.0))
    return np.choose(np.where(others, generator.integers(kinds, size=length), random.randrange(kinds)), images)


def bank_memory() -> tuple[Any, Any, Banks]:
    cells = np.zeros(len(Cell), np.int64)
    memory = np.zeros(Banks.words(SHAPE), np.int64)
    return memory, cells, Banks(memory, cells, Cell.ARRIVED, np.full(SHAPE, NO_TIME))


@pytest.mark.parametrize("seeds", first(1, [300, 30_000]))
def test_a_reader_of_banks_sees_a_whole_state_or_keeps_the_last_one(seeds: int) -> None:
    """It took a torn bank for whole where the count became visible before the rows, and after 1,000 tries always."""
    for seed in range(seeds):
        random = Random(seed)
        memory, cells, writer = bank_memory()
        seen, seen_cells = memory.copy(), cells.copy()
        reader = Banks(seen, seen_cells, Cell.ARRIVED, np.full(SHAPE, NO_TIME))
        images, counts = [memory.copy()], [0]
        posted = {0: np.full(SHAPE, NO_TIME)}
        for number in range(1, random.randint(2, 6)):
            posted[number] = np.array([[random.choice((number, 7)) for _ in range(CHANNELS)] for _ in Row])
            writer.post(posted[number])
            images.append(memory.copy())
            counts.append(int(cells[Cell.ARRIVED]))
        last = 0
        for _ in range(4):
            seen[:], seen_cells[Cell.ARRIVED] = mixed(random, images), random.choice(counts)
            count, rows = reader.read()
            assert (rows == posted[count]).all(), f"a torn bank was taken for whole (seed {seed})"
            assert count in (last, seen_cells[Cell.ARRIVED])
            last = count


def test_a_writer_that_ends_after_any_store_leaves_a_whole_bank() -> None:
    """The rows, the head and the count are stored one after the other, in any order."""
    old, new = np.full(SHAPE, 1), np.arange(12).reshape(SHAPE)
    memory, cells, writer = bank_memory()
    writer.post(old)
    before = np.concatenate([memory, cells])
    writer.post(new)
    after = np.concatenate([memory, cells])
    changed = np.flatnonzero(before != after).tolist()
    for seed in range(200):
        order = Random(seed).sample(changed, len(changed))
        for stored in range(len(order) + 1):
            shown = before.copy()
            shown[order[:stored]] = after[order[:stored]]
            seen, seen_cells = np.zeros_like(memory), np.zeros_like(cells)
            reader = Banks(seen, seen_cells, Cell.ARRIVED, old)
            seen[:], seen_cells[:] = shown[: memory.size], shown[memory.size :]
            rows = reader.read()[1]
            assert (rows == old).all() or (rows == new).all()
            assert stored < len(order) or (rows == new).all()


TEXTS = st.binary(max_size=40)


@settings(max_examples=2 * settings().max_examples)
@given(st.lists(TEXTS, min_size=2, max_size=4), st.integers(0, 2**32))
def test_a_text_is_read_whole_or_not_at_all(texts: list[bytes], seed: int) -> None:
    random, room = Random(seed), 64 + HEAD.size
    memory = bytearray(room)
    writer, images = SharedText(memory, 0, room), [np.frombuffer(bytes(room), np.uint8)]
    for number, text in enumerate(texts, 1):
        writer.put(number, text)
        images.append(np.frombuffer(bytes(memory), np.uint8))
    assert writer.get() == (len(texts), texts[-1])
    for _ in range(20):
        found = SharedText(bytearray(mixed(random, images).tobytes()), 0, room).get()
        assert found is None or found == (found[0], texts[found[0] - 1])


def test_a_text_that_has_no_room_is_refused_and_the_one_before_stands() -> None:
    text = SharedText(bytearray(HEAD.size + 8), 0, HEAD.size + 8)
    assert text.get() is None
    text.put(3, b"12345678")
    with pytest.raises(ValueError, match="9 bytes do not fit into 8"):
        text.put(4, b"123456789")
    assert text.get() == (3, b"12345678")


def memories(patch: pytest.MonkeyPatch) -> list[mmap.mmap]:
    """The shared memories that are made from now on."""
    made, make = list[mmap.mmap](), mmap.mmap
    patch.setattr(mmap, "mmap", lambda *given: made.append(make(*given)) or made[-1])
    return made


@pytest.mark.parametrize("seeds", first(1, [20, 2000]))
def test_a_request_and_an_answer_are_seen_whole_or_not_yet(seeds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A request whose number was seen before its text gave one that nobody had made: another channel, another value."""
    box, made_memory = Scripted(), memories(monkeypatch)
    for seed in range(seeds):
        random = Random(seed)
        control = Exchange([box.channel("a"), box.channel("b")])
        worker = Exchange([box.channel("a"), box.channel("b")])
        mine, seen = made_memory[-2:]
        images, made = [np.frombuffer(mine[:], np.uint8)], [None]
        for number in range(1, random.randint(2, 5)):
            request = {"call": "write", "channel": random.choice("ab"), "raw": random.randrange(3)}
            control.ask(request)
            made.append((number, request))  # type: ignore[arg-type]
            images.append(np.frombuffer(mine[:], np.uint8))
        for _ in range(5):
            seen[:] = mixed(random, images).tobytes()
            assert worker.asked() in made


def test_the_report_of_a_process_that_was_killed_within_it_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    made = memories(monkeypatch)
    state, shown = RunState(), RunState()
    mine, seen = made
    state.report(b'{"status": 1}')
    whole = mine[REPORT_AT:OUTCOME_AT]
    for seed in range(200):
        random = Random(seed)
        images = [np.zeros(len(whole), np.uint8), np.frombuffer(whole, np.uint8)]
        seen[REPORT_AT:OUTCOME_AT] = mixed(random, images).tobytes()
        assert shown.reported() in (b"", b'{"status": 1}')
    state.report(bytes(2 * MAX_REPORT_BYTES))
    assert state.reported() == b""
