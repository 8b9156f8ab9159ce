"""The face OPC UA: a server whose address space is the machine."""

from __future__ import annotations

import gc
import logging
import socket
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.xmlimporter import XmlImporter

from umo.clients.faces.command_users import RefusalLimit
from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.face import Changes, Commands, Face
from umo.clients.faces.opcua import ua_decoding as decoding
from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua import ua_machinery as machinery
from umo.clients.faces.opcua.ua_attributes import Rights, missing
from umo.clients.faces.opcua.ua_commands import NOT_WRITABLE, ClientCommands
from umo.clients.faces.opcua.ua_connection import Answer, Services, UaServer
from umo.clients.faces.opcua.ua_events import ACKNOWLEDGE, Kinds, MachineEvents
from umo.clients.faces.opcua.ua_machine import MachineNodes, acknowledging
from umo.clients.faces.opcua.ua_methods import STANDARD, call_standard, refusal
from umo.clients.faces.opcua.ua_packml import URI as PACKML
from umo.clients.faces.opcua.ua_packml import PackMLUnits
from umo.clients.faces.opcua.ua_security import Security
from umo.clients.faces.opcua.ua_session import UaSession
from umo.clients.faces.opcua.ua_tree import NodeTree, put
from umo.clients.faces.opcua.ua_values import GONE, data_value, moment, state_text
from umo.process.frames.machine_items import Declaration, ItemKind
from umo.process.frames.run_reader import NumberedEvent
from umo.system.packages import umo_version

_C = ua.StatusCodes
PORT = 4840
NODESETS = Path(__file__).parent / "nodesets"
COMPANIONS = ("Di", "IA", "Machinery", "PackML")
"""The NodeSet2 files of the OPC Foundation that are imported, in this order."""
REFUSAL = 300
"""Severity of the event of a refusal."""
REFUSAL_PAUSE = 1.0
"""Shortest time in s between two events that report refusals of the same user."""


GONE_ANSWER = Answer(ua.StatusCode(_C.BadNoCommunication), "the machine does not run")


class OpcUa(Face):
    """Serves the machine to OPC UA clients.

    Options:
        port: the TCP port of the server.
        host: the address of the server. If other computers reach it, it needs `certificate` and `clients`.
        certificate: file of the server's certificate and key (PEM).
        clients: file of the certificates of the programs that may connect (PEM).
        manufacturer: the manufacturer of the machine, as on its name plate.
        serial: the serial number of the machine.
    """

    proves_users = True

    def __init__(
        self,
        port: int = PORT,
        host: str = "127.0.0.1",
        certificate: Path | None = None,
        clients: Path | None = None,
        manufacturer: str = "not known",
        serial: str = "not known",
    ) -> None:
        self._endpoint = Endpoint(host, port, certificate and Path(certificate), clients and Path(clients))
        self._security = Security(self._endpoint)
        self._plate = {"Manufacturer": manufacturer, "SerialNumber": serial}
        self._server: UaServer | None = None
        self._kinds: Kinds | None = None
        self._tree: NodeTree | None = None
        self._shown: Declaration | None = None
        """The machine whose nodes are in the address space."""
        self._nodes: MachineNodes | None = None
        self._units: PackMLUnits | None = None
        self._happenings: MachineEvents | None = None
        self._commands: ClientCommands | None = None
        self._refusals = RefusalLimit(REFUSAL_PAUSE)
        self._utc = 0.0
        self.address = ""
        """The address of the server."""

    @property
    def server(self) -> UaServer:
        assert self._server is not None
        return self._server

    async def open(self) -> None:
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it writes traces of what clients do wrong
        decoding.bound()
        listening = self._endpoint.listening()
        try:
            rights = Rights(self._may_write, self._may_call, self._true_at)
            security = self._security
            server = UaServer(Services(self._write, self._call, rights, security.is_trusted, security.only_secured))
            await self._fill(server)
            limits.tell(server.iserver.aspace)
            await server.iserver.monitoring.prepare(server)
            await _describe(server, self._security.uri(f"urn:{socket.gethostname()}:umo"))
            self._kinds = await Kinds.of(server)
            self._security.apply(server)
            host = f"[{self._endpoint.host}]" if ":" in self._endpoint.host else self._endpoint.host
            self.address = f"opc.tcp://{host}:{listening.getsockname()[1]}"
            server.set_endpoint(self.address)
            await server.listen(listening)
        except BaseException:
            listening.close()
            raise
        self._server = server

    async def _fill(self, server: UaServer) -> None:
        """Create the address space of the standards. The garbage collector is off meanwhile, because none of the 7,000
        nodes is garbage: without it this takes 1.2 s of processor time, with it 1.8 s."""
        collects = gc.isenabled()
        gc.disable()
        try:
            await server.init()
            for name in COMPANIONS:
                await XmlImporter(server, strict_mode=False).import_xml(NODESETS / f"Opc.Ua.{name}.NodeSet2.xml")
        finally:
            if collects:
                gc.enable()

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        before, self._shown = self._shown, None  # if this fails it is built anew
        if before is None or _fixed(before) != _fixed(machine):
            await self._build(machine)
        self._shown = machine
        assert self._nodes is not None and self._kinds is not None
        self._happenings = MachineEvents(self.server, self._kinds, self._nodes)
        self._commands = ClientCommands(self.server.iserver.aspace, self._nodes, commands, self._tell_refusal)

    async def _build(self, machine: Declaration) -> None:
        server = self.server
        if self._tree is not None:
            self._tree.clear()
        namespace = await server.register_namespace(f"urn:umo:{machine.station}")
        spaces = {uri: number for number, uri in enumerate(await server.get_namespace_array())}
        tree = self._tree = NodeTree(server.iserver.aspace, server.iserver.node_mgt_service, namespace)
        nodes = self._nodes = MachineNodes(tree, machine, ua.NodeId(machinery.MACHINES, spaces[machinery.URI]))
        plate = {"ProductInstanceUri": f"urn:umo:{machine.station}", "Model": machine.station} | self._plate
        machinery.add_identification(tree, nodes.root, spaces, plate)
        self._units = PackMLUnits(server, tree, spaces[PACKML])
        await self._units.build(machine, nodes)

    async def frames(self, changes: Changes) -> None:
        nodes, machine, units, happenings = self._nodes, self._shown, self._units, self._happenings
        assert nodes is not None and machine is not None and units is not None and happenings is not None
        for place in changes.places:
            item = machine.items[place]
            value = data_value(item, changes)
            put(nodes.values[place], value)
            if place in nodes.texts:
                put(nodes.texts[place], state_text(item, value))
                units.show(place, value)
            if item.kind is ItemKind.ALARM:
                happenings.alarm(item, float(changes.values[place]), changes.utc)
        self._utc = changes.utc

    async def events(self, events: Sequence[NumberedEvent]) -> None:
        assert self._happenings is not None
        for each in events:
            self._happenings.event(each.event, self._utc)

    async def end(self, why: str) -> None:
        """Mark every value as the last one of the run, and answer the waiting commands."""
        commands, self._commands = self._commands, None
        if commands is not None:
            await commands.close()
        await self.server.iserver.abandon()
        if self._nodes is None or self._units is None or self._happenings is None:
            return
        for each in (*self._nodes.values, *self._nodes.texts.values(), *self._units.values()):
            old = each.value
            if old is not None and old.StatusCode is not None and not old.StatusCode.is_bad():
                put(each, ua.DataValue(old.Value, GONE, old.SourceTimestamp, old.ServerTimestamp))
        self._happenings.end(f"the machine has ended: {why}")

    async def close(self) -> None:
        if self._server is not None:
            await self._server.stop()

    # Commands ----------------------------------------------------------------------------------------------

    async def _write(self, session: UaSession, value: ua.WriteValue) -> Answer:
        space, node = self.server.iserver.aspace, value.NodeId
        if node not in space:
            return Answer(missing(node), "there is no such node")
        if value.AttributeId not in space[node].attributes:
            return Answer(ua.StatusCode(_C.BadAttributeIdInvalid), "it has no such attribute")
        if self._nodes is None or node not in self._nodes.writable:
            return Answer(NOT_WRITABLE, "only actuators and tunable numbers can be written")
        if self._commands is None:
            return GONE_ANSWER
        return await self._commands.write(session, value)

    async def _call(self, session: UaSession, request: ua.CallMethodRequest) -> Answer:
        arguments = list(request.InputArguments or [])
        if (alarm := self._acknowledged(request)) is not None:
            return await self._acknowledge(session, request, alarm, arguments)
        if (code := refusal(self.server.iserver.aspace, request)) is not None:
            return Answer(ua.CallMethodResult(code), "this object has no such method")
        called = None if self._nodes is None else self._nodes.methods.get(request.MethodId)
        if called is None:
            return Answer(call_standard(session, request))
        if self._commands is None:
            return Answer(ua.CallMethodResult(GONE_ANSWER.result), GONE_ANSWER.words)
        return await self._commands.call(session, request.MethodId, arguments, called)

    def _acknowledged(self, request: ua.CallMethodRequest) -> str | None:
        """Return the alarm that a call acknowledges, or None. The called method is that of the alarm, or that of the
        standard."""
        if self._nodes is None:
            return None
        alarm = self._nodes.alarm_of(request.ObjectId)
        own = self._nodes.acknowledging.get(request.MethodId)
        return alarm if alarm is not None and (own == alarm or request.MethodId == ACKNOWLEDGE) else None

    async def _acknowledge(self, session: UaSession, request: Any, alarm: str, arguments: list[Any]) -> Answer:
        """Acknowledge an alarm. If the call names an event that is not the last event of the alarm, the call is
        refused."""
        if self._commands is None or self._happenings is None:
            return Answer(ua.CallMethodResult(GONE_ANSWER.result), GONE_ANSWER.words)
        event = arguments[0].Value if arguments else None
        if event and isinstance(event, bytes) and not self._happenings.is_last(alarm, event):
            unknown = ua.StatusCode(_C.BadEventIdUnknown)
            return Answer(ua.CallMethodResult(unknown), f"{alarm} has changed since that event")
        return await self._commands.call(session, request.MethodId, arguments, acknowledging(alarm))

    # Rights ------------------------------------------------------------------------------------------------

    def _may_write(self, session: Any, node: ua.NodeId) -> bool:
        item = None if self._nodes is None else self._nodes.writable.get(node)
        if item is None or item.verb is None or self._commands is None:
            return False
        return self._commands.may(session, item.verb.name, item.path)

    def _may_call(self, session: Any, method: ua.NodeId) -> bool:
        """True if a session may call a method. Without a session: True if any user may call it."""
        called = None if self._nodes is None else self._nodes.methods.get(method)
        if called is None and self._nodes is not None and (alarm := self._nodes.acknowledging.get(method)) is not None:
            called = acknowledging(alarm)
        if called is None or session is None:
            return called is not None or method in STANDARD
        return self._commands is not None and self._commands.may(session, called.verb.name, called.path or "")

    def _true_at(self, node: ua.NodeId) -> datetime | None:
        """Return the time of the last period that was read, if this is a node of the machine; otherwise None, which
        means now."""
        if self._tree is None or node.NamespaceIndex != self._tree.namespace:
            return None
        return moment(self._utc)

    def _tell_refusal(self, who: str, words: str) -> None:
        """Write a refusal to the variable LastRefusal and report it as an event. There is at most one such event per
        second and user, because more events would displace alarms from the queues of clients."""
        is_event = self._refusals.is_told(who, time.monotonic())
        assert self._tree is not None and self._nodes is not None and self._happenings is not None
        text = ua.Variant(f"{who}: {words}", ua.VariantType.String)
        put(self._tree.value_of(self._nodes.refusal), ua.DataValue(text, SourceTimestamp=datetime.now(UTC)))
        if is_event:
            self._happenings.tell("", f"{who}: {words}", REFUSAL)


def _fixed(machine: Declaration) -> tuple[Any, ...]:
    """Return the data from which the nodes are made."""
    return machine.station, machine.wiring, machine.items, machine.actions, machine.units


async def _describe(server: UaServer, uri: str) -> None:
    server.name, server.application_type = "umo", ua.ApplicationType.Server
    await server.set_application_uri(uri)
    await server.set_build_info("urn:umo", "umo", "umo", umo_version(), "0", datetime.fromtimestamp(0, UTC))
