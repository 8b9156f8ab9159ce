"""Certificates and rules of a fleet: what is made, what is refused."""

from __future__ import annotations

import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleet_authorities import authority_in
from umo.clients.fleet import fleet_settings
from umo.clients.fleet.fleet_certificates import Authority
from umo.clients.fleet.fleet_identity import identity_of
from umo.clients.fleet.fleet_rules import FILE, FleetRules
from umo.clients.fleet.fleet_session import FleetNetwork, rules_of
from umo.errors import OptionError

TLS = "tls/localhost:7447"


@pytest.fixture
def fleet(tmp_path: Path) -> Authority:
    return authority_in(tmp_path / "fleet")


def test_a_certificate_has_a_folder_whose_key_only_its_owner_reads(fleet: Authority) -> None:
    folder = fleet.folder / "ann"
    assert sorted(each.name for each in folder.iterdir()) == ["ca.pem", "certificate.pem", "key.pem"]
    assert stat.S_IMODE((folder / "key.pem").stat().st_mode) == 0o600
    assert str(identity_of(folder)) == "user:ann"
    assert identity_of(fleet.folder / "plant").hosts == ("localhost", "127.0.0.1")


def test_rules_have_every_certificate_and_go_to_every_server(fleet: Authority) -> None:
    rules = fleet.rules
    assert (rules.routers, rules.sites) == (["plant"], ["cell7", "cell8"])
    assert rules.users == {"ann": ["*"], "bob": ["*"], "eve": ["cell8"], "late": ["*"]}
    text = (fleet.folder / FILE).read_text()
    assert {(fleet.folder / name / FILE).read_text() for name in ("plant", "cell7", "cell8")} == {text}
    assert not (fleet.folder / "ann" / FILE).exists()


def test_nothing_is_overwritten(fleet: Authority) -> None:
    with pytest.raises(OptionError, match="useless"):
        Authority.create(fleet.folder)
    key = (fleet.folder / "ann" / "key.pem").read_bytes()
    for name in ("ann", "authority"):
        with pytest.raises(OptionError, match="does not overwrite it"):
            fleet.issue("user", name)
    assert (fleet.folder / "ann" / "key.pem").read_bytes() == key


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".", "..", "*", "a*", "$*", "a b", "ä", "-x", "x" * 1000, "a\n"])
def test_a_name_that_is_no_word_of_a_key_or_folder_is_refused(fleet: Authority, name: str) -> None:
    before = sorted(fleet.folder.rglob("*"))
    with pytest.raises(OptionError, match=r"cannot be a name|characters"):
        fleet.issue("user", name)
    with pytest.raises(OptionError):
        fleet.issue("user", "fine", sites=[name])
    assert sorted(fleet.folder.rglob("*")) == before


def test_a_withdrawn_name_has_no_rule_and_is_not_used_again(fleet: Authority) -> None:
    assert fleet.withdraw("ann") == "user:ann"
    assert "ann" not in FleetRules.load(fleet.folder / "plant" / FILE).users
    (fleet.folder / "ann").rename(fleet.folder / "away")
    with pytest.raises(OptionError, match="still exists"):
        fleet.issue("user", "ann")
    with pytest.raises(OptionError, match="has no 'ann'"):
        fleet.withdraw("ann")


def test_a_rule_in_another_form_is_not_spoilt(fleet: Authority) -> None:
    file = fleet.folder / FILE
    file.write_text("[user]\nann = true\n")
    for change in (lambda: fleet.withdraw("ann"), lambda: fleet.issue("site", "cell9")):
        with pytest.raises(OptionError):
            change()
        assert file.read_text() == "[user]\nann = true\n"
    assert not (fleet.folder / "cell9").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("users.ann = true", "did you mean 'user'"),
        ("user = 3", "user: must be a table, not 3"),
        ("user.ann = 3", "must be true"),
        ("user.ann = []", "must be true"),
        ('site.cell7 = ["cell8"]', "must be true"),
        ('user."*" = true', "cannot be a name"),
        ('user.ann = ["**"]', "cannot be a name"),
        ("user.ann", "rules.toml"),
        ("a=" * 2000, "rules.toml"),
    ],
)
def test_wrong_rules_are_told(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(OptionError, match=words):
        FleetRules.load(tmp_path / FILE)


def test_rules_that_are_no_text_are_told(tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(b"\xff\0")
    with pytest.raises(OptionError, match=FILE):
        FleetRules.load(tmp_path / FILE)


def test_an_expired_early_foreign_or_missing_certificate_is_told(fleet: Authority, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="expired on"):
        identity_of(fleet.folder / "late")
    with pytest.raises(OptionError, match="set the clock"):
        identity_of(fleet.folder / "ann", (datetime.now(UTC) - timedelta(days=9)).timestamp())
    with pytest.raises(OptionError, match=r"has no ca\.pem"):
        identity_of(tmp_path)
    for name in ("ca.pem", "certificate.pem", "key.pem"):
        (tmp_path / name).write_bytes((fleet.folder / "authority" / "ca.pem").read_bytes())
    with pytest.raises(OptionError, match="common name"):
        identity_of(tmp_path)
    (tmp_path / "certificate.pem").write_text("x")
    with pytest.raises(OptionError, match="is not a certificate"):
        identity_of(tmp_path)


# What a name is worth, by the way of connecting -----------------------------------------------------------------


def test_whoever_listens_by_tls_has_rules_or_does_not_begin(fleet: Authority) -> None:
    folder = fleet.folder / "cell7"
    for mode in ("peer", "router"):
        assert rules_of(FleetNetwork(listen=[TLS], certificates=folder), mode)
    (folder / FILE).unlink()
    for mode in ("peer", "router"):
        with pytest.raises(OptionError, match="without rules no certificate proves a name"):
            rules_of(FleetNetwork(listen=[TLS], certificates=folder), mode)
    assert rules_of(FleetNetwork(connect=[TLS], certificates=folder), "client") is None


@pytest.mark.parametrize("network", [{"listen": ["tcp/0.0.0.0:1"]}, {"connect": ["tcp/127.0.0.1:1", "tcp/10.0.0.1:1"]}])
def test_a_network_of_computers_without_certificates_carries_no_commands(network: Any) -> None:
    rules = rules_of(FleetNetwork(**network), "router")
    assert rules is not None
    assert rules["default_permission"] == "deny"
    keys = [key for rule in rules["rules"] for key in rule["key_exprs"]]
    assert not [key for key in keys if "command" in key or "sign" in key or key.startswith("**")]


def test_tcp_and_tls_do_not_go_together(fleet: Authority) -> None:
    with pytest.raises(OptionError, match="cannot be combined"):
        FleetNetwork(listen=[TLS, "tcp/127.0.0.1:7448"], certificates=fleet.folder / "plant")


@pytest.mark.parametrize(
    "host", ["127.0.0.1.evil.com", "127.evil.com", "localhost.evil.com", "10.0.0.1", "[::]", "0.0.0.0"]
)
def test_only_this_computer_is_local(host: str) -> None:
    assert not FleetNetwork(listen=[f"tcp/{host}:7447"]).is_local
    assert FleetNetwork(listen=["tcp/127.0.0.1:1", "tcp/[::1]:1", "tcp/localhost:1"]).is_local


def test_a_user_is_whom_the_certificate_names(fleet: Authority, tmp_path: Path) -> None:
    changes = {"connect": [TLS], "certificates": str(fleet.folder / "ann")}
    settings = fleet_settings.load(tmp_path / "none.toml", changes)
    assert settings.user == "ann"
    with pytest.raises(OptionError, match="belongs to user:ann; this command needs the certificate of a site"):
        settings.require("site")
    with pytest.raises(OptionError, match=r"'bob', but the certificate .* belongs to user:ann"):
        fleet_settings.load(tmp_path / "none.toml", changes | {"user": "bob"})


def test_who_sees_no_station_is_told_of_the_rules(fleet: Authority, tmp_path: Path) -> None:
    settings = fleet_settings.load(tmp_path / "no", {"connect": [TLS], "certificates": fleet.folder / "ann"})
    assert "started with rules for user:ann" in settings.why_none
    assert "rules" not in fleet_settings.load(tmp_path / "no").why_none
