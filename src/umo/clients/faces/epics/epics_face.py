"""The face EPICS: a pvAccess server with the objects, axes and actions of a machine."""

from __future__ import annotations

from umo.clients.faces.endpoint import Endpoint, is_local
from umo.clients.faces.epics.epics_variables import EpicsVariables, variables_of
from umo.clients.faces.epics.motor_record import MotorRecord
from umo.clients.faces.epics.pva_server import PvaServer
from umo.clients.faces.face import Changes, Commands, Face
from umo.errors import OptionError
from umo.objects.presentation.identity import escaped, is_word
from umo.process.frames.machine_items import Declaration

PORT, SEARCH_PORT = 5075, 5076
"""The port of the server, and the port on which EPICS's clients search."""


class Epics(Face):
    """Serves pvAccess on this computer. The kernel proves whose process a client is.

    Options:
        prefix: the text before each name; default: the name of the station and a colon.
        port: the TCP port of the server. 0 means a free port, which clients find by searching.
        search_port: the UDP port on which clients search.
        host: an address of this computer that no other computer can reach.
    """

    proves_users = True

    def __init__(
        self, prefix: str = "", port: int = PORT, search_port: int = SEARCH_PORT, host: str = "127.0.0.1"
    ) -> None:
        if not is_local(host):
            raise OptionError(
                f"host {host!r} can be reached from other computers, and pvAccess does not prove who a "
                "user is: leave out `host`, and serve other computers by a gateway that only reads (docs/face-epics.md)"
            )
        if any(each.isspace() for each in prefix):
            raise OptionError(f"prefix {prefix!r} contains a space")
        if not 0 < search_port <= 65535:
            raise OptionError(f"search_port {search_port} is not from 1 to 65535")
        self._prefix, self.search_port = prefix, search_port
        self._server = PvaServer(Endpoint(host, port), search_port)
        self._variables: EpicsVariables | None = None

    async def open(self) -> None:
        self.address = self._server.open()

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        variables = variables_of(machine, self._prefix or f"{escaped(machine.station, _is_station)}:", commands)
        for axis in machine.axes:
            MotorRecord(variables, axis).add()
        variables.add_tree()
        self._server.serve(variables.by_name)
        self._variables = variables

    async def frames(self, changes: Changes) -> None:
        if self._variables is not None:
            self._variables.show(changes)

    async def end(self, why: str) -> None:
        self._server.cancel()
        if self._variables is not None:
            self._variables.end(why)

    async def close(self) -> None:
        await self._server.close()


def _is_station(character: str) -> bool:
    """True if this character of a station's name is used unchanged in a prefix. A colon is not, because it ends the
    prefix."""
    return is_word(character) or character in ".-"
