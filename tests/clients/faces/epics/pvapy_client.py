"""pvapy as a client, commanded by JSON lines: {"id": 1, "do": "get", "name": "plant:cell:level"}."""

from __future__ import annotations

import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pvaccess as pva

READ_TIMEOUT, WRITE_TIMEOUT = 1.0, 6.0
TYPES = {bool: pva.BOOLEAN, int: pva.INT, float: pva.DOUBLE, str: pva.STRING}
own = threading.local()
"""Channels of this thread."""
seen: list[Any] = []
"""Channels that are monitored."""
counting = threading.Lock()
told = 0
"""The number of their changes so far."""


def channel(name: str, timeout: float) -> pva.Channel:
    channels = vars(own).setdefault("channels", {})
    if (name, timeout) not in channels:
        channels[name, timeout] = pva.Channel(name)
        channels[name, timeout].setTimeout(timeout)
    return channels[name, timeout]


def get(name: str) -> Any:
    found = channel(name, READ_TIMEOUT).get("field()").toDict()
    return {key: each for key, each in found.items() if key != "control"}


def put(name: str, value: Any, block: bool = False) -> None:
    channel(name, WRITE_TIMEOUT).put(value, ("record[block=true]" if block else "") + "field(value)")


def call(name: str, arguments: dict[str, Any]) -> Any:
    shape: dict[str, Any] = {"scheme": pva.STRING, "path": pva.STRING}
    given: dict[str, Any] = {"scheme": "pva", "path": name}
    if arguments:
        shape["query"] = {key: TYPES[type(each)] for key, each in arguments.items()}
        given["query"] = arguments
    client = pva.RpcClient(name)
    client.setTimeout(WRITE_TIMEOUT)
    return client.invoke(pva.PvObject(shape, given, "epics:nt/NTURI:1.0")).toDict().get("value")


def monitor(names: list[str]) -> None:
    """See all changes of these from now on."""
    for name in names:
        each = pva.Channel(name)
        each.monitor(count, "field()")
        seen.append(each)


def count(value: Any) -> None:
    global told
    with counting:
        told += 1


ORDERS = {"get": get, "put": put, "call": call, "monitor": monitor, "counted": lambda: told}


def carry_out(order: dict[str, Any]) -> None:
    number, do = order.pop("id"), order.pop("do")
    try:
        answer: dict[str, Any] = {"id": number, "result": ORDERS[do](**order)}
    except Exception as error:
        answer = {"id": number, "error": str(error)}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    with ThreadPoolExecutor(8) as pool:
        for line in sys.stdin:
            pool.submit(carry_out, json.loads(line))
