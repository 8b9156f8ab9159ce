"""The services that a session may ask for (OPC 10000-4, 5): the requests of clients, and the functions that answer
them.

Write and Call are answered by `ua_connection`, because the machine needs time for them. The structures of requests are
those of the standard with numbers instead of enumerations: asyncua 2.1 cannot decode a number that an enumeration does
not have, and the standard has a status code for each such case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.ua.ua_binary import struct_from_binary

from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_attributes import ResponseSpace, check_timestamps, missing

_C = ua.StatusCodes
REFERENCE = 100
"""Approximate size of a reference in bytes."""


def service(name: str) -> ua.NodeId:
    """Return the type of a request."""
    return ua.NodeId(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary"))


def decoded(kind: Any, body: Any) -> Any:
    """Return a decoded structure. Raises ServiceError if the bytes could not be decoded as one."""
    try:
        return struct_from_binary(kind, body)
    except ServiceError:
        raise
    except Exception:
        raise ServiceError(_C.BadDecodingError) from None


def counted(operations: list[Any], most: int = limits.MAX_OPERATIONS) -> list[Any]:
    """Return the operations of a request. Raises ServiceError if it has none, or too many."""
    if not operations:
        raise ServiceError(_C.BadNothingToDo)
    if len(operations) > most:
        raise ServiceError(_C.BadTooManyOperations)
    return operations


# Structures ------------------------------------------------------------------------------------------------


@dataclass
class ReadParameters:
    MaxAge: ua.Duration = 0
    TimestampsToReturn: ua.Int32 = 0
    NodesToRead: list[ua.ReadValueId] = field(default_factory=list)


@dataclass
class HistoryReadParameters:
    HistoryReadDetails: ua.ExtensionObject = None
    TimestampsToReturn: ua.Int32 = 0
    ReleaseContinuationPoints: ua.Boolean = True
    NodesToRead: list[ua.HistoryReadValueId] = field(default_factory=list)


@dataclass
class BrowseDescription:
    NodeId: ua.NodeId = field(default_factory=ua.NodeId)
    BrowseDirection: ua.Int32 = 0
    ReferenceTypeId: ua.NodeId = field(default_factory=ua.NodeId)
    IncludeSubtypes: ua.Boolean = True
    NodeClassMask: ua.UInt32 = 0
    ResultMask: ua.UInt32 = 0


@dataclass
class BrowseParameters:
    View: ua.ViewDescription = field(default_factory=ua.ViewDescription)
    RequestedMaxReferencesPerNode: ua.UInt32 = 0
    NodesToBrowse: list[BrowseDescription] = field(default_factory=list)


@dataclass
class CreateItem:
    ItemToMonitor: ua.ReadValueId = field(default_factory=ua.ReadValueId)
    MonitoringMode: ua.Int32 = 0
    RequestedParameters: ua.MonitoringParameters = field(default_factory=ua.MonitoringParameters)


@dataclass
class CreateItemsParameters:
    SubscriptionId: ua.UInt32 = 0
    TimestampsToReturn: ua.Int32 = 0
    ItemsToCreate: list[CreateItem] = field(default_factory=list)


@dataclass
class ModifyItemsParameters:
    SubscriptionId: ua.UInt32 = 0
    TimestampsToReturn: ua.Int32 = 0
    ItemsToModify: list[ua.MonitoredItemModifyRequest] = field(default_factory=list)


@dataclass
class SetModeParameters:
    SubscriptionId: ua.UInt32 = 0
    MonitoringMode: ua.Int32 = 0
    MonitoredItemIds: list[ua.UInt32] = field(default_factory=list)


# Services --------------------------------------------------------------------------------------------------


def _read(session: Any, asked: Any) -> Any:
    nodes = counted(asked.NodesToRead, limits.MAX_READ)
    results = session.iserver.attributes.read(session, asked.MaxAge, asked.TimestampsToReturn, nodes)
    return ua.ReadResponse(Results=results)


def _history_read(session: Any, asked: Any) -> Any:
    """Refuse the request, because this server has no history. Recordings and fleets have one."""
    check_timestamps(asked.TimestampsToReturn)
    unsupported = ua.StatusCode(_C.BadHistoryOperationUnsupported)
    space = session.iserver.aspace
    results = [
        ua.HistoryReadResult(unsupported if each.NodeId in space else missing(each.NodeId))
        for each in counted(asked.NodesToRead)
    ]
    return ua.HistoryReadResponse(Results=results)


def _browse(session: Any, asked: Any) -> Any:
    if not asked.View.ViewId.is_null():
        raise ServiceError(_C.BadViewIdUnknown)
    nodes = counted(asked.NodesToBrowse)
    most, room = asked.RequestedMaxReferencesPerNode, ResponseSpace()
    return ua.BrowseResponse(Results=[_roomy(session.view.browse(each, most), room) for each in nodes])


def _roomy(result: Any, room: ResponseSpace) -> Any:
    """Return the result. Raises ServiceError if the response has no room for it."""
    room.take(REFERENCE * len(result.References or []))
    return result


def _browse_next(session: Any, asked: Any) -> Any:
    points = counted(asked.ContinuationPoints)
    room = ResponseSpace()
    results = [_roomy(session.view.browse_next(each, asked.ReleaseContinuationPoints), room) for each in points]
    return ua.BrowseNextResponse(Parameters=ua.BrowseNextResult(results))


def _translate(session: Any, asked: Any) -> Any:
    results = [session.view.translate(each) for each in counted(asked.BrowsePaths)]
    return ua.TranslateBrowsePathsToNodeIdsResponse(Results=results)


def _register(session: Any, asked: Any) -> Any:
    """Return the identifiers of the nodes unchanged, because nodes need no preparation."""
    nodes = counted(asked.NodesToRegister)
    if any(each.is_null() for each in nodes):
        raise ServiceError(_C.BadNodeIdInvalid)
    return ua.RegisterNodesResponse(Parameters=ua.RegisterNodesResult(nodes))


def _unregister(session: Any, asked: Any) -> Any:
    counted(asked.NodesToUnregister)
    return ua.UnregisterNodesResponse()


def _create_subscription(session: Any, asked: Any) -> Any:
    return ua.CreateSubscriptionResponse(Parameters=session.monitoring.create(session, asked))


def _modify_subscription(session: Any, asked: Any) -> Any:
    return ua.ModifySubscriptionResponse(Parameters=session.monitoring.modify(session, asked))


def _set_publishing(session: Any, asked: Any) -> Any:
    def enable(subscription: Any) -> None:
        subscription.is_enabled = asked.PublishingEnabled

    results = session.monitoring.each(session, counted(asked.SubscriptionIds), enable)
    return ua.SetPublishingModeResponse(Parameters=ua.SetPublishingModeResult(results))


def _delete_subscriptions(session: Any, asked: Any) -> Any:
    def remove(subscription: Any) -> None:
        session.publisher.remove(subscription.number)

    results = session.monitoring.each(session, counted(asked.SubscriptionIds), remove)
    return ua.DeleteSubscriptionsResponse(Results=results)


def _republish(session: Any, asked: Any) -> Any:
    message = session.monitoring.republish(session, asked.SubscriptionId, asked.RetransmitSequenceNumber)
    return ua.RepublishResponse(NotificationMessage=message)


def _create_items(session: Any, asked: Any) -> Any:
    counted(asked.ItemsToCreate, limits.MAX_ITEMS)
    return ua.CreateMonitoredItemsResponse(Results=session.monitoring.create_items(session, asked))


def _modify_items(session: Any, asked: Any) -> Any:
    counted(asked.ItemsToModify, limits.MAX_ITEMS)
    return ua.ModifyMonitoredItemsResponse(Results=session.monitoring.modify_items(session, asked))


def _set_mode(session: Any, asked: Any) -> Any:
    counted(asked.MonitoredItemIds, limits.MAX_ITEMS)
    results = session.monitoring.set_mode(session, asked)
    return ua.SetMonitoringModeResponse(Parameters=ua.SetMonitoringModeResult(results))


def _delete_items(session: Any, asked: Any) -> Any:
    counted(asked.MonitoredItemIds, limits.MAX_ITEMS)
    return ua.DeleteMonitoredItemsResponse(Results=session.monitoring.delete_items(session, asked))


SERVICES: Mapping[Any, tuple[Any, Callable[[Any, Any], Any]]] = {
    service("Read"): (ReadParameters, _read),
    service("HistoryRead"): (HistoryReadParameters, _history_read),
    service("Browse"): (BrowseParameters, _browse),
    service("BrowseNext"): (ua.BrowseNextParameters, _browse_next),
    service("TranslateBrowsePathsToNodeIds"): (ua.TranslateBrowsePathsToNodeIdsParameters, _translate),
    service("RegisterNodes"): (ua.RegisterNodesParameters, _register),
    service("UnregisterNodes"): (ua.UnregisterNodesParameters, _unregister),
    service("CreateSubscription"): (ua.CreateSubscriptionParameters, _create_subscription),
    service("ModifySubscription"): (ua.ModifySubscriptionParameters, _modify_subscription),
    service("SetPublishingMode"): (ua.SetPublishingModeParameters, _set_publishing),
    service("DeleteSubscriptions"): (ua.DeleteSubscriptionsParameters, _delete_subscriptions),
    service("Republish"): (ua.RepublishParameters, _republish),
    service("CreateMonitoredItems"): (CreateItemsParameters, _create_items),
    service("ModifyMonitoredItems"): (ModifyItemsParameters, _modify_items),
    service("SetMonitoringMode"): (SetModeParameters, _set_mode),
    service("DeleteMonitoredItems"): (ua.DeleteMonitoredItemsParameters, _delete_items),
}
"""Services that are answered immediately: the structure of the request, and the function that answers it."""
