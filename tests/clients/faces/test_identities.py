"""Identities on faces: unique and constant, whatever letters a name has."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import combinations
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from asyncua import ua
from hypothesis import example, given, settings
from hypothesis import strategies as st
from prometheus_client import generate_latest

from umo.clients.faces.epics.epics_variables import EpicsVariables, variables_of
from umo.clients.faces.face import Changes
from umo.clients.faces.mqtt.home_assistant_discovery import TOPICS, device_of, discovery, former_topics, value_topic
from umo.clients.faces.mqtt.sparkplug_node import SparkplugNode
from umo.clients.faces.opcua import ua_machinery as machinery
from umo.clients.faces.opcua.ua_machine import MachineNodes
from umo.clients.faces.opcua.ua_machinery import add_identification
from umo.clients.faces.prometheus import Metrics
from umo.clients.fleet.fleet_keys import is_station_key, segment
from umo.objects.presentation.identity import escaped, is_text, is_topic, is_word, unescaped
from umo.process.frames.machine_items import Declaration, ItemKind, MachineItem

Thing = tuple[str, str]
"""Kind ("action": an action) and path."""
NEAR = ("a", "b", "_", "__", "-", "/", " ", ":", "+", "#", "%", "ä", "ö", "a\u0308", "ﬁ", "0", "1", "é", "_x00E4_", "x")
WORDS = (
    "run", "mode", "alarm", "axis", "equipment", "clear", "acknowledge_alarm", "shelve", "PVI", "event",
    "bdSeq", "machine", "refusal",
    "stop", "target", "log", "log_", "EURange", "", "Status", "5", "__5", "5a", "State", "Run", "Alarms", "Stop",
    "Mode", "LastRefusal", "EquipmentState", "AxisState", "PackML", "Identification", "Run_", "a/shown",
)  # fmt: skip
"""What looks like an escape, like another name, or like a name that a face has for itself."""
few = settings(max_examples=40)
printable = st.characters(blacklist_categories=("C", "Z"), blacklist_characters=".") | st.just(" ")
near = st.lists(st.sampled_from(NEAR), min_size=1, max_size=3).map("".join)
part = (
    st.lists(st.sampled_from(NEAR), min_size=1, max_size=3).map("".join) | st.sampled_from(WORDS) | st.text(printable)
)
first = part.filter(str.isidentifier)
path = st.tuples(first, st.lists(part, max_size=2)).map(lambda each: ".".join((each[0], *each[1])))
KINDS = [each.value for each in ItemKind if each is not ItemKind.RUN]
thing = st.tuples(st.sampled_from([*KINDS, "action"]), path)


def machine_of(things: Iterable[Thing], station: str = "plant") -> Declaration:
    """A declaration with these; an axis has its state and its encoder."""
    found = sorted((each for each in things if each[0] != "action"), key=lambda each: KINDS.index(each[0]))
    run = ("mode", "periods", "missed", "execution", "wake")
    items = [MachineItem(n, ItemKind(kind), path, {}) for n, (kind, path) in enumerate(found)]
    items += [MachineItem(len(items) + n, ItemKind.RUN, path, {}) for n, path in enumerate(run)]
    actions = tuple({"path": p, "help": "", "arguments": [], "dead_man": False} for k, p in things if k == "action")
    return Declaration(station, "", "1-1", 0.01, 0.0, tuple(items), actions, (), (), True)


class Nodes:
    """In place of a NodeTree of OPC UA: notes the identifiers, and the names by which each is found from the top."""

    def __init__(self) -> None:
        self.made: list[str] = []
        self.ways: dict[str, tuple[tuple[int, str], ...]] = {}

    def object(self, parent: Any, text: str, name: str, *more: Any, own: int = 1, **about: Any) -> ua.NodeId:
        self.made.append(text)
        self.ways[text] = (*self.ways.get(str(parent.Identifier), ()), (own, name))
        return ua.NodeId(text, 1)

    variable = property = object

    def method(self, parent: Any, text: str, name: str, given: Any, returned: Any = (), **more: Any) -> ua.NodeId:
        self.made += [
            f"{text}/{each}" for each, there in (("InputArguments", given), ("OutputArguments", returned)) if there
        ]
        return self.object(parent, text, name, **more)

    def refer(self, *more: Any) -> None: ...

    def value_of(self, node: ua.NodeId) -> Any:
        return None


def opcua_nodes(machine: Declaration) -> Nodes:
    tree: Any = Nodes()
    nodes = MachineNodes(tree, machine, ua.NodeId("machines", 1))
    add_identification(tree, nodes.root, {machinery.URI: 2, machinery.DEVICES: 3}, {"Model": "plant"})
    return cast(Nodes, tree)


def opcua(machine: Declaration) -> list[str]:
    return [each for each in opcua_nodes(machine).made if not each.startswith("part:")]


def epics_variables(machine: Declaration) -> EpicsVariables:
    async def ask(*given: Any, **more: Any) -> None: ...

    commands: Any = SimpleNamespace(ask=ask)
    return variables_of(machine, "plant:", commands)


def epics(machine: Declaration) -> list[str]:
    return list(epics_variables(machine).by_name)


def epics_tree(machine: Declaration) -> dict[str, str]:
    """The variable of each entry of the tree, by the names of its devices."""
    variables = epics_variables(machine)
    variables.add_tree()
    found, waiting = {}, [("plant:PVI", "")]
    while waiting:
        name, above = waiting.pop()
        for entry, what in variables.by_name[name].value["value"].todict().items():
            if "d" in what:
                waiting.append((what["d"], f"{above}.{entry}"))
            else:
                (found[f"{above}.{entry}"],) = what.values()
    return found


def home_assistant(machine: Declaration) -> list[str]:
    found = discovery(machine, "umo/plant", "homeassistant")
    return [*found, *(each["unique_id"] for each in found.values())]


def topics(machine: Declaration) -> list[str]:
    return [value_topic("umo/plant", each) for each in machine.items]


def orders(machine: Declaration) -> list[str]:
    return [each["command_topic"] for each in discovery(machine, "umo", "x").values() if "command_topic" in each]


def sparkplug(machine: Declaration) -> list[str]:
    node = SparkplugNode(machine, 0)
    own = ["bdSeq", "event", "Node Control/Rebirth", "Node Info/Station"]
    return [*own, *node._names, *node.actions]


FACES: dict[str, Callable[[Declaration], list[str]]] = {
    each.__name__: each for each in (opcua, epics, home_assistant, topics, orders, sparkplug)
}


def are_one(one: Thing, other: Thing) -> bool:
    """Whether a machine cannot have both: a path has one object, signal, tunable number (which is shown), action or
    part; nothing but alarms is below the first four."""
    (near, above), (far, below) = sorted((one, other), key=lambda each: len(each[1]))
    kinds, parts = {near, far}, {"equipment", "axis"}
    if one == other or "alarm" in kinds:
        return one == other
    return (above == below and kinds != parts) or (near not in parts and f"{below}.".startswith(f"{above}."))


@pytest.mark.parametrize("face", FACES)
@few
@given(thing, thing)
def test_two_things_never_have_one_identity_and_none_depends_on_another(face: str, one: Thing, other: Thing) -> None:
    if are_one(one, other):
        return
    told = FACES[face]
    nothing, alone, beside = (told(machine_of(each)) for each in ((), (one,), (other,)))
    both = told(machine_of((one, other)))
    assert len(set(both)) == len(both) == len(alone) + len(beside) - len(nothing)
    assert set(both) == set(alone) | set(beside)
    assert set(alone) & set(beside) == set(nothing)
    assert set(told(machine_of((other, one)))) == set(both)


def is_legal(one: Thing, other: Thing) -> bool:
    """Whether a machine may have both: beside what is not one, a tunable number that is shown or kept too, and numbers
    of an object (its velocity)."""
    (near, above), (far, below) = sorted((one, other), key=lambda each: len(each[1]))
    numbers = {"signal", "tunable"}
    is_twin = above == below and {near, far} == numbers
    is_of_object = above != below and far in numbers and near not in {"equipment", "axis", "alarm", "action"}
    return is_twin or is_of_object or not are_one(one, other)


def browse_names(things: Iterable[Thing]) -> dict[str, tuple[tuple[int, str], ...]]:
    """The names from the machine on by which OPC UA finds each node."""
    return opcua_nodes(machine_of(things)).ways


@settings(max_examples=60)
@given(st.lists(thing, min_size=1, max_size=3))
@example([("sensor", "Run.mode")])
@example([("signal", "Stop"), ("equipment", "Alarms"), ("action", "cell.PackML")])
@example([("signal", "gain"), ("tunable", "gain"), ("action", "Clear")])
@example([("sensor", "encoder"), ("signal", "encoder.velocity"), ("action", "Mode")])
def test_nodes_of_opc_ua_have_names_that_are_unique_constant_and_of_no_order(things: list[Thing]) -> None:
    if not all(is_legal(one, other) for one, other in combinations(things, 2)):
        return
    together = browse_names(things)
    assert len(set(together.values())) == len(together)
    assert browse_names(things[::-1]) == together
    for kind, path in things:
        if ({"signal": "tunable", "tunable": "signal"}.get(kind), path) not in things:
            alone = browse_names([(kind, path)])
            assert {node: together[node] for node in alone if node in together} | alone == alone


@few
@given(thing, thing)
def test_an_entry_of_the_tree_of_epics_never_becomes_that_of_another(one: Thing, other: Thing) -> None:
    if are_one(one, other):
        return
    machine = machine_of((one, other))
    both = epics_tree(machine)
    assert sorted(both.values()) == sorted(each for each in epics(machine) if not each.endswith("PVI"))
    for before in (epics_tree(machine_of((one,))), epics_tree(machine_of((other,)))):
        assert {place: before[place] for place in before if place in both}.items() <= both.items()


@few
@given(near, st.text(max_size=8), st.sampled_from([is_word, is_text, is_topic]))
def test_an_escape_can_be_undone(one: str, other: str, kept: Callable[[str], bool]) -> None:
    for text in (one, other, f"{one}_x00E4_{other}", f"{one}_x004{other}"):
        assert unescaped(escaped(text, kept)) == text.replace("\0", "")
        assert all(kept(each) for each in escaped(text, kept))


@few
@given(path, path)
def test_a_path_comes_back_from_its_topic(one: str, other: str) -> None:
    assert (TOPICS.of(one) == TOPICS.of(other)) == (one == other)
    assert TOPICS.path(TOPICS.of(one)) == one


def test_the_topics_of_umo_02_at_the_broker_are_those_that_home_assistant_is_told_to_forget() -> None:
    things = [("sensor", "zone.a_b"), ("sensor", "zone_a.b"), ("tunable", "z.gain"), ("action", "z.go")]
    machine = machine_of(things, "press 2")
    run = [f"sensor/umo_press_2/run_{each}" for each in ("mode", "periods", "missed", "execution", "wake")]
    former = [f"sensor/umo_press_2/{each}" for each in ("zone_a_b", "zone_a_b_")]
    former += [
        "number/umo_press_2/tunable_z_gain",
        *run,
        "button/umo_press_2/action_z_go",
        "sensor/umo_press_2/refusal",
    ]
    assert former_topics(machine, "ha") == [f"ha/{each}/config" for each in former]
    assert not set(former_topics(machine, "ha")) & set(discovery(machine, "umo", "ha"))


station = st.text(st.characters(blacklist_characters="/\0"), min_size=1, max_size=255) | part.filter(bool)


@few
@given(station, station)
def test_two_stations_never_have_one_identity(one: str, other: str) -> None:
    for name in (one, other):
        assert is_station_key(f"cell7/{segment(name)}")
    if one != other:
        assert segment(one) != segment(other)
        ours, theirs = (
            set(home_assistant(machine_of([("sensor", "b_c"), ("sensor", "c")], each))) for each in (one, other)
        )
        assert not ours & theirs
        assert device_of(one) != device_of(other) and escaped(one, is_topic) != escaped(other, is_topic)


@few
@example("x" * 100)
@given(st.text("ab.ä_", min_size=65, max_size=100))
def test_the_identity_of_a_long_name_is_that_of_no_other_name(name: str) -> None:
    """A station may have the name that the identity of another one is."""
    known = [name]
    for _ in range(3):
        known.append(segment(known[-1]))
        assert is_station_key(f"cell7/{known[-1]}")
    assert len(set(known)) == len(known)


@pytest.mark.parametrize("name", ["press", "press-2", "press.2", "Press_2", "x" * 64])
def test_what_a_key_may_have_stays(name: str) -> None:
    assert segment(name) == name


@few
@given(st.lists(thing, max_size=4, unique=True))
def test_prometheus_has_every_series_once(things: list[Thing]) -> None:
    metrics = Metrics()
    metrics.machine = machine_of(things)
    count = len(metrics.machine.items)
    metrics.changes = Changes(1, 0.0, None, np.arange(count), np.ones(count), np.zeros(count, np.uint8), np.ones(count))
    lines = [each.rpartition(" ")[0] for each in generate_latest(metrics).decode().splitlines() if each[0] != "#"]
    assert len(set(lines)) == len(lines)
