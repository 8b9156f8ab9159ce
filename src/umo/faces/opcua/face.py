"""The face OPC UA: a server whose address space is the machine."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.xmlimporter import XmlImporter

from umo.faces.contract import Changes, Commands, Face
from umo.faces.declaration import Declaration
from umo.faces.endpoint import Endpoint
from umo.faces.opcua.commands import NOT_WRITABLE, ClientCommands
from umo.faces.opcua.connection import Answer, Services, UaServer
from umo.faces.opcua.machine import MachineNodes
from umo.faces.opcua.security import Security
from umo.faces.opcua.session import Session
from umo.faces.opcua.tree import Tree
from umo.faces.opcua.values import GONE, data_value, is_switch
from umo.frames.reader import NumberedEvent

PORT = 4840
NODESETS = Path(__file__).parent / "nodesets"
COMPANIONS = ("Di", "IA", "Machinery", "PackML")
"""The NodeSet2 files of the OPC Foundation that are imported, in this order."""
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINES = 1001
"""Node Objects/Machines (OPC 40001-1)."""


class OpcUa(Face):
    """Serves the machine to OPC UA clients.

    Options:
        port: of the server.
        host: its address; one that other computers reach needs `certificate` and `clients`.
        certificate: file of its certificate and key (PEM).
        clients: file of the certificates of the programs that may connect (PEM).
    """

    proves_users = True

    def __init__(
        self, port: int = PORT, host: str = "127.0.0.1", certificate: Path | None = None, clients: Path | None = None
    ) -> None:
        self._endpoint = Endpoint(host, port, certificate and Path(certificate), clients and Path(clients))
        self._security = Security(self._endpoint)
        self._server: UaServer | None = None
        self._tree: Tree | None = None
        self._shown: Declaration | None = None
        """The machine whose nodes are there."""
        self._nodes: MachineNodes | None = None
        self._commands: ClientCommands | None = None
        self.address = ""
        """Where it is reached."""

    @property
    def server(self) -> UaServer:
        assert self._server is not None
        return self._server

    async def open(self) -> None:
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it writes traces of what clients do wrong
        listening = self._endpoint.listening()
        try:
            server = UaServer(Services(self._write, self._call, self._security.is_trusted, self._security.only_secured))
            await server.init()
            await _describe(server, self._security.uri(f"urn:{socket.gethostname()}:umo"))
            for name in COMPANIONS:
                await XmlImporter(server, strict_mode=False).import_xml(NODESETS / f"Opc.Ua.{name}.NodeSet2.xml")
            self._security.apply(server)
            host = f"[{self._endpoint.host}]" if ":" in self._endpoint.host else self._endpoint.host
            self.address = f"opc.tcp://{host}:{listening.getsockname()[1]}"
            server.set_endpoint(self.address)
            await server.listen(listening)
        except BaseException:
            listening.close()
            raise
        self._server = server

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        if self._shown is None or _fixed(self._shown) != _fixed(machine):
            await self._build(machine)
        self._shown = machine
        assert self._nodes is not None
        self._commands = ClientCommands(self._nodes, commands, self._tell_refusal)

    async def _build(self, machine: Declaration) -> None:
        server = self.server
        if self._tree is not None:
            await self._tree.clear()
        namespace = await server.register_namespace(f"urn:umo:{machine.station}")
        machines = ua.NodeId(MACHINES, await server.get_namespace_index(MACHINERY))
        self._tree = Tree(server.iserver.aspace, server.iserver.node_mgt_service, namespace)
        self._nodes = MachineNodes(self._tree, machine, machines)

    async def frames(self, changes: Changes) -> None:
        nodes, machine = self._nodes, self._shown
        assert nodes is not None and machine is not None
        for place in changes.places:
            item = machine.items[place]
            value = data_value(item, changes)
            await _put(nodes.values[place], value)
            if place in nodes.texts:
                number = None if value.Value is None else value.Value.Value
                text = ua.LocalizedText(item.states.get(number, "") if number is not None else "")
                await _put(nodes.texts[place], ua.DataValue(ua.Variant(text), value.StatusCode, value.SourceTimestamp))

    async def events(self, events: Sequence[NumberedEvent]) -> None:
        return

    async def end(self, why: str) -> None:
        """Every value is the last one from now on, and says so; commands that wait are answered."""
        if self._commands is not None:
            await self._commands.close()
        self._commands = None
        await self.server.iserver.abandon()
        if self._nodes is not None:
            for each in (*self._nodes.values, *self._nodes.texts.values()):
                old = each.value
                if old is not None and old.StatusCode is not None and not old.StatusCode.is_bad():
                    await _put(each, ua.DataValue(old.Value, GONE, old.SourceTimestamp, old.ServerTimestamp))

    async def close(self) -> None:
        if self._server is not None:
            await self._server.stop()

    # Commands ----------------------------------------------------------------------------------------------

    async def _write(self, session: Session, value: ua.WriteValue) -> Answer:
        if self._commands is None or self._tree is None or value.NodeId.NamespaceIndex != self._tree.namespace:
            return Answer(NOT_WRITABLE, "it is not written, or no machine runs")
        return await self._commands.write(session, value)

    async def _call(self, session: Session, request: ua.CallMethodRequest) -> Answer:
        if self._nodes is not None and request.MethodId in self._nodes.methods:
            if self._commands is None:
                gone = ua.StatusCode(ua.StatusCodes.BadNoCommunication)
                return Answer(ua.CallMethodResult(gone), "the machine does not run")
            return await self._commands.call(session, request)
        return Answer((await self.server.iserver.method_service.call([request]))[0])

    def _tell_refusal(self, who: str, words: str) -> None:
        """To the variable LastRefusal."""
        assert self._tree is not None and self._nodes is not None
        text = ua.DataValue(ua.Variant(f"{who}: {words}", ua.VariantType.String))
        task = asyncio.create_task(_put(self._tree.value_of(self._nodes.refusal), text))
        self.server.iserver.answering.add(task)
        task.add_done_callback(self.server.iserver.answering.discard)


async def _put(where: Any, value: ua.DataValue) -> None:
    """Set a value, and tell those who monitor it."""
    where.value = value
    for handle, callback in list(where.datachange_callbacks.items()):
        await callback(handle, value)


def _fixed(machine: Declaration) -> tuple[Any, ...]:
    """What the nodes are made from."""
    return machine.station, machine.wiring, machine.items, machine.actions, machine.units


async def _describe(server: UaServer, uri: str) -> None:
    server.name = "umo"
    server.product_uri, server.manufacturer_name = "urn:umo", "umo"
    server.application_type = ua.ApplicationType.Server
    await server.set_application_uri(uri)
    from datetime import datetime

    await server.set_build_info("urn:umo", "umo", "umo", version("umo"), "0", datetime(2026, 1, 1))


__all__ = ["OpcUa", "is_switch"]
