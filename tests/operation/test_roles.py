"""Roles: who may give which command, and what a missing or a wrong file means."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from umo.operation.commands.roles import Caller, Roles, place
from umo.operation.commands.verb import Role
from umo.operation.commands.verbs import VERBS

FILE = """
[users]
ann = "maintain"
bob = "operate"
cid = "tune"
dot = "see"
"""


def allowed(roles: Roles, user: str, command: str) -> str | None:
    """Why a user whose name is proved may not give a command."""
    return roles.refusal(Caller("opcua", user, is_proved=True), command)


@pytest.fixture
def roles(tmp_path: Path) -> Roles:
    file = tmp_path / "roles.toml"
    file.write_text(FILE)
    return Roles.load(file)


@pytest.mark.parametrize(
    ("user", "role"),
    [("ann", Role.MAINTAIN), ("bob", Role.OPERATE), ("cid", Role.TUNE), ("dot", Role.SEE), ("eve", Role.SEE)],
)
def test_a_role_includes_those_before_it(roles: Roles, user: str, role: Role) -> None:
    for verb in VERBS.values():
        assert (allowed(roles, user, verb.name) is None) == (role >= verb.role), verb.name


def test_the_reason_names_what_is_missing(roles: Roles) -> None:
    assert (
        allowed(roles, "bob", "shelve")
        == "bob has the role operate; shelve needs the role maintain in [users] of roles.toml (docs/security.md)"
    )
    assert allowed(roles, "", "tune") == (
        "a user without a name has the role see; tune needs the role tune in [users] of roles.toml (docs/security.md)"
    )
    assert roles.refusal(Caller("epics", "ann"), "tune") == (
        "ann, unverified, has the role see; tune needs the role tune: epics in [unverified] of roles.toml "
        "(docs/security.md)"
    )


def test_a_command_that_is_not_listed_needs_the_last_role(roles: Roles) -> None:
    assert allowed(roles, "ann", "explode") is None
    assert allowed(roles, "bob", "explode") is not None


def test_no_verb_is_for_all() -> None:
    assert min(verb.role for verb in VERBS.values()) > Role.SEE


def test_everybody_else_can_have_a_role(tmp_path: Path) -> None:
    file = tmp_path / "roles.toml"
    file.write_text('[users]\nann = "see"\n"*" = "operate"\n')
    assert allowed(Roles.load(file), "eve", "call") is None
    assert allowed(Roles.load(file), "ann", "call") is not None


def test_without_a_file_others_may_only_look(tmp_path: Path) -> None:
    roles = Roles.load(tmp_path / "none.toml")
    for proved in (False, True):
        assert all(roles.refusal(Caller("page", "eve", proved), command) for command in VERBS)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[users", "Expected"),
        ("[user]\nann = 'see'", "roles.toml:1: user: unknown key (did you mean 'users'?); known: users, unverified"),
        ("[users]\nann = 'operat'", "no role 'operat' (did you mean 'operate'?)"),
        ("[users]\nann = 3", "no role 3"),
        ("[users]\nann = ['see']", "no role ['see']"),
        ("users = 3", "roles.toml:1: users: must be a table, not 3"),
        ("[unverified]\nepics = 3", "no role 3"),
        ("\xff", "roles.toml"),
    ],
)
def test_a_file_that_is_wrong_allows_nothing_but_to_see_and_says_why(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "roles.toml"
    file.write_bytes(text.encode("latin-1"))
    roles = Roles.load(file)
    assert allowed(roles, "ann", "stop") is not None
    assert words in str(allowed(roles, "ann", "tune"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in folders")
@pytest.mark.parametrize("make", [lambda file: file.symlink_to("none.toml"), lambda file: os.mkfifo(file), Path.mkdir])
def test_what_stands_in_place_of_the_file_allows_nothing_and_blocks_nobody(
    tmp_path: Path, make: Callable[[Path], object]
) -> None:
    make(file := tmp_path / "roles.toml")
    assert allowed(Roles.load(file), "ann", "tune") is not None
    assert allowed(Roles.load(file), "ann", "stop") is not None


def test_the_file_is_in_the_users_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert place() == tmp_path / "umo" / "roles.toml"
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert place() == tmp_path / ".config" / "umo" / "roles.toml"


def test_the_user_who_runs_the_machine_may_everything_whatever_the_file_says(tmp_path: Path) -> None:
    file = tmp_path / "roles.toml"
    for text in (None, "nonsense", '[users]\nann = "see"\n'):
        if text is not None:
            file.write_text(text)
        owner = Caller("page", "ann", is_owner=True)
        assert all(Roles.load(file).refusal(owner, command) is None for command in [*VERBS, "explode"])


def test_a_name_that_is_not_proved_takes_from_the_role_of_its_way_and_adds_nothing(tmp_path: Path) -> None:
    file = tmp_path / "roles.toml"
    file.write_text('[users]\nann = "see"\nbob = "maintain"\n"*" = "maintain"\n[unverified]\npage = "tune"\n')
    roles = Roles.load(file)
    of = {name: roles.of(Caller("page", name)) for name in ("ann", "bob", "eve", "")}
    assert of == {"ann": Role.SEE, "bob": Role.TUNE, "eve": Role.TUNE, "": Role.TUNE}
    assert roles.of(Caller("epics", "bob")) == Role.SEE
    assert roles.of(Caller("page", "bob", is_proved=True)) == Role.MAINTAIN
