"""The nodes of a machine: its parts, objects, states, numbers and actions (OPC 10000-8; OPC 40001-1 Machinery)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AttributeValue

from umo.clients.faces.opcua.ua_tree import NodeTree, O, argument, enum_values
from umo.clients.faces.opcua.ua_values import is_switch, type_of, unit_of
from umo.objects.presentation.identity import Identities, escaped, is_text
from umo.operation.commands.verb import ArgumentKind, Names, Verb
from umo.operation.commands.verbs import ACKNOWLEDGE_ALARM, CALL, naming, offered
from umo.process.frames.machine_items import Declaration, ItemKind, MachineItem

RUN, ALARMS, REFUSAL = "Run", "Alarms", "LastRefusal"
EQUIPMENT, AXIS, UNIT = "EquipmentState", "AxisState", "PackML"
"""Names of nodes that umo adds to those of the machine."""
IDENTITIES = Identities(".", ":", is_text, frozenset({"machine", "refusal"}))
"""Identifiers of nodes. The identifier of a node is that of its parent, a slash and a name."""
PARTS = Identities(".", ":", is_text, frozenset({RUN, ALARMS}))
"""Identifiers of parts. Two folders that umo adds also have such identifiers."""
ARGUMENT_TYPES: Mapping[str, int] = {"number": O.Double, "integer": O.Int64, "bool": O.Boolean}
"""Data types of the arguments of actions by their kinds; arguments of other kinds are strings."""
RESULT = argument("Result", O.BaseDataType, "what the action returns; a list or a mapping as text")
PATH = "Path"
"""The argument that contains the path of a verb."""
VERB_TYPES: Mapping[ArgumentKind, int] = {
    ArgumentKind.NUMBER: O.Double,
    ArgumentKind.TIME: O.Double,
    ArgumentKind.FLAG: O.Boolean,
    ArgumentKind.VALUE: O.BaseDataType,
}
"""Data types of the arguments of verbs by their kinds; arguments of other kinds are strings, and those of an action are
JSON."""
OF_PARTS = frozenset({EQUIPMENT, AXIS, UNIT})
"""Names of the nodes that umo adds to each part."""
EVENT = (argument("EventId", O.ByteString, "EventId of the event to acknowledge; empty for the last event"),)
COMMENT = (argument("Comment", O.LocalizedText, "accepted, and not stored"),)


@dataclass(frozen=True)
class Called:
    """The effect of a method. `kinds`: the types of its arguments by name."""

    verb: Verb
    path: str | None
    """The path of the verb; None if the argument `Path` contains it."""
    kinds: Mapping[str, str]
    keeps_up: bool = False
    arguments: Sequence[Mapping[str, Any]] = ()
    """The arguments in the form in which the action or the verb declares them."""

    @property
    def optional(self) -> frozenset[str]:
        """Arguments that have a default."""
        return frozenset(each["name"] for each in self.arguments if not each["required"])


def acknowledging(alarm: str) -> Called:
    """Return the effect of the method Acknowledge. Its arguments may be null, and they are not passed on to the
    command."""
    optional = tuple({"name": each.Name, "required": False} for each in (*EVENT, *COMMENT))
    return Called(ACKNOWLEDGE_ALARM, alarm, {}, arguments=optional)


def calling(verb: Verb, path: str | None) -> Called:
    """Return the effect of the method of a verb. `path` is None if the argument `Path` contains the path."""
    own = [each.plain() | {"name": each.name.capitalize()} for each in verb.arguments]
    about = own if path is not None else [{"name": PATH, "kind": "text", "required": True}, *own]
    return Called(verb, path, {each["name"]: each["kind"] for each in about}, verb.is_kept_up, tuple(about))


def of_the_machine() -> frozenset[str]:
    """Return the names of the nodes that umo adds to the machine."""
    return OF_PARTS | {RUN, ALARMS, REFUSAL, *(verb.title for verb in offered())}


def browse_name(path: str) -> str:
    """Return the name of the node with this path, within its part. The name never equals that of a node that umo
    adds."""
    part, _, name = path.rpartition(".")
    return escaped(name, is_text, OF_PARTS if part else of_the_machine())


class MachineNodes:
    """The nodes of one machine. `machines` is the node Objects/Machines of OPC 40001-1."""

    def __init__(self, tree: NodeTree, machine: Declaration, machines: ua.NodeId) -> None:
        self._tree, self._machine = tree, machine
        self._tuned = {item.path for item in machine.of_kind(ItemKind.TUNABLE)}
        self.texts: dict[int, AttributeValue] = {}
        """The nodes ValueAsText of the items that have one."""
        self.writable: dict[ua.NodeId, MachineItem] = {}
        self.methods: dict[ua.NodeId, Called] = {}
        self.alarms: dict[str, ua.NodeId] = {}
        """The object of each alarm."""
        self.acknowledging: dict[ua.NodeId, str] = {}
        """The alarm that each method Acknowledge acknowledges."""
        self.by_path: dict[str, ua.NodeId] = {}
        """The nodes of objects, parts and signals by their paths."""
        self.root = tree.object(machines, "machine", machine.station, reference=O.Organizes, description=machine.wiring)
        self._parts: dict[str, ua.NodeId] = {"": self.root}
        self._folders: dict[str, ua.NodeId] = {}
        self.refusal = tree.variable(
            self.root, "refusal", REFUSAL, O.BaseDataVariableType, O.String,
            description="The last refused command, with its user and the reason.",
        )  # fmt: skip
        nodes = {item.number: self._add(item) for item in sorted(machine.items, key=_depth)}
        self.values: list[AttributeValue] = [tree.value_of(nodes[item.number]) for item in machine.items]
        """The place of each item's value, by the number of the item."""
        for action in machine.actions:
            self._add_action(action)
        for verb in offered():
            path = "" if verb.names is Names.NOTHING else None
            self._add_verb(self.root, f"command:{verb.name}", verb.title, calling(verb, path))

    def part(self, path: str) -> ua.NodeId:
        """Return the object of a compound; "" means the machine. If the path is that of an object, the nodes below it,
        such as a velocity, are below the object's variable."""
        if path not in self._parts:
            above = self.part(path.rpartition(".")[0])
            self._parts[path] = self._tree.object(above, PARTS.of(path, "part"), browse_name(path))
            self.by_path.setdefault(path, self._parts[path])
        return self._parts[path]

    def _folder(self, name: str) -> ua.NodeId:
        """Return a folder that umo itself adds to the machine."""
        if name not in self._folders:
            self._folders[name] = self._tree.object(self.root, f"part:{name}", name)
        return self._folders[name]

    def alarm_of(self, node: ua.NodeId) -> str | None:
        """Return the alarm of this object, or None."""
        return next((path for path, each in self.alarms.items() if each == node), None)

    # Items -------------------------------------------------------------------------------------------------

    def _add(self, item: MachineItem) -> ua.NodeId:
        parent, name = self._place(item)
        node = (self._state if item.states else self._number)(parent, name, item)
        if item.name == item.path:
            self.by_path[item.path] = self._parts[item.path] = node
        if item.writable:
            self.writable[node] = item
        return node

    def _place(self, item: MachineItem) -> tuple[ua.NodeId, str]:
        """Return the parent and the name of the variable of an item."""
        if item.kind is ItemKind.ALARM:
            return self._alarm(item), "State"
        if item.kind in (ItemKind.EQUIPMENT, ItemKind.AXIS):
            return self.part(item.path), EQUIPMENT if item.kind is ItemKind.EQUIPMENT else AXIS
        if item.kind is ItemKind.RUN:
            return self._folder(RUN), item.path
        name = browse_name(item.path)
        is_twin = item.kind is ItemKind.SIGNAL and item.path in self._tuned
        return self.part(item.path.rpartition(".")[0]), f"{name}/shown" if is_twin else name

    def _number(self, parent: ua.NodeId, name: str, item: MachineItem) -> ua.NodeId:
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

    def _state(self, parent: ua.NodeId, name: str, item: MachineItem) -> ua.NodeId:
        """Add the variable of a state. If the states are 0 and 1, the variable is a Boolean; otherwise it is a number
        with a name for each state."""
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

    def _alarm(self, item: MachineItem) -> ua.NodeId:
        """Add the object of an alarm to the folder Alarms. The path of the alarm is the object's name."""
        about = f"{item.about.get('text', '')} (priority {item.about.get('priority', '')})"
        own = IDENTITIES.of(item.path, "condition")
        node = self._tree.object(self._folder(ALARMS), own, IDENTITIES.part(item.path), description=about)
        self.alarms[item.path] = node
        given = (*EVENT, *COMMENT)
        method = self._tree.method(
            node, f"{own}/Acknowledge", "Acknowledge", given, own=0, description="Acknowledge it."
        )
        self.acknowledging[method] = item.path
        for verb in naming(Names.ALARM):
            if verb is not ACKNOWLEDGE_ALARM:  # which the standard has a method for
                name = verb.title.removesuffix("Alarm")
                self._add_verb(node, f"{own}/{name}", name, calling(verb, item.path))
        return node

    # Methods -----------------------------------------------------------------------------------------------

    def _add_verb(self, parent: ua.NodeId, text: str, name: str, called: Called) -> None:
        verb = called.verb
        path = (argument(PATH, O.String, verb.names.value),) if called.path is None else ()
        own = (
            argument(each.name.capitalize(), VERB_TYPES.get(each.kind, O.String), f"{each.help} {each.range}")
            for each in verb.arguments
        )
        node = self._tree.method(parent, text, name, (*path, *own), (RESULT,), description=verb.help)
        self.methods[node] = called

    def _add_action(self, action: Mapping[str, Any]) -> None:
        path, arguments = str(action["path"]), action["arguments"]
        given = [argument(each["name"], ARGUMENT_TYPES.get(each["kind"], O.String), _about(each)) for each in arguments]
        text = str(action.get("help") or "")
        part, name = self.part(path.rpartition(".")[0]), browse_name(path)
        node = self._tree.method(part, IDENTITIES.of(path, "action"), name, given, (RESULT,), description=text)
        kinds = {each["name"]: each["kind"] for each in arguments}
        self.methods[node] = Called(CALL, path, kinds, bool(action.get("dead_man")), tuple(arguments))


def _depth(item: MachineItem) -> int:
    """Return the depth of an item, by which an object is sorted before the items below it."""
    return item.path.count(".")


def _about(each: Mapping[str, Any]) -> str:
    """Return the range, choices and default of an argument as text."""
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
