"""The channels of the Modbus driver and the requests that serve them, as pure functions."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.peers.modbus_map import CELL, value
from helpers.tiers import budget
from umo.drivers.contract import Direction
from umo.drivers.modbus import Modbus
from umo.drivers.modbus.channel import FORMS, TABLES, ModbusChannel, parse
from umo.drivers.modbus.plan import Request, plan_reads, plan_writes
from umo.errors import ChannelError, ChannelsFailed, DriverError

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
        ("holding:65532:uint64", Direction.BOTH, 64, False),
        ("input:4:int64", Direction.INPUT, 64, True),
        ("holding:0:float32:0.001", Direction.BOTH, 24, True),
        ("input:8:float64:1e-6", Direction.INPUT, 52, True),
        ("holding:0:float32:0.001:BADC", Direction.BOTH, 24, True),
        ("holding:7.9", Direction.BOTH, 1, False),
        ("input:7:BA.11:8", Direction.INPUT, 4, False),
        ("holding:7:int32:DCBA.19:12", Direction.BOTH, 8, True),
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
        "coil:-1",
        "coil:65536",
        "coil:1:int16",
        "coil:01",
        "coil:1\n",
        "Coil:1",
        "discrete:1:uint16",
        "holding:65535:uint32",
        "holding:1:float32",
        "holding:1:float32:0",
        "holding:1:float32:-1",
        "holding:1:float32:nan",
        "holding:1:float64:1e13",
        "holding:1:uint16:0.1",
        "holding:65533:uint64",
        "holding:65535:float32:1",
        "coil:1.0",
        "holding:1.16",
        "holding:1.3:4",
        "holding:1.03",
        "holding:1:uint32.32",
        "holding:1:int16.3",
        "holding:1:float32:0.1.3",
        "holding:1:ABCD",
        "holding:1:uint32:AB",
        "holding:1:uint32:ACBD",
        "holding:1:CDAB:uint32",
        "input:0x10",
        "input:٣",
    ],
)
def test_any_other_text_is_refused_with_the_forms_that_there_are(text: str) -> None:
    with pytest.raises(ChannelError) as caught:
        Modbus().channel(text)
    assert all(form in str(caught.value) for form in FORMS)


NEAR_MISSES = st.from_regex(
    r"(coil|discrete|holding|input|dio)?:?[0-9-]{0,6}(:u?int(8|16|32|64)|:float(16|32|64)(:[0-9.e-]{0,4})?)?"
    r"(:(ABCD|CDAB|BADC|DCBA|AB|BA|ABDC))?(\.[0-9]{1,2}(:[0-9]{1,2})?)?"
)


@given(st.text() | NEAR_MISSES)
def test_every_text_is_a_channel_or_a_channel_error(text: str) -> None:
    try:
        channel = parse(text)
    except ChannelError:
        return
    assert channel.text == text
    first = int(re.split("[:.]", text)[1])
    assert text.startswith(f"{channel.table.name}:{first}")
    assert first <= channel.address < first + 4
    assert 1 <= channel.bits <= 64
    assert channel.end <= 65536


# Plans, as pure functions -------------------------------------------------------------------------


def channels_of(tables: Sequence[str]) -> st.SearchStrategy[list[ModbusChannel]]:
    kinds = st.sampled_from(["", "", ":int16", ":uint32", ":int32", ":int64"])
    addresses = st.integers(0, 40) | st.integers(0, 3000) | st.integers(65500, 65532)

    def text(table: str, address: int, kind: str) -> str:
        return f"{table}:{address}{kind if table in ('holding', 'input') else ''}"

    one = st.builds(text, st.sampled_from(tables), addresses, kinds).map(parse)
    runs = st.builds(
        lambda table, first, many: [parse(f"{table}:{i}") for i in range(first, min(first + many, 65536))],
        st.sampled_from(tables),
        addresses,
        st.integers(0, 300) | st.sampled_from([1969, 2001]),  # one more than a write, and a read, of bits may have
    )
    few = st.lists(one, max_size=40)
    return few | st.builds(lambda few, run: few + run, few, runs)


def cells_of(request: Request) -> range:
    return range(request.address, request.address + request.count)


def named(channels: Sequence[ModbusChannel]) -> set[tuple[str, int]]:
    return {(each.table.name, cell) for each in channels for cell in range(each.address, each.end)}


@budget(20, 60)
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


@budget(50, 60)
@given(channels_of(list(TABLES)))
def test_reads_touch_no_unnamed_cell_unless_gaps_are_bridged(channels: list[ModbusChannel]) -> None:
    plan = plan_reads(channels)
    assert {(each.table.name, cell) for each in plan for cell in cells_of(each)} == named(channels)
    assert len(plan_reads(channels, bridge_gaps=True)) <= len(plan)


@budget(20, 60)
@given(channels_of(["coil", "holding"]), st.data())
def test_a_plan_of_writes_does_what_writing_one_after_the_other_does(
    channels: list[ModbusChannel], data: st.DataObject
) -> None:
    raws = [each.lowest + data.draw(st.integers(0, 2**64)) % 2**each.bits for each in channels[:40]]
    raws += [i % 2 for i in range(len(channels) - len(raws))]
    wanted: dict[tuple[str, int], int] = {}
    for channel, raw in zip(channels, raws, strict=True):
        words = struct.unpack(">HHHH", struct.pack(">Q", raw & 2**64 - 1))
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


# 64 bits and floats --------------------------------------------------------------------------------

SCALES = st.sampled_from(["1", "0.001", "0.1", "1e-6", "250", "0.0254"])


@budget(100, 300)
@given(st.sampled_from(["float32", "float64"]), SCALES, st.booleans(), st.data())
def test_a_float_keeps_every_raw_integer_of_its_channel_exactly(
    kind: str, scale: str, little: bool, data: st.DataObject
) -> None:
    channel = parse(f"holding:0:{kind}:{scale}", little=little)
    ends = st.sampled_from([channel.lowest, channel.highest, channel.highest - 1, 0, -1])
    raw = data.draw(ends | st.integers(channel.lowest, channel.highest))
    words = channel.words(raw)
    assert value(channel, words.__getitem__, little=little) == raw
    assert channel.raw(words) == raw


@pytest.mark.parametrize(
    ("text", "packing", "number", "raw"),
    [
        ("input:0:float32:0.001", ">f", 1.2344, 1234),
        ("input:0:float32:0.001", ">f", -1.2346, -1235),
        ("input:0:float64:0.5", ">d", 1e15, 2 * 10**15),
        ("input:0:float32:1", ">f", 2.5e9, 2_500_000_000),
        ("input:0:uint64", ">Q", 2**63 - 1, 2**63 - 1),
        ("input:0:int64", ">q", -(2**63), -(2**63)),
    ],
)
def test_the_raw_integer_of_a_float_is_its_value_divided_by_the_scale(
    text: str, packing: str, number: float, raw: int
) -> None:
    channel = parse(text)
    assert channel.raw(struct.unpack(f">{channel.cells}H", struct.pack(packing, number))) == raw


@pytest.mark.parametrize(
    ("text", "packing", "number", "words"),
    [
        ("input:0:float32:0.001", ">f", float("nan"), "input:0:float32:0.001 reads nan, for which there is no raw"),
        ("input:0:float32:0.001", ">f", float("-inf"), "input:0:float32:0.001 reads -inf"),
        ("input:0:float32:0.001", ">f", 1e30, "reads 1e[+]30, for which there is no raw integer"),
        ("input:0:float64:1e-9", ">d", 1e300, "reads 1e[+]300, for which there is no raw integer"),
        ("input:0:float64:1", ">d", 2.0**63, "for which there is no raw integer"),
        ("input:0:uint64", ">Q", 2**63, "9223372036854775808 does not fit input:0:uint64"),
    ],
)
def test_what_is_not_a_raw_integer_fails_for_its_channel_and_the_others_stand(
    text: str, packing: str, number: float, words: str
) -> None:
    channels = [parse(text), parse("input:4"), parse("input:5:int16")]
    (request,) = plan_reads(channels, bridge_gaps=True)
    wrong = struct.unpack(f">{channels[0].cells}H", struct.pack(packing, number))
    out = np.full(3, -99, np.int64)
    with pytest.raises(ChannelsFailed, match=words) as caught:
        request.decode([*wrong, *[0] * (4 - len(wrong)), 7, 65535], out)
    assert list(caught.value.causes) == [text]
    assert out.tolist() == [-99, 7, -1]


@pytest.mark.parametrize("raw", [2**23, -(2**23) - 1])
def test_a_value_that_a_float_cannot_carry_exactly_is_refused(raw: int) -> None:
    with pytest.raises(DriverError, match=f"{raw} does not fit holding:0:float32:0.1: it takes -8388608 to 8388607"):
        parse("holding:0:float32:0.1").words(raw)
