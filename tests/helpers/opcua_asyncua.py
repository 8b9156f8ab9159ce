"""The face OPC UA with clients of asyncua in the same loop: any request of the standard, as it is."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from asyncua import Client, ua
from asyncua.ua.ua_binary import struct_from_binary

from helpers.faced import hosted
from helpers.opcua import PASSWORDS, QuickOpcUa
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.operation.commands.client_commands import Mode

VALUE = ua.AttributeIds.Value
FIRST = 60.0
"""Time in s within which the first face of a process is there: it fills in the standards."""


class Rig:
    """A machine that is served."""

    def __init__(self, machine: TriedMachine, face: QuickOpcUa, said: list[str]) -> None:
        self.machine, self.face, self.said = machine, face, said

    def node(self, name: str) -> ua.NodeId:
        assert self.face._tree is not None
        return self.face._tree.id(name)

    @asynccontextmanager
    async def client(self, user: str | None = None) -> AsyncIterator[Asker]:
        client = Client(self.face.address, watchdog_intervall=20.0)  # one request may take longer than 1 s
        if user is not None:
            client.set_user(user)
            client.set_password(PASSWORDS[user])
        async with client:
            yield Asker(client, self)


class Asker:
    """Sends requests as they are, and answers with the response of the server, or with the name of its code."""

    def __init__(self, client: Client, rig: Rig) -> None:
        self.client, self._rig = client, rig

    async def ask(self, name: str, *parameters: Any, **more: Any) -> Any:
        """`parameters`: of the structure of the request, or the structure itself."""
        request = getattr(ua, f"{name}Request")()
        kind = getattr(ua, f"{name}Parameters")
        first = parameters[0] if parameters else None
        request.Parameters = first if isinstance(first, kind) else kind(*parameters, **more)
        return await self.send(name, request)

    async def send(self, name: str, request: Any) -> Any:
        try:
            data = await self.client.uaclient.protocol.send_request(request, timeout=20.0)
        except ua.UaStatusCodeError as error:
            return ua.StatusCode(error.code).name
        return struct_from_binary(getattr(ua, f"{name}Response"), data)

    async def read(self, name: str | ua.NodeId, attribute: int = VALUE, **more: Any) -> ua.DataValue:
        node = self._rig.node(name) if isinstance(name, str) else name
        asked = ua.ReadValueId(node, attribute, **more)
        response = await self.ask("Read", 0.0, ua.TimestampsToReturn.Both, [asked])
        return response.Results[0] if not isinstance(response, str) else response

    async def subscribe(self, handler: Any, interval: float = 50.0) -> Any:
        return await self.client.create_subscription(interval, handler)

    async def monitor(self, subscription: Any, name: str | ua.NodeId, **given: Any) -> ua.MonitoredItemCreateResult:
        """Create one item with these parameters; `mode`, `stamps`, `attribute` are those beside them."""
        node = self._rig.node(name) if isinstance(name, str) else name
        mode = given.pop("mode", ua.MonitoringMode.Reporting)
        stamps = given.pop("stamps", ua.TimestampsToReturn.Both)
        asked = ua.ReadValueId(node, given.pop("attribute", VALUE), given.pop("range", None))
        asked.DataEncoding = given.pop("encoding", ua.QualifiedName())
        item = ua.MonitoredItemCreateRequest(asked, mode, ua.MonitoringParameters(**given))
        response = await self.ask("CreateMonitoredItems", subscription.subscription_id, stamps, [item])
        return response.Results[0] if not isinstance(response, str) else response


class Heard:
    """What a subscription has told."""

    def __init__(self) -> None:
        self.values: list[tuple[int, Any, str]] = []
        """Handle of the client, value, name of the status."""
        self.changes: list[str] = []
        self.sizes: list[int] = []
        """Notifications in each response."""

    def listen(self, subscription: Any) -> None:
        """Take the responses as they come, before asyncua's client sorts them."""

        async def heard(result: ua.PublishResult) -> None:
            size = 0
            for each in result.NotificationMessage.NotificationData or []:
                if isinstance(each, ua.DataChangeNotification):
                    size += len(each.MonitoredItems)
                    for item in each.MonitoredItems:
                        self.values.append((item.ClientHandle, item.Value.Value.Value, status(item.Value)))
                elif isinstance(each, ua.EventNotificationList):
                    size += len(each.Events)
                    self.values += [(item.ClientHandle, fields(item), "Good") for item in each.Events]
                else:
                    self.changes.append(each.Status.name)
            if size:
                self.sizes.append(size)

        subscription.server._subscription_callbacks[subscription.subscription_id] = heard

    def of(self, handle: int) -> list[tuple[Any, str]]:
        return [each[1:] for each in self.values if each[0] == handle]

    def datachange_notification(self, *given: Any) -> None:
        pass


def fields(event: ua.EventFieldList) -> list[Any]:
    return [each.Value.Text if isinstance(each.Value, ua.LocalizedText) else each.Value for each in event.EventFields]


def status(value: ua.DataValue) -> str:
    code = value.StatusCode.value if value.StatusCode is not None else 0
    return ua.StatusCode(code & ~0xFFFF).name + ("+overflow" if code & 0x80 else "")


Work = Callable[[Rig], Coroutine[Any, Any, None]]


def run(work: Work, mode: Mode = Mode.AUTOMATIC, **options: Any) -> None:
    async def whole() -> None:
        face = QuickOpcUa(port=0)
        async with TriedMachine(mode) as machine, hosted(machine, face, **options) as said:
            await until(lambda: face._utc, FIRST)
            await work(Rig(machine, face, said))
            assert not any("has failed" in each for each in said), said

    asyncio.run(whole())
