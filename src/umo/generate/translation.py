"""What the translation of control code to C gives: the data that the generator puts around it.

A target has numbers of its own; each object of translated code has its fields, each fault its number and text. What
does not translate is a `Untranslatable`, with its place and the nearest thing that does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from umo.generate.c_types import CType
from umo.generate.known_values import KnownValues

FIRST_FAULT = 32
"""The first number of a fault of translated code; those below are the runtime's (umo.h)."""
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
    ("UMO_NO_HOST", "TaskFailed", "only the host can do it, and there is none"),
)
"""The faults of the runtime from 1 on, as in umo.h: their names, classes and texts."""
NO_HOST = 1 + [name for name, _, _ in RUNTIME_FAULTS].index("UMO_NO_HOST")
"""The fault that Python does not have."""


class ControllerLimit(OverflowError):
    """Python goes on, and a controller cannot: a whole number leaves 32 bits, a power is a complex number, or
    the sign of a NaN is asked for. No `except` catches it, as there would be none to catch in Python."""


@dataclass(frozen=True)
class ControllerTarget:
    """What C is made for."""

    name: str
    real: Literal["double", "float"] = "double"
    exact_libm: bool = False
    """Whether its functions of <math.h> are those of this Python, to the bit."""
    int_bits: int = 32
    """The width of whole numbers."""
    table_bytes: int | None = None
    """The size of the table of a linearization at most."""
    tells: bool = False
    """Whether Python is there, and makes the texts that code tells."""


class CodeFault(NamedTuple):
    """A fault of translated code: what Python raises there."""

    number: int
    kind: str
    """The class, such as RangeError."""
    text: str
    """The message as it is written."""
    file: str
    line: int
    name: str = ""
    """In C."""


class Teller(NamedTuple):
    """A text that Python makes while compiled laws drive."""

    make: Callable[..., Any]
    """The error, or the text, of these variables."""
    given: Sequence[CType]
    """The types of these."""
    fault: int = 0
    """The fault whose error it is; 0: of none."""
    field: tuple[Any, str] | None = None
    """The object and its attribute that the text is assigned to."""


class StructField(NamedTuple):
    """A field of a struct that stands for an attribute of a live object."""

    path: str
    """Path of the object or law, such as `z.servo`."""
    struct: str
    name: str
    kind: str
    """The type in C."""
    owner: Literal["INPUT", "STATE"]
    """INPUT: translated code never assigns it, the host may; STATE: translated code assigns it."""


class Untranslatable(NamedTuple):
    """A piece of Python that has no C."""

    file: str
    line: int
    source: str
    reason: str
    nearest: str

    def __str__(self) -> str:
        near = f"; {self.nearest}" if self.nearest else ""
        place = f"{self.file}:{self.line}: " if self.file else ""
        return f"{place}{self.source}: {self.reason}{near}"


class CFunction(NamedTuple):
    """How a translated function is called: it returns its fault; its result goes where the last argument points."""

    name: str
    arguments: tuple[str, ...] = ("m",)

    def call(self, *more: str) -> str:
        return f"{self.name}({', '.join((*self.arguments, *more))})"


@dataclass
class Translation:
    """The translated functions of one machine."""

    header: str = ""
    """Structs and prototypes."""
    members: str = ""
    """The members of `struct umo_machine` for these structs, a line each."""
    source: str = ""
    """The functions."""
    fault_names: str = ""
    """The names of the faults, an enum."""
    effects: Mapping[str, Set[str | int]] = field(default_factory=dict)
    """What each function and those that it calls do: functions that are called, members of objects that are read
    (`zero_offset`), ASSIGNS, the numbers of `tellers`."""
    init: str = "static void init_objects(umo_machine *m)\n{\n    (void)m;\n}\n"
    """The function that fills the structs with the live values."""
    access: str = ""
    """The function that gives the structs by their numbers."""
    entry: Mapping[Any, CFunction] = field(default_factory=dict)
    """How each function is called."""
    faults: list[CodeFault] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    """Of the functions; where the runtime has a fault, it is told with one of them (`umo_at`)."""
    layout: list[StructField] = field(default_factory=list)
    structs: list[Any] = field(default_factory=list)
    """The structs of live objects (`umo.generate.lower.live_fields.LiveStruct`), by the numbers of machine_struct."""
    host_calls: list[str] = field(default_factory=list)
    """What the host is asked for, by number."""
    tellers: list[Teller] = field(default_factory=list)
    """The texts that Python makes, by number."""
    kinds: Mapping[int, type[BaseException]] = field(default_factory=dict)
    """The class of each fault."""
    hosts: list[tuple[Any, str]] = field(default_factory=list)
    """Object and name of what the host is asked for, by number."""
    known: KnownValues = field(default_factory=KnownValues)
    """What is taken as known: nobody may set it afterwards."""
    notes: list[str] = field(default_factory=list)
    """What is to be said of the C, such as a function that differs in its last bit."""
    problems: list[Untranslatable] = field(default_factory=list)
    refused_conditions: bool = False
    """Whether the first of them is one of the conditions."""
    on_host: list[Untranslatable] = field(default_factory=list)
    """What works in C on this computer only, and not on a controller."""
