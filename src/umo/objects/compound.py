"""Compound objects: objects made of objects (the paper's sections 4.4 and 5.3, Listing 6)."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import MappingProxyType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    Never,
    Union,
    cast,
    dataclass_transform,
    final,
    get_args,
    get_origin,
)

from umo.errors import DeclarationError, PathError
from umo.objects.atomic import Atomic, Binary
from umo.objects.attributes import assign, check_declared, shared
from umo.objects.keywords import AlarmsByName, ByAttribute, ClassSettings, Reaction, refuse_in_body, settings_of
from umo.objects.link import Cycle, Unconnected
from umo.objects.node import Node
from umo.objects.paths import named
from umo.signature import hints_of
from umo.states import shown
from umo.text import cut_repr, in_brackets, shown_place
from umo.user_code import check_overrides, definition, incomplete

if TYPE_CHECKING:
    from umo.objects.interlock import Interlock
    from umo.objects.link import Machine


CONTAINERS: Mapping[Any, str] = {
    **dict.fromkeys((list, Sequence, tuple), "Sequence"),
    **dict.fromkeys((dict, Mapping, MappingProxyType), "Mapping"),
}
"""The annotations for several parts, each with the type that it should have."""


SERVICES = frozenset(("now", "dt", "cycle"))
"""The attributes of a compound that belong to the running cycle."""
RESERVED = SERVICES | {
    "setup", "sample", "control", "update", "reset", "acknowledge", "interlocks", "on_suspend", "on_resume",
}  # fmt: skip
"""The names that no part of a compound can have."""


@dataclass_transform(kw_only_default=True, eq_default=False, field_specifiers=(dataclasses.field,))
class Compound(Node):
    """Base of compound objects: annotate a field for each part, and give the parts as keywords.

        class ServoAxis(Compound):
            motor: DigitalActuator
            encoder: DigitalSensor
            speed: float = 100.0        # a number that a wiring may set

    Parts may also stand in lists and dicts. They are frozen at construction, to tuples and read-only mappings: annotate
    them `Sequence[ServoAxis]` and `Mapping[str, ServoAxis]`. A class's own state belongs in `setup`.

    Settings of a class are class keywords. A subclass inherits the settings that it does not give itself:

        class Press(Compound, stop_order=("ram.motor", "zones.*.heater", "valves"), max_period="10 ms"):

    stop_order: The order in which the objects are reset to their defaults: paths below this object, patterns, and names
        of lists and dicts (for all objects in them). Default: as declared; objects that are not named follow in this
        order. A part uses its own `stop_order`, unless a parent names the part's objects.
    max_period: The longest sampling period for which `control` is designed, in s or as "2 ms". Default: not limited.
    equipment: Whether the compound fails alone (the equipment module of ISA-88). If one of its objects, its `control`
        or a sequence that was started in it fails, its actuators go to their defaults in stop order, its sequences end,
        and it is in fault (`cycle.fault`) until `cycle.clear()`. The other parts of the machine continue. With "manual"
        this applies in manual mode only, as for an axis. With False (the default) a failure belongs to the equipment
        around the compound, or ends the run if there is none. The setting has no effect on the machine itself.
    numbers: The numbers that are not fields, such as those of laws and properties, by the names of the attributes:
        `numbers={"law.gain": Number("V/mm", 0.0, 2.0, tunable=True), "load": Number("N", shown=True)}`, or a function
        of the object that returns them. The numbers of the base are kept; if both declare a name, the subclass takes
        precedence.
    when_suspended: What happens to the actuators and axes below in a change to manual mode, and to those that an action
        has left when its client's lease ends. "default": actuators go to their defaults, axes are disabled. "hold":
        actuators keep their values, axes stop on their profiles and stay under control. "run on": actuators keep their
        values, motions continue to their ends. A law (`control`) that writes an actuator in each period continues to do
        so. The nearest declaration applies. Default: "default" for actuators, "hold" for axes.
    every: The rate of a part of the machine: it is sampled, controlled and updated in every n-th period (`every=10`),
        or at a period of its own, a multiple of the machine's (`every="10 ms"`). Objects in it have the same rate,
        unless their class has `every`, too. `dt` and `cycle.period` of the part belong to the periods of the part. A
        period first carries out the parts with the machine's rate, including their outputs, then the other parts that
        are due. The setting has no effect on the machine itself. Default: the rate of the object around it; 1 for the
        machine.
    alarms: The alarms for the operator (ISA-18.2): each an `umo.operation.alarms.Alarm` by its name, or a function of
        the object that returns them. The alarms of the base are kept; if both declare a name, the subclass takes
        precedence. The path of an alarm consists of the object's path and the alarm's name: `tank.overfill`.

    A wiring may set a field with a number (or bool, string, Enum). Unit, range and use are annotated:

        gain: Annotated[float, Number("V/mm", 0.0, 3.0, tunable=True)] = 0.3
    """

    _settings: ClassVar[ClassSettings] = ClassSettings()
    _children: Mapping[str, Node] = MappingProxyType({})
    _fixed: frozenset[str] = frozenset()  # the fields that hold parts
    _free: frozenset[str] = frozenset()  # the attributes that are assigned without a look
    _parametrised: bool = False  # `setup` last saw fields that a wiring had set
    _machine: Machine

    def __init_subclass__(
        cls,
        *,
        stop_order: Sequence[str] | None = None,
        max_period: str | float | None = None,
        equipment: bool | Literal["manual"] | None = None,
        numbers: ByAttribute | None = None,
        when_suspended: Reaction | None = None,
        every: int | str | None = None,
        alarms: AlarmsByName | None = None,
        **unknown: Never,
    ) -> None:
        super().__init_subclass__()
        cls._free = cls._class_names  # until it has its parts
        given = {
            "stop_order": stop_order,
            "max_period": max_period,
            "equipment": equipment,
            "numbers": numbers,
            "when_suspended": when_suspended,
            "every": every,
            "alarms": alarms,
            **unknown,
        }
        cls._settings = settings_of(cls, given)
        dataclasses.dataclass(eq=False, repr=False, kw_only=True)(cls)
        names = [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]
        refuse_in_body(cls, names)
        _check_hooks(cls)
        for name in vars(cls).keys() - {*names}:
            if isinstance(part := vars(cls)[name], Node):
                how = f"`{name}: {type(part).__name__}`, and give the object where the {cls.__name__} is made"
                raise DeclarationError(f"{cls.__name__}.{name} is not a part of its objects: write {how}")
        for name in names:
            if name in RESERVED or name.startswith("_"):
                raise _reserved(cls, name)
        own = (each for each in cls.__mro__ if each not in Compound.__mro__)  # mixins too
        for name in (name for each in own for name in SERVICES & vars(each).keys()):
            raise _reserved(cls, name)

    @final
    def __post_init__(self) -> None:
        if self._abstract:
            raise incomplete(type(self), self._abstract)
        self._parent = None
        self._name = ""
        self._disconnect()
        cls: Any = type(self)
        hints = {name: Any if isinstance(hint, str) else hint for name, hint in hints_of(cls).items()}
        children: dict[str, Node] = {}
        fixed = set()
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            if not hasattr(self, field.name):
                continue  # `field(init=False)`: its class sets it later
            frozen, parts = _parts(field.name, getattr(self, field.name))
            _check_type(f"{type(self).__name__}.{field.name}", frozen, hints.get(field.name, Any))
            if parts:
                assign(self, field.name, frozen)
                children.update(parts)
                fixed.add(field.name)
        for name, child in children.items():
            child._adopt(self, name)
        self._children, self._fixed = MappingProxyType(children), RESERVED | fixed
        self._free = shared(self._class_names.union(vars(self)) - self._fixed)
        for path in self._settings.stop_order:
            try:
                named(self, path)
            except PathError as error:
                raise PathError(f"stop_order: {error}") from None
        self.setup()

    def setup(self) -> None:
        """Override this method to create the attributes of the class, such as control laws. It is called at the end of
        construction, and again on connect if a wiring sets fields of the machine (`[parameters]`). The `setup` of the
        parts is called first."""

    def _set_up(self) -> None:
        """Call `setup` of the parts, then `setup` of this object."""
        for child in self._children.values():
            if isinstance(child, Compound):
                child._set_up()
        self.setup()

    if not TYPE_CHECKING:  # typed, any attribute could be assigned

        def __setattr__(self, name, value):
            if name not in self._free or (isinstance(value, Node) and value._parent is None and self._fixed):
                self._admit(name, value)
            assign(self, name, value)

    def _admit(self, name: str, value: object) -> None:
        """Check an assignment to a part, an assignment of an object, or an assignment to an attribute that is not
        known."""
        if name in self._fixed:
            if name in RESERVED:
                raise _reserved(type(self), name)
            what = f"{self._path or type(self).__name__}.{name} is a part; parts cannot be replaced"
            raise DeclarationError(f"{what}{_written(self._children.get(name), value)}")
        is_new = isinstance(value, Node) and value._parent is None and name != "_parent"
        if is_new and self._fixed and not self._is_below(value):
            raise DeclarationError(f"{type(self).__name__}.{name}: declare an object as an annotated field")
        if name not in self._class_names:
            check_declared(self, name)
            self._free = shared(self._free | {name})

    def interlocks(self) -> Iterable[Interlock]:
        """Return the interlocks of this object. Override it to declare interlocks. Called on connect."""
        return ()

    def on_suspend(self) -> None:
        """Override this method to bring the work of this object to a safe state. It is called once when the machine
        changes to manual mode, in which the sequences of the application wait, and for a parent before its parts. The
        values that this method writes remain."""

    async def on_resume(self) -> None:
        """Override this method for work that must be done before the application continues, such as a spindle's run-up.
        It is called when the machine has changed back to automatic mode and the actuators have the values of the
        application again. If this method fails, the machine goes back to manual mode."""

    # One period ------------------------------------------------------------------------------------

    def sample(self) -> bool:
        """Read every synchronous sensor below, and return True if all are GOOD. Raises DriverError with a list of the
        failures. With `outputs = "at next tick"`, `sample` of the whole machine first sends the outputs that `update`
        has not sent, and the list of failures also contains the outputs that were not accepted."""
        return self._machine.sample(self)

    def update(self) -> bool:
        """Send every synchronous actuator below, and return True. Raises DriverError if an output was not accepted.
        With `outputs = "at next tick"` in the wiring's `[process]`, `update` of the whole machine sends nothing; the
        next `sample` sends the outputs."""
        return self._machine.update(self)

    def reset(self) -> None:
        """Reset every object below immediately: actuators go to their defaults in stop order, then sensors clear the
        faults of their circuits."""
        self._machine.reset(self)

    def acknowledge(self) -> bool:
        return self._machine.acknowledge(self)

    @property
    def dt(self) -> float:
        """The time in s since the previous period: the number of ticks that the timer consumed, times the period. In a
        sequence: the time since its previous step."""
        return self._machine.clock.dt

    @property
    def now(self) -> float:
        """The time in s on the cycle's clock."""
        return self._machine.clock.now

    @property
    def cycle(self) -> Cycle:
        """The running cycle as this object sees it: `m.cycle.start(...)`, `m.cycle.running`."""
        return Cycle(self._machine, self)

    def _enter_fault(self) -> None:
        """Handle the fault of the equipment to which this object belongs: nothing moves the object any more."""

    def _connect(
        self,
        machine: Machine,
        sample: Callable[[], bool],
        control: Callable[[], None],
        update: Callable[[], bool],
    ) -> None:
        """Connect the compound. `sample`, `control` and `update` become its methods, so that they are called in every
        period without a look-up."""
        # `m.control()` drives the whole part; the class's own override stays reachable for `super()`
        vars(self).update(_machine=machine, sample=sample, update=update, control=control)

    def _disconnect(self) -> None:
        self._machine = cast("Machine", Unconnected(self))
        for name in ("sample", "update", "control"):
            vars(self).pop(name, None)

    def _is_below(self, other: object) -> bool:
        """Return True if the other object is this one, its parent, or a compound further up. A part can have its parent
        as an attribute."""
        node: Node | None = self
        while node is not None and node is not other:
            node = node._parent
        return node is not None

    def __repr__(self) -> str:
        name = f"{type(self).__name__} {self._path}".rstrip()
        return f"<{name}: {', '.join(self._children) or 'no parts'}>"


def _check_hooks(cls: type[Compound]) -> None:
    check_overrides(cls)
    for name in ("sample", "update"):
        if getattr(cls, name) is not getattr(Compound, name):
            what = f"{cls.__name__}.{name} would never be called: umo moves all objects of a part together"
            raise DeclarationError(f"{what}; the code for each period belongs in `control`")
    for name in ("control", "setup", "interlocks"):
        code = getattr(vars(cls).get(name), "__code__", None)
        if code is None:
            continue
        place = in_brackets(shown_place(definition(vars(cls)[name])))
        if code.co_flags & inspect.CO_GENERATOR and name != "interlocks":
            raise DeclarationError(f"{cls.__name__}.{name} contains `yield`, so its statements would not run{place}")
        if not code.co_argcount and not code.co_flags & inspect.CO_VARARGS:
            raise DeclarationError(
                f"{cls.__name__}.{name} has no parameter for its object: write `def {name}(self)`{place}"
            )
        if code.co_argcount - len(vars(cls)[name].__defaults__ or ()) > 1:
            form = f"`def {name}(self)`{'; the period is `self.dt`' if name == 'control' else ''}"
            raise DeclarationError(f"{cls.__name__}.{name} takes no arguments except its object: write {form}{place}")
    if not inspect.iscoroutinefunction(cls.on_resume):
        raise DeclarationError(f"{cls.__name__}.on_resume must be a sequence: `async def on_resume(self)`")


def _reserved(cls: type, name: str) -> DeclarationError:
    hint = f"; reserved are: {', '.join(sorted(RESERVED))}" if name in RESERVED else ": umo's own begin with _"
    button = f"{name.strip('_') or 'part'}_button" if name in RESERVED else name.strip("_") or "part"
    return DeclarationError(f"{cls.__name__}.{name}: the name is reserved; choose another, such as {button!r}{hint}")


def _written(part: Node | None, value: object) -> str:
    """Return what was probably meant by a value that was assigned to an object."""
    if not isinstance(part, Atomic) or isinstance(value, Node):
        return ""
    return part._instead_of_setting(shown(value))


def _parts(name: str, value: object) -> tuple[object, dict[str, Node]]:
    """Return the value in its frozen form, and the objects in it by name."""
    if isinstance(value, Node):
        return value, {name: value}
    frozen: object
    if isinstance(value, list | tuple):
        named, frozen = {f"{name}.{i}": item for i, item in enumerate(value)}, tuple(value)
    elif isinstance(value, Mapping):
        named, frozen = {f"{name}.{key}": item for key, item in value.items()}, MappingProxyType(dict(value))
    else:
        return value, {}
    parts = {key: item for key, item in named.items() if isinstance(item, Node)}
    if len(parts) < len(named) and any(map(_holds_objects, named.values())):
        raise DeclarationError(f"{name} contains objects and other values: {next(k for k in named if k not in parts)}")
    keys = [key.removeprefix(f"{name}.") for key in parts]
    if parts and (len(parts) < len(value) or any("." in key or not key.isprintable() for key in keys)):
        raise DeclarationError(
            f"{name}: the keys of parts must be different strings without dots and control characters"
        )
    return (frozen, parts) if parts else (value, {})


def _holds_objects(value: object) -> bool:
    if isinstance(value, Mapping):
        value = value.values()
    return isinstance(value, Node) or (isinstance(value, Collection) and any(isinstance(v, Node) for v in value))


def _check_type(where: str, value: object, hint: Any) -> None:
    """Raise DeclarationError for a mistake that a type checker would have found, because not everybody runs one."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin is tuple and args and args[-1] is not Ellipsis and isinstance(value, tuple) and len(args) == len(value):
        for item, each in zip(value, args, strict=True):
            _check_type(where, item, each)
    elif origin in (list, tuple, Sequence) and isinstance(value, tuple):
        for item in value:
            _check_type(where, item, args[0] if args else Any)
    elif origin in (dict, Mapping) and isinstance(value, MappingProxyType):
        for item in value.values():
            _check_type(where, item, args[1] if args else Any)
    elif isinstance(origin, type) and origin in CONTAINERS and isinstance(value, tuple | MappingProxyType):
        raise DeclarationError(f"{where} is annotated {hint}, not as a {CONTAINERS[type(value)]}")
    elif isinstance(origin, type) and issubclass(origin, Node):
        if not isinstance(value, origin):
            instead = f": write `{origin.__name__}(...)`" if isinstance(value, type) else ""
            if isinstance(value, tuple) and len(value) == 1:
                instead = ": a comma after an object makes a tuple of it"
            raise DeclarationError(f"{where} must be a {origin.__name__}, not {value!r}{instead}")
        if isinstance(value, Binary) and args and isinstance(args[0], type) and value.states is not args[0]:
            raise DeclarationError(f"{where} must have the states {args[0].__name__}, not {value.states.__name__}")
    elif isinstance(value, Node) and hint is not Any and get_origin(hint) not in (Union, UnionType):
        raise DeclarationError(f"{where} is annotated {hint}, which does not accept {value!r}")


def check_machine(function: str, given: object) -> None:
    """Check a machine. Raises DeclarationError for anything else, such as the class of a machine or the function that
    makes one."""
    if not isinstance(given, Compound):
        hint = f"; call it: {function}({given.__name__}(...))" if hasattr(given, "__name__") else ""
        raise DeclarationError(f"{function}() takes a machine, a Compound, not {cut_repr(given)}{hint}")
