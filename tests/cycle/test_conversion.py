"""A run is the same in everything, whichever way blocks are converted, and whatever the drivers do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.conversions import WAYS, choose
from helpers.machines import timer
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    LookupTable,
    Polynomial,
    UmoError,
    Vector,
    connect,
)
from umo.objects import Atomic
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer


@dataclass(frozen=True)
class Spec:
    """One object of a random machine."""

    kind: str
    driver: int
    synchronous: bool
    resolution: float
    offset: float
    clamp: bool
    hold: bool
    incremental: bool
    inverted: bool
    mark: bool = False
    curve: Polynomial | LookupTable | None = None
    invalid_raws: tuple[int, ...] = ()
    rate: float | None = None

    def make(self) -> Atomic:
        hold = {"max_age": "2 ms"} if self.hold else {}
        if self.hold or self.mark:
            hold["on_error"] = "mark" if self.mark else "hold"
        scale: Any = {"minimum": -10.0, "maximum": 10.0, "resolution": self.resolution, "zero_offset": self.offset}
        scale["linearization"] = self.curve
        if self.kind == "da":
            limits = "clamp" if self.clamp else "raise"
            rate = self.rate if self.synchronous else None
            guards: Any = {"synchronous": self.synchronous, "slew_rate": rate}
            return DigitalActuator("V", default=0.0, limits=limits, **guards, **scale)
        if self.kind == "ds":
            scale |= {"incremental": self.incremental, "invalid_raws": self.invalid_raws}
            return DigitalSensor("V", synchronous=self.synchronous, **scale, **hold)
        if self.kind == "ba":
            return BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF, synchronous=self.synchronous)
        return BinarySensor(OnOff, one=OnOff.ON, synchronous=self.synchronous, **hold)


SPEC = st.builds(
    Spec,
    kind=st.sampled_from(["da", "ds", "ba", "bs"]),
    driver=st.integers(0, 2),
    synchronous=st.sampled_from([True, True, True, False]),
    resolution=st.sampled_from([1.0, -1.0, 0.1, -0.3, 10 / 2047]),
    offset=st.sampled_from([0.0, 1.5, -7.3]),
    clamp=st.booleans(),
    hold=st.booleans(),
    incremental=st.booleans(),
    inverted=st.booleans(),
    mark=st.sampled_from([False, False, True]),
    curve=st.sampled_from(
        [None] * 9 + [Polynomial([0.5, 1.0, 0.02], (-20, 20)), LookupTable([-20, 0, 30], [30, 0, -12])]
    ),
    invalid_raws=st.sampled_from([()] * 9 + [(2,), (-7, 2**40)]),
    rate=st.sampled_from([None, None, 1000.0, 333.3]),
)
NUMBER = st.integers(0, 99)
RAW = st.integers(-30, 30) | st.sampled_from([0, 1, 2, 2**40, -(2**63), 2**63 - 1])
STEP = (
    st.tuples(st.just("write"), NUMBER, st.floats(-12, 12))
    | st.tuples(st.just("set"), NUMBER, RAW)
    | st.tuples(st.just("break"), st.integers(0, 2), st.booleans())
    | st.tuples(st.sampled_from(["sample", "update", "reset", "timer", "read", "vector"]))
    | st.tuples(st.sampled_from(["sample one", "update one", "reset one", "read one"]), NUMBER)
    | st.tuples(st.just("referenced"), NUMBER, st.booleans())
)


class Heap(Compound):
    timer: DigitalSensor
    parts: list[Atomic]


def play(specs: list[Spec], steps: list[Any], way: str) -> list[Any]:
    """Everything that can be seen of a run, step by step."""
    boxes = [Scripted(), Scripted(), Scripted()]
    machine = Heap(timer=timer(), parts=[spec.make() for spec in specs])
    wire: dict[str, Any] = {"timer": {"driver": "clock", "period": "1 ms"}}
    for i, spec in enumerate(specs):
        wire[f"parts.{i}"] = {"driver": f"box{spec.driver}"}
        if spec.kind in ("ba", "bs"):
            wire[f"parts.{i}"]["inverted"] = spec.inverted
    clock = VirtualTimer(missed=[0, 2, 0, 1, 3])
    # the wall clock has no part in it: a computer that is busy makes none of them late
    patient = {f"box{i}": {"type": box, "timeout": "60 s"} for i, box in enumerate(boxes)}
    drivers: dict[str, Any] = {"clock": clock} | patient
    trace: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        choose(patch, way)
        connection = connect(machine, {"drivers": drivers, "wire": wire})
        with connection as m:
            image = connection.image
            for step in steps:
                try:
                    result = act(m, boxes, step)
                except UmoError as error:
                    result = type(error), str(error)
                trace.append((step, result))
                trace += [[*map(repr, seen)] for seen in (image.values, image.pending, image.sent, image.raws)]
                trace += [[int(q) for q in image.quality], [*map(repr, image.times)], image.clock.now]
            for box in boxes:
                box.broken = None
    return [*trace, *(box.calls for box in boxes)]


def act(m: Heap, boxes: list[Scripted], step: Any) -> Any:
    verb, *rest = step
    if verb == "timer":
        return m.timer.read()
    if verb == "break":
        boxes[rest[0]].broken = OSError("cut") if rest[1] else None
        return None
    if verb == "read":
        return [repr(item.read()) for item in m.parts if item.synchronous or not hasattr(item, "sample")]
    if verb == "vector":
        return vectors(m)
    if not rest:
        return getattr(m, verb)()
    item: Any = m.parts[rest[0] % len(m.parts)] if m.parts else m.timer
    if verb == "set":
        for box in boxes:
            box.set(item.path, rest[1])
    elif verb == "referenced":
        return getattr(item, "incremental", False) and item.referenced(rest[1])
    elif verb == "write":
        if isinstance(item, DigitalActuator):
            return item.write(rest[1])
        return isinstance(item, BinaryActuator) and item.write(OnOff.ON if rest[1] > 0 else OnOff.OFF)
    else:
        return repr(getattr(item, verb.split()[0], lambda: None)())
    return None


def vectors(m: Heap) -> Any:
    motors = [item for item in m.parts if isinstance(item, DigitalActuator) and item.synchronous]
    lamps = [item for item in m.parts if isinstance(item, BinaryActuator) and item.synchronous]
    seen: list[Any] = []
    if motors:
        seen += [Vector(motors).write(np.linspace(-9.0, 9.0, len(motors))), Vector(motors).read().tolist()]
    if lamps:
        seen += [Vector(lamps).write(OnOff.ON), Vector(lamps).read().tolist()]
    return seen


@pytest.mark.parametrize("way", WAYS[1:])
@settings(max_examples=2 * settings().max_examples)
@given(specs=st.lists(SPEC, min_size=3, max_size=8), steps=st.lists(STEP, min_size=10, max_size=40))
def test_both_ways_are_equal_in_everything(way, specs, steps):
    for one, other in zip(play(specs, steps, "numpy"), play(specs, steps, way), strict=True):
        assert one == other


@pytest.mark.parametrize("way", WAYS)
def test_a_machine_of_nothing_runs(way):
    assert play([], [("sample",), ("update",), ("reset",), ("timer",)], way)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("kind", "synchronous"), [("da", True), ("ds", True), ("ba", False), ("bs", False)])
def test_a_machine_of_one_kind_alone_runs(way, kind, synchronous):
    specs = [Spec(kind, i % 3, synchronous, 0.1, 0.0, False, False, False, False) for i in range(5)]
    assert play(specs, [("sample",), ("update",), ("read one", 2), ("reset",), ("write", 1, 3.0)], way)


@pytest.mark.usefixtures("each_way")
def test_sixty_objects_on_three_drivers_move_in_one_transfer_a_driver_and_direction():
    specs = [
        Spec(("da", "ds", "ba", "bs")[i % 4], i // 4 % 3, True, 0.1, 0.0, False, False, False, False) for i in range(60)
    ]
    machine = Heap(timer=timer(), parts=[spec.make() for spec in specs])
    boxes = [Scripted(), Scripted(), Scripted()]
    wire: dict[str, Any] = {f"parts.{i}": {"driver": f"box{s.driver}"} for i, s in enumerate(specs)}
    wire["timer"] = {"driver": "clock", "period": "1 ms"}
    drivers: dict[str, Any] = {"clock": VirtualTimer()} | {f"box{i}": box for i, box in enumerate(boxes)}
    connection = connect(machine, {"drivers": drivers, "wire": wire})
    with connection as m:
        counts = [len(box.calls) for box in boxes]
        m.sample()
        m.update()
        for box, count in zip(boxes, counts, strict=True):
            assert [(c.segment, len(c.channels)) for c in box.calls[count:]] == [("read_many", 10), ("write_many", 10)]
            read, written = box.calls[count:]
            assert list(read.channels) == [
                f"parts.{i}" for i, s in enumerate(specs) if s.kind[1] == "s" and boxes[s.driver] is box
            ]
            assert list(written.channels) == [
                f"parts.{i}" for i, s in enumerate(specs) if s.kind[1] == "a" and boxes[s.driver] is box
            ]
