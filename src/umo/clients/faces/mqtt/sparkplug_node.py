"""The messages of a station as an edge node of Sparkplug B: birth, data, death."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite, isnan
from typing import Any

from umo.clients.faces.face import Changes
from umo.clients.faces.mqtt.sparkplug_payload import (
    BAD,
    DOUBLE,
    GOOD,
    STALE,
    STRING,
    Payload,
    put_property,
    put_value,
)
from umo.objects import Quality
from umo.objects.presentation.identity import Identities, is_text
from umo.operation.commands.verbs import offered
from umo.process.frames.machine_items import Declaration, MachineItem
from umo.process.frames.run_reader import NumberedEvent

REBIRTH = "Node Control/Rebirth"
REFUSAL, DONE = "Node Control/Refusal", "Node Control/Done"
"""Metrics with the answers to commands."""
DROPPED = "Node Info/Dropped"
EVENT, BD_SEQ = "event", "bdSeq"
METRICS = Identities("/", ":", is_text, frozenset({EVENT, BD_SEQ}))
"""Names of metrics: `tunable:cell.gain` is `tunable:cell/gain`; hosts show a slash as a folder."""
ACTION = "action"
"""The kind of a metric that calls an action. The metric's value is the last result of the action."""
VERB = "verb"
"""The kind of a metric that gives a verb. Clients write a JSON object with the path and the arguments to the metric."""
QUALITY = "Quality"
QUALITIES = {Quality.GOOD: GOOD, Quality.STALE: STALE}
"""The qualities of Sparkplug, which has only three. All qualities of umo that are not listed here become BAD. The
property `quality` has umo's name."""


def milliseconds(utc: float) -> int:
    return max(0, int(utc * 1000))


class SparkplugNode:
    """Makes payloads. `bd_seq` numbers the connections, `seq` the messages of one connection."""

    def __init__(self, machine: Declaration, bd_seq: int) -> None:
        self.machine = machine
        self.bd_seq = bd_seq
        self._names = [item.identity(METRICS) for item in machine.items]
        self.by_metric: Mapping[str, MachineItem] = dict(zip(self._names, machine.items, strict=True))
        self.actions = {METRICS.of(str(each["path"]), ACTION): each for each in machine.actions}
        self.verbs = {METRICS.of(verb.word, VERB): verb for verb in offered()}
        self._told = [-1] * len(machine.items)
        """The last published quality of each item."""
        self._seq = 0

    def name_of(self, metric: Any) -> str:
        """Return the name of a metric that a client has sent. The metric may have only an alias."""
        alias = int(metric.alias)
        return self._names[alias - 1] if not metric.name and 0 < alias <= len(self._names) else str(metric.name)

    def death(self) -> bytes:
        payload = _payload()
        put_value(payload.metrics.add(name=BD_SEQ, timestamp=payload.timestamp), self.bd_seq)
        return bytes(payload.SerializeToString())

    def birth(self, changes: Changes, dropped: int) -> bytes:
        """Return every metric with its properties and its present value."""
        payload, machine = _payload(), self.machine
        self._seq = 0
        own: Mapping[str, Any] = {
            BD_SEQ: self.bd_seq, REBIRTH: False, "Node Info/Station": machine.station,
            "Node Info/Wiring": machine.wiring, "Node Info/Run": machine.run, DROPPED: dropped,
            REFUSAL: None, DONE: None, EVENT: None, **dict.fromkeys((*self.actions, *self.verbs)),
        }  # fmt: skip
        for name, value in own.items():
            put_value(payload.metrics.add(name=name, timestamp=payload.timestamp), value)
        self._told = [-1] * len(machine.items)
        self._put_changes(payload, changes, range(len(machine.items)))
        for item, metric in zip(machine.items, payload.metrics[len(own) :], strict=True):
            metric.name = self._names[item.number]
            _describe(item, metric)
        return self.numbered(payload)

    def data(self, changes: Changes) -> Any:
        """Return a payload with the changes. It has no sequence number yet."""
        payload = _payload()
        self._put_changes(payload, changes, changes.places.tolist())
        return payload

    def events(self, events: Iterable[NumberedEvent]) -> Any:
        """Return a payload with a metric for each event, as JSON."""
        payload = _payload()
        for number, event in events:
            told = {"number": number, "path": event.path, "text": event.text, "who": event.who, "asked": event.asked}
            metric = payload.metrics.add(name=EVENT, timestamp=payload.timestamp)
            put_value(metric, json.dumps(told | {"state": event.state.name.lower()}))
        return payload

    def one(self, name: str, value: Any, properties: Mapping[str, str]) -> Any:
        payload = _payload()
        metric = payload.metrics.add(name=name, timestamp=payload.timestamp)
        put_value(metric, value)
        for key, text in properties.items():
            put_property(metric, key, text)
        return payload

    def historical(self, metrics: Iterable[Any]) -> Any:
        payload = _payload()
        payload.metrics.extend(metrics)
        return payload

    def numbered(self, payload: Any) -> bytes:
        """Return a payload, with the next sequence number, as bytes."""
        payload.seq = self._seq
        self._seq = (self._seq + 1) % 256
        return bytes(payload.SerializeToString())

    def _put_changes(self, payload: Any, changes: Changes, places: Sequence[int]) -> None:
        values, times, told = changes.values.tolist(), changes.times.tolist(), self._told
        qualities, items, add = changes.quality.tolist(), self.machine.items, payload.metrics.add
        for place in places:
            at, quality, states = times[place], qualities[place], items[place].states
            metric = add(alias=place + 1, timestamp=milliseconds(changes.utc if isnan(at) else at))
            value = values[place]
            state = items[place].state_of(value) if states else None
            if isnan(value) or quality == Quality.BAD or (states and state is None):
                metric.is_null, metric.datatype = True, STRING if states else DOUBLE
            elif states:
                metric.datatype, metric.string_value = STRING, state
            else:
                metric.datatype, metric.double_value = DOUBLE, value
            if quality or quality != told[place]:
                told[place] = quality
                put_property(metric, QUALITY, QUALITIES.get(Quality(quality), BAD))
                put_property(metric, "quality", str(Quality(quality)))


def _payload() -> Any:
    return Payload(timestamp=milliseconds(time.time()))


def _describe(item: MachineItem, metric: Any) -> None:
    """Add unit, range and states of an item to a metric, as properties."""
    if item.look:
        put_property(metric, "engUnit", item.look)
    for key, limit in (("engLow", item.minimum), ("engHigh", item.maximum)):
        if limit is not None and isfinite(limit):
            put_property(metric, key, float(limit))
    if item.states:
        put_property(metric, "states", {str(number): name for number, name in item.states.items()})
    if item.verb is None:
        put_property(metric, "readOnly", True)
