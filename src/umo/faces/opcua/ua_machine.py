"""The nodes of a machine: its parts, objects, states, numbers and actions (OPC 10000-8; OPC 40001-1 Machinery)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AttributeValue

from umo.clients.client_commands import Mode
from umo.faces.face_declaration import Declaration, FaceItem, ItemKind
from umo.faces.opcua.ua_tree import NodeTree, O, argument, enum_values
from umo.faces.opcua.ua_values import is_switch, type_of, unit_of
from umo.presentation.identity import Identities, escaped, is_text

RUN, ALARMS, REFUSAL = "Run", "Alarms", "LastRefusal"
EQUIPMENT, AXIS, UNIT = "EquipmentState", "AxisState", "PackML"
"""Names of nodes of umo's own, beside those of the machine."""
IDENTITIES = Identities(".", ":", is_text, frozenset({"machine", "refusal"}))
"""Identifiers of nodes. What belongs to a node has its identifier, a slash and a name."""
PARTS = Identities(".", ":", is_text, frozenset({RUN, ALARMS}))
"""Identifiers of parts; two folders of umo's own have such ones."""
ARGUMENT_TYPES: Mapping[str, int] = {"number": O.Double, "integer": O.Int64, "bool": O.Boolean}
"""Data types of the arguments of actions by their kinds; the others are texts."""
RESULT = argument("Result", O.BaseDataType, "what the action returns; a list or a mapping as text")
PATH = argument("Path", O.String, 'path in the machine; "": everything')
MODES = ({"name": "Mode", "required": True, "choices": tuple(str(each) for each in Mode)},)
"""What SetMode takes."""
COMMANDS: tuple[tuple[str, str, tuple[ua.Argument, ...], str], ...] = (
    ("SetMode", "mode", (argument("Mode", O.String, "automatic or manual"),), "Change the mode."),
    ("Stop", "stop", (), "End the run as after a signal: every actuator goes to its default."),
    ("LetGo", "let go", (PATH,), "End what this client holds: a written actuator, a jog."),
    ("Cancel", "cancel", (PATH,), "Cancel an action."),
    ("Clear", "clear", (PATH,), "End the faults of equipment."),
    ("Acknowledge", "acknowledge", (PATH,), "Acknowledge latched interlocks."),
    ("AcknowledgeAlarms", "acknowledge alarm", (PATH,), "Acknowledge alarms."),
)
"""Methods of the machine: name, command, arguments, meaning."""
OF_PARTS = frozenset({EQUIPMENT, AXIS, UNIT})
OF_THE_MACHINE = OF_PARTS | {RUN, ALARMS, REFUSAL, *(name for name, *_ in COMMANDS)}
"""Names of umo's own nodes in each part, and in the machine."""
ALARM_COMMANDS: tuple[tuple[str, str, tuple[ua.Argument, ...], str], ...] = (
    ("Reset", "reset alarm", (), "Reset it, if it is latched."),
    ("Shelve", "shelve", (argument("Time", O.Double, "s"),), "Put it away for a time."),
    ("Unshelve", "unshelve", (), "Bring it back."),
    ("RemoveFromService", "remove from service", (), "Put it away for maintenance."),
    ("ReturnToService", "return to service", (), "Bring it back."),
)
"""Methods of each alarm, beside the Acknowledge of the standard."""
EVENT = (argument("EventId", O.ByteString, "of the event that is acknowledged; nothing: of the last one"),)
COMMENT = (argument("Comment", O.LocalizedText, "is not kept"),)


@dataclass(frozen=True)
class Called:
    """What a method does. `kinds`: of its arguments by their names."""

    do: str
    path: str | None
    """None: the argument `Path` tells."""
    kinds: Mapping[str, str]
    keeps_up: bool = False
    arguments: Sequence[Mapping[str, Any]] = ()
    """What an action declares of them."""

    @property
    def optional(self) -> frozenset[str]:
        """Arguments that have a default."""
        return frozenset(each["name"] for each in self.arguments if not each["required"])


def acknowledging(alarm: str) -> Called:
    """What Acknowledge does. Its arguments may be null; they are no arguments of the command."""
    optional = tuple({"name": each.Name, "required": False} for each in (*EVENT, *COMMENT))
    return Called("acknowledge alarm", alarm, {}, arguments=optional)


def browse_name(path: str) -> str:
    """The name of what has this path, within its part: never that of a node of umo's own."""
    part, _, name = path.rpartition(".")
    return escaped(name, is_text, OF_PARTS if part else OF_THE_MACHINE)


class MachineNodes:
    """`machines`: the node Objects/Machines of OPC 40001-1."""

    def __init__(self, tree: NodeTree, machine: Declaration, machines: ua.NodeId) -> None:
        self._tree, self._machine = tree, machine
        self._tuned = {item.path for item in machine.of_kind(ItemKind.TUNABLE)}
        self.texts: dict[int, AttributeValue] = {}
        """ValueAsText of those items that have it."""
        self.writable: dict[ua.NodeId, FaceItem] = {}
        self.methods: dict[ua.NodeId, Called] = {}
        self.alarms: dict[str, ua.NodeId] = {}
        """The object of each alarm."""
        self.acknowledging: dict[ua.NodeId, str] = {}
        """The alarm that each method Acknowledge is for."""
        self.by_path: dict[str, ua.NodeId] = {}
        """Objects, parts, signals by their paths."""
        self.root = tree.object(machines, "machine", machine.station, reference=O.Organizes, description=machine.wiring)
        self._parts: dict[str, ua.NodeId] = {"": self.root}
        self._folders: dict[str, ua.NodeId] = {}
        self.refusal = tree.variable(
            self.root, "refusal", REFUSAL, O.BaseDataVariableType, O.String,
            description="The last command that was refused: whose, and why.",
        )  # fmt: skip
        nodes = {item.number: self._add(item) for item in sorted(machine.items, key=_depth)}
        self.values: list[AttributeValue] = [tree.value_of(nodes[item.number]) for item in machine.items]
        """Where the value of each item stands, by its number."""
        for action in machine.actions:
            self._add_action(action)
        for name, do, given, text in COMMANDS:
            self._add_command(self.root, f"command:{do}", (name, do, given, text), None if given else "")

    def part(self, path: str) -> ua.NodeId:
        """The object of a compound; "": the machine. What is below an object (its velocity) is below its variable."""
        if path not in self._parts:
            above = self.part(path.rpartition(".")[0])
            self._parts[path] = self._tree.object(above, PARTS.of(path, "part"), browse_name(path))
            self.by_path.setdefault(path, self._parts[path])
        return self._parts[path]

    def _folder(self, name: str) -> ua.NodeId:
        """A folder of umo's own in the machine."""
        if name not in self._folders:
            self._folders[name] = self._tree.object(self.root, f"part:{name}", name)
        return self._folders[name]

    def alarm_of(self, node: ua.NodeId) -> str | None:
        """The alarm whose object this is; None: of none."""
        return next((path for path, each in self.alarms.items() if each == node), None)

    # Items -------------------------------------------------------------------------------------------------

    def _add(self, item: FaceItem) -> ua.NodeId:
        parent, name = self._place(item)
        node = (self._state if item.states else self._number)(parent, name, item)
        if item.name == item.path:
            self.by_path[item.path] = self._parts[item.path] = node
        if item.writable:
            self.writable[node] = item
        return node

    def _place(self, item: FaceItem) -> tuple[ua.NodeId, str]:
        """Parent and name of its variable."""
        if item.kind is ItemKind.ALARM:
            return self._alarm(item), "State"
        if item.kind in (ItemKind.EQUIPMENT, ItemKind.AXIS):
            return self.part(item.path), EQUIPMENT if item.kind is ItemKind.EQUIPMENT else AXIS
        if item.kind is ItemKind.RUN:
            return self._folder(RUN), item.path
        name = browse_name(item.path)
        is_twin = item.kind is ItemKind.SIGNAL and item.path in self._tuned
        return self.part(item.path.rpartition(".")[0]), f"{name}/shown" if is_twin else name

    def _number(self, parent: ua.NodeId, name: str, item: FaceItem) -> ua.NodeId:
        bounds = [-inf if item.minimum is None else item.minimum, inf if item.maximum is None else item.maximum]
        has_range = bounds != [-inf, inf]
        kinds = {
            (True, True): O.AnalogUnitRangeType,
            (True, False): O.AnalogUnitType,
            (False, True): O.AnalogItemType,
            (False, False): O.BaseDataVariableType,
        }
        kind, text = kinds[bool(item.unit), has_range], item.identity(IDENTITIES)
        node = self._tree.variable(parent, text, name, kind, O.Double, item.writable, description=item.path)
        for wanted, title, value, data_type in (
            (has_range, "EURange", ua.Range(*bounds), O.Range),
            (bool(item.unit), "EngineeringUnits", unit_of(item), O.EUInformation),
        ):
            if wanted:
                variant = ua.Variant(value, ua.VariantType.ExtensionObject)
                self._tree.property(node, f"{text}/{title}", title, variant, data_type)
        return node

    def _state(self, parent: ua.NodeId, name: str, item: FaceItem) -> ua.NodeId:
        """Two states, 0 and 1, are a Boolean; others are a number with a name."""
        switch, text = is_switch(item), item.identity(IDENTITIES)
        kind = O.TwoStateDiscreteType if switch else O.MultiStateValueDiscreteType
        node = self._tree.variable(parent, text, name, kind, type_of(item).value, item.writable, description=item.path)
        if switch:
            for number, title in enumerate(("FalseState", "TrueState")):
                state = ua.Variant(ua.LocalizedText(item.states[number]), ua.VariantType.LocalizedText)
                self._tree.property(node, f"{text}/{title}", title, state, O.LocalizedText)
            return node
        self._tree.property(node, f"{text}/EnumValues", "EnumValues", enum_values(item.states), O.EnumValueType)
        nothing = ua.Variant(ua.LocalizedText(""), ua.VariantType.LocalizedText)
        shown = self._tree.property(node, f"{text}/ValueAsText", "ValueAsText", nothing, O.LocalizedText)
        self.texts[item.number] = self._tree.value_of(shown)
        return node

    def _alarm(self, item: FaceItem) -> ua.NodeId:
        """The object of an alarm in the folder Alarms, named by its path."""
        about = f"{item.about.get('text', '')} (priority {item.about.get('priority', '')})"
        own = IDENTITIES.of(item.path, "condition")
        node = self._tree.object(self._folder(ALARMS), own, IDENTITIES.part(item.path), description=about)
        self.alarms[item.path] = node
        given = (*EVENT, *COMMENT)
        method = self._tree.method(
            node, f"{own}/Acknowledge", "Acknowledge", given, own=0, description="Acknowledge it."
        )
        self.acknowledging[method] = item.path
        for command in ALARM_COMMANDS:
            self._add_command(node, f"{own}/{command[0]}", command, item.path)
        return node

    # Methods -----------------------------------------------------------------------------------------------

    def _add_command(self, parent: ua.NodeId, text: str, command: Any, path: str | None) -> None:
        name, do, given, about = command
        node = self._tree.method(parent, text, name, given, (RESULT,), description=about)
        kinds = {each.Name: "text" if each.Name != "Time" else "number" for each in given}
        self.methods[node] = Called(do, path, kinds, arguments=MODES if do == "mode" else ())

    def _add_action(self, action: Mapping[str, Any]) -> None:
        path, arguments = str(action["path"]), action["arguments"]
        given = [argument(each["name"], ARGUMENT_TYPES.get(each["kind"], O.String), _about(each)) for each in arguments]
        text = str(action.get("help") or "")
        part, name = self.part(path.rpartition(".")[0]), browse_name(path)
        node = self._tree.method(part, IDENTITIES.of(path, "action"), name, given, (RESULT,), description=text)
        kinds = {each["name"]: each["kind"] for each in arguments}
        self.methods[node] = Called("call", path, kinds, bool(action.get("dead_man")), tuple(arguments))


def _depth(item: FaceItem) -> int:
    """An object stands before what is below it."""
    return item.path.count(".")


def _about(each: Mapping[str, Any]) -> str:
    """An argument in words: its range, choices, default."""
    parts = []
    if each["kind"] in ("number", "integer"):
        low, high = (each.get(key) for key in ("minimum", "maximum"))
        bounds = [f"{word} {bound:g}" for word, bound in (("from", low), ("to", high)) if bound is not None]
        parts.append(" ".join([*bounds, str(each.get("unit") or "")]).strip())
    if each.get("choices"):
        parts.append(f"one of {', '.join(each['choices'])}")
    if not each["required"]:
        parts.append(f"optional, default {each.get('default')}")
    return "; ".join(filter(None, parts))
