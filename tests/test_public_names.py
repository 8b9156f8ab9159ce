"""The exported names are pinned: a change here is a change for every user."""

from __future__ import annotations

import importlib
import inspect
import re

import pytest

import umo
from umo import errors

STATES = {"CompleteIncomplete", "EnableDisable", "FrontBack", "HighLow", "LeftRight", "OnOff", "OpenClosed", "PassFail",
          "Rotation", "TwoState", "UpDown", "ZeroOne"}  # fmt: skip
OBJECTS = {
    "BinaryActuator",
    "BinarySensor",
    "Compound",
    "DigitalActuator",
    "DigitalSensor",
    "Interlock",
    "Polynomial",
    "Quality",
    "Range",
    "LookupTable",
    "Thermocouple",
    "Vector",
    "action",
} | STATES
ERRORS = {
    "AxisError",
    "HomingError",
    "DeviceHeld",
    "BadInput",
    "Busy",
    "Cancelled",
    "ChannelError",
    "ChannelsFailed",
    "CommandRefused",
    "LeaseHeld",
    "DeclarationError",
    "DeviceTimeout",
    "DriverError",
    "Failure",
    "Fault",
    "FramesError",
    "Interlocked",
    "NotConnected",
    "OptionError",
    "PathError",
    "RangeError",
    "StandsStopped",
    "StateError",
    "StopError",
    "TaskFailed",
    "TimeExpired",
    "UmoError",
    "WiringError",
}

NAMES = {
    "umo": OBJECTS
    | ERRORS
    | {
        "Channel",
        "Direction",
        "Driver",
        "Frame",
        "attach",
        "check",
        "connect",
        "drive",
        "published",
        "run",
        "start",
        "RunFailed",
        "Started",
    },
    "umo.objects": OBJECTS | {"Action", "Atomic", "Binary", "Digital", "Node", "Tunable", "actions_of", "tunables_of"},
    "umo.drivers": {"Channel", "Direction", "Driver", "IntArray"},
    "umo.wiring": {"Parameter", "Process", "Wire", "Wired", "check", "driver_options", "resolve", "share"},
    "umo.cycle": {"Frame", "Observer", "connect", "drive", "run"},
    "umo.frames": {"Layout", "Reader", "Ring", "Stage", "published", "rings"},
    "umo.remote": {"HeldLease", "LiveView", "RemoteStation", "attach"},
    "umo.process": {"RunFailed", "Started", "start"},
    "umo.latency": {"Answer", "Samples", "judge", "measure"},
    "umo.testing.conformance": {
        "Certificate",
        "Finding",
        "Input",
        "Judgement",
        "Output",
        "TimePlan",
        "PtyTap",
        "Rule",
        "Subject",
        "Tap",
        "TcpTap",
        "TransferTime",
        "all_rules",
        "conform",
    },
    "umo.testing": {"Call", "Scripted", "VirtualTimer", "periods", "put", "station"},
}


@pytest.mark.parametrize("package", NAMES)
def test_exported_names(package):
    module = importlib.import_module(package)
    assert set(module.__all__) == NAMES[package]
    assert list(module.__all__) == sorted(module.__all__)
    assert all(hasattr(module, name) for name in module.__all__)


def test_sequences_and_inputs_are_exported_by_control():
    from umo import control

    assert {"HOMING", "next_period", "state_of", "together", "until", "value_of", "wait"} <= set(control.__all__)


def test_every_error_is_exported():
    defined = {
        name for name, item in vars(errors).items() if inspect.isclass(item) and item.__module__ == errors.__name__
    }
    assert defined == ERRORS


def test_the_hierarchy_drawn_at_the_top_of_errors_is_the_real_one():
    parents, left = ["UmoError"], set(ERRORS)
    for depth, name, beside in re.findall(r"^((?:\|   )*)[|`]-- (\w+)(?: \((\w+)\))?", errors.__doc__ or "", re.M):
        del parents[1 + len(depth) // 4 :]
        bases = [base.__name__ for base in getattr(errors, name).__bases__]
        assert bases == [parents[-1], *([beside] if beside else [])]
        parents.append(name)
        left.discard(name)
    assert {"UmoError", "Cancelled", "Failure", "Fault"} == left
    assert issubclass(umo.Cancelled, BaseException) and not issubclass(umo.Cancelled, Exception)
