"""Every verb by every way, with each role, in both modes, with and without the lease: the same answers."""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from helpers.tiers import some
from helpers.verb_ways import WAYS, OpcUa, Way
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.remote.client_session import ClientSession
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.verb import Role, Verb
from umo.operation.commands.verbs import ACKNOWLEDGE, LET_GO, STOP, VERBS, WRITE, offered

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
ASKED: Mapping[str, tuple[str, dict[str, Any]]] = {
    "stop": ("", {}),
    "mode": ("", {"mode": "manual"}),
    "tune": ("cell.gain", {"value": 2.0}),
    "write": ("cell.valve", {"value": 1.0}),
    "let go": ("cell.valve", {}),
    "call": ("cell.add", {"weight": 1.5}),
    "cancel": ("cell.add", {}),
    "acknowledge": ("cell", {}),
    "clear": ("cell", {}),
    "acknowledge alarm": ("cell.full", {}),
    "reset alarm": ("cell.full", {}),
    "shelve": ("cell.full", {"time": 60.0}),
    "unshelve": ("cell.full", {}),
    "remove from service": ("cell.full", {}),
    "return to service": ("cell.full", {}),
}
"""A path and arguments for each verb that can be done on the machine that faces are tried on, in this order."""
OF_LIFE = {WRITE, LET_GO}
"""Refused by ways that do not tell whether a client lives."""
ROLE = re.compile(r"has the role (\w+); ([a-z ]+) needs the role (\w+)")


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(ClientSession, "stop", lambda session, who: None)  # the machine goes on


def give_role(role: Role) -> None:
    """To bob, by each way."""
    from umo.operation.commands.roles import place

    place().parent.mkdir(parents=True, exist_ok=True)
    place().write_text(f'[users]\nbob = "{role}"\n"*" = "{role}"\n[unverified]\n"*" = "{role}"\n')


def answers(kind: type[Way], role: Role, mode: Mode, lease: str) -> dict[Verb, str]:
    """The answer to each verb by one way. `lease`: "own", "none", "other": bert has it, or "of a command
    before"."""
    give_role(role)

    async def work() -> dict[Verb, str]:
        async with TriedMachine(mode) as machine:
            machine.set("cell.level", 170)
            await until(lambda: machine.connection.machine.image.columns.alarms.any())
            if lease == "other":
                clients = machine.clients
                clients.lease.acquire("bert", "another", 60.0, clients.clock())
            way = kind(machine)
            await way.open()
            try:
                if lease == "own" and way.takes_lease:
                    await way.take()  # type: ignore[attr-defined]
                if lease == "of a command before":
                    held = (await way.give(ACKNOWLEDGE, "cell")).startswith("done")
                    assert bool(machine.holder) == held == (role >= ACKNOWLEDGE.role)
                return {verb: await way.give(verb, path, **more) for verb, path, more in asked(mode)}
            finally:
                await way.close()

    return asyncio.run(work())


def asked(mode: Mode) -> list[tuple[Verb, str, dict[str, Any]]]:
    """The mode stays as it is."""
    given = ASKED | {"mode": ("", {"mode": str(mode)})}
    return [(VERBS[name], *given[name]) for name in ASKED]


def reason(text: str) -> str:
    """What is the same for all ways: not the table of roles that gives the role."""
    found = ROLE.search(text)
    return found[0] if found else text


def test_every_verb_that_is_offered_is_asked_for() -> None:
    assert list(ASKED.keys() ^ {verb.name for verb in offered()}) == []


@pytest.mark.parametrize("mode", Mode, ids=str)
@pytest.mark.parametrize("role", Role, ids=str)
def test_a_verb_is_refused_to_who_has_no_role_for_it_and_in_the_wrong_mode(role: Role, mode: Mode) -> None:
    for verb, text in answers(OpcUa, role, mode, "own").items():
        if role < verb.role:
            assert text.startswith(f"bob has the role {role}; {verb.name} needs the role {verb.role} in [users]"), (
                verb.name
            )
        elif verb.only_manual and mode is Mode.AUTOMATIC:
            assert f"{verb.name} is possible in manual mode only" in text
        elif verb is LET_GO and mode is Mode.AUTOMATIC:
            assert text == "cell.valve is not held"
        elif verb.name == "reset alarm":
            assert text == "cell.full is acknowledged: it cannot be reset"
        elif verb.name == "cancel":
            assert text == "no action cell.add is running"
        else:
            assert text.startswith("done"), (verb.name, text)


def cases(names: Sequence[str]) -> list[Any]:
    """Ways, modes and roles. `make test` tries each way in one mode, with the role that may do everything and with one
    that may not."""
    roles, modes = list(Role), list(Mode)
    shown = {
        (name, modes[turn % len(modes)], role)
        for turn, name in enumerate(names)
        for role in (roles[turn % (len(roles) - 1)], roles[-1])
    }
    known = product(names, modes, roles)
    return some(shown.__contains__, [case for case in known if case[2] is roles[-1] or not WAYS[case[0]].is_owner])


@pytest.mark.parametrize(("name", "mode", "role"), cases([name for name in WAYS if name != "opcua"]))
def test_every_way_has_the_same_answers(name: str, mode: Mode, role: Role) -> None:
    if name == "fleet":
        pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    way = WAYS[name]
    expected, found = answers(OpcUa, role, mode, "own"), answers(way, role, mode, "own")
    for verb, text in found.items():
        if not way.tells_life and verb in OF_LIFE and role >= verb.role:
            continue
        if way.takes_lease and role < Role.TUNE:
            assert ROLE.search(text), verb.name
        told = expected[verb].replace("bob has", "bob, unverified, has")
        assert reason(text) == reason(told), verb.name


def check_without_lease(name: str, mode: Mode, role: Role, lease: str, refusal: str) -> None:
    """Every verb but the stop is refused: for want of the role, of heartbeats, or of the lease."""
    if name == "fleet":
        pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    way = WAYS[name]
    for verb, text in answers(way, role, mode, lease).items():
        if role < verb.role:
            assert ROLE.search(text), verb.name
        elif verb is STOP:
            assert text.startswith("done")
        elif not way.tells_life and verb is WRITE:
            assert text.endswith("transmits no heartbeats")
        else:
            assert text == refusal, verb.name


@pytest.mark.parametrize(("name", "mode", "role"), cases(list(WAYS)))
def test_every_verb_but_stop_is_refused_while_another_client_has_the_lease(name: str, mode: Mode, role: Role) -> None:
    check_without_lease(name, mode, role, "other", "bert has the lease")


@pytest.mark.parametrize(("name", "mode", "role"), cases([name for name, way in WAYS.items() if way.takes_lease]))
def test_every_verb_but_stop_is_refused_without_the_lease_where_it_is_not_taken_for_each(
    name: str, mode: Mode, role: Role
) -> None:
    check_without_lease(name, mode, role, "none", "nobody has the lease; take it first")


@pytest.mark.parametrize(("name", "mode", "role"), cases([name for name, way in WAYS.items() if not way.takes_lease]))
def test_where_the_lease_is_taken_for_each_command_it_makes_no_difference_whether_it_was_taken_for_one_before(
    name: str, mode: Mode, role: Role
) -> None:
    if name == "fleet":
        pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    assert answers(WAYS[name], role, mode, "of a command before") == answers(WAYS[name], role, mode, "none")
