"""A client of node-opcua in a process of its own, as the conformance kit for faces needs it."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AttributeValue, NodeData

from helpers import npm
from umo.clients.faces import face_users as users
from umo.clients.faces.conformance import ForeignClient, RefusedByFace, Seen
from umo.clients.faces.conformance.client import Grade
from umo.clients.faces.opcua import OpcUa

FOLDER = Path(__file__).parents[1] / "clients" / "faces" / "opcua"
PASSWORDS = {"ann": "hunter2", "bob": 'sw"ordfish'}


STANDARD: dict[Any, NodeData] = {}
"""The nodes of the standards, as the first server has filled them in."""


class QuickOpcUa(OpcUa):
    """The face without the 1.2 s in which each server fills in the standards: they are copied."""

    async def _fill(self, server: Any) -> None:
        inner = server.iserver
        if not STANDARD:
            await super()._fill(server)
            STANDARD.update(copied(inner.aspace._nodes))
            return
        inner.aspace._nodes.update(copied(STANDARD))
        await inner.history_manager.init()


def copied(nodes: Mapping[Any, NodeData]) -> dict[Any, NodeData]:
    made = {}
    for key, node in nodes.items():
        made[key] = copy = NodeData(node.nodeid)
        copy.references = list(node.references)
        copy.attributes = {name: AttributeValue(each.value) for name, each in node.attributes.items()}
    for key in (ua.ObjectIds.Server_NamespaceArray, ua.ObjectIds.Server_ServerArray):
        value = made[ua.NodeId(key)].attributes[ua.AttributeIds.Value]
        value.value = deepcopy(value.value)
    return made


class Node:
    """The program client.mjs."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self._asked: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._numbers = count(1)
        self._hearing = asyncio.create_task(self._hear())

    @classmethod
    async def start(cls) -> Node:
        modules = npm.modules(FOLDER)
        more = {"NODE_PATH": str(modules), "UMO_PKI": str(modules.parent / "pki")}
        process = await asyncio.create_subprocess_exec(
            "node", "--no-warnings", str(FOLDER / "client.mjs"),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
            env=os.environ | more, limit=1 << 24,
        )  # fmt: skip
        return cls(process)

    async def _hear(self) -> None:
        assert self.process.stdout is not None
        while line := await self.process.stdout.readline():
            answer = json.loads(line)
            if (waiting := self._asked.pop(answer["id"], None)) is not None and not waiting.done():
                waiting.set_result(answer)
        for waiting in self._asked.values():
            if not waiting.done():
                waiting.set_exception(RefusedByFace("the client has ended"))

    async def ask(self, do: str, **more: Any) -> dict[str, Any]:
        """What it answers; RefusedByFace if it could not."""
        number = next(self._numbers)
        waiting = self._asked[number] = asyncio.get_running_loop().create_future()
        assert self.process.stdin is not None
        self.process.stdin.write((json.dumps({"id": number, "do": do, **more}) + "\n").encode())
        answer = await waiting
        if "refused" in answer:
            raise RefusedByFace(f"{answer['refused']} {answer.get('status', '')}")
        return answer

    def stop(self) -> None:
        """It hangs from now on."""
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self.process.send_signal(signal.SIGCONT)

    async def end(self, *, kill: bool = False) -> None:
        if self.process.returncode is None:
            if kill:
                self.process.send_signal(signal.SIGKILL)
            else:
                await self.ask("close")
            await self.process.wait()
        self._hearing.cancel()
        await asyncio.gather(self._hearing, return_exceptions=True)


class OpcUaClient(ForeignClient):
    """`user`: name, or a certificate and key; None: anonymous. `actions`: the arguments of each, in order."""

    def __init__(self, node: Node, namespaces: Sequence[str]) -> None:
        self.node, self.namespaces = node, namespaces

    @classmethod
    async def connect(
        cls, url: str, user: Mapping[str, str] | None, station: str = "plant", security: Mapping[str, str] | None = None
    ) -> OpcUaClient:
        node = await Node.start()
        try:
            told = await node.ask("connect", url=url, station=station, user=user, security=security)
        except BaseException:
            await node.end(kill=True)
            raise
        return cls(node, told["namespaces"])

    async def read(self, name: str) -> Seen:
        told = await self.node.ask("read", name=name)
        return Seen(
            told["value"], Grade(told["grade"]), told["time"], told["unit"], told["minimum"], told["maximum"],
            {int(number): text for number, text in told["states"].items()},
        )  # fmt: skip

    async def status(self, name: str) -> str:
        return str((await self.node.ask("read", name=name))["status"])

    async def write_all(self, values: Sequence[tuple[str, Any]]) -> list[dict[str, str]]:
        """Write several nodes in one request."""
        values = [(name, "NaN" if value != value else value) for name, value in values]
        return list((await self.node.ask("write", values=values))["results"])

    async def _write(self, name: str, value: Any) -> None:
        [result] = await self.write_all([(name, value)])
        if result["status"] != "Good":
            raise RefusedByFace(f"{result['status']}: {result['words']}")

    async def tune(self, path: str, value: Any) -> None:
        await self._write(f"tunable:{path}", value)

    async def write(self, path: str, value: Any) -> None:
        await self._write(path, value)

    async def method(self, parent: str, method: str, *given: Any) -> Any:
        told = await self.node.ask("call", object=parent, method=method, given=given)
        if not told["status"].startswith("Good"):
            raise RefusedByFace(f"{told['status']}: {told['words']}")
        return told["output"][0] if told["output"] else None

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        return await self.method(f"part:{path.rpartition('.')[0]}", f"action:{path}", *arguments.values())

    async def mode(self, mode: str) -> None:
        await self.method("machine", "command:mode", mode)

    async def close(self) -> None:
        await self.node.end()

    async def kill(self) -> None:
        await self.node.end(kill=True)


def let_in(file: Path | None = None) -> None:
    """Write the file of users: ann and bob with their passwords."""
    file = users.place() if file is None else file
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(passwords())


@cache
def passwords() -> str:
    """The lines of the file of users. A password takes 45 ms."""
    lines = (f'{name} = "{users.hashed(password)}"' for name, password in PASSWORDS.items())
    return "\n".join(["[passwords]", *lines, ""])


def named(name: str) -> dict[str, str]:
    return {"name": name, "password": PASSWORDS[name]}
