"""Sessions of OPC UA. They identify the client, notice whether it lives, and protect clients from each other."""

from __future__ import annotations

import asyncio
import secrets
import time
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto import permission_rules
from asyncua.crypto.permission_rules import UserRole
from asyncua.server.internal_session import InternalSession, SessionState

from umo.clients.faces import face_users as users
from umo.clients.faces.endpoint import is_local
from umo.clients.faces.face import User
from umo.clients.faces.opcua.ua_limits import MAX_MESSAGE
from umo.clients.faces.opcua.ua_monitoring import Monitoring
from umo.clients.faces.opcua.ua_subscriptions import Publisher, PublishRequest
from umo.clients.faces.opcua.ua_view import Browsing
from umo.system.peer_account import is_own

SILENCE = 5.0
"""Time in s without a request after which the holds of a client are released. A closed connection is noticed
immediately."""


@dataclass
class Client(permission_rules.User):
    """A user as an object of asyncua and as an object of umo. The latter is None for an anonymous user."""

    user: User | None = None
    holder: User | None = None
    """The user as the holder of dead-man commands. As such the user counts as alive only while requests arrive."""


class UaSession(InternalSession):
    """The session of a client. `name` is the address from which the client connects."""

    user: Any

    def __init__(self, *given: Any, external: bool = False, **more: Any) -> None:
        super().__init__(*given, external=external, **more)
        self.processor: Any = None
        """The connection of the session."""
        self.socket: Any = None
        """The socket of the connection on which the session was last activated, or is being activated."""
        self.publisher = Publisher(self._send, self.iserver.monitoring.clock)
        self.view = Browsing(self.aspace)
        self.most = 0
        """Largest number of bytes of a response that its client accepts; 0 means any."""
        self.ordered = asyncio.Lock()
        """Lock by which writes are carried out in the order in which they arrived."""
        if external:  # asyncua counts its tokens up: another client could guess them
            self.iserver.unregister_external_session(self)
            self.auth_token = ua.NodeId(secrets.token_bytes(32), 0, ua.NodeIdType.ByteString)
            self.iserver.register_external_session(self)

    async def create_session(self, params: ua.CreateSessionParameters, sockname: Any = None) -> ua.CreateSessionResult:
        self.most = params.MaxResponseMessageSize or 0
        result = await super().create_session(params, sockname)
        result.MaxRequestMessageSize = MAX_MESSAGE
        return result

    def activate_session(
        self, params: ua.ActivateSessionParameters, peer_certificate: bytes | None
    ) -> ua.ActivateSessionResult:
        """Identify the user. Another user cannot take over the session."""
        before, token, host = self.user, params.UserIdentityToken, str(self.name[0])
        if not isinstance(token, ua.UserNameIdentityToken | ua.X509IdentityToken) and not is_local(host):
            raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
        proof = peer_certificate if isinstance(token, ua.X509IdentityToken) else None
        result = super().activate_session(params, proof)
        after: Any = self.user
        if isinstance(before, Client) and _name(before) != _name(after):
            self.user = before
            raise ServiceError(ua.StatusCodes.BadIdentityChangeNotSupported)
        if after.user is not None:
            name = after.user.name
            is_owner = is_own(self.socket)
            user = User(name, True, is_owner, lambda: self._is_of(name))
            holder = User(name, True, is_owner, lambda: self._is_of(name) and self._is_heard())
            self.user = Client(UserRole.User, name, user, holder)
        return result

    def _is_of(self, name: str) -> bool:
        """True if this is still a session of this user, and is connected."""
        connected = self.processor is not None and self.processor.is_open
        return connected and self.state is SessionState.Activated and _name(self.user) == name

    def _is_heard(self) -> bool:
        return time.monotonic() - self._last_activity < SILENCE

    # Subscriptions ----------------------------------------------------------------------------------------

    @property
    def monitoring(self) -> Monitoring:
        return self.iserver.monitoring

    def _send(self, request: PublishRequest, response: Any) -> int:
        """Answer a Publish request on the connection that this session has now; see `Processor.sent`."""
        if self.processor is None:
            return 0
        return int(self.processor.sent(request.header.RequestHandle, request.sequence, response))

    async def close_session(self, delete_subs: bool = True) -> None:
        """Close a session. Its subscriptions end too, because they are not transferred."""
        self.publisher.close()
        await super().close_session(False)


def _name(client: Any) -> str | None:
    return client.user.name if isinstance(client, Client) and client.user is not None else None


class Users:
    """Identifies users by password or certificate (`umo.clients.faces.face_users`). A client without either is
    anonymous."""

    def get_user(
        self, server: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> Client | None:
        """Return the client, or None if the name, the password or the certificate is wrong."""
        if username is not None:
            name = username if users.by_password(username, password or "") else None
        elif certificate is not None:
            name = users.by_certificate(certificate)
        else:
            return Client(UserRole.User, "anonymous")
        return None if name is None else Client(UserRole.User, name, User(name, True))
