"""What clients write and call, as commands of the machine."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from math import isfinite
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace

from umo.errors import PathError, RangeError, StateError, UmoError
from umo.faces.face import Commands, User
from umo.faces.face_declaration import ItemKind
from umo.faces.opcua.ua_attributes import bounds
from umo.faces.opcua.ua_connection import Answer
from umo.faces.opcua.ua_machine import Called, MachineNodes
from umo.faces.opcua.ua_methods import check, wrong
from umo.faces.opcua.ua_session import UaSession
from umo.faces.opcua.ua_values import UaRefusal, given, result_of, status_of

BEGUN_WITHIN = 0.5
"""Time in s after which an action that is kept up, and was not refused, counts as begun."""
PATIENCE = 10.0
"""Time in s after which an action that still runs is answered with GoodCompletesAsynchronously: clients wait for 15 s
or longer."""
_C = ua.StatusCodes
GOOD, LATER = ua.StatusCode(), ua.StatusCode(_C.GoodCompletesAsynchronously)
NOT_WRITABLE = ua.StatusCode(_C.BadNotWritable)
ANONYMOUS = "an anonymous session only reads: log in with a password or a certificate"
TellRefusal = Callable[[str, str], object]
"""Tells a refusal: of whom, in words."""


class ClientCommands:
    """The commands of all clients to one run."""

    def __init__(self, space: AddressSpace, nodes: MachineNodes, commands: Commands, refused: TellRefusal) -> None:
        self._space, self._nodes, self._commands, self._refused = space, nodes, commands, refused
        self._running: set[asyncio.Task[Any]] = set()

    def may(self, session: Any, do: str, path: str) -> bool:
        """Whether a session may give a command, as far as its user goes."""
        user: User | None = session.user.user
        return user is not None and self._commands.may(user, do, path)

    async def write(self, session: UaSession, value: ua.WriteValue) -> Answer:
        """The value of a node that is there."""
        item = self._nodes.writable.get(value.NodeId)
        if item is None or value.AttributeId != ua.AttributeIds.Value:
            return Answer(NOT_WRITABLE, "only actuators and tunable numbers are written")
        try:
            _user_of(session)
            if value.IndexRange:
                code = _C.BadIndexRangeInvalid if bounds(value.IndexRange) is None else _C.BadIndexRangeNoData
                raise UaRefusal(code, f"{item.path} is no array")
            new = given(item, value.Value)
            do = "write" if item.kind is ItemKind.ACTUATOR else "tune"
            await self._ask(session, do, item.path, held=do == "write", value=new)
        except UmoError as error:
            return self._refusal(session, error)
        return Answer(GOOD)

    async def call(self, session: UaSession, method: ua.NodeId, arguments: list[ua.Variant], called: Called) -> Answer:
        """A method that its object has."""
        try:
            _user_of(session)
            result = check(self._space, method, arguments, called.optional)
            if result is not None:
                return self._wrong(session, called, result)
            path, more = _arguments(called, arguments)
            work = self._ask(session, called.do, path, held=called.keeps_up, **more)
            if called.keeps_up or called.do == "call":
                return await self._patiently(session, work, BEGUN_WITHIN if called.keeps_up else PATIENCE)
            return Answer(_result(GOOD, await work))
        except UmoError as error:
            refusal = self._refusal(session, error)
            codes = _codes(called, arguments, error)
            refusal.result = wrong(codes) if any(codes) else ua.CallMethodResult(refusal.result)
            return refusal

    def _wrong(self, session: UaSession, called: Called, result: ua.CallMethodResult) -> Answer:
        """Of arguments that are not those that are declared."""
        takes = ", ".join(f"{name} ({kind})" for name, kind in called.kinds.items()) or "no arguments"
        refusal = self._refusal(session, UaRefusal(result.StatusCode.value, f"it takes {takes}"))
        refusal.result = result
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
        user = _user_of(session)
        client: Any = session.user
        return await self._commands.ask(client.holder if held else user, do, path, **more)

    def _refusal(self, session: UaSession, error: UmoError) -> Answer:
        user = session.user.user
        self._refused(user.name if user else "anonymous", str(error))
        return Answer(status_of(error), str(error))

    async def close(self) -> None:
        for task in list(self._running):
            task.cancel()
        await asyncio.gather(*self._running, return_exceptions=True)


def _user_of(session: UaSession) -> User:
    """UaRefusal of an anonymous session."""
    user: User | None = session.user.user
    if user is None:
        raise UaRefusal(_C.BadUserAccessDenied, ANONYMOUS)
    return user


def _arguments(called: Called, variants: list[ua.Variant]) -> tuple[str, dict[str, Any]]:
    """Path and arguments of a command; those that are null have their defaults."""
    values = {
        name: each.Value.Text if isinstance(each.Value, ua.LocalizedText) else each.Value
        for name, each in zip(called.kinds, variants, strict=False)
        if each.Value is not None
    }
    if called.do == "call":
        return str(called.path), {"arguments": values}
    path = values.pop("Path", "") if called.path is None else called.path
    return path, {"value": next(iter(values.values()))} if values else {}


def _codes(called: Called, variants: list[ua.Variant], error: UmoError) -> list[int]:
    """Which arguments the machine has refused; none: the refusal is of the command as a whole."""
    if called.arguments:
        pairs = zip(called.arguments, variants, strict=False)
        return [0 if _is_within(about, each.Value) else _C.BadOutOfRange for about, each in pairs]
    if called.do == "call" or not isinstance(error, RangeError | StateError | PathError):
        return []
    return [_C.BadNodeIdUnknown if isinstance(error, PathError) else _C.BadOutOfRange] * len(variants)


def _is_within(about: Mapping[str, Any], value: Any) -> bool:
    """Whether an argument is within what its action declares."""
    if value is None or isinstance(value, bool):
        return True
    if isinstance(value, int | float):
        low, high = about.get("minimum"), about.get("maximum")
        return isfinite(value) and (low is None or value >= low) and (high is None or value <= high)
    return not about.get("choices") or value in about["choices"]


def _result(status: ua.StatusCode, value: Any) -> ua.CallMethodResult:
    return ua.CallMethodResult(status, OutputArguments=[result_of(value)])
