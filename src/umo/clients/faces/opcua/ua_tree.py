"""Adds nodes of one namespace to asyncua's address space, and removes them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import AddressSpace, AttributeValue, NodeManagementService

from umo.clients.faces.opcua.ua_values import NOT_YET

O = ua.ObjectIds  # noqa: E741
VALUE = ua.AttributeIds.Value
ADMIN = User(role=UserRole.Admin)
READ, READ_WRITE = 1, 3
"""Bits of AccessLevel."""
INT64_BITS = 63


class NodeTree:
    """Adds nodes whose identifiers are strings. The caller must give a name that the parent node does not have yet."""

    def __init__(self, space: AddressSpace, nodes: NodeManagementService, namespace: int) -> None:
        self._space, self._nodes = space, nodes
        self.namespace = namespace
        self._made: list[ua.NodeId] = []

    def id(self, text: str) -> ua.NodeId:
        return ua.NodeId(text, self.namespace)

    def object(
        self, parent: ua.NodeId, text: str, name: str, kind: ua.NodeId | int = O.BaseObjectType, **more: Any
    ) -> ua.NodeId:
        """Add an object, and return its identifier. `more`: see `_add`."""
        return self._add(parent, text, name, ua.NodeClass.Object, ua.ObjectAttributes(), kind, **more)

    def variable(
        self, parent: ua.NodeId, text: str, name: str, kind: int, data_type: int, writable: bool = False, **more: Any
    ) -> ua.NodeId:
        """Add a variable that has no value yet, and return its identifier."""
        about = ua.VariableAttributes()
        about.DataType, about.ValueRank = ua.NodeId(data_type), ua.ValueRank.Scalar
        about.AccessLevel = about.UserAccessLevel = READ_WRITE if writable else READ
        about.MinimumSamplingInterval = 0.0
        node = self._add(parent, text, name, ua.NodeClass.Variable, about, kind, **more)
        self.value_of(node).value = ua.DataValue(StatusCode=NOT_YET)
        return node

    def property(
        self, parent: ua.NodeId, text: str, name: str, value: ua.Variant, data_type: int, own: int = 0
    ) -> ua.NodeId:
        """Add a property with a constant value. `own`: the namespace of its name."""
        about = ua.VariableAttributes()
        about.DataType = ua.NodeId(data_type)
        about.ValueRank = ua.ValueRank.OneDimension if value.is_array else ua.ValueRank.Scalar
        if value.is_array:
            about.ArrayDimensions = [0]
        about.AccessLevel = about.UserAccessLevel = READ
        node = self._add(
            parent, text, name, ua.NodeClass.Variable, about, O.PropertyType, reference=O.HasProperty, own=own
        )
        self.value_of(node).value = ua.DataValue(value)
        return node

    def method(
        self, parent: ua.NodeId, text: str, name: str, given: Sequence[Any], returned: Sequence[Any] = (), **more: Any
    ) -> ua.NodeId:
        about = ua.MethodAttributes()
        about.Executable = about.UserExecutable = True
        node = self._add(parent, text, name, ua.NodeClass.Method, about, None, **more)
        for title, arguments in (("InputArguments", given), ("OutputArguments", returned)):
            if arguments:
                value = ua.Variant(list(arguments), ua.VariantType.ExtensionObject, is_array=True)
                self.property(node, f"{text}/{title}", title, value, O.Argument)
        return node

    def value_of(self, node: ua.NodeId) -> AttributeValue:
        """Return the place at which the value of a variable is stored."""
        return self._space[node].attributes[VALUE]

    def refer(self, source: ua.NodeId, target: ua.NodeId, reference: int) -> None:
        """Add a reference, and its inverse."""
        for one, other, forward in ((source, target, True), (target, source, False)):
            item = ua.AddReferencesItem()
            item.SourceNodeId, item.TargetNodeId, item.IsForward = one, other, forward
            item.ReferenceTypeId, item.TargetNodeClass = ua.NodeId(reference), ua.NodeClass.Unspecified
            self._nodes.add_references([item])[0].check()

    def adopt(self, nodes: Sequence[ua.NodeId]) -> None:
        """Register nodes that other code has added, so that `clear` removes them, too."""
        self._made += nodes

    def clear(self) -> None:
        """Remove every node, and notify the clients that monitor one."""
        unknown = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadNodeIdUnknown))
        made = set(self._made)
        for node in reversed(self._made):
            data = self._space.get(node)
            if data is None:
                continue
            for attribute in data.attributes.values():
                put(attribute, unknown)
                attribute.datachange_callbacks.clear()
            for reference in data.references:
                if reference.NodeId not in made and (other := self._space.get(reference.NodeId)) is not None:
                    other.references[:] = [each for each in other.references if each.NodeId != node]
            del self._space[node]
        self._made = []

    def _add(
        self,
        parent: ua.NodeId,
        text: str,
        name: str,
        node_class: ua.NodeClass,
        about: Any,
        kind: ua.NodeId | int | None,
        reference: int = O.HasComponent,
        own: int | None = None,
        description: str = "",
    ) -> ua.NodeId:
        """Add a node. `kind`: the type of the node; `own`: the namespace of its name, if it is not that of the tree;
        `reference`: the type of the reference from its parent."""
        item = ua.AddNodesItem()
        item.RequestedNewNodeId = self.id(text)
        item.BrowseName = ua.QualifiedName(name, self.namespace if own is None else own)
        item.NodeClass = node_class
        if kind is not None:
            item.TypeDefinition = kind if isinstance(kind, ua.NodeId) else ua.NodeId(kind)
        about.DisplayName, about.Description = ua.LocalizedText(name), ua.LocalizedText(description)
        item.NodeAttributes = about
        result = self._nodes._add_node(item, ADMIN, check=False)
        result.StatusCode.check()
        self._made.append(result.AddedNodeId)
        self._hang(parent, item, ua.NodeId(reference))
        return result.AddedNodeId

    def _hang(self, parent: ua.NodeId, item: Any, reference: ua.NodeId) -> None:
        """Refer to a new node from its parent. asyncua would search all other children first, which takes 8 s for 3,000
        children."""
        above, node = self._space[parent], item.RequestedNewNodeId
        down, up = ua.ReferenceDescription(), ua.ReferenceDescription()
        down.ReferenceTypeId = up.ReferenceTypeId = reference
        down.IsForward, up.IsForward = True, False
        down.NodeId, down.NodeClass, down.BrowseName = node, item.NodeClass, item.BrowseName
        down.DisplayName, down.TypeDefinition = item.NodeAttributes.DisplayName, item.TypeDefinition
        up.NodeId = parent
        for attribute in ("NodeClass", "BrowseName", "DisplayName"):
            setattr(up, attribute, above.attributes[getattr(ua.AttributeIds, attribute)].value.Value.Value)
        above.references.append(down)
        self._space[node].references.append(up)


def put(where: AttributeValue, value: ua.DataValue) -> None:
    """Set a value, and notify the clients that monitor it."""
    where.value = value
    for item in list(where.datachange_callbacks):
        item.take(value)


def argument(name: str, data_type: int, description: str = "") -> ua.Argument:
    return ua.Argument(
        Name=name,
        DataType=ua.NodeId(data_type),
        ValueRank=ua.ValueRank.Scalar,
        Description=ua.LocalizedText(description),
    )


def enum_values(states: Mapping[int, str]) -> ua.Variant:
    """Return the EnumValues of a variable with named values. Values that do not fit an Int64 are left out."""
    names = {number: ua.LocalizedText(name) for number, name in states.items() if number.bit_length() <= INT64_BITS}
    values = [ua.EnumValueType(Value=number, DisplayName=name) for number, name in names.items()]
    return ua.Variant(values, ua.VariantType.ExtensionObject, is_array=True)
