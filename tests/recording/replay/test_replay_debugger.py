"""The debugger of `umo recording replay`, as somebody at a terminal has it: stops, and ways to go back and forth."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import umo.stations
from helpers.tapes import OVEN, changed_conveyor, recorded, save
from helpers.waiting import until
from umo import DigitalSensor
from umo.errors import OptionError
from umo.recording.replay.stops import BreakCondition, Stop

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="snapshots are forks of Linux")


@pytest.fixture(scope="module")
def conveyor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(recorded("conveyor"), tmp_path_factory.mktemp("recordings") / "conveyor.mcap")


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "umo_command", "recording", "replay", *words]


def session(file: Path, lines: str, *words: str) -> str:
    """What the debugger says to these lines."""
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONBREAKPOINT"}
    done = subprocess.run(
        command(str(file), *words), input=lines, capture_output=True, text=True, env=environ, timeout=50
    )
    assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    return done.stdout


def stops(text: str) -> list[int]:
    """The periods at which it stopped."""
    return [int(each.replace(",", "")) for each in re.findall(r"period ([\d,]+), [\d.e-]+ s\n", text)]


@pytest.mark.slow
@pytest.mark.full
def test_it_goes_to_a_period_back_and_forth(conveyor: Path) -> None:
    lines = "back 100\nto 3 s\nstep\nstep 10\nto 100\nto 3000\nback 5000\nq\n"
    said = session(conveyor, lines, "--at", "2500")
    assert stops(said) == [2500, 2400, 1499, 1500, 1510, 100, 3000, 0]


@pytest.mark.full
def test_the_machine_is_as_it_was_whichever_way_one_came(conveyor: Path) -> None:
    look = "p sorter.belt.position, sorter.belt.speed.read(), m.now\nwhere\n"
    lines = f"{look}to 3500\nto 10\nback 10\nto 2345\n{look}q\n"
    said = session(conveyor, lines, "--at", "2345")
    looks = re.findall(r"\(\d+\.\d+, \d+\.\d+, 4\.692\)", said)
    assert len(looks) == 2 and looks[0] == looks[1]
    first, second = (re.findall(r"stands at (\S+)", each) for each in said.split("period 2,345, 4.692 s")[1:])
    assert first[:5] == second[:5] != []


@pytest.mark.full
def test_it_stops_each_time_that_an_expression_becomes_true(conveyor: Path) -> None:
    lines = "p sorter.entry.read()\ncontinue\nback 10\ncontinue\nq\n"
    said = session(conveyor, lines, "--break", "sorter.entry.read().name == 'COVERED'")
    first, second, back, again = stops(said)
    assert "Beam.COVERED" in said
    assert first < second == again and back == second - 10


@pytest.mark.slow
@pytest.mark.full
def test_it_stops_at_the_first_difference(conveyor: Path, tmp_path: Path) -> None:
    copy = changed_conveyor(tmp_path, "tracking.py", "tunable=True)] = 0.05", "tunable=True)] = 0.09")
    said = session(conveyor, "p sorter.push_time\nback 1\nstep\nq\n", str(copy), "--at", "first-difference")
    first, before, again = stops(said)[:3]
    assert first == again == before + 1
    assert "sorter.diverter: recorded" in said and "0.09" in said


@pytest.mark.full
def test_at_the_end_of_the_recording_it_stops_once_more_and_then_tells_the_result(conveyor: Path) -> None:
    said = session(conveyor, "continue\nback 3\ncontinue\ncontinue\n", "--at", "10")
    assert stops(said)[0] == 10 and said.count("the recording ends here") == 2
    assert said.rstrip().splitlines()[-2].startswith("(replay) identical: 3,7")


@pytest.mark.full
def test_a_line_of_control_code_can_be_reached_and_looking_changes_nothing(conveyor: Path) -> None:
    lines = "b umo.stations.conveyor.tracking:184\ncontinue\np self.belt.speed.read()\ncl 1\ncontinue\ncontinue\n"
    said = session(conveyor, lines, "--at", "10")
    assert "identical" in said


@pytest.mark.full
def test_mistakes_in_the_prompt_are_told(conveyor: Path) -> None:
    said = session(conveyor, "to nowhere\nback x\nhelp\np 1 +\nq\n", "--at", "5")
    assert (
        "'nowhere' is not a place in a replay" in said
        and "back [N]" in said
        and "'x' is not a number of periods" in said
    )


@pytest.mark.full
def test_another_debugger_is_begun_where_the_environment_names_one(conveyor: Path) -> None:
    environ = os.environ | {"PYTHONBREAKPOINT": "replay.test_replay_debugger.breaking", "PYTHONPATH": path()}
    done = subprocess.run(command(str(conveyor), "--at", "700"), capture_output=True, text=True, env=environ)
    assert re.findall(r"broke at (\d+)", done.stdout) == ["700", "500", "3740"], done.stdout + done.stderr


def breaking() -> None:
    """A debugger that goes back once."""
    frame = sys._getframe()
    while frame is not None and frame.f_code.co_name != "stand_in":
        frame = frame.f_back  # type: ignore[assignment]
    print("broke at", frame.f_locals["period"], flush=True)
    if frame.f_locals["period"] == 700:
        frame.f_locals["replay"].back(200)


def path() -> str:
    return os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, sys.path)])


@pytest.mark.full
@pytest.mark.slow
def test_every_process_ends_with_the_first_one(conveyor: Path) -> None:
    with subprocess.Popen(
        command(str(conveyor), "--at", "3000"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        assert process.stdout is not None
        while b"(replay)" not in process.stdout.peek(1):
            process.stdout.readline()
        group = process.pid
        assert len(members(group)) >= 3
        process.send_signal(signal.SIGKILL)
        until(lambda: not members(group))


def members(group: int) -> list[int]:
    """The processes of a group that have not ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            rest = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(rest[2]) == group and rest[0] != "Z":
            found.append(int(stat.parent.name))
    return found


@pytest.mark.parametrize(
    ("text", "stop"),
    [
        ("12.3s", Stop(time=12.3)),
        ("500", Stop(period=500)),
        ("2 min", Stop(time=120.0)),
        ("first-difference", Stop(difference=True)),
    ],
)
def test_a_place_in_a_replay(text: str, stop: Stop) -> None:
    assert Stop.parse(text) == stop


@pytest.mark.parametrize("text", ["", "-3", "nan", "first", "3 parsecs"])
def test_what_is_no_place_is_told(text: str) -> None:
    with pytest.raises(OptionError, match="is not a place in a replay"):
        Stop.parse(text)


def test_a_condition_is_told_where_it_begins_to_hold() -> None:
    class M:
        x: Any = 1

    m, condition = M(), BreakCondition("m.x > 2 and period >= 0")
    seen = []
    for x in (1, 3, 4, 2, 5):
        m.x = x
        seen.append(condition.becomes_true(m, 0, 0.0))  # type: ignore[arg-type]
    assert seen == [False, True, False, False, True]
    assert not BreakCondition("1 / (m.x - 5) > 1").becomes_true(m, 0, 0.0)  # type: ignore[arg-type]


def test_a_condition_on_an_object_names_read() -> None:
    m = SimpleNamespace(level=DigitalSensor("mm", minimum=0.0, maximum=1.0, resolution=0.1))
    with pytest.raises(OptionError, match="write `read\\(\\)` for the value of an object"):
        BreakCondition("level > 0.5").becomes_true(m, 0, 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("import os", "is not an expression"),
        ("", "is not an expression"),
        ("(" * 300, "is not an expression"),
        ("x.write(3.0)", "write\\(\\) cannot be called in a condition"),
        ("x.raed() > 1", "did you mean 'read'"),
        ("m.__class__", "__class__ is internal"),
        ("open('/etc/passwd')", "open\\(\\) cannot be called"),
        ("(lambda: 1)()", "cannot be called in a condition"),
        ("(y := 3) > 1", "only expressions that read"),
        ("abs(x)(3)", "cannot be called"),
    ],
)
def test_a_condition_that_would_do_more_than_read_is_refused(text: str, told: str) -> None:
    with pytest.raises(OptionError, match=told):
        BreakCondition(text)


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--break", "sorter.belt.sped.read() > 1"), "Belt has no sped (did you mean 'speed'?)"),
        (("--break", "sorter > 1"), "not supported between"),
        (("--at", "99999"), "--at: the replay has 3,741 periods, and did not reach this one"),
        (("--at", "soon"), "is not a place in a replay"),
    ],
)
def test_a_mistake_in_the_command_is_one_line(conveyor: Path, words: tuple[str, ...], told: str) -> None:
    done = subprocess.run(command(str(conveyor), *words), input="q\n", capture_output=True, text=True, timeout=50)
    assert done.returncode == 2, done
    assert told in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.full
def test_a_condition_that_never_becomes_true_is_told_and_the_result(conveyor: Path) -> None:
    done = subprocess.run(
        command(str(conveyor), "--break", "sorter.belt.position > 1e9"), capture_output=True, text=True, timeout=50
    )
    assert done.returncode == 0 and "never became true" in done.stderr and done.stdout.startswith("identical")


@pytest.mark.slow
def test_it_stops_in_the_control_code_with_the_machine_and_its_parts_by_name(conveyor: Path) -> None:
    said = session(conveyor, "p unit.state, m, sorter\nn\nn\nw\nb\nq\n", "--at", "2500")
    assert "complete()\n-> await until(lambda: unit.state in" in said  # where the sequence stands
    assert "<Conveyor: sorter, timer>" in said and "<Sorter" in said
    stack = said.split("(replay)")[4]
    assert re.search(r"application\.py\(\d+\)main\(\)", stack) and "umo/clients" not in stack


@pytest.mark.full
def test_breakpoints_go_along_when_one_goes_back(conveyor: Path) -> None:
    file = CONVEYOR / "belt.py"
    text = "commanded = self.setpoint.read()"
    line = next(number for number, each in enumerate(file.read_text().splitlines(), 1) if text in each)
    said = session(
        conveyor, f"b {file}:{line}\nback 100\nb\nback 1\ncontinue\np self is sorter.belt\nq\n", "--at", "3000"
    )
    assert stops(said) == [3000, 2900, 2899]
    assert said.count(f"breakpoint   keep yes   at {file}:{line}") == 1
    assert said.count(f"-> {text}") == 1 and "(replay) True" in said


@pytest.mark.slow
@pytest.mark.full
def test_at_the_end_it_stops_where_the_error_was_raised(tmp_path: Path) -> None:
    (tmp_path / "oven").mkdir()
    (tmp_path / "oven" / "objects.py").write_text(OVEN)
    (tmp_path / "oven" / "application.py").write_text(FAILING)
    file = save(recorded(str(tmp_path / "oven")), tmp_path / "oven.mcap")
    before = sorted(tmp_path.iterdir())
    said = session(
        file, "continue\np level\nback 2\nto end\ncontinue\ncontinue\n", str(tmp_path / "oven"), "--at", "end"
    )
    assert said.count("the replay ends with ValueError: too high") == 2
    assert '-> raise ValueError("too high")' in said and "(replay) 7\n" in said
    assert "identical" in said
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
@pytest.mark.full
def test_it_goes_back_with_a_driver_off_the_cycle(tmp_path: Path) -> None:
    (tmp_path / "oven").mkdir()
    (tmp_path / "oven" / "objects.py").write_text(SLOW_OVEN)
    (tmp_path / "oven" / "application.py").write_text(HEATING)
    (tmp_path / "oven" / "wiring").mkdir()
    (tmp_path / "oven" / "wiring" / "simulated.toml").write_text(SLOW_WIRING)
    file = save(recorded(str(tmp_path / "oven")), tmp_path / "oven.mcap")
    said = session(file, "back 50\nback 40\nto 90\nto end\ncontinue\n", str(tmp_path / "oven"), "--at", "90")
    assert stops(said)[:4] == [90, 40, 0, 90]
    assert "first difference" not in said and "identical" in said


CONVEYOR = Path(umo.stations.__file__).parent / "conveyor"
FAILING = """
from umo.control import next_period
async def main(m):
    for level in range(100):
        m.heater.write(level / 10.0)
        await next_period()
        if level == 7:
            raise ValueError("too high")
"""
SLOW_OVEN = OVEN.replace("    timer:", "    warmth: DigitalSensor\n    timer:", 1).replace(
    "        timer=", "        warmth=DigitalSensor('degC', minimum=0, maximum=100, resolution=1),\n        timer=", 1
)
SLOW_WIRING = """
[drivers.slow]
type = "simulated"
off_cycle = true
period = "20 ms"

[wire]
"heater" = { driver = "simulated" }
"warmth" = { driver = "slow" }
"timer" = { driver = "simulated", period = "10 ms" }
"""
HEATING = """
from umo.control import next_period
async def main(m):
    for level in range(100):
        m.heater.write(level / 10.0)
        await next_period()
"""


# At a terminal ---------------------------------------------------------------------------------------------


def begun(file: Path, *words: str) -> Any:
    pexpect = pytest.importorskip("pexpect")
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONBREAKPOINT"}
    program, *arguments = command(str(file), *words)
    terminal = pexpect.spawn(program, arguments, timeout=50, env=environ, encoding="utf-8", dimensions=(40, 200))
    terminal.expect_exact("(replay) ")
    return terminal


@pytest.mark.slow
@pytest.mark.full
def test_at_a_terminal_ctrl_c_begins_a_new_line_and_the_history_goes_along(conveyor: Path) -> None:
    terminal = begun(conveyor, "--at", "2500")
    terminal.send("half a line")
    terminal.expect_exact("half a line")  # it is read: Ctrl-C before that waits for the next key
    terminal.sendintr()
    terminal.expect_exact("(replay) ")
    terminal.sendline("p 40 + 2")
    terminal.expect_exact("42")
    terminal.expect_exact("(replay) ")
    terminal.sendline("back 1000")
    terminal.expect_exact("period 1,500, 3.002 s")
    terminal.expect_exact("(replay) ")
    terminal.send("\x1b[A\x1b[A\r")  # the line before the last one
    terminal.expect_exact("42")
    terminal.sendline("q")
    terminal.expect_exact(pexpect_end())
    terminal.close()
    assert terminal.exitstatus == 0


def pexpect_end() -> Any:
    import pexpect

    return pexpect.EOF


@pytest.mark.full
def test_a_terminal_that_is_closed_ends_every_process(conveyor: Path) -> None:
    terminal = begun(conveyor, "--at", "3000")
    group = terminal.pid
    assert len(members(group)) >= 3
    terminal.close(force=False)
    until(lambda: not members(group))
