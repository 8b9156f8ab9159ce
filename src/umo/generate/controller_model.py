"""The model of a generated controller: the objects, interlocks and laws of a machine, with their numbers.

The model is read from a machine that is laid out as if it were connected (`laid_out`): the same slots, the same order
of laws, the same raw integers of defaults. No device is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from types import MethodType
from typing import Any, NamedTuple

from umo.control.axis import Axis
from umo.cycle.directory import axes_in
from umo.cycle.equipment import equipment_in
from umo.cycle.image import Image
from umo.cycle.laid_out import laid_out as machine_laid_out
from umo.cycle.machine import ConnectedMachine
from umo.cycle.rate_groups import PartGroup
from umo.drivers.contract import Direction
from umo.errors import DeclarationError
from umo.objects import Actuator, Binary, Compound, Digital, Node, Sensor, described, walk
from umo.objects.interpolation import Cubics, Segments
from umo.objects.keywords import IN_MANUAL
from umo.objects.linearization import Linearization
from umo.objects.scaling import raw_bounds
from umo.wiring import resolve
from umo.wiring.wired import AT_ONCE, Wire, Wired

LEAST_RAW, GREATEST_RAW = -(2**31), 2**31 - 1
"""The smallest and largest raw integer of a controller, which has 32 bits for them."""
MOST = 2**15 - 1
"""The highest number of an object, which has 16 bits on a controller."""
EXACT_RAW = 2**24
"""Integers up to this one are exact as 32-bit floats."""


class NotGenerated(NamedTuple):
    """A part of the declaration that a generated controller does not support."""

    path: str
    reason: str
    nearest: str

    def __str__(self) -> str:
        return f"{self.path or 'the machine'}: {self.reason}; {self.nearest}"


@dataclass(frozen=True)
class ControllerObject:
    """One object, with its place in the image and its properties. A time or rate is None if it is not set."""

    slot: int
    path: str
    kind: str
    """The class, such as DigitalSensor."""
    units: str
    """The units of a digital object, or the states of a binary one."""
    channel: str
    """The channel as written in the wiring."""
    output: bool
    binary: bool
    synchronous: bool
    scale: tuple[float, float]
    """Resolution and zero offset."""
    bounds: tuple[float, float]
    """Minimum and maximum."""
    good: tuple[float, float] = (0.0, 0.0)
    """The bounds within which the value of a sensor is GOOD."""
    raws: tuple[float, float] = (0.0, 0.0)
    """The smallest and the largest raw integer of an actuator or a timer."""
    one: int = 0
    """The number of the state of a binary object for level 1, in the order of the Enum."""
    clamps: bool = False
    marks: bool = False
    incremental: bool = False
    max_age: float | None = None
    default: float = 0.0
    default_raw: int = 0
    slew_rate: float | None = None
    expires: float | None = None
    filter: float | None = None
    velocity: float | None = None
    debounce: float | None = None
    rollover_bits: int = 0
    invalid_raws: tuple[int, ...] = ()
    linearization: Linearization | None = None
    equipment: int = -1
    """The innermost equipment that contains the object; -1 if none."""
    group: int = -1
    """The group with which the object is transferred; -1 for that of the whole machine."""

    @property
    def conditioned(self) -> bool:
        times = self.filter, self.velocity, self.debounce
        return bool(self.rollover_bits) or any(each is not None for each in times)


@dataclass(frozen=True)
class ControllerInterlock:
    """One interlock. `outputs` are the indices of its actuators among the outputs, in stop order."""

    condition: Callable[[], bool]
    reason: str
    outputs: list[int]
    latched: bool
    stops: bool


@dataclass(frozen=True)
class ControllerEquipment:
    """A part of the machine that can be in fault while the rest of the machine runs."""

    path: str
    outer: int
    """The equipment that contains this equipment; -1 if none."""
    entered: list[MethodType]
    """The methods called when the fault of the equipment begins, outer parts before inner ones."""


@dataclass(frozen=True)
class ControllerGroup:
    """A part that has its own rate."""

    path: str
    every: int
    """The number of machine periods in one period of the part."""
    phase: int
    """The number of the first period in which the part acts; 0 means `every`."""
    period: float


@dataclass(frozen=True)
class ControllerLaw:
    """A law, with the innermost equipment that contains it (-1 for none), and the group in which it acts (-1 for that
    of the whole machine)."""

    control: MethodType
    equipment: int
    group: int = -1


@dataclass
class ControllerModel:
    """The data of a machine that a controller needs."""

    name: str
    period: float
    objects: list[ControllerObject]
    """The objects by slot: sampled inputs, then updated outputs, then asynchronous objects."""
    inputs: int
    """The number of the sampled inputs."""
    outputs: list[int]
    """The slots of the actuators, in the order of the transfer."""
    stop_order: list[int]
    """The indices of the actuators among the outputs, in the order in which they go to their defaults."""
    timer: int
    interlocks: list[ControllerInterlock]
    equipment: list[ControllerEquipment]
    """The equipment, outer before inner."""
    laws: list[ControllerLaw]
    """The `control` methods, each of the class that defines it, in the order in which the laws of a group act."""
    groups: list[ControllerGroup] = field(default_factory=list)
    """The parts that have their own rates, the fastest first."""
    axes: list[Axis] = field(default_factory=list)
    """The axes that the controller brakes to standstill when the host is silent."""
    problems: list[NotGenerated] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def conditions(self) -> list[Callable[[], bool]]:
        """The functions that return a condition: those of the interlocks, then those that tell whether axes move."""
        return [*(each.condition for each in self.interlocks), *(axis._moves for axis in self.axes)]

    @property
    def steps(self) -> list[Callable[..., Any]]:
        """The functions that act: the laws, then the methods called at faults of equipment, then the braking of
        axes."""
        entered = [one for each in self.equipment for one in each.entered]
        return [*(each.control for each in self.laws), *entered, *(axis._brake for axis in self.axes)]


@contextmanager
def laid_out(root: Compound, wiring: Wired | Path | str | Mapping[str, Any] | None = None) -> Iterator[ControllerModel]:
    """Return a context that yields the model of a machine with this wiring. Inside the context, the objects have their
    slots, calibrations and parameters as if they were connected. No device is opened, and nothing is read or written.
    The errors are those of `connect`."""
    if root.cycle.connected:
        raise DeclarationError(f"{type(root).__name__} is already connected")
    wired = wiring if isinstance(wiring, Wired) else resolve(root, wiring, to_run=False)
    with machine_laid_out(root, wired) as machine:
        yield model_of(machine, wired)


def model_of(machine: ConnectedMachine, wired: Wired) -> ControllerModel:
    """Return the model of a connected machine."""
    image, root = machine.image, machine.root
    outputs = [slot for slot, item in enumerate(image.items) if item.direction is Direction.OUTPUT]
    place = {slot: number for number, slot in enumerate(outputs)}
    containing = _Containing(root)
    objects = [
        replace(_object(image, slot, wire, containing), group=_group(machine, wire.item))
        for slot, wire in enumerate(image.wires)
    ]
    model = ControllerModel(
        name=type(root).__name__,
        period=machine.clock.period,
        objects=objects,
        inputs=sum(one.synchronous and not one.output for one in objects),
        outputs=outputs,
        stop_order=[place[slot] for slot in machine.claims.order],
        timer=image.timer,
        interlocks=[
            ControllerInterlock(
                each.interlock.condition,
                each.interlock.reason,
                [place[slot] for slot in each.slots],
                each.interlock.latched,
                each.interlock.effect == "stop",
            )
            for each in machine.claims.inhibitions
        ],
        equipment=containing.described(),
        laws=[
            ControllerLaw(law, containing.innermost(law.__self__), _group(machine, law.__self__))
            for law in machine.acting_laws.of(root)
        ],
        groups=[ControllerGroup(each.path, each.every, each.phase, each.clock.period) for each in machine.groups.parts],
        axes=[each for each in axes_in(root) if isinstance(each, Axis)],
    )
    model.problems += [*_problems(machine, wired, objects), *too_many(model)]
    model.notes += _notes(objects)
    return model


def _group(machine: ConnectedMachine, node: Any) -> int:
    """Return the number of the group that contains a node; -1 for that of the whole machine."""
    group = machine.groups.of(node)
    return group.clock.group if isinstance(group, PartGroup) else -1


class _Containing:
    """The equipment of a machine, without equipment that contains failures in manual mode only: a controller has no
    modes."""

    def __init__(self, root: Compound) -> None:
        self._all = [each for each in equipment_in(root) if each._settings.equipment != IN_MANUAL]
        self._numbers = {id(each): number for number, each in enumerate(self._all)}

    def innermost(self, node: Any) -> int:
        """Return the number of the innermost equipment around an object; -1 if there is none."""
        while isinstance(node, Node):
            if (found := self._numbers.get(id(node))) is not None:
                return found
            node = node._parent
        return -1

    def described(self) -> list[ControllerEquipment]:
        return [ControllerEquipment(each._path, self.innermost(each._parent), _entered(each)) for each in self._all]


def _entered(compound: Compound) -> list[MethodType]:
    nodes = (node for node in (compound, *walk(compound)) if isinstance(node, Compound))
    return [node._enter_fault for node in nodes if type(node)._enter_fault is not Compound._enter_fault]  # type: ignore[misc]


def _object(image: Image, slot: int, wire: Wire, containing: _Containing) -> ControllerObject:
    item: Any = wire.item
    scales, binary = image.scales, isinstance(item, Binary)
    given: dict[str, Any] = {}
    if isinstance(item, Sensor):
        given |= _of_sensor(item, image, slot)
    elif isinstance(item, Actuator):
        given |= _of_actuator(item, image, slot)
    if binary:
        given["one"] = [*item.states].index(item.one)
    return ControllerObject(
        slot=slot,
        path=item.path,
        kind=type(item).__name__,
        units=f"{item.states.__name__}, 1 is {item.one}" if binary else described(item).unit,
        channel=image.wire_texts[slot],
        output=item.direction is Direction.OUTPUT,
        binary=binary,
        synchronous=item.synchronous,
        scale=(float(scales.resolution[slot]), float(scales.zero_offset[slot])),
        bounds=(wire.calibration.minimum, wire.calibration.maximum),
        max_age=item._max_age,
        linearization=wire.linearization,
        equipment=containing.innermost(item),
        **given,
    )


def _of_sensor(item: Sensor, image: Image, slot: int) -> dict[str, Any]:
    wire, scales = image.wires[slot], image.scales
    of_timer = (float(image._least_ticks), float(image._most_ticks)) if slot == image.timer else (0.0, 0.0)
    return {
        "good": (float(scales.low[slot]), float(scales.high[slot])),
        "marks": item._marks,
        "raws": of_timer,
        "debounce": item._debounce,
        "incremental": item._incremental,
        "filter": item._filter,
        "velocity": item._velocity,
        "rollover_bits": wire.rollover_bits,
        "invalid_raws": tuple(raw for raw in wire.invalid_raws if LEAST_RAW <= raw <= GREATEST_RAW),
    }


def _of_actuator(item: Actuator, image: Image, slot: int) -> dict[str, Any]:
    wire, scales = image.wires[slot], image.scales
    return {
        "raws": (float(scales.least[slot]), float(scales.greatest[slot])),
        "default": item._default_value(),
        "default_raw": wire.default,
        "expires": item.expires,
        "clamps": item._clamp,
        "slew_rate": item._slew_rate,
    }


def _problems(machine: ConnectedMachine, wired: Wired, objects: list[ControllerObject]) -> Iterator[NotGenerated]:
    if wired.period is None:
        yield NotGenerated("", "it has no timer", "declare a DigitalSensor `timer` and wire it with a period")
    if wired.process.outputs != AT_ONCE:
        yield NotGenerated(
            "", f'its outputs are sent "{wired.process.outputs}"', f'leave out `outputs`, or "{AT_ONCE}"'
        )
    for one in objects:
        if not isinstance(machine.image.items[one.slot], Binary | Digital):
            yield NotGenerated(one.path, f"a controller has no {one.kind}", "a binary object, or a digital one")
        yield from _problems_of(one)


def too_many(model: ControllerModel) -> Iterator[NotGenerated]:
    """Yield an obstacle for each kind of parts of which there are more than a controller can number."""
    counts = [
        ("", "objects", len(model.objects)),
        ("", "interlocks", len(model.interlocks)),
        ("", "equipment", len(model.equipment)),
        ("", "parts with rates of their own", len(model.groups)),
        *((one.path, "invalid raw integers", len(one.invalid_raws)) for one in model.objects),
    ]
    for path, what, count in counts:
        if count > MOST:
            yield NotGenerated(path, f"it has {count} {what}", f"a controller has {MOST} at most")
    for each in model.groups:
        if each.every > GREATEST_RAW:
            yield NotGenerated(
                each.path, f"it acts every {each.every} periods", f"at most every {GREATEST_RAW} periods"
            )


def _problems_of(one: ControllerObject) -> Iterator[NotGenerated]:
    raws = one.raws if one.output else _raws_of_range(one)
    if not all(LEAST_RAW <= raw <= GREATEST_RAW for raw in raws):
        nearest = "a coarser resolution, or a smaller range"
        yield NotGenerated(one.path, f"its raw integers reach {raws[1]:.0f}, beyond 32 bits", nearest)
    if one.rollover_bits > 32:
        yield NotGenerated(one.path, f"its counter has {one.rollover_bits} bits", "a counter of at most 32 bits")
    if one.linearization is not None and not has_curves(one.linearization):
        nearest = "a Polynomial, a LookupTable or a Thermocouple"
        yield NotGenerated(one.path, f"{one.linearization} is a user-defined linearization", nearest)


def _raws_of_range(one: ControllerObject) -> tuple[float, float]:
    """Return the raw integers at the ends of a sensor's range; 0 if it has a linearization, whose table is bounded."""
    if one.linearization is not None or one.binary:
        return 0.0, 0.0
    return raw_bounds(*one.bounds, *one.scale)


def has_curves(linearization: Linearization) -> bool:
    """True if the linearization is interpolated in a table in both directions."""
    kind = type(linearization)
    own = kind.to_value is not Linearization.to_value or kind.to_input is not Linearization.to_input
    return not own and all(isinstance(each, Cubics | Segments) for each in curves_of(linearization))


def curves_of(linearization: Linearization) -> tuple[Cubics | Segments, Cubics | Segments]:
    """Return the curves from the electrical quantity to the value, and from the value back."""
    return linearization._forward, linearization._inverse


def _notes(objects: list[ControllerObject]) -> Iterator[str]:
    for one in objects:
        if not one.synchronous and one.output:
            yield f"{one.path} is asynchronous: the controller sends it with the outputs of the period of the write"
        elif not one.synchronous and one.units != "sampling_period":
            yield f"{one.path} is asynchronous: it is not read on the controller"


def inexact_as_floats(objects: list[ControllerObject]) -> list[str]:
    """Return the paths of objects for which some raw integers are equal when they are stored as 32-bit floats."""
    ends = ((one, one.raws if one.output else _raws_of_range(one)) for one in objects)
    return [one.path for one, raws in ends if any(isfinite(raw) and abs(raw) > EXACT_RAW for raw in raws)]
