"""The page with a fleet: a table of all stations, and each of them as if it ran here."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleets import free_port
from umo.process.start import LINUX

from .conftest import Client, eventually, opened, started, viewing

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


class Rig:
    """A conveyor with its gateway, and the page on "another computer": it has no frames of its own."""

    def __init__(self, url: str, begin: Callable[[], subprocess.Popen[str]], gateway: subprocess.Popen[str]) -> None:
        self.url, self._begin, self.gateway = url, begin, gateway

    def begin_again(self) -> None:
        self.gateway.kill()
        self.gateway.wait()
        self.gateway = self._begin()


@contextmanager
def gateway_of(frames: Path, port: int, folder: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    begun: list[subprocess.Popen[str]] = []
    roles = folder / "gateway" / "umo" / "roles.toml"  # nothing proves the name of a client of this network
    roles.parent.mkdir(parents=True, exist_ok=True)
    roles.write_text('[unverified]\nfleet = "operate"\n')

    def begin() -> subprocess.Popen[str]:
        words = ["connect", "fleet", "--site", "cell7", "--commands", "--listen", f"tcp/127.0.0.1:{port}"]
        command = [sys.executable, "-c", "from umo_command import main; main()", *words]
        environment = {"UMO_FRAMES": str(frames), "XDG_CONFIG_HOME": str(folder / "gateway")}
        begun.append(
            process := subprocess.Popen(
                command, text=True, env=dict(os.environ) | environment, stderr=subprocess.DEVNULL
            )
        )
        return process

    try:
        yield begin
    finally:
        for each in begun:
            each.kill()
            each.wait()


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    here, there, port = tmp_path / "here", tmp_path / "there", free_port()
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("UMO_FRAMES", str(there))
    with started(tmp_path), gateway_of(there, port, tmp_path) as begin:
        monkeypatch.setenv("UMO_FRAMES", str(here))
        settings = tmp_path / "config" / "umo" / "fleet.toml"
        settings.parent.mkdir(parents=True)
        settings.write_text(f'connect = ["tcp/127.0.0.1:{port}"]\nuser = "ann"\n')
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
        gateway = begin()
        eventually(lambda: _answers(port))
        with viewing("--fleet") as (_, url):
            yield Rig(url, begin, gateway)


def _answers(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def row(client: Client, condition: Callable[[Any], bool]) -> Any:
    """The first row of the conveyor in a table for which the condition is true."""
    while True:
        rows = [each for each in client.get("fleet")["stations"] if each["name"] == "cell7/conveyor"]
        if rows and condition(rows[0]):
            return rows[0]


def socket_of(url: str) -> str:
    return url.replace("http", "ws", 1).replace("/?", "/ws?")


@pytest.mark.full
def test_the_table_has_a_station_of_another_computer_and_one_message_shows_and_commands_it(rig: Rig) -> None:
    with opened(socket_of(rig.url)) as client:
        told = row(client, lambda each: each["state"] == "running")
        assert (told["present"], told["mode"]) == (True, "manual")
        client.send(type="watch", name="cell7/conveyor", place=None)
        described = client.get("description")
        assert described["name"] == "cell7/conveyor"
        assert described["twin"]
        client.send(type="command", id=1, do="lease", who="ann")
        answer = client.get("answer")
        while answer["state"] == "begun":
            answer = client.get("answer")
        assert answer["state"] == "done", answer
        state = client.get("state")
        while "ann" not in state.get("lease", {}).get("holder", ""):
            state = client.get("state")


@pytest.mark.full
def test_a_station_whose_gateway_is_gone_is_away_and_comes_back(rig: Rig) -> None:
    with opened(socket_of(rig.url)) as client:
        row(client, lambda each: each["present"])
        rig.gateway.kill()
        assert row(client, lambda each: not each["present"])["state"] == "away"
        rig.begin_again()
        row(client, lambda each: each["present"] and each["state"] == "running")


def test_one_click_in_the_table_shows_the_station(rig: Rig, page: Any) -> None:
    page.goto(rig.url)
    page.click("table.fleet button:has-text('cell7/conveyor')")
    page.wait_for_selector("#tab-machine:not([disabled])")
    page.click("#tab-machine")
    page.locator('tr[data-path="sorter.diverter"]').wait_for()
    assert page.faults == []


def test_the_name_of_a_station_of_the_fleet_leads_to_it(rig: Rig, page: Any) -> None:
    with viewing("cell7/conveyor") as (_, url):
        page.goto(url)
        page.wait_for_selector("#tab-machine:not([disabled])")
        assert page.faults == []
        page.goto("about:blank")  # before its server ends


def test_below_a_table_of_a_fleet_nobody_is_told_to_start_a_station(rig: Rig, page: Any) -> None:
    page.goto(rig.url)
    page.locator("table.fleet button:has-text('cell7/conveyor')").wait_for()
    assert not page.locator("text=Start one in a terminal").is_visible()
