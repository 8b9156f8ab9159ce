"""The kit of faces: proves with a client of another project that a face keeps its contract, and says what is broken.

    class OpcUaClient(ForeignClient): ...          # reads, writes and calls as a client of the protocol does

    report = asyncio.run(try_face(Subject("opcua", make=OpcUa, client=OpcUaClient)))
    assert report.passed, str(report)

docs/howto-write-a-face.md describes it.
"""

from umo.testing.faces.client import ForeignClient, Refused, Seen
from umo.testing.faces.machine import Machine
from umo.testing.faces.rules import RULES, Rig, Subject, try_face, try_rule

__all__ = ["RULES", "ForeignClient", "Machine", "Refused", "Rig", "Seen", "Subject", "try_face", "try_rule"]
