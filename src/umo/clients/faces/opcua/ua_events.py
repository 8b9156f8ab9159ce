"""Events of the machine, and its alarms as conditions, for clients that subscribe to events (OPC 10000-9).

asyncua has no condition instances: an alarm is an object with its state and its methods, and each change of its state
is an event of AlarmConditionType. By ConditionRefresh a client gets that event again as long as the alarm is retained.
"""

from __future__ import annotations

import copy
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from asyncua import Node, ua
from asyncua.common import events as ua_templates

from umo.clients.faces.opcua.ua_machine import MachineNodes
from umo.clients.faces.opcua.ua_tree import O
from umo.clients.faces.opcua.ua_values import moment
from umo.cycle.events import ALARM, FAULT, CommandState, Event
from umo.operation.alarms.alarm_states import ACTIVE, BAD_STATES, PUT_AWAY, TO_BE_ACKNOWLEDGED, AlarmState
from umo.process.frames.machine_items import MachineItem

SEVERITY: Mapping[str, int] = {"low": 200, "medium": 400, "high": 600, "critical": 900}
"""Severities of alarms by their priorities."""
EVENT_SEVERITY: Mapping[CommandState, int] = {CommandState.REFUSED: 300, CommandState.FAILED: 500}
NORMAL_EVENT, FAULT_EVENT = 100, 700
LATCHED = (AlarmState.LATCHED_UNACKNOWLEDGED, AlarmState.LATCHED_ACKNOWLEDGED)
ACKNOWLEDGE = ua.NodeId(O.AcknowledgeableConditionType_Acknowledge)
"""The method of the standard, which clients call with the object of the condition."""


@dataclass(frozen=True)
class Kinds:
    """One event of each type, as a template that is copied."""

    plain: Any
    alarm: Any

    @classmethod
    async def of(cls, server: Any) -> Kinds:
        found = []
        for kind in (O.BaseEventType, O.AlarmConditionType):
            node = Node(server.iserver.isession, ua.NodeId(kind))
            found.append(await ua_templates.get_event_obj_from_type_node(node))
        found[1].add_property("NodeId", None, ua.VariantType.NodeId)
        notifier = Node(server.iserver.isession, ua.NodeId(O.Server))
        await notifier.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        return cls(*found)


class MachineEvents:
    """Reports one machine's events to the clients of a server."""

    def __init__(self, server: Any, kinds: Kinds, nodes: MachineNodes) -> None:
        self._monitoring = server.iserver.monitoring
        self._kinds, self._nodes = kinds, nodes
        self._states: dict[str, AlarmState] = {}
        self._ids: dict[str, bytes] = {}
        """The last event of each alarm, which a client acknowledges."""

    def alarm(self, item: MachineItem, number: float, utc: float) -> None:
        """Report the state of an alarm. An alarm's first state is reported only if it is not normal."""
        state, before = AlarmState(int(number)), self._states.get(item.path, AlarmState.NORMAL)
        if state is before:
            return
        self._states[item.path] = state
        event = copy.copy(self._kinds.alarm)
        node = self._nodes.alarms[item.path]
        acked = state not in TO_BE_ACKNOWLEDGED
        fields: dict[str, Any] = {
            "NodeId": node,
            "ConditionName": item.path,
            "ConditionClassId": ua.NodeId(O.ProcessConditionClassType),
            "ConditionClassName": ua.LocalizedText("ProcessConditionClassType"),
            "Retain": not (state is AlarmState.NORMAL or state in PUT_AWAY),
            "Quality": ua.StatusCode(ua.StatusCodes.BadNoData if state in BAD_STATES else ua.StatusCodes.Good),
            "SuppressedOrShelved": state in PUT_AWAY,
            "EnabledState": ua.LocalizedText("Enabled"),
            "EnabledState/Id": True,
            "ActiveState": ua.LocalizedText("Active" if state in ACTIVE else "Inactive"),
            "ActiveState/Id": state in ACTIVE,
            "AckedState": ua.LocalizedText("Acknowledged" if acked else "Unacknowledged"),
            "AckedState/Id": acked,
            "LatchedState": ua.LocalizedText("Latched" if state in LATCHED else "Unlatched"),
            "LatchedState/Id": state in LATCHED,
            "Comment": ua.LocalizedText(str(state)),
        }
        for name, value in fields.items():
            setattr(event, name, value)
        severity = SEVERITY.get(str(item.about.get("priority")), SEVERITY["medium"])
        text = f"{item.about.get('text') or item.path}: {state}"
        self._ids[item.path] = self._send(event, item.path, node, text, severity, utc)

    def event(self, event: Event, utc: float) -> None:
        """Report an event of the machine. Events of alarms are reported as conditions."""
        if event.asked == ALARM:
            return
        severity = FAULT_EVENT if event.asked == FAULT else EVENT_SEVERITY.get(event.state, NORMAL_EVENT)
        words = [event.who, event.asked, "" if event.state is CommandState.NONE else str(event.state), event.text]
        text = ": ".join(each for each in words if each)
        self.tell(event.path, text, severity, utc)

    def tell(self, path: str, text: str, severity: int, utc: float | None = None) -> None:
        node = self._nodes.by_path.get(path, self._nodes.root)
        self._send(copy.copy(self._kinds.plain), path, node, text, severity, time.time() if utc is None else utc)

    def _send(self, event: Any, path: str, node: ua.NodeId, text: str, severity: int, utc: float) -> bytes:
        event.EventId = uuid.uuid4().bytes
        event.Time, event.ReceiveTime = moment(utc), moment(time.time())
        event.SourceNode, event.SourceName = node, path
        event.Message, event.Severity = ua.LocalizedText(text), severity
        self._monitoring.tell(event)
        return bytes(event.EventId)

    def is_last(self, path: str, event_id: object) -> bool:
        """True if this is the last event of the alarm. A client cannot acknowledge an alarm whose last event it has not
        seen."""
        return self._ids.get(path) == event_id

    def end(self, why: str) -> None:
        """Called when the run is over: no alarm is active any more."""
        retained = self._monitoring.retained
        for path, node in self._nodes.alarms.items():
            if node in retained:
                event = copy.copy(retained[node])
                event.Retain, event.Quality = False, ua.StatusCode(ua.StatusCodes.BadNoCommunication)
                self._send(event, path, node, why, event.Severity, time.time())
        self.tell("", why, NORMAL_EVENT)
