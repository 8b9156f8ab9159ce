"""A machine with every kind of object, in Python and in C side by side, over a circuit whose channels fail."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from helpers.machines import timer
from tools.compiled_machine import CompiledMachine, compiled
from umo import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    LookupTable,
    Polynomial,
)
from umo.control import Axis, state_of, value_of
from umo.cycle.connect import connect
from umo.drivers.contract import Channel, IntArray
from umo.errors import ChannelsFailed, EquipmentFault, TaskFailed, UmoError
from umo.generate.c_compiler import compiler
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import ControllerModel, model_of
from umo.generate.struct_memory import StructMemory
from umo.generate.translation import RUNTIME_FAULTS, CodeFault
from umo.generate.translator import translate
from umo.objects import Quality, Sensor, atoms, children, walk
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer

KINDS = {0: None} | {number: kind for number, (_, kind, _) in enumerate(RUNTIME_FAULTS, 1)}
"""The class of a fault by its number."""
needs_a_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler: none of cc, gcc, clang")


class Everything(Compound):
    """Each kind of object, each reaction to a failure, and interlocks of each kind."""

    timer: DigitalSensor
    plain: DigitalSensor
    held: DigitalSensor
    marked: DigitalSensor
    held_then_marked: DigitalSensor
    smooth: DigitalSensor
    moving: DigitalSensor
    counter: DigitalSensor
    encoder: DigitalSensor
    bent: DigitalSensor
    table: DigitalSensor
    door: BinarySensor[PassFail]
    bouncing: BinarySensor[PassFail]
    motor: DigitalActuator
    heater: DigitalActuator
    ramp: DigitalActuator
    valve_position: DigitalActuator
    fragile: DigitalActuator
    lamp: BinaryActuator[OnOff]
    pump: BinaryActuator[OnOff]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.door) is PassFail.FAIL, [self.heater, self.ramp], "the door is open")
        yield Interlock(lambda: value_of(self.marked) > 60.0, [self.pump], "too hot", latched=True)
        yield Interlock(lambda: value_of(self.held) > 90.0, [self.motor], "too far", effect="stop")

    def control(self) -> None:
        plain = value_of(self.plain)
        self.motor.write(plain * 0.1 - 4.0)
        if plain > 20.0:
            self.heater.write(self.smooth.read() * 1.2)
        self.ramp.write(plain * 0.24 - 12.0)
        self.valve_position.write(self.table.read())
        self.fragile.write(self.counter.read() * 0.01)
        self.lamp.write(OnOff.ON if value_of(self.encoder, Quality.UNREFERENCED) > 3.0 else OnOff.OFF)
        self.pump.write(OnOff.ON if plain > 50.0 else OnOff.OFF)


def _sensor(**changes: Any) -> DigitalSensor:
    given = {"minimum": 0.0, "maximum": 100.0, "resolution": 0.3, "zero_offset": 0.1} | changes
    return DigitalSensor("mm", **given)


def _actuator(**changes: Any) -> DigitalActuator:
    given = {"default": 0.0, "minimum": -10.0, "maximum": 10.0, "resolution": 0.03, "zero_offset": 0.01} | changes
    return DigitalActuator("V", **given)


def everything(beyond: float = 0.0) -> Everything:
    """`beyond`: time in ms by which the ages that are allowed are longer than whole periods."""

    def age(periods: int) -> str:
        return f"{periods + beyond} ms"

    relay: Any = {"one": OnOff.ON, "default": OnOff.OFF}
    return Everything(
        timer=timer(),
        plain=_sensor(),
        held=_sensor(on_error="hold", max_age=age(3)),
        marked=_sensor(on_error="mark", invalid_raws=(77, 5)),
        held_then_marked=_sensor(on_error="mark", max_age=age(2)),
        smooth=_sensor(filter="5 ms", on_error="mark"),
        moving=_sensor(velocity="4 ms", on_error="mark"),
        counter=_sensor(maximum=1e5, minimum=-1e5, rollover=12, velocity=0.0, on_error="mark"),
        encoder=_sensor(incremental=True, on_error="hold", max_age=age(1000)),
        bent=_sensor(linearization=Polynomial([0.5, 0.9, 0.001], domain=(-10.0, 110.0)), on_error="mark"),
        table=_sensor(
            maximum=9.0, resolution=0.02, on_error="mark", linearization=LookupTable([0, 1, 2, 5], [0.0, 2.0, 3.0, 9.0])
        ),
        door=BinarySensor(PassFail, one=PassFail.FAIL, on_error="hold", max_age=age(1)),
        bouncing=BinarySensor(PassFail, one=PassFail.PASS, debounce="3 ms", on_error="mark"),
        motor=_actuator(),
        heater=_actuator(minimum=0.0, maximum=100.0, limits="clamp", expires="4 ms"),
        ramp=_actuator(slew_rate=700.0, default=1.0),
        valve_position=_actuator(
            default=2.5, minimum=2.0, maximum=8.0, limits="clamp", linearization=LookupTable([0, 3, 9], [1.0, 4.0, 9.0])
        ),
        fragile=_actuator(minimum=-1e3, maximum=1e3, on_error="retry", max_age=age(3), slew_rate=9000.0),
        lamp=BinaryActuator(OnOff, **relay),
        pump=BinaryActuator(OnOff, **relay, synchronous=False),
    )


class Fragile(Scripted):
    """A circuit whose channels fail at will: `deaf` are the outputs that accept nothing."""

    deaf: frozenset[str] = frozenset()

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        taken = [(c, raw) for c, raw in zip(channels, raws.tolist(), strict=True) if c.text not in self.deaf]
        self._keep([c for c, _ in taken], [raw for _, raw in taken])
        if deaf := [c.text for c in channels if c.text in self.deaf]:
            raise ChannelsFailed(dict.fromkeys(deaf, "deaf"))


def told_by(call: Callable[[], object]) -> str | None:
    """The class of the error of a call; None: it has none."""
    try:
        call()
    except UmoError as error:
        return type(error).__name__
    return None


def without_host(m: Compound) -> None:
    """Its axes cannot plan, as on a controller that has no host."""

    def refused(*_: Any) -> None:
        raise TaskFailed("only the host can do it, and no host is connected")

    for axis in (each for each in walk(m) if isinstance(each, Axis)):
        axis._replan = axis.profile.to = refused  # type: ignore[method-assign, assignment]


class Beside:
    """A connected machine of Python and its controller in C, driven by the same raw integers."""

    def __init__(
        self,
        running: connect[Any],
        box: Fragile,
        controller: CompiledMachine,
        model: ControllerModel,
        faults: Sequence[CodeFault] = (),
    ) -> None:
        self.running, self.box, self.c, self.model = running, box, controller, model
        self.image = running.image
        self.kinds = KINDS | {each.number: each.kind for each in faults}
        self.told: Counter[str | None] = Counter()
        """How often the machine told an error of each class; None: nothing."""
        self.structs: list[StructMemory] = []
        """The fields of the live objects of translated code."""
        self.inputs = [self.image.wires[slot].channel.text for slot in range(model.inputs)]
        self.outputs = [self.image.wires[slot].channel.text for slot in model.outputs]

    @classmethod
    def play(
        cls,
        machine: Compound,
        folder: Path,
        periods: int,
        act: Callable[[Any, CompiledMachine], object] = lambda *_: None,
    ) -> Counter[str | None]:
        """Random periods of a machine in both, the same after each; `act` is what the host does then. How often the
        machine told an error of each class."""
        random, box = Random(1), Fragile()
        missed = [random.choice((0, 0, 0, 0, 2, 5)) for _ in range(periods)]
        running = connect(machine, wired(machine, box, VirtualTimer(missed)))
        sensors = [each.path for each in atoms(machine) if isinstance(each, Sensor) and each.path != "timer"]
        set_inputs(box, sensors, [0] * len(sensors), [False] * len(sensors))
        with running as m:
            both = cls.translated(running, box, folder)
            assert both.difference() == ""
            following = random_inputs(both.model, random)
            for number in range(periods):
                raws, failed = following()
                both.step(max(missed[number], 1), raws, failed, [False] * len(both.outputs))
                assert (number, both.difference()) == (number, "")
                act(m, both.c)
                assert (number, both.difference()) == (number, "")
        return both.told

    @classmethod
    def translated(cls, running: connect[Any], box: Fragile, folder: Path) -> Beside:
        """A connected machine and what is generated from it, compiled in this folder."""
        model = model_of(running.machine, running.wired)
        translation = translate(running.root, model.conditions, model.steps, TARGETS["host"])
        write_folder(files_of(model, translation, TARGETS["host"]), folder)
        c = CompiledMachine(compiled(folder), model.inputs, len(model.outputs))
        both = cls(running, box, c, model, translation.faults)
        both.structs = [c.struct(number, each) for number, each in enumerate(translation.structs)]
        assert c.begin([0] * model.inputs) == 0
        return both

    def push(self) -> None:
        """The host has changed fields in Python: in C, too."""
        for each in self.structs:
            each.push()

    def clear(self, number: int) -> bool:
        """Clear the fault of an equipment, of the whole machine for -1: whether it could be, which is the same in
        both."""
        running = self.running
        part = running.root if number < 0 else running.machine.equipment.all[number].compound
        can = self.c.clear(number)
        try:
            running.machine.equipment.clear(part)
        except EquipmentFault:
            assert not can
        else:
            assert can
        return can

    def step(self, ticks: int, raws: Sequence[int], failed: Sequence[bool], deaf: Sequence[bool]) -> None:
        """One period of both; what they tell must be the same."""
        set_inputs(self.box, self.inputs, raws, failed)
        self.box.deaf = frozenset(text for text, yes in zip(self.outputs, deaf, strict=True) if yes)
        told = self._python()
        self.told[told] += 1
        fault = self.c.step(ticks, raws, failed) or self.c.sent(deaf)
        while not fault and self.c.changed:
            fault = self.c.sent(deaf if self.c.given else ())  # the circuit takes every default
        assert self.kinds[fault] == told, (fault, told)

    def _python(self) -> str | None:
        m = self.running.root
        m.timer.read()
        return told_by(m.sample) or told_by(m.control) or told_by(m.update)

    def difference(self) -> str:
        """The first object, equipment or field that is not the same; empty: all are."""
        in_fault = {each.path: each.fault is not None for each in self.running.machine.equipment.all}
        for number, each in enumerate(self.model.equipment):
            if in_fault[each.path] != bool(self.c.equipment_fault(number)):
                return f"{each.path}: Python has {in_fault[each.path]}, C has {self.c.equipment_fault(number)}"
        return self._of_objects() or next((line for each in self.structs for line in each.differences()), "")

    def _of_objects(self) -> str:
        image = self.image
        for one in self.model.objects:
            slot = one.slot
            python = [image.values[slot], image.quality[slot]]
            c: list[Any] = [self.c.value(slot), self.c.quality(slot)]
            if one.output:
                place = self.model.outputs.index(slot)
                python += [image.pending[slot], image.raws[slot], image.claims.inhibited(slot) is not None]
                c += [self.c.pending(place), self.c.raw(slot), self.c.inhibited(place)]
                if image.quality[slot] == Quality.GOOD:  # the circuit has what was sent last
                    python.append(self.box.get(image.wires[slot].channel.text))
                    c.append(self.c.raws_out[place])
            if one.velocity is not None and image.quality[slot] != Quality.BAD:
                python.append(image.velocity(slot))
                c.append(self.c.velocity(slot))
            if repr(python) != repr(c):
                return f"{one.path}: Python has {python}, C has {c}"
        return ""


def set_inputs(box: Scripted, channels: Sequence[str], raws: Sequence[int], failed: Sequence[bool]) -> None:
    for text, raw, no in zip(channels, raws, failed, strict=True):
        box.set(text, ChannelsFailed({text: "cut"}) if no else raw)


def wiring_of(machine: Compound, box: Scripted, clock: VirtualTimer, *inverted: str) -> dict[str, Any]:
    paths = [path for path in children(machine) if path != "timer"]
    wire: dict[str, Any] = {
        path: {"driver": "box"} | ({"inverted": True} if path in inverted else {}) for path in paths
    }
    wire["timer"] = {"driver": "clock", "period": "1 ms"}
    return {"drivers": {"box": box, "clock": clock}, "wire": wire}


def wired(machine: Compound, box: Fragile, clock: VirtualTimer) -> dict[str, Any]:
    """Every object on the box, by its path."""
    wire: dict[str, Any] = {each.path: {"driver": "box"} for each in atoms(machine) if each.path != "timer"}
    return {"drivers": {"box": box, "clock": clock}, "wire": wire | {"timer": {"driver": "clock", "period": "1 ms"}}}


def random_inputs(model: ControllerModel, random: Random) -> Callable[[], tuple[list[int], list[bool]]]:
    """Raw integers that wander, jump, leave the range, and fail, by input."""
    now = [0] * model.inputs

    def following() -> tuple[list[int], list[bool]]:
        failed = []
        for place, one in enumerate(model.objects[: model.inputs]):
            if one.binary:
                now[place] = random.choice((0, 1)) if random.random() < 0.15 else now[place]
                raw = 7 if random.random() < 0.002 else now[place]
            else:
                now[place] = _wandered(now[place], one.rollover_bits, random)
                raw = now[place]
            failed.append(random.random() < 0.01)
            given.append(raw)
        found, given[:] = list(given), []
        return found, failed

    given: list[int] = []
    return following


def _wandered(raw: int, bits: int, random: Random) -> int:
    if bits:
        return (raw + random.randint(-300, 300)) % (1 << bits)
    if random.random() < 0.02:
        return random.randint(-30, 400)
    return min(max(raw + random.randint(-6, 6), -3), 340)
