"""A message costs the face OPC UA no more than its bytes, whatever lengths it tells."""

from __future__ import annotations

import asyncio
import struct
import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import Client, ua
from asyncua.common.utils import Buffer, ServiceError
from asyncua.ua import ua_binary
from asyncua.ua.ua_binary import struct_from_binary, struct_to_binary, variant_from_binary, variant_to_binary
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.opcua_asyncua import Rig, run
from umo.clients.faces.opcua.ua_decoding import bound
from umo.clients.faces.opcua.ua_limits import MAX_ELEMENTS, MAX_MESSAGE

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")]
MANY = 3_000_000
"""As a length: takes seconds if it is believed."""


@pytest.fixture(autouse=True)
def decoding() -> None:
    bound()


def ints(*numbers: int) -> bytes:
    return struct.pack(f"<{len(numbers)}i", *numbers)


WITH_SHAPE, ARRAY = 0xC0, 0x80
NULL, INT32, BYTES, DATA, VARIANT = 0, 6, 15, 23, 24


@pytest.mark.smoke
@pytest.mark.parametrize(
    "sent",
    [
        bytes([ARRAY | NULL]) + ints(MANY) + bytes(100),
        bytes([ARRAY | NULL]) + ints(30) + bytes(100),
        bytes([ARRAY | VARIANT]) + ints(MANY) + bytes(100),
        bytes([ARRAY | BYTES]) + ints(300, -4) + bytes(100),
        bytes([ARRAY | BYTES]) + ints(300, 0, 0, -8) + bytes(100),
        bytes([ARRAY | VARIANT]) + ints(MAX_MESSAGE) + bytes(MAX_MESSAGE),
        bytes([ARRAY | DATA]) + ints(MAX_MESSAGE) + bytes(MAX_MESSAGE),
        bytes([ARRAY | VARIANT]) + ints(100) + 100 * (bytes([ARRAY | VARIANT]) + ints(1000) + bytes(1000)),
        bytes([WITH_SHAPE | INT32]) + ints(0, 1, 900_000),
        bytes([WITH_SHAPE | INT32]) + ints(1, 7, 2, 1, 900_000),
        bytes([WITH_SHAPE | INT32]) + ints(2, 7, 7, 2, -1, -2),
        bytes([WITH_SHAPE | INT32]) + ints(1, 7, 200, *[1] * 200),
        bytes([ARRAY | INT32]) + ints(-2) + bytes(100),
    ],
    ids=[
        "nulls", "few nulls", "too few bytes", "read again", "read again later", "a message of variants",
        "a message of values", "arrays of arrays", "a shape of nothing", "a shape of one", "a shape below zero",
        "a shape of many dimensions", "a length below zero",
    ],
)  # fmt: skip
def test_a_length_that_the_bytes_do_not_have_is_refused(sent: bytes) -> None:
    with pytest.raises((ServiceError, struct.error)):
        variant_from_binary(Buffer(sent))


@pytest.mark.smoke
def test_a_list_of_structures_without_fields_is_refused() -> None:
    with pytest.raises(ServiceError):
        ua_binary.from_binary(list[ua.Orientation], Buffer(ints(50) + bytes(60)))


@pytest.mark.smoke
@pytest.mark.parametrize(
    "value",
    [
        ua.Variant([1, 2, 3, 4, 5, 6], ua.VariantType.Int32, [2, 3]),
        ua.Variant([], ua.VariantType.Int32, [0, 3]),
        ua.Variant([], ua.VariantType.Variant, is_array=True),
        ua.Variant([ua.Variant(1.0), ua.Variant(["a", None])], ua.VariantType.Variant),
        ua.Variant([ua.Range(0, 1)] * 100, ua.VariantType.ExtensionObject),
        ua.Variant(["x"] * MAX_ELEMENTS, ua.VariantType.String),
        ua.Variant(None, ua.VariantType.String, is_array=True),
    ],
)  # fmt: skip
def test_an_array_comes_as_it_was_sent(value: ua.Variant) -> None:
    sent = variant_to_binary(value)
    assert variant_to_binary(variant_from_binary(Buffer(sent))) == sent


@pytest.mark.smoke
@settings(max_examples=300, deadline=None, database=None, derandomize=True)
@given(st.integers(0, 25), st.sampled_from((ARRAY, WITH_SHAPE)), st.lists(st.integers(-9, 9), min_size=1, max_size=40))
def test_an_array_has_no_more_elements_than_bytes(kind: int, form: int, words: list[int]) -> None:
    sent = bytes([kind | form]) + ints(*words)
    try:
        value = variant_from_binary(Buffer(sent)).Value
    except Exception:
        return
    assert value is None or len(ua.flatten(value)) <= len(sent)


PLACE = variant_to_binary(ua.Variant([0x11223344], ua.VariantType.Int32))
"""An array of one number; its bytes are replaced."""


async def before_any_session(rig: Rig, wrong: bytes) -> None:
    """Ask for the endpoints, with an array in the additional header. The connection ends."""
    client = Client(rig.face.address)
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    protocol: Any = client.uaclient.protocol
    request = ua.GetEndpointsRequest()
    protocol._setup_request_header(request.RequestHeader, 60.0)
    request.RequestHeader.AdditionalHeader = ua.LiteralOperand(variant_from_binary(Buffer(PLACE)))
    body = struct_to_binary(request)
    assert PLACE in body
    body = body.replace(PLACE, wrong + bytes(max(0, len(PLACE) - len(wrong))))
    protocol.transport.write(protocol._connection.message_to_binary(body, request_id=protocol._request_id + 1))
    async with asyncio.timeout(20.0):
        while not protocol.transport.is_closing():
            await asyncio.sleep(0)
    client.disconnect_socket()


def test_an_array_of_nulls_before_any_session_costs_its_connection_and_nothing_else() -> None:
    async def work(rig: Rig) -> None:
        await before_any_session(rig, bytes([ARRAY | NULL]) + ints(MANY))
        async with rig.client() as other:
            assert (await other.read("cell.level")).StatusCode.is_good()

    run(work)


def test_a_write_of_an_array_of_nulls_is_refused() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            protocol: Any = client.client.uaclient.protocol
            request = ua.WriteRequest()
            protocol._setup_request_header(request.RequestHeader, 60.0)
            value = ua.DataValue(variant_from_binary(Buffer(PLACE)))
            request.Parameters.NodesToWrite = [ua.WriteValue(rig.node("cell.level"), 13, None, value)]
            body = struct_to_binary(request).replace(PLACE, bytes([ARRAY | NULL]) + ints(MANY) + bytes(4))
            number = protocol._request_id = protocol._request_id + 1
            answer = protocol._callbackmap[number] = asyncio.get_running_loop().create_future()
            protocol.transport.write(protocol._connection.message_to_binary(body, request_id=number))
            data = await asyncio.wait_for(answer, 20.0)
            ua_binary.nodeid_from_binary(data)
            code = struct_from_binary(ua.ResponseHeader, data).ServiceResult
            assert code.name == "BadDecodingError"
            assert (await client.read("cell.level")).StatusCode.is_good()

    run(work)
