"""Connections of OPC UA, with the functions that asyncua's connections lack.

A Write or a Call is answered when the machine has answered for each node. The connection serves other requests in the
meantime. The text of a refusal is in the DiagnosticInfo of the answer. A client that does not read its responses is
disconnected.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import SessionState
from asyncua.server.uaprocessor import UaProcessor
from asyncua.ua.ua_binary import struct_to_binary

from umo.clients.faces.kept_tasks import KeptTasks
from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_attributes import Attributes, Rights
from umo.clients.faces.opcua.ua_monitoring import Monitoring
from umo.clients.faces.opcua.ua_services import SERVICES, counted, decoded, service
from umo.clients.faces.opcua.ua_session import UaSession, Users
from umo.clients.faces.opcua.ua_subscriptions import fault

log = logging.getLogger("umo.faces.opcua")
KEEP_ALIVE = ((socket.TCP_KEEPIDLE, 1), (socket.TCP_KEEPINTVL, 1), (socket.TCP_KEEPCNT, 3))
"""Settings of the TCP keep-alive, in s and number of attempts. A computer that no longer answers is noticed after 4
s."""
UNSENT_TIMEOUT = 5_000
"""Time in ms after which a connection is closed if the computer does not acknowledge sent data."""
ADDITIONAL_INFO = 0x80
"""Bit of `ReturnDiagnostics`: texts about the results of single operations (OPC 10000-4, 7.32)."""


WRITE, CALL, PUBLISH = service("Write"), service("Call"), service("Publish")
CREATE, ACTIVATE, CLOSE = (service(f"{each}Session") for each in ("Create", "Activate", "Close"))
OPEN = (service("GetEndpoints"), service("FindServers"), service("CloseSecureChannel"))
"""Services that need neither a session nor a secure channel."""
WITHOUT_SESSION = (*OPEN, CREATE, ACTIVATE, CLOSE)
"""Services that need no session, and that asyncua answers. The others are answered by this module, or are not
supported."""


class Answer:
    """The result of one operation. `result`: a StatusCode, or a CallMethodResult."""

    def __init__(self, result: Any, words: str = "") -> None:
        self.result = result
        self.words = words


Carry = Callable[[UaSession, Any], Awaitable[Answer]]
"""Function that carries out one WriteValue or CallMethodRequest of a session."""


class Services(InternalServer):
    """The services of the server. `write` and `call` carry out the requests of clients. Sessions of clients use the
    services of this package. Only asyncua's internal session, which fills the address space, uses asyncua's
    services."""

    def __init__(
        self, write: Carry, call: Carry, rights: Rights, is_trusted: Callable[[bytes], bool], only_secured: bool
    ) -> None:
        super().__init__(user_manager=Users())
        self.write, self.call = write, call
        self.attributes = Attributes(self.aspace, rights)
        self.monitoring = Monitoring(self.attributes)
        self.subscription_service = self.isession.subscription_service = self.monitoring
        self.is_trusted, self.only_secured = is_trusted, only_secured
        self.answering = KeptTasks()
        self.logging_in = asyncio.Lock()
        limits.limit(self)

    def create_session(self, name: Any, user: Any = None, external: bool = False) -> UaSession:
        return UaSession(self, self.aspace, self.subscription_service, name, external=external)

    async def get_endpoints(self, params: Any = None, sockname: Any = None) -> list[Any]:
        """Return the endpoints with one of the requested transport profiles; all endpoints if none is requested."""
        profiles = params.ProfileUris if params is not None else None
        found = await super().get_endpoints(params, sockname)
        return [each for each in found if not profiles or each.TransportProfileUri in profiles]

    async def abandon(self) -> None:
        """Give up all operations in progress, because the machine will not answer them."""
        await self.answering.end()


class Processor(UaProcessor):
    """Processes the messages of one connection."""

    iserver: Services
    _session_watchdog_task: asyncio.Task[None] | None

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._answers = 0

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
        if self.iserver.only_secured and typeid not in OPEN and not self._is_secured:
            raise ServiceError(ua.StatusCodes.BadSecurityPolicyRejected)
        if typeid not in WITHOUT_SESSION:
            return self._serve(typeid, header, sequence, body)
        if typeid == ACTIVATE:
            return await self._activate(typeid, header, sequence, body)
        if typeid == CREATE and self.session is not None:  # asyncua would keep it for ever
            await self.session.close_session(True)
        if typeid == CLOSE:
            self._own(header)
        return await super()._process_message(typeid, header, sequence, body)

    def _own(self, header: Any) -> Any:
        """Return the session of this connection. Raises ServiceError if a request belongs to another session."""
        session: Any = self.session
        if session is None and self.iserver.lookup_external_session(header.AuthenticationToken) is not None:
            raise ServiceError(ua.StatusCodes.BadSecureChannelIdInvalid)
        if session is None or header.AuthenticationToken != session.auth_token:
            raise ServiceError(ua.StatusCodes.BadSessionIdInvalid)
        if session.state is SessionState.Closed:
            raise ServiceError(ua.StatusCodes.BadSessionClosed)
        return session

    async def _activate(self, *message: Any) -> Any:
        """Log in. Only one client at a time can log in, so that a flood of wrong passwords does not delay the machine's
        values."""
        async with self.iserver.logging_in:
            try:
                return await self._log_in(*message)
            except (ServiceError, ua.uaerrors.UaStatusCodeError):
                await asyncio.sleep(limits.LOGIN_PAUSE)
                raise

    async def _log_in(self, typeid: Any, header: Any, sequence: Any, body: Any) -> Any:
        """Log in to a session. A session that is already activated can be continued on a new connection; the old
        connection then loses it."""
        if self.session is not None and self.session.state is SessionState.Closed:
            self._leave()
        is_new = self.session is None
        session: Any = self.iserver.lookup_external_session(header.AuthenticationToken) if is_new else self._own(header)
        if session is None:
            raise ServiceError(ua.StatusCodes.BadSessionIdInvalid)
        if is_new and not session.is_activated():
            raise ServiceError(ua.StatusCodes.BadSecureChannelIdInvalid)
        before = session.name, session.socket
        session.name, session.socket = self.name, self._transport.get_extra_info("socket")
        try:
            answered = await super()._process_message(typeid, header, sequence, body)
        except BaseException:
            session.name, session.socket = before
            if is_new:
                self._leave()
            raise
        if session.processor is not self:
            session.publisher.requests.clear()
            if session.processor is not None:
                session.processor._leave()
            session.processor = self
        return answered

    def _leave(self) -> None:
        """Separate this connection from its session, so that the end of one does not affect the other."""
        self.session = None
        if self._session_watchdog_task is not None:
            self._session_watchdog_task.cancel()
            self._session_watchdog_task = None

    def _serve(self, typeid: Any, header: Any, sequence: Any, body: Any) -> bool:
        """Answer a service of a session. The answer to a Write, Call or Publish request is sent later."""
        session = self._own(header)
        if not session.is_activated():
            raise ServiceError(ua.StatusCodes.BadSessionNotActivated)
        self.session_last_activity = time.monotonic()
        session.touch()
        if typeid in (WRITE, CALL):
            self._begin(typeid, header, sequence, body)
        elif typeid == PUBLISH:
            acknowledged = decoded(ua.PublishParameters, body).SubscriptionAcknowledgements
            session.publisher.publish(header, sequence, acknowledged)
        elif typeid in SERVICES:
            structure, answer = SERVICES[typeid]
            self.send_response(header.RequestHandle, sequence, answer(session, decoded(structure, body)))
        else:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        return True

    def send_response(
        self, handle: Any, sequence: Any, response: Any, kind: Any = ua.MessageType.SecureMessage
    ) -> None:
        """Send a response, or a fault if the response cannot be sent."""
        if code := self.sent(handle, sequence, response, kind):
            self.sent(handle, sequence, fault(code), kind)

    def sent(self, handle: Any, sequence: Any, response: Any, kind: Any = ua.MessageType.SecureMessage) -> int:
        """Send a response. Return 0 if the response is sent or the connection is closed. Otherwise nothing was sent,
        and the returned code gives the reason: the response cannot be encoded, or it is larger than the client accepts.
        A client that does not read its responses is disconnected."""
        if self._transport.get_write_buffer_size() > limits.MAX_UNSENT:
            self._transport.abort()
        if not self.is_open:
            return 0
        response.ResponseHeader.RequestHandle = handle
        try:
            body = struct_to_binary(response)
        except Exception as error:
            log.debug("request %s", handle, exc_info=error)
            return int(ua.StatusCodes.BadEncodingError)
        session: Any = self.session
        if session is not None and 0 < session.most < len(body) and not isinstance(response, ua.ServiceFault):
            return int(ua.StatusCodes.BadResponseTooLarge)
        self._transport.write(
            self._connection.message_to_binary(body, message_type=kind, request_id=sequence.RequestId)
        )
        return 0

    @property
    def is_open(self) -> bool:
        return not self._transport.is_closing()

    async def close(self) -> None:
        """Drop the connection's Publish requests. Called when the connection is closed."""
        session: Any = self.session
        if session is not None and session.processor is self:
            session.publisher.requests.clear()
            session.processor = None
        await super().close()

    @property
    def _is_secured(self) -> bool:
        return bool(self._connection.security_policy.Mode == ua.MessageSecurityMode.SignAndEncrypt)

    # Writes and calls --------------------------------------------------------------------------------------

    def _begin(self, typeid: Any, header: Any, sequence: Any, body: Any) -> None:
        """Begin to answer a Write or Call request in a separate task. The task continues even if the connection is
        lost; the gateway ends the holds of clients that are no longer alive."""
        session: Any = self.session
        if self._answers >= limits.MAX_ANSWERS:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
        response: Any
        if typeid == WRITE:
            work = self._write(session, counted(decoded(ua.WriteParameters, body).NodesToWrite))
            response = ua.WriteResponse()
        else:
            work = self._call(session, counted(decoded(ua.CallParameters, body).MethodsToCall))
            response = ua.CallResponse()
        self._answers += 1
        self.iserver.answering.begin(self._answer(work, response, header, sequence))

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
            cancelled = isinstance(error, asyncio.CancelledError)
            response = fault(ua.StatusCodes.BadNoCommunication if cancelled else ua.StatusCodes.BadInternalError)
        finally:
            self._answers -= 1
        self.send_response(header.RequestHandle, sequence, response)


class Protocol(OPCUAProtocol):
    """The protocol of one connection."""

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
    """Listens on a socket that is already open."""

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
