"""Sparkplug while broker, face, station and host are killed at random, seen by a host that allows no mistake."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from helpers.mqtt import MOSQUITTO, Mosquitto
from helpers.strict_host import StrictHost
from umo.clients.faces.conformance.tried_machine import until

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(MOSQUITTO is None, reason="Debian's package mosquitto is not installed"),
]
ROUNDS = 70
"""About five minutes."""
RECOVERED = 60.0
"""Time in s within which data must flow again; a face tries its broker after 8 s at the latest."""
PRIMARY = "scada"


def birth(seq: int = 0, bd_seq: int = 1, **more: Any) -> dict[str, Any]:
    metrics = [
        {"name": "bdSeq", "value": bd_seq, "type": "Int64", "timestamp": 1},
        {"name": "Node Control/Rebirth", "value": False, "type": "Boolean", "timestamp": 1},
        {"name": "level", "alias": 1, "value": 1.0, "type": "Double", "timestamp": 1},
    ]
    return {"kind": "NBIRTH", "retain": False, "qos": 0, "seq": seq, "timestamp": 1, "metrics": metrics, **more}


def data(seq: int, **more: Any) -> dict[str, Any]:
    metric = {"alias": 1, "value": 1.0, "type": "Double", "timestamp": 1, **more}
    return {"kind": "NDATA", "retain": False, "qos": 0, "seq": seq, "timestamp": 1, "metrics": [metric]}


def death(bd_seq: int = 1) -> dict[str, Any]:
    metrics = [{"name": "bdSeq", "value": bd_seq, "type": "Int64", "timestamp": 1}]
    return {"kind": "NDEATH", "retain": False, "qos": 1, "metrics": metrics}


WRONG: dict[str, list[dict[str, Any]]] = {
    "seq 3 instead of 2": [birth(), data(1), data(3)],
    "seq 1 instead of 0": [birth(255), data(1)],
    "NDATA before NBIRTH": [birth(), death(), data(1)],
    "which was not in NBIRTH": [birth(), data(1, alias=9)],
    "type String instead of Double": [birth(), data(1, type="String")],
    "that of the session before": [birth(), death(), birth()],
    "without NDEATH": [birth(), birth(bd_seq=2)],
    "NBIRTH is retained": [birth(retain=True)],
    "NBIRTH has QoS 1": [birth(qos=1)],
}


@pytest.mark.parametrize("words", WRONG)
def test_the_host_objects(words: str) -> None:
    host = StrictHost()
    for message in WRONG[words]:
        host._take(message)
    assert any(words in each for each in host.objections), host.objections


def test_the_host_allows_a_session_that_is_right() -> None:
    host = StrictHost()
    for message in (data(7), birth(254), data(255), data(0), death(9), data(1), birth(), death(), birth(0, 2)):
        host._take(message)
    assert host.objections == []


class Plant:
    """Broker, station, face and host; each can be killed, and begins again."""

    def __init__(self, folder: Path) -> None:
        self.broker = Mosquitto(folder)
        self._folder = folder
        self._programs: dict[str, subprocess.Popen[bytes]] = {}
        self.host = StrictHost()
        self.objections: list[str] = []

    def begin(self, name: str) -> None:
        words = {
            "station": ["run", "ztheta", "--manual", "--realtime", "--no-record", "--no-plot", "--acknowledge"],
            "face": ["connect", "face", "sparkplug", "--commands", "--set", f"sparkplug.port={self.broker.port}",
                     "--set", f"sparkplug.primary={PRIMARY}"],
        }[name]  # fmt: skip
        log = (self._folder / f"{name}.log").open("ab")
        with log:
            command = [sys.executable, "-m", "umo_command", *words]
            self._programs[name] = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)

    async def begin_host(self) -> None:
        self.host = await StrictHost().connect(self.broker.port, "ztheta", PRIMARY)

    async def flows(self) -> None:
        """Data have come since now, and the host is content."""
        await until(lambda: self.host.is_born, RECOVERED)
        count = self.host.data
        await until(lambda: self.host.data > count + 10, RECOVERED)

    def _end(self, name: str) -> None:
        """Kill it with all its processes."""
        process = self._programs.pop(name)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    async def kill(self, name: str) -> None:
        if name == "broker":
            self.broker.kill()
            self.broker.start()
        elif name == "host":
            await self.end_host()
            await self.begin_host()
        else:
            self._end(name)
            self.begin(name)

    async def end_host(self) -> None:
        self.objections += self.host.objections
        await self.host.close()

    async def end(self) -> None:
        await self.end_host()
        for name in list(self._programs):
            self._end(name)
        self.broker.kill()

    def logs(self) -> str:
        return "\n".join((self._folder / f"{name}.log").read_text()[-2000:] for name in ("station", "face"))


@pytest.mark.full
@pytest.mark.parametrize("seed", [1])
def test_kills_at_random_lead_to_no_message_that_sparkplug_does_not_allow(tmp_path: Path, seed: int) -> None:
    choose = Random(seed)

    async def work() -> None:
        plant = Plant(tmp_path)
        pause: Callable[[], int] = lambda: choose.randrange(0, 30)  # noqa: E731
        try:
            await plant.begin_host()
            plant.begin("station")
            plant.begin("face")
            for number in range(ROUNDS):
                await plant.flows()
                count, more = plant.host.data, pause()
                await until(lambda c=count, m=more: plant.host.data >= c + m, RECOVERED)  # type: ignore[misc]
                victims = choose.sample(["broker", "face", "station", "host"], choose.choice((1, 1, 1, 2)))
                for name in victims:
                    await plant.kill(name)
                assert plant.objections + plant.host.objections == [], f"round {number}, before {victims}"
            await plant.flows()
        except TimeoutError:
            raise AssertionError(plant.logs()) from None
        finally:
            await plant.end()
        assert plant.objections == []

    asyncio.run(work())
