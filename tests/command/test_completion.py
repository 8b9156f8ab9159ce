"""What the shell completes, by the words that it asks for, and in the shells themselves."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import umo as um
from helpers import patient
from helpers.tiers import first
from helpers.waiting import until
from umo_command.app import app

SHELL_TIMEOUT = 60.0
"""Timeout in s for what a shell shows, on a busy computer."""


def completed(line: str) -> list[str]:
    """What bash is given for the last word of a line, which may be empty."""
    asked = {"_UMO_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    return CliRunner().invoke(app, [], env=asked).stdout.split()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("umo sh", ["show"]),
        ("umo show wh", ["why"]),
        ("umo show", ["show"]),
        ("umo alarm un", ["unshelve"]),
        ("umo connect certificate si", ["site"]),
        ("umo recording export x --o", ["--out"]),
        ("umo run z", ["ztheta"]),
        ("umo run ztheta -w sec", ["second_generation"]),
        ("umo device get ztheta z.enc", ["z.encoder", "z.encoder_zero"]),
        ("umo device drivers mod", ["modbus"]),
        ("umo connect face prom", ["prometheus"]),
        ("umo do ztheta retu", ["return-to-service"]),
    ],
)
def test_commands_options_and_names_are_completed(line: str, words: list[str]) -> None:
    assert completed(line) == words


def test_stations_and_recordings_of_the_folder_are_completed(
    umo: Callable[..., object], tank: Path, tmp_path: Path
) -> None:
    (tmp_path / "talk").mkdir()
    (tmp_path / "tape.mcap").touch()
    (tmp_path / "tape.txt").touch()
    assert completed("umo check ta") == ["talk/", "tank"]
    assert completed("umo recording info ta") == ["talk/", "tank/", "tape.mcap"]
    assert completed("umo check ./tan") == ["./tank"]
    assert completed(f"umo check {tmp_path}/tan") == [f"{tmp_path}/tank"]
    assert completed("umo run tank -w mod") == ["modbus"]


def test_a_station_whose_code_fails_completes_nothing_and_says_nothing(umo: Callable[..., object], tank: Path) -> None:
    (tank / "objects.py").write_text("print('here'); 1 / 0")
    assert completed("umo device get tank l") == []


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> object:
    folders = {name: str(tmp_path_factory.mktemp(name.lower())) for name in ("UMO_STATE", "UMO_FRAMES")}
    with pytest.MonkeyPatch.context() as patch:
        for name, folder in folders.items():
            patch.setenv(name, folder)
        wiring = patient.conveyor(tmp_path_factory.mktemp("wiring"))
        with um.start("conveyor", wiring, manual=True, realtime=True) as started:
            until(lambda: started.poll(0.01) or (started.frames is not None and started.frames.head > 5))
            yield folders


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("umo do con", ["conveyor"]),
        ("umo do conveyor call sorter.belt.r", ["sorter.belt.run_at"]),
        ("umo do conveyor call sorter.belt.run_at sp", ["speed="]),
        ("umo do conveyor mode ma", ["manual"]),
        ("umo do conveyor write sorter.div", ["sorter.diverter"]),
        ("umo tune number conveyor sorter.win", ["sorter.window"]),
        ("umo show values sorter.div", ["sorter.diverter"]),
        ("umo show page conv", ["conveyor"]),
    ],
)
def test_what_a_running_station_has_is_completed(
    running: dict[str, str], monkeypatch: pytest.MonkeyPatch, line: str, words: list[str]
) -> None:
    for name, folder in running.items():
        monkeypatch.setenv(name, folder)
    assert completed(line) == words


# In the shells ----------------------------------------------------------------------------------------


class Terminal:
    """A shell with a person in front of it."""

    def __init__(self, *command: str) -> None:
        self._mine, its = pty.openpty()
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        environ = os.environ | {"PATH": path, "TERM": "dumb", "PS1": "$ ", "HISTFILE": ""}
        self._shell = subprocess.Popen(command, stdin=its, stdout=its, stderr=its, env=environ, start_new_session=True)
        os.close(its)

    def type(self, text: str) -> None:
        os.write(self._mine, text.encode())

    def shows(self, text: str) -> str:
        """What it shows up to this text; it fails after the timeout."""
        shown, end = "", time.monotonic() + SHELL_TIMEOUT
        while text not in shown:
            if not select.select([self._mine], [], [], max(0.0, end - time.monotonic()))[0]:
                pytest.fail(f"{text!r} is not in {shown!r}")
            shown += os.read(self._mine, 1 << 16).decode(errors="replace")
        return shown

    def close(self) -> None:
        self._shell.kill()
        self._shell.wait()
        os.close(self._mine)


INTERACTIVE = {
    "bash": (["bash", "--norc", "--noprofile", "-i"], 'eval "$(_UMO_COMPLETE=source_bash umo)"'),
    "zsh": (["zsh", "-f", "-i"], 'autoload -Uz compinit; compinit -u -D; eval "$(_UMO_COMPLETE=source_zsh umo)"'),
}


TABS = [("umo run zt", "ztheta"), ("umo show wh", "why"), ("umo recording rep", "repair")]
"""What is typed, and what a tab makes of it or shows; each takes a process of umo."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tabs"), first(1, [("bash", TABS[:1]), ("bash", TABS), ("zsh", TABS)]))
def test_a_tab_completes_in_the_shell(
    name: str, tabs: list[tuple[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name}")
    monkeypatch.chdir(tmp_path)
    command, prepare = INTERACTIVE[name]
    terminal = Terminal(*command)
    try:
        terminal.type(f"{prepare}; echo ready-$((40 + 2))\n")
        terminal.shows("ready-42")
        for typed, completed in tabs:
            terminal.type(f"\x15{typed}\t\t")  # bash shows several words at the second tab
            terminal.shows(completed)
    finally:
        terminal.close()


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.skipif(shutil.which("fish") is None, reason="there is no fish")
def test_fish_completes(tmp_path: Path) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    ask = "_UMO_COMPLETE=source_fish umo | source; complete -C 'umo run zt'"
    done = subprocess.run(
        ["fish", "--no-config", "-c", ask], env=os.environ | {"PATH": path, "HOME": str(tmp_path)}, cwd=tmp_path,
        capture_output=True, text=True, timeout=SHELL_TIMEOUT,
    )  # fmt: skip
    assert [line.partition("\t")[0] for line in done.stdout.splitlines()] == ["ztheta"], done.stderr
