"""Whatever clients send, the face OPC UA answers, lives, and serves the others."""

from __future__ import annotations

import asyncio
import copy
import logging
import sys
from contextlib import AsyncExitStack
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import nodeid_from_binary, struct_from_binary, struct_to_binary
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from helpers.faced import hosted
from helpers.opcua import QuickOpcUa, let_in
from helpers.opcua_asyncua import FIRST, Asker, Heard, Rig
from helpers.opcua_requests import REQUESTS, with_own
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.operation.commands.client_commands import Mode

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")]
PER_EXAMPLE = 40
"""Requests of one client at most."""
NEVER = ("BadInternalError", "BadUnexpectedError", "BadEncodingError", "BadTimeout")
"""Codes that say that something was not thought of."""
FAULT = ua.NodeId(ua.ObjectIds.ServiceFault_Encoding_DefaultBinary)


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


class Attacked:
    """A face, a client that hears a value of it, and one after the other that sends what it likes."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._open = loop, AsyncExitStack()
        self.sent, self._fails = 0, False

    def __enter__(self) -> Attacked:
        self._loop.run_until_complete(self._begin())
        return self

    def __exit__(self, *error: object) -> None:
        self._loop.run_until_complete(self._open.aclose())

    async def _begin(self) -> None:
        face = QuickOpcUa(port=0)
        machine = await self._open.enter_async_context(TriedMachine(Mode.MANUAL))
        said = await self._open.enter_async_context(hosted(machine, face))
        await until(lambda: face._utc, FIRST)
        self.rig = Rig(machine, face, said)
        self.other: Asker = await self._open.enter_async_context(self.rig.client())
        self.heard = Heard()
        mine = await self.other.subscribe(self.heard)
        self.heard.listen(mine)
        await self.other.monitor(mine, "cell.level", QueueSize=10)
        deaf = ua.DataChangeFilter(ua.DataChangeTrigger.StatusValue, 1, 1e9)
        await self.other.monitor(mine, "cell.position", ClientHandle=1, QueueSize=10, Filter=deaf)

    def attack(self, user: str | None, requests: list[Any]) -> None:
        self._loop.run_until_complete(asyncio.wait_for(self._attack(user, requests), 3 * FIRST))

    async def _attack(self, user: str | None, requests: list[Any]) -> None:
        async with self.rig.client(user) as client:
            sender = Sender(client)
            await sender.send("CreateSubscription", ua.CreateSubscriptionParameters(50.0), ())
            for each in requests:
                await sender.send(*copy.deepcopy(each))
            self.sent += len(requests)
            for _ in range(5):
                await sender.send("Publish", ua.PublishParameters(), ())
            raw = 20 + 2 * (self.sent % 50) + 80 * (self.sent % 2)  # with an alarm, or without
            self._fails = not self._fails
            self.rig.machine.set("cell.position", OSError("unplugged") if self._fails else 7)
            self.rig.machine.set("cell.level", raw)
            await until(lambda: [each[0] for each in self.heard.of(0)[-1:]] == [raw / 2], FIRST)
            await until(
                lambda: [each[1] == "BadDeviceFailure" for each in self.heard.of(1)[-1:]] == [self._fails], FIRST
            )
        assert not sender.wrong, sender.wrong
        assert not any("has failed" in each for each in self.rig.said), self.rig.said


class Sender:
    """Sends requests of one client. A damaged one may be answered, refused, or end the connection."""

    def __init__(self, client: Asker) -> None:
        self._protocol = client.client.uaclient.protocol
        self._subscriptions: list[int] = []
        self._items: list[int] = []
        self.wrong: list[Any] = []
        """Codes in what was published that must never be."""

    async def send(self, name: str, parameters: Any, damage: Any) -> None:
        request = getattr(ua, f"{name}Request")()
        request.Parameters = with_own(parameters, self._subscriptions, self._items)
        protocol = self._protocol
        if protocol.transport is None or protocol.transport.is_closing():
            return
        protocol._setup_request_header(request.RequestHeader, 20.0)
        body = bytearray(struct_to_binary(request))
        for place, wrong in damage:
            begin = place % len(body)
            body[begin : begin + len(wrong)] = wrong
        number = protocol._request_id = protocol._request_id + 1
        answer = protocol._callbackmap[number] = asyncio.get_running_loop().create_future()
        protocol.transport.write(protocol._connection.message_to_binary(bytes(body), request_id=number))
        if name == "Publish" and not damage:
            answer.add_done_callback(self._published)
        if name == "Publish" or damage:  # it is answered later, or not at all
            return
        self._look(name, await asyncio.wait_for(answer, 30.0))

    def _published(self, answer: asyncio.Future[Buffer]) -> None:
        if answer.cancelled() or answer.exception() is not None:
            return
        try:
            data = answer.result().copy()
            self._look("Publish", data.copy())
            if nodeid_from_binary(data.copy()) == FAULT:
                return
            message = struct_from_binary(ua.PublishResponse, data).Parameters.NotificationMessage
            for each in message.NotificationData or []:
                codes = [item.Value.StatusCode for item in getattr(each, "MonitoredItems", [])]
                self.wrong += [code.name for code in codes if code is not None and code.name in NEVER]
        except Exception as error:
            self.wrong.append(error)

    def _look(self, name: str, data: Buffer) -> None:
        if nodeid_from_binary(data.copy()) == FAULT:
            code = struct_from_binary(ua.ServiceFault, data).ResponseHeader.ServiceResult.name
            assert code not in NEVER, (name, code)
            return
        response = struct_from_binary(getattr(ua, f"{name}Response"), data)
        results = getattr(response, "Results", None) or getattr(getattr(response, "Parameters", None), "Results", None)
        for each in results or []:
            status = each if isinstance(each, ua.StatusCode) else each.StatusCode
            assert status is None or status.name not in NEVER, (name, each)
        if name == "CreateSubscription":
            self._subscriptions.append(response.Parameters.SubscriptionId)
        if name == "CreateMonitoredItems":
            self._items += [each.MonitoredItemId for each in response.Results if each.StatusCode.is_good()]


def fuzz(examples: int, number: int) -> None:
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    loop = asyncio.new_event_loop()
    try:
        with Attacked(loop) as attacked:

            @seed(number)
            @settings(max_examples=examples, deadline=None, suppress_health_check=list(HealthCheck), database=None)
            @given(st.sampled_from((None, "ann")), st.lists(REQUESTS, min_size=PER_EXAMPLE // 2, max_size=PER_EXAMPLE))
            def attack(user: str | None, requests: list[Any]) -> None:
                attacked.attack(user, requests)

            attack()
            print(f"{attacked.sent} requests")
    finally:
        loop.close()


@pytest.mark.full
@pytest.mark.smoke
def test_200_requests_leave_the_face_alive_and_others_served() -> None:
    fuzz(8, 1)


def test_10000_requests_leave_the_face_alive_and_others_served() -> None:
    fuzz(400, 46)
