"""The table of verbs: its form, the page that is made of it, and that a verb is added in one place."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from helpers.verb_ways import WAYS
from tools.count import verb_counts
from tools.verb_page import PAGE, with_table
from umo.clients.faces.conformance import TriedMachine
from umo.cycle.events import CommandState
from umo.errors import RangeError
from umo.operation.alarms import AlarmState
from umo.operation.alarms.alarm_states import SHELVED_STATES, Operation
from umo.operation.commands.client_commands import ClientCommand
from umo.operation.commands.commanded import Commanded, VerbAnswer
from umo.operation.commands.roles import Caller, Roles
from umo.operation.commands.verb import ArgumentKind, Names, Role, Verb, VerbArgument
from umo.operation.commands.verb_table import VerbTable
from umo.operation.commands.verbs import ACKNOWLEDGE_ALARM, VERBS, naming, offered, verb_of
from umo.process.frames.alarm_list import AlarmRow
from umo.process.frames.machine_items import declaration_of
from umo_command.alarm.commands import commands_of_verbs

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


# The form -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", VERBS.values(), ids=lambda verb: verb.word)
def test_a_verb_has_a_name_of_lower_case_words_and_a_sentence(verb: Verb) -> None:
    assert verb.name.replace(" ", "a").islower() and verb.name.replace(" ", "a").isalpha()
    assert verb.help.endswith(".")
    assert verb_of(verb.name) is verb_of(verb.word) is verb_of(verb.name.replace(" ", "-")) is verb


@pytest.mark.parametrize(
    ("argument", "good", "bad"),
    [
        (VerbArgument("n", ArgumentKind.NUMBER, "", "mm", 1.0, 5.0), {1: 1.0, 5.0: 5.0}, [0.9, 5.1, True, "2", None]),
        (VerbArgument("t", ArgumentKind.TIME, "", "s", 1.0), {2: 2.0, "1 min": 60.0}, ["60", "1 x", 0.5, float("nan")]),
        (VerbArgument("c", ArgumentKind.CHOICE, "", choices=("a", "b")), {"a": "a"}, ["A", 1, [], None]),
        (VerbArgument("f", ArgumentKind.FLAG, ""), {True: True, False: False}, [1.0, "true", None]),
    ],
    ids=lambda each: each.kind.name if isinstance(each, VerbArgument) else "",
)
def test_an_argument_takes_what_is_declared_and_nothing_else(
    argument: VerbArgument, good: Mapping[Any, Any], bad: list[Any]
) -> None:
    assert {given: argument.checked(given) for given in good} == good
    for given in bad:
        with pytest.raises(RangeError):
            argument.checked(given)


def test_one_argument_is_the_value_of_a_command_and_several_stand_by_name() -> None:
    one, several = (
        Verb("probe", "It probes.", probed, arguments=tuple(VerbArgument(n, ArgumentKind.FLAG, "") for n in names))
        for names in ("a", "ab")
    )
    assert one.fields({"a": True}) == {"value": True}
    assert several.fields({"a": True, "b": False}) == {"arguments": {"a": True, "b": False}}
    for verb, given in ((one, {"a": True}), (several, {"a": True, "b": False})):
        assert verb.given(ClientCommand(1, **verb.fields(given))) == given
    with pytest.raises(RangeError, match="probe needs b"):
        several.given(ClientCommand(1, **several.fields({"a": True})))
    with pytest.raises(RangeError, match="no argument 'c': it takes a, b"):
        several.given(ClientCommand(1, **several.fields({"a": True, "b": True, "c": True})))


def test_the_page_has_the_table() -> None:
    assert PAGE.read_text("utf-8") == with_table(PAGE.read_text("utf-8")), "run tools/verb_page.py"


def test_no_module_knows_a_verb_by_a_text() -> None:
    assert {where: found for where, found in verb_counts() if found and where.endswith(".py")} == {}


def test_umo_alarm_has_a_command_for_each_verb_of_alarms() -> None:
    assert [verb.help for verb in naming(Names.ALARM)] == [each.help for each in commands_of_verbs().values()]


@pytest.mark.parametrize("state", AlarmState, ids=str)
def test_an_alarm_is_told_with_the_verbs_that_lead_on_from_its_state(state: AlarmState) -> None:
    row = AlarmRow("tank.full", state, None, "", None, "", "")  # type: ignore[arg-type]
    assert ("acknowledge alarm" in row.verbs) == row.asks
    assert ("unshelve" in row.verbs) == (state in SHELVED_STATES)
    assert ("return to service" in row.verbs) == (state is AlarmState.OUT_OF_SERVICE)
    assert ("remove from service" in row.verbs) == (state is not AlarmState.OUT_OF_SERVICE)


def test_each_operation_of_clients_on_alarms_has_a_verb() -> None:
    assert {each.operation for each in naming(Names.ALARM)} == {
        each for each in Operation if each > Operation.CANNOT_EVALUATE
    }


# A verb is added in one place ---------------------------------------------------------------------------


def probed(machine: Commanded, command: ClientCommand, given: Mapping[str, Any]) -> VerbAnswer:
    return CommandState.DONE, str(given.get("depth"))


PROBE = Verb(
    "probe deep", "Tell how deep it was probed.", probed, Names.ALARM, role=Role.TUNE,
    arguments=(VerbArgument("depth", ArgumentKind.NUMBER, "How deep.", "mm", 0.0, 2.0),),
)  # fmt: skip


@pytest.fixture
def probe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Verb:
    """A verb that is nowhere but in the table."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "config" / "umo").mkdir(parents=True)
    (tmp_path / "config" / "umo" / "roles.toml").write_text('[users]\n"*" = "tune"\n[unverified]\n"*" = "tune"\n')
    monkeypatch.setitem(VERBS, PROBE.name, PROBE)
    return PROBE


def tried(step: Callable[[TriedMachine], Any]) -> Any:
    async def work() -> Any:
        async with TriedMachine() as machine:
            return await step(machine)

    return asyncio.run(work())


@linux
@pytest.mark.parametrize("name", WAYS)
def test_a_verb_that_is_only_in_the_table_is_carried_out_by_every_way(probe: Verb, name: str) -> None:
    if name == "fleet":
        pytest.importorskip("zenoh", reason="the extra fleet is not installed")

    async def step(machine: TriedMachine) -> list[str]:
        way = WAYS[name](machine)
        await way.open()
        try:
            if way.takes_lease:
                await way.take()  # type: ignore[attr-defined]
            return [await way.give(probe, "cell.full", depth=depth) for depth in (1.5, 3.0)]
        finally:
            await way.close()

    assert tried(step) == ["done: 1.5", "depth must be a number from 0 to 2 mm, not 3.0"]


@linux
def test_umo_attach_has_it_as_a_method_too(probe: Verb) -> None:
    async def step(machine: TriedMachine) -> tuple[Any, bool, str]:
        way = WAYS["attach"](machine)
        await way.open()
        try:
            await way.take()  # type: ignore[attr-defined]
            station = way.station  # type: ignore[attr-defined]
            found = await asyncio.to_thread(lambda: station.probe_deep("cell.full", depth=0.5))
            return found, "probe_deep" in dir(station), station.verbs._repr_html_()
        finally:
            await way.close()

    found, is_listed, html = tried(step)
    assert (found, is_listed) == (0.5, True)
    assert "<td>probe deep</td>" in html


@linux
def test_every_client_shows_it(probe: Verb) -> None:
    pytest.importorskip("p4p", reason="the extra epics is not installed")
    from umo.clients.faces.epics.epics_variables import variables_of
    from umo.clients.faces.mqtt.sparkplug_node import SparkplugNode
    from umo.clients.page.watched_run import Watched

    async def step(machine: TriedMachine) -> None:
        reader = machine.find()
        declaration = declaration_of(reader)
        commands: Any = SimpleNamespace(ask=None)
        variables = variables_of(declaration, "plant:", commands).by_name
        assert {"plant:run:probe_deep", "plant:cell:full:probe_deep"} <= variables.keys()
        assert "verb:probe_deep" in SparkplugNode(declaration, 0).verbs
        told = Watched(reader).description()["verbs"]
        (argument,) = next(each for each in told if each["name"] == probe.name)["arguments"]
        assert (argument["name"], argument["maximum"], argument["unit"]) == ("depth", 2.0, "mm")
        assert {"ProbeDeep", "alarm ProbeDeep"} <= opcua_methods(declaration)

    tried(step)
    assert probe.name in AlarmRow("a", AlarmState.NORMAL, None, "", None, "", "").verbs  # type: ignore[arg-type]
    assert any(row[0] == probe.name for row in VerbTable(VERBS).rows)  # umo do, notebooks
    assert "| probe deep |" in with_table(PAGE.read_text("utf-8"))
    assert probe in offered()


def opcua_methods(declaration: Any) -> set[str]:
    """The names of the methods of the machine, and of its alarms."""
    from asyncua import ua

    from umo.clients.faces.opcua.ua_machine import MachineNodes

    found: set[str] = set()

    class Nodes:
        def __getattr__(self, name: str) -> Any:
            return lambda parent, text="", title="", *given, **more: ua.NodeId(text or str(parent), 1)

        def method(self, parent: Any, text: str, name: str, *given: Any, **more: Any) -> ua.NodeId:
            of_alarm = "condition" in str(parent.Identifier)
            found.add(f"alarm {name}" if of_alarm else name)
            return ua.NodeId(text, 1)

    tree: Any = Nodes()
    MachineNodes(tree, declaration, ua.NodeId("machines", 1))
    return found


@linux
def test_every_alarm_has_every_verb_of_alarms_in_opc_ua_and_epics() -> None:
    pytest.importorskip("p4p", reason="the extra epics is not installed")
    from umo.clients.faces.epics.epics_variables import variables_of

    async def step(machine: TriedMachine) -> None:
        declaration = declaration_of(machine.find())
        commands: Any = SimpleNamespace(ask=None)
        variables = variables_of(declaration, "plant:", commands).by_name
        methods = opcua_methods(declaration)
        for verb in naming(Names.ALARM):
            assert f"plant:cell:full:{verb.word}" in variables
            assert f"alarm {verb.title.removesuffix('Alarm')}" in methods
        assert f"alarm {ACKNOWLEDGE_ALARM.title}" not in methods  # it is Acknowledge, as the standard has it

    tried(step)


def test_it_needs_the_role_that_it_says(probe: Verb) -> None:
    roles = Roles({"ann": Role.TUNE, "bob": Role.SEE})
    assert roles.refusal(Caller("opcua", "ann", is_proved=True), probe.name) is None
    assert "probe deep needs the role tune" in str(roles.refusal(Caller("opcua", "bob", is_proved=True), probe.name))
