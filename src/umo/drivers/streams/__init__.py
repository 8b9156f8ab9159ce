"""Streams of bytes to devices, over TCP or a serial line, for drivers of protocols."""

from __future__ import annotations

from umo.drivers.streams.line import Serial
from umo.drivers.streams.look import Look
from umo.drivers.streams.place import Host, Place, place_of
from umo.drivers.streams.stream import Gone, Lost, Stream, TimedOut

__all__ = ["Gone", "Host", "Look", "Lost", "Place", "Serial", "Stream", "TimedOut", "place_of"]
