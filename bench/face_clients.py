"""A client of another project for each face, which takes all that the face tells, and the face's broker if it has one.

They are those of the tests. NotHere says which part is not installed.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import urllib.parse
import urllib.request
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bench.drivers.case import NotHere

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the helpers import one another from there

READY = 60.0
"""Time in s that a client has until it gets values."""
LOOKS = 10.0
"""Looks of a face at the machine, and of a client's subscription, a second."""
SCRAPES = """
global: {{scrape_interval: 1s, scrape_timeout: 1s}}
scrape_configs: [{{job_name: umo, static_configs: [{{targets: ["{target}"]}}]}}]
"""


class FaceClient(ABC):
    """`options`: those that the face needs, on the command line. `folder`: for its files."""

    face: str
    project: str
    """The client, and its broker."""
    rate = LOOKS
    """Times a second that it gets a value that changes."""
    takes_all = False
    """Whether it gets those that do not change, too."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.options: dict[str, object] = {"port": 0}
        self.closing = AsyncExitStack()
        """Ends what has begun."""

    @abstractmethod
    async def connect(self, address: str, station: str, paths: Sequence[str]) -> None:
        """Take the values of these paths from now on. `address`: as the face has said it."""

    @abstractmethod
    async def told(self) -> tuple[int, int]:
        """The number of values that it has been told so far, and of those that were told within 2 s."""

    async def ready(self) -> None:
        """Wait until values come. RuntimeError if they do not."""
        for _ in range(round(READY / 0.2)):
            if (await self.told())[0]:
                return
            await asyncio.sleep(0.2)
        raise RuntimeError(f"{self.project} gets no values from the face {self.face}")


class PrometheusClient(FaceClient):
    face, project, rate, takes_all = "prometheus", "Prometheus, a scrape a second", 1.0, True

    async def connect(self, address: str, station: str, paths: Sequence[str]) -> None:
        if (program := shutil.which("prometheus")) is None:
            raise NotHere("Debian's package prometheus")
        from helpers.mqtt import free_port

        self._port = free_port()
        config = self.folder / f"prometheus-{self._port}.yml"
        config.write_text(SCRAPES.format(target=urllib.parse.urlsplit(address).netloc))
        process = await asyncio.create_subprocess_exec(
            program, f"--config.file={config}", f"--storage.tsdb.path={self.folder / str(self._port)}",
            f"--web.listen-address=127.0.0.1:{self._port}", "--log.level=error",
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        self.closing.push_async_callback(process.wait)
        self.closing.callback(process.kill)

    async def told(self) -> tuple[int, int]:
        query = urllib.parse.quote('sum(count_over_time(umo_value{path=~"zones.*"}[1h]))')
        address = f"http://127.0.0.1:{self._port}/api/v1/query?query={query}"
        with suppress(OSError, ValueError):
            found = json.loads(await asyncio.to_thread(_fetched, address))["data"]["result"]
            count = int(found[0]["value"][1]) if found else 0
            return count, count
        return 0, 0


class OpcUaClient(FaceClient):
    face, project = "opcua", "node-opcua"

    async def connect(self, address: str, station: str, paths: Sequence[str]) -> None:
        from helpers.opcua import Node

        self._node = await _installed(Node.start)
        self.closing.push_async_callback(self._node.end, kill=True)
        for _ in range(round(READY / 0.5)):
            about = await self._node.ask("connect", url=address, station=station, user=None, security=None)
            if f"urn:umo:{station}" in about["namespaces"]:
                break
            await asyncio.sleep(0.5)
        await asyncio.sleep(2.0)  # the face has begun with the station: it adds its nodes
        interval = 1000 / LOOKS
        told = await self._node.ask("subscribe", names=list(paths), interval=interval, queue=10, count=True)
        if told["items"] != len(paths):
            raise RuntimeError(f"the face opcua lets {told['items']} of {len(paths)} values be monitored")

    async def told(self) -> tuple[int, int]:
        counted = await self._node.ask("counted")
        return counted["count"], counted["count"] - counted["late"]


class EpicsClient(FaceClient):
    face, project = "epics", "pvapy"

    def __init__(self, folder: Path) -> None:
        from helpers.epics import free_udp_port

        super().__init__(folder)
        self.options["search_port"] = free_udp_port()

    async def connect(self, address: str, station: str, paths: Sequence[str]) -> None:
        from helpers.epics import Pvapy, name_of

        search = SimpleNamespace(search_port=self.options["search_port"])
        self._client = await _installed(Pvapy.of, search)
        self.closing.push_async_callback(self._client.close)
        await self._client.order("monitor", names=[name_of(path, f"{station}:") for path in paths])

    async def told(self) -> tuple[int, int]:
        count = int(await self._client.order("counted"))
        return count, count


class SparkplugClient(FaceClient):
    face, project = "sparkplug", "sparkplug-payload with mqtt.js, mosquitto"

    def __init__(self, folder: Path) -> None:
        from helpers.mqtt import MOSQUITTO, Mosquitto

        super().__init__(folder)
        if MOSQUITTO is None:
            raise NotHere("Debian's package mosquitto")
        broker = Mosquitto(folder)
        self.closing.callback(broker.kill)
        self.options["port"] = self._port = broker.port
        self._count = 0

    async def connect(self, address: str, station: str, paths: Sequence[str]) -> None:
        from helpers.mqtt import SparkplugHost

        self._host = await _installed(SparkplugHost().connect, self._port, station)
        self.closing.push_async_callback(self._host.close)

    async def told(self) -> tuple[int, int]:
        heard, self._host.heard = self._host.heard, []
        self._count += sum(map(self._values_of, heard))
        return self._count, self._count

    def _values_of(self, message: dict[str, Any]) -> int:
        if message["kind"] != "NDATA":
            return 0
        return sum(each["name"].startswith("zones/") for each in message["metrics"])


class HomeAssistantClient(SparkplugClient):
    face, project = "homeassistant", "mqtt.js, mosquitto"

    def _values_of(self, message: dict[str, Any]) -> int:
        return message["kind"] == "plain" and "/value/zones/" in message["topic"]


CLIENTS: tuple[type[FaceClient], ...] = (
    PrometheusClient, OpcUaClient, EpicsClient, SparkplugClient, HomeAssistantClient,
)  # fmt: skip


async def _installed(make: Callable[..., Any], *given: object) -> Any:
    """What `make` returns; NotHere where a test would be skipped."""
    try:
        return await make(*given)
    except pytest.skip.Exception as error:
        raise NotHere(str(error)) from None


def _fetched(address: str) -> str:
    with urllib.request.urlopen(address, timeout=5) as answer:
        return str(answer.read().decode())
