"""The settings of a fleet: its file, and what a command line changes."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from umo.errors import OptionError
from umo.fleet.fleet_keys import segment
from umo.fleet.fleet_session import FleetNetwork, settings_of
from umo.fleet.fleet_settings import load


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
    assert (settings.site, settings.user, settings.network.connect) == ("cell_7", "ann", ("tcp/127.0.0.1:7000",))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sight = 'a'", "did you mean"),
        ("connect = 'tcp/a:1'", "list of addresses"),
        ("connect = ['plant']", "not an address"),
        ("connect = ['udp/a:1']", "not an address"),
        ("connect = ['tls/a:1']", "certificates"),
        ("certificates = '/nowhere'", "umo fleet certificate"),
        ("site = 7", "not a text"),
        ("site = ", "fleet.toml"),
    ],
)
def test_a_mistake_is_told_in_words(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text(text)
    with pytest.raises(OptionError, match=words):
        load(file)


def test_tls_on_every_link_proves_and_anything_else_does_not(tmp_path: Path) -> None:
    for name in ("ca.pem", "certificate.pem", "key.pem"):
        (tmp_path / name).write_text("")
    tls = FleetNetwork(["tls/a:1"], certificates=tmp_path)
    mixed = FleetNetwork(["tls/a:1"], ["tcp/0.0.0.0:1"], tmp_path)
    assert (tls.is_proved, tls.is_local) == (True, False)
    assert not mixed.is_proved
    assert not FleetNetwork().is_proved
    assert FleetNetwork(["tcp/127.0.0.1:1"], ["tcp/[::1]:2"]).is_local
