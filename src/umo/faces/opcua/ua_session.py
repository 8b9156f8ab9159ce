"""Sessions of OPC UA: who the client is, whether it lives, and what one client cannot do to another."""

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

from umo.faces import face_users as users
from umo.faces.endpoint import is_local
from umo.faces.face import User
from umo.faces.opcua.ua_limits import MAX_ITEMS, SHORTEST_PUBLISHING

SILENCE = 5.0
"""Time in s without a request after which what a client holds is let go of. A closed connection is noticed at once."""


@dataclass
class Client(permission_rules.User):
    """A user as asyncua has them, and as umo has them; None: anonymous."""

    user: User | None = None
    holder: User | None = None
    """The same, who lives only while requests come: for what must be kept up."""


class UaSession(InternalSession):
    """The session of a client. `name` is the address that it comes from."""

    user: Any

    def __init__(self, *given: Any, external: bool = False, **more: Any) -> None:
        super().__init__(*given, external=external, **more)
        self.transport: asyncio.BaseTransport | None = None
        """Its connection."""
        self.ordered = asyncio.Lock()
        """Writes are carried out in the order in which they came."""
        if external:  # asyncua counts its tokens up: another client could guess them
            self.iserver.unregister_external_session(self)
            self.auth_token = ua.NodeId(secrets.token_bytes(32), 0, ua.NodeIdType.ByteString)
            self.iserver.register_external_session(self)

    def activate_session(
        self, params: ua.ActivateSessionParameters, peer_certificate: bytes | None
    ) -> ua.ActivateSessionResult:
        """Find out who it is. Another user cannot take the session over."""
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
            name, is_remote = after.user.name, not is_local(host)
            user = User(name, True, is_remote, lambda: self._is_of(name))
            holder = User(name, True, is_remote, lambda: self._is_of(name) and self._is_heard())
            self.user = Client(UserRole.User, name, user, holder)
        return result

    def _is_of(self, name: str) -> bool:
        """Whether it is still a session of this user, and connected."""
        connected = self.transport is not None and not self.transport.is_closing()
        return connected and self.state is SessionState.Activated and _name(self.user) == name

    def _is_heard(self) -> bool:
        return time.monotonic() - self._last_activity < SILENCE

    # What asyncua does not look at ------------------------------------------------------------------------

    async def create_subscription(self, params: Any, callback: Any, request_callback: Any = None) -> Any:
        params.RequestedPublishingInterval = max(SHORTEST_PUBLISHING, params.RequestedPublishingInterval)
        return await super().create_subscription(params, callback, request_callback)

    async def create_monitored_items(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        services = (each.monitored_item_srv for each in self.subscription_service.subscriptions.values())
        if sum(len(each._monitored_items) for each in services) + len(params.ItemsToCreate) > MAX_ITEMS:
            raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)
        return await super().create_monitored_items(params)

    async def delete_monitored_items(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        return await super().delete_monitored_items(params)

    async def modify_monitored_items(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        return await super().modify_monitored_items(params)

    async def delete_subscriptions(self, ids: list[int]) -> Any:
        for each in ids:
            self._check(each)
        return await super().delete_subscriptions(ids)

    def _check(self, subscription: int) -> None:
        """It is one of this session."""
        found = self.subscription_service.subscriptions.get(subscription)
        if found is None or found.session_id != self.session_id:
            raise ServiceError(ua.StatusCodes.BadSubscriptionIdInvalid)

    async def transfer_subscriptions(self, params: Any, callback: Any) -> Any:
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)


def _name(client: Any) -> str | None:
    return client.user.name if isinstance(client, Client) and client.user is not None else None


class Users:
    """Knows users by password or certificate (`umo.faces.face_users`); without either they are anonymous."""

    def get_user(
        self, server: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> Client | None:
        """None: the name, the password or the certificate is wrong."""
        if username is not None:
            name = username if users.by_password(username, password or "") else None
        elif certificate is not None:
            name = users.by_certificate(certificate)
        else:
            return Client(UserRole.User, "anonymous")
        return None if name is None else Client(UserRole.User, name, User(name, True))
