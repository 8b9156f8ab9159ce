"""EPICS clients of other projects, each in a process of its own: pvapy, and ophyd-async with bluesky."""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from helpers.foreign_python import foreign_python
from umo.clients.faces.conformance import ForeignClient, RefusedByFace, Seen
from umo.clients.faces.conformance.client import Grade
from umo.clients.faces.epics import Epics

FOREIGN = Path(__file__).parents[1] / "clients" / "faces" / "epics"
"""Requirements and programs of the clients."""
GRADES = {0: Grade.GOOD, 1: Grade.DOUBTFUL, 2: Grade.DOUBTFUL, 3: Grade.NONE}


def clients_python() -> str:
    """The Python of an environment that has the clients."""
    return foreign_python(FOREIGN / "requirements.txt", "the EPICS clients")


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def epics() -> Epics:
    return Epics(port=0, search_port=free_udp_port())


def environment(face: Any) -> dict[str, str]:
    """For a client of what has this port to search."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("EPICS_", "PYTHON"))} | {
        "EPICS_PVA_ADDR_LIST": "127.0.0.1",
        "EPICS_PVA_AUTO_ADDR_LIST": "NO",
        "EPICS_PVA_BROADCAST_PORT": str(face.search_port),
    }


def name_of(item: str, prefix: str = "plant:") -> str:
    """The variable of an item of the kit."""
    kind, _, path = item.rpartition(":")
    path = f"run.{path}" if kind == "run" else path if kind in ("", "tunable") else f"{path}.{kind}"
    return prefix + re.sub("[^A-Za-z0-9_.]", lambda each: f"_x{ord(each[0]):04X}_", path).replace(".", ":")


class Pvapy(ForeignClient):
    """A process with pvapy."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process, self._numbers = process, count()
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._reading = asyncio.create_task(self._read_answers())

    @classmethod
    async def of(cls, face: Any, user: str = "") -> Pvapy:
        """`user`: pvAccess tells the account of the process, whoever it says it is."""
        program = str(FOREIGN / "pvapy_client.py")
        process = await asyncio.create_subprocess_exec(
            clients_python(), program, env=environment(face), limit=1 << 20,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        client = cls(process)
        await client.read("run:mode")  # pvapy is imported and has found the server: both take long
        return client

    async def _read_answers(self) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            answer = json.loads(line)
            self._answers.pop(answer["id"]).set_result(answer)

    async def order(self, do: str, **more: Any) -> Any:
        """RefusedByFace with the words that the client has."""
        number = next(self._numbers)
        self._answers[number] = asyncio.get_running_loop().create_future()
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"id": number, "do": do, **more}).encode() + b"\n")
        answer = await self._answers[number]
        if "error" in answer:
            raise RefusedByFace(answer["error"])
        return answer["result"]

    async def get(self, name: str) -> dict[str, Any]:
        return dict(await self.order("get", name=name))

    async def put(self, name: str, value: Any, **more: Any) -> None:
        await self.order("put", name=name, value=value, **more)

    async def read(self, name: str) -> Seen:
        try:
            found = await self.get(name_of(name))
        except RefusedByFace:  # there is no channel
            return Seen(None, Grade.NONE)
        value, grade, stamp = found["value"], GRADES[found["alarm"]["severity"]], found["timeStamp"]
        moment = stamp["secondsPastEpoch"] + stamp["nanoseconds"] / 1e9
        if isinstance(value, dict):
            shown = None if grade is Grade.NONE else value["choices"][value["index"]]
            return Seen(shown, grade, moment, states=dict(enumerate(value["choices"])))
        about = found["display"]
        return Seen(
            None if grade is Grade.NONE else value, grade, moment,
            about["units"], about["limitLow"], about["limitHigh"],
        )  # fmt: skip

    async def tune(self, path: str, value: Any) -> None:
        await self.put(name_of(path), value)

    async def write(self, path: str, value: Any) -> None:
        await self.put(name_of(path), value)

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        return await self.order("call", name=name_of(path), arguments=dict(arguments))

    async def mode(self, mode: str) -> None:
        choices = (await self.get(name_of("run:mode")))["value"]["choices"]
        await self.put(name_of("run:mode"), choices.index(mode))

    async def close(self) -> None:
        if self._process.returncode is None:
            self._process.kill()
            await self._process.wait()
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)
        for each in self._answers.values():
            each.cancel()


class ServedZtheta:
    """The z-theta station in manual mode and real time, and its face, each in a process of its own."""

    def __init__(self) -> None:
        self.search_port = free_udp_port()
        name = "umo.clients.faces.epics:Epics"
        options = {"port": 0, "search_port": self.search_port}
        more = [word for each in options.items() for word in ("--set", "{}.{}={}".format(name, *each))]
        self.station = program("run", "ztheta", "--manual", "--no-record", "--no-plot")
        self.face = program("connect", "face", name, "--commands", *more)
        assert self.face.stdout is not None
        said = ""
        while "ztheta (simulated)" not in said:  # it has found the station
            line = self.face.stdout.readline()
            assert line, said
            said += line

    def end(self) -> None:
        for each in (self.face, self.station):
            each.terminate()
            each.communicate(timeout=30)


def program(*words: str) -> subprocess.Popen[str]:
    """`umo` with these words."""
    command = [sys.executable, "-u", "-m", "umo_command", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
