"""Equipment with PackML's states as an object of OPC 30050 (PackML)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from asyncua import Node, ua

from umo.clients.faces.opcua.ua_machine import IDENTITIES, UNIT, Called, MachineNodes
from umo.clients.faces.opcua.ua_tree import NodeTree, O, put
from umo.operation.commands.verbs import CALL
from umo.operation.packml import PACKML, PackMLState
from umo.process.frames.machine_items import Declaration

URI = "http://opcfoundation.org/UA/PackML/"
BASE_TYPE, OBJECTS = 6, 72
"""Nodes of OPC 30050: PackMLBaseObjectType, Objects/PackMLObjects."""
_S = PackMLState
BASE, MACHINE, EXECUTE = (
    "BaseStateMachine",
    "BaseStateMachine.MachineState",
    "BaseStateMachine.MachineState.ExecuteState",
)
"""The state machines. Each one is nested in a state of the one before it."""
ABORTED, CLEARED, RUNNING = {_S.ABORTING: 61, _S.ABORTED: 62}, 71, 75
IN_MACHINE = {_S.CLEARING: 55, _S.STOPPED: 53, _S.STOPPING: 54}
IN_EXECUTE = {
    _S.RESETTING: 27, _S.IDLE: 28, _S.STARTING: 29, _S.SUSPENDING: 30, _S.SUSPENDED: 31, _S.UNSUSPENDING: 32,
    _S.HOLDING: 33, _S.HELD: 34, _S.UNHOLDING: 35, _S.EXECUTE: 36, _S.COMPLETING: 37, _S.COMPLETE: 38,
}  # fmt: skip
"""Node numbers of the states."""
METHODS: Mapping[str, Mapping[str, str]] = {
    BASE: {"Abort": "abort", "Clear": "clear"},
    MACHINE: {"Stop": "stop", "Reset": "reset"},
    EXECUTE: {
        "Reset": "reset", "Start": "start", "Hold": "hold", "Unhold": "unhold", "Suspend": "suspend",
        "Unsuspend": "unsuspend", "ToComplete": "complete",
    },
}  # fmt: skip
"""The methods of each state machine, each with its command of umo."""


def inside(state: PackMLState) -> list[tuple[str, int, str]]:
    """Return the state of each state machine, the outermost first: the name of the state machine, and the node and name
    of its state. They are 0 and "" if the state machine is in no state."""
    name = state.name.title()
    if state in ABORTED:
        return [(BASE, ABORTED[state], name), (MACHINE, 0, ""), (EXECUTE, 0, "")]
    if state in IN_MACHINE:
        return [(BASE, CLEARED, "Cleared"), (MACHINE, IN_MACHINE[state], name), (EXECUTE, 0, "")]
    return [(BASE, CLEARED, "Cleared"), (MACHINE, RUNNING, "Running"), (EXECUTE, IN_EXECUTE[state], name)]


class PackMLUnits:
    """The objects of all units of a machine that have PackML's states; units with other state models have no such
    object."""

    def __init__(self, server: Any, tree: NodeTree, namespace: int) -> None:
        self._server, self._tree, self._namespace = server, tree, namespace
        self._states: dict[int, str] = {}
        """The identifier of each unit, by the number of the item that is its state."""
        self._modes: dict[int, str] = {}

    async def build(self, machine: Declaration, nodes: MachineNodes) -> None:
        for unit in machine.units:
            if unit["model"] == PACKML.name:
                await self._add(unit, machine, nodes)

    async def _add(self, unit: Mapping[str, Any], machine: Declaration, nodes: MachineNodes) -> None:
        path, tree = str(unit["path"]), self._tree
        text = IDENTITIES.of(path, "packml")
        parent = Node(self._server.iserver.isession, nodes.part(str(unit["part"])))
        kind = ua.NodeId(BASE_TYPE, self._namespace)
        name = ua.QualifiedName(UNIT, tree.namespace)
        made = await parent.add_object(tree.id(text), name, objecttype=kind, instantiate_optional=False)
        tree.adopt([made.nodeid, *await _below(made)])
        tree.refer(ua.NodeId(OBJECTS, self._namespace), made.nodeid, O.Organizes)
        supported = [ua.EnumValueType(Value=int(n), DisplayName=ua.LocalizedText(t)) for n, t in unit["modes"].items()]
        modes = ua.Variant(supported, ua.VariantType.ExtensionObject, is_array=True)
        tree.value_of(tree.id(f"{text}.Status.UnitSupportedModes")).value = ua.DataValue(modes)
        for each in ("CurMachSpeed", "MachSpeed", "EquipmentBlocked", "EquipmentStarved"):
            missing = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadNotSupported))
            tree.value_of(tree.id(f"{text}.Status.{each}")).value = missing
        for machine_name, methods in METHODS.items():
            for title, command in methods.items():
                where = tree.id(f"{text}.{machine_name}")
                node = tree.method(where, f"{text}.{machine_name}.{title}", title, (), own=self._namespace)
                nodes.methods[node] = Called(CALL, f"{path}.{command}", {})
        self._states[machine.by_name[f"{path}.state"].number] = text
        self._modes[machine.by_name[f"{path}.mode"].number] = text

    def show(self, place: int, value: ua.DataValue) -> None:
        """Show the new state or mode of a unit, if this item is a state or a mode."""
        if place in self._modes:
            put(self._tree.value_of(self._tree.id(f"{self._modes[place]}.Status.UnitModeCurrent")), value)
        if place not in self._states:
            return
        text = self._states[place]
        number = None if value.Value is None else value.Value.Value
        states = [(each, 0, "") for each in (BASE, MACHINE, EXECUTE)] if number is None else inside(_S(int(number)))
        for name, node, title in states:
            shown = ua.Variant(ua.LocalizedText(title), ua.VariantType.LocalizedText)
            where = ua.Variant(ua.NodeId(node, self._namespace) if node else ua.NodeId(), ua.VariantType.NodeId)
            for key, variant in ((f"{text}.{name}.CurrentState", shown), (f"{text}.{name}.CurrentState.Id", where)):
                told = ua.DataValue(variant, value.StatusCode, value.SourceTimestamp, value.ServerTimestamp)
                put(self._tree.value_of(self._tree.id(key)), told)

    def values(self) -> list[Any]:
        """Return the places at which the values that describe a run are stored."""
        keys = [f"{text}.Status.UnitModeCurrent" for text in self._modes.values()]
        keys += [
            f"{text}.{name}.CurrentState{each}"
            for text in self._states.values() for name in METHODS for each in ("", ".Id")
        ]  # fmt: skip
        return [self._tree.value_of(self._tree.id(each)) for each in keys]


async def _below(node: Any) -> list[ua.NodeId]:
    """Return the nodes below a node that were created with it."""
    found: list[ua.NodeId] = []
    for each in await node.get_references(ua.ObjectIds.Aggregates, ua.BrowseDirection.Forward):
        if each.NodeId.NamespaceIndex == node.nodeid.NamespaceIndex:
            found += [each.NodeId, *await _below(Node(node.session, each.NodeId))]
    return found
