"""Frames of a serial line: what is known for the answer to a request, though it came damaged."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pymodbus")

from umo.drivers.modbus.rtu_frame import has_come, is_answer


def summed(frame: bytes) -> bytes:
    """With its check sum, bit by bit as in Modbus over Serial Line V1.02, 6.2.2."""
    remainder = 0xFFFF
    for byte in frame:
        remainder ^= byte
        for _ in range(8):
            remainder = remainder >> 1 ^ (0xA001 if remainder & 1 else 0)
    return frame + remainder.to_bytes(2, "little")


@st.composite
def exchanges(draw: st.DrawFn) -> tuple[bytes, bytes]:
    """A request without its check sum, and the answer to it."""
    unit, function = draw(st.integers(1, 247)), draw(st.sampled_from([1, 3, 4, 6, 15, 16]))
    address, count = draw(st.integers(0, 65000)), draw(st.integers(1, 20))
    head = bytes([unit, function]) + address.to_bytes(2, "big")
    if draw(st.booleans()) and function != 6:
        return head + count.to_bytes(2, "big"), summed(bytes([unit, function | 0x80, draw(st.integers(1, 11))]))
    if function <= 4:
        size = (count + 7) // 8 if function == 1 else 2 * count
        data = draw(st.binary(min_size=size, max_size=size))
        return head + count.to_bytes(2, "big"), summed(bytes([unit, function, size]) + data)
    return head + count.to_bytes(2, "big"), summed(head + count.to_bytes(2, "big"))


@given(exchanges(), st.data())
def test_an_answer_with_one_damaged_byte_has_come(exchange: tuple[bytes, bytes], data: st.DataObject) -> None:
    request, answer = exchange
    assert is_answer(request, answer)
    place, wrong = data.draw(st.integers(0, len(answer) - 1)), data.draw(st.integers(1, 255))
    damaged = answer[:place] + bytes([answer[place] ^ wrong]) + answer[place + 1 :]
    refusal = answer[1] & 0x80 and place < 2  # it is as short as noise, and is known by both bytes
    assert has_come(request, damaged) or refusal


@given(exchanges(), st.binary(max_size=9), st.binary(max_size=9))
def test_an_answer_among_other_bytes_has_come(exchange: tuple[bytes, bytes], before: bytes, behind: bytes) -> None:
    request, answer = exchange
    assert has_come(request, before + answer + behind)


@given(exchanges(), exchanges())
def test_an_intact_frame_that_is_not_the_answer_is_no_sign_of_it(
    exchange: tuple[bytes, bytes], other: tuple[bytes, bytes]
) -> None:
    """A late answer to an earlier write begins like that to this one."""
    request, _ = exchange
    assert has_come(request, other[1]) == is_answer(request, other[1])
    moved = request[:2] + ((int.from_bytes(request[2:4], "big") ^ 1).to_bytes(2, "big")) + request[4:6]
    if request[1] >= 6:
        assert not has_come(request, summed(moved))


@given(exchanges(), st.binary(max_size=40))
def test_noise_is_no_sign_of_the_answer(exchange: tuple[bytes, bytes], noise: bytes) -> None:
    request, answer = exchange
    alike = sum(a == b for a, b in zip(noise, answer, strict=False)) >= 2
    if not alike and answer not in noise:
        assert not has_come(request, noise)
