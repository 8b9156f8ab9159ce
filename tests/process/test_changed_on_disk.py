"""A station whose wiring, code or recipes on disk differ from what runs is told by whoever asks, with the files."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import Result

import umo as umo_package
from helpers.waiting import until
from umo import connect, published
from umo.cycle.stage import Stage
from umo.process import source_files
from umo.process.frames import Reader
from umo.process.job import Job, Plan
from umo.process.job_facts import job_facts
from umo.process.named_files import named_files
from umo.process.source_files import ChangedFile, changed_files, changed_text, other_files
from umo.system import packages
from umo.testing import periods

Umo = Callable[..., Result]
OBJECTS = """
from .laws import GAIN
from umo import Compound, DigitalActuator, DigitalSensor


class Press(Compound):
    heater: DigitalActuator
    timer: DigitalSensor

    def setup(self):
        from . import later  # imported when the machine is connected

    def control(self):
        if self.heater.read() > 9.0:
            from . import recipes  # not in this test
            from .tables import curve

            curve.read("curve.csv")


def machine():
    return Press(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.5),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
WIRING = """[wire]
"heater" = { driver = "simulated" }
"timer" = { driver = "simulated", period = "10 ms" }
"""
FORMER = "it runs the former {}, which has changed on disk since the start; the next run takes it as it is now"


@pytest.fixture
def press(umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of a station that runs in this process, as `umo run --realtime` publishes it."""
    folder = tmp_path / "press"
    (folder / "wiring").mkdir(parents=True)
    files = {
        "objects.py": OBJECTS,
        "laws.py": "GAIN = 1.0\n",
        "later.py": "",
        "unused.py": "",
        "recipes.py": "",
        "tables/__init__.py": "",
        "tables/curve.py": "def read(name): ...",
        "curve.csv": "1, 2",
        "unused.csv": "3, 4",
        "wiring/rig.toml": WIRING,
    }
    (folder / "tables").mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    for name in [name for name in sys.modules if name.startswith(packages.PREFIX)]:
        monkeypatch.delitem(sys.modules, name)
    plan = Plan(Job(station=str(folder)))
    connection = connect(plan.machine, plan.wired)
    with (
        connection as machine,
        published(connection, plan.name, plan.wiring_name, place=plan.place, job=job_facts(plan)) as ring,
    ):
        periods(machine, 3)
        assert ring.path is not None
        yield folder


def running() -> Reader:
    from umo.process.frames.search import find_running

    return find_running("press")


def changed() -> list[ChangedFile]:
    with running() as reader:
        return changed_files(reader.about)


def test_a_run_tells_the_files_that_it_has_read_and_no_others(press: Path) -> None:
    with running() as reader:
        known = reader.about["job"]["sources"]
    own = {Path(file).relative_to(press).as_posix() for file in known if Path(file).is_relative_to(press)}
    assert own == {"objects.py", "laws.py", "later.py", "wiring/rig.toml"}
    assert not any("site-packages" in file for file in known)
    assert not any(file.endswith("umo/cycle/connect.py") for file in known)


def test_a_file_that_was_touched_or_written_as_it_was_tells_nothing(press: Path) -> None:
    assert changed() == []
    os.utime(press / "laws.py", (1, 1))
    (press / "wiring" / "rig.toml").write_text(WIRING)
    (press / "unused.py").write_text("more = 1")
    assert changed() == []


@pytest.mark.parametrize("name", ["wiring/rig.toml", "objects.py", "laws.py", "later.py"])
def test_a_file_that_was_changed_is_named(press: Path, name: str) -> None:
    before = (press / name).read_text()
    (press / name).write_text(f"{before}# changed\n")
    assert changed() == [ChangedFile(name, False)]
    (press / name).write_text(before)
    assert changed() == []


@pytest.mark.parametrize("name", ["recipes.py", "tables/curve.py", "curve.csv"])
def test_a_file_that_the_code_names_and_may_have_read_is_named_so(press: Path, name: str) -> None:
    (press / name).write_text("5, 6 # changed")
    assert changed() == [ChangedFile(name, False, is_read=False)]
    assert changed_text(changed()) == FORMER.format(name).replace("runs", "may have read")


def test_a_replay_is_told_of_files_that_the_code_names(press: Path) -> None:
    with running() as reader:
        job = reader.about["job"]
    assert other_files(job, press) == []
    (press / "curve.csv").write_text("5, 6")
    assert other_files(job, press) == ["curve.csv"]


def test_a_file_of_the_folder_that_no_code_names_does_not_count(press: Path) -> None:
    for name in ("unused.csv", "unused.py"):
        (press / name).write_text("changed = 1")
    assert changed() == []


def test_code_that_cannot_be_read_names_no_files(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("open('curve.csv'")
    (tmp_path / "curve.csv").write_text("1, 2")
    assert named_files([str(tmp_path / "broken.py"), str(tmp_path / "gone.py")], tmp_path) == []


def test_a_file_outside_of_the_folder_is_not_looked_for(tmp_path: Path) -> None:
    (tmp_path / "station").mkdir()
    (tmp_path / "secret.csv").write_text("1, 2")
    (tmp_path / "station" / "laws.py").write_text("open('../secret.csv'); open('/etc/hosts.allow'); open('.')")
    assert named_files([str(tmp_path / "station" / "laws.py")], tmp_path / "station") == []


def test_a_name_in_a_folder_that_may_not_be_looked_at_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stat = os.stat

    def refused(path: Any, *words: Any, **more: Any) -> os.stat_result:
        if str(path).startswith("/secret/"):
            raise PermissionError(13, "Permission denied", str(path))
        return stat(path, *words, **more)

    (tmp_path / "laws.py").write_text('TABLES = "/secret/table.csv", "near.csv"\n')
    (tmp_path / "near.csv").touch()
    monkeypatch.setattr(os, "stat", refused)
    assert named_files([str(tmp_path / "laws.py")], tmp_path) == [str(tmp_path / "near.csv")]


def test_a_file_of_the_same_length_and_time_is_seen_to_differ_by_its_content(press: Path) -> None:
    file = press / "laws.py"
    times = file.stat().st_atime_ns, file.stat().st_mtime_ns
    (press / "new.py").write_text("GAIN = 2.0\n")
    os.utime(press / "new.py", ns=times)
    (press / "new.py").replace(file)  # as an editor does
    assert changed() == [ChangedFile("laws.py", False)]


def test_a_file_that_is_changed_in_its_place_and_given_its_former_time_differs(press: Path) -> None:
    file = press / "laws.py"
    assert changed() == []  # its content is known to whoever asks
    before, text = file.stat(), file.read_text()
    file.write_text(text.replace("1", "2"))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert changed() == [ChangedFile("laws.py", False)]


@pytest.mark.parametrize("change", ["longer", "earlier"])
def test_of_a_large_file_the_beginning_and_the_size_count(
    press: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    monkeypatch.setattr(source_files, "MAX_FILE_BYTES", 10)
    file = press / "large.py"
    file.write_text("0123456789 and more")
    before = source_files.digest_of(str(file))
    file.write_text("0123456789 and much more" if change == "longer" else "0123456780 and more")
    assert source_files.digest_of(str(file)) != before


def test_a_file_that_is_gone_is_told_so(press: Path) -> None:
    (press / "laws.py").unlink()
    assert changed() == [ChangedFile("laws.py", True)]
    assert changed_text(changed()) == FORMER.format("laws.py (gone)")


def test_a_run_on_another_computer_is_not_compared_with_this_disk(press: Path) -> None:
    (press / "laws.py").unlink()
    with running() as reader:
        about = dict(reader.about)
    assert changed_files(about | {"job": about["job"] | {"host": "another"}}) == []
    assert changed_files({name: fact for name, fact in about.items() if name != "job"}) == []
    assert changed_files(about | {"job": {"error": "it could not be told"}}) == []


def said(result: Result) -> str:
    assert result.exit_code == 0, result.output
    return " ".join(f"{result.stdout} {result.stderr}".split())


def test_ps_get_and_check_tell_it(umo: Umo, press: Path) -> None:
    commands: list[tuple[str, ...]] = [
        (
            "show",
            "stations",
        ),
        ("device", "get", "press", "heater"),
        ("check", "press"),
    ]
    assert not any("former" in said(umo(*words)) for words in commands)
    (press / "laws.py").write_text("GAIN = 2.0\n")
    assert f"press: {FORMER.format('laws.py')}" in said(umo("show", "stations"))
    assert FORMER.format("laws.py") in said(umo("device", "get", "press", "heater"))
    assert f"note: press is running (pid {os.getpid()}): {FORMER.format('laws.py')}" in said(umo("check", "press"))
    (listed,) = json.loads(umo("show", "stations", "--json").stdout)["running"]
    assert listed["changed"] == ["laws.py"]


def test_several_files_are_told_in_one_sentence(press: Path) -> None:
    for name in ("laws.py", "wiring/rig.toml"):
        (press / name).write_text("# changed")
    assert changed_text(changed()) == (
        "it runs the former wiring/rig.toml and laws.py, which have changed on disk since the start; "
        "the next run takes them as they are now"
    )


def test_the_page_tells_it(press: Path) -> None:
    from umo.clients.page.watched_run import Watched

    def told(watched: Watched) -> Any:
        watched.look_around()
        watched.read()
        watched.number += 1
        return json.loads(watched.state(full=True))["facts"]["changed"], watched.line().get("changed")

    watched = Watched(running())
    try:
        assert told(watched) == ("", None)
        (press / "laws.py").write_text("GAIN = 2.0\n")
        assert told(watched) == (FORMER.format("laws.py"),) * 2
    finally:
        watched.close()


def test_the_recipes_that_a_machine_has_read_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = Plan(Job(station="batch"))
    recipes = [Path(file).name for file in plan.sources if "/recipes" in file]
    assert recipes
    assert any(file.endswith("batch/control.py") for file in plan.sources)  # it ships with umo, and is a station


class Lazy(ModuleType):
    """A module that is imported as soon as it is asked for anything, as LazyLoader of importlib makes them."""

    def __getattribute__(self, name: str) -> object:
        raise AssertionError(f"asked for {name}")


def test_a_module_that_waits_for_its_import_is_not_imported_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lazy_for_this_test", Lazy("lazy_for_this_test"))
    assert Plan(Job(station="conveyor")).sources


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")
def test_a_run_in_processes_of_its_own_tells_the_files_that_these_have_read(tmp_path: Path) -> None:
    (tmp_path / "press").mkdir()
    for name, text in {"objects.py": OBJECTS, "laws.py": "GAIN = 1.0\n", "later.py": ""}.items():
        (tmp_path / "press" / name).write_text(text)
    with umo_package.start(tmp_path / "press", realtime=True) as started:
        until(lambda: started.stage is Stage.RUNNING and started.frames is not None)
        assert started.frames is not None
        about = started.frames.about
        assert changed_files(about) == []
        (tmp_path / "press" / "later.py").write_text("a = 1")
        (tmp_path / "press" / "laws.py").write_text("GAIN = 2.0\n")
        assert {each.path for each in changed_files(about)} == {"later.py", "laws.py"}


def test_a_file_that_changes_while_the_devices_are_opened_has_changed_and_a_module_imported_then_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in {"objects.py": OBJECTS, "laws.py": "GAIN = 1.0\n", "later.py": "", "device.py": ""}.items():
        (tmp_path / name).write_text(text)
    plan = Plan(Job(station=str(tmp_path)))
    (tmp_path / "laws.py").write_text("GAIN = 2.0\n")
    monkeypatch.setitem(sys.modules, "device_of_this_test", module := ModuleType("device_of_this_test"))
    module.__file__ = str(tmp_path / "device.py")
    about: dict[str, Any] = {"place": str(tmp_path), "job": job_facts(plan)}
    assert str(tmp_path / "device.py") in about["job"]["sources"]
    assert [each.path for each in changed_files(about)] == ["laws.py"]
