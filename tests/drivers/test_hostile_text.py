"""The text driver with devices that misbehave (hostile.py): it does not crash, hang or grow, and no wrong value
is ever read. Each answer names its channel, T3=..., so that an answer to another request can be told."""

from __future__ import annotations

import re
import socket
import tracemalloc
from collections.abc import Iterable
from itertools import count
from time import monotonic
from typing import Any

import numpy as np
import pytest

from helpers.peers.hostile import BEHAVIOURS, fuzz, hostile
from helpers.tiers import first, some
from umo.drivers.streams import hosts
from umo.drivers.streams.stream import Gone, TimedOut
from umo.drivers.text import Text
from umo.errors import ChannelsFailed, DriverError

TIMEOUT = 0.05
SHORT = {"late", "byte by byte", "cut", "noise before"}
"""Behaviours with tests of their own in `make test`; there the fuzzed ones have all of them."""
CHANNELS: dict[str, Any] = {"t{n}": {"ask": "T{n}?", "answer": "T{n}={} C", "scale": 0.01, "set": "T{n} {:.2f}"}}
TRUTH = {"t1": 10_125, "t2": -20_250, "t3": 31_375}
_SET = re.compile(rb"T(\d) (\S+)\n")
_ASK = re.compile(rb"T(\d)\?\n")
_IDENTIFY = re.compile(rb"\*IDN\?\n")


def test_each_address_of_a_host_gets_its_share_of_the_time_and_one_that_fails_ends_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        there = (socket.AF_INET, socket.SOCK_STREAM, 0, "", server.getsockname())
        silent, unsupported = (socket.AF_INET, socket.SOCK_STREAM, 0, "", "silent"), (99, 1, 0, "", ("::1", 5025, 0, 0))
        given, connected = [], hosts._connected

        def connect(place: Any, seconds: float) -> socket.socket:
            given.append(seconds)
            if place is silent:
                raise TimeoutError
            return connected(place, seconds)

        monkeypatch.setattr(hosts, "_connected", connect)

        def dial(*found: Any) -> None:
            monkeypatch.setattr(hosts, "_found", lambda *_: list(found))
            hosts.TcpDial("device", 5025)(monotonic() + 60.0).close()

        dial(unsupported, silent, there)
        dial(there)
        assert given == [pytest.approx(share, abs=5.0) for share in (20.0, 30.0, 60.0, 60.0)]
        for found, failed in (([unsupported, silent], TimedOut), ([silent, unsupported], Gone), ([], Gone)):
            with pytest.raises(failed):
                dial(*found)


def answer(data: bytes) -> tuple[int, bytes]:
    """The device: constants, a set that is acknowledged with its own text, an identification."""
    if found := _IDENTIFY.match(data):
        return found.end(), b"HOSTILE\n"
    if found := _ASK.match(data):
        return found.end(), b"T%s=%.2f C\n" % (found[1], TRUTH[f"t{int(found[1])}"] / 100)
    if found := _SET.match(data):
        return found.end(), b"SET T%s\n" % found[1]
    end = data.find(b"\n") + 1
    return end, b"ERR\n"


def driver_for(peer: Any, **options: Any) -> Text:
    place = {"serial": peer.path} if peer.path else {"host": "127.0.0.1", "port": peer.port}
    driver = Text(channels=CHANNELS, acknowledge="SET T*", errors=["ERR*"], **place, **options)
    driver.timeout = TIMEOUT
    return driver


def torment(driver: Text, calls: int, seconds: float) -> tuple[int, int]:
    """Calls of every kind; how many succeeded and failed. Every value that is read is right."""
    names = tuple(TRUTH)
    channels = tuple(map(driver.channel, names))
    out, good, bad = np.zeros(len(names), np.int64), 0, 0
    end = monotonic() + seconds
    for call in count():
        if (call >= calls or monotonic() > end) and (good or call > 20 * calls):  # more calls on a busy computer
            break
        out[:] = 0
        try:
            if call % 4 == 3:
                driver.write(channels[call % 3], call)
            elif call % 4 == 2:
                name = names[call % 3]
                assert driver.read(driver.channel(name)) == TRUTH[name]
            else:
                driver.read_many(channels, out)
                assert out.tolist() == list(TRUTH.values())
            good += 1
        except ChannelsFailed as error:
            for name, value in zip(names, out.tolist(), strict=True):
                assert name in error.causes or value == TRUTH[name]
            bad += 1
        except DriverError as error:
            assert "\n" not in str(error) and len(str(error)) < 400
            bad += 1
    return good, bad


def opened(driver: Text, tries: int = 50) -> Text:
    """`open` fails as any other call does; a machine would end here."""
    for _ in range(tries):
        try:
            driver.open()
        except DriverError:
            driver.close()
        else:
            return driver
    raise AssertionError("the device never let the driver in")


def run(script: Iterable[str], calls: int, *, line: bool, seconds: float = 20.0, **options: Any) -> tuple[int, int]:
    with hostile(answer, script, line=line) as peer:
        driver = opened(driver_for(peer, **options))
        try:
            return torment(driver, calls, seconds)
        finally:
            driver.close()


@pytest.mark.parametrize("behaviour", some(SHORT.__contains__, [name for name in BEHAVIOURS if name != "right"]))
def test_a_behaviour_over_tcp_never_gives_a_wrong_value(behaviour: str) -> None:
    good, _ = run(["right", "right", behaviour], 16, line=False)
    assert good


@pytest.mark.parametrize("behaviour", some(SHORT.__contains__, [name for name in BEHAVIOURS if name != "right"]))
def test_a_behaviour_on_a_serial_line_never_gives_a_wrong_value(behaviour: str) -> None:
    run(
        ["right", "right", "right", behaviour],
        12,
        line=True,
        quiet=0.02,
        identify={"ask": "*IDN?", "answer": "HOSTILE"},
    )


@pytest.mark.slow
@pytest.mark.parametrize("line", [False, True], ids=["tcp", "serial"])
@pytest.mark.parametrize("seed", first(1, [1998, 2026]))
def test_a_fuzzed_device_never_gives_a_wrong_value(line: bool, seed: int) -> None:
    options: dict[str, Any] = {"identify": {"ask": "*IDN?", "answer": "HOSTILE"}}
    good, bad = run(fuzz(seed, rights=0.8), 100_000, line=line, seconds=2.0, quiet=0.02 if line else 0.0, **options)
    assert good and bad


@pytest.mark.parametrize("behaviour", ["endless noise", "endless answers", "endless byte", "oversize"])
def test_an_endless_answer_does_not_make_the_driver_grow(behaviour: str) -> None:
    with hostile(answer, ["right", behaviour]) as peer:
        driver = opened(driver_for(peer))
        channel = driver.channel("t1")
        tracemalloc.start()
        try:
            for _ in range(12):
                try:
                    assert driver.read(channel) == TRUTH["t1"]
                except DriverError:
                    continue
            ours = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, "*/umo/drivers/*")])
        finally:
            tracemalloc.stop()
            driver.close()
        assert sum(trace.size for trace in ours.statistics("filename")) < 100_000


@pytest.mark.parametrize(
    "sent",
    [b"T1=\x00101.25 C\n", b"T1=\xc3\x28 C\n", b"T1=101.25 C\x00\n", b"T1=9e37 C\n", b"T1=nan C\n", b"T1=1e99999 C\n"],
)
def test_bytes_that_are_no_text_or_no_number_are_never_a_value(sent: bytes) -> None:
    with hostile(lambda data: (data.find(b"\n") + 1, sent), ["right"]) as peer:
        driver = opened(driver_for(peer, encoding="utf-8"))
        with pytest.raises(DriverError):
            driver.read(driver.channel("t1"))
        driver.close()
