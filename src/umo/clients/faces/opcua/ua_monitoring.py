"""The services of subscriptions and monitored items of one server (OPC 10000-4, 5.13 and 5.14)."""

from __future__ import annotations

import copy
import time
import uuid
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from itertools import count
from typing import Any

from asyncua import Node, ua
from asyncua.common import events as templates
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AttributeValue

from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_attributes import Attributes, check_timestamps
from umo.clients.faces.opcua.ua_data_filter import data_filter
from umo.clients.faces.opcua.ua_event_filter import EventFilter
from umo.clients.faces.opcua.ua_items import DISABLED, REPORTING, SAMPLING, DataItem, EventItem
from umo.clients.faces.opcua.ua_subscriptions import UaSubscription

_C = ua.StatusCodes
_A = ua.AttributeIds
_O = ua.ObjectIds
OF_SESSION = (_A.UserAccessLevel, _A.UserExecutable, _A.Executable)
"""Attributes that are computed for each session, and do not change during the session."""
SUBSCRIBE_TO_EVENTS = 1
"""The bit SubscribeToEvents of EventNotifier."""
OWN_SEVERITY = 100
"""Severity of events about events: a refresh, an overflow."""
GOOD = ua.StatusCode()


class Monitoring:
    """The subscriptions of all sessions. It replaces asyncua's SubscriptionService."""

    def __init__(self, attributes: Attributes, clock: Callable[[], float] = time.monotonic) -> None:
        self._attributes, self._space, self.clock = attributes, attributes.space, clock
        self.subscriptions: dict[int, UaSubscription] = {}
        self.retained: dict[ua.NodeId, Any] = {}
        """The last event of each condition that is to be retained."""
        self._numbers, self._items = count(1), count(1)
        self._own: dict[int, Any] = {}
        """One event of each type that this server itself creates, as a template to copy."""

    async def prepare(self, server: Any) -> None:
        """Look up the types of the events that this server creates itself."""
        for kind in (_O.RefreshStartEventType, _O.RefreshEndEventType, _O.EventQueueOverflowEventType):
            node = Node(server.iserver.isession, ua.NodeId(kind))
            event = self._own[kind] = await templates.get_event_obj_from_type_node(node)
            event.Severity, event.SourceNode, event.SourceName = OWN_SEVERITY, ua.NodeId(_O.Server), "Server"
            event.Message = ua.LocalizedText(kind.name if hasattr(kind, "name") else "")

    # Subscriptions -----------------------------------------------------------------------------------------

    def create(self, session: Any, given: Any) -> ua.CreateSubscriptionResult:
        if len(self.subscriptions) >= limits.MAX_SUBSCRIPTIONS:
            raise ServiceError(_C.BadTooManySubscriptions)
        number = next(self._numbers)
        made = UaSubscription(number, session.session_id, session.publisher, given, self.forget)
        self.subscriptions[number] = session.publisher.subscriptions[number] = made
        made.start()
        return ua.CreateSubscriptionResult(number, made.interval, made.lifetime, made.keep_alive)

    def forget(self, subscription: UaSubscription) -> None:
        """Forget a subscription that has ended."""
        self.subscriptions.pop(subscription.number, None)

    def of(self, session: Any, number: int) -> UaSubscription:
        """Return a subscription of a session. Raises ServiceError if the session has no such subscription."""
        found = session.publisher.subscriptions.get(number)
        if found is None:
            raise ServiceError(_C.BadSubscriptionIdInvalid)
        found.touch()
        return found

    def modify(self, session: Any, given: Any) -> ua.ModifySubscriptionResult:
        changed = self.of(session, given.SubscriptionId)
        changed.set(given)
        changed.start()
        return ua.ModifySubscriptionResult(changed.interval, changed.lifetime, changed.keep_alive)

    def each(self, session: Any, numbers: list[int], do: Callable[[UaSubscription], object]) -> list[ua.StatusCode]:
        """Call a function for several subscriptions. Return the result for each subscription."""
        results = []
        for number in numbers:
            try:
                do(self.of(session, number))
                results.append(GOOD)
            except ServiceError as error:
                results.append(ua.StatusCode(error.code))
        return results

    def republish(self, session: Any, number: int, sequence: int) -> ua.NotificationMessage:
        message = self.of(session, number).kept.get(sequence)
        if message is None:
            raise ServiceError(_C.BadMessageNotAvailable)
        return message

    # Items -------------------------------------------------------------------------------------------------

    def create_items(self, session: Any, given: Any) -> list[ua.MonitoredItemCreateResult]:
        owner = self.of(session, given.SubscriptionId)
        check_timestamps(given.TimestampsToReturn)
        return [self._create_item(session, owner, each, given.TimestampsToReturn) for each in given.ItemsToCreate]

    def _create_item(
        self, session: Any, owner: UaSubscription, asked: Any, stamps: int
    ) -> ua.MonitoredItemCreateResult:
        result = ua.MonitoredItemCreateResult()
        try:
            if sum(len(each.items) for each in self.subscriptions.values()) >= limits.MAX_ITEMS:
                raise ServiceError(_C.BadTooManyMonitoredItems)
            if asked.MonitoringMode not in (DISABLED, SAMPLING, REPORTING):
                raise ServiceError(_C.BadMonitoringModeInvalid)
            is_event = asked.ItemToMonitor.AttributeId == _A.EventNotifier
            make = self._event_item if is_event else self._data_item
            item = make(session, owner, asked, stamps, result)
        except ServiceError as error:
            result.StatusCode = ua.StatusCode(error.code)
            return result
        owner.add(item)
        result.MonitoredItemId, result.RevisedQueueSize = item.number, item.size
        result.RevisedSamplingInterval = item.sampling
        return result

    def _data_item(self, session: Any, owner: UaSubscription, asked: Any, stamps: int, result: Any) -> DataItem:
        read, given = asked.ItemToMonitor, asked.RequestedParameters
        node, attribute = read.NodeId, read.AttributeId
        value = self._attributes.whole(session, node, attribute)
        data = self._space.get(node)
        if data is None or attribute not in data.attributes:
            raise ServiceError(value.StatusCode.value)
        if code := self._attributes.refusal(read, value):
            raise ServiceError(code)
        source = AttributeValue(value) if attribute in OF_SESSION else data.attributes[attribute]
        new = data_filter(self._space, node, attribute, given.Filter)
        return DataItem(next(self._items), owner.stir, self.clock, source, new, asked, stamps, owner.interval)

    def _event_item(self, session: Any, owner: UaSubscription, asked: Any, stamps: int, result: Any) -> EventItem:
        node = asked.ItemToMonitor.NodeId
        value = self._attributes.whole(session, node, _A.EventNotifier)
        if value.StatusCode is not None and value.StatusCode.is_bad():
            raise ServiceError(value.StatusCode.value)
        if not value.Value.Value & SUBSCRIBE_TO_EVENTS:
            raise ServiceError(_C.BadNotSupported)
        events = self._event_filter(asked.RequestedParameters.Filter, result, 0)
        overflown = partial(self._made, _O.EventQueueOverflowEventType)
        return EventItem(next(self._items), owner.stir, node, asked, events, overflown)

    def _event_filter(self, given: Any, result: Any, before: int) -> EventFilter:
        """Return a checked filter for events. The errors of the filter are stored in `result`. `before`: the cost of
        the filter that this one replaces."""
        events = EventFilter(self._space, given)
        if not (events.is_valid and events.is_whole):
            result.FilterResult = events.result
        if not events.is_valid:
            raise ServiceError(_C.BadEventFilterInvalid)
        known = sum(item.filter.cost for each in self.subscriptions.values() for item in _notifiers(each))
        if known - before + events.cost > limits.MAX_EVENT_COST:
            raise ServiceError(_C.BadTooManyMonitoredItems)
        return events

    def modify_items(self, session: Any, given: Any) -> list[ua.MonitoredItemModifyResult]:
        owner = self.of(session, given.SubscriptionId)
        check_timestamps(given.TimestampsToReturn)
        return [self._modify_item(owner, each, given.TimestampsToReturn) for each in given.ItemsToModify]

    def _modify_item(self, owner: UaSubscription, asked: Any, stamps: int) -> ua.MonitoredItemModifyResult:
        item, given = owner.items.get(asked.MonitoredItemId), asked.RequestedParameters
        result = ua.MonitoredItemModifyResult()
        try:
            if isinstance(item, EventItem):
                item.modify(given, self._event_filter(given.Filter, result, item.filter.cost))
            elif isinstance(item, DataItem):
                new = data_filter(self._space, item.asked.NodeId, item.asked.AttributeId, given.Filter)
                item.modify(given, new, stamps, owner.interval)
            else:
                raise ServiceError(_C.BadMonitoredItemIdInvalid)
        except ServiceError as error:
            result.StatusCode = ua.StatusCode(error.code)
            return result
        result.RevisedSamplingInterval, result.RevisedQueueSize = item.sampling, item.size
        return result

    def set_mode(self, session: Any, given: Any) -> list[ua.StatusCode]:
        owner = self.of(session, given.SubscriptionId)
        if given.MonitoringMode not in (DISABLED, SAMPLING, REPORTING):
            raise ServiceError(_C.BadMonitoringModeInvalid)
        results = []
        for number in given.MonitoredItemIds:
            item = owner.items.get(number)
            if item is not None:
                item.set_mode(given.MonitoringMode)
            results.append(GOOD if item is not None else ua.StatusCode(_C.BadMonitoredItemIdInvalid))
        return results

    def delete_items(self, session: Any, given: Any) -> list[ua.StatusCode]:
        owner = self.of(session, given.SubscriptionId)
        unknown = ua.StatusCode(_C.BadMonitoredItemIdInvalid)
        return [GOOD if owner.remove(each) else unknown for each in given.MonitoredItemIds]

    # Events ------------------------------------------------------------------------------------------------

    async def trigger_event(self, event: Any, subscription_id: int | None = None) -> None:
        """Receive an event that asyncua itself creates."""
        self.tell(event)

    def tell(self, event: Any) -> None:
        """Report an event. The event of a condition is kept as long as the condition is retained."""
        if hasattr(event, "Retain") and hasattr(event, "NodeId"):
            self.retained.pop(event.NodeId, None)
            if event.Retain:
                self.retained[event.NodeId] = event
        for each in self.subscriptions.values():
            for item in _notifiers(each):
                if item.node == event.emitting_node:
                    item.take(event)

    def refresh(self, subscription: UaSubscription, only: int | None = None) -> None:
        """Report the retained conditions again, between the two refresh events. `only`: the item to which they are
        reported; default: all. Raises ServiceError if the subscription has no such item."""
        items = [each for each in _notifiers(subscription) if only is None or each.number == only]
        if only is not None and not items:
            raise ServiceError(_C.BadMonitoredItemIdInvalid)
        start, end = (self._made(each) for each in (_O.RefreshStartEventType, _O.RefreshEndEventType))
        for item in items:
            item.take(start, always=True)
            for event in self.retained.values():
                item.take(event)
            item.take(end, always=True)

    def _made(self, kind: int) -> Any:
        event = copy.copy(self._own[kind])
        event.EventId = uuid.uuid4().bytes
        event.Time = event.ReceiveTime = datetime.now(UTC)
        return event


def _notifiers(subscription: UaSubscription) -> list[EventItem]:
    return list(subscription.notifiers.values())
