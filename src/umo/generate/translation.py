"""The result of the translation of control code to C, as data for the generator.

The classes describe the number types of a target, the fields of each object of translated code, and the number and text
of each fault. Code that cannot be translated is reported as an `Untranslatable`, with its place and the nearest
alternative."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from umo.generate.c_types import CType
from umo.generate.known_values import KnownValues

FIRST_FAULT = 32
"""The first number of a fault of translated code. Lower numbers are those of the runtime (umo.h)."""
RUNTIME_FAULTS = (
    ("UMO_UNREAD", "DriverError", "could not be read"),
    ("UMO_UNWRITTEN", "DriverError", "could not be written"),
    ("UMO_BAD_TICKS", "DriverError", "the ticks of the timer are outside its range"),
    ("UMO_OUTSIDE", "RangeError", "the value is outside the range of the actuator"),
    ("UMO_NOT_FINITE", "RangeError", "the value is not finite"),
    ("UMO_BAD_INPUT", "BadInput", "the quality of the sensor is not accepted"),
    ("UMO_NEVER_READ", "BadInput", "the sensor was never read"),
    ("UMO_INTERLOCKED", "Interlocked", "an interlock forbids the write"),
    ("UMO_NO_STATE", "StateError", "no state of the actuator"),
    ("UMO_NO_HOST", "TaskFailed", "only the host can do it, and no host is connected"),
)
"""The faults of the runtime from number 1 on, as in umo.h, with their names, classes and texts."""
NO_HOST = 1 + [name for name, _, _ in RUNTIME_FAULTS].index("UMO_NO_HOST")
"""The fault for a missing host. This fault does not exist in Python."""


class ControllerLimit(OverflowError):
    """An operation that Python can carry out and a controller cannot: an integer leaves 32 bits, a power is complex, or
    the sign of a NaN is used. No `except` in translated code catches it, because Python raises nothing there."""


@dataclass(frozen=True)
class ControllerTarget:
    """The number types and features of a target."""

    name: str
    real: Literal["double", "float"] = "double"
    exact_libm: bool = False
    """True if the target's functions of <math.h> give bit for bit the same results as those of this Python."""
    int_bits: int = 32
    """The width of integers."""
    table_bytes: int | None = None
    """The maximum size of the table of a linearization."""
    makes_texts: bool = False
    """True if Python calls the code and can make texts."""


class CodeFault(NamedTuple):
    """A fault of translated code. It stands for the error that Python raises at that place."""

    number: int
    kind: str
    """The class of the error, such as RangeError."""
    text: str
    """The message as written in the code."""
    file: str
    line: int
    name: str = ""
    """Name of the fault in C."""


class TextMaker(NamedTuple):
    """A text that Python makes for compiled laws."""

    make: Callable[..., Any]
    """Function that returns the error or the text for these variables."""
    given: Sequence[CType]
    """The types of the variables."""
    fault: int = 0
    """The number of the fault that has this error; 0 if none."""
    field: tuple[Any, str] | None = None
    """The object and the attribute to which the text is assigned."""


class StructField(NamedTuple):
    """A field of a struct, for an attribute of a live object."""

    path: str
    """Path of the object or law, such as `z.servo`."""
    struct: str
    name: str
    kind: str
    """The type in C."""
    owner: Literal["INPUT", "STATE"]
    """INPUT if only the host may assign the field, STATE if translated code assigns it."""


class Untranslatable(NamedTuple):
    """A piece of Python that cannot be translated to C."""

    file: str
    line: int
    source: str
    reason: str
    nearest: str

    def __str__(self) -> str:
        near = f"; use instead: {self.nearest}" if self.nearest else ""
        place = f"{self.file}:{self.line}: " if self.file else ""
        return f"{place}{self.source}: {self.reason}{near}"


class CFunction(NamedTuple):
    """The signature of a translated function. The function returns its fault, and stores its result at the address in
    its last argument."""

    name: str
    arguments: tuple[str, ...] = ("m",)

    def call(self, *more: str) -> str:
        return f"{self.name}({', '.join((*self.arguments, *more))})"


@dataclass
class Translation:
    """The translated functions of one machine."""

    header: str = ""
    """The structs and prototypes."""
    members: str = ""
    """The members of `struct umo_machine` for these structs, one per line."""
    source: str = ""
    """The functions."""
    fault_names: str = ""
    """The names of the faults, as an enum of C."""
    effects: Mapping[str, Set[str | int]] = field(default_factory=dict)
    """The effects of each function and of those that it calls: the called functions of the runtime, the members of
    objects that are read (`zero_offset`), ASSIGNS, and numbers of `text_makers`."""
    init: str = "static void init_objects(umo_machine *m)\n{\n    (void)m;\n}\n"
    """The function that fills the structs with the live values."""
    access: str = ""
    """The function that finds the structs by number."""
    entry: Mapping[Any, CFunction] = field(default_factory=dict)
    """The signature of each function."""
    faults: list[CodeFault] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    """The Python files of the functions. A fault of the runtime is reported with one of these files (`umo_at`)."""
    layout: list[StructField] = field(default_factory=list)
    structs: list[Any] = field(default_factory=list)
    """The structs of live objects (`umo.generate.lower.live_fields.LiveStruct`), by their numbers in machine_struct."""
    host_calls: list[str] = field(default_factory=list)
    """The requests to the host, by number."""
    text_makers: list[TextMaker] = field(default_factory=list)
    """The texts that Python makes, by number."""
    kinds: Mapping[int, type[BaseException]] = field(default_factory=dict)
    """The class of each fault."""
    hosts: list[tuple[Any, str]] = field(default_factory=list)
    """The object and the name of each request to the host, by number."""
    known: KnownValues = field(default_factory=KnownValues)
    """The values that are taken as known and must not be set afterwards."""
    notes: list[str] = field(default_factory=list)
    """Notes on the C for the user, such as a function whose results differ in the last bit."""
    problems: list[Untranslatable] = field(default_factory=list)
    refused_conditions: bool = False
    """True if the first obstacle is in a condition."""
    on_host: list[Untranslatable] = field(default_factory=list)
    """Code that works in C on this computer only, and not on a controller."""
