"""Connections of OPC UA: what asyncua's lack.

A Write or a Call is answered when the machine has answered, node by node, while the connection goes on; the words of a
refusal are in its DiagnosticInfo. A client that does not take what it has asked for is disconnected.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.uaprocessor import UaProcessor
from asyncua.ua.ua_binary import struct_from_binary

from umo.faces.opcua import ua_limits as limits
from umo.faces.opcua.ua_session import UaSession, Users

KEEP_ALIVE = ((socket.TCP_KEEPIDLE, 1), (socket.TCP_KEEPINTVL, 1), (socket.TCP_KEEPCNT, 3))
"""A computer that does not answer any more is noticed after 4 s, in s and tries."""
UNSENT_TIMEOUT = 5_000
"""Time in ms after which a computer that does not take what was sent is gone."""
REFRESH_SEVERITY = 100
"""Of the events around a ConditionRefresh."""
ADDITIONAL_INFO = 0x80
"""Bit of `ReturnDiagnostics`: words of the results of single operations (OPC 10000-4, 7.32)."""


def _service(name: str) -> ua.NodeId:
    return ua.NodeId(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary"))


WRITE, CALL = _service("Write"), _service("Call")
CREATE, ACTIVATE = _service("CreateSession"), _service("ActivateSession")
OPEN = (_service("GetEndpoints"), _service("FindServers"), _service("CloseSecureChannel"))
"""Services that need neither a session nor a secured channel."""
LEFT_OUT = tuple(
    map(
        _service,
        ("AddNodes", "DeleteNodes", "AddReferences", "DeleteReferences", "RegisterServer", "RegisterServer2"),
    )
)
"""Services that this server does not have."""


class Answer:
    """What became of one operation. `result`: a StatusCode, or a CallMethodResult."""

    def __init__(self, result: Any, words: str = "") -> None:
        self.result = result
        self.words = words


Carry = Callable[[UaSession, Any], Awaitable[Answer]]
"""Carries out one WriteValue or CallMethodRequest of a session."""


class Services(InternalServer):
    """`write` and `call` carry out what clients ask for."""

    def __init__(self, write: Carry, call: Carry, is_trusted: Callable[[bytes], bool], only_secured: bool) -> None:
        super().__init__(user_manager=Users())
        self.write, self.call = write, call
        self.is_trusted, self.only_secured = is_trusted, only_secured
        self.answering: set[asyncio.Task[None]] = set()
        self.logging_in = asyncio.Lock()
        self.bind_condition_methods = REFRESH_SEVERITY
        limits.limit(self)

    def create_session(self, name: Any, user: Any = None, external: bool = False) -> UaSession:
        return UaSession(self, self.aspace, self.subscription_service, name, external=external)

    async def abandon(self) -> None:
        """Nothing that is under way will be answered by the machine."""
        tasks = list(self.answering)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class Processor(UaProcessor):
    """The messages of one connection."""

    iserver: Services

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._answers = 0
        self._gone = False

    async def process(self, header: Any, body: Any) -> bool:
        if header.MessageType == ua.MessageType.SecureMessage and not self._connection.is_open():
            return False
        if self._transport.get_write_buffer_size() > limits.MAX_UNSENT:
            self._transport.abort()
            return False
        return bool(await super().process(header, body))

    def open_secure_channel(self, algohdr: Any, seqhdr: Any, body: Any) -> None:
        certificate = algohdr.SenderCertificate
        if certificate and not self.iserver.is_trusted(certificate):
            raise ua.uaerrors.BadUserAccessDenied
        super().open_secure_channel(algohdr, seqhdr, body)

    async def _process_message(self, typeid: Any, header: Any, sequence: Any, body: Any) -> Any:
        if typeid in LEFT_OUT:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        if self.iserver.only_secured and typeid not in OPEN and not self._is_secured:
            raise ServiceError(ua.StatusCodes.BadSecurityPolicyRejected)
        if typeid in (WRITE, CALL) and self.session is not None and self.session.is_activated():
            return self._begin(typeid, header, sequence, body)
        if typeid == ACTIVATE:
            session: Any = self.session or self.iserver.lookup_external_session(header.AuthenticationToken)
            if session is not None:
                session.name, session.transport = self.name, self._transport
            return await self._log_in(typeid, header, sequence, body)
        if typeid == CREATE and self.session is not None:  # asyncua would keep it for ever
            await self.session.close_session(True)
        return await super()._process_message(typeid, header, sequence, body)

    async def _log_in(self, *message: Any) -> Any:
        """One at a time: a flood of wrong passwords leaves time for the machine's values."""
        async with self.iserver.logging_in:
            try:
                return await super()._process_message(*message)
            except (ServiceError, ua.uaerrors.UaStatusCodeError):
                await asyncio.sleep(limits.LOGIN_PAUSE)
                raise

    @property
    def _is_secured(self) -> bool:
        return bool(self._connection.security_policy.Mode == ua.MessageSecurityMode.SignAndEncrypt)

    # Writes and calls --------------------------------------------------------------------------------------

    def _begin(self, typeid: Any, header: Any, sequence: Any, body: Any) -> bool:
        """Answer it in a task of its own. The task goes on when the connection has gone: the gateway ends what
        nobody keeps up."""
        assert isinstance(self.session, UaSession)
        self.session.touch()
        if self._answers >= limits.MAX_ANSWERS:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
        if typeid == WRITE:
            each = struct_from_binary(ua.WriteParameters, body).NodesToWrite
            work = self._write(self.session, each)
            response: Any = ua.WriteResponse()
        else:
            each = struct_from_binary(ua.CallParameters, body).MethodsToCall
            work = self._call(self.session, each)
            response = ua.CallResponse()
        if not 0 < len(each) <= limits.MAX_OPERATIONS:
            work.close()
            raise ServiceError(ua.StatusCodes.BadTooManyOperations if each else ua.StatusCodes.BadNothingToDo)
        self._answers += 1
        task = asyncio.create_task(self._answer(work, response, header, sequence))
        self.iserver.answering.add(task)
        task.add_done_callback(self.iserver.answering.discard)
        return True

    async def _write(self, session: UaSession, values: Sequence[Any]) -> list[Answer]:
        async with session.ordered:
            return [await self.iserver.write(session, each) for each in values]

    async def _call(self, session: UaSession, methods: Sequence[Any]) -> list[Answer]:
        return [await self.iserver.call(session, each) for each in methods]

    async def _answer(self, work: Awaitable[list[Answer]], response: Any, header: Any, sequence: Any) -> None:
        try:
            answers = await work
            response.Results = [each.result for each in answers]
            if header.ReturnDiagnostics & ADDITIONAL_INFO:
                response.DiagnosticInfos = [ua.DiagnosticInfo(AdditionalInfo=each.words or None) for each in answers]
        except (Exception, asyncio.CancelledError) as error:
            response = ua.ServiceFault()
            cancelled = isinstance(error, asyncio.CancelledError)
            code = ua.StatusCodes.BadNoCommunication if cancelled else ua.StatusCodes.BadInternalError
            response.ResponseHeader.ServiceResult = ua.StatusCode(code)
        finally:
            self._answers -= 1
        if not self._transport.is_closing():
            self.send_response(header.RequestHandle, sequence, response)


class Protocol(OPCUAProtocol):
    """One connection."""

    processor: Any
    _buffer: bytes

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if self.processor is None:  # there are too many
            return
        self.processor = Processor(self.iserver, transport, self.limits)
        self.processor.set_policies(self.policies)
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in (*KEEP_ALIVE, (socket.TCP_USER_TIMEOUT, UNSENT_TIMEOUT)):
            connection.setsockopt(socket.IPPROTO_TCP, option, value)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if len(self._buffer) > limits.CHUNK and self.transport is not None:  # a chunk that never ends
            self._buffer = b""
            self.transport.close()


class Listener(BinaryServer):
    """Listens on a socket that is open already."""

    def __init__(self, server: Services, listening: socket.socket) -> None:
        host, port = listening.getsockname()[:2]
        super().__init__(server, host, port, limits.transport())
        self._listening = listening

    def _make_protocol(self) -> Protocol:
        return Protocol(self.iserver, self._policies, self.clients, self.closing_tasks, self.limits)

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._make_protocol, sock=self._listening)
        self.cleanup_task = asyncio.create_task(self._close_task_loop())


class UaServer(Server):
    """asyncua's server with these connections."""

    iserver: Services

    async def listen(self, listening: socket.socket) -> None:
        await self._setup_server_nodes()
        await self.iserver.start()
        self.bserver = Listener(self.iserver, listening)
        self.bserver.set_policies(self._policies)
        await self.bserver.start()
