"""Subscriptions: they determine when changes are published, and in which portions (OPC 10000-4, 5.14)."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError

from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_attributes import weight
from umo.clients.faces.opcua.ua_items import EventItem, MonitoredItem

log = logging.getLogger("umo.faces.opcua")
_C = ua.StatusCodes
LAST_NUMBER = (1 << 32) - 1
"""The largest sequence number. The number after it is 1."""


@dataclass
class PublishRequest:
    """A Publish request that waits. `results`: the results of its acknowledgements."""

    header: Any
    sequence: Any
    results: list[ua.StatusCode]
    came: float

    def is_over(self, now: float) -> bool:
        """True if the request's client no longer waits."""
        hint = self.header.TimeoutHint
        return bool(hint) and now - self.came > hint / 1e3


Send = Callable[[PublishRequest, Any], int]
"""Function that answers a Publish request with a response. It returns 0, or a status code if the response cannot be
sent. In that case nothing was sent."""


def fault(code: int) -> Any:
    """Return the answer to a request that is refused as a whole."""
    response = ua.ServiceFault()
    response.ResponseHeader.ServiceResult = ua.StatusCode(code)
    return response


@dataclass(eq=False)
class Publisher:
    """The subscriptions of one session, and its Publish requests that wait."""

    send: Send
    clock: Callable[[], float] = time.monotonic
    subscriptions: dict[int, UaSubscription] = field(default_factory=dict)
    requests: deque[PublishRequest] = field(default_factory=deque)
    _ended: deque[ua.PublishResult] = field(default_factory=lambda: deque(maxlen=limits.MAX_SUBSCRIPTIONS))
    """Unsent notifications about subscriptions that have expired."""

    def publish(self, header: Any, sequence: Any, acknowledged: Iterable[Any]) -> None:
        """Accept a Publish request."""
        if not self.subscriptions and not self._ended:
            raise ServiceError(_C.BadNoSubscription)
        results = [self._acknowledge(each) for each in acknowledged]
        self._drop_old()
        if len(self.requests) >= limits.MAX_PUBLISH:
            self.fault(self.requests.popleft(), _C.BadTooManyPublishRequests)
        self.requests.append(PublishRequest(header, sequence, results, self.clock()))
        if self._ended and (code := self.answer(self._ended.popleft())):
            self.fault(self.requests.popleft(), code)
        for each in sorted(self.subscriptions.values(), key=lambda each: -each.priority):
            if each.is_late:
                each.catch_up()

    def _acknowledge(self, given: Any) -> ua.StatusCode:
        found = self.subscriptions.get(given.SubscriptionId)
        if found is None:
            return ua.StatusCode(_C.BadSubscriptionIdInvalid)
        is_kept = found.kept.pop(given.SequenceNumber, None) is not None
        return ua.StatusCode() if is_kept else ua.StatusCode(_C.BadSequenceNumberUnknown)

    def _drop_old(self) -> None:
        now = self.clock()
        for each in [each for each in self.requests if each.is_over(now)]:
            self.requests.remove(each)
            self.fault(each, _C.BadTimeout)

    def has_request(self) -> bool:
        self._drop_old()
        return bool(self.requests)

    def answer(self, result: ua.PublishResult) -> int:
        """Answer the oldest request. Return 0, or a status code if the answer cannot be sent. In that case the request
        still waits."""
        request = self.requests[0]
        result.Results = request.results
        code = self.send(request, ua.PublishResponse(Parameters=result))
        if not code:
            self.requests.popleft()
        return code

    def fault(self, request: PublishRequest, code: int) -> None:
        self.send(request, fault(code))

    def remove(self, number: int) -> None:
        """End a subscription."""
        self.subscriptions.pop(number).close()
        if not self.subscriptions:
            self._refuse_all(_C.BadNoSubscription)

    def expire(self, subscription: UaSubscription) -> None:
        """End a subscription whose client has sent no Publish request for its lifetime."""
        change = ua.StatusChangeNotification(Status=ua.StatusCode(_C.BadTimeout))
        self._ended.append(subscription.message([change]))
        self.remove(subscription.number)

    def _refuse_all(self, code: int) -> None:
        while self.requests:
            self.fault(self.requests.popleft(), code)

    def close(self) -> None:
        for number in list(self.subscriptions):
            self.subscriptions.pop(number).close()
        self._ended.clear()
        self._refuse_all(_C.BadSessionClosed)


class UaSubscription:
    """Publishes the notifications of its items, once in each publishing interval."""

    def __init__(
        self,
        number: int,
        session_id: ua.NodeId,
        publisher: Publisher,
        given: Any,
        ended: Callable[[UaSubscription], object],
    ) -> None:
        """`ended` is called when the subscription is closed."""
        self._ended = ended
        self.number, self.session_id, self.publisher = number, session_id, publisher
        self.items: dict[int, MonitoredItem] = {}
        self.notifiers: dict[int, EventItem] = {}
        """The items that receive events."""
        self.kept: OrderedDict[int, ua.NotificationMessage] = OrderedDict()
        """Messages that are not yet acknowledged, by their sequence numbers."""
        self.is_enabled = bool(given.PublishingEnabled)
        self.is_late = False
        """True if the next Publish request is answered at once."""
        self._stirred: dict[MonitoredItem, None] = {}
        """Items that may have notifications to publish."""
        self._portions: deque[list[Any]] = deque()
        """Notifications of items that could not be sent in one message."""
        self._next = 1
        self._is_first = True
        self._quiet = self._silent = 0
        """Number of publishing cycles without a notification, and without a Publish request."""
        self._task: asyncio.Task[None] | None = None
        self.pub_result_callback = self.pub_request_callback = None  # asyncua sets them when a session is taken up
        self.set(given)

    def set(self, given: Any) -> None:
        """Change the settings that a client may change. Each value is revised to the nearest possible one."""
        asked = given.RequestedPublishingInterval
        if not isfinite(asked):
            asked = limits.LONGEST_INTERVAL if asked > 0 else 0.0
        self.interval = min(max(asked, limits.SHORTEST_PUBLISHING), limits.LONGEST_INTERVAL)
        """The publishing interval in ms."""
        self.keep_alive = min(given.RequestedMaxKeepAliveCount or limits.KEEP_ALIVE, limits.MAX_KEEP_ALIVE)
        self.lifetime = max(3 * self.keep_alive, min(given.RequestedLifetimeCount, limits.MAX_LIFETIME))
        self.portion = min(given.MaxNotificationsPerPublish or limits.MAX_NOTIFICATIONS, limits.MAX_NOTIFICATIONS)
        """Largest number of notifications in one response."""
        self.priority = int(given.Priority)
        self._silent = 0

    def start(self) -> None:
        """Begin to publish, once in each publishing interval."""
        if self._task is not None:
            self._task.cancel()
        self._task = asyncio.create_task(self._go_on())

    async def _go_on(self) -> None:
        clock = self.publisher.clock
        due = clock()
        while True:
            due = max(due + self.interval / 1e3, clock())
            await asyncio.sleep(due - clock())
            self.tick()

    def tick(self) -> None:
        """Carry out a publishing cycle. An error in asyncua loses a message, but does not end the subscription."""
        try:
            self._tick()
        except Exception as error:
            log.debug("subscription %d", self.number, exc_info=error)

    def _tick(self) -> None:
        self._settle()
        self._quiet += 1
        if self.publisher.has_request():
            self._silent = 0
            self._publish()
            return
        self._silent += 1
        if self._silent >= self.lifetime:
            self.publisher.expire(self)
        elif self._is_due():
            self.is_late = True

    def _is_due(self) -> bool:
        return self._is_first or self._quiet >= self.keep_alive or (self.is_enabled and self._has_told())

    def _publish(self) -> None:
        """Answer requests while there is something to send; send a keep-alive if nothing was sent for long."""
        self.is_late = False
        while self.is_enabled and self._has_told():
            if not self.publisher.has_request():
                self.is_late = True
                return
            self._send(self._notifications())
        if self._is_due():
            self._send([])

    def catch_up(self) -> None:
        """Publish late notifications, because a Publish request has arrived."""
        if self.publisher.requests:
            self._silent = 0
            self._settle()
            self._publish()

    # What is told ------------------------------------------------------------------------------------------

    def stir(self, item: MonitoredItem) -> None:
        """Record that an item may have a notification."""
        self._stirred[item] = None

    def _settle(self) -> None:
        now = self.publisher.clock()
        for item in list(self._stirred):
            if not item.settle(now) and not item.is_told:
                self._stirred.pop(item, None)

    def _has_told(self) -> bool:
        return bool(self._portions) or any(each.is_told for each in self._stirred)

    def _notifications(self) -> list[Any]:
        """Return the next portion of notifications, those of each item beginning with the oldest."""
        if self._portions:
            return self._portions.popleft()
        told: list[Any] = []
        left = limits.MAX_RESPONSE
        for item in list(self._stirred):
            while item.is_told and len(told) < self.portion and left > 0:
                told.append(item.notification())
                left -= _weight(told[-1])
            if len(told) >= self.portion or left <= 0:
                break
        return told

    def _send(self, told: list[Any]) -> None:
        result = self.message(_data(told))
        result.MoreNotifications = self.is_enabled and self._has_told()
        self._quiet, self._is_first = 0, False
        if code := self.publisher.answer(result):
            self._next = result.NotificationMessage.SequenceNumber
            self.kept.pop(self._next, None)
            self._divide(told, code)

    def _divide(self, told: list[Any], code: int) -> None:
        """Divide notifications that do not fit into one message. A single notification that does not fit is sent
        without its content."""
        half = len(told) // 2
        if half:
            self._portions.extendleft((told[half:], told[:half]))
            self.portion = min(self.portion, half) if code == _C.BadResponseTooLarge else self.portion
        elif told and (bare := _bare(told[0], code)) is not None:
            self._portions.appendleft([bare])
        else:
            self.publisher.fault(self.publisher.requests.popleft(), code)

    def message(self, told: list[Any]) -> ua.PublishResult:
        """Return a message with the next sequence number. The message is kept until it is acknowledged, unless it is a
        keep-alive."""
        message = ua.NotificationMessage(SequenceNumber=self._next, NotificationData=told)
        if told:
            self.kept[self._next] = message
            self._next = 1 if self._next >= LAST_NUMBER else self._next + 1
            sizes = deque(map(_size, self.kept.values()))
            while len(sizes) > limits.MAX_UNACKNOWLEDGED or (len(sizes) > 1 and sum(sizes) > limits.MAX_KEPT):
                self.kept.popitem(last=False)
                sizes.popleft()
        return ua.PublishResult(
            SubscriptionId=self.number, AvailableSequenceNumbers=list(self.kept), MoreNotifications=False,
            NotificationMessage=message,
        )  # fmt: skip

    def touch(self) -> None:
        """Record that the client has sent a request that names this subscription."""
        self._silent = 0

    def add(self, item: MonitoredItem) -> None:
        self.items[item.number] = item
        if isinstance(item, EventItem):
            self.notifiers[item.number] = item

    def remove(self, number: int) -> bool:
        """End an item. Return True if the item existed."""
        self.notifiers.pop(number, None)
        item = self.items.pop(number, None)
        if item is None:
            return False
        self._stirred.pop(item, None)
        item.close()
        return True

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()
        for number in list(self.items):
            self.remove(number)
        self._ended(self)


def _data(told: list[Any]) -> list[Any]:
    """Return notifications as the data of a message."""
    values = [each for each in told if isinstance(each, ua.MonitoredItemNotification)]
    events = [each for each in told if isinstance(each, ua.EventFieldList)]
    found: list[Any] = [ua.DataChangeNotification(MonitoredItems=values)] if values else []
    return [*found, ua.EventNotificationList(Events=events)] if events else found


def _weight(notification: Any) -> int:
    """Return the approximate size of a notification in bytes."""
    if isinstance(notification, ua.MonitoredItemNotification):
        return weight(notification.Value)
    return sum(map(weight, notification.EventFields))


def _bare(notification: Any, code: int) -> Any | None:
    """Return the notification without its content, or None if it has no content."""
    handle = notification.ClientHandle
    if isinstance(notification, ua.MonitoredItemNotification):
        value = notification.Value
        is_bare = value.Value is None or value.Value.Value is None
        bare = ua.DataValue(None, ua.StatusCode(code), value.SourceTimestamp, value.ServerTimestamp)
        return None if is_bare else ua.MonitoredItemNotification(handle, bare)
    fields = notification.EventFields
    nothing = [ua.Variant() for _ in fields]
    return None if all(each.Value is None for each in fields) else ua.EventFieldList(handle, nothing)


def _size(message: ua.NotificationMessage) -> int:
    """Return the number of notifications in a message."""
    lists = (getattr(each, name, ()) for each in message.NotificationData for name in ("MonitoredItems", "Events"))
    return sum(map(len, lists))
