"""A broker, and a host application of npm in a process of its own, as the conformance kit for faces needs it."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
import time
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any, Self

from helpers import npm
from umo.clients.faces.conformance import ForeignClient, RefusedByFace, Seen
from umo.clients.faces.conformance.client import Grade

FOLDER = Path(__file__).parents[1] / "clients" / "faces" / "mqtt"
MOSQUITTO = shutil.which("mosquitto") or next((str(p) for p in [Path("/usr/sbin/mosquitto")] if p.exists()), None)
NOTHING = Seen(None, Grade.NONE)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Mosquitto:
    """A broker on a port of this computer, which can be killed and started again."""

    def __init__(self, folder: Path, settings: str = "allow_anonymous true\n") -> None:
        self.port = free_port()
        self._config = folder / f"mosquitto-{self.port}.conf"
        self._config.write_text(f"listener {self.port} localhost\n{settings}")
        self.start()

    def start(self) -> None:
        assert MOSQUITTO
        self._process = subprocess.Popen([MOSQUITTO, "-c", str(self._config)], stderr=subprocess.DEVNULL)
        for _ in range(1000):
            try:
                socket.create_connection(("127.0.0.1", self.port), 1).close()
                return
            except OSError:
                select_pause()
        raise AssertionError("mosquitto does not begin")

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


def select_pause() -> None:
    """Wait 10 ms."""
    import select

    select.select([], [], [], 0.01)


class SparkplugHost(ForeignClient):
    """Sees what the npm package sparkplug-payload decodes; aliases and deaths are kept as a host does."""

    def __init__(self, user: str = "ann") -> None:
        self.user, self._numbers = user, count(1)
        self.heard: list[dict[str, Any]] = []
        self._names: dict[int, str] = {}
        self._metrics: dict[str, dict[str, Any]] = {}
        self._waiting: dict[str, asyncio.Future[Any]] = {}
        self.alive = False

    async def connect(self, port: int, node: str = "plant", primary: str = "") -> Self:
        modules = await asyncio.to_thread(npm.modules, FOLDER)
        self._process = await asyncio.create_subprocess_exec(
            "node", str(FOLDER / "client.mjs"), str(modules), str(port), "umo", node, primary,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=1 << 24,
        )  # fmt: skip
        self._reading = asyncio.create_task(self._read_lines())
        return self

    async def _read_lines(self) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            self._take(json.loads(line))

    def _take(self, message: dict[str, Any]) -> None:
        self.heard.append({**message, "at": time.time()})
        if message["kind"] == "NBIRTH":
            self.alive, self._metrics = True, {}
            self._names = {each["alias"]: each["name"] for each in message["metrics"] if "alias" in each}
        elif message["kind"] == "NDEATH":
            self.alive = False
        for each in message.get("metrics", []):
            name = each.get("name") or self._names.get(each.get("alias"), "")
            each["name"] = name
            properties = each.get("properties", {})
            if each.get("isHistorical"):
                continue
            kept = self._metrics.get(name, {}).get("properties", {})
            self._metrics[name] = {**each, "properties": {**kept, **properties}}
            if name.startswith("Node Control/") and "request" in properties:
                self._answer(name, each["value"], properties["request"]["value"])

    def _answer(self, name: str, text: str, request: str) -> None:
        waiting = self._waiting.pop(request, None)
        if waiting is not None and not waiting.done():
            if name.endswith("Refusal"):
                waiting.set_exception(RefusedByFace(text))
            else:
                waiting.set_result(json.loads(text))

    async def read(self, name: str) -> Seen:
        metric = self._metrics.get(name.replace(".", "/"))
        if metric is None:
            return NOTHING
        about = {key: each["value"] for key, each in metric["properties"].items()}
        states = {int(number): each["value"] for number, each in about.get("states", {}).items()}
        grade = Grade.GOOD if about["Quality"] == 192 and self.alive else Grade.DOUBTFUL
        if metric["value"] is None:
            grade = Grade.NONE
        return Seen(
            metric["value"], grade, metric["timestamp"] / 1000, about.get("engUnit"), about.get("engLow"),
            about.get("engHigh"), states,
        )  # fmt: skip

    def send(self, line: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(line).encode() + b"\n")

    async def heard_by_broker(self) -> None:
        """The broker has all that was sent before."""
        self.send({"topic": (topic := f"umo/here/{next(self._numbers)}"), "text": ""})
        async with asyncio.timeout(10.0):
            while not any(each.get("topic") == topic for each in self.heard):
                await asyncio.sleep(0.005)

    async def ask(self, metric: str, value: Any, kind: str) -> Any:
        number = f"{id(self)}-{next(self._numbers)}"
        waiting = self._waiting[number] = asyncio.get_running_loop().create_future()
        properties = {"user": self.user, "request": number}
        texts = {key: {"type": "String", "value": text} for key, text in properties.items()}
        self.send({"metrics": [{"name": metric, "type": kind, "value": value, "properties": texts}]})
        return await asyncio.wait_for(waiting, 10.0)

    async def tune(self, path: str, value: Any) -> None:
        if value != value:  # JSON has no NaN: as text
            await self.ask(f"tunable:{path.replace('.', '/')}", "nan", "String")
            return
        await self.ask(f"tunable:{path.replace('.', '/')}", value, "Double")

    async def write(self, path: str, value: Any) -> None:
        await self.ask(path.replace(".", "/"), value, "Double")

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        return await self.ask(f"action:{path.replace('.', '/')}", json.dumps(arguments), "String")

    async def mode(self, mode: str) -> None:
        await self.ask("run:mode", mode, "String")

    async def close(self) -> None:
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()
        self._reading.cancel()
