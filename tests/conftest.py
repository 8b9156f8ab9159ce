"""What all tests share: hypothesis without deadlines (the machines that run this are shared), image forms, `umo`."""

import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.machinery import PathFinder
from itertools import count, islice
from pathlib import Path

import pytest
import typer.testing
from hypothesis import HealthCheck, settings
from typer.testing import CliRunner, Result

from umo.process import source_files
from umo.system import packages
from umo_command.app import app

# Hundreds of processes import umo, and each worker all tests, in which pytest rewrites the asserts: that is done once.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
pytest.register_assert_rewrite("helpers")
from helpers import tiers  # noqa: E402
from helpers.conversions import CHOSEN_FIRST, choose  # noqa: E402
from helpers.tiers import first  # noqa: E402

ROOMS = {each.name for each in Path(__file__).parent.iterdir() if each.is_dir()}
HERE = f"{Path(__file__).parent}{os.sep}"


class NoRooms:
    """Keeps the folders of the tests, which have names of a station's modules (`objects`, `control`), from being taken
    for packages without an `__init__`: one would stay in place of the module of the next test."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name in ROOMS and (found := PathFinder.find_spec(name)) is not None and found.origin is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, NoRooms)  # type: ignore[arg-type]
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a shell; programs of the tests inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):  # under nohup
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
FOLDERS = tempfile.TemporaryDirectory(prefix="umo-tests-")
TESTS = count()
"""The numbers of the tests of this process."""
os.environ |= {name: str(Path(FOLDERS.name, name)) for name in ("UMO_STATE", "UMO_FRAMES")}
if "COMPILED_BY" not in os.environ and (cc := shutil.which("cc")) and os.name == "posix":
    # The runtime of umo is compiled once, not with each of 100 machines. Workers have these from the session.
    once = {"COMPILED_BY": cc, "COMPILED_ONCE": str(Path(FOLDERS.name, "compiled"))}
    os.environ |= {**once, "PATH": f"{HERE}helpers/once{os.pathsep}{os.environ['PATH']}"}
for tier, examples in (("quick", 25), ("full", 100)):
    settings.register_profile(tier, deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=examples)
settings.load_profile("full")
# typer makes all of a command line from its functions at each call of the runner, which takes 50 ms.
typer.testing._get_command = cache(typer.testing._get_command)
# A run hashes the modules that are imported and are neither umo's nor installed: not those of all tests, each time.
imported = source_files._modules
source_files._modules = lambda: (file for file in imported() if not (file.startswith(HERE) and "/test_" in file))


LIMITS = {None: 60, "slow": 180, "full": 900}
"""s that a test with this mark may take on a busy computer (pytest-timeout)."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shard", metavar="K/N", default="1/1", help="run the K-th of N parts of the test modules")


def pytest_configure(config: pytest.Config) -> None:
    """Before any module of tests is imported. Garbage is not collected meanwhile: there is little, and to look for it
    takes a third of the time."""
    gc.disable()
    tiers.choose(config.option.markexpr)
    if config.option.markexpr == tiers.QUICK:
        settings.load_profile("quick")


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    return tiers.LeftOut.from_parent(parent, path=module_path) if tiers.is_left_out(module_path) else None


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(name: str, obj: object) -> list[pytest.Item] | None:
    return [] if name.startswith(("test", "Test")) and tiers.is_test_left_out(obj) else None


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "each_way" in metafunc.fixturenames:
        metafunc.parametrize("each_way", first(1, CHOSEN_FIRST), indirect=True)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """When -m and -k have left out what is not to run."""
    part, parts = map(int, config.getoption("--shard").split("/"))
    files = set(sorted({item.path for item in items})[part - 1 :: parts])
    config.hook.pytest_deselected(items=[item for item in items if item.path not in files])
    items[:] = [item for item in items if item.path in files]
    slow: dict[pytest.Item, None] = {}
    for item in items:
        marks = {mark.name: mark for mark in reversed([*item.iter_markers()])}
        if "slow" in marks:
            slow[item] = None
        own = marks.get("timeout")
        if own is None or not own.args:
            limit = max(limit for mark, limit in LIMITS.items() if mark is None or mark in marks)
            item.add_marker(pytest.mark.timeout(limit, **own.kwargs) if own else limited_to(limit), append=False)
    in_good_order(items, slow)


@cache
def limited_to(limit: int) -> pytest.MarkDecorator:
    """One mark for thousands of tests."""
    return pytest.mark.timeout(limit)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(10_000)  # in place of 700 objects
    gc.enable()


def in_good_order(items: list[pytest.Item], slow: Mapping[pytest.Item, object]) -> None:
    """The slow ones first (xdist begins with equal parts of the list): none is left over for the end. Every second
    process has none of them, as slow tests wait most of their time. Those of a file stay together, as they share
    fixtures."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    quick = iter([item for item in items if item not in slow])
    turns = {path: 2 * turn % workers for turn, path in enumerate(dict.fromkeys(item.path for item in slow))}
    size, ordered = -(-len(items) // workers), []
    for worker in range(workers):
        first = [item for item in slow if turns[item.path] == worker]
        ordered += [*first, *islice(quick, max(0, size - len(first)))]
    items[:] = [*ordered, *quick]


@pytest.fixture(scope="module", autouse=True)
def nothing_to_collect() -> None:
    """What the tests before have left, and the modules of all tests, is not looked through by any collection of garbage
    in this module: each took up to a second."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def each_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs with each way of converting: with that of this computer in make test, where test_conversion.py
    finds the other one equal to it; with both in make test-all."""
    choose(monkeypatch, request.param)


@pytest.fixture
def many_descriptors() -> Iterator[None]:
    """More than 1,024 are open, beyond what select(2) can watch."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] < 2048:
        pytest.skip("this computer does not let a process open so many")
    resource.setrlimit(resource.RLIMIT_NOFILE, (2048, before[1]))
    taken = [os.open(os.devnull, os.O_RDONLY) for _ in range(1025)]
    try:
        yield
    finally:
        for file in taken:
            os.close(file)
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


@pytest.fixture(autouse=True)
def own_folders(monkeypatch: pytest.MonkeyPatch) -> None:
    """What umo keeps of runs and shows of running machines goes to folders of the test, not to the user's. They are
    made by the tests that need them: a folder for each of 8,000 tests takes 10 s of processor time."""
    number = next(TESTS)
    monkeypatch.setenv("UMO_STATE", str(Path(FOLDERS.name, f"state-{number}")))
    monkeypatch.setenv("UMO_FRAMES", str(Path(FOLDERS.name, f"frames-{number}")))


@pytest.fixture
def umo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Result]:
    """The command, run in an empty folder; a station's modules do not outlive the call."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> Result:
        with monkeypatch.context() as patch:
            patch.setattr(sys, "path", list(sys.path))
            for name in [name for name in sys.modules if name.startswith(packages.PREFIX)]:
                patch.delitem(sys.modules, name)
            return CliRunner().invoke(app, list(words))

    return call


@pytest.fixture
def tank(umo: Callable[..., Result], tmp_path: Path) -> Path:
    """A new station."""
    assert umo("new", "station", "tank").exit_code == 0
    return tmp_path / "tank"
