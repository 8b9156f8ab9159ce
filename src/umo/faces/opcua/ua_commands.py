"""What clients write and call, as commands of the machine."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from asyncua import ua

from umo.errors import CommandRefused, StateError, UmoError
from umo.faces.face import Commands, User
from umo.faces.face_declaration import ItemKind
from umo.faces.opcua.ua_connection import Answer
from umo.faces.opcua.ua_machine import Called, MachineNodes
from umo.faces.opcua.ua_session import Client, UaSession
from umo.faces.opcua.ua_values import given, result_of, status_of

BEGUN_WITHIN = 0.5
"""Time in s after which an action that is kept up, and was not refused, counts as begun."""
PATIENCE = 10.0
"""Time in s after which an action that still runs is answered with GoodCompletesAsynchronously: clients wait for 15 s
or longer."""
GOOD, LATER = ua.StatusCode(), ua.StatusCode(ua.StatusCodes.GoodCompletesAsynchronously)
NOT_WRITABLE = ua.StatusCode(ua.StatusCodes.BadNotWritable)
DENIED = ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
ANONYMOUS = "an anonymous session only reads: log in with a password or a certificate"
TellRefusal = Callable[[str, str], object]
"""Tells a refusal: of whom, in words."""


class ClientCommands:
    """The commands of all clients to one run."""

    def __init__(self, nodes: MachineNodes, commands: Commands, refused: TellRefusal) -> None:
        self._nodes, self._commands, self._refused = nodes, commands, refused
        self._running: set[asyncio.Task[Any]] = set()

    async def write(self, session: UaSession, value: ua.WriteValue) -> Answer:
        item = self._nodes.writable.get(value.NodeId)
        if item is None or value.AttributeId != ua.AttributeIds.Value or value.IndexRange:
            return Answer(NOT_WRITABLE, "only actuators and tunable numbers are written")
        try:
            if value.Value.StatusCode is not None and not value.Value.StatusCode.is_good():
                raise StateError(f"{item.path}: only a good value is written")
            new = given(item, value.Value.Value)
            do = "write" if item.kind is ItemKind.ACTUATOR else "tune"
            await self._ask(session, do, item.path, held=do == "write", value=new)
        except UmoError as error:
            return self._refusal(session, error)
        return Answer(GOOD)

    async def call(self, session: UaSession, request: ua.CallMethodRequest, called: Called | None = None) -> Answer:
        called = called or self._nodes.methods[request.MethodId]
        try:
            path, more = _arguments(called, request.InputArguments or [])
            work = self._ask(session, called.do, path, held=called.keeps_up, **more)
            if called.keeps_up or called.do == "call":
                return await self._patiently(session, work, BEGUN_WITHIN if called.keeps_up else PATIENCE)
            return Answer(_result(GOOD, await work))
        except UmoError as error:
            refusal = self._refusal(session, error)
            words = [ua.DiagnosticInfo(AdditionalInfo=refusal.words)] * len(request.InputArguments or [])
            refusal.result = ua.CallMethodResult(refusal.result, InputArgumentDiagnosticInfos=words)
            return refusal

    async def _patiently(self, session: UaSession, work: Coroutine[Any, Any, Any], patience: float) -> Answer:
        """The result of an action, or that it goes on. It is not cancelled with the request."""
        task = asyncio.create_task(work)
        self._running.add(task)
        task.add_done_callback(self._running.discard)
        done, _ = await asyncio.wait({task}, timeout=patience)
        if done:
            return Answer(_result(GOOD, task.result()))
        task.add_done_callback(lambda ended: self._ended(session, ended))
        return Answer(_result(LATER, None))

    def _ended(self, session: UaSession, task: asyncio.Task[Any]) -> None:
        """Of an action that was answered before its end; what failed is in the machine's events, too."""
        if not task.cancelled() and isinstance(error := task.exception(), UmoError):
            self._refusal(session, error)

    async def _ask(self, session: UaSession, do: str, path: str, held: bool = False, **more: Any) -> Any:
        client: Any = session.user
        user = client.holder if held else client.user
        if user is None:
            raise Anonymous(ANONYMOUS)
        return await self._commands.ask(user, do, path, **more)

    def _refusal(self, session: UaSession, error: UmoError) -> Answer:
        user = _user(session)
        self._refused(user.name if user else "anonymous", str(error))
        return Answer(DENIED if isinstance(error, Anonymous) else status_of(error), str(error))

    async def close(self) -> None:
        for task in list(self._running):
            task.cancel()
        await asyncio.gather(*self._running, return_exceptions=True)


class Anonymous(CommandRefused):
    """A command of nobody."""


def _user(session: UaSession) -> User | None:
    client: Any = session.user
    return client.user if isinstance(client, Client) else None


def _arguments(called: Called, variants: list[ua.Variant]) -> tuple[str, dict[str, Any]]:
    """Path and arguments of a command. StateError for too many, or of a wrong type."""
    if len(variants) > len(called.kinds):
        raise StateError(f"there are {len(variants)} arguments; it has {len(called.kinds)}")
    values = {
        name: _plain(name, kind, each)
        for (name, kind), each in zip(called.kinds.items(), variants, strict=False)
        if each.Value is not None
    }
    if called.do == "call":
        return str(called.path), {"arguments": values}
    path = values.pop("Path", "") if called.path is None else called.path
    return path, {"value": next(iter(values.values()))} if values else {}


def _plain(name: str, kind: str, variant: ua.Variant) -> Any:
    value = variant.Value
    if isinstance(value, ua.LocalizedText):
        value = value.Text
    types: Any = {"number": int | float, "integer": int, "bool": bool}.get(kind, str)
    if variant.is_array or not isinstance(value, types) or (isinstance(value, bool) and kind != "bool"):
        raise StateError(f"{name}: {value!r} is no {kind}")
    return float(value) if kind == "number" else value


def _result(status: ua.StatusCode, value: Any) -> ua.CallMethodResult:
    return ua.CallMethodResult(status, OutputArguments=[result_of(value)])
