"""The name plate of a machine (OPC 40001-1 Machinery, with the types of OPC 10000-100)."""

from __future__ import annotations

from collections.abc import Mapping

from asyncua import ua

from umo.clients.faces.opcua.ua_tree import NodeTree, O

URI, DEVICES = "http://opcfoundation.org/UA/Machinery/", "http://opcfoundation.org/UA/DI/"
MACHINES, IDENTIFICATION_TYPE = 1001, 1012
"""Nodes of OPC 40001-1: Objects/Machines, MachineIdentificationType."""


def add_identification(tree: NodeTree, root: ua.NodeId, spaces: Mapping[str, int], about: Mapping[str, str]) -> None:
    """Add the add-in Identification below the machine and below its building blocks. `spaces`: the indices of the
    namespaces."""
    own, devices = spaces[URI], spaces[DEVICES]
    kind = ua.NodeId(IDENTIFICATION_TYPE, own)
    plate = tree.object(root, "identification", "Identification", kind, reference=O.HasAddIn, own=devices)
    for name, text in about.items():
        is_title = name in ("Manufacturer", "Model")
        value = ua.Variant(ua.LocalizedText(text)) if is_title else ua.Variant(text, ua.VariantType.String)
        data_type = O.LocalizedText if is_title else O.String
        tree.property(plate, f"identification/{name}", name, value, data_type, own=devices)
    blocks = tree.object(root, "blocks", "MachineryBuildingBlocks", O.FolderType, own=own)
    tree.refer(blocks, plate, O.HasAddIn)
