"""A process variable: a value in one of EPICS's normative types, and the channels through which clients use it."""

from __future__ import annotations

import threading
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from p4p import Type, Value
from p4p.nt import NTEnum, NTScalar
from p4p.nt.common import alarm, timeStamp
from p4p.server.raw import SharedPV

from umo.clients.faces.face import User

CarryOut = Callable[[User, Any], Awaitable[Any]]
"""Function that carries out a put or a call of a user. Its second argument is the value of the put, or the arguments of
the call."""
TYPES: Mapping[str, Type] = {
    "d": NTScalar.buildType("d", display=True, control=True, form=True),
    "i": NTScalar.buildType("i", display=True, form=True),
    "s": NTScalar.buildType("s", display=True),
    "enum": NTEnum.buildType(extra=[("descriptor", "s")]),
}
"""Normative types by the code of the value: a number, an integer, a string, one name of a list."""
INVALID, UNDEFINED = 3, 6
"""Severity and status of a variable without a value."""


class ProcessVariable:
    """One variable. `write` carries out a put and `call` an RPC; without them a put or an RPC is refused. `kept_up` is
    True if a written value is held while the channel of its client is open. Each client then has a separate channel, so
    that its end is noticed."""

    def __init__(
        self,
        value: Value,
        write: CarryOut | None = None,
        call: CarryOut | None = None,
        *,
        kept_up: bool = False,
    ) -> None:
        self.value = value
        """The initial value. If `kept_up` is True, it is updated to the last value sent."""
        self.write, self.call, self.kept_up = write, call, kept_up
        self.channels: list[SharedPV] = []
        self._lock = threading.Lock()
        """Lock that is held while `channels` or `value` changes, because p4p's threads add channels."""

    def show(self, fields: Mapping[str, Any]) -> None:
        """Send new values of fields to the clients."""
        with self._lock:
            channels = tuple(self.channels)
            for name, each in fields.items() if self.kept_up else ():
                self.value[name] = each
        for channel in channels:
            channel.post(Value(self.value.type(), fields))

    def add_channel(self, handler: Any) -> SharedPV:
        """Add a channel, and return it with the last value."""
        with self._lock:
            channel = SharedPV(handler=handler, initial=Value(self.value.type(), self.value.todict()))
            self.channels.append(channel)
        return channel

    def remove_channel(self, channel: SharedPV) -> None:
        with self._lock:
            if channel in self.channels:
                self.channels.remove(channel)

    def take_channels(self) -> list[SharedPV]:
        """Return all channels and forget them."""
        with self._lock:
            channels, self.channels = self.channels, []
        return channels


def scalar(value: float | int | str, code: str = "d", **about: Any) -> Value:
    """Return a normative scalar with the present time. `about`: the fields of `display`."""
    return Value(TYPES[code], {"value": value, "display": about, "timeStamp": _now()})


def choice(index: int, choices: Sequence[str], about: str = "") -> Value:
    """Return a normative enumeration."""
    what = {"index": index, "choices": list(choices)}
    return Value(TYPES["enum"], {"value": what, "descriptor": about, "timeStamp": _now()})


def undefined(value: Value) -> Value:
    """Return a value of the same type that is marked as undefined."""
    value["alarm"] = {"severity": INVALID, "status": UNDEFINED, "message": "no value yet"}
    return value


def _now() -> dict[str, int]:
    return {"secondsPastEpoch": int(time.time())}


def pvi(entries: Mapping[str, Mapping[str, str]]) -> Value:
    """Return the PVI structure of one device: each entry with its access (r, rw or x; d for a device) and its
    variable."""
    shape = [(name, ("S", None, [(access, "s") for access in entry])) for name, entry in entries.items()]
    fields = [("value", ("S", None, shape)), ("alarm", alarm), ("timeStamp", timeStamp)]
    return Value(Type(fields, id="epics:nt/NTPVI:1.0"), {"value": entries})


def result(value: Any) -> Value:
    """Return the result of a call as a scalar. It is JSON if it is neither a number nor a string."""
    code = {bool: "?", int: "l", float: "d"}.get(type(value), "s")
    if code == "s" and not isinstance(value, str):
        import json

        value = "" if value is None else json.dumps(value)
    return Value(NTScalar.buildType(code), {"value": value})
