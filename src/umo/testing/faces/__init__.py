"""The kit of faces: proves with a client of another project that a face keeps its contract, and says what is broken.

    class OpcUaClient(ForeignClient): ...          # reads, writes and calls as a client of the protocol does

    report = asyncio.run(try_face(TriedFace("opcua", make=OpcUa, client=OpcUaClient)))
    assert report.passed, str(report)

docs/howto-write-a-face.md describes it.
"""

from umo.testing.faces.client import ForeignClient, RefusedByFace, Seen
from umo.testing.faces.face_rules import RULES, Rig, TriedFace, try_face, try_rule
from umo.testing.faces.tried_machine import TriedMachine

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
