"""`umo check` finds in a station's code, without running it, what is never equal and what no object has."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.checked_code import own_modules, told
from umo.process.station import Station, find

OBJECTS = """
from collections.abc import Mapping, Sequence

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor
from umo.control import Servo
from umo.operation import PackML
from umo.states import OnOff, OpenClosed, PassFail


class Unit(PackML):
    weight = 0.0


class Zone(Compound, equipment=True):
    lamp: BinaryActuator[OnOff]
    limit: float = 3.0

    def setup(self) -> None:
        self.unit = Unit(self)


class Hot(Zone):
    hottest: float = 3.0


class Burning(Zone):
    burner: BinaryActuator[OnOff]


class Cell(Compound):
    timer: DigitalSensor
    zones: Sequence[Zone]
    named: Mapping[str, Zone]
    ready: BinarySensor[PassFail]
    valve: BinaryActuator[OpenClosed]
    lamps: Mapping[str, BinaryActuator[OnOff]]
    level: DigitalSensor
    heater: DigitalActuator
    spare: DigitalActuator | None = None
    target: float = 20.0

    def setup(self) -> None:
        self.servo = Servo(self.level, self.heater, gain=1.0)
        self.nearest = self.zones[0]
        self.count = 0
        self.chosen = self.valve
        self.last = self.level
        self.settings = {"a": 3.0}

    def control(self) -> None:
        {control}


def zone(kind=Zone):
    return kind(lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))


def machine() -> Cell:
    return Cell(
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
        zones=[zone(), zone(Hot)],
        named={"a": zone()},
        ready=BinarySensor(PassFail, one=PassFail.PASS),
        valve=BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED),
        lamps={"red": BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF)},
        level=DigitalSensor("l", minimum=0.0, maximum=100.0, resolution=0.1),
        spare=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.1),
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.1),
    )
"""
APPLICATION = """
from umo.control import state_of, until, wait
from umo.states import OnOff, OpenClosed, PassFail

from .objects import Cell

{before}
async def main(m):
    {code}


async def helper(cell: Cell):
    {helper}
"""


def made(folder: Path, code: str = "pass", *, helper: str = "pass", control: str = "pass", before: str = "") -> Station:
    """A station with some code in its application, in a function that it may call, or in its objects."""
    folder.mkdir()
    (folder / "objects.py").write_text(OBJECTS.replace("{control}", control.replace("\n", "\n        ")))
    text = APPLICATION.replace("{before}", before)
    for name, given in (("{code}", code), ("{helper}", helper)):
        text = text.replace(name, given.replace("\n", "\n    "))
    (folder / "application.py").write_text(text)
    return find(folder)


@pytest.fixture(autouse=True)
def modules_as_before() -> Iterator[None]:
    with own_modules():
        yield


OF_READY = (
    "is a state of PassFail, and is never equal to OpenClosed.OPEN: write `is PassFail.PASS` or `is PassFail.FAIL`"
)


def test_a_state_of_another_type_is_found(tmp_path: Path) -> None:
    states, signs = ("state_of(m.ready)", "m.ready.read()", "each"), ("is", "is not", "==", "!=")
    tests = [f"if {state} {sign} OpenClosed.OPEN:\n    await wait('1 s')" for state in states for sign in signs]
    found = told(made(tmp_path / "cell", "\n".join(["each = m.ready.read()", *tests])))
    expected = [state for state in states for _ in signs]
    assert found == [f"application.py:{9 + 2 * n + 1}: `{state}` {OF_READY}" for n, state in enumerate(expected)]


NEVER_EQUAL = [
    ("m.valve.read() is OnOff.ON", "`m.valve.read()` is a state of OpenClosed, and is never equal to OnOff.ON"),
    ("m.valve.pending is OnOff.ON", "`m.valve.pending` is a state of OpenClosed"),
    ("m.valve.read() is True", "never equal to True: write `is OpenClosed.OPEN` or `is OpenClosed.CLOSED`"),
    ("m.valve.read() == 'open'", "never equal to 'open': write `is OpenClosed.OPEN`"),
    ("1 == m.valve.read()", "`m.valve.read()` is a state of OpenClosed, and is never equal to 1"),
    ("OnOff.ON is m.valve.read()", "`m.valve.read()` is a state of OpenClosed, and is never equal to OnOff.ON"),
    ("m.ready.read() in (OpenClosed.OPEN, PassFail.PASS)", "`m.ready.read()` " + OF_READY),
    ("m.ready.read() not in {OpenClosed.OPEN}", "`m.ready.read()` " + OF_READY),
    ("m.zones[0].lamp.read() is OpenClosed.OPEN", "`m.zones[0].lamp.read()` is a state of OnOff"),
    ("m.named['a'].lamp.read() is OpenClosed.OPEN", "is a state of OnOff, and is never equal to OpenClosed.OPEN"),
    ("m.nearest.lamp.read() is OpenClosed.OPEN", "is a state of OnOff, and is never equal to OpenClosed.OPEN"),
    ("[z for z in m.zones if z.lamp.read() is PassFail.PASS]", "`z.lamp.read()` is a state of OnOff"),
    ("await until(lambda: m.ready.read() is OpenClosed.OPEN)", "`m.ready.read()` " + OF_READY),
    ("m.valve is OpenClosed.OPEN", "an object, not its state: write `m.valve.read() is OpenClosed.OPEN`"),
    ("m.ready == 1", "not its state: write `m.ready.read() is PassFail.PASS` or `m.ready.read() is PassFail.FAIL`"),
    ("m.ready.read() is m.valve.read()", "a state of PassFail and is compared with a state of OpenClosed"),
    ("3 < m.level", "`m.level` is an object, not its value: write `m.level.read() > 3`"),
    ("0 <= m.level.read() <= m.level <= 5", "`m.level` is an object, not its value: write `m.level.read() <= 5`"),
    ("m.level > 3", "`m.level` is an object, not its value: write `m.level.read() > 3`"),
    ("1 if m.ready else 0", "`m.ready` is an object, which is always true: write `m.ready.read() is ...`"),
    ("1 if not m.level else 0", "`m.level` is an object, which is always true: write `m.level.read() > ...`"),
    ("m.level is 3.5", "`m.level` is an object, not its value: write `m.level.read() == 3.5`"),
    ("m.level.read() is PassFail.PASS", "`m.level.read()` is a number, and is never equal to PassFail.PASS"),
    (
        "1 if m.ready.read() else 0",
        "neither true nor false: write `m.ready.read() is PassFail.PASS` or `m.ready.read()",
    ),
    ("[z for z in m.zones if not z.lamp.read()]", "`z.lamp.read()` is a state, which is neither true nor false"),
    ("await until(lambda: m.ready.read())", "`m.ready.read()` is a state, which is neither true nor false"),
    ("await until(lambda: m.ready)", "`m.ready` is an object, which is always true"),
    ("m.valve.write(OnOff.ON)", "it takes OpenClosed.OPEN or OpenClosed.CLOSED, not OnOff.ON"),
    ("m.heater.write(OnOff.ON)", "`m.heater.write(OnOff.ON)`: it takes a number in its unit, not OnOff.ON"),
    ("m.heater.write(m.level)", "an object is written, not its value: write `m.level.read()`"),
    ("OpenClosed.OPN", "`OpenClosed.OPN`: OpenClosed has no state 'OPN' (did you mean 'OPEN'?)"),
]


@pytest.mark.filterwarnings("ignore::SyntaxWarning")
def test_what_is_never_equal_is_found(tmp_path: Path) -> None:
    found = told(made(tmp_path / "cell", "\n".join(f"x = {code}" for code, _ in NEVER_EQUAL)))
    assert len(found) == len(NEVER_EQUAL)
    for line, (told_, (code, text)) in enumerate(zip(found, NEVER_EQUAL, strict=True), 9):
        assert told_.startswith(f"application.py:{line}: "), code
        assert text in told_


def test_the_cases_of_a_match_are_looked_at(tmp_path: Path) -> None:
    code = (
        "match m.ready.read():\n    case PassFail.PASS | OpenClosed.OPEN:\n        pass\n    case True:\n        pass"
    )
    found = told(made(tmp_path / "cell", code))
    assert [re.search(r"never equal to (\S+):", each)[1] for each in found] == ["OpenClosed.OPEN", "True"]  # type: ignore[index]


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("m.tagret = 100.0", "`m.tagret`: Cell has no attribute 'tagret' (did you mean 'target'?)"),
        ("m.servo.gian = 3.0", "`m.servo.gian`: Servo has no attribute 'gian' (did you mean 'gain'?)"),
        ("m.zones[0].limt = 1.0", "Hot and Zone has no attribute 'limt' (did you mean 'limit'?)"),
        ("for each in m.zones:\n    each.limt = 1.0", "has no attribute 'limt' (did you mean 'limit'?)"),
        ("m.zones[0].unit.prodced += 1", "Unit has no attribute 'prodced' (did you mean 'produced'?)"),
        ("print(m.lvel.read())", "`m.lvel`: Cell has no attribute 'lvel' (did you mean 'level'?)"),
        ("m.valve.wirte(OpenClosed.OPEN)", "has no attribute 'wirte' (did you mean 'write'?)"),
        ("m.valve.state = OpenClosed.OPEN", "no attribute 'state'; its value is written: `valve.write(...)`"),
        ("print(m.valve.state is OpenClosed.OPEN)", "has no attribute 'state' (did you mean 'read()'?)"),
    ],
)
def test_an_attribute_that_nothing_has_is_found(tmp_path: Path, code: str, text: str) -> None:
    (found,) = told(made(tmp_path / "cell", code))
    assert text in found


def test_functions_with_annotations_and_laws_are_looked_at(tmp_path: Path) -> None:
    station = made(
        tmp_path / "cell",
        helper="cell.tagret = 3.0",
        control="if self.ready.read() is OpenClosed.OPEN:\n    self.servo.gian = 1.0",
    )
    assert [each.partition(":")[0] for each in told(station)] == ["application.py", "objects.py", "objects.py"]


RIGHT = """
if m.ready.read() is PassFail.PASS and m.valve.pending is not OpenClosed.OPEN:
    m.target = 3.0
if m.zones[0].lamp.read() in (OnOff.ON, OnOff.OFF) and m.level.read() > 3:
    m.servo.gain = m.servo.integral = 1.0
last = None
if m.ready.read() is last or last is PassFail.PASS:
    last = m.ready.read()
for each in (m.ready, m.valve):
    print(each.read() is OpenClosed.OPEN, each.path)
for zone in m.zones:
    zone.unit.produced += 1
    if hasattr(zone, "special"):
        zone.special = 1
    zone.hottest = 4.0
m.count += 1
m.servo.control(3.0, dt=m.dt)
m.nearest = m.zones[1]
m._own = 1
if m.valve is m.ready or m.valve is None:
    pass
if m.spare or m.named or m.spare is None:
    pass
match m.ready.read():
    case PassFail.PASS:
        pass
    case None:
        pass
other = m if m.count else None
other.anything = 1
state = m.ready.read()
state = 3
if state == 3:
    pass
print(m.cycle.running, m.now, m.dt, m.zones[0].unit.model, m.level.velocity)
""".strip()


def test_what_is_right_or_not_certain_is_not_accused(tmp_path: Path) -> None:
    assert told(made(tmp_path / "cell", RIGHT, helper="cell.target = 1.0")) == []


MAY_BE = """
async def optional(valve: BinaryActuator[OpenClosed] | None = None, level: DigitalSensor | None = None) -> None:
    if valve:
        valve.write(OpenClosed.OPEN)
    other = level
    if other and level:
        pass


async def narrowed(zone: Zone) -> None:
    if isinstance(zone, Burning):
        zone.burner.write(OnOff.ON)


async def of_changing(m: Cell) -> None:
    if m.chosen:
        m.chosen = None
    if m.last == 3.0:
        m.last = 3.0


async def keys(m: Cell) -> None:
    for key in m.named:
        print(key.upper())
    print([lamp for lamp in m.lamps if lamp == "red"])


async def patterns(m: Cell) -> None:
    match m.level:
        case DigitalSensor(unit="l"):
            pass
    match (m.ready.read(), m.valve.read()):
        case (PassFail.PASS, OpenClosed.OPEN) | (PassFail.FAIL, OpenClosed.CLOSED):
            pass


async def bound_elsewhere(m: Cell) -> None:
    level = m.level

    def read() -> None:
        nonlocal level
        level = level.read()

    read()
    if level == 3.0:
        pass
    print("%s" % m.level)
    m.chosen.write(OnOff.ON)
    m.heater.write(m.last.read())
    await until(lambda: m.chosen)


async def bound_in_other_ways(m: Cell) -> None:
    level = m.level
    async for level in numbers(m):
        print(level == 3.0)
    valve = m.valve
    print([valve == 1 for valve, _ in [(1, 2)]])
    match m.settings:
        case {"a": 3.0, **level}:
            print(level == {})


async def numbers(m: Cell):
    yield 3.0
"""


def test_what_may_be_something_else_is_not_accused(tmp_path: Path) -> None:
    imports = "from umo import BinaryActuator, DigitalSensor\nfrom .objects import Burning, Zone\n"
    assert told(made(tmp_path / "cell", before=imports + MAY_BE)) == []


def test_the_values_of_a_mapping_are_looked_at_and_its_keys_are_not(tmp_path: Path) -> None:
    loop = "for lamp in m.lamps.values():\n    print(lamp == 1, lamp.read() is PassFail.PASS)"
    assert len(told(made(tmp_path / "cell", f"{loop}\nprint(m.lamps['red'] == 1)"))) == 3


def test_the_states_in_a_tuple_of_a_match_are_looked_at(tmp_path: Path) -> None:
    code = "match (m.ready.read(), m.valve.read()):\n    case (PassFail.PASS, PassFail.PASS):\n        pass"
    (found,) = told(made(tmp_path / "cell", code))
    assert "`m.valve.read()` is a state of OpenClosed, and is never equal to PassFail.PASS" in found


def test_check_prints_them_and_ends_with_the_status_of_a_mistake(tmp_path: Path, umo: Callable[..., Result]) -> None:
    made(tmp_path / "cell", "m.tagret = 3.0")
    result = umo("check", "cell")
    assert result.exit_code == 2
    assert "application.py:9: `m.tagret`: Cell has no attribute 'tagret'" in " ".join(result.stderr.split())
