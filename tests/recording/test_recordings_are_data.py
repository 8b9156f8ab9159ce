"""A recording is data: nothing is imported, called or opened because a file says so, whoever reads the file."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from importlib import metadata
from importlib.abc import MetaPathFinder
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from helpers.recorded import block_at_random, layout_of
from helpers.tapes import OVEN, MemoryTape, recorded, save, taped
from helpers.tiers import first, named
from umo import Compound, DigitalSensor, connect, drive, published
from umo.clients.page.watched_recording import WatchedRecording
from umo.clients.page.watched_run import described_twin
from umo.drivers import registry
from umo.errors import UmoError
from umo.process import source_files
from umo.process import station as station_module
from umo.process.frames import Reader, blackbox
from umo.process.job import Job as RunJob
from umo.process.job import Plan
from umo.process.job_facts import job_facts
from umo.process.station import Station, shipped
from umo.recording import flight_folder
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.replay.closed_loop import recorded_trial
from umo.recording.replay.code_given import CodeGiven
from umo.recording.replay.program import Program
from umo.recording.replay.tape import NotReplayable
from umo.testing import assert_no_error, assert_replays, periods
from umo_command.run.long_runs import prune
from umo_command.run.long_runs import recorded as recorded_runs

Umo = Callable[..., Result]
MODULES = ("objects", "application", "twin", "trap", "trap_driver", "__init__")
CODE = """
from pathlib import Path
Path(__file__).with_name("touched").touch()
from umo import Compound
from umo.drivers import Simulated
class Driver(Simulated):
    pass
def machine(**options):
    return Compound()
async def main(m, **options):
    pass
def twin(m):
    pass
"""


EVENTS = ("open", "os.listdir", "os.scandir", "exec", "compile", "subprocess.Popen", "import", "socket.connect")
"""Events of Python's audit hooks that mean that something was touched."""


@dataclass
class Watch:
    """What of a folder is opened, listed or imported."""

    folder: str = ""
    seen: list[str] = field(default_factory=list)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.folder:
            return
        if event in EVENTS:
            text = repr(arguments[0].co_filename if event == "exec" else arguments)
            of_the_trap = self.folder in text or (event == "import" and str(arguments[0]).startswith("trap"))
            if of_the_trap and ".mcap" not in text:
                self.seen.append(f"{event} {text}")


WATCH = Watch()


class ModulesSought(MetaPathFinder):
    """Notes whoever wants to import a module of the name of a registered driver."""

    def find_spec(self, name: str, *others: object) -> None:
        if name in registry.known():
            WATCH.seen.append(f"import {name}")


@pytest.fixture(scope="module", autouse=True)
def watched() -> None:
    sys.addaudithook(WATCH)  # it stays for the life of the process, and is of no use without a folder


@contextmanager
def traps(folder: Path) -> Iterator[None]:
    """In the block nothing of this folder is touched."""
    WATCH.folder, WATCH.seen = str(folder), []
    sought = ModulesSought()
    sys.meta_path.insert(0, sought)
    try:
        yield
    finally:
        sys.meta_path.remove(sought)
        WATCH.folder = ""
    assert not WATCH.seen
    assert not list(folder.glob("**/touched"))


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is everything that a file could name, and the current one."""
    folder = tmp_path / "trap"
    (folder / "wiring").mkdir(parents=True)
    for module in MODULES:
        (folder / f"{module}.py").write_text(CODE)
    shutil.copytree(folder, folder / "conveyor")
    shutil.copytree(folder / "conveyor", folder / "press")
    (folder / "wiring" / "simulated.toml").write_text('[wire]\ntimer = { driver = "timerfd" }\n')
    (folder / "model.fmu").write_bytes(b"PK")
    monkeypatch.chdir(folder)
    return folder


Job = dict[str, Any]


def of_a_program(job: Job, trap: Path) -> None:
    job |= {"machine": "trap:machine", "application": "trap:main", "path": [str(trap)]}


def of_a_script(job: Job, trap: Path) -> None:
    script = str(trap / "trap.py")
    job |= {"machine": "__umo_main__:machine", "application": "__umo_main__:main", "script": script, "path": []}


def of_a_folder(job: Job, trap: Path) -> None:
    job |= {"station": "trap", "place": str(trap)}


def of_a_folder_by_its_name(job: Job, trap: Path) -> None:
    job |= {"station": "press", "place": ""}


def of_a_path_for_a_name(job: Job, trap: Path) -> None:
    job |= {"station": str(trap), "place": str(trap)}


def of_a_folder_with_the_name_of_a_shipped_one(job: Job, trap: Path) -> None:
    job |= {"place": str(trap / "conveyor")}


def with_a_wiring_file(job: Job, trap: Path) -> None:
    job["wiring"] = {"name": "simulated", "file": str(trap / "wiring" / "simulated.toml"), "text": "x = 1"}


def with_a_wiring_by_a_path(job: Job, trap: Path) -> None:
    job["wiring"] = {"name": str(trap / "wiring" / "simulated.toml")}


def _with_driver(job: Job, **driver: Any) -> None:
    """The station's own wiring with one driver more."""
    file = shipped()["conveyor"] / "wiring" / "simulated.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in driver.items()]
    text = "\n".join([file.read_text(), "[drivers.trap]", *lines])
    job["wiring"] = {"name": "simulated", "file": str(file), "text": text}


def with_a_driver(job: Job, trap: Path) -> None:
    _with_driver(job, type="trap_driver:Driver")


def with_a_driver_of_the_station(job: Job, trap: Path) -> None:
    _with_driver(job, type=".trap_driver:Driver")


def with_a_function_for_a_driver(job: Job, trap: Path) -> None:
    job["wiring"] = {"table": {"wire": {"timer": {"driver": "trap_driver:Driver"}}}}


def with_a_module_named_as_a_driver(job: Job, trap: Path, kind: str = "text") -> None:
    job["wiring"] = {"table": {"wire": {"timer": {"driver": f"{kind}:Driver"}}}}


def with_a_model(job: Job, trap: Path) -> None:
    _with_driver(job, type="fmu", model=str(trap / "model.fmu"))


def with_a_model_as_an_option(job: Job, trap: Path) -> None:
    job["options"] = {"given": {"model": str(trap / "model.fmu")}}
    _with_driver(job, type="fmu")


def with_nonsense(job: Job, trap: Path) -> None:
    job |= {"station": ["trap"], "place": {"a": str(trap)}, "wiring": [str(trap)], "options": str(trap), "files": 7}


ATTACKS = [
    with_a_module_named_as_a_driver, of_a_script, of_a_folder_by_its_name, with_a_driver, with_a_model, of_a_program,
    of_a_folder, of_a_path_for_a_name, of_a_folder_with_the_name_of_a_shipped_one, with_a_wiring_file,
    with_a_wiring_by_a_path, with_a_driver_of_the_station, with_a_function_for_a_driver, with_a_model_as_an_option,
    with_nonsense,
]  # fmt: skip


@pytest.fixture(scope="module")
def conveyor() -> MemoryTape:
    """A short run of the conveyor."""
    tape = recorded("conveyor", stop=0.05)
    tape.recorded = tape.recorded[:1]
    return tape


@pytest.fixture(params=first(4, ATTACKS), ids=lambda attack: attack.__name__)
def attack(request: pytest.FixtureRequest, conveyor: MemoryTape, trap: Path) -> Path:
    return attacking(conveyor, trap, request.param)


def attacking(conveyor: MemoryTape, trap: Path, change: Callable[[Job, Path], None]) -> Path:
    """A recording that names code and files of the trap, in the trap."""
    job = json.loads(json.dumps(dict(conveyor.job)))
    change(job, trap)
    about = conveyor.layout.about
    before = dict(about)
    about |= {"place": str(job.get("place", "")), "twin": True, "options": job.get("options", {})}
    tape = MemoryTape(conveyor.layout, job)
    tape.events, tape.recorded = conveyor.events, conveyor.recorded
    try:
        return save(tape, trap / "attack.mcap")
    finally:
        about.clear()
        about.update(before)


FEW: list[tuple[str, ...]] = [("recording", "info", "FILE"), ("recording", "replay", "FILE")]
MORE: list[tuple[str, ...]] = [
    ("recording", "info", "FILE", "--json"), ("recording", "export", "FILE", "--out", "OUT.npz"),
    ("recording", "export", "FILE", "--out", "OUT.csv"),
    ("show", "why", "--file", "FILE"), ("recording", "replay", "FILE", "--set", "sorter.push_time=0.09"),
    ("recording", "shrink", "FILE", "--for", "1"), ("recording", "shrink", "FILE", "--closed", "--for", "1"),
    ("recording", "shrink", "FILE", "-o", "OUT.py", "--for", "1"), ("recording", "repair", "FILE"),
]  # fmt: skip


@pytest.mark.parametrize("commands", first(1, named(["few", "more"], [FEW, MORE])))
def test_no_reader_of_a_recording_touches_what_it_names(
    umo: Umo, attack: Path, trap: Path, tmp_path: Path, commands: list[tuple[str, ...]]
) -> None:
    with traps(trap):
        for command in commands:
            (tmp_path / "OUT.py").unlink(missing_ok=True)
            words = [{"FILE": str(attack)}.get(word, word.replace("OUT", str(tmp_path / "OUT"))) for word in command]
            done = umo(*words)
            assert done.exit_code in (0, 1, 2), (command, done.output)
            assert "Traceback" not in done.output
        for check in (assert_replays, assert_no_error):
            with suppress(NotReplayable, AssertionError):
                check(attack)
        with Recording(attack) as recording, suppress(NotReplayable):
            recorded_trial(recording)
        with closing(WatchedRecording(Recording(attack))) as viewed:
            told = described_twin(viewed, None)
            assert told is None or "error" in told or viewed.twin_place == shipped()["conveyor"]


@pytest.mark.parametrize("kind", sorted(registry.known()))
@pytest.mark.parametrize("text", ["Driver", "", "Driver:x"])
def test_a_registered_name_stands_for_no_module(conveyor: MemoryTape, trap: Path, kind: str, text: str) -> None:
    """`text:Driver` is the class `Driver` of a module `text`, as the driver `text` has no such form."""
    job = json.loads(json.dumps(dict(conveyor.job)))
    job["wiring"] = {"table": {"wire": {"timer": {"driver": f"{kind}:{text}"}}}}
    with traps(trap), pytest.raises(NotReplayable if kind != "station" else UmoError):
        Program.of(MemoryTape(conveyor.layout, job))


@pytest.mark.parametrize("name", ["press", "./conveyor"])
def test_what_the_command_line_names_is_run(umo: Umo, conveyor: MemoryTape, trap: Path, name: str) -> None:
    """The same traps are touched by the code that is named: the grid above would see it."""
    file = save(conveyor, trap / "run.mcap")
    assert umo("recording", "replay", str(file), name).exit_code == 2  # it has other objects
    assert (Path(name) / "touched").exists()


def test_a_reason_says_what_to_write(conveyor: MemoryTape, trap: Path) -> None:
    def reason(change: Callable[[Job, Path], None]) -> str:
        job = json.loads(json.dumps(dict(conveyor.job)))
        change(job, trap)
        with pytest.raises(NotReplayable) as caught:
            Program.of(MemoryTape(conveyor.layout, job))
        assert len(str(caught.value).splitlines()) == 1
        return str(caught.value)

    assert reason(of_a_folder).endswith(f"(it was in {trap}). umo runs only code that the command line names: add the "
    f"folder of the station")  # fmt: skip
    assert reason(of_a_script).endswith("add trap.py:machine:main")
    assert "the code 'trap_driver:Driver'" in reason(with_a_driver) and "--wiring NAME|FILE" in reason(with_a_driver)
    assert "names a file (model = " in reason(with_a_model)
    assert "--model" in reason(with_a_model_as_an_option)


def test_other_code_is_told(conveyor: MemoryTape, tmp_path: Path) -> None:
    assert Program.of(conveyor).code == ""
    copy = tmp_path / "conveyor"
    shutil.copytree(shipped()["conveyor"], copy, ignore=shutil.ignore_patterns("__pycache__"))
    given = CodeGiven(str(copy))
    assert Program.of(conveyor, given).code == ""
    (copy / "notes.py").write_text("")
    assert Program.of(conveyor, given).code == "", "no run has read it"
    with (copy / "control.py").open("a") as file:
        file.write("\n# another\n")
    assert Program.of(conveyor, given).code == "the code differs from the code of the recorded run (control.py)"


def test_code_that_was_not_hashed_is_not_told_as_the_same(conveyor: MemoryTape) -> None:
    """Of umo 0.2."""
    job = {name: value for name, value in conveyor.job.items() if name != "sources"}
    told = Program.of(MemoryTape(conveyor.layout, job)).code
    assert told.startswith("it is not known whether the code is the code of the recorded run")


def test_files_outside_of_the_folder_of_the_code_are_not_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever a recording says that it had read."""
    seen: list[str] = []
    monkeypatch.setattr(source_files, "digest_of", lambda file: seen.append(file) or "")
    sources: dict[Any, Any] = {
        "/a/press/objects.py": "1",
        "/a/press/../../etc/passwd": "1",
        "/etc/passwd": 2,
        "x": None,
        "": 1,
    }
    assert source_files.other_files({"place": "/a/press", "sources": sources}, tmp_path) == ["objects.py"]
    assert seen == [str(tmp_path / "objects.py")]


PROGRAM = """
from beside import LEVEL
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import next_period
class Oven(Compound):
    heater: DigitalActuator
    timer: DigitalSensor
def make():
    return Oven(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
async def work(m):
    for _ in range(20):
        m.heater.write(LEVEL)
        await next_period()
"""


def test_a_program_is_replayed_by_its_functions(umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    for name, level in (("oven.py", 1.5), ("other.py", 2.5)):
        (tmp_path / "beside.py").write_text("LEVEL = 1.5\n")
        (tmp_path / name).write_text(PROGRAM.replace("LEVEL)", f"{level})"))
    wiring = {"wire": {"timer": {"driver": "simulated", "period": "1 ms"}, "heater": {"driver": "simulated"}}}
    job = RunJob(machine="__umo_main__:make", application="__umo_main__:work", wiring=wiring)
    job.script = str(tmp_path / "oven.py")
    plan = Plan(job)
    connection = connect(plan.machine, plan.wired)
    with connection as m, taped(connection, job_facts(plan)) as tape:
        drive(m, plan.application)
    file = save(tape, tmp_path / "run.mcap")
    refused = umo("recording", "replay", str(file))
    assert refused.exit_code == 2 and refused.stderr.strip().endswith("add oven.py:make:work")
    same = umo("recording", "replay", str(file), f"{tmp_path / 'oven.py'}:make:work")
    assert same.exit_code == 0 and same.stdout.startswith("identical"), same.output
    other = umo("recording", "replay", str(file), f"{tmp_path / 'other.py'}:make:work")
    assert other.exit_code == 1 and "the code differs" in other.stdout, other.output
    assert umo("recording", "replay", str(file), "none.py:make").exit_code == 2
    for number, (before, after) in enumerate([("make()", "make(recipe: Path)"), ("work(m)", "work(m, recipe: Path)")]):
        program = f"from pathlib import Path\n{PROGRAM}".replace("LEVEL)", "1.5)").replace(before, after)
        (tmp_path / f"file{number}.py").write_text(program)
        tape.layout.about["job"] = dict(tape.job) | {"options": {"given": {"recipe": str(tmp_path / "secret.txt")}}}
        named = MemoryTape(tape.layout, tape.layout.about["job"])
        named.events, named.recorded = tape.events, tape.recorded
        asked = umo(
            "recording",
            "replay",
            str(save(named, tmp_path / f"f{number}.mcap")),
            f"{tmp_path}/file{number}.py:make:work",
        )
        assert asked.exit_code == 2 and "had a file as its option --recipe" in asked.stderr, asked.output
    assert_replays(file, f"{tmp_path / 'oven.py'}:make:work")


# Other files of a run ----------------------------------------------------------------------------------


def test_files_beside_a_run_are_data(umo: Umo, trap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`run.json` and `summary.json`, the `recorder.json` of a flight recorder."""
    place = str(trap)
    about = {"station": f"{place}/press", "wiring": place, "options": {"model": place}, "place": place, "script": place,
             "command": [place], "pid": 1, "process": place, "machine": "trap:machine"}  # fmt: skip
    folder = tmp_path / "elsewhere" / "runs" / "press-20260101-000000"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder.parents[1])
    (folder / "run.json").write_text(json.dumps(about))
    (folder / "summary.json").write_text(json.dumps({"state": place, "status": place, "result": {"file": place}}))
    flight = flight_folder.place() / "attack-1"
    flight.mkdir()
    (flight / flight_folder.ABOUT).write_text(json.dumps([place, 1, [1, place]]))
    try:
        with traps(trap):
            assert umo("recording", "runs").exit_code == 0
            list(recorded_runs())
            prune(5, f"{place}/press")
            assert umo("recording", "save", place, str(tmp_path / "saved.mcap")).exit_code in (1, 2)
    finally:
        shutil.rmtree(flight)
    assert trap.is_dir()


def test_a_recording_with_anything_in_its_description_is_told_in_a_line(umo: Umo, tmp_path: Path) -> None:
    jobs: list[Any] = [{"station": None}, {"options": []}, {"wiring": {"text": "[["}}, "x"]
    for number, job in enumerate(jobs):
        layout = layout_of(1, 1, wiring="", job=job)
        path = tmp_path / f"{number}.mcap"
        with closing(RecordingFile(path, layout)) as file:
            file.add([block_at_random(layout, 0, 3, number)])
        for command in ("info", "replay") if number < 2 else ("info",):
            done = umo(command, str(path))
            assert done.exit_code in (0, 2) and "Traceback" not in done.output, (job, command, done.output)
            assert command == "info" or len(done.stderr.strip().splitlines()) <= 2


def test_the_reason_of_an_error_is_never_silent(conveyor: MemoryTape) -> None:
    job: Mapping[str, Any] = dict(conveyor.job) | {"station": "nowhere"}
    with pytest.raises(UmoError, match="neither ships with umo nor is installed"):
        Program.of(MemoryTape(conveyor.layout, job))


def test_a_station_that_a_package_installs_is_found_by_its_recorded_name(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And one of the same name beside the file, in the current folder, is not."""
    installed = tmp_path / "site" / "acme" / "oven"
    beside = tmp_path / "oven"
    for folder, text in ((installed, OVEN), (beside, CODE)):
        folder.mkdir(parents=True)
        (folder / "objects.py").write_text(text)
    (installed / "application.py").write_text(HEATING)
    (installed.parent / "__init__.py").write_text("")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "site")])
    monkeypatch.chdir(tmp_path)
    entry = {"name": "oven", "group": "umo.stations"}
    point, others = EntryPoint(value="acme.oven", **entry), metadata.entry_points
    monkeypatch.setattr(metadata, "entry_points", lambda **which: [point] if which == entry else others(**which))
    file = save(recorded(str(installed)), tmp_path / "run.mcap")
    done = umo("recording", "replay", str(file))
    assert done.exit_code == 0 and done.stdout.startswith("identical"), done.output
    assert not (beside / "touched").exists()
    assert station_module.packaged("kiln") is None


HEATING = """
from umo.control import next_period
async def main(m):
    for number in range(20):
        m.heater.write(number / 10)
        await next_period()
"""


def test_a_station_is_named_for_the_twin_of_a_recording_alone(umo: Umo, trap: Path) -> None:
    done = umo("show", "page", "conveyor", "--station", "conveyor")
    assert done.exit_code == 2 and "--station can only be used with a recording" in done.stderr, done.output


def test_the_twin_of_a_recording_is_that_of_the_named_station(conveyor: MemoryTape, trap: Path) -> None:
    job = dict(conveyor.job) | {"station": "press", "place": str(trap / "press")}
    tape = MemoryTape(conveyor.layout, job)
    tape.events, tape.recorded = conveyor.events, conveyor.recorded
    file = save(tape, trap / "run.mcap")
    with closing(WatchedRecording(Recording(file))) as viewed:
        assert viewed.twin_place is None and not viewed.twin and described_twin(viewed, None) is None
    named = Station("conveyor", shipped()["conveyor"])
    with closing(WatchedRecording(Recording(file), station=named)) as viewed:
        assert viewed.twin_place == shipped()["conveyor"]
        assert str(shipped()["conveyor"]) in viewed.description()["recording"]["replay"]


def test_a_black_box_is_data(umo: Umo, trap: Path, tmp_path: Path) -> None:
    """A file of frames that names the trap as its folder, with all that a recording could name."""
    m = Press(timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False))
    connection, file = connect(m), tmp_path / "box.frames"
    job = {"station": "press", "machine": "trap:machine", "script": str(trap / "trap.py"), "place": str(trap)}
    with connection, published(connection, "press", place=trap, job=job) as frames, Reader(frames.path) as reader:
        periods(m, 5)
        blackbox.save(reader, file, "kept")
    with traps(trap):
        done = umo("show", "why", "--file", str(file))
        assert done.exit_code == 0 and "kept" in done.stdout, done.output


class Press(Compound):
    timer: DigitalSensor
