"""Limits of the OPC UA server: no client makes it use memory, or time, without bound."""

from __future__ import annotations

from collections.abc import Mapping

from asyncua import ua
from asyncua.common.connection import TransportLimits
from asyncua.server.address_space import AddressSpace
from asyncua.server.internal_server import InternalServer

MAX_CLIENTS = 32
"""Connections at once at most; more are closed."""
MAX_SUBSCRIPTIONS = 64
"""Subscriptions of all clients at most."""
MAX_ITEMS = 10_000
"""Monitored items of all clients at most."""
MAX_QUEUE = 100
"""Values of one monitored item that wait to be sent at most: then the oldest are left out."""
MAX_UNACKNOWLEDGED = 100
"""Messages of a subscription that are kept to be sent again at most."""
MAX_KEPT = 20_000
"""Notifications in these messages at most: then the oldest are forgotten, all but the last."""
SHORTEST_PUBLISHING = 50.0
"""Shortest publishing interval, ms."""
LONGEST_INTERVAL = 3_600_000.0
"""Longest publishing and sampling interval, ms."""
KEEP_ALIVE, MAX_KEEP_ALIVE, MAX_LIFETIME = 10, 5_000, 15_000
"""Publishing cycles without a notification: by default, and at most; without a Publish request at most."""
MAX_NOTIFICATIONS = 10_000
"""Notifications of one Publish response at most."""
MAX_PUBLISH = 100
"""Publish requests of one session that wait at most."""
MAX_CONTINUATIONS = 16
"""Continuation points of one session at most."""
MIN_SESSION, MAX_SESSION = 2_000.0, 60_000.0
"""Time in ms without a request after which a session ends: what a client may ask for."""
LOGIN_TIME = 10.0
"""Time in s that a connection has to open a session."""
LOGIN_PAUSE = 0.1
"""Time in s after a wrong password in which nobody logs in: each costs 50 ms of the face, or more."""
MAX_MESSAGE = 1 << 20
"""Largest number of bytes of a message."""
CHUNK = 65_535
MAX_PENDING = 100
"""Messages of one connection that have come and are not yet looked at, at most: then it is closed."""
MAX_ANSWERS = 32
"""Write and Call requests of one connection whose answer is still to come, at most: others are refused."""
MAX_UNSENT = 16 << 20
"""Bytes that a client has asked for and does not take, at most: then its connection is closed."""
MAX_OPERATIONS = 1_000
"""Nodes of one Write or Call request at most."""
MAX_READ = 10_000
"""Nodes of one Read request at most."""
MAX_RESPONSE = 4 << 20
"""Bytes of a response at most, as they are estimated while it is made: each 100 kB take 10 ms of the face, or more."""
MAX_EVENT_COST = 10_000
"""Cost of the filters of all event items at most: each event then costs about 30 ms."""
MAX_ELEMENTS = 2 * MAX_READ
"""Elements of an array in a message, with those of the arrays in it, at most: each takes 20 us and 300 bytes."""
MAX_DIMENSIONS = 8
"""Dimensions of an array at most."""


_CALLS = (
    "MaxNodesPerWrite", "MaxNodesPerBrowse", "MaxNodesPerRegisterNodes", "MaxNodesPerTranslateBrowsePathsToNodeIds",
    "MaxNodesPerMethodCall", "MaxNodesPerHistoryReadData", "MaxNodesPerHistoryReadEvents",
)  # fmt: skip
CAPABILITIES: Mapping[str, tuple[float, str]] = {
    "OperationLimits_MaxNodesPerRead": (MAX_READ, "UInt32"),
    "OperationLimits_MaxMonitoredItemsPerCall": (MAX_ITEMS, "UInt32"),
    **{f"OperationLimits_{each}": (MAX_OPERATIONS, "UInt32") for each in _CALLS},
    "MaxSessions": (MAX_CLIENTS, "UInt32"),
    "MaxSubscriptions": (MAX_SUBSCRIPTIONS, "UInt32"),
    "MaxSubscriptionsPerSession": (MAX_SUBSCRIPTIONS, "UInt32"),
    "MaxMonitoredItems": (MAX_ITEMS, "UInt32"),
    "MaxMonitoredItemsPerSubscription": (MAX_ITEMS, "UInt32"),
    "MaxMonitoredItemsQueueSize": (MAX_QUEUE, "UInt32"),
    "MaxBrowseContinuationPoints": (MAX_CONTINUATIONS, "UInt16"),
    "MaxHistoryContinuationPoints": (0, "UInt16"),
    "MaxQueryContinuationPoints": (0, "UInt16"),
    "MinSupportedSampleRate": (0.0, "Double"),
}
"""The content of Server/ServerCapabilities: value and type."""


def tell(space: AddressSpace) -> None:
    """Show clients these limits instead of those of asyncua."""
    for name, (value, kind) in CAPABILITIES.items():
        node = space.get(ua.NodeId(getattr(ua.ObjectIds, f"Server_ServerCapabilities_{name}")))
        if node is not None:
            told = ua.Variant(value, getattr(ua.VariantType, kind))
            node.attributes[ua.AttributeIds.Value].value = ua.DataValue(told)


def transport() -> TransportLimits:
    return TransportLimits(CHUNK, CHUNK, -(-MAX_MESSAGE // CHUNK), MAX_MESSAGE)


def limit(server: InternalServer) -> None:
    """Set what asyncua can limit by itself."""
    server.max_connections = MAX_CLIENTS
    server.max_subscriptions = MAX_SUBSCRIPTIONS
    server.max_monitored_item_queue_size = MAX_QUEUE
    server.max_unacked_messages_per_subscription = MAX_UNACKNOWLEDGED
    server.min_session_timeout_ms, server.max_session_timeout_ms = MIN_SESSION, MAX_SESSION
    server.max_pending_activation_seconds = LOGIN_TIME
    server.max_pending_messages_per_connection = MAX_PENDING
