"""Requests of OPC UA as a hostile, a broken or a hasty client may send them, for hypothesis: it has the seed and the
shrinker."""

from __future__ import annotations

import uuid
from typing import Any

from asyncua import ua
from hypothesis import strategies as st

from umo.clients.faces.opcua.ua_services import (
    BrowseDescription,
    BrowseParameters,
    CreateItem,
    CreateItemsParameters,
    HistoryReadParameters,
    ModifyItemsParameters,
    ReadParameters,
    SetModeParameters,
)

OWN = 6
"""Index of the namespace of the machine."""
NAMES = (
    "cell.level", "cell.position", "cell.limit", "cell.phase", "cell.valve", "tunable:cell.gain", "cell.level/EURange",
    "part:cell", "machine", "refusal", "action:cell.add", "action:cell.jog", "command:mode", "command:let go",
    "command:cancel", "condition:cell.full", "condition:cell.full/Acknowledge", "condition:cell.full/Shelve", "cell.no",
)  # fmt: skip
"""All but the command that ends the run."""
NUMBERS = (
    0, 24, 33, 35, 46, 47, 58, 84, 85, 2041, 2253, 2256, 2258, 2259, 2268, 2782, 2915, 3875, 9111, 11492, 12912, 99_999,
)  # fmt: skip
ODD = (ua.NodeId(), ua.NodeId("cell.level", 7), ua.NodeId(b"\0" * 40, OWN), ua.NodeId(uuid.UUID(int=1), OWN))


def mostly(usual: Any, odd: Any) -> Any:
    """What a client means to send, and one time in six something else."""
    return st.integers(0, 5).flatmap(lambda chance: odd if chance == 5 else usual)


OWN_IDS = st.sampled_from([ua.NodeId(each, OWN) for each in NAMES])
STANDARD_IDS = st.sampled_from([ua.NodeId(each) for each in NUMBERS])
IDS = st.one_of(OWN_IDS, STANDARD_IDS, st.sampled_from(ODD))
VALUES = mostly(st.sampled_from([ua.NodeId(each, OWN) for each in NAMES[:7]]), IDS)
PARENTS = st.sampled_from([ua.NodeId(each, OWN) for each in ("part:cell", "machine", "condition:cell.full")])
METHODS = st.sampled_from(
    [ua.NodeId(each, OWN) for each in NAMES[10:18]] + [ua.NodeId(each) for each in (3875, 9111, 11492, 12912)]
)
OBJECTS = st.one_of(PARENTS, st.sampled_from([ua.NodeId(2253), ua.NodeId(2782)]))
TYPES = st.sampled_from([ua.NodeId(each) for each in (2041, 2782, 2915)])
REFERENCES = st.sampled_from([ua.NodeId(each) for each in (0, 31, 33, 35, 46, 47)])
SMALL = st.sampled_from((0, 1, 2, 3, 7, 100, 1000, (1 << 31) - 1))
COUNTS = st.one_of(SMALL, st.sampled_from((1 << 31, (1 << 32) - 1)))
INFINITE = (float("nan"), float("inf"), float("-inf"))
FLOATS = st.one_of(
    st.sampled_from((0.0, -1.0, 1.0, 5.0, 50.0, 100.0, 100.5, 1e308, -1e308, *INFINITE)), st.floats()
)  # fmt: skip
WORDS = ("", "EURange", "Default Binary", "Default XML", "cell", "%_[a-")
TEXTS = st.one_of(st.none(), st.sampled_from(WORDS), st.text(max_size=5))
RANGES = mostly(st.none(), st.sampled_from(("", "0", "1:3", "3:1", "x", "0,1", "-1", "9" * 30, "0:99999999", "1:")))
QUALIFIED = st.builds(ua.QualifiedName, TEXTS, st.sampled_from((0, OWN, 32_767)))
ATTRIBUTES = mostly(st.just(13), st.one_of(st.integers(0, 30), COUNTS))
ENUM = mostly(st.integers(0, 2), st.one_of(st.integers(0, 4), st.sampled_from((-1, 99, (1 << 31) - 1))))
"""In the place of an enumeration: also what it does not have."""
FLAGS = st.booleans()
MINE = -1
"""In the place of an identifier of a subscription or an item: one that the client has."""
OWNED = mostly(st.integers(MINE - 3, MINE), COUNTS)


def some(kind: Any, most: int = 3) -> Any:
    return st.lists(kind, max_size=most)


VARIANTS: Any = st.one_of(
    st.just(ua.Variant()),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.Double), FLOATS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.Int32), st.integers(-3, 3)),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.UInt32), COUNTS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.Boolean), FLAGS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.String), TEXTS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.ByteString), st.binary(max_size=20)),
    st.builds(lambda value: ua.Variant(ua.LocalizedText(value), ua.VariantType.LocalizedText), TEXTS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.NodeId), IDS),
    st.builds(lambda value: ua.Variant(value, ua.VariantType.Double, is_array=True), some(FLOATS)),
    st.just(ua.Variant(ua.Range(0, 1), ua.VariantType.ExtensionObject)),
)
STATUSES = st.one_of(st.none(), st.builds(ua.StatusCode, st.sampled_from((0, 0x480, 1 << 30, 1 << 31, (1 << 32) - 1))))
DATA = st.builds(ua.DataValue, VARIANTS, STATUSES)
FIELDS = st.sampled_from(("Message", "Severity", "EventType", "Time", "Retain", "data_types", "add_property"))
FIELD_PATHS = mostly(st.builds(lambda name: [ua.QualifiedName(name, 0)], FIELDS), some(QUALIFIED))
CLAUSES = st.builds(ua.SimpleAttributeOperand, mostly(TYPES, IDS), FIELD_PATHS, ATTRIBUTES, RANGES)
OPERANDS = st.one_of(
    st.builds(ua.LiteralOperand, VARIANTS), st.builds(ua.ElementOperand, SMALL), CLAUSES,
    st.builds(ua.Range, FLOATS, FLOATS),
    st.just(ua.AttributeOperand()),
)  # fmt: skip
ELEMENTS = st.builds(ua.ContentFilterElement, st.integers(0, 18), some(OPERANDS, 4))
FILTERS = st.one_of(
    st.just(ua.ExtensionObject()),
    st.builds(ua.DataChangeFilter, st.integers(0, 3), st.integers(0, 4), FLOATS),
    st.builds(ua.EventFilter, some(CLAUSES), st.builds(ua.ContentFilter, some(ELEMENTS))),
    st.just(ua.AggregateFilter()),
    st.just(ua.ExtensionObject(ua.NodeId(9999), b"abc")),
    st.builds(ua.Range, FLOATS, FLOATS),
)
NO_NAME = st.just(ua.QualifiedName())
READS = st.builds(ua.ReadValueId, VALUES, ATTRIBUTES, RANGES, mostly(NO_NAME, QUALIFIED))
NOTIFIERS = st.builds(ua.ReadValueId, st.just(ua.NodeId(2253)), st.just(12))
MONITORED = st.builds(ua.MonitoringParameters, COUNTS, mostly(st.just(0.0), FLOATS), FILTERS, COUNTS, FLAGS)
CALLED = st.builds(ua.CallMethodRequest, mostly(OBJECTS, IDS), mostly(METHODS, IDS), some(VARIANTS))
ENABLED = mostly(st.just(True), FLAGS)
CREATED = st.builds(CreateItem, mostly(READS, NOTIFIERS), mostly(st.just(2), ENUM), MONITORED)
STEPS = some(st.builds(ua.RelativePathElement, mostly(REFERENCES, IDS), FLAGS, FLAGS, QUALIFIED))
PATHS = st.builds(ua.BrowsePath, IDS, st.builds(ua.RelativePath, STEPS))
SUBSCRIPTION = (mostly(st.sampled_from((0.0, 50.0, -1.0)), FLOATS), COUNTS, COUNTS, COUNTS)
PARAMETERS = {
    "Read": st.builds(ReadParameters, FLOATS, ENUM, some(READS)),
    "HistoryRead": st.builds(
        HistoryReadParameters, st.just(ua.ReadRawModifiedDetails()), ENUM, FLAGS,
        some(st.builds(ua.HistoryReadValueId, IDS, RANGES)),
    ),
    "Write": st.builds(ua.WriteParameters, some(st.builds(ua.WriteValue, VALUES, ATTRIBUTES, RANGES, DATA))),
    "Call": st.builds(ua.CallParameters, some(CALLED)),
    "Browse": st.builds(
        BrowseParameters, st.builds(ua.ViewDescription, mostly(st.just(ua.NodeId()), IDS)), COUNTS,
        some(st.builds(BrowseDescription, IDS, ENUM, mostly(REFERENCES, IDS), FLAGS, COUNTS, COUNTS)),
    ),
    "BrowseNext": st.builds(ua.BrowseNextParameters, FLAGS, some(st.binary(max_size=20))),
    "TranslateBrowsePathsToNodeIds": st.builds(ua.TranslateBrowsePathsToNodeIdsParameters, some(PATHS)),
    "RegisterNodes": st.builds(ua.RegisterNodesParameters, some(IDS)),
    "UnregisterNodes": st.builds(ua.UnregisterNodesParameters, some(IDS)),
    "CreateSubscription": st.builds(ua.CreateSubscriptionParameters, *SUBSCRIPTION, ENABLED, st.integers(0, 255)),
    "ModifySubscription": st.builds(ua.ModifySubscriptionParameters, OWNED, *SUBSCRIPTION, st.integers(0, 255)),
    "SetPublishingMode": st.builds(ua.SetPublishingModeParameters, FLAGS, some(OWNED)),
    "DeleteSubscriptions": st.builds(ua.DeleteSubscriptionsParameters, some(OWNED, 1)),
    "Republish": st.builds(ua.RepublishParameters, OWNED, COUNTS),
    "CreateMonitoredItems": st.builds(CreateItemsParameters, OWNED, ENUM, some(CREATED)),
    "ModifyMonitoredItems": st.builds(
        ModifyItemsParameters, OWNED, ENUM, some(st.builds(ua.MonitoredItemModifyRequest, OWNED, MONITORED))
    ),
    "SetMonitoringMode": st.builds(SetModeParameters, OWNED, ENUM, some(OWNED)),
    "DeleteMonitoredItems": st.builds(ua.DeleteMonitoredItemsParameters, OWNED, some(OWNED)),
    "Publish": st.builds(
        ua.PublishParameters, some(st.builds(ua.SubscriptionAcknowledgement, OWNED, COUNTS))
    ),
    "TransferSubscriptions": st.builds(ua.TransferSubscriptionsParameters, some(COUNTS), FLAGS),
    "SetTriggering": st.builds(ua.SetTriggeringParameters, COUNTS, COUNTS, some(COUNTS), some(COUNTS)),
    "AddNodes": st.just(ua.AddNodesParameters()),
}  # fmt: skip
"""Structures of requests by the names of their services."""
LENGTHS = st.sampled_from((-(1 << 31), -8, -4, -2, 0, 1, 1000, 1_000_000, (1 << 31) - 1))
ARRAYS = st.one_of(st.just(b""), st.integers(0x80, 0xFF).map(lambda code: bytes([code])))
"""Nothing, or the byte before the length of an array: those of 0x80 take no byte for an element."""
WRONG = st.one_of(
    st.binary(min_size=1, max_size=1),
    st.builds(lambda array, length: array + length.to_bytes(4, "little", signed=True), ARRAYS, LENGTHS),
)
DAMAGE = st.one_of(
    st.just(()), st.just(()), st.just(()), st.lists(st.tuples(st.integers(0, 400), WRONG), max_size=3)
)  # fmt: skip
"""Bytes of the message that are others: where, and what they are."""
OFTEN = ("CreateSubscription", "CreateMonitoredItems") * 3
REQUESTS = st.one_of(
    *(st.tuples(st.just(name), kind, DAMAGE) for name, kind in PARAMETERS.items()),
    *(st.tuples(st.just(name), PARAMETERS[name], st.just(())) for name in OFTEN),
)
"""Service, structure, damage."""


def with_own(given: Any, subscriptions: list[int], items: list[int]) -> Any:
    """The same with identifiers that the client has in the places of MINE and what is below it."""
    for name in getattr(given, "__dataclass_fields__", ()):
        if name in ("Encoding", "data_type"):
            continue
        value = getattr(given, name)
        owned = items if "MonitoredItem" in name else subscriptions
        if isinstance(value, int) and name in ("SubscriptionId", "MonitoredItemId"):
            setattr(given, name, _own(value, owned))
        elif isinstance(value, list) and name in ("SubscriptionIds", "MonitoredItemIds"):
            setattr(given, name, [_own(each, owned) for each in value])
        elif isinstance(value, list):
            for each in value:
                with_own(each, subscriptions, items)
    return given


def _own(value: int, owned: list[int]) -> int:
    if value >= 0:
        return value
    return owned[value % len(owned)] if owned else 0
