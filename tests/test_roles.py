"""Roles: who may give which command, and what a missing or a wrong file means."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from umo.cycle.client_control import COMMANDS
from umo.system.roles import NEEDED, Role, Roles, place

FILE = """
[users]
ann = "maintain"
bob = "operate"
cid = "tune"
dot = "see"
"""


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
    for command, needed in NEEDED.items():
        assert (roles.allowed(user, command) is None) == (role >= needed), command


def test_the_reason_names_what_is_missing(roles: Roles) -> None:
    assert roles.allowed("bob", "shelve") == "bob may operate; shelve needs the role maintain"
    assert roles.allowed("", "tune") == "a user without a name may see; tune needs the role tune"


def test_a_command_that_is_not_listed_needs_the_last_role(roles: Roles) -> None:
    assert roles.allowed("ann", "explode") is None
    assert roles.allowed("bob", "explode") is not None


def test_every_command_of_clients_is_listed() -> None:
    assert NEEDED.keys() == {*COMMANDS, "stop"}


def test_everybody_else_can_have_a_role(tmp_path: Path) -> None:
    file = tmp_path / "roles.toml"
    file.write_text('[users]\nann = "see"\n"*" = "operate"\n')
    assert Roles.load(file).allowed("eve", "call") is None
    assert Roles.load(file).allowed("ann", "call") is not None


def test_without_a_file_everybody_may_everything(tmp_path: Path) -> None:
    assert Roles.load(tmp_path / "none.toml").allowed("eve", "remove from service") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[users", "Expected"),
        ("[user]\nann = 'see'", "no 'user' (did you mean 'users'?)"),
        ("[users]\nann = 'operat'", "no role 'operat' (did you mean 'operate'?)"),
        ("[users]\nann = 3", "no role 3"),
        ("[users]\nann = ['see']", "no role ['see']"),
        ("users = 3", "[users] gives names their roles"),
        ("\xff", "roles.toml"),
    ],
)
def test_a_file_that_is_wrong_allows_nothing_but_to_stop_and_says_why(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "roles.toml"
    file.write_bytes(text.encode("latin-1"))
    roles = Roles.load(file)
    assert roles.allowed("ann", "stop") is None
    assert words in str(roles.allowed("ann", "tune"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in folders")
@pytest.mark.parametrize("make", [lambda file: file.symlink_to("none.toml"), lambda file: os.mkfifo(file), Path.mkdir])
def test_what_stands_in_place_of_the_file_allows_nothing_and_blocks_nobody(
    tmp_path: Path, make: Callable[[Path], object]
) -> None:
    make(file := tmp_path / "roles.toml")
    assert Roles.load(file).allowed("ann", "tune") is not None
    assert Roles.load(file).allowed("ann", "stop") is None


def test_the_file_is_in_the_users_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert place() == tmp_path / "umo" / "roles.toml"
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert place() == tmp_path / ".config" / "umo" / "roles.toml"
