"""The declarations of an FMU: the variables of its model description as channels. No code of the FMU is run."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from math import isfinite, prod
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any
from zipfile import BadZipFile, ZipFile

from umo.drivers.contract import Channel, Direction
from umo.errors import ChannelError, DriverError, WiringError
from umo.system.packages import how_to_install
from umo.text import COMPARED_NAMES, others

TICK = "tick"
FLOAT_BITS = 48
"""Bits of a float's raw integer, with its sign. Such an integer is unchanged after multiplication by a scale and
division by it in double precision."""
FLOATS = ("Real", "Float64", "Float32")
INTEGERS: Mapping[str, tuple[int, bool]] = {
    "Boolean": (1, False),
    "Integer": (32, True),
    **{f"Int{bits}": (bits, True) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (min(bits, 63), False) for bits in (8, 16, 32, 64)},
}
"""Bits and sign of the integer types."""
SETTABLE = ("input", "parameter")
LISTED_NAMES = 6
ANY_CHANNEL = "?"
"""A text that names no channel. With it `umo device drivers` requests the forms; the answer has all variables."""
MAX_UNIT_LENGTH = 40
"""The largest number of characters of a unit. A longer unit is ignored."""
_FACTOR = r"(?:1|[^\W\d_]+(?:\^?-?\d)?)"
_PRODUCT = rf"{_FACTOR}(?:[.*/]{_FACTOR})*"
_UNIT = re.compile(rf"{_PRODUCT}(?:/\({_PRODUCT}\))?")
"""Units as models write them: "degC", "m3/s", "kg/(m.s2)"."""
_INDEXED = re.compile(r"(.+)\[([1-9][0-9]{0,8}(?:,[1-9][0-9]{0,8})*)\]")
_DIGIT = re.compile(r"(?<=[^\W\d])(-?\d)")


@dataclass(frozen=True)
class FmuChannel(Channel):
    """A variable of the model, or the tick."""

    reference: int = 0
    kind: str = TICK
    """The type of the variable, as `kind_of` returns it: Real for fmi2GetReal."""
    scale: float | None = None
    """The change of a float for one raw step."""
    units: str | None = None
    """The unit of a float in the model description, if pint knows it."""
    element: int = 0
    """The index of the value in an array, in the order of FMI, from 0."""
    size: int = 1
    """Number of the variable's values."""

    @property
    def places(self) -> tuple[tuple[str, int, int], ...]:
        """The variable, or its element, regardless of the scale."""
        return ((self.kind, self.reference, self.element),)


def described(file: Path) -> Any:
    """Return FMPy's description of the model. Raises WiringError if the file is not a co-simulation unit of FMI 2.0 or
    3.0."""
    try:
        changed = os.stat(file).st_mtime_ns
    except OSError as error:
        raise WiringError(f"model: {file}: {error.strerror}") from error
    if not file.is_file():
        raise WiringError(f"model: {file} is a folder, not an .fmu file")
    return _described(file, changed)


@lru_cache(maxsize=16)
def _described(file: Path, changed: int) -> Any:
    try:
        from fmpy.model_description import read_model_description
    except ModuleNotFoundError as error:
        raise DriverError(f"the fmu driver needs FMPy: {how_to_install('fmu')}") from error
    try:  # what is wrong in form only (`fmpy validate` lists it) does not keep a model from running
        with TemporaryDirectory() as folder, ZipFile(file) as archive:  # FMPy would leave the file open
            archive.extract("modelDescription.xml", folder)
            description: Any = read_model_description(folder, validate=False)
    except Exception as error:
        raise WiringError(f"model: {file} cannot be read as an FMU: {_reason(error)}") from error
    if not description.fmiVersion.startswith(("2.", "3.")):
        raise WiringError(f"model: {file} is of FMI {description.fmiVersion}; umo runs FMI 2.0 and 3.0")
    if description.coSimulation is None:
        raise WiringError(
            f"model: {file} is not for co-simulation; umo runs only co-simulation units: export the model again as one"
        )
    return description


def _reason(error: Exception) -> str:
    if isinstance(error, BadZipFile):
        return "it is not a zip archive"
    text = str(error).partition("\n")[0]
    return text if type(error) is Exception or isinstance(error, KeyError) else f"{text}; try fmpy validate"


@lru_cache(maxsize=16)
def variables_of(description: Any) -> Mapping[str, Any]:
    """Return FMPy's variables by name, including aliases."""
    return MappingProxyType({variable.name: variable for variable in description.modelVariables})


def channel_of(description: Any, text: str) -> FmuChannel:
    """Return the channel of this text: `NAME`, `NAME:SCALE` or `tick`. Raises ChannelError, which names the nearest
    variables."""
    variables = variables_of(description)
    if text == TICK:
        return FmuChannel(text, Direction.INPUT, 31)
    name, scale = (text, None) if text in variables else _parted(text)
    variable, indices = (variables[name], ()) if name in variables else _element(variables, name)
    if variable is None:
        wireable = {
            _first_of(description, known): known for known in variables.values() if _is_channel(description, known)
        }
        near, more = (list(wireable), []) if text == ANY_CHANNEL else (_nearest(name, wireable), _others(wireable))
        forms = [f"{each}:SCALE" if wireable[each].type in FLOATS else each for each in near]
        raise ChannelError(text, [*forms, *more, TICK])
    kind, bits, signed = _raw(description, variable, text)
    shape = shape_of(description, variable)
    element = _place_of(variable.name, indices, shape)
    if kind in FLOATS and scale is None:
        raise ChannelError(text, [f"{name}:SCALE"])
    if kind not in FLOATS and scale is not None:
        raise ChannelError(text, [name])
    direction, units = _direction(variable, text), _units(variable) if kind in FLOATS else None
    return FmuChannel(text, direction, bits, signed, variable.valueReference, kind, scale, units, element, prod(shape))


def _element(variables: Mapping[str, Any], name: str) -> tuple[Any, tuple[int, ...]]:
    """Return the array and the indices of `NAME[2,3]`; None for any other name."""
    if (found := _INDEXED.fullmatch(name)) is None or (variable := variables.get(found[1])) is None:
        return None, ()
    return (variable, tuple(map(int, found[2].split(",")))) if variable.dimensions else (None, ())


def _first_of(description: Any, variable: Any) -> str:
    """Return the name of a variable; for an array, the name of its first element."""
    shape = shape_of(description, variable)
    return f"{variable.name}[{','.join('1' * len(shape))}]" if shape else variable.name


def _place_of(name: str, indices: tuple[int, ...], shape: tuple[int, ...]) -> int:
    """Return the place of an element among the values of an array, counted row by row. Indices start at 1."""
    if len(indices) != len(shape) or not all(1 <= i <= size for i, size in zip(indices, shape, strict=True)):
        first, last = ",".join("1" * len(shape)), ",".join(map(str, shape))
        raise WiringError(f"{name} is an array: its elements are {name}[{first}] to {name}[{last}]")
    place = 0
    for i, size in zip(indices, shape, strict=True):
        place = place * size + i - 1
    return place


def _units(variable: Any) -> str | None:
    """Return the variable's unit as pint writes it; None for a difference of absolute values, such as a temperature
    difference."""
    declared = variable.declaredType
    if variable.relativeQuantity or (variable.relativeQuantity is None and declared and declared.relativeQuantity):
        return None
    text = variable.unit or (declared.unit if declared else None)
    return _known_to_pint(text) if text else None


@lru_cache(maxsize=256)
def _known_to_pint(text: str) -> str | None:
    """Return the unit in pint's spelling: `m3/s` of FMI is `m**3/s`, `N.m` is `N*m`. None if pint does not know it."""
    if len(text) > MAX_UNIT_LENGTH or not _UNIT.fullmatch(text):
        return None
    units = _DIGIT.sub(r"**\1", text.replace("^", "").replace(".", "*"))
    try:
        _pint().parse_units(units)
    except Exception:  # pint raises a dozen types
        return None
    return units


@cache
def _pint() -> Any:
    from pint import UnitRegistry

    return UnitRegistry()


def check_start(description: Any, name: str, value: float | str) -> None:
    """Check a start value. Raises WiringError if the variable cannot start at this value."""
    variable = variables_of(description).get(name)
    if variable is None:
        variables = variables_of(description)
        listed = ", ".join([*_nearest(name, variables), *_others(variables)])
        raise WiringError(f"start_values: the model has no variable {name!r}; it has: {listed}")
    settable = variable.causality in SETTABLE or variable.initial in ("exact", "approx")
    if not settable or variable.causality == "structuralParameter":
        raise WiringError(f"start_values: {name} cannot be set, its causality is {variable.causality}")
    if variable.dimensions:
        raise WiringError(f"start_values: {name} is an array; umo sets single variables")
    needed = _unfit(description, variable, value)
    if needed:
        raise WiringError(f"start_values: {name} takes {needed}, not {value!r}")


def _unfit(description: Any, variable: Any, value: float | str) -> str:
    """Return what the variable accepts, as text, if it does not accept this value; otherwise ""."""
    if variable.type == "String":
        return "" if isinstance(value, str) else "a text"
    kind, bits, signed = _raw(description, variable, variable.name)
    if kind == "Boolean":
        return "" if isinstance(value, bool) else "true or false"
    number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    if kind in FLOATS:
        return "" if number else "a finite number"
    least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    return "" if type(value) is int and least <= value <= most else f"a whole number from {least} to {most}"


def _parted(text: str) -> tuple[str, float | None]:
    """Return name and scale. The name of a variable can contain a colon."""
    name, colon, number = text.rpartition(":")
    try:
        scale = float(number)
    except ValueError:
        return text, None
    if not colon or not isfinite(scale) or not scale:
        return text, None
    return name, scale


def kind_of(description: Any, variable: Any) -> str:
    """Return the type as in the names of FMI's functions, which transfer an enumeration as an integer."""
    kind: str = variable.type
    return kind if kind != "Enumeration" else "Int64" if description.fmiVersion.startswith("3.") else "Integer"


def shape_of(description: Any, variable: Any) -> tuple[int, ...]:
    """Return the sizes of an array, () for a single value. If a size is a structural parameter, its start value is
    used."""
    if not variable.dimensions:
        return ()
    starts = {each.valueReference: each.start for each in description.modelVariables}
    sizes = (starts.get(each.valueReference) if each.start is None else each.start for each in variable.dimensions)
    return tuple(int(size or 0) for size in sizes)


def arranged(values: list[Any], shape: tuple[int, ...]) -> Any:
    """Return the values, given row by row in the order of FMI, as nested lists of this shape."""
    for size in reversed(shape[1:]):
        values = [values[i : i + size] for i in range(0, len(values), size or 1)]
    return values if shape else values[0]


def _raw(description: Any, variable: Any, text: str) -> tuple[str, int, bool]:
    """Return type, width and sign of the variable's raw integer."""
    kind = kind_of(description, variable)
    if kind in FLOATS:
        return kind, FLOAT_BITS, True
    if kind not in INTEGERS:
        raise WiringError(f"{text} is a {kind}; umo takes floats, integers, booleans and enumerations")
    return kind, *INTEGERS[kind]


def _is_channel(description: Any, variable: Any) -> bool:
    """Return True if a channel can name the variable."""
    try:
        _raw(description, variable, variable.name)
        _direction(variable, variable.name)
    except WiringError:
        return False
    return True


def _direction(variable: Any, text: str) -> Direction:
    if variable.causality not in SETTABLE:
        return Direction.INPUT
    if variable.variability in ("fixed", "constant"):
        raise WiringError(f"{text} is a {variable.variability} {variable.causality}: give it in start_values")
    return Direction.OUTPUT


def _nearest(name: str, variables: Mapping[str, Any]) -> list[str]:
    """Return the names of some variables: first the most similar names, then names that contain the given name, then
    the model's first variables."""
    known = list(variables)[:COMPARED_NAMES]
    near = difflib.get_close_matches(name[:200], known, n=LISTED_NAMES, cutoff=0.5)
    within = [each for each in known if name.lower() in each.lower()]
    return list(dict.fromkeys([*near, *within, *known]))[:LISTED_NAMES]


def _others(variables: Mapping[str, Any]) -> list[str]:
    more = len(variables) - LISTED_NAMES
    return [others(more)] if more > 0 else []
