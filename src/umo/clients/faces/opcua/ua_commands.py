"""Translates the writes and calls of clients into commands of the machine."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from math import isfinite
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.command_users import arguments_of
from umo.clients.faces.face import Commands, User
from umo.clients.faces.kept_tasks import KeptTasks
from umo.clients.faces.opcua.ua_attributes import bounds
from umo.clients.faces.opcua.ua_connection import Answer
from umo.clients.faces.opcua.ua_machine import PATH, Called, MachineNodes
from umo.clients.faces.opcua.ua_methods import check, wrong
from umo.clients.faces.opcua.ua_session import UaSession
from umo.clients.faces.opcua.ua_values import UaRefusal, given, result_of, status_of
from umo.errors import PathError, UmoError
from umo.operation.commands.verb import Verb

BEGUN_WITHIN = 0.5
"""Time in s after which a dead-man action is answered as begun if it was not refused."""
PATIENCE = 10.0
"""Time in s after which an action that still runs is answered with GoodCompletesAsynchronously: clients wait for 15 s
or longer."""
_C = ua.StatusCodes
GOOD, LATER = ua.StatusCode(), ua.StatusCode(_C.GoodCompletesAsynchronously)
NOT_WRITABLE = ua.StatusCode(_C.BadNotWritable)
ANONYMOUS = "an anonymous session can only read: log in with a password or a certificate"
TellRefusal = Callable[[str, str], object]
"""Function that reports a refusal. Its arguments are the user and the text."""


class ClientCommands:
    """Passes the commands of all clients to one run."""

    def __init__(self, space: AddressSpace, nodes: MachineNodes, commands: Commands, refused: TellRefusal) -> None:
        self._space, self._nodes, self._commands, self._refused = space, nodes, commands, refused
        self._running = KeptTasks()

    def may(self, session: Any, do: str, path: str) -> bool:
        """True if the user of a session may give a command."""
        user: User | None = session.user.user
        return user is not None and self._commands.may(user, do, path)

    async def write(self, session: UaSession, value: ua.WriteValue) -> Answer:
        """Write the value of an existing node."""
        item = self._nodes.writable.get(value.NodeId)
        if item is None or value.AttributeId != ua.AttributeIds.Value:
            return Answer(NOT_WRITABLE, "only actuators and tunable numbers can be written")
        try:
            _user_of(session)
            if value.IndexRange:
                code = _C.BadIndexRangeInvalid if bounds(value.IndexRange) is None else _C.BadIndexRangeNoData
                raise UaRefusal(code, f"{item.path} is not an array")
            new = given(item, value.Value)
            verb = item.verb
            assert verb is not None
            await self._ask(session, verb, item.path, held=verb.is_kept_up, **verb.fields({"value": new}))
        except UmoError as error:
            return self._refusal(session, error)
        return Answer(GOOD)

    async def call(self, session: UaSession, method: ua.NodeId, arguments: list[ua.Variant], called: Called) -> Answer:
        """Call an existing method of an object."""
        try:
            _user_of(session)
            result = check(self._space, method, arguments, called.optional)
            if result is not None:
                return self._wrong(session, called, result)
            path, more = _arguments(called, arguments)
            is_held = called.keeps_up or (called.verb.of_action and called.path is None)
            work = self._ask(session, called.verb, path, held=is_held, **more)
            if called.keeps_up or called.verb.lasts:
                return await self._patiently(session, work, BEGUN_WITHIN if called.keeps_up else PATIENCE)
            return Answer(_result(GOOD, await work))
        except UmoError as error:
            refusal = self._refusal(session, error)
            codes = _codes(called, arguments, error)
            refusal.result = wrong(codes) if any(codes) else ua.CallMethodResult(refusal.result)
            return refusal

    def _wrong(self, session: UaSession, called: Called, result: ua.CallMethodResult) -> Answer:
        """Return the answer to a call whose arguments do not match their declarations."""
        takes = ", ".join(f"{name} ({kind})" for name, kind in called.kinds.items()) or "no arguments"
        refusal = self._refusal(session, UaRefusal(result.StatusCode.value, f"the method takes {takes}"))
        refusal.result = result
        return refusal

    async def _patiently(self, session: UaSession, work: Coroutine[Any, Any, Any], patience: float) -> Answer:
        """Return the result of an action, or the answer that the action continues. The action is not cancelled with the
        request."""
        task = self._running.begin(work)
        done, _ = await asyncio.wait({task}, timeout=patience)
        if done:
            return Answer(_result(GOOD, task.result()))
        task.add_done_callback(lambda ended: self._ended(session, ended))
        return Answer(_result(LATER, None))

    def _ended(self, session: UaSession, task: asyncio.Task[Any]) -> None:
        """Report the failure of an action that was answered before its end. The failure is also in the machine's
        events."""
        if not task.cancelled() and isinstance(error := task.exception(), UmoError):
            self._refusal(session, error)

    async def _ask(self, session: UaSession, verb: Verb, path: str, held: bool = False, **more: Any) -> Any:
        user = _user_of(session)
        client: Any = session.user
        return await self._commands.ask(client.holder if held else user, verb.name, path, **more)

    def _refusal(self, session: UaSession, error: UmoError) -> Answer:
        user = session.user.user
        self._refused(user.name if user else "anonymous", str(error))
        return Answer(status_of(error), str(error))

    async def close(self) -> None:
        await self._running.end()


def _user_of(session: UaSession) -> User:
    """Return the user of a session. Raises UaRefusal for an anonymous session."""
    user: User | None = session.user.user
    if user is None:
        raise UaRefusal(_C.BadUserAccessDenied, ANONYMOUS)
    return user


def _arguments(called: Called, variants: list[ua.Variant]) -> tuple[str, dict[str, Any]]:
    """Return the path and the arguments of a command. Arguments that are null are left out, so that their defaults
    apply."""
    values = {
        name: each.Value.Text if isinstance(each.Value, ua.LocalizedText) else each.Value
        for name, each in zip(called.kinds, variants, strict=False)
        if each.Value is not None
    }
    if called.path is not None and called.verb.of_action:
        return called.path, called.verb.fields(values)
    path = str(values.pop(PATH, "")) if called.path is None else called.path
    given = {name.lower(): value for name, value in values.items()}
    if called.verb.of_action:
        given = arguments_of(next(iter(given.values()), ""))
    return path, called.verb.fields(given)


def _codes(called: Called, variants: list[ua.Variant], error: UmoError) -> list[int]:
    """Return a status code for each argument: 0, or the reason why the machine refused it. All are 0 if the command is
    refused as a whole."""
    pairs = zip(called.arguments, variants, strict=False)
    unknown = called.path is None and isinstance(error, PathError)
    return [
        _C.BadNodeIdUnknown if unknown and about["name"] == PATH
        else 0 if _is_within(about, each.Value) else _C.BadOutOfRange
        for about, each in pairs
    ]  # fmt: skip


def _is_within(about: Mapping[str, Any], value: Any) -> bool:
    """True if an argument is within what its action, or its verb, declares."""
    if value is None or isinstance(value, bool):
        return True
    if isinstance(value, int | float):
        low, high = about.get("minimum"), about.get("maximum")
        return isfinite(value) and (low is None or value >= low) and (high is None or value <= high)
    return not about.get("choices") or value in about["choices"]


def _result(status: ua.StatusCode, value: Any) -> ua.CallMethodResult:
    return ua.CallMethodResult(status, OutputArguments=[result_of(value)])
