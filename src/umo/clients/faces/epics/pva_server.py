"""The pvAccess server of a face. p4p calls the server from p4p's threads; commands are carried out in the face's
loop."""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from p4p import Value
from p4p.server import DynamicProvider, Server, ServerOperation, StaticProvider
from p4p.server.raw import SharedPV

from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.epics.process_variable import CarryOut, ProcessVariable, result
from umo.clients.faces.face import User
from umo.clients.faces.kept_tasks import KeptTasks
from umo.errors import CommandRefused, UmoError, text_of
from umo.system.peer_account import account_of, peer_uid

BEGUN_AFTER = 1.0
"""Time in s after which a put that does not wait for completion is answered if the machine has not refused it."""
SILENCE = 20
"""Time in s after which a client that hangs counts as disconnected; its library sends a heartbeat every 15 s."""
MAX_CHANNELS = 1000
"""Largest number of channels to variables that clients hold. Each client has a separate channel."""
MAX_ASKED = 32
"""Largest number of puts and calls of one connection whose user is being looked up. The limit keeps a flood from
delaying other connections for long."""


class PvaServer:
    """Serves `variables` by name. `search_port`: the UDP port on which clients search for names."""

    def __init__(self, endpoint: Endpoint, search_port: int) -> None:
        self._endpoint, self._search_port = endpoint, search_port
        self.variables: Mapping[str, ProcessVariable] = {}
        self._static = StaticProvider()
        self._dynamic = DynamicProvider("kept up", self)
        self._server: Server | None = None
        self._port = 0
        self._asking = ThreadPoolExecutor(1, "umo epics")
        """The single thread that finds out who a client is. Because there is only one, commands are carried out in the
        order of arrival."""
        self._asked: Counter[str] = Counter()
        """Number of the puts and calls of each connection whose user is being looked up."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks = KeptTasks()

    def open(self) -> str:
        """Start the server and return its address. Raises UmoError if the port is in use."""
        self._loop = asyncio.get_running_loop()
        endpoint = self._endpoint
        endpoint.listening().close()  # the server would silently take another port
        self._server = Server(
            providers=[self._static, self._dynamic],
            useenv=False,
            conf={
                "EPICS_PVAS_INTF_ADDR_LIST": endpoint.host,
                "EPICS_PVAS_SERVER_PORT": str(endpoint.port),
                "EPICS_PVAS_BROADCAST_PORT": str(self._search_port),
                "EPICS_PVAS_AUTO_BEACON_ADDR_LIST": "NO",
                "EPICS_PVAS_BEACON_ADDR_LIST": endpoint.host,
                "EPICS_PVA_CONN_TMO": str(SILENCE * 3 / 4),  # as EPICS has it
            },
        )
        self._port = int(self._server.conf()["EPICS_PVAS_SERVER_PORT"])
        return f"pva://{endpoint.host}:{self._port}"

    def serve(self, variables: Mapping[str, ProcessVariable]) -> None:
        """Serve these variables, and no others, from now on."""
        before, self.variables = self.variables, {}
        for name, variable in before.items():
            if not variable.kept_up:
                self._static.remove(name)
            for channel in variable.take_channels():
                channel.close(destroy=True)
        for name, variable in variables.items():
            if not variable.kept_up:
                self._static.add(name, variable.add_channel(ChannelHandler(self, variable)))
        self.variables = variables

    async def close(self) -> None:
        if self._server is not None:
            await asyncio.to_thread(self._server.stop)
        self._asking.shutdown(wait=False)
        self.serve({})
        self.cancel()

    def cancel(self) -> None:
        """Cancel the waits of clients, and answer them with an error."""
        self._tasks.cancel()

    # In p4p's threads ----------------------------------------------------------------------------------

    def testChannel(self, name: str) -> bool:
        """True if a client can open a channel to this variable."""
        variable = self.variables.get(name)
        return variable is not None and variable.kept_up

    def makeChannel(self, name: str, peer: str) -> SharedPV | None:
        """Return the channel for one client."""
        variable = self.variables.get(name)
        count = sum(len(each.channels) for each in self.variables.values() if each.kept_up)
        if variable is None or count >= MAX_CHANNELS:
            return None
        return variable.add_channel(ChannelHandler(self, variable))

    def start(self, carry_out: CarryOut | None, operation: ClientRequest) -> None:
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._begin, carry_out, operation)

    # In the loop ---------------------------------------------------------------------------------------

    def _begin(self, carry_out: CarryOut | None, operation: ClientRequest) -> None:
        self._tasks.begin(self._answer(carry_out, operation))

    async def _answer(self, carry_out: CarryOut | None, operation: ClientRequest) -> None:
        try:
            if carry_out is None:
                raise CommandRefused(
                    "this variable is read-only" if not operation.is_call else "this variable cannot be called"
                )
            user = await self._user(operation)
            operation.done(await operation.awaited(carry_out, user))
        except asyncio.CancelledError:
            operation.done(error="the machine no longer exists")
        except UmoError as error:
            operation.done(error=str(error))
        except Exception as error:  # a client may send anything
            operation.done(error=text_of(error))

    async def _user(self, operation: ClientRequest) -> User:
        if self._asked[operation.peer] >= MAX_ASKED:
            raise CommandRefused(f"a connection may have at most {MAX_ASKED} puts and calls in progress")
        self._asked[operation.peer] += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._asking, operation.user, self._port)
        finally:
            self._asked[operation.peer] -= 1
            self._asked += Counter()  # without those that are at 0


class ChannelHandler:
    """Takes the puts and calls of a variable's channel, which serves one client if the variable is held, otherwise all
    clients."""

    def __init__(self, server: PvaServer, variable: ProcessVariable) -> None:
        self._server, self._variable = server, variable
        self.is_open = True

    def put(self, channel: SharedPV, operation: Any) -> None:
        self._start(self._variable.write, operation, operation.value(), is_call=False)

    def rpc(self, channel: SharedPV, operation: ServerOperation) -> None:
        self._start(self._variable.call, operation, operation.value(), is_call=True)

    def _start(self, carry_out: CarryOut | None, operation: Any, given: Value, *, is_call: bool) -> None:
        channel = self if self._variable.kept_up else None
        self._server.start(carry_out, ClientRequest(operation, given, channel, is_call=is_call))

    def onLastDisconnect(self, channel: SharedPV) -> None:
        if self._variable.kept_up:
            self.is_open = False
            self._variable.remove_channel(channel)


class ClientRequest:
    """A put or a call that a client waits for. `channel`: the channel that holds the written value."""

    def __init__(self, operation: Any, given: Value, channel: ChannelHandler | None, *, is_call: bool) -> None:
        self._operation, self._given, self._channel, self.is_call = operation, given, channel, is_call
        self._is_awaited = True
        block = operation.pvRequest().get("record._options.block", "")
        self._waits = is_call or str(block).lower() == "true"
        """True if the client waits for the end of the action, False if for its beginning."""
        operation.onCancel(self._cancelled)

    @property
    def peer(self) -> str:
        """Address and port of the client."""
        return str(self._operation.peer())

    def _cancelled(self) -> None:
        self._is_awaited = False

    def user(self, port: int) -> User:
        """Return the user of this port of the server. For a process on this computer the user is the account that the
        kernel reports; for others it is the name that the client gives."""
        host, _, number = self.peer.rpartition(":")
        uid = peer_uid((host.strip("[]"), int(number)), port) if number.isdecimal() else None
        account = self._operation.account() if uid is None else account_of(uid)
        name = "" if account == "anonymous" else account
        alive = (lambda: self._is_awaited) if self._waits else None
        if (channel := self._channel) is not None:
            alive = lambda: channel.is_open  # noqa: E731
        return User(name, proved=uid is not None, is_owner=uid == os.getuid(), is_alive=alive)

    async def awaited(self, carry_out: CarryOut, user: User) -> Any:
        """Carry out the request. Return its result, or None if it is in progress and the client does not wait for the
        end."""
        task = asyncio.ensure_future(carry_out(user, self._given))
        if not self._waits:
            done, _ = await asyncio.wait([task], timeout=BEGUN_AFTER)
            if not done:
                task.add_done_callback(lambda ended: ended.cancelled() or ended.exception())  # told as an event
                return None
        return await task

    def done(self, value: Any = None, error: str | None = None) -> None:
        if error is not None or not self.is_call:
            self._operation.done(error=error)
        else:
            self._operation.done(result(value))
