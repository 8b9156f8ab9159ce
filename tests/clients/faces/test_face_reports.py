"""What users of other projects have reported of faces (docs/field-reports.md), tried with umo's."""

from __future__ import annotations

import numpy as np
import pytest
from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from umo.clients.faces.face import Changes
from umo.clients.faces.mqtt.sparkplug_node import SparkplugNode
from umo.clients.faces.mqtt.sparkplug_payload import Payload
from umo.clients.faces.prometheus import Metrics
from umo.process.frames.machine_items import RUN_ITEMS, Declaration, ItemKind, MachineItem

ITEM = MachineItem(0, ItemKind.SENSOR, "level", {}, "mm")
COUNT = 1 + len(RUN_ITEMS)
NOW = Changes(1, 1e9, None, np.arange(COUNT), np.ones(COUNT), np.zeros(COUNT, np.uint8), np.full(COUNT, 1e9))


def machine_of(item: MachineItem, station: str = "plant") -> Declaration:
    run = [MachineItem(1 + n, ItemKind.RUN, path, {}) for n, path in enumerate(RUN_ITEMS)]
    return Declaration(station, "", "1-1", 0.01, 0.0, (item, *run), (), (), (), False)


@pytest.mark.parametrize("name", ['Pro 14" R/W', "back\\slash", "two\nlines", "line\u2028separator", "größe", "\t"])
def test_a_name_with_any_letters_leaves_a_scrape_whole(name: str) -> None:
    metrics = Metrics()
    metrics.machine, metrics.changes = machine_of(MachineItem(0, ItemKind.SENSOR, f"zones.{name}", {}), name), NOW
    families = list(text_string_to_metric_families(generate_latest(metrics).decode()))
    labels = [sample.labels for family in families for sample in family.samples if family.name == "umo_value"]
    assert [(each["station"], each["path"]) for each in labels] == [(name, f"zones.{name}")]


def test_bd_seq_stands_in_birth_and_death_only_and_a_death_has_no_number() -> None:
    node = SparkplugNode(machine_of(ITEM), 7)
    birth, data, death = Payload(), Payload(), Payload()
    birth.ParseFromString(node.birth(NOW, 0))
    data.ParseFromString(node.numbered(node.data(NOW)))
    death.ParseFromString(node.death())
    has = [any(each.name == "bdSeq" for each in message.metrics) for message in (birth, data, death)]
    assert has == [True, False, True]
    assert (birth.seq, data.seq, death.HasField("seq")) == (0, 1, False)
    birth.ParseFromString(node.birth(NOW, 0))
    assert birth.seq == 0


@pytest.mark.parametrize("names", [{0: "OFF", 1: "OFF"}, {0: "a", 1: "b", 2: "a"}])
def test_two_states_of_one_name_are_one_series(names: dict[int, str]) -> None:
    metrics = Metrics()
    metrics.machine = machine_of(MachineItem(0, ItemKind.SENSOR, "door", {}, states=names))
    metrics.changes = NOW
    lines = [each.rpartition(" ")[0] for each in generate_latest(metrics).decode().splitlines() if each[0] != "#"]
    assert len(set(lines)) == len(lines)
