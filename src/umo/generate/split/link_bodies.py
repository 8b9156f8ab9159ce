"""The bodies of the frames on the link: those of the host's requests, and those of the controller's answers.

docs/split-protocol.md describes them. Numbers begin with the least significant byte."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from umo.errors import DriverError
from umo.generate.split.part_plan import PartPlan, bits_of, share_of

VERSION = 2


class FrameKind(IntEnum):
    """The first byte of a body."""

    HELLO = 1
    WELCOME = 2
    START = 3
    EXCHANGE = 4
    STOP = 5
    STATE = 6
    REFUSED = 7


class FrameItem(IntEnum):
    """The kind of an item of a START or an EXCHANGE."""

    FIELD = 1
    COMMAND = 2
    REFERENCE = 3
    CLEAR = 4
    ACKNOWLEDGE = 5
    PLANNED = 6
    GIVEN = 7


class ControllerMode(IntEnum):
    """The mode of the controller."""

    RESTING = 0
    RUNNING = 1
    FAULTED = 2
    HOST_GONE = 3


HELLO, WELCOME = Struct("<BI"), Struct("<BIBIBH")
HEAD, ITEM, STATE = Struct("<BHH"), Struct("<BH"), Struct("<BHHBhhIHBB")


REFUSALS = {
    1: "the controller has another host",
    2: "this process and the controller's program belong to different users",
}
"""Reasons why a controller closes the line to a host immediately."""


class HostRefused(DriverError):
    """Raised if the controller has another host, or does not accept this computer as its host."""


def check_refused(body: bytes, name: str) -> None:
    """Raise HostRefused if this body is a refusal. The error names the controller."""
    if len(body) == 2 and body[0] == FrameKind.REFUSED:
        raise HostRefused(f"the controller {name} refuses: {REFUSALS.get(body[1], f'reason {body[1]}')}")


class Welcome(NamedTuple):
    """The answer of a controller to HELLO."""

    kind: int
    nonce: int
    version: int
    hash: int
    real_size: int
    session: int


class ControllerState(NamedTuple):
    """The state of a controller, as it reports it."""

    session: int
    heard: int
    """The number of the host's last frame that the controller has carried out."""
    mode: ControllerMode
    fault: int
    fault_object: int
    number: int
    """The number of the controller's periods since the start, modulo 2**32."""
    asks: int
    """The number of the request by which the controller asks the host to plan a motion, or 0 if there is none."""
    call: int
    """The index of the requested call in `Translation.host_calls`."""
    numbers: Sequence[float]
    raws_in: Sequence[int]
    failed: Sequence[bool]
    pending: Sequence[float]
    raws_out: Sequence[int]
    inhibited: Sequence[bool]
    equipment: Sequence[int]
    """The number of the fault of each equipment, or 0 if it has none."""
    fields: bytes
    """The bytes of the fields that the controller changes, one after the other."""


def hello(nonce: int) -> bytes:
    return HELLO.pack(FrameKind.HELLO, nonce)


def welcome_of(body: bytes) -> Welcome | None:
    """Return a WELCOME, or None for any other frame."""
    if len(body) != WELCOME.size or body[0] != FrameKind.WELCOME:
        return None
    return Welcome(*WELCOME.unpack(body))


def item(kind: FrameItem, number: int, data: bytes = b"") -> bytes:
    return ITEM.pack(kind, number) + data


def request(
    kind: FrameKind, session: int, number: int, inhibited: Iterable[bool], items: Iterable[bytes] = ()
) -> bytes:
    """Return the body of a START, an EXCHANGE or a STOP. A STOP has neither bits nor items."""
    if kind is FrameKind.STOP:
        return HEAD.pack(kind, session, number & 0xFFFF)
    bits = list(inhibited)
    packed = sum(1 << place for place, yes in enumerate(bits) if yes).to_bytes(share_of(len(bits)), "little")
    return b"".join((HEAD.pack(kind, session, number & 0xFFFF), packed, *items))


class StateReader:
    """Reads the STATE frames of one part."""

    def __init__(self, plan: PartPlan) -> None:
        self._inputs, self._outputs = plan.model.inputs, len(plan.model.outputs)
        real = "d" if plan.real_size == 8 else "f"
        bits_in, bits_out = bits_of(self._inputs), bits_of(self._outputs)
        equipment = len(plan.model.equipment)
        parts = f"2{real}{self._inputs}i{bits_in}s{self._outputs}{real}{self._outputs}i{bits_out}s{equipment}h"
        self._objects = Struct(f"<{parts}")
        self._size = STATE.size + self._objects.size + sum(each.size for each in plan.fields if each.changes)

    def read(self, body: bytes) -> ControllerState | None:
        """Return the state, or None if this is not a STATE of this part."""
        if len(body) != self._size or body[0] != FrameKind.STATE or body[5] not in ControllerMode.__members__.values():
            return None
        _, session, heard, mode, fault, fault_object, number, asks, call, count = STATE.unpack_from(body)
        numbers, found = (each := self._objects.unpack_from(body, STATE.size))[:2], each[2:]
        inputs, outputs = self._inputs, self._outputs
        at = inputs + 1 + outputs
        return ControllerState(
            session,
            heard,
            ControllerMode(mode),
            fault,
            fault_object,
            number,
            asks,
            call,
            numbers[:count],
            found[:inputs],
            _bits(found[inputs], inputs),
            found[inputs + 1 : at],
            found[at : at + outputs],
            _bits(found[at + outputs], outputs),
            found[at + outputs + 1 :],
            body[STATE.size + self._objects.size :],
        )


def _bits(data: bytes, count: int) -> list[bool]:
    whole = int.from_bytes(data, "little")
    return [bool(whole >> place & 1) for place in range(count)]
