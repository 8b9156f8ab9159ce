"""Writes recordings in the layout of umo 0.2: version 1, the summary was written anew with each chunk.

Its files were compared, byte by byte, with those that umo 0.2 (98a050ff) has written of the same blocks.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from pathlib import Path

import zstandard

from umo.process.frames import Layout
from umo.recording import mcap_records
from umo.recording.block import Block, columns_message, exact_message
from umo.recording.mcap_records import ChunkIndex, McapChannel, Opcode

EXACT, COLUMNS = McapChannel(1, "umo/exact", "umo"), McapChannel(2, "umo/columns", "umo")


def description(layout: Layout) -> dict[str, str]:
    about = layout.about
    run = json.dumps([about.get("station"), about.get("pid"), about.get("started_monotonic")])
    described = json.loads(layout.describe())
    events = described["events"]  # rows of events had no checksum
    events["entry_bytes"] -= 8
    events["fields"] = [
        each | {"offset": max(each["offset"] - 8, 0)} for each in events["fields"] if each["name"] != "checksum"
    ]
    return {"version": "1", "run": run, "part": "1", "description": json.dumps(described)}


def write(path: Path, layout: Layout, blocks: Sequence[Block]) -> None:
    """A file as the recorder of 0.2 has left it: a chunk for each block."""
    channels = mcap_records.channel(EXACT) + mcap_records.channel(COLUMNS)
    data = bytearray(mcap_records.header("umo"))
    about = mcap_records.metadata("umo", description(layout))
    metadata = mcap_records.metadata_index(len(data), len(about), "umo")
    data += about + channels
    indexes, times = b"", []
    for number, block in enumerate(blocks, 1):
        time = int(block.frames["began"][0] + block.frames["utc"][0])
        messages = [(EXACT.number, exact_message(block)), (COLUMNS.number, columns_message(block, layout))]
        records = [mcap_records.message(channel, number, time, content) for channel, content in messages]
        content, compressed = b"".join(records), zstandard.ZstdCompressor(level=3).compress(b"".join(records))
        chunk = mcap_records.chunk(time, time, len(content), zlib.crc32(content), compressed)
        rows = [mcap_records.INDEXED.pack(time, at) for at in (0, len(records[0]))]
        behind = [mcap_records.message_index(1 + place, row) for place, row in enumerate(rows)]
        places = {1: len(data) + len(chunk), 2: len(data) + len(chunk) + len(behind[0])}
        size = len(b"".join(behind))
        index = ChunkIndex(time, time, len(data), len(chunk), places, size, len(compressed), len(content))
        indexes += mcap_records.chunk_index(index)
        data += chunk + b"".join(behind)
        times.append(time)
    counts = {1: len(blocks), 2: len(blocks)}
    statistics = mcap_records.statistics(
        counts, schemas=0, channels=2, metadata=1, chunks=len(blocks), first=min(times), last=max(times)
    )
    groups = [(Opcode.CHANNEL, channels), (Opcode.STATISTICS, statistics), (Opcode.CHUNK_INDEX, indexes),
              (Opcode.METADATA_INDEX, metadata)]  # fmt: skip
    path.write_bytes(bytes(data) + mcap_records.closing(len(data), 0, groups))
