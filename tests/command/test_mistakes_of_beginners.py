"""Forty and more mistakes, as a beginner makes them: each is answered with its place, the reason and what to write."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from helpers.checked_code import own_modules, told
from helpers.machines import TEMPLATE, bench
from umo import BinaryActuator, Compound, DigitalSensor, run
from umo.control import wait
from umo.errors import DeclarationError, StateError
from umo.objects.units import check_unit
from umo.process.station import declared, find
from umo.states import OpenClosed
from umo.wiring import check
from umo_command.check.code_check import mistakes_of


@pytest.fixture(autouse=True)
def modules_as_before() -> Iterator[None]:
    with own_modules():
        yield


IMPORTS = """import asyncio
import os
import random
import subprocess
import threading
import time
from contextlib import suppress
from datetime import datetime

import numpy as np

from umo import TaskFailed
from umo.control import PID, next_period, timeout, together, unless, until
from umo.states import OpenClosed
"""
SEQUENCE = {
    "print(f'{m.level.read} mm')": "`m.level.read` is not called, so it has no value: write `m.level.read()`",
    "print(m.level.read)": "`m.level.read` is not called, so it has no value",
    "x = 1.0 + m.level.read": "`m.level.read` is not called, so it has no value",
    "task = m.cycle.start(m.fill(3.0))\nwhile not task.done:\n    pass": (
        "`not task.done` does not change while no period passes: write `await until(lambda: ...)`"
    ),
    "m.cycle.progress = 'filling'": "`m.cycle.progress` is a function: write `m.cycle.progress(...)`",
    "await (m.fill(3.0), m.empty(20.0))": (
        "`(m.fill(3.0), m.empty(20.0))`: several sequences are awaited by `await together(...)`"
    ),
    "x = m.cycle.start(m.fill(3.0)).result": (
        "`m.cycle.start(m.fill(3.0)).result` is None, because the sequence has only been started"
    ),
    "x = 2.0 * m.level": "`m.level` is an object, not its value: write `m.level.read()`",
    "m.inlet.write('on')": "it takes OpenClosed.OPEN or OpenClosed.CLOSED, not 'on'",
    "m.inlet.write(True)": "it takes OpenClosed.OPEN or OpenClosed.CLOSED, not True",
    "m.inlet.write(None)": "it takes OpenClosed.OPEN or OpenClosed.CLOSED, not None",
    "m.target == 3.0": "`m.target == 3.0` is compared, and nothing is done with the result",
    "os.system('true')": "`os.system('true')` stops the whole machine while it waits",
    "subprocess.run(['true'])": "`subprocess.run(['true'])` stops the whole machine while it waits",
    "asyncio.run(m.fill(3.0))": "asyncio cannot be used in a sequence: write `await` the sequence",
    "await asyncio.sleep(1)": "asyncio cannot be used in a sequence: write `await wait(...)`",
    "asyncio.create_task(m.fill(3.0))": "asyncio cannot be used in a sequence: write `cycle.start(...)`",
    "await asyncio.gather(m.fill(3.0))": "asyncio cannot be used in a sequence: write `await together(...)`",
    "while True:\n    m.target = 1.0": "no period passes in this loop, so the machine stops here",
    "while True:\n    try:\n        await m.fill(3.0)\n    except:\n        pass": "this block swallows the stop",
    "try:\n    await m.fill(3.0)\nexcept BaseException:\n    pass": "this block swallows the stop",
    "try:\n    await m.fill(3.0)\nfinally:\n    return": "`return` in `finally` swallows the stop of the sequence",
    "m.sample()": "`m.sample()`: the cycle does this in each period: remove it",
    "x = 1.0 + random.random()": "`random.random()` is a different number in each run: use `cycle.random`",
    "m.target = np.random.normal(3.0)": "`np.random.normal(3.0)` is a different number in each run: use `cycle.random`",
    "x = np.random.default_rng()": "`np.random.default_rng()` is a different number in each run: use `cycle.random`",
    "while time.time() < 5.0:\n    await next_period()": "`time.time()` is the computer's time, which virtual time and",
    "if datetime.now() > m.start:\n    m.target = 1.0": "`datetime.now()` is the computer's time",
    "try:\n    await m.fill(3.0)\nexcept Exception:\n    pass": "this block swallows every fault, and nothing",
    "while True:\n    try:\n        m.level.read()\n    except:\n        continue": "swallows every fault",
    "with suppress(Exception):\n    await m.fill(3.0)": "`suppress(Exception)` swallows every fault",
    "level = m.level.read()\nwhile level < 3.0:\n    await next_period()": (
        "`level` was read once, before: write `m.level.read()` instead of `level`"
    ),
    "level = m.level.read()\nawait until(lambda: level > 3.0)": "`level` was read once, before",
    "m.inlet.write(OpenClosed.OPEN)\nm.inlet.write(OpenClosed.CLOSED)": (
        "`m.inlet.write(OpenClosed.OPEN)` has no effect, because no period passes before the next value"
    ),
    "for each in OpenClosed:\n    m.inlet.write(each)": "only the last value of `m.inlet.write(each)` counts",
    "await together(*[until(lambda: z.read() is OpenClosed.OPEN) for z in (m.inlet, m.drain)])": (
        "`z` has the value of the last turn of the loop when this is called; write `lambda z=z:`"
    ),
    "for z in (m.inlet, m.drain):\n    m.cycle.start(until(lambda: z.read() is OpenClosed.OPEN))": (
        "write `lambda z=z:`"
    ),
    "if m.inlet.read() is OpenClosed.OPEN or OpenClosed.CLOSED:\n    m.target = 1.0": (
        "`OpenClosed.CLOSED` is not compared with anything: write each comparison in full, `... is OpenClosed.CLOSED`"
    ),
    "m.target = PID(gain=1.0).step(1.0, 2.0, 0.01)": "`0.01` is not the period if a wiring sets another period",
    "x = m.level.get()": "DigitalSensor has no attribute 'get' (did you mean 'read()'?)",
    "m.level.write(3.0)": "DigitalSensor has no attribute 'write'; a sensor is only read",
    "m.inlet.open()": "BinaryActuator has no attribute 'open' (did you mean 'write(...)'?)",
    "m.regulator.hihg = 3.0": "Hysteresis has no attribute 'hihg' (did you mean 'high'?)",
    "threading.Thread(target=lambda: m.inlet.write(OpenClosed.OPEN)).start()": "writes outside the cycle",
}
"""What a beginner writes in a sequence, and what `umo check` tells of it."""
CLASS = {
    "    def control(self) -> None:\n        Hysteresis(self.a, self.b, 1, low=0, high=1).control()\n": (
        "`Hysteresis(self.a, self.b, 1, low=0, high=1)` is created again in each period, so it keeps no state"
    ),
    "    def contol(self) -> None:\n        pass\n": "nothing calls `contol`: umo calls `control`",
    "    def interlock(self) -> None:\n        pass\n": "nothing calls `interlock`: umo calls `interlocks`",
    "    def helper() -> None:\n        pass\n": "`helper` has no parameter for its object: write `def helper(self)`",
    "    target = 1.0\n\n    def aim(self, target: float) -> None:\n        target = target\n": (
        "`target` is a name of this function only, and nothing reads it: write `self.target = ...`"
    ),
    "    past = []\n\n    def note(self) -> None:\n        self.past.append(1)\n": "`past` is shared by all objects",
}
"""The same in a class."""
RIGHT_CLASS = [
    f"    law = None\n    on = False\n\n    def control(self) -> None:\n{body}"
    for body in (
        "        self.law = self.law or Hysteresis(self.a, self.b, 1, low=0, high=1)\n",
        "        self.law = Hysteresis(self.a, self.b, 1, low=0, high=1) if self.law is None else self.law\n",
        "        if self.on:\n            return\n        self.law = Hysteresis(self.a, self.b, 1, low=0, high=1)\n",
    )
]
"""What is right in a class, although it looks like a mistake."""
RIGHT = [
    "print(f'{m.level.read()} mm', m.level)",
    "task = m.cycle.start(m.fill(3.0))\nawait task\nm.target = task.result",
    "task = m.cycle.start(m.fill(3.0))\nwhile not task.done:\n    await next_period()",
    "waiting = [3.0]\nwhile waiting:\n    m.aim(waiting.pop())",
    "waiting = [3.0]\nwhile waiting.pop():\n    pass",
    "m.band = 3.0",
    "m.cycle.start(m.fill(3.0)).cancel()",
    "m.target = m.cycle.random.random()",
    "generator = np.random.default_rng(7)\nm.target = generator.normal()",
    "print(time.time())",
    "try:\n    await m.fill(3.0)\nexcept TaskFailed:\n    pass",
    "try:\n    await m.fill(3.0)\nexcept Exception as error:\n    print(error)",
    "try:\n    m.target = float('x')\nexcept Exception:\n    pass",
    "with suppress(TaskFailed):\n    await m.fill(3.0)",
    "start = m.level.read()\nwhile m.level.read() < start + 3.0:\n    await next_period()",
    "level = m.level.read()\nwhile level < 3.0:\n    await next_period()\n    level = m.level.read()",
    "level = m.level.read()\nwhile level < 3.0:\n    await next_period()\n    if m.target > 3.0:\n        break",
    "level = m.level.read()\nawait until(lambda: m.level.read() > level)",
    "m.inlet.write(OpenClosed.OPEN)\nawait wait('1 s')\nm.inlet.write(OpenClosed.CLOSED)",
    "m.inlet.write(OpenClosed.OPEN)\nm.drain.write(OpenClosed.CLOSED)",
    "for each in OpenClosed:\n    m.inlet.write(each)\n    await next_period()",
    "for each in (m.inlet, m.drain):\n    each.write(OpenClosed.OPEN)",
    "for z in (m.inlet, m.drain):\n    await until(lambda: z.read() is OpenClosed.OPEN)",
    "await together(*[until(lambda z=z: z.read() is OpenClosed.OPEN) for z in (m.inlet, m.drain)])",
    "await together(*[until(lambda: m.target > 1.0) for _ in range(2)])",
    "if m.inlet.read() is OpenClosed.OPEN or m.drain.read() is OpenClosed.OPEN:\n    m.target = 1.0",
    "m.target = PID(gain=1.0).step(1.0, 2.0, m.dt)",
    "m.regulator.high = 3.0",
]
"""What looks alike in a sequence, and is right."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What is told of each: all stand in functions and classes of one station."""
    folder = Path(shutil.copytree(TEMPLATE, tmp_path_factory.mktemp("stations") / "mine"))
    file, control = folder / "application.py", folder / "control.py"
    file.write_text(file.read_text().replace('"""\n', f'"""\n\n{IMPORTS}', 1))
    lines = [("application.py", len(file.read_text().splitlines()), "")]
    for code in (*SEQUENCE, *RIGHT):
        text = f"\n\nasync def mistaken(m: Tank):\n    {code.replace(chr(10), chr(10) + '    ')}\n"
        file.write_text(file.read_text() + text)
        lines.append(("application.py", len(file.read_text().splitlines()), code))
    lines.append(("control.py", len(control.read_text().splitlines()), ""))
    for number, code in enumerate([*CLASS, *RIGHT_CLASS]):
        control.write_text(f"{control.read_text()}\n\nclass Mistaken{number}(Compound):\n{code}")
        lines.append(("control.py", len(control.read_text().splitlines()), code))
    all_told: dict[str, list[str]] = {code: [] for _, _, code in lines}
    with own_modules():
        mistakes = told(find(folder))
    for each in mistakes:
        place, _, text = each.partition(": ")
        name, _, line = place.partition(":")
        all_told[next(code for of, last, code in lines if of == name and int(line) <= last)].append(text)
    return all_told


@pytest.mark.parametrize("code", [*SEQUENCE, *CLASS])
def test_check_finds_it_with_what_to_write(found: dict[str, list[str]], code: str) -> None:
    assert any({**SEQUENCE, **CLASS}[code] in each for each in found[code]), found[code]


@pytest.mark.parametrize("code", ["", *RIGHT, *RIGHT_CLASS])
def test_what_is_right_is_not_accused(found: dict[str, list[str]], code: str) -> None:
    assert found[code] == []


async def without_machine() -> None:
    pass


async def of_keywords(*, speed: float = 1.0) -> None:
    pass


@pytest.mark.parametrize("application", [without_machine, of_keywords])
def test_an_application_that_takes_no_machine_is_told_what_to_write(application: Any) -> None:
    name, line = application.__name__, application.__code__.co_firstlineno
    told_of_it = f"{name} has no parameter for the machine: write `async def {name}(m)`"
    place = f"tests/command/test_mistakes_of_beginners.py:{line}"
    for given in (application, partial(application)):  # as a command has it
        with pytest.raises(DeclarationError, match=rf"^{re.escape(told_of_it)} \({re.escape(place)}\)$"):
            run(bench(), None, given)
    (mistake,) = mistakes_of([], bench(), application)
    assert str(mistake) == f"{place}: {told_of_it}"


def test_several_sequences_after_an_await_are_told_how_they_are_awaited() -> None:
    async def application(m: Any) -> None:
        await (wait("1 ms"), wait("2 ms"))  # type: ignore[misc]

    with pytest.raises(TypeError, match=r"several sequences are awaited by `await together\(\.\.\.\)`"):
        run(bench(), None, application)


class Valve(Compound):
    valve: BinaryActuator[OpenClosed]


def valve() -> BinaryActuator[OpenClosed]:
    return BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (True, "write OpenClosed.OPEN or OpenClosed.CLOSED"),
        (1, "write OpenClosed.OPEN or OpenClosed.CLOSED"),
        ("open", ": write OpenClosed.OPEN"),
        ("CLOSED", ": write OpenClosed.CLOSED"),
    ],
)
def test_a_state_that_is_none_is_answered_with_the_nearest(given: object, words: str) -> None:
    with pytest.raises(StateError, match=words):
        Valve(valve=valve()).valve.write(given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (BinaryActuator, r"write `BinaryActuator\(\.\.\.\)`"),
        ((valve(),), "a comma after an object makes a tuple of it"),
    ],
)
def test_a_part_of_the_wrong_type_is_told_what_was_meant(given: object, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        Valve(valve=given)  # type: ignore[arg-type]


def test_a_default_that_is_no_state_is_told_the_states() -> None:
    with pytest.raises(DeclarationError, match=r"write OpenClosed\.OPEN or OpenClosed\.CLOSED"):
        BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=True)  # type: ignore[type-var]


@pytest.mark.parametrize(("unit", "near"), [("milimeter", "millimeter"), ("secnd", "second"), ("volts/secnd", "")])
def test_a_unit_that_is_misspelt_is_told_the_nearest(unit: str, near: str) -> None:
    with pytest.raises(DeclarationError, match=f"did you mean '{near}'" if near else "is not a unit"):
        check_unit(unit)


def test_a_sample_or_update_of_a_class_is_refused_as_the_whole_moves_its_parts_without_it() -> None:
    class Counted:
        def sample(self) -> bool:
            return True

    with pytest.raises(DeclarationError, match=r"Mixed\.sample would never be called.*belongs in `control`"):

        class Mixed(Counted, Compound): ...

    with pytest.raises(DeclarationError, match=r"Odd\.update would never be called"):

        class Odd(Compound):
            def update(self) -> bool:
                return True


def test_a_law_with_a_yield_or_without_self_is_refused_with_its_place() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.control contains `yield`.*test_mistakes_of_beginners\.py:\d"):

        class Odd(Compound):
            def control(self):  # type: ignore[no-untyped-def]
                yield

    with pytest.raises(
        DeclarationError,
        match=r"Odder\.setup has no parameter for its object: write `def "
        r"setup\(self\)`",
    ):

        class Odder(Compound):
            def setup() -> None:  # type: ignore[misc]
                pass


def test_a_law_that_wants_the_period_is_told_where_it_is() -> None:
    with pytest.raises(DeclarationError, match=r"`def control\(self\)`; the period is `self.dt` .*beginners\.py:\d"):

        class Odd(Compound):
            def control(self, dt: float) -> None: ...  # type: ignore[override]


def test_an_object_in_the_body_of_a_class_is_told_where_it_belongs() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.lamp is not a part of its objects: write `lamp: BinaryActuator`"):

        class Odd(Compound):
            lamp = valve()


def test_a_machine_that_is_not_made_is_told_why() -> None:
    class Own(Compound):
        level: DigitalSensor

        def __init__(self, **parts: object) -> None:
            self.x = 1

    with pytest.raises(DeclarationError, match="write `return` before the machine"):
        declared(lambda: None, "machine()", {})
    with pytest.raises(DeclarationError, match=r"write `Valve\(\.\.\.\)`, with its parts"):
        declared(lambda: Valve, "machine()", {})
    with pytest.raises(DeclarationError, match=r"Own\.__init__ does not create the parts: write `setup` instead"):
        declared(Own, "machine()", {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[drivers.a]\ntype = simulated", 'write a string in quotation marks: "tank"'),
        ('[drivers.a]\ntype = "simulated"\n[drivers.a]\n', "write all keys of a table below one heading [table]"),
        ("[wire]\na = 1\na = 2", "give each key only once: a is also in line 2"),
        ("# own\n[wire]\n'z.a' = { driver = [\n1] }\nb = 1\n'z.a' = [\n2]\nc = 1", "once: 'z.a' is also in line 3"),
        ("[wire]\na = { x = 1 }\nb.x = 1\na = { y = 2 }\n", "give each key only once: a is also in line 2"),
        ("[wire]\na.x = 1\n[parameters]\na.x = 1\na.y = 1\na.x = 2\n", "once: a.x is also in line 4"),
        ("[drivers]\na = 1\n[drivers.a]\ntype = 'simulated'", "give each key only once: [drivers.a] is also in line 2"),
    ],
)
def test_a_wiring_that_is_no_toml_is_told_what_was_meant(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "wiring.toml"
    file.write_text(text)
    assert any(words in str(each) for each in check(Valve(valve=valve()), file))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# own\n[wire]\nvalve = { driver = 'simulated' }\nvlave = { driver = 'simulated' }", ':4: wire."vlave": '),
        ("[wire]\nvalve = {\n driver = 'simulated', chanel = 'a' }".replace("\n d", " d"), ':2: wire."valve".chanel: '),
        ("[wire.valve]\ndriver = 'simulated'\ninverted = 'no'", ':3: wire."valve".inverted: must be true or false'),
        ("[drivers.a]\ntype = 'modbus'\nhots = 'box'\n[wire]\nvalve.driver = 'a'", ":3: drivers.a.hots: unknown key"),
        ("[drivers.a]\ntype = 'simulated'\ntimeout = 50\n[wire]\nvalve.driver = 'a'", '50 has no unit: write "50 ms"'),
        (
            "[wire]\nvalve.driver = 'simulated'\n[parameters]\nspede = 1",
            ":4: parameters.'spede': there is no such parameter",
        ),
    ],
)
def test_a_mistake_in_a_wiring_is_told_with_the_line_of_its_key(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "wiring.toml"
    file.write_text(text)
    assert any(words in str(each) for each in check(Valve(valve=valve()), file)), check(Valve(valve=valve()), file)


def test_a_wiring_in_another_encoding_is_told_the_right_one(tmp_path: Path) -> None:
    file = tmp_path / "wiring.toml"
    file.write_text("[wire]", encoding="utf-16")
    assert any("save the file as UTF-8" in str(each) for each in check(Valve(valve=valve()), file))
