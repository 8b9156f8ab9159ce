"""The conformance kit for faces: proves with a client of another project that a face keeps its contract, and says what
is broken.

    class OpcUaClient(ForeignClient): ...          # reads, writes and calls as a client of the protocol does

    report = asyncio.run(try_face(TriedFace("opcua", make=OpcUa, client=OpcUaClient)))
    assert report.passed, str(report)

docs/howto-write-a-face.md describes it.
"""

from umo.clients.faces.conformance.client import ForeignClient, RefusedByFace, Seen
from umo.clients.faces.conformance.face_rules import RULES, Rig, TriedFace, try_face, try_rule
from umo.clients.faces.conformance.tried_machine import TriedMachine

__all__ = [
    "RULES",
    "ForeignClient",
    "RefusedByFace",
    "Rig",
    "Seen",
    "TriedFace",
    "TriedMachine",
    "try_face",
    "try_rule",
]
