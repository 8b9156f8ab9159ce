"""Open drivers of Modbus, with devices of libmodbus on the other end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from helpers.peers.modbus_device import PATIENT, Peer, running
from umo.drivers.modbus import Modbus

Start = Callable[..., tuple[Modbus, Peer]]


@contextmanager
def opened(port: int, **options: Any) -> Iterator[Modbus]:
    """A driver that is connected to a server on this computer."""
    driver = Modbus(port=port, **options)
    driver.timeout = PATIENT
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


@contextmanager
def starting() -> Iterator[Start]:
    """start(*faults, **options): an open driver and its device; all end with the block."""
    with ExitStack() as stack:

        def start(*faults: str, **options: Any) -> tuple[Modbus, Peer]:
            peer = stack.enter_context(running(0, *faults))
            return stack.enter_context(opened(peer.port, **options)), peer

        yield start


def read(driver: Modbus, *texts: str) -> list[int]:
    """Raw integers of these channels."""
    out = np.full(len(texts), -99, np.int64)
    driver.read_many([driver.channel(text) for text in texts], out)
    return out.tolist()


def write(driver: Modbus, raws: dict[str, int]) -> None:
    """Raw integers by their channels."""
    driver.write_many([driver.channel(text) for text in raws], np.array(list(raws.values()), np.int64))
