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
from umo.faces.opcua.ua_limits import MAX_ITEMS, MAX_QUEUE, MAX_READ, SHORTEST_PUBLISHING
from umo.system.peer_account import is_own

SILENCE = 5.0
"""Time in s without a request after which what a client holds is let go of. A closed connection is noticed at once."""

OF_SUBSCRIPTION = tuple(
    ua.NodeId(each)
    for each in (
        ua.ObjectIds.ConditionType_ConditionRefresh,
        ua.ObjectIds.ConditionType_ConditionRefresh2,
        ua.ObjectIds.Server_GetMonitoredItems,
        ua.ObjectIds.Server_ResendData,
    )
)
"""Methods of the standard whose first argument is a subscription."""


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
            name = after.user.name
            is_owner = is_own(self.transport.get_extra_info("socket") if self.transport is not None else None)
            user = User(name, True, is_owner, lambda: self._is_of(name))
            holder = User(name, True, is_owner, lambda: self._is_of(name) and self._is_heard())
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
        for each in params.ItemsToModify:  # asyncua takes any size, and 0 for none
            given = each.RequestedParameters
            given.QueueSize = min(given.QueueSize or MAX_QUEUE, MAX_QUEUE)
        return await super().modify_monitored_items(params)

    async def set_monitoring_mode(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: Any) -> Any:
        self._check(*params.SubscriptionIds)
        return await super().set_publishing_mode(params)

    def modify_subscription(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        return super().modify_subscription(params)

    def republish(self, params: Any) -> Any:
        self._check(params.SubscriptionId)
        return super().republish(params)

    def publish(self, acks: Any = None) -> Any:
        for each in acks or ():
            each.SubscriptionId *= self.owns(each.SubscriptionId)  # there is no subscription 0
        return super().publish(acks)

    async def read(self, params: Any) -> Any:
        if len(params.NodesToRead) > MAX_READ:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
        return await super().read(params)

    async def delete_subscriptions(self, ids: list[int]) -> Any:
        self._check(*ids)
        return await super().delete_subscriptions(ids)

    def owns(self, subscription: Any) -> bool:
        """Whether a subscription is one of this session."""
        found = self.subscription_service.subscriptions.get(subscription)
        return found is not None and found.session_id == self.session_id

    def _check(self, *subscriptions: int) -> None:
        if not all(map(self.owns, subscriptions)):
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
