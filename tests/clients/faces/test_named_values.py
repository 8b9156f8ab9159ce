"""A value is told as one of its named states only if it is that state: on every face, for any numbers and names."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import struct_from_binary, struct_to_binary
from hypothesis import example, given, settings
from hypothesis import strategies as st

from helpers.home_assistant import rendered
from umo.clients.faces.face import Changes
from umo.clients.faces.mqtt.home_assistant_discovery import discovery, told
from umo.clients.faces.mqtt.sparkplug_node import SparkplugNode
from umo.clients.faces.opcua.ua_tree import enum_values
from umo.clients.faces.opcua.ua_values import data_value, state_text, type_of
from umo.clients.faces.prometheus import Metrics
from umo.objects import Quality
from umo.process.frames.machine_items import RUN_ITEMS, Declaration, ItemKind, MachineItem

INVALID = 3
WHOLE = st.one_of(
    st.integers(-3, 9), st.sampled_from((1 << 31, -(1 << 31), 1 << 53, 1 << 63, 1 << 70, (1 << 31) - 1))
)  # fmt: skip
NAMES = st.one_of(st.sampled_from(("off", "on", "0", "1", "1.5", "7", "inf", "none")), st.text("ab7.", min_size=1))
USUAL = ({0: "off", 1: "on"}, {0: "idle", 1: "filling", 2: "hot"})
STATES = st.one_of(st.sampled_from(USUAL), st.dictionaries(WHOLE, NAMES, min_size=1))
VALUES = st.one_of(
    WHOLE.map(float), st.sampled_from((0.5, 1.5, 2.0, -0.5, float("inf"), float("-inf"), float("nan"))), st.floats()
)  # fmt: skip
QUALITIES = st.sampled_from([each for each in Quality if each is not Quality.BAD])
NO_STATE = None


def machine_of(item: MachineItem) -> Declaration:
    run = [MachineItem(n, ItemKind.RUN, path, {}) for n, path in enumerate(RUN_ITEMS, 1)]
    return Declaration("plant", "", "1-1", 0.01, 0.0, (item, *run), (), (), (), True)


def opcua(item: MachineItem, changes: Changes) -> str | None:
    value = struct_from_binary(ua.DataValue, Buffer(struct_to_binary(data_value(item, changes))))
    text = state_text(item, value).Value.Value.Text
    struct_to_binary(ua.DataValue(enum_values(item.states)))
    if value.Value is None or value.Value.Value is None:
        assert value.StatusCode.is_bad() and not text
        return NO_STATE
    assert value.Value.VariantType == type_of(item)
    name = item.states[int(value.Value.Value)]
    assert text == name
    return name


def epics(item: MachineItem, changes: Changes) -> str | None:
    from umo.clients.faces.epics.epics_variables import variables_of

    async def ask(*given: Any, **more: Any) -> None: ...

    commands: Any = SimpleNamespace(ask=ask)
    variables = variables_of(machine_of(item), "plant:", commands)
    channel = variables.by_name["plant:cell:step"].add_channel(None)
    variables.show(changes_of(float(next(iter(item.states))), Quality.GOOD))
    variables.show(changes)
    shown = channel.current()
    if shown["alarm.severity"] == INVALID:
        return NO_STATE
    return str(shown["value.choices"][shown["value.index"]])


def home_assistant(item: MachineItem, changes: Changes) -> str | None:
    found = discovery(machine_of(item), "b", "p").values()
    (template,) = (each["value_template"] for each in found if each["name"] == item.name)
    state = rendered(template, told(item, changes).decode())
    return NO_STATE if state == "None" else state


def sparkplug(item: MachineItem, changes: Changes) -> str | None:
    (metric,) = SparkplugNode(machine_of(item), 0).data(changes).metrics
    return NO_STATE if metric.is_null else str(metric.string_value)


def prometheus(item: MachineItem, changes: Changes) -> str | None:
    metrics = Metrics()
    metrics.machine, metrics.changes = machine_of(item), changes
    (states,) = (each.samples for each in metrics.collect() if each.name == "umo_state")
    names = [each.labels["state"] for each in states if each.labels["path"] == item.path and each.value]
    assert len(names) <= 1
    return names[0] if names else NO_STATE


FACES: dict[str, Callable[[MachineItem, Changes], str | None]] = {
    each.__name__: each for each in (opcua, epics, home_assistant, sparkplug, prometheus)
}


def changes_of(value: float, quality: Quality) -> Changes:
    count = 1 + len(RUN_ITEMS)
    values, qualities = np.ones(count), np.zeros(count, np.uint8)
    values[0], qualities[0] = value, quality
    return Changes(1, 1e9, None, np.arange(1), values, qualities, np.full(count, 1e9))


@pytest.mark.smoke
@pytest.mark.parametrize("face", FACES)
@settings(max_examples=60, deadline=None, database=None, derandomize=True)
@example({0: "idle", 1: "filling", 2: "heating"}, 1.5, Quality.GOOD, ItemKind.SIGNAL)
@example({0: "off", 1: "on"}, 2.0, Quality.GOOD, ItemKind.SENSOR)
@example({0: "off", 1: "on"}, float("inf"), Quality.GOOD, ItemKind.SENSOR)
@example({0: "7"}, 7.0, Quality.GOOD, ItemKind.SIGNAL)
@example({1 << 31: "far"}, float(1 << 31), Quality.GOOD, ItemKind.SIGNAL)
@given(STATES, VALUES, QUALITIES, st.sampled_from((ItemKind.SENSOR, ItemKind.SIGNAL)))
def test_a_value_is_told_as_a_state_only_if_it_is_that_state(
    face: str, states: dict[int, str], value: float, quality: Quality, kind: ItemKind
) -> None:
    item = MachineItem(0, kind, "cell.step", {"path": "cell.step"}, states=states)
    name = FACES[face](item, changes_of(value, quality))
    if face == "prometheus" and quality > Quality.UNREFERENCED:  # what is stale is left out
        assert name is NO_STATE
    else:
        assert name == next((each for number, each in states.items() if number == value), NO_STATE)
