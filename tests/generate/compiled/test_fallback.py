"""What keeps laws in Python, or gives them back to it, is told, and the machine goes on as it was."""

from __future__ import annotations

from collections.abc import Callable, MutableSequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import atan2
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.compiling import CompiledRun, observed
from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.machines import timer
from helpers.tiers import first
from umo import Compound, DigitalActuator, DigitalSensor, connect
from umo.control import Servo, value_of
from umo.control.loops import LawLoop
from umo.errors import BadInput, DeclarationError, RangeError
from umo.generate import compiled_laws, law_library
from umo.generate.compiled_laws import prepare
from umo.process.compiling import prepare_if_asked, start_compiled
from umo.testing import VirtualTimer
from umo.wiring import resolve
from umo.wiring.wired import ProcessSettings

Umo = Callable[..., Any]
pytestmark = needs_a_compiler


class Pump(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    motor: DigitalActuator

    def setup(self) -> None:
        self.gain: Any = 0.5
        self.total = 0.0
        self.table = [1.0, 2.0]
        self.weights = np.array([1.0, 2.0])

    def control(self) -> None:
        level = value_of(self.level)
        self.total += level * self.gain * self.table[0] + self.weights[1]
        self.table[1] = level
        if self.total > 1e6:
            raise RangeError("too much")
        self.motor.write(min(level * self.gain, 10.0))


class Rounded(Pump):
    """It changes an array in place, and rounds."""

    def control(self) -> None:
        self.weights[0] = round(value_of(self.level) * 0.3)
        self.motor.write(min(float(self.weights[0]) * self.gain, 10.0))


def pump(kind: type[Pump] = Pump) -> Pump:
    return kind(
        timer=timer(),
        level=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=0.5),
        motor=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
    )


def running(machine: Any, state: str = "compiled") -> CompiledRun:
    """A connected pump whose laws are compiled, past the comparison."""
    box = Fragile()
    box.set("level", 20)
    return CompiledRun(machine, box, state)


def test_an_experiment_on_a_law_gives_the_laws_back_to_python() -> None:
    class Heated(Pump):
        def setup(self) -> None:
            self.servo = Servo(self.level, self.motor, gain=0.1, integral_time=1.0)

        def control(self) -> None:
            self.servo.control(50.0, dt=self.dt)

    with running(pump(Heated)) as run:
        assert run.laws.state == "compiled"
        loop = LawLoop(run.m, run.m.servo, run.m.level, run.m.motor)
        loop.take(lambda *_: 7.0)
        run.step()
        assert run.m.motor.pending == 7.0
        assert run.laws.state == "python" and "servo.step is replaced" in run.events
        loop.give_back()
        run.step()
        assert run.m.motor.pending != 7.0


def test_attributes_are_read_and_set_as_before() -> None:
    with running(pump()) as run:
        m = run.m
        assert run.laws.state == "compiled" and "the laws are compiled" in run.events
        assert type(m).__name__ == "Pump" and isinstance(m, Pump)
        m.gain, m.total = 0.25, 0.0
        m.table[0] = 4.0
        m.weights[1] = 8.0
        run.step()
        assert m.total == 10.0 * 0.25 * 4.0 + 8.0
        assert (list(m.table), m.table[1], m.motor.pending) == ([4.0, 10.0], 10.0, 2.5)
        m.weights = np.array([0.0, 1.0])
        run.step()
        assert m.total == 18.0 + 10.0 + 1.0
        assert run.laws.state == "compiled"


@pytest.mark.parametrize(
    ("name", "value"), [("gain", None), ("total", "much"), ("table", [1.0]), ("weights", np.zeros(3))]
)
def test_a_value_of_another_kind_gives_the_laws_back_to_python(name: str, value: Any) -> None:
    with running(pump()) as run:
        total = run.m.total
        setattr(run.m, name, value)
        assert run.laws.state == "python" and f"{name} is set to" in run.events
        assert repr(getattr(run.m, name)) == repr(value) and type(run.m) is Pump
        if name != "total":
            assert run.m.total == total
        setattr(run.m, name, {"gain": 1.0, "total": 0.0, "table": [1.0, 2.0], "weights": np.ones(2)}[name])
        run.step()
        assert isinstance(run.m.table, list)


class Typed(Pump):
    """A law whose result tells a zero with a sign from one without."""

    def setup(self) -> None:
        self.real, self.whole, self.flag = 1.0, 1, True
        self.pair = (1.0, 2)
        self.reals, self.wholes, self.pairs = [1.0, 2.0], [1, 2], [(1.0, 2.0), (3.0, 4.0)]
        self.array, self.counts = np.ones(2), np.array([1, 2])

    def control(self) -> None:
        turned = atan2(-self.real, -1.0) + atan2(-self.pair[0], -1.0) + atan2(-self.reals[0], -1.0)
        turned += atan2(-self.pairs[0][0], -1.0) + atan2(-float(self.array[0]), -1.0)
        count = self.whole + self.wholes[0] + self.pair[1] + float(self.counts[0])
        self.motor.write((turned + count) % 10.0 if self.flag else 0.0)


ANYTHING = [0, 0.0, -0.0, 3, 1.5, True, 2**31, 2**53, 2**53 + 1, np.float64(2.0), np.int64(0), np.True_, None]


class Overridden(Pump):
    """Its override is None at first, where its class has a number."""

    override: float | None = 9.0

    def setup(self) -> None:
        super().setup()
        self.override = None

    def control(self) -> None:
        self.motor.write(self.gain if self.override is None else self.override)


class Wanted(Pump):
    """What it wants is None at first, and no attribute of its class."""

    def setup(self) -> None:
        super().setup()
        self.wanted: float | None = None

    def control(self) -> None:
        self.motor.write(self.gain if self.wanted is None else self.wanted)


@pytest.mark.parametrize(("kind", "name"), [(Overridden, "override"), (Wanted, "wanted")])
def test_an_attribute_that_is_none_is_so_when_python_runs_the_laws_again(kind: type[Pump], name: str) -> None:
    with running(pump(kind)) as run:
        run.m.gain = 3
        run.step()
        assert run.laws.state == "python"
        assert (getattr(run.m, name), run.m.motor.pending) == (None, 3.0)


@pytest.mark.parametrize("name", ["real", "whole", "flag", "pair", "reals", "wholes", "pairs", "array", "counts"])
@pytest.mark.parametrize("value", first(5, ANYTHING))
def test_what_is_set_is_computed_with_as_in_python_or_gives_the_laws_back(name: str, value: Any) -> None:
    def act(m: Any) -> Any:
        """Set it, or an element of it; what the law does then."""
        found: Any = getattr(m, name)
        if isinstance(found, np.ndarray):
            setattr(m, name, np.array([value, 1]))
        elif name == "pairs":
            found[0] = (value, 1.0)
        elif isinstance(found, MutableSequence):
            found[0] = value
        else:
            setattr(m, name, (value, 2) if name == "pair" else value)
        try:
            m.control()
        except Exception as error:
            return type(error)
        return m.motor.pending

    alone = pump(Typed)
    with running(pump(Typed)) as run, connect(alone, wired(alone, Fragile(), VirtualTimer())):
        for _ in range(2):
            run.m.timer.read(), run.m.sample(), alone.timer.read(), alone.sample()
            assert act(run.m) == act(alone)


def scaled(gains: list[float], value: float, by: float = 1.0) -> float:
    return gains[0] * value * by


def one(_: Any) -> float:
    return 1.0


def three(_: Any) -> float:
    return 3.0


def test_what_a_partial_or_a_member_of_an_enum_has_is_seen_to_change() -> None:
    gains, values = [1.0], [2.0]
    scale = partial(scaled, gains, by=3.0)

    class Kind(Enum):
        FIRST = values

        own = one

    class Reading(Pump):
        def control(self) -> None:
            self.motor.write(scale(1.0) + Kind.FIRST.value[0] + Kind.FIRST.own())

    changes: list[tuple[Callable[[], Any], float]] = [
        (lambda: gains.__setitem__(0, 2.0), 9.0),
        (lambda: scale.keywords.update(by=1.0), 5.0),
        (lambda: values.__setitem__(0, 1.0), 4.0),
        (lambda: setattr(Kind, "own", three), 6.0),
        (lambda: setattr(Kind.FIRST, "_value_", [0.0]), 5.0),
    ]
    for change, pending in changes:
        with running(pump(Reading)) as run:
            change()
            run.step()
            assert (run.laws.state, run.m.motor.pending) == ("python", pending)


class Fast:
    limit = 1.0


class Slow(Fast):
    pass


class Classed(Pump):
    def setup(self) -> None:
        self.speed = Fast()

    def control(self) -> None:
        self.motor.write(1.0 if isinstance(self.speed, Slow) else 2.0)


@pytest.mark.parametrize("period", [0, 30])
def test_the_class_of_an_object_that_code_asks_for_is_seen_to_change(period: int) -> None:
    with running(pump(Classed)) as run:
        run.step(period)
        run.m.speed.__class__ = Slow
        run.step()
        assert (run.laws.state, run.m.motor.pending) == ("python", 1.0)


def test_a_class_with_a_metaclass_of_its_own_is_not_made_a_class_below_it() -> None:
    made: list[str] = []

    class Counting(type):
        def __init__(cls, *given: Any) -> None:
            super().__init__(*given)
            made.append(cls.__name__)

    class Limits(metaclass=Counting):
        label = "low"

    class Reading(Pump):
        def setup(self) -> None:
            self.limits = Limits()

        def control(self) -> None:
            self.motor.write(1.0 if self.limits.label == "low" else 2.0)

    with running(pump(Reading)) as run:
        assert made == ["Limits"]
        Limits.label = "high"
        run.step()
        assert (run.laws.state, run.m.motor.pending) == ("python", 2.0)


def test_the_class_of_a_bound_object_is_not_told_of_the_one_below_it() -> None:
    told: list[type] = []

    class Told(Pump):
        def __init_subclass__(cls, **given: Any) -> None:
            told.append(cls)
            super().__init_subclass__(**given)

    with running(pump(Told)) as run:
        assert run.laws.state == "compiled" and type(run.m) is not Told and told == []
        assert type(run.m)._settings is Told._settings


def test_a_list_that_grows_gives_the_laws_back_to_python() -> None:
    with running(pump()) as run:
        run.m.table.append(3.0)
        assert run.laws.state == "python" and run.m.table == [1.0, 10.0, 3.0]
        run.step()


@pytest.mark.parametrize("gains", [[1.0, 2.0], np.array([1.0, 2.0])], ids=["list", "array"])
def test_a_list_or_an_array_of_the_class_keeps_python(gains: Any) -> None:
    class OfClass(Pump):
        def control(self) -> None:
            self.motor.write(float(self.gains[0]))  # type: ignore[attr-defined]

    OfClass.gains = gains  # type: ignore[attr-defined]
    with running(pump(OfClass), "python") as run:
        assert "gains is a list or an array of its class, which other objects share" in run.events
        gains[0] = 9.0
        run.step()
        assert run.m.motor.pending == 9.0


class PairOfArrays(Pump):
    def setup(self) -> None:
        self.held = (np.zeros(2), np.ones(2))

    def control(self) -> None:
        self.motor.write(float(self.held[0][0]))


class NumberAndArray(Pump):
    def setup(self) -> None:
        self.held = (1.0, np.ones(2))

    def control(self) -> None:
        self.motor.write(float(self.held[1][0]))


class ArrayOrNone(Pump):
    def setup(self) -> None:
        self.held: Any = None
        self.total = 0.0

    def control(self) -> None:
        self.total += 1.0
        if self.total == 3.0:
            self.held = np.zeros(2)
        if self.held is not None:
            sums = self.held + 0.0
            self.motor.write(float(sums[0]))


@pytest.mark.parametrize("kind", [PairOfArrays, NumberAndArray, ArrayOrNone])
def test_an_array_within_another_value_does_not_compile(kind: type[Pump]) -> None:
    machine = pump(kind)
    with pytest.raises(DeclarationError, match=r"held has a list or an array within another value"):
        prepare(machine, resolve(machine, wired(machine, Fragile(), VirtualTimer())))


@dataclass(frozen=True)
class Limits:
    low: float
    high: float


class Limited(Pump):
    """A law with a dataclass that it assigns."""

    def setup(self) -> None:
        self.limits: Any = Limits(0.0, 8.0)

    def control(self) -> None:
        self.limits = replace(self.limits, low=value_of(self.level) / 10.0)
        self.motor.write(min(self.limits.low + 4.0, self.limits.high))


def test_a_dataclass_is_read_and_set_as_before() -> None:
    with running(pump(Limited)) as run:
        assert (run.laws.state, run.m.limits, run.m.motor.pending) == ("compiled", Limits(1.0, 8.0), 5.0)
        run.m.limits = Limits(0.5, 2.0)
        run.step()
        assert (run.laws.state, run.m.limits, run.m.motor.pending) == ("compiled", Limits(1.0, 2.0), 2.0)
        run.m.limits = Limits(0, 3.0)
        assert run.laws.state == "python" and run.m.limits == Limits(0, 3.0)


def test_a_difference_keeps_python(monkeypatch: pytest.MonkeyPatch) -> None:
    source = compiled_laws.source_of_laws

    def other(*given: Any) -> str:
        return source(*given).replace("* m->", "+ m->")

    monkeypatch.setattr(compiled_laws, "source_of_laws", other)
    with running(pump(), "python") as run:
        assert run.laws.state == "python" and "Pump.control is not the same" in run.events
        assert run.m.total == 21 * (10.0 * 0.5 + 2.0) and run.m.motor.read() == 5.0


def test_errors_are_those_of_python_and_come_from_its_line() -> None:
    with running(pump()) as run:
        run.box.set("level", 300)
        with pytest.raises(BadInput, match="level is OUT_OF_RANGE") as of_runtime:
            run.step()
        assert "value_of(self.level)" in raising_line(of_runtime)
        run.box.set("level", 20)
        run.m.total = 2e6
        with pytest.raises(RangeError, match="too much") as told:
            run.step()
        assert "too much" in raising_line(told)
        assert run.laws.state == "compiled"


def raising_line(told: pytest.ExceptionInfo[BaseException]) -> str:
    last = told.traceback[-1]
    assert Path(str(last.path)).name == "test_fallback.py"
    return Path(__file__).read_text().splitlines()[last.lineno]


def test_without_a_compiler_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    machine = pump()
    with pytest.raises(DeclarationError, match="there is no C compiler"):
        prepare(machine, resolve(machine, wired(machine, Fragile(), VirtualTimer())))


def test_a_library_is_compiled_once_and_again_where_it_is_damaged(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def prepared() -> Any:
        machine = pump(Once)
        return prepare(machine, resolve(machine, wired(machine, Fragile(), VirtualTimer())))

    class Once(Pump):
        """No other test has loaded its library."""

        def control(self) -> None:
            self.motor.write(1.25)

    compiled: list[Any] = []
    run = law_library.subprocess.run

    def noted(words: Any, **more: Any) -> Any:
        compiled.extend([words] if "--version" not in words else [])
        return run(words, **more)

    monkeypatch.setattr(law_library.subprocess, "run", noted)
    library = prepared().library
    assert cache.stat().st_mode & 0o777 == 0o700
    library.write_bytes(library.read_bytes()[:100])
    for _ in range(2):
        assert prepared().library == library
        assert len(compiled) == 2


def test_a_compilation_that_fails_by_itself_leaves_the_laws_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, said = pump(), list[str]()
    monkeypatch.setattr(compiled_laws, "translate", lambda *_: {}["nobody thought of it"])
    found = replace(resolve(machine, wired(machine, Fragile(), VirtualTimer())), process=ProcessSettings(compile=True))
    assert prepare_if_asked(machine, found, said.append) is None
    assert said[0].startswith("the laws run in Python, not compiled: KeyError: 'nobody thought of it'")


@pytest.mark.parametrize(
    ("fails", "told"),
    [
        (
            False,
            "the laws are compiled: C drives as soon as each law gave the same results as in Python for 20 of its "
            "periods",
        ),
        (True, "the laws run in Python, not compiled: KeyError: 'gone'"),
    ],
)
def test_a_run_says_whether_its_laws_are_compiled(monkeypatch: pytest.MonkeyPatch, fails: bool, told: str) -> None:
    monkeypatch.setattr(compiled_laws, "CompiledLaws", lambda *_: {}["gone"] if fails else None)
    said = list[str]()
    start_compiled(Mock(), Mock(), said.append)
    assert len(said) == 1 and said[0].startswith(told)


def test_what_does_not_translate_is_told_and_the_run_goes_on(umo: Umo, tmp_path: Path) -> None:
    assert umo("new", "station", "tank").exit_code == 0
    control = tmp_path / "tank" / "control.py"
    law = "        self.regulator.control()\n"
    control.write_text(control.read_text().replace(law, f"{law}        self.seen = sorted([1])\n"))
    wiring = tmp_path / "tank" / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text() + "\n[process]\ncompile = true\n")
    result = umo("run", "tank", "--no-plot")
    said = " ".join(result.stderr.split())
    assert result.exit_code == 0 and "the laws run in Python, not compiled: tank/control.py:" in said
    wiring.write_text(wiring.read_text().replace("compile = true", 'compile = "yes"'))
    result = umo("run", "tank")
    assert result.exit_code == 2 and "must be true or false, without quotes, not 'yes'" in result.stderr


def test_a_compiled_run_is_replayed_in_python(umo: Umo, tmp_path: Path) -> None:
    assert umo("new", "station", "tank").exit_code == 0
    wiring = tmp_path / "tank" / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text() + "\n[process]\ncompile = true\n")
    assert "[parameters]" in wiring.read_text()
    with observed():
        assert umo("run", "tank", "--no-plot", "--record", "tank.mcap").exit_code == 0
    replayed = umo("recording", "replay", "tank.mcap", "tank")
    assert replayed.exit_code == 0 and replayed.stdout.startswith("identical: 831 periods")


def test_without_the_extension_the_library_is_called_by_ctypes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_laws, "extension", None)
    with running(pump()) as run:
        assert run.laws.state == "compiled"
        run.m.total = 0.0
        run.step()
        assert run.m.total == 10.0 * 0.5 + 2.0


def test_what_a_text_under_a_name_decides_is_left_out_and_listed() -> None:
    class ChangeEvents(Pump):
        def setup(self) -> None:
            super().setup()
            self.phase = ""

        def control(self) -> None:
            super().control()
            phase = f"pumping {self.total:.0f}"
            if phase != self.phase:
                self.phase = phase
                self.cycle.progress(phase)

    with running(pump(ChangeEvents)) as run:
        assert "phase != self.phase only decides which text is made" in run.events


def test_an_array_that_laws_change_in_place_is_one_that_they_can_change_when_python_drives_again() -> None:
    with CompiledRun(pump(Rounded)) as run:
        run.m.gain = "much"
        run.m.gain = 0.25
        run.box.set("level", 21)
        run.step()
        assert (run.laws.state, list(run.m.weights), run.m.motor.pending) == ("python", [3.0, 2.0], 0.75)
