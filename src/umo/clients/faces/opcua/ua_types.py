"""Finds the types of nodes and values by the references of the address space (OPC 10000-3)."""

from __future__ import annotations

from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace

_O = ua.ObjectIds
SUBTYPE = ua.NodeId(_O.HasSubtype)
ANYTHING, NUMBER, ENUMERATION, STRUCTURE = (
    ua.NodeId(each) for each in (_O.BaseDataType, _O.Number, _O.Enumeration, _O.Structure)
)
LAST_BUILT_IN = 25
"""The largest number of a built-in data type. Data types up to this number have an encoding of the same number."""


def supertype(space: AddressSpace, kind: ua.NodeId) -> ua.NodeId:
    """Return the type above another one, or the null NodeId if there is none."""
    node = space.get(kind)
    for each in node.references if node is not None else ():
        if not each.IsForward and each.ReferenceTypeId == SUBTYPE:
            return each.NodeId
    return ua.NodeId()


def lineage(space: AddressSpace, kind: ua.NodeId) -> list[ua.NodeId]:
    """Return a type and all types above it."""
    found: list[ua.NodeId] = []
    while kind in space and kind not in found:
        found.append(kind)
        kind = supertype(space, kind)
    return found


def below(space: AddressSpace, kind: ua.NodeId, above: ua.NodeId) -> bool:
    """True if a type is the other type or one of its subtypes."""
    return kind == above or above in lineage(space, kind)


def encoding(space: AddressSpace, kind: ua.NodeId) -> Any:
    """Return the VariantType in which values of a data type are encoded, or None if the type is abstract."""
    for each in lineage(space, kind):
        if each in (ENUMERATION, STRUCTURE):
            return ua.VariantType.Int32 if each == ENUMERATION else ua.VariantType.ExtensionObject
        if each.NamespaceIndex == 0 and isinstance(each.Identifier, int) and each.Identifier <= LAST_BUILT_IN:
            return None if each == ANYTHING else ua.VariantType(each.Identifier)
    return None


def fits(space: AddressSpace, kind: ua.NodeId, value: ua.Variant) -> bool:
    """True if a value has a data type, or a subtype of it."""
    encoded = encoding(space, kind)
    if encoded is not None:
        return bool(value.VariantType == encoded)
    return kind == ANYTHING or below(space, ua.NodeId(value.VariantType.value), kind)


def is_structure(given: Any, kind: Any) -> bool:
    """True if a decoded value is a structure of the standard. asyncua 2.1 has two classes of some of them."""
    return bool(getattr(given, "data_type", None) == kind.data_type)
