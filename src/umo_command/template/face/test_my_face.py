"""The face keeps the contract of faces: the kit tries it with a client of its protocol."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from my_face import MyFace

from umo.clients.faces.conformance import RULES, ForeignClient, RefusedByFace, Seen, TriedFace, try_rule
from umo.clients.faces.conformance.client import Grade

GRADES = {"GOOD": Grade.GOOD, "BAD": Grade.NONE}


class LineClient(ForeignClient):
    """Reads and writes lines, as nc does."""

    def __init__(self, user: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._user, self._reader, self._writer = user, reader, writer
        self._numbers = itertools.count()
        self._seen: dict[str, Seen] = {}
        self._asked: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._hearing = asyncio.create_task(self._hear())

    @classmethod
    async def of(cls, face: Any, user: str) -> ForeignClient:
        host, port = face.address.removeprefix("tcp://").split(":")
        return cls(user, *await asyncio.open_connection(host, int(port)))

    async def _hear(self) -> None:
        while text := await self._reader.readline():
            told = json.loads(text)
            if "ended" in told:
                self._seen.clear()
            elif "name" in told:
                grade = GRADES.get(told["quality"], Grade.DOUBTFUL)
                self._seen[told["name"]] = Seen(told["value"], grade, told["time"], told["unit"])
            else:
                self._asked.pop(told["number"]).set_result(told)

    async def read(self, name: str) -> Seen:
        return self._seen.get(name, Seen(None, Grade.NONE))

    async def _ask(self, do: str, **more: Any) -> Any:
        number = next(self._numbers)
        self._asked[number] = asyncio.get_running_loop().create_future()
        command = {"do": do, "number": number, "user": self._user, **more}
        self._writer.write(json.dumps(command).encode() + b"\n")
        answer = await self._asked[number]
        if "refused" in answer:
            raise RefusedByFace(answer["refused"])
        return answer["done"]

    async def tune(self, path: str, value: Any) -> None:
        await self._ask("tune", path=path, value=value)

    async def write(self, path: str, value: Any) -> None:
        await self._ask("write", path=path, value=value)

    async def call(self, path: str, arguments: Mapping[str, Any]) -> Any:
        return await self._ask("call", path=path, arguments=dict(arguments))

    async def mode(self, mode: str) -> None:
        await self._ask("mode", value=mode)

    async def close(self) -> None:
        self._writer.close()
        self._hearing.cancel()


TRIED = TriedFace("my_face", lambda: MyFace(port=0), LineClient.of)


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machines that the kit runs are not seen by others."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))


@pytest.mark.parametrize("name", RULES)
def test_the_face_keeps_the_contract(name: str) -> None:
    assert asyncio.run(try_rule(TRIED, RULES[name])) in (None, "")
