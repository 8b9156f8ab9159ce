"""Limits of the OPC UA server, so that no client makes it use unlimited memory or time."""

from __future__ import annotations

from collections.abc import Mapping

from asyncua import ua
from asyncua.common.connection import TransportLimits
from asyncua.server.address_space import AddressSpace
from asyncua.server.internal_server import InternalServer

MAX_CLIENTS = 32
"""Largest number of simultaneous connections; further ones are closed."""
MAX_SUBSCRIPTIONS = 64
"""Largest number of subscriptions of all clients."""
MAX_ITEMS = 10_000
"""Largest number of monitored items of all clients."""
MAX_QUEUE = 100
"""Largest number of values of one monitored item that wait to be sent. If there are more, the oldest ones are left
out."""
MAX_UNACKNOWLEDGED = 100
"""Largest number of messages of a subscription that are kept to be sent again."""
MAX_KEPT = 20_000
"""Largest number of notifications in these messages. If there are more, the oldest messages are forgotten, but never
the last one."""
SHORTEST_PUBLISHING = 50.0
"""Shortest publishing interval in ms."""
LONGEST_INTERVAL = 3_600_000.0
"""Longest publishing and sampling interval in ms."""
KEEP_ALIVE, MAX_KEEP_ALIVE, MAX_LIFETIME = 10, 5_000, 15_000
"""Numbers of publishing cycles: the default and the largest number without a notification, and the largest number
without a Publish request."""
MAX_NOTIFICATIONS = 10_000
"""Largest number of notifications of one Publish response."""
MAX_PUBLISH = 100
"""Largest number of Publish requests of one session that wait."""
MAX_CONTINUATIONS = 16
"""Largest number of continuation points of one session."""
MIN_SESSION, MAX_SESSION = 2_000.0, 60_000.0
"""Shortest and longest time in ms without a request after which a session ends. A client may request a time between
these limits."""
LOGIN_TIME = 10.0
"""Time in s that a connection has to open a session."""
LOGIN_PAUSE = 0.1
"""Time in s after a wrong password during which no login is accepted. The limit exists because checking a password
takes the face 50 ms or more."""
MAX_MESSAGE = 1 << 20
"""Largest number of bytes of a message."""
CHUNK = 65_535
MAX_PENDING = 100
"""Largest number of messages of one connection that have arrived and are not processed yet. With more, the connection
is closed."""
MAX_ANSWERS = 32
"""Largest number of Write and Call requests of one connection that are not answered yet. Further requests are
refused."""
MAX_UNSENT = 16 << 20
"""Largest number of bytes that a client has requested and not yet received. With more, its connection is closed."""
MAX_OPERATIONS = 1_000
"""Largest number of nodes of one Write or Call request."""
MAX_READ = 10_000
"""Largest number of nodes of one Read request."""
MAX_RESPONSE = 4 << 20
"""Largest number of bytes of a response, as estimated while the response is made. Each 100 kB cost the face 10 ms or
more."""
MAX_EVENT_COST = 10_000
"""Largest total cost of the filters of all event items. At this cost each event takes about 30 ms."""
MAX_ELEMENTS = 2 * MAX_READ
"""Largest number of elements of an array in a message, including the elements of nested arrays. Each element takes 20
us and 300 bytes."""
MAX_DIMENSIONS = 8
"""Largest number of dimensions of an array."""


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
    """Show these limits to clients, in place of asyncua's limits."""
    for name, (value, kind) in CAPABILITIES.items():
        node = space.get(ua.NodeId(getattr(ua.ObjectIds, f"Server_ServerCapabilities_{name}")))
        if node is not None:
            told = ua.Variant(value, getattr(ua.VariantType, kind))
            node.attributes[ua.AttributeIds.Value].value = ua.DataValue(told)


def transport() -> TransportLimits:
    return TransportLimits(CHUNK, CHUNK, -(-MAX_MESSAGE // CHUNK), MAX_MESSAGE)


def limit(server: InternalServer) -> None:
    """Set the limits that asyncua itself can enforce."""
    server.max_connections = MAX_CLIENTS
    server.max_subscriptions = MAX_SUBSCRIPTIONS
    server.max_monitored_item_queue_size = MAX_QUEUE
    server.max_unacked_messages_per_subscription = MAX_UNACKNOWLEDGED
    server.min_session_timeout_ms, server.max_session_timeout_ms = MIN_SESSION, MAX_SESSION
    server.max_pending_activation_seconds = LOGIN_TIME
    server.max_pending_messages_per_connection = MAX_PENDING
