"""EPICS: the machine as process variables, which pvAccess clients read, write and call."""

from umo.clients.faces.epics.epics_face import Epics

__all__ = ["Epics"]
