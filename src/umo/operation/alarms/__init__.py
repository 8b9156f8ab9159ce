"""Alarms after ISA-18.2 and IEC 62682: declared on compounds with the class keyword `alarms`."""

from umo.operation.alarms.alarm_states import AlarmState, Operation
from umo.operation.alarms.collecting import DeclaredAlarm, alarms_of
from umo.operation.alarms.declaration import Alarm, Bad, High, In, Low, Priority
from umo.operation.alarms.engine import AlarmEngine

__all__ = [
    "Alarm",
    "AlarmEngine",
    "AlarmState",
    "Bad",
    "DeclaredAlarm",
    "High",
    "In",
    "Low",
    "Operation",
    "Priority",
    "alarms_of",
]
