"""Thirty and more mistakes, as a beginner makes them: each is answered with its place, the reason and what to write."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.checked_code import own_modules, told
from helpers.machines import TEMPLATE
from umo import BinaryActuator, Compound, DigitalSensor
from umo.errors import DeclarationError, StateError
from umo.objects.units import check_unit
from umo.process.station import declared, find
from umo.states import OpenClosed
from umo.wiring import check


@pytest.fixture(autouse=True)
def modules_as_before() -> Iterator[None]:
    with own_modules():
        yield


IMPORTS = """import asyncio
import os
import subprocess
import threading
import time
from datetime import datetime

from umo.control import next_period, until
"""
SEQUENCE = {
    "x = 2.0 * m.level": "`m.level` is an object, not its value: write `m.level.read()`",
    "m.inlet.write('on')": "a BinaryActuator takes one of its states, such as OnOff.ON, not 'on'",
    "m.inlet.write(True)": "takes one of its states, such as OnOff.ON, not True",
    "m.inlet.write(None)": "takes one of its states, such as OnOff.ON, not None",
    "m.target == 3.0": "`m.target == 3.0` is compared, and nothing is done with the result",
    "os.system('true')": "`os.system('true')` stops the whole machine while it waits",
    "subprocess.run(['true'])": "`subprocess.run(['true'])` stops the whole machine while it waits",
    "asyncio.run(m.fill(3.0))": "asyncio cannot be used in a sequence: write `await` the sequence",
    "await asyncio.sleep(1)": "asyncio cannot be used in a sequence: write `await wait(...)`",
    "asyncio.create_task(m.fill(3.0))": "asyncio cannot be used in a sequence: write `cycle.start(...)`",
    "await asyncio.gather(m.fill(3.0))": "asyncio cannot be used in a sequence: write `await together(...)`",
    "while True:\n    m.target = 1.0": "no period passes in this loop, so the machine stops in it",
    "while True:\n    try:\n        await m.fill(3.0)\n    except:\n        pass": "this block swallows the stop",
    "try:\n    await m.fill(3.0)\nexcept BaseException:\n    pass": "this block swallows the stop",
    "try:\n    await m.fill(3.0)\nfinally:\n    return": "`return` in `finally` swallows the stop of the sequence",
    "m.sample()": "`m.sample()`: the cycle does this in each period: leave it out",
    "threading.Thread(target=lambda: m.inlet.write(OpenClosed.OPEN)).start()": "writes beside the cycle",
}
"""What a beginner writes in a sequence, and what `umo check` tells of it."""
CLASS = {
    "    def contol(self) -> None:\n        pass\n": "nobody calls `contol`: umo calls `control`",
    "    def interlock(self) -> None:\n        pass\n": "nobody calls `interlock`: umo calls `interlocks`",
    "    def helper() -> None:\n        pass\n": "`helper` takes no object: write `def helper(self)`",
    "    past = []\n\n    def note(self) -> None:\n        self.past.append(1)\n": "`past` is one for all",
}
"""The same in a class."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What is told of each: all stand in functions and classes of one station."""
    folder = Path(shutil.copytree(TEMPLATE, tmp_path_factory.mktemp("stations") / "mine"))
    file, control = folder / "application.py", folder / "control.py"
    file.write_text(file.read_text().replace('"""\n', f'"""\n\n{IMPORTS}', 1))
    lines = [("application.py", len(file.read_text().splitlines()), "")]
    for code in SEQUENCE:
        text = f"\n\nasync def mistaken(m: Tank):\n    {code.replace(chr(10), chr(10) + '    ')}\n"
        file.write_text(file.read_text() + text)
        lines.append(("application.py", len(file.read_text().splitlines()), code))
    lines.append(("control.py", len(control.read_text().splitlines()), ""))
    for number, code in enumerate(CLASS):
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


def test_nothing_else_is_accused(found: dict[str, list[str]]) -> None:
    assert found[""] == []


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


def test_a_law_with_a_yield_or_without_self_is_refused_with_its_place() -> None:
    with pytest.raises(DeclarationError, match=r"Odd\.control has a `yield` in it.*test_mistakes_of_beginners\.py:\d"):

        class Odd(Compound):
            def control(self):  # type: ignore[no-untyped-def]
                yield

    with pytest.raises(DeclarationError, match=r"Odder\.setup takes no object: write `def setup\(self\)`"):

        class Odder(Compound):
            def setup() -> None:  # type: ignore[misc]
                pass


def test_a_machine_that_is_not_made_is_told_why() -> None:
    class Own(Compound):
        level: DigitalSensor

        def __init__(self, **parts: object) -> None:
            self.x = 1

    with pytest.raises(DeclarationError, match="write `return` before the machine"):
        declared(lambda: None, "machine()", {})
    with pytest.raises(DeclarationError, match=r"write `Valve\(\.\.\.\)`, with its parts"):
        declared(lambda: Valve, "machine()", {})
    with pytest.raises(DeclarationError, match=r"Own\.__init__ does not make the parts: write `setup` in its place"):
        declared(Own, "machine()", {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[drivers.a]\ntype = simulated", 'a text stands in quotation marks: "tank"'),
        ('[drivers.a]\ntype = "simulated"\n[drivers.a]\n', "one [table] of a name holds all its keys"),
        ("[wire]\na = 1\na = 2", "each key is given once"),
    ],
)
def test_a_wiring_that_is_no_toml_is_told_what_was_meant(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "wiring.toml"
    file.write_text(text)
    assert any(words in str(each) for each in check(Valve(valve=valve()), file))


def test_a_wiring_in_another_encoding_is_told_the_right_one(tmp_path: Path) -> None:
    file = tmp_path / "wiring.toml"
    file.write_text("[wire]", encoding="utf-16")
    assert any("save the file as UTF-8" in str(each) for each in check(Valve(valve=valve()), file))
