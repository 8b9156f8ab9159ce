"""The transitions of PackML as OPC 30050 has them, from its NodeSet2 (`Opc.Ua.PackML.NodeSet2.xml`, in the npm package
node-opcua-nodesets): `python tools/packml_transitions.py FILE > tests/helpers/packml_opc30050.json`."""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as xml
from collections.abc import Iterator

NAMESPACE = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
FROM, TO, CAUSE = "i=51", "i=52", "i=53"
"""The types of references: FromState, ToState, HasCause."""
Transition = tuple[str, str, str]


def transitions(file: str) -> Iterator[Transition]:
    """From, to, cause ("": the state's own end)."""
    root = xml.parse(file).getroot()
    alias = {each.get("Alias"): each.text for each in root.iter(f"{NAMESPACE}Alias")}
    nodes = {each.get("NodeId"): each for each in root if each.get("NodeId")}

    def name(node: str | None) -> str:
        return str(nodes[node].get("BrowseName")).partition(":")[2]

    for node in nodes.values():
        found: dict[str, str] = {}
        for reference in node.iter(f"{NAMESPACE}Reference"):
            kind = str(reference.get("ReferenceType"))
            kind = str(alias.get(kind, kind))
            if kind in (FROM, TO, CAUSE) and reference.get("IsForward") != "false":
                found[kind] = name(reference.text)
        if FROM in found and TO in found:
            yield found[FROM], found[TO], found.get(CAUSE, "")


if __name__ == "__main__":
    print(json.dumps(sorted(transitions(sys.argv[1])), indent=1))
