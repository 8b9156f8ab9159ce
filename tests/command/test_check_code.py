"""`umo check` finds in a station's code, without running it, what shows late or never: and nothing that is right."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import Result

from helpers import shown_code
from helpers.checked_code import own_modules, told
from helpers.machines import TEMPLATE
from umo import Compound
from umo.process.station import Station, find, shipped
from umo_command.check.code_check import mistakes_of

Told = dict[str, list[str]]
"""What is told of each code."""
OBJECTS = '''
from collections.abc import Mapping, Sequence
from typing import Annotated

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock
from umo.control import ServoAxis, wait
from umo.operation import PackML
from umo.states import OnOff, PassFail


class Zone(Compound, equipment=True):
    lamp: BinaryActuator[OnOff]

    async def blink(self) -> None:
        await wait("1 ms")

    def helper(self) -> None:
        """Nothing."""


class Unit(PackML):
    part: Zone

    async def starting(self) -> None:
        {starting}


class Cell(Compound):
    timer: DigitalSensor
    zones: Sequence[Zone]
    named: Mapping[str, Zone]
    spare: Zone | None
    z: ServoAxis
    ready: BinarySensor[PassFail]
    level: DigitalSensor

    def setup(self) -> None:
        self.nearest = self.zones[0]
        self.on_done = None
        self.kept = self.filling = None
        self.zones[0].unit = Unit(self.zones[0])

    async def fill(self) -> float:
        await wait("1 ms")
        return 1.0

    async def full(self) -> bool:
        return True

    @property
    def best(self) -> Zone:
        return self.zones[0]

    def zone(self) -> Zone:
        return self.zones[0]

    def control(self) -> None:
        {control}

    def interlocks(self):
        {interlocks}
        yield Interlock(lambda: self.ready.read() is PassFail.FAIL, [self.zones[0].lamp], "not ready")


def zone() -> Zone:
    return Zone(lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))


def machine() -> Cell:
    numbers = {"gain": 1.0, "velocity": 10.0, "acceleration": 100.0, "jerk": 1000.0, "window": 1.0}
    motor = DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp")
    encoder = DigitalSensor("mm", minimum=-100.0, maximum=100.0, resolution=0.01)
    return Cell(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        zones=[zone(), zone()],
        named={"a": zone()},
        spare=zone(),
        z=ServoAxis(motor=motor, encoder=encoder, following_error=50.0, **numbers),
        ready=BinarySensor(PassFail, one=PassFail.PASS),
        level=DigitalSensor("l", minimum=0.0, maximum=100.0, resolution=0.1),
    )
'''
APPLICATION = """
from __future__ import annotations

from typing import TYPE_CHECKING

import time

import umo.control
from umo import control
from umo.control import Lock, first, move_together, next_period, timeout, together, unless, until, wait
from umo.states import PassFail

if TYPE_CHECKING:
    from .objects import Cell


async def main({parameter}):
    {code}


async def helper(cell: Cell):
    {helper}
"""


def made(folder: Path, code: str = "pass", *, helper: str = "pass", parameter: str = "m", **of_objects: str) -> Station:
    """A station with some code in its application, in a function that it may call, or in its objects."""
    folder.mkdir()
    texts = {"starting": "pass", "control": "pass", "interlocks": "pass"} | of_objects
    objects = OBJECTS
    for name, text in texts.items():
        objects = objects.replace("{" + name + "}", text.replace("\n", "\n        "))
    (folder / "objects.py").write_text(objects)
    application = APPLICATION.replace("{parameter}", parameter).replace("{helper}", helper.replace("\n", "\n    "))
    (folder / "application.py").write_text(application.replace("{code}", code.replace("\n", "\n    ")))
    return find(folder)


@pytest.fixture(autouse=True)
def modules_as_before() -> Iterator[None]:
    with own_modules():
        yield


@pytest.fixture(scope="module")
def in_functions(tmp_path_factory: pytest.TempPathFactory) -> Told:
    """What is told of each of these mistakes. They stand in functions of one station."""
    codes = [*NOT_AWAITED, *(code for code, _ in (*THROUGH, *OTHERS))]
    folder = tmp_path_factory.mktemp("stations")
    station = made(folder / "all", "await wait('1 ms')")
    file = folder / "all" / "application.py"
    lines = [(0, "")]
    for code in codes:
        function = f"\n\nasync def mistaken(m: Cell):\n    {code.replace(chr(10), chr(10) + '    ')}\n"
        file.write_text(file.read_text() + function)
        lines.append((len(file.read_text().splitlines()), code))
    found: dict[str, list[str]] = {code: [] for code in codes}
    with own_modules():
        mistakes = told(station)
    for each in mistakes:
        place, _, text = each.partition(": ")
        line = int(place.partition(":")[2])
        found[next(code for last, code in lines if line <= last)].append(text)
    return found


NOT_AWAITED = [
    "m.z.move_to(80.0)",
    "m.z.home()",
    'wait("1 s")',
    'control.wait("1 s")',
    'umo.control.wait("1 s")',
    "next_period()",
    "until(lambda: True)",
    "unless(lambda: True, m.fill())",
    "together(m.fill(), m.full())",
    'first(m.fill(), wait("1 s"))',
    "move_together((m.z, 3.0))",
    "m.fill()",
    "helper(m)",
    "m.zones[0].blink()",
    'm.named["a"].blink()',
    "m.spare.blink()",
    "m.nearest.blink()",
    "m.best.blink()",
    "m.zone().blink()",
    "m.zones[0].unit.starting()",
    "m.zones[0].unit.part.blink()",
]
"""What makes a sequence, in each way in which code comes to it."""


@pytest.mark.parametrize("call", NOT_AWAITED)
def test_a_sequence_that_nobody_awaits_is_found(in_functions: Told, call: str):
    (found,) = in_functions[call]
    assert found == f"nobody awaits `{call}`, so it does not run; write `await` before it"


THROUGH = [
    ("for each in m.zones:\n    each.blink()", "each.blink()"),
    ("for each in m.named.values():\n    each.blink()", "each.blink()"),
    ("axis = m.z\naxis.move_to(3.0)", "axis.move_to(3.0)"),
    ("filled = m.fill()", "m.fill()"),
    ("m.filling = m.fill()", "m.fill()"),
    ("async def inner():\n    pass\ninner()", "inner()"),
    ("if m.ready.read() is PassFail.PASS:\n    m.fill()", "m.fill()"),
    ("try:\n    m.fill()\nfinally:\n    pass", "m.fill()"),
    ("m.z.move_to(\n    80.0\n)", "m.z.move_to( 80.0 )"),
]
"""The same behind names, loops and blocks."""


@pytest.mark.parametrize(("code", "call"), THROUGH)
def test_it_is_found_through_names_loops_and_blocks(in_functions: Told, code: str, call: str):
    (found,) = in_functions[code]
    assert f"nobody awaits `{call}`" in found


def test_the_line_is_that_of_the_call(tmp_path: Path):
    (found,) = told(made(tmp_path / "cell", "await m.fill()\nm.fill()"))
    assert found.startswith("application.py:19: nobody awaits `m.fill()`")


def test_it_is_found_in_functions_laws_and_states(tmp_path: Path):
    station = made(
        tmp_path / "cell",
        helper="cell.fill()",
        control="self.fill()\nself.nearest.blink()\nreturn self.full()",
        starting="self.part.blink()",
        interlocks="yield Interlock(lambda: self.full(), [self.zones[0].lamp], 'full')",
    )
    places = [re.sub(r":\d+:", ":", each).partition(",")[0] for each in told(station)]
    assert places == [
        "application.py: nobody awaits `cell.fill()`",
        "objects.py: nobody awaits `self.part.blink()`",
        "objects.py: nobody awaits `self.fill()`",
        "objects.py: nobody awaits `self.nearest.blink()`",
        "objects.py: nobody awaits `self.full()`",
        "objects.py: `self.full()` is a sequence",
    ]


def test_an_interlock_that_nobody_gets_is_found(tmp_path: Path):
    guard = "Interlock(lambda: True, [self.zones[0].lamp], 'never')"
    (found,) = told(made(tmp_path / "cell", interlocks=guard))
    assert f"`{guard}` alone does nothing: write `yield {guard}`" in found


OTHERS = [
    ("if m.full():\n    pass", "`m.full()` is a sequence, which is always true: write `await m.full()`"),
    ("while not m.full():\n    pass", "`m.full()` is a sequence, which is always true: write `await m.full()`"),
    ("full = m.full()\nif full:\n    pass", "`full` is a sequence, which is always true: write `await full`"),
    ("assert m.now > 1 or m.full()", "`m.full()` is a sequence, which is always true: write `await m.full()`"),
    ("x = [1 for each in m.zones if each.blink()]\nprint(x)", "`each.blink()` is a sequence, which is always true"),
    ("if m.full() == 1:\n    pass", "`m.full()` is a sequence, not its result: write `await m.full()`"),
    ("if m.ready.read:\n    pass", "`m.ready.read` is not called, and a function is always true"),
    ("if m.level.read is PassFail.PASS:\n    pass", "`m.level.read` is not called, and a function is compared"),
    ("m.z.home", "`m.z.home` is not called, so it does not run: write `m.z.home()`"),
    ("m.nearest.helper", "`m.nearest.helper` is not called, so it does not run"),
    ("await until(m.ready)", "`m.ready` is an object, not a function: write `until(lambda: m.ready.read() is ...)`"),
    ("await until(m.level)", "`m.level` is an object, not a function: write `until(lambda: m.level.read() > ...)`"),
    (
        "await until(m.level.read() > 3.0)",
        "`m.level.read() > 3.0` is evaluated only once, beforehand: write `until(lambda: m.level.read() > 3.0)`",
    ),
    (
        "await unless(not m.ready, m.fill())",
        "`not m.ready` is evaluated only once, beforehand: write `unless(lambda: not m.ready)`",
    ),
    (
        "await until(m.level.read)",
        "`m.level.read` returns a value, not a condition: write `until(lambda: m.level.read() ",
    ),
    ("await m.fill", "`m.fill` is not called: write `await m.fill()`"),
    ("m.fill() if m.now else None", "nobody awaits `m.fill()`"),
    ("m.now and m.fill()", "nobody awaits `m.fill()`"),
    ("[each.blink() for each in m.zones]", "nobody awaits `each.blink()`"),
    ("await together([m.fill(), m.full()])", "give several with a star, `*[m.fill(), m.full()]`"),
    ('with timeout("1 s"):\n    pass', '`with timeout("1 s"):` is refused: write `async with timeout("1 s"):`'),
    ("await until(m.full())", "`m.full()` is a sequence, not a condition: write `await m.full()`"),
    (
        "await until(lambda: m.full())",
        "`m.full()` is a sequence, which is always true: the condition would hold immediately",
    ),
    ("await until(m.full)", "`m.full` is a sequence, which is always true: the condition would hold immediately"),
    ("m.cycle.start(m.fill)", "`m.fill` is not called: write `m.fill()`"),
    ("await together(m.fill(), m.full)", "`m.full` is not called: write `m.full()`"),
    ('timeout("1 s")', '`timeout("1 s")` alone does nothing: write `async with timeout("1 s"):`'),
    ("Lock()", "`Lock()` alone does nothing: write `async with Lock():`"),
    ("time.sleep(1)", "`time.sleep(1)` stops the whole machine: write `await wait(...)` in a sequence"),
    ("import time\ntime.sleep(1)", "`time.sleep(1)` stops the whole machine"),
    ("import time as clock\nclock.sleep(1)", "`clock.sleep(1)` stops the whole machine"),
    ("from time import sleep as rest\nrest(1)", "`rest(1)` stops the whole machine"),
    (
        "while m.level.read() < 3.0:\n    print(m.now)",
        "`m.level.read() < 3.0` does not change while no period passes: write `await until(lambda: ...)`",
    ),
]
"""What else is found, and what is told of it."""


@pytest.mark.parametrize(("code", "text"), OTHERS)
def test_other_mistakes_with_sequences_and_functions_are_found(in_functions: Told, code: str, text: str):
    (found,) = in_functions[code]
    assert text in found


RIGHT = """
await m.z.move_to(80.0)
filling = m.fill()
await filling
each = [m.fill(), m.full()]
await together(*each)
task = m.cycle.start(m.fill())
m.cycle.start(wait("1 s"))
make = lambda: m.fill()
await make()
later = m.fill
await later()
if await m.full():
    pass
full = await m.full()
if full:
    pass
if m.on_done:
    m.on_done()
if m.on_done is None:
    pass
condition = lambda: m.level.read() > 3.0
await until(condition)
await until(lambda: m.ready.read() is PassFail.PASS)
await unless(lambda: m.level.read() > 3.0, m.fill())
await first(m.fill(), wait("1 s"))
motions = {"up": m.z.move_to(3.0)}
await motions["up"]
m.kept = m.fill()
await m.kept
waiting = m.fill() if full else m.full()
await waiting
unknown = getattr(m, "fill")
unknown()
helper = str
helper(m)
m.zone().helper()
m.cycle.tell("done")
while m.level.read() < 3.0:
    await next_period()
while m.level.read() < 3.0:
    break
async with timeout("1 s"):
    pass
while m.level.read() < 3.0:
    print([each async for each in numbers(m)])
import contextlib
with contextlib.suppress(IndexError):
    while True:
        m.filling = [].pop()
try:
    while True:
        m.filling = [].pop()
except IndexError:
    pass
chosen = {"fill": m.fill}["fill"]
if m.fill is chosen or chosen == m.fill or m.fill in {chosen}:
    pass
await until(later or (lambda: True))
await until(m.on_done and later or condition)
started = None
def start():
    nonlocal started
    started = m.fill()
start()
await started
global kept
kept = m.fill()
await other()
""".strip()
BESIDE = """


kept = None


async def other():
    await kept


async def numbers(m: Cell):
    yield 1
"""


def test_what_is_right_or_not_certain_is_not_accused(tmp_path: Path):
    station = made(
        tmp_path / "cell",
        RIGHT,
        control="self.cycle.start(self.fill())\nmake = self.fill\nself.cycle.start(make())",
        helper="return cell.fill()",
    )
    file = station.path / "application.py"
    file.write_text(file.read_text() + BESIDE)
    assert told(station) == []


@pytest.mark.parametrize("parameter", ["m: Cell", "m: Cell, count: int = 1"])
def test_an_annotation_that_only_type_checkers_import_is_known(tmp_path: Path, parameter: str):
    (found,) = told(made(tmp_path / "cell", "m.fill()", parameter=parameter))
    assert "nobody awaits `m.fill()`" in found


@pytest.mark.parametrize("name", [*shipped(), "template"])
def test_the_stations_that_ship_have_none(name: str, tmp_path: Path):
    station = find(name) if name != "template" else find(shutil.copytree(TEMPLATE, tmp_path / "mine"))
    assert told(station) == []


class NoMachine(Compound):
    """In the place of a machine."""


@pytest.mark.slow
def test_no_code_that_is_shown_is_accused(tmp_path: Path):
    """That of README, docs and docstrings; what is shown as a mistake is found."""
    modules = [*shown_code.pages(tmp_path), *shown_code.docstrings(tmp_path)]
    assert len(modules) > 50
    found: list[str] = []
    for module in modules:
        machine = shown_code.machine_of(module)
        main = None if machine is None else getattr(module, "main", None)
        found += [str(each) for each in mistakes_of([module], machine or NoMachine(), main)]
        del sys.modules[module.__name__]
    (of_sequences,) = found
    assert re.search(r"docs_howto_sequences.py:\d+: nobody awaits `fill\(m, 60.0\)`", of_sequences)


def test_check_prints_them_and_ends_with_the_status_of_a_mistake(tmp_path: Path, umo: Callable[..., Result]):
    made(tmp_path / "cell", "m.fill()\nawait wait('1 ms')")
    result = umo("check", "cell")
    assert result.exit_code == 2
    assert "application.py:18: nobody awaits `m.fill()`" in " ".join(result.stderr.split())
    assert "ok: everything simulated" in result.stdout
    assert result.stderr.splitlines()[-1] == "umo: 1 error in the code"


def test_a_machine_whose_setup_forgets_an_await_is_not_made(tmp_path: Path, umo: Callable[..., Result]):
    station = made(tmp_path / "cell", "await wait('1 ms')")
    file = station.path / "objects.py"
    file.write_text(file.read_text().replace("self.on_done = None", "self.on_done = None\n        self.fill()"))
    result = umo("run", "cell", "--no-record", "--no-plot")
    assert result.exit_code != 0
    assert "in setup: nobody awaits `self.fill()`" in " ".join(result.stderr.split())


def test_a_run_of_such_a_station_fails_at_the_same_line(tmp_path: Path, umo: Callable[..., Result]):
    made(tmp_path / "cell", "m.fill()\nawait wait('1 ms')")
    result = umo("run", "cell", "--no-record", "--no-plot")
    assert result.exit_code == 1
    said = " ".join((result.stdout + result.stderr).split())
    assert "application.py:18 in main: nobody awaits `m.fill()`" in said
    assert said.endswith("(at 0.001 s)")
