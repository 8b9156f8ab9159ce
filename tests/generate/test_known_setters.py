"""A controller goes on with what its generation took as known: an application that sets it is refused, with the line
that reads it and the line that sets it; what is taken as known is told in the folder's README."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.tiers import some
from umo.generate import known_containers, known_setters

Umo = Callable[..., Result]
CONTROL = """
from typing import Annotated, Any
from umo import Compound, DigitalActuator, DigitalSensor, Number

LIMIT = 1.0

class Settings:
    label = "slow"

    def __init__(self):
        self.kind = "first"

def offset_of(start):
    offset = start
    def read():
        return offset
    def write(value):
        nonlocal offset
        SET_OFFSET
    return read, write

read_offset, write_offset = offset_of(0.5)

class Pump(Compound):
    level: DigitalSensor
    motor: DigitalActuator
    timer: DigitalSensor
    PV: Annotated[float, Number("mm", 0.0, 100.0, tunable=TUNABLE)] = 3.0

    def setup(self):
        self.mode_name = "heat"
        self.mode_name = str(self.mode_name)
        self.target: Any = None
        self.active = self.motor
        self.names = NAMES
        self.settings = Settings()
        self.gain = 2.0

    def control(self):
        total = LIMIT + self.PV + read_offset() + self.gain + self.level.read()
        if self.mode_name == "heat":
            total += 1.0
        if self.target is not None:
            total += self.target
        if "a" in self.names:
            total += 2.0
        if self.settings.kind == "first" and self.settings.label == "slow":
            total += 4.0
        self.active.write(total)

    def choose(self, name):
        SET_HERE
"""
OBJECTS = """
from umo import DigitalActuator, DigitalSensor
from .control import Pump

def machine() -> Pump:
    return Pump(
        level=DigitalSensor("mm", minimum=0, maximum=100, resolution=0.1),
        motor=DigitalActuator("V", default=0, minimum=0, maximum=100, resolution=0.01, limits="clamp"),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=1000, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo import wait
from . import control
from .control import Pump, Settings

async def main(m: Pump):
    await wait("1 s")
    SET_THERE

class Order:
    def __init__(self, m):
        BY_ORDER

    def __post_init__(self, m=None):
        AFTER_ORDER

    def setup(self, m):
        self.mode_name = "another"
        BY_SETUP

    def later(self):
        self.mode_name = "off"
"""
LINES = {
    "SET_OFFSET": "return None",
    "SET_HERE": "return None",
    "SET_THERE": "return None",
    "BY_ORDER": "self.machine = m",
    "AFTER_ORDER": 'object.__setattr__(self, "mode_name", "mine")',
    "BY_SETUP": 'vars(self)["mode_name"] = "mine"',
    "TUNABLE": "False",
    "NAMES": '("a", "b")',
}


def generate(umo: Umo, folder: Path, target: str = "host", **lines: str) -> Result:
    """Generate the controller of a station with these lines."""
    station = folder / "pump"
    station.mkdir(exist_ok=True)
    for name, text in (("control", CONTROL), ("objects", OBJECTS), ("application", APPLICATION)):
        for word, line in (LINES | lines).items():
            text = text.replace(word, line)
        (station / f"{name}.py").write_text(text)
    return umo("new", "controller", "pump", "--target", target, "-o", "controller")


THERE = [
    ('m.mode_name = "off"', "Pump.mode_name"),
    ('m.mode_name += "s"', "Pump.mode_name"),
    ("del m.mode_name", "Pump.mode_name"),
    ('setattr(m, "mode_name", "off")', "Pump.mode_name"),
    ('object.__setattr__(m, "mode_name", "off")', "Pump.mode_name"),
    ('setattr(m, input(), "off")', "may be set"),
    ('m.__setattr__(input(), "off")', "may be set"),
    ('object.__setattr__(m, input(), "off")', "may be set"),
    ('names = vars(m); names["mode_name"] = "off"', "may be set"),
    ("Settings.update(m.__dict__)", "may be set"),
    ('m.__setattr__("mode_name", "off")', "Pump.mode_name"),
    ('vars(m)["mode_name"] = "off"', "Pump.mode_name"),
    ('m.__dict__.update(mode_name="off")', "may be set"),
    ("setattr(m, input(), 1.0)", "may be set"),
    ('exec("m.mode_name = None")', "may be set"),
    ("m.gain, m.target = 1.0, 2.0", "Pump.target"),
    ("for m.target in range(3): pass", "Pump.target"),
    ("m.active = m.motor", "Pump.active"),
    ('m.names = ("b",)', "Pump.names"),
    ("m.settings = Settings()", "Pump.settings"),
    ('m.settings.kind = "second"', "Settings.kind"),
    ('Settings.label = "fast"', "Settings.label"),
    ("control.LIMIT = 2.0", "LIMIT of pump/control.py"),
    ("m.PV = 4.0", "Pump.PV"),
    ('put = setattr; put(m, "mode_name", "off")', "may be set"),
    ('from builtins import setattr as put; put(m, "mode_name", "off")', "may be set"),
    ('list(map(setattr, [m], ["mode_name"], ["off"]))', "may be set"),
    ('import functools; functools.partial(setattr, m, "mode_name")("off")', "may be set"),
    ('m.__setattr__.__call__("mode_name", "off")', "may be set"),
    ('getattr(m, "__setattr__")("mode_name", "off")', "may be set"),
    ('getattr(m, "__dict__")["mode_name"] = "off"', "may be set"),
    ('import builtins; getattr(builtins, "vars")(m)["mode_name"] = "off"', "may be set"),
    ('put = vars; put(m)["mode_name"] = "off"', "may be set"),
    ('[vars(each) for each in (m,)][0]["mode_name"] = "off"', "may be set"),
    ('(lambda names=vars(m): names.update(mode_name="off"))()', "may be set"),
    ('match vars(m):\n        case names: names["mode_name"] = "off"', "may be set"),
    ('put = vars(m).update; put(mode_name="off")', "may be set"),
    ('m.__dict__ = {"mode_name": "off"}', "may be set"),
    ("m.__class__ = Order", "may be set"),
    ('eval("m.__setattr__")("mode_name", "off")', "may be set"),
    ("Settings.kind.__set__(m.settings, None)", "may be set"),
    ("import importlib; importlib.reload(control)", "may be set"),
    ("control.read_offset.__closure__[0].cell_contents = 2.0", "may be set"),
    ("Pump.control.__code__ = Order.later.__code__", "may be set"),
]


@pytest.mark.parametrize(("line", "told"), THERE)
def test_each_of_them_is_found_where_it_stands(tmp_path: Path, line: str, told: str) -> None:
    file = tmp_path / "application.py"
    file.write_text(APPLICATION.replace("SET_THERE", line))
    found = {each.name for each in known_setters._read(str(file)).settings if each.line == 8}
    assert found & ({known_setters.ANY} if told == "may be set" else {told.rpartition(".")[2], told.partition(" ")[0]})


READS = [
    'print(vars(m)["mode_name"])',
    "for name in vars(m): print(name)",
    "print(len(m.__dict__), dict(vars(m)), sorted(vars(m).items()), **vars(m))",
    'assert "mode_name" in vars(m)',
    'print(getattr(m, "mode_name"), getattr(m, input()))',
    'mode = "exec" if isinstance(m, Order) else "vars"',
    "Order(m).later(); m.order.later()",
]


@pytest.mark.parametrize("line", READS)
def test_what_only_reads_is_no_setting(tmp_path: Path, line: str) -> None:
    file = tmp_path / "application.py"
    file.write_text(APPLICATION.replace("SET_THERE", line))
    found = known_setters._read(str(file))
    assert not [each for each in found.settings if each.line == 8] and not found.again
    assert not any(map(known_setters._ClassUses([found]).any_object, found.settings))


FOREIGN = [
    {"application": "Order.later(m)"},
    {"application": "change = Order.later; change(m)"},
    {"application": "for kind in (Order, Pump): kind.later(m)"},
    {"application": "type(m.order).later(m)"},
    {"application": "m.order.__class__.later(m)"},
    {"application": "O = Order; O.later(m)"},
    {"control": "from .application import Order; Order.later(self)"},
    {"control": "from .application import Order as O; O.later(name)"},
    {"control": "from . import application as a; a.Order.later(name)"},
    {"control": "from . import application as a; list(map(a.Order.later, [name]))"},
]


@pytest.mark.parametrize("lines", FOREIGN)
def test_the_self_of_a_method_that_a_class_is_asked_for_may_be_any_object(
    tmp_path: Path, lines: dict[str, str]
) -> None:
    files = []
    for name, text, word in (("control", CONTROL, "SET_HERE"), ("application", APPLICATION, "SET_THERE")):
        (tmp_path / f"{name}.py").write_text(text.replace(word, lines.get(name, "pass")))
        files.append(known_setters._read(str(tmp_path / f"{name}.py")))
    (later,) = (each for each in files[1].settings if each.method == "later")
    assert later.kind == "Order" and known_setters._ClassUses(files).any_object(later)


@pytest.mark.parametrize(("line", "told"), some(lambda case: THERE.index(case) % 10 == 0, THERE))
def test_an_application_that_sets_what_is_known_is_refused(umo: Umo, tmp_path: Path, line: str, told: str) -> None:
    done = generate(umo, tmp_path, SET_THERE=line)
    said = " ".join(done.stderr.split())
    assert done.exit_code == 2 and told in said and "pump/application.py:8" in said and "pump/control.py:" in said
    assert not (tmp_path / "controller").exists()


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ({"SET_HERE": "self.mode_name = name"}, "Pump.mode_name is taken as known, and is set in pump/control.py:"),
        ({"SET_HERE": "global LIMIT; LIMIT = 2.0"}, "LIMIT of pump/control.py is taken as known, and is set in"),
        ({"SET_OFFSET": "offset = value"}, "offset of offset_of.read is taken as known, and is set in"),
        ({"BY_ORDER": 'm.mode_name = "off"'}, "Pump.mode_name is taken as known, and is set in pump/application.py:12"),
        ({"AFTER_ORDER": "setattr(m, self.name, 2)"}, "is taken as known, and may be set in pump/application.py:15"),
        ({"BY_SETUP": "m.active = m.motor"}, "Pump.active is taken as known, and is set in pump/application.py:19"),
        ({"SET_THERE": "Order.later(m)"}, "Pump.mode_name is taken as known, and is set in pump/application.py:22"),
        (
            {"SET_HERE": "from .application import Order; Order.later(self)"},
            "Pump.mode_name is taken as known, and is set in pump/application.py:22",
        ),
        ({"SET_THERE": "m.setup()"}, "Pump.mode_name is taken as known, and is set in pump/control.py:"),
        ({"TUNABLE": "True"}, "PV is taken as known, but clients may set it"),
        ({"NAMES": '["a"]', "SET_THERE": 'm.names.append("b")'}, "Pump.names is a list, which code can change"),
        ({"NAMES": '{"a": 1}', "SET_THERE": 'm.names["b"] = 1'}, "Pump.names is a dict, which code can change"),
        ({"NAMES": '{"a"}', "SET_THERE": "names = m.names"}, "Pump.names is a set, which code can change"),
    ],
)
def test_so_is_a_law_a_client_and_a_container(umo: Umo, tmp_path: Path, lines: dict[str, str], told: str) -> None:
    done = generate(umo, tmp_path, **lines)
    assert done.exit_code == 2 and told in " ".join(done.stderr.split())


CONTAINED = """
from .base import Base

TABLE = {"a": 1.0}
TABLE["b"] = 2.0

class Pump(Base):
    KINDS: ClassVar[dict[str, float]] = {"x": 3.0}

    def setup(self):
        self.names = ["a"]
        self.names.append("b")
        self.laws, self.table = [Law() for _ in self.names], dict(TABLE)

    def control(self):
        for law, name in zip(self.laws, self.names):
            law.step(TABLE[name], self.table.get(name), self.KINDS["x"], len(self.names))

    def other(self, m, value):
        CHANGED

CHANGES
"""
CHANGED = [
    ("m.names.append(value)", ".names"),
    ("m.names[0] = value", ".names"),
    ("del m.names[0]", ".names"),
    ("m.names += [value]; m.names[:] = []", ".names"),
    ("names = m.names; names.clear()", ".names"),
    ("put = m.names.append; put(value)", ".names"),
    ("value.take(m.names)", ".names"),
    ("return m.names", ".names"),
    ("value(names=m.kinds)", ".names"),
    ("m.names = value", ".names"),
    ("self.names.sort()", ".names"),
    ("self.names += value", ".names"),
    ('setattr(m, "names", value)', ".names"),
    ('TABLE["a"] = value', "TABLE"),
    ("TABLE.update(value)", "TABLE"),
    ("for TABLE['a'] in value: pass", "TABLE"),
    ("[*map(TABLE.pop, value)]", "TABLE"),
    ("value = TABLE or None", "TABLE"),
    ("sorted = value; sorted(TABLE)", "TABLE"),
    ("from .control import TABLE as T; T.clear()", "TABLE"),
    ("control.TABLE.clear()", ".TABLE"),
    ("self.KINDS.clear()", ".KINDS"),
    ('getattr(m, "names").append(value)', ".names"),
    ("getattr(m, value).append(value)", known_containers.ANY),
    ("for each in vars(m).values(): each.append(value)", known_containers.ANY),
    ("m.__dict__[value].append(value)", known_containers.ANY),
    ("[*map(getattr, [m], [value])][0].append(value)", known_containers.ANY),
]


def containers_in(changed: str = "pass", changes: str = "") -> set[str]:
    """The containers that a file may change."""
    tree = ast.parse(CONTAINED.replace("CHANGED", changed).replace("CHANGES", changes))
    return {each.name for each in known_containers.changed_in(tree, known_setters.BEFORE) if not each.before}


@pytest.mark.parametrize(("line", "told"), CHANGED)
def test_a_container_that_may_be_changed_is_found(line: str, told: str) -> None:
    assert told in containers_in(line)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("class Other:\n    KINDS = TABLE", ".KINDS"),
        ("class Other:\n    def __init__(self, names):\n        self.names = names", ".names"),
        ("@dataclass\nclass Other:\n    names: list[str] = field(default_factory=list)", ".names"),
        ("from .base import TABLE\nTABLE.clear()", "TABLE"),
        ("from .base import *\nTABLE.clear()", "TABLE"),
        ("class Other:\n    def setup(self, m):\n        m.names.append(1)", ".names"),
        ("class Other:\n    def work(self):\n        self.names += [1]", ".names"),
        ("class Other:\n    def setup(self):\n        self.put = lambda: self.names.append(1)", ".names"),
    ],
)
def test_so_is_one_that_has_another_name(lines: str, told: str) -> None:
    assert told in containers_in(changes=lines)


@pytest.mark.parametrize(
    "line",
    [
        "print(m.names, TABLE, sorted(TABLE.items()))",
        'value = "a" in m.names and not TABLE',
        "value = [*m.names, *m.laws] + m.names",
        "for name, each in enumerate(m.laws): each.gain = TABLE[name]",
        "value = max(m.table.values())",
        "names = []; names.append(1)",
        'value = getattr(m, "level")',
    ],
)
def test_one_that_is_only_read_is_not(line: str) -> None:
    assert not containers_in(line) & {"TABLE", ".TABLE", ".names", ".laws", ".table", ".KINDS", known_containers.ANY}


def test_a_list_that_nobody_changes_is_known(umo: Umo, tmp_path: Path) -> None:
    done = generate(umo, tmp_path, NAMES='["a", "b"]')
    assert done.exit_code == 0, done.stderr


def test_a_setup_of_the_machine_may_set_the_objects_of_others(umo: Umo, tmp_path: Path) -> None:
    kind = "self.settings = Settings(); kept = self.settings; kept.kind = 'second'"
    done = generate(umo, tmp_path, NAMES=f"('a',); {kind}")
    assert done.exit_code == 0, done.stderr
    later = "kept = self; self.later = lambda: setattr(kept, 'mode_name', 'off')"
    done = generate(umo, tmp_path, NAMES=f"('a',); {later}")
    assert done.exit_code == 2 and "Pump.mode_name is taken as known, and is set in" in " ".join(done.stderr.split())


def test_parts_and_setters_of_the_same_name_are_no_hindrance(umo: Umo, tmp_path: Path) -> None:
    there = "m.settings.level = 2.0; m.other.motor = 3.0"
    done = generate(umo, tmp_path, SET_THERE=there)
    assert done.exit_code == 0, done.stderr
    done = generate(umo, tmp_path, SET_THERE="Pump.level = 2.0")
    assert done.exit_code == 2 and "Pump.level is taken as known, and is set in" in " ".join(done.stderr.split())


def test_what_sets_numbers_and_other_objects_is_no_hindrance(umo: Umo, tmp_path: Path) -> None:
    there = 'm.gain = 3.0; other = {"mode_name": 1}; other["mode_name"] = 2; mode_name = "x"'
    done = generate(umo, tmp_path, SET_THERE=there, SET_HERE="self.gain = 4.0")
    assert done.exit_code == 0, done.stderr


def test_the_folder_tells_what_is_known_with_its_value_and_line(umo: Umo, tmp_path: Path) -> None:
    assert generate(umo, tmp_path).exit_code == 0
    told = (tmp_path / "controller" / "README.md").read_text().partition("## To be known")[2]
    line = 1 + CONTROL.splitlines().index('        if self.mode_name == "heat":')
    assert f"- taken as known: `Pump.mode_name` is `'heat'` (pump/control.py:{line})\n" in told
    for name, value in (("target", "`None`"), ("PV", "`3.0`"), ("names", "(`'a'`, `'b'`)"), ("settings", "a Settings")):
        assert f"`Pump.{name}` is {value}" in told
    for each in (
        "`LIMIT of pump/control.py` is `1.0`",
        "`offset of offset_of.read` is `0.5`",
        "`Settings.kind` is `'first'`",
    ):
        assert each in told
    assert "the object `motor`" in told and "Nothing" not in told
