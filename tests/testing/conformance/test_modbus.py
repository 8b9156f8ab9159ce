"""The conformance kit on the Modbus driver: a device on libmodbus, on TCP and as units of a serial line."""

from __future__ import annotations

import os
import select
import threading
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from conformance.subjects import off_cycle
from helpers.peers.modbus_device import Peer, running
from helpers.peers.modbus_map import coil, holding
from helpers.tiers import first, named
from umo.drivers.modbus import Modbus
from umo.testing.conformance import Input, Output, PtyTap, Subject, TcpTap, conform

pytest.importorskip("pymodbus")
pytest.importorskip("serial")
FEW = 300
"""Cycles, where the 10,000 of TCP would add nothing but time."""
KEPT = 50
"""Levels of an output: few, as the kit watches the memory of this process."""
OUTPUTS = (
    Output("holding:0", 5, 0, 65535),
    Output("holding:1:int16", 0, -32768, 32767),
    Output("coil:3", 0, 0, 1),
)
WIDE = (Output("holding:8:int32", 0, -(2**31), 2**31 - 1), Output("holding:12:float32:0.1", 0, -(2**23), 2**23 - 1))
INPUTS = (Input("input:7"), Input("input:9:int32"), Input("discrete:1"))
LOOPS = (("holding:0", "holding:0"), ("coil:3", "coil:3"))
REFUSED = ("holding:600", "input:600", "coil:5000")


class Levels:
    """The levels of the coils and holding registers of a device, from what it logs before it answers. A thread reads
    the log, so that it never fills the pipe. It has a descriptor of its own, as the number of one that is closed
    elsewhere may soon be that of the next device."""

    def __init__(self, peer: Peer) -> None:
        self._pipe = os.dup(peer._pipe)
        self._ended = False
        self._levels: dict[tuple[str, int], deque[int]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._lock = threading.Lock()
        self._begun = b""
        """A line of the log whose end has not come yet."""
        threading.Thread(target=self._read, daemon=True).start()

    def __call__(self, text: str) -> list[int]:
        """Of a channel with one cell, as Subject.levels has them."""
        table, address, *kind = text.split(":")
        with self._lock:
            self._take()  # the thread may have had no turn yet
            kept = self._levels[table, int(address)] or deque([(coil if table == "coil" else holding)(int(address))])
            found = list(kept)
            self._levels[table, int(address)] = deque(found[-1:], maxlen=KEPT)
        return [raw - 65536 if kind == ["int16"] and raw > 32767 else raw for raw in found]

    def _read(self) -> None:
        with suppress(OSError, ValueError):  # the log has ended meanwhile
            while not self._ended:
                select.select([self._pipe], [], [])
                with self._lock:
                    self._take()

    def _take(self) -> None:
        """Note what is logged now."""
        while not self._ended and select.select([self._pipe], [], [], 0)[0]:
            if more := os.read(self._pipe, 65536):
                *lines, self._begun = (self._begun + more).split(b"\n")
                for line in lines:
                    self._note(line.decode().split())
            else:
                self._ended = True
                os.close(self._pipe)

    def _note(self, words: list[str]) -> None:
        if words[:1] != ["request"]:
            return
        function, (address, _, *values) = int(words[1].rpartition(":")[2]), map(int, words[2:])
        table = "coil" if function in (5, 15) else "holding"
        for i, value in enumerate(values):
            self._levels[table, address + i].append(value)


@contextmanager
def on_tcp(**options: bool) -> Iterator[Subject]:
    with running() as peer, TcpTap("127.0.0.1", peer.port) as tap:
        yield Subject(
            name="modbus, TCP" + ", read_write" * bool(options),
            make=lambda: Modbus(host=tap.host, port=tap.port, **options),
            direct=lambda: Modbus(port=peer.port, **options),
            outputs=OUTPUTS,
            inputs=INPUTS,
            loopbacks=LOOPS,
            refused=REFUSED,
            levels=Levels(peer),
            line=tap,
            timeout=0.1,
            device="libmodbus on TCP",
        )


@contextmanager
def on_a_line() -> Iterator[Subject]:
    with running("rtu") as peer, PtyTap(peer.path) as tap:
        yield Subject(
            name="modbus, serial RTU",
            make=lambda: Modbus(serial=tap.serial, baudrate=115200, unit=2, recovery="50 ms"),
            outputs=OUTPUTS,
            inputs=INPUTS,
            loopbacks=LOOPS,
            refused=REFUSED,
            levels=Levels(peer),
            line=tap,
            checksum=True,
            timeout=0.1,
            device="libmodbus on a pseudo-terminal",
        )


@pytest.mark.parametrize("options", first(1, [{"read_write": True}, {}]))
def test_the_driver_conforms_on_tcp(options: dict[str, bool], rules: list[str] | None) -> None:
    with on_tcp(**options) as subject:
        certificate = conform(subject, cycles=FEW, only=rules)
    assert certificate.passed, certificate


@pytest.mark.full
@pytest.mark.parametrize("way", first(1, named(["", "off the cycle"], [lambda subject: subject, off_cycle])))
def test_the_driver_conforms_on_a_serial_line(rules: list[str] | None, way: Callable[[Subject], Subject]) -> None:
    with on_a_line() as subject:
        certificate = conform(way(subject), cycles=FEW, only=rules)
    assert certificate.passed, certificate


def test_wide_outputs_conform(rules: list[str] | None) -> None:
    with running("quiet") as peer:
        subject = Subject(
            name="modbus, TCP, 32 bits",
            make=lambda: Modbus(port=peer.port),
            outputs=WIDE,
            inputs=INPUTS,
            loopbacks=tuple((output.channel, output.channel) for output in WIDE),
            timeout=0.1,
            device="libmodbus on TCP",
        )
        certificate = conform(subject, cycles=FEW, only=rules)
    assert certificate.passed, certificate
