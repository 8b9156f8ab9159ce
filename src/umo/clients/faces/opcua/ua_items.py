"""Monitored items: their sampling, and the queue of values to be published (OPC 10000-4, 5.13)."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from math import isfinite
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AttributeValue

from umo.clients.faces.opcua.ua_attributes import ranged, stamped, with_timestamps
from umo.clients.faces.opcua.ua_data_filter import DataFilter
from umo.clients.faces.opcua.ua_event_filter import EventFilter
from umo.clients.faces.opcua.ua_limits import LONGEST_INTERVAL, MAX_QUEUE

log = logging.getLogger("umo.faces.opcua")
DISABLED, SAMPLING, REPORTING = range(3)
"""MonitoringMode."""
OVERFLOW = 0x480
"""Bits of a StatusCode. They mean that the InfoType is DataValue, and that values before or after this one were left
out."""
Stir = Callable[["MonitoredItem"], object]


class MonitoredItem:
    """The common part of monitored items: mode and queue. `stir` notifies the subscription that the item may have
    something to publish."""

    def __init__(self, number: int, stir: Stir, mode: int, given: Any) -> None:
        self.number, self.mode = number, mode
        self._stir = stir
        self.queue: deque[Any] = deque()
        self._set(given)

    def _set(self, given: Any) -> None:
        self.handle = int(given.ClientHandle)
        self.discard_oldest = bool(given.DiscardOldest)
        self.size = self.revised_size(given.QueueSize)

    def revised_size(self, asked: int) -> int:
        raise NotImplementedError

    def _resize(self, given: Any) -> None:
        """Move the waiting notifications to a queue of another size, as if they arrived now."""
        self._set(given)
        waiting = list(self.queue)
        self.queue.clear()
        for each in waiting:
            self._queue(each)

    def _queue(self, content: Any) -> None:
        """Queue a notification. If the queue is full, one notification is left out, and the client is informed."""
        raise NotImplementedError

    @property
    def is_told(self) -> bool:
        """True if there is something to publish."""
        return self.mode == REPORTING and bool(self.queue)

    def settle(self, now: float) -> bool:
        """Take the samples that are due. Return True if something remains for later."""
        return False

    def set_mode(self, mode: int) -> None:
        self.mode = mode
        if mode == DISABLED:
            self.queue.clear()
        self._stir(self)

    def notification(self) -> Any:
        """Return and remove the notification that waits longest."""
        raise NotImplementedError

    def close(self) -> None:
        """Stop watching for changes."""


class DataItem(MonitoredItem):
    """Monitors an attribute.

    The item receives a value when the attribute changes. The value is sampled at the next multiple of the sampling
    interval. A value with another status is sampled immediately, so that no failure between two samples is missed.
    `sampling` is the revised interval in ms, or 0 if every value is taken when it arrives.
    """

    def __init__(
        self, number: int, stir: Stir, clock: Callable[[], float], source: AttributeValue, new: DataFilter,
        request: Any, timestamps: int, publishing: float,
    ) -> None:  # fmt: skip
        """`clock`: function that returns the time in s; `publishing`: the publishing interval of the subscription in
        ms."""
        super().__init__(number, stir, int(request.MonitoringMode), request.RequestedParameters)
        self._clock, self._source, self.asked = clock, source, request.ItemToMonitor
        self._last: ua.DataValue | None = None
        """The last value that was put into the queue."""
        self._held: ua.DataValue | None = None
        """The latest value that has arrived since the last sample."""
        self._began, self._tick = clock(), 0
        self.filter, self.timestamps = new, timestamps
        self.sampling = revised_sampling(request.RequestedParameters.SamplingInterval, publishing)
        source.datachange_callbacks[self] = self._heard
        self._restart()

    def revised_size(self, asked: int) -> int:
        return min(max(1, int(asked)), MAX_QUEUE)

    def _restart(self) -> None:
        self._began, self._tick = self._clock(), 0
        if self._source.value is not None:
            self.take(self._source.value)

    async def _heard(self, item: DataItem, value: ua.DataValue) -> None:
        """Take a change of a node that asyncua itself manages."""
        self.take(value)

    def take(self, value: ua.DataValue) -> None:
        """Take a new value. If it cannot be stored, the client is notified that a value is missing, and the face
        continues."""
        try:
            self._take(value)
        except Exception as error:
            log.debug("item %d", self.number, exc_info=error)
            self._last, self._held = None, None
            self._queue(ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadInternalError)))

    def _take(self, value: ua.DataValue) -> None:
        if self.mode == DISABLED:
            return
        self.settle(self._clock())
        value = ranged(value, self.asked.IndexRange)
        before = self._last
        if not self.sampling or before is None or before.StatusCode != value.StatusCode:
            self._held = None
            self._sample(value)
        else:
            self._held = value
            self._stir(self)

    def settle(self, now: float) -> bool:
        if self._held is None:
            return False
        tick = int((now - self._began) * 1e3 / self.sampling) if self.sampling else self._tick + 1
        if tick <= self._tick:
            return True
        self._tick, held, self._held = tick, self._held, None
        self._sample(held)
        return False

    def _sample(self, value: ua.DataValue) -> None:
        if self.filter.tells(self._last, value):
            self._last = value
            self._queue(value if value.ServerTimestamp is not None else stamped(value, datetime.now(UTC)))

    def _queue(self, value: ua.DataValue) -> None:
        if len(self.queue) < self.size:
            self.queue.append(value)
        elif self.size == 1:
            self.queue[0] = value
        elif self.discard_oldest:
            self.queue.popleft()
            self.queue[0] = _overflown(self.queue[0])
            self.queue.append(value)
        else:
            self.queue[-1] = _overflown(value)
        self._stir(self)

    def set_mode(self, mode: int) -> None:
        before = self.mode
        super().set_mode(mode)
        if mode == DISABLED:
            self._last = self._held = None
        elif before == DISABLED:
            self._restart()

    def modify(self, given: Any, new: DataFilter, timestamps: int, publishing: float) -> None:
        now = self._clock()
        self.settle(now)
        self.filter, self.timestamps = new, timestamps
        self._resize(given)
        self.sampling = revised_sampling(given.SamplingInterval, publishing)
        self._began, self._tick = now, 0
        if self._held is not None:
            self._stir(self)

    def resend(self) -> None:
        """Publish the last value again (ResendData)."""
        if self.mode == REPORTING and not self.queue and self._last is not None:
            self.queue.append(self._last)
            self._stir(self)

    def notification(self) -> ua.MonitoredItemNotification:
        value = with_timestamps(self.queue.popleft(), self.timestamps, self.asked.AttributeId)
        return ua.MonitoredItemNotification(self.handle, value)

    def close(self) -> None:
        self._source.datachange_callbacks.pop(self, None)


class EventItem(MonitoredItem):
    """Monitors the events of a notifier. If events were left out, a separate event reports that."""

    def __init__(
        self, number: int, stir: Stir, node: ua.NodeId, request: Any, events: EventFilter, overflown: Callable[[], Any]
    ) -> None:
        """`overflown`: function that returns the event which reports that events were left out."""
        super().__init__(number, stir, int(request.MonitoringMode), request.RequestedParameters)
        self.node, self.filter, self._overflown = node, events, overflown
        self.sampling = 0.0
        self._overflow: list[ua.Variant] | None = None

    def revised_size(self, asked: int) -> int:
        return MAX_QUEUE if asked == 0 else min(int(asked), MAX_QUEUE)

    @property
    def is_told(self) -> bool:
        return self.mode == REPORTING and (bool(self.queue) or self._overflow is not None)

    def take(self, event: Any, always: bool = False) -> None:
        """Take a new event. With `always` the filter is ignored."""
        if self.mode == DISABLED or not (always or self.filter.passes(event)):
            return
        self._queue(self.filter.fields(event))

    def _queue(self, fields: list[ua.Variant]) -> None:
        if len(self.queue) >= self.size:
            self._overflow = self.filter.fields(self._overflown())
            if not self.discard_oldest:
                self.queue.pop()
            else:
                self.queue.popleft()
        self.queue.append(fields)
        self._stir(self)

    def set_mode(self, mode: int) -> None:
        if mode == DISABLED:
            self._overflow = None
        super().set_mode(mode)

    def modify(self, given: Any, new: EventFilter) -> None:
        self.filter = new
        self._resize(given)

    def notification(self) -> ua.EventFieldList:
        first = self._overflow is not None and (self.discard_oldest or not self.queue)
        if first:
            fields, self._overflow = self._overflow, None
        else:
            fields = self.queue.popleft()
        return ua.EventFieldList(self.handle, fields)


def revised_sampling(asked: float, publishing: float) -> float:
    """Return the revised sampling interval in ms. A negative request means the publishing interval."""
    if asked < 0:
        return publishing
    return min(asked, LONGEST_INTERVAL) if isfinite(asked) else LONGEST_INTERVAL if asked > 0 else 0.0


def _overflown(value: ua.DataValue) -> ua.DataValue:
    code = value.StatusCode.value if value.StatusCode is not None else 0
    return ua.DataValue(value.Value, ua.StatusCode(code | OVERFLOW), value.SourceTimestamp, value.ServerTimestamp)
