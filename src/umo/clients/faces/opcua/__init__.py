"""OPC UA: the machine as the address space of a server, for SCADA systems, MES and engineering tools (asyncua).

`umo.clients.faces.opcua.opcua_face` is the face; docs/face-opcua.md describes what clients see.
"""

from umo.clients.faces.opcua.opcua_face import OpcUa

__all__ = ["OpcUa"]
