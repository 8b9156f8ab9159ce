"""The settings of a fleet: its file, and what a command line changes."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from umo.clients.fleet.fleet_keys import segment
from umo.clients.fleet.fleet_session import FleetNetwork, settings_of
from umo.clients.fleet.fleet_settings import JetStreamTable, load
from umo.errors import OptionError


def test_without_a_file_only_this_computer_is_reached(tmp_path: Path) -> None:
    settings = load(tmp_path / "fleet.toml")
    assert settings.site == segment(socket.gethostname())
    assert settings.network.is_local
    zenoh = settings_of(settings.network, "peer")
    assert all("127.0.0.1" in each for key in ("listen", "connect") for each in zenoh[key]["endpoints"])
    assert not zenoh["scouting"]["multicast"]["enabled"]


def test_a_file_gives_the_settings_and_the_command_line_changes_them(tmp_path: Path) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text('site = "cell 7"\nconnect = ["tcp/plant:7447"]\nuser = "ann"\n')
    settings = load(file, {"connect": ["tcp/127.0.0.1:7000"], "site": None})
    assert (settings.site, settings.user, settings.network.connect) == ("cell_x0020_7", "ann", ("tcp/127.0.0.1:7000",))


def test_the_table_of_a_jetstream_is_read_with_its_defaults(tmp_path: Path) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text('[jetstream]\nuser = "ann"\nkeep = "2 d"\n')
    assert load(file).jetstream == JetStreamTable("ann", keep=2 * 86400.0)
    assert load(tmp_path / "none.toml").jetstream == JetStreamTable()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sight = 'a'", "did you mean"),
        ("connect = 'tcp/a:1'", "list of addresses"),
        ("connect = ['plant']", "not an address"),
        ("connect = ['udp/a:1']", "not an address"),
        ("connect = ['tls/a:1']", "certificates"),
        ("connect = ['tls/a:1']\ncertificates = '/nowhere'", "umo connect certificate"),
        ("site = 7", r"fleet\.toml:1: site: must be a name, not 7"),
        ("site = ", "fleet.toml"),
        ("[jetstream]\nuser = 'ann'\nusers = 'bob'", r"fleet\.toml:3: jetstream\.users: .*did you mean 'user'"),
        ("[jetstream]\nkeep = 'long'", r"fleet\.toml:2: jetstream\.keep: 'long' is not a duration"),
        ("[jetstream]\n\nbytes = 'many'", r"fleet\.toml:3: jetstream\.bytes: must be a whole number from 1 on"),
        ("jetstream = 'nats'", r"fleet\.toml:1: jetstream: must be a table, not 'nats'"),
    ],
)
def test_a_mistake_is_told_in_words(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text(text)
    with pytest.raises(OptionError, match=words):
        load(file)


def test_an_address_of_another_computer_is_not_local_and_without_tls_nobody_is_proved() -> None:
    assert FleetNetwork(["tcp/127.0.0.1:1"], ["tcp/[::1]:2"]).is_local
    assert not FleetNetwork(["tcp/10.0.0.1:1"]).is_local
    assert not any(each.is_proved for each in (FleetNetwork(), FleetNetwork(["tcp/10.0.0.1:1"])))
