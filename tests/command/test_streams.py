"""Whoever reads stdout and stderr of `umo` is an observer: it may go away, and the run goes on."""

from __future__ import annotations

import io
import logging
import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.tiers import first
from umo.system import streams
from umo_command.new.templates import make_station

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="descriptors as Linux has them"),
]

UMO = [sys.executable, "-c", "from umo_command import main; main()"]


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A station that prints in every period."""
    folder = tmp_path_factory.mktemp("streams")
    make_station(folder / "tank")
    control = folder / "tank" / "control.py"
    text = control.read_text()
    assert "self.regulator.control()" in text
    control.write_text(
        text.replace("self.regulator.control()", "self.regulator.control(); print(self.now, flush=True)")
    )
    return folder / "tank"


def run(tank: Path, command: str) -> subprocess.CompletedProcess[str]:
    """A line of the shell, `umo` in it, in the folder where the station lies."""
    line = command.replace("umo ", f"{sys.executable} -c 'from umo_command import main; main()' ")
    return subprocess.run(["bash", "-c", line], cwd=tank.parent, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("module", ["rich", "typer"])
def test_ctrl_c_while_the_command_is_imported_is_no_traceback(tmp_path: Path, module: str) -> None:
    (tmp_path / f"{module}.py").write_text("raise KeyboardInterrupt")
    done = subprocess.run(
        [sys.executable, "-c", "from umo_command import main; main()", "--help"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (128 + signal.SIGINT, "")


def left(tank: Path) -> list[str]:
    """The runs that were written down whole."""
    return sorted(str(file.parent) for file in tank.parent.glob("runs/*/summary.json"))


@pytest.mark.parametrize(
    "command",
    first(
        1,
        [
            "umo run tank --no-plot 2>&1 | head -2; exit ${PIPESTATUS[0]}",
            "umo run tank 2>&1 | head -2; exit ${PIPESTATUS[0]}",
            "umo run tank <&- >&- 2>&-",
            "umo run tank 2> >(exec true) | true; exit ${PIPESTATUS[0]}",
            "umo run tank >/dev/full 2>&1",
            "umo run tank >&-",
            "umo run tank 2>&-",
        ],
    ),
)
def test_a_run_goes_on_when_its_reader_goes_away(tank: Path, command: str) -> None:
    before = left(tank)
    ended = run(tank, command)
    assert ended.returncode == 0, ended.stderr
    assert len(left(tank)) == len(before) + 1
    assert "Traceback" not in ended.stderr
    assert "Exception ignored" not in ended.stderr


@pytest.fixture(scope="module")
def clocked(tank: Path) -> Path:
    """The same with a timer of real time, for half a second or for ever."""
    folder = tank.parent / "clocked"
    shutil.copytree(tank, folder, ignore=shutil.ignore_patterns("__pycache__"))
    wiring = folder / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text().replace('driver = "tank", channel = "tick"', 'driver = "timerfd"'))
    (folder / "application.py").write_text(
        "import os\nfrom umo.control import wait\n\n\n"
        "async def main(m):\n    await wait(os.environ.get('LASTS', '500 ms'))\n"
    )
    return folder


@pytest.mark.parametrize(
    "command", first(1, [">/dev/full 2>&1", "2>&1 | head -1; exit ${PIPESTATUS[0]}", "<&- >&- 2>&-"])
)
@pytest.mark.full
def test_a_run_in_processes_of_its_own_goes_on_too(clocked: Path, command: str) -> None:
    assert run(clocked, f"umo run clocked {command}").returncode == 0


def test_a_terminal_that_is_closed_stops_the_run_safely(clocked: Path) -> None:
    before = left(clocked)
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(clocked.parent)
        os.execve(sys.executable, [*UMO, "run", "clocked", "--no-plot"], os.environ | {"LASTS": "1 h"})
    seen = b""
    while b" s " not in seen:  # the status line, in seconds
        seen += os.read(terminal, 1000)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 129
    assert len(left(clocked)) == len(before) + 1


@pytest.mark.parametrize("where", first(1, [">&- 2>&-", ">/dev/full 2>&1", "2>&1 | true; exit ${PIPESTATUS[0]}"]))
@pytest.mark.full
def test_the_exit_status_is_that_of_the_command(tank: Path, where: str) -> None:
    assert run(tank, f"umo check tank {where}").returncode == 0
    assert run(tank, f"umo check nothing {where}").returncode == 2


def test_what_a_closed_stream_leaves_free_is_taken_by_nothing_else(tank: Path) -> None:
    """A device's connection under number 1 would be sent whatever is printed."""
    code = (
        "import pathlib, socket\nfrom umo.system.streams import keep_open\nkeep_open()\n"
        "with socket.socket() as device: pathlib.Path('number').write_text(str(device.fileno()))"
    )
    line = f'exec "{sys.executable}" -c "$CODE" <&- >&- 2>&-'
    subprocess.run(["bash", "-c", line], env=os.environ | {"CODE": code}, cwd=tank.parent, check=True)
    assert int((tank.parent / "number").read_text()) > 2


@pytest.mark.full
@pytest.mark.parametrize("words", first(1, [["check", "tank"], ["--help"], ["show", "stations"], ["show", "why"]]))
def test_commands_work_where_the_home_folder_cannot_be_written(tank: Path, words: list[str]) -> None:
    hidden = ("UMO_STATE", "UMO_FRAMES", "XDG_STATE_HOME", "XDG_RUNTIME_DIR")
    environment = {key: value for key, value in os.environ.items() if key not in hidden} | {
        "HOME": "/proc",
        "TMPDIR": str(tank.parent),
    }
    ended = subprocess.run(
        [*UMO, *words], cwd=tank.parent, env=environment, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in ended.stderr
    assert ended.returncode in ((0, 2) if words == ["show", "why"] else (0,)), (
        ended.stderr
    )  # 2: nothing was late before


@pytest.mark.full
def test_names_that_are_not_utf8_are_shown_with_their_bytes(tank: Path) -> None:
    for command in ("umo check $'caf\\xe9'", "umo check tank -w $'caf\\xe9.toml'"):
        ended = run(tank, command)
        assert ended.returncode == 2
        assert r"caf\udce9" in ended.stderr
        assert "Traceback" not in ended.stderr
    os.rename(tank / "wiring" / "simulated.toml", os.fsencode(tank) + b"/wiring/caf\xe9.toml")
    try:
        ended = run(tank, "umo check tank")
        assert ended.returncode == 0, ended.stderr
        assert "caf" in ended.stdout
    finally:
        os.rename(os.fsencode(tank) + b"/wiring/caf\xe9.toml", tank / "wiring" / "simulated.toml")


def test_ctrl_c_before_there_is_a_machine_is_130_and_a_line_that_says_where(tank: Path) -> None:
    objects = tank / "objects.py"
    before = objects.read_text()
    objects.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n" + before)
    try:
        ended = run(tank, "umo check tank")
    finally:
        objects.write_text(before)
    assert ended.returncode == 128 + signal.SIGINT
    assert ended.stderr.strip() == "umo: interrupted (tank/objects.py:2)"


@pytest.mark.parametrize(("terminal", "begun"), [(True, "\r\x1b[2K"), (False, "")])
def test_a_log_message_begins_on_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch, terminal: bool, begun: str) -> None:
    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return terminal

    monkeypatch.setattr(logging, "lastResort", None)
    monkeypatch.setattr(sys, "stderr", screen := Screen())
    streams.log_on_lines()
    assert logging.lastResort is not None
    logging.lastResort.handle(logging.makeLogRecord({"msg": "heater inhibited", "levelno": logging.WARNING}))
    assert screen.getvalue() == f"{begun}heater inhibited\n"


FULL = """
import os
from umo.system.streams import say_without_waiting

os.set_blocking(2, False)
try:
    while True:
        os.write(2, bytes(1000))
except BlockingIOError:
    pass
os.set_blocking(2, True)
say_without_waiting("lost")
os.close(2)
say_without_waiting("lost")
"""


def test_a_stream_that_nobody_reads_or_that_is_closed_holds_up_no_last_words() -> None:
    with subprocess.Popen([sys.executable, "-c", FULL], stderr=subprocess.PIPE) as process:
        try:
            assert process.wait(60) == 0  # its stderr is full all the while
        finally:
            process.kill()


LINES = """
import sys
from umo.system.streams import say_without_waiting as say

for number in range(2):
    say(f"said {number}")
    print(f"printed {number}", file=sys.stderr, flush=True)
"""


def test_what_is_said_and_what_is_printed_stand_beside_each_other_in_a_file(tmp_path: Path) -> None:
    """One was written over the other: at the end of the file, and where the stream stood."""
    with (tmp_path / "log").open("wb") as log:
        subprocess.run([sys.executable, "-c", LINES], stderr=log, check=True)
    assert (tmp_path / "log").read_text().split("\n") == ["said 0", "printed 0", "said 1", "printed 1", ""]


def test_what_is_said_reaches_a_socket_as_that_of_a_journal() -> None:
    here, there = socket.socketpair()
    with here, there:
        subprocess.run([sys.executable, "-c", LINES], stderr=there, check=True)
        assert here.recv(1000) == b"said 0\nprinted 0\nsaid 1\nprinted 1\n"


def test_final_message_are_added_to_what_a_file_holds(tmp_path: Path) -> None:
    file = tmp_path / "log"
    with file.open("wb") as log:
        log.write(b"before\n")
        log.flush()
        code = "from umo.system.streams import say_without_waiting as say; say('caf\u00e9'); say('\\udcff')"
        subprocess.run([sys.executable, "-c", code], stderr=log, check=True)
    assert file.read_bytes() == "before\ncafé\n\\udcff\n".encode()
