"""The channels of the Modbus driver and the requests that serve them, as pure functions."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from peers.modbus_map import CELL, value
from umo.drivers.contract import Direction
from umo.drivers.modbus import Modbus
from umo.drivers.modbus.channel import FORMS, TABLES, ModbusChannel, parse
from umo.drivers.modbus.plan import Request, plan_reads, plan_writes
from umo.errors import ChannelError, DriverError

# Channels -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "direction", "bits", "signed"),
    [
        ("coil:0", Direction.BOTH, 1, False),
        ("discrete:65535", Direction.INPUT, 1, False),
        ("holding:12", Direction.BOTH, 16, False),
        ("holding:12:uint16", Direction.BOTH, 16, False),
        ("holding:12:int16", Direction.BOTH, 16, True),
        ("holding:65534:uint32", Direction.BOTH, 32, False),
        ("input:65535", Direction.INPUT, 16, False),
        ("input:0:int32", Direction.INPUT, 32, True),
    ],
)
def test_a_channel_knows_its_direction_and_its_range(text: str, direction: Direction, bits: int, signed: bool) -> None:
    channel = Modbus().channel(text)
    assert (channel.text, channel.direction, channel.bits, channel.signed) == (text, direction, bits, signed)
    assert channel == Modbus().channel(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "coil",
        "coil:",
        "coil:-1",
        "coil:65536",
        "coil:1:int16",
        "coil:01",
        "coil: 1",
        "coil:1\n",
        "Coil:1",
        "discrete:1:uint16",
        "holding:65535:uint32",
        "holding:1:float32",
        "holding:1:",
        "input:0x10",
        "input:٣",
    ],
)
def test_any_other_text_is_refused_with_the_forms_that_there_are(text: str) -> None:
    with pytest.raises(ChannelError) as caught:
        Modbus().channel(text)
    assert all(form in str(caught.value) for form in FORMS)


NEAR_MISSES = st.from_regex(r"(coil|discrete|holding|input|dio)?:?[0-9-]{0,6}(:u?int(8|16|32|64))?")


@given(st.text() | NEAR_MISSES)
def test_every_text_is_a_channel_or_a_channel_error(text: str) -> None:
    try:
        channel = parse(text)
    except ChannelError:
        return
    assert channel.text == text
    assert text.startswith(f"{channel.table.name}:{channel.address}")
    assert channel.end <= 65536


# Plans, as pure functions -------------------------------------------------------------------------


def channels_of(tables: Sequence[str]) -> st.SearchStrategy[list[ModbusChannel]]:
    kinds = st.sampled_from(["", "", ":int16", ":uint32", ":int32"])
    addresses = st.integers(0, 40) | st.integers(0, 3000) | st.integers(65500, 65534)

    def text(table: str, address: int, kind: str) -> str:
        return f"{table}:{address}{kind if table in ('holding', 'input') else ''}"

    one = st.builds(text, st.sampled_from(tables), addresses, kinds).map(parse)
    runs = st.builds(
        lambda table, first, many: [parse(f"{table}:{i}") for i in range(first, min(first + many, 65536))],
        st.sampled_from(tables),
        addresses,
        st.integers(0, 2100),
    )
    few = st.lists(one, max_size=40)
    return few | st.builds(lambda few, run: few + run, few, runs)


def cells_of(request: Request) -> range:
    return range(request.address, request.address + request.count)


def named(channels: Sequence[ModbusChannel]) -> set[tuple[str, int]]:
    return {(each.table.name, cell) for each in channels for cell in range(each.address, each.end)}


@settings(max_examples=60, deadline=None)
@given(channels_of(list(TABLES)), st.booleans())
def test_a_plan_of_reads_serves_every_channel_once_and_keeps_to_the_maxima(
    channels: list[ModbusChannel], bridge: bool
) -> None:
    plan = plan_reads(channels, bridge_gaps=bridge)
    assert sorted(item.place for request in plan for item in request.items) == list(range(len(channels)))
    out = np.full(len(channels), -99, np.int64)
    for request in plan:
        assert 1 <= request.count <= (2000 if request.table.name in ("coil", "discrete") else 125)
        request.decode([CELL[request.table.name](i) for i in cells_of(request)], out)
    assert out.tolist() == [value(channel, CELL[channel.table.name]) for channel in channels]


@settings(max_examples=60, deadline=None)
@given(channels_of(list(TABLES)))
def test_reads_touch_no_unnamed_cell_unless_gaps_are_bridged(channels: list[ModbusChannel]) -> None:
    plan = plan_reads(channels)
    assert {(each.table.name, cell) for each in plan for cell in cells_of(each)} == named(channels)
    assert len(plan_reads(channels, bridge_gaps=True)) <= len(plan)


@settings(max_examples=60, deadline=None)
@given(channels_of(["coil", "holding"]), st.data())
def test_a_plan_of_writes_does_what_writing_one_after_the_other_does(
    channels: list[ModbusChannel], data: st.DataObject
) -> None:
    raws = [each.lowest + data.draw(st.integers(0, 2**32)) % 2**each.bits for each in channels[:40]]
    raws += [i % 2 for i in range(len(channels) - len(raws))]
    wanted: dict[tuple[str, int], int] = {}
    for channel, raw in zip(channels, raws, strict=True):
        words = struct.unpack(">HH", struct.pack(">Q", raw & 2**64 - 1)[4:])
        for cell, word in zip(range(channel.address, channel.end), words[-channel.cells :], strict=True):
            wanted[channel.table.name, cell] = word
    written: dict[tuple[str, int], int] = {}
    for request in plan_writes(channels):
        assert 1 <= request.count <= (1968 if request.table.name == "coil" else 123)
        for cell, word in zip(cells_of(request), request.encode(raws), strict=True):
            written[request.table.name, cell] = word
    assert written == wanted


def test_a_plan_follows_the_order_of_the_declaration() -> None:
    plan = plan_writes([parse(text) for text in ("holding:9", "coil:5", "coil:4", "holding:2")])
    assert [request.what for request in plan] == [
        "holding register 9",
        "coils 4 to 5",
        "holding register 2",
    ]


def test_a_value_that_does_not_fit_is_refused_and_not_cut_off() -> None:
    (request,) = plan_writes([parse("holding:0:int16")])
    with pytest.raises(DriverError, match="-32769 does not fit holding:0:int16: it takes -32768 to 32767"):
        request.encode([-32769])


@pytest.mark.parametrize(
    ("one", "other", "overlap"),
    [
        ("holding:0", "holding:0:int16", True),
        ("holding:0:int32", "holding:1", True),
        ("holding:0:int32", "holding:2", False),
        ("holding:0", "input:0", False),
        ("coil:0", "discrete:0", False),
    ],
)
def test_channels_that_share_a_cell_are_two_objects_on_one_channel(one: str, other: str, overlap: bool) -> None:
    assert bool(set(parse(one).places) & set(parse(other).places)) is overlap
