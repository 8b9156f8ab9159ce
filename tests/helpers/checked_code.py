"""What `umo check` tells of the code of a station that a test has made."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from umo.process.station import Station
from umo.system import packages
from umo_command.check.code_check import mistakes_in


@contextmanager
def own_modules() -> Iterator[None]:
    """The modules of stations that are imported in the block do not outlive it."""
    known = set(sys.modules)
    yield
    for name in [each for each in sys.modules if each.startswith(packages.PREFIX) and each not in known]:
        del sys.modules[name]


def told(station: Station) -> list[str]:
    """The mistakes, without the folder."""
    machine = station.machine()
    station.module("application")
    return [str(each).rpartition("/")[2] for each in mistakes_in(station, machine)]
