"""The faces of a wiring beside `umo run`: checked before the start, served while it runs, gone with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.begun_programs import is_noted_as_ended, programs_begun
from helpers.waiting import until
from umo.clients.faces import face_registry
from umo.clients.faces.face import Face
from umo.errors import UmoError, WiringError
from umo.process.station import find
from umo.system.processes import ENDED, state
from umo_command.check.report import check_station
from umo_command.connect import faces
from umo_command.run import faces_beside
from umo_command.run.faces_beside import FIRST_PAUSE, MAX_PAUSE, MAX_TOLD, FacesBeside, faces_of, names_in

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
LAMP = "test_faces_beside:Lamp"
TESTS = Path(__file__).parents[1]
WIRING = f"""
drivers.simulated.type = "simulated"
wire.level.driver = "simulated"
wire.timer = {{ driver = "timerfd", period = "10 ms" }}
[faces."{LAMP}"]
word = "red"
"""
STATION = """
from umo import Compound, DigitalSensor

class Tank(Compound):
    timer: DigitalSensor
    level: DigitalSensor

def machine():
    numbers = {"minimum": 0.0, "maximum": 1e6, "resolution": 1.0}
    timer = DigitalSensor("sampling_period", synchronous=False, **numbers)
    return Tank(timer=timer, level=DigitalSensor("mm", **numbers))
"""
APPLICATION = """
from umo.control import next_period

async def main(m):
    while True:
        await next_period()
"""


class Lamp(Face):
    """A face that shows nothing. It may not begin, or not end."""

    def __init__(self, word: str = "", hang: bool = False) -> None:
        self.address, self._hang = f"lamp of {word}", hang

    async def open(self) -> None:
        if "blown" in self.address:
            raise UmoError("the lamp is blown")

    async def begin(self, machine: Any, commands: Any) -> None:
        print(f"begun with {machine.station}", flush=True)

    async def frames(self, changes: Any) -> None:
        while self._hang:
            signal.pause()

    async def end(self, why: str) -> None:
        return


# The table ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"rate": 0}, "rig.toml: faces.rate: must be a number from 0.1 to 100, not 0"),
        ({"prometeus": {}}, "no face 'prometeus' (did you mean 'prometheus'?)"),
        ({LAMP: {"wort": "red"}}, "wort: unknown key"),
    ],
)
def test_a_mistake_in_the_table_is_one_of_the_wiring(table: dict[str, Any], words: str) -> None:
    with pytest.raises(WiringError) as caught:
        faces_of("rig.toml", table)
    assert words in str(caught.value)


def test_a_face_that_is_not_installed_is_told_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def find(name: str) -> type[Face]:
        if name == LAMP:
            return Lamp
        raise face_registry.FaceNotInstalled(f'the face {name} needs glow: pip install ".[{name}]" in the clone of umo')

    monkeypatch.setattr("umo.clients.faces.face_settings.find_face", find)
    told: list[str] = []
    found = faces_of("rig.toml", {"rate": 5, LAMP: {}, "opcua": {}}, told.append)
    assert (found, names_in(found)) == ({"rate": 5, LAMP: {}}, [LAMP])
    assert told == ['the face opcua needs glow: pip install ".[opcua]" in the clone of umo']
    assert faces_of("rig.toml", {"rate": 5, "opcua": {}}, told.append) == {}


def test_check_tells_the_faces_and_a_mistake_in_them(station: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check_station(find(str(station)), None) == 0
    assert f"served by {LAMP}" in capsys.readouterr().out
    file = station / "wiring" / "simulated.toml"
    file.write_text(WIRING.replace("word", "wort"))
    assert check_station(find(str(station)), None) == 2
    assert "simulated.toml:6: faces.test_faces_beside:Lamp.wort: unknown key" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("path", "near"),
    [("level", None), ("*", None), ("run:missed", None), ("levl", " (did you mean 'level'?)"), ("tank", "")],
)
def test_check_notes_a_dead_band_that_matches_no_number(
    station: Path, capsys: pytest.CaptureFixture[str], path: str, near: str | None
) -> None:
    (station / "wiring" / "simulated.toml").write_text(f"{WIRING}\n[faces.dead_bands]\n{path!r} = 1.0\n")
    assert check_station(find(str(station)), None) == 0
    told = capsys.readouterr().out
    assert ("faces.dead_bands" in told) is (near is not None)
    if near is not None:
        assert f"note: faces.dead_bands: {path!r} is no sensor, actuator or tunable number{near}" in told


# The process ----------------------------------------------------------------------------------------------


class Time:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    found: list[str] = []
    monkeypatch.setattr(faces_beside, "say", found.append)
    return found


def program(text: str) -> list[str]:
    return [sys.executable, "-c", text]


def test_one_that_ends_is_told_once_and_started_again_after_growing_pauses(
    said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time, file, begun = Time(), tmp_path / "starts", programs_begun(monkeypatch)
    text = f"open({str(file)!r}, 'a').write('x'); print('it is dark'); raise SystemExit(3)"
    with FacesBeside("rig.toml", {LAMP: {}}, command=program(text), clock=time) as beside:
        beside.look(None, [])
        assert begun == []  # the machine does not run yet

        def ended(count: int) -> bool:
            beside.look(1, [])
            return len(begun) == count and is_noted_as_ended(begun[-1]) and len(file.read_text()) == count

        beside.look(1, [])
        until(lambda: ended(1))
        for count, pause in ((2, FIRST_PAUSE), (3, 2 * FIRST_PAUSE), (4, 4 * FIRST_PAUSE)):
            time.now += 0.99 * pause
            beside.look(1, [])
            assert len(begun) == count - 1
            time.now += 0.02 * pause
            until(lambda count=count: ended(count))
        end = "the faces have ended (status 3); the machine continues, and the faces are started again"
        assert said == ["faces: it is dark", end]
        beside.is_ending = True
        time.now += MAX_PAUSE
        beside.look(1, [])
        assert len(begun) == 4


def test_one_that_has_lived_for_long_is_told_anew_and_started_soon(
    said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time, file, begun = Time(), tmp_path / "starts", programs_begun(monkeypatch)
    text = f"open({str(file)!r}, 'a').write('x'); import signal; signal.pause()"
    with FacesBeside("rig.toml", {LAMP: {}}, command=program(text), clock=time) as beside:
        for count in (1, 2, 3):
            beside.look(1, [])
            assert len(begun) == count
            until(lambda count=count: file.exists() and len(file.read_text()) == count)
            time.now += MAX_PAUSE
            begun[-1].kill()
            until(lambda: beside.look(1, []) or is_noted_as_ended(begun[-1]))
            time.now += FIRST_PAUSE
    assert said == ["the faces have ended (signal 9); the machine continues, and the faces are started again"] * 3


def test_one_that_floods_is_read_in_pieces(said: list[str]) -> None:
    text = "n = 0\nwhile True:\n    n += 1\n    print('line', n, flush=True)"
    with FacesBeside("rig.toml", {LAMP: {}}, command=program(text)) as beside:
        until(lambda: beside.look(1, []) or said)
        for _ in range(5):
            before = len(said)
            beside.look(1, [])
            assert len(said) - before <= MAX_TOLD


def test_one_that_does_not_end_is_killed(said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faces_beside, "END_TIMEOUT", 0.05)
    begun = programs_begun(monkeypatch)
    text = "import signal; signal.signal(15, signal.SIG_IGN); print('deaf', flush=True); signal.pause()"
    with FacesBeside("rig.toml", {LAMP: {}}, command=program(text)) as beside:
        until(lambda: beside.look(1, []) or said)
    assert [each.returncode for each in begun] == [-signal.SIGKILL]


@pytest.mark.parametrize(
    ("command", "table", "why"),
    [
        ("/no/such/program", {LAMP: {}}, "No such file or directory"),
        ("a\0b", {LAMP: {}}, "embedded null byte"),
        ("true", {LAMP: {(): 1}}, "keys must be"),
    ],
)
def test_one_that_cannot_be_started_is_told_and_tried_again(
    said: list[str], command: str, table: dict[str, Any], why: str
) -> None:
    time = Time()
    with FacesBeside("rig.toml", table, command=[command], clock=time) as beside:
        for _ in range(3):
            beside.look(1, [])
            time.now += MAX_PAUSE
    [line] = said
    assert line.startswith("the faces cannot be started: ")
    assert why in line


# Beside a run ---------------------------------------------------------------------------------------------


@pytest.fixture
def station(tmp_path: Path) -> Path:
    folder = tmp_path / "tank"
    (folder / "wiring").mkdir(parents=True)
    (folder / "wiring" / "simulated.toml").write_text(WIRING)
    (folder / "objects.py").write_text(STATION)
    (folder / "application.py").write_text(APPLICATION)
    return folder


@contextmanager
def running(station: Path, *words: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """`umo run`, and the lines that it has told so far."""
    command = [sys.executable, "-P", "-m", "umo_command", "run", str(station), "--no-record", *words]
    folders = {"UMO_STATE": str(station.parent / "state"), "UMO_FRAMES": str(station.parent / "frames")}
    environ = os.environ | folders | {"PYTHONPATH": os.pathsep.join([str(TESTS), *filter(None, sys.path)])}
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environ, cwd=station
    ) as process:
        try:
            yield process, []
        finally:
            process.kill()


def told(run: tuple[subprocess.Popen[str], list[str]], words: str) -> str:
    """The next line with these words."""
    process, lines = run
    assert process.stderr is not None
    for line in process.stderr:
        lines.append(line)
        if words in line:
            return line
    raise AssertionError(f"{words!r} was not told: {''.join(lines)}")


def face_of(process: subprocess.Popen[str]) -> int:
    """The pid of its faces, which are waited for: a 0 would be the process group of the tests."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    of = faces.__name__

    def found() -> int:
        pids = children.read_text().split()
        return next((int(pid) for pid in pids if of in Path(f"/proc/{pid}/cmdline").read_text()), 0)

    return until(found)


def gone(pid: int) -> bool:
    return state(pid) in ENDED


def begun(run: tuple[subprocess.Popen[str], list[str]]) -> int:
    """The pid of the control process, once the face has begun with it."""
    line = told(run, "(pid")
    told(run, "begun with tank")
    return int(line.partition("(pid ")[2].partition(")")[0])


@pytest.mark.full
def test_they_are_served_while_it_runs_and_begin_again_after_kill(station: Path) -> None:
    with running(station) as run:
        assert "lamp of red  (reading only)" in told(run, LAMP)
        control, face = begun(run), face_of(run[0])
        assert os.getpriority(os.PRIO_PROCESS, face) == faces_beside.NICENESS
        assert os.sched_getscheduler(face) == os.SCHED_OTHER
        os.kill(face, signal.SIGKILL)
        told(run, "the faces have ended (signal 9); the machine runs on")
        again = face_of(run[0])
        os.kill(control, signal.SIGKILL)
        assert run[0].wait(30) != 0
        assert gone(again)


@pytest.mark.full
def test_a_run_that_is_stopped_ends_them_in_the_end(station: Path) -> None:
    with running(station) as run:
        begun(run)
        face = face_of(run[0])
        run[0].send_signal(signal.SIGINT)
        assert run[0].wait(30) == 130
        assert gone(face)
        assert run[0].stderr is not None
        assert "faces have ended" not in run[0].stderr.read()


@pytest.mark.full
def test_they_die_with_a_run_that_is_killed(station: Path) -> None:
    with running(station) as run:
        begun(run)
        face = face_of(run[0])
        os.kill(face, signal.SIGSTOP)
        run[0].kill()
        until(lambda: gone(face))


@pytest.mark.full
def test_one_that_hangs_does_not_keep_the_machine_from_ending(station: Path) -> None:
    (station / "wiring" / "simulated.toml").write_text(WIRING + "hang = true\n")
    with running(station) as run:
        begun(run)
        face = face_of(run[0])
        run[0].send_signal(signal.SIGTERM)
        assert run[0].wait(30) == 128 + signal.SIGTERM
        assert gone(face)


@pytest.mark.full
def test_one_that_cannot_begin_is_told_and_the_machine_runs(station: Path) -> None:
    (station / "wiring" / "simulated.toml").write_text(WIRING.replace("red", "blown"))
    with running(station, "--until", "5 s") as run:
        told(run, "test_faces_beside:Lamp: the lamp is blown")
        told(run, "the faces have ended (status 2); the machine runs on")
        assert run[0].wait(30) == 124


@pytest.mark.full
def test_without_them_none_is_started_and_a_mistake_is_none(station: Path) -> None:
    (station / "wiring" / "simulated.toml").write_text(WIRING.replace("word", "wort"))
    for words, status in ((["--no-faces", "--until", "0.5 s"], 124), ([], 2)):
        with running(station, *words) as (process, _):
            assert process.stderr is not None
            lines = process.stderr.read()
            assert process.wait(30) == status
            assert ("faces.test_faces_beside:Lamp.wort: unknown key" in lines) == (status == 2)
            assert "Traceback" not in lines
