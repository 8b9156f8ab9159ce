"""The numbers of the objects as tables in C: their properties and the curves of their linearizations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf
from typing import Any, NamedTuple

import numpy as np

from umo.generate.controller_model import ControllerModel, ControllerObject, NotGenerated, curves_of
from umo.generate.emit.c_text import array, comment, real, real_or, time_of, truth
from umo.generate.translation import ControllerTarget
from umo.objects.interpolation import Cubics, Segments


def tables_of(model: ControllerModel, target: ControllerTarget) -> str:
    """Return the numbers of the objects as tables in C."""
    return "".join(_tables(model, target))


class _Curve(NamedTuple):
    """A curve of a linearization and the numbers of its table."""

    way: str
    slot: int
    """The slot of the first object with this curve."""
    curve: Cubics | Segments
    numbers: tuple[float, ...]

    @property
    def name(self) -> str:
        return f"{self.way}_{self.slot}"


def _curves(objects: Iterable[ControllerObject]) -> dict[int, _Curve]:
    """Return the curve of each object, by slot. Objects with equal curves share one."""
    found: dict[tuple[Any, ...], _Curve] = {}
    of_slot = {}
    for one in objects:
        if one.linearization is not None:
            curve, way = curves_of(one.linearization)[one.output], "to_input" if one.output else "to_value"
            numbers = tuple(np.frombuffer(curve.in_c.numbers).tolist())
            of_slot[one.slot] = found.setdefault((way, *curve.in_c), _Curve(way, one.slot, curve, numbers))
    return of_slot


def large_tables(model: ControllerModel, target: ControllerTarget) -> Iterator[NotGenerated]:
    """Return the linearizations whose table is too large for the target. Of equal linearizations only the first is
    returned."""
    if target.table_bytes is None or model.problems:
        return
    for slot, curve in _curves(model.objects).items():
        size = len(curve.numbers) * (4 if target.real == "float" else 8)
        if slot == curve.slot and size > target.table_bytes:
            one = next(each for each in model.objects if each.slot == slot)
            reason = (
                f"the table of {one.linearization} has {size} bytes; {target.name} allows at most {target.table_bytes}"
            )
            yield NotGenerated(one.path, reason, "a LookupTable of fewer points, or --target cortex-m")


def _tables(model: ControllerModel, target: ControllerTarget) -> Iterator[str]:
    """Yield the tables in C with the numbers of the objects."""
    for one in model.objects:
        if one.invalid_raws:
            yield array("int32_t", f"invalid_raws_{one.slot}", [_whole(raw) for raw in one.invalid_raws])
    curves = _curves(model.objects)
    for curve in {each.name: each for each in curves.values()}.values():
        yield from _curve_table(curve, target)
    yield "static const UMO_FLASH umo_traits traits[] = {\n"
    for one in model.objects:
        yield _traits(model, one, curves.get(one.slot), target)
    yield "};\n\n"


def _whole(raw: int) -> str:
    return "INT32_MIN" if raw == -(2**31) else str(raw)


def _curve_table(curve: _Curve, target: ControllerTarget) -> Iterator[str]:
    yield array("umo_real", f"{curve.name}_table", [real(number, target) for number in curve.numbers])
    cubic, count, first, per_x, _ = curve.curve.in_c
    yield f"static const UMO_FLASH umo_curve {curve.name} = {{\n"
    yield f"    .cubic = {truth(cubic)}, .count = {count}, "
    yield f".first = {real(first, target)}, .per_x = {real(per_x, target)},\n"
    yield f"    .table = {curve.name}_table,\n}};\n"


def _traits(model: ControllerModel, one: ControllerObject, curve: _Curve | None, target: ControllerTarget) -> str:
    flags = {
        "UMO_OUTPUT": one.output,
        "UMO_BINARY": one.binary,
        "UMO_ASYNCHRONOUS": not one.synchronous,
        "UMO_CLAMPS": one.clamps,
        "UMO_MARKS": one.marks,
        "UMO_INCREMENTAL": one.incremental,
    }
    fields = {
        "flags": " | ".join(name for name, yes in flags.items() if yes) or "0",
        "one": str(one.one),
        "equipment": str(one.equipment),
        **({"group": str(one.group)} if model.groups else {}),
        "resolution": real(one.scale[0], target),
        "zero_offset": real(one.scale[1], target),
        "minimum": real(one.bounds[0], target),
        "maximum": real(one.bounds[1], target),
        "max_age": time_of(one.max_age, target),
        **(_of_output if one.output else _of_input)(one, target),
    }
    if curve is not None:
        fields[curve.way] = f"&{curve.name}"
    lines = "".join(f"        .{name} = {value},\n" for name, value in fields.items())
    return f"    {{ /* {one.slot}: {comment(one.path)}, {one.kind} ({comment(one.units)}) */\n{lines}    }},\n"


def _of_output(one: ControllerObject, target: ControllerTarget) -> dict[str, str]:
    return {
        "least": real(one.raws[0], target),
        "greatest": real(one.raws[1], target),
        "rest": real(one.default, target),
        "rest_raw": _whole(one.default_raw),
        "slew_rate": real_or(one.slew_rate, inf, target),
        "expires": time_of(one.expires, target),
    }


def _of_input(one: ControllerObject, target: ControllerTarget) -> dict[str, str]:
    fields = {"low": real(one.good[0], target), "high": real(one.good[1], target)}
    if one.raws != (0.0, 0.0):
        fields["greatest"] = real(one.raws[1], target)
    if one.conditioned:
        times = {"filter": one.filter, "velocity": one.velocity, "debounce": one.debounce}
        fields |= {name: time_of(seconds, target) for name, seconds in times.items()}
        fields["rollover_bits"] = str(one.rollover_bits)
    if one.invalid_raws:
        fields |= {"invalid_count": str(len(one.invalid_raws)), "invalid_raws": f"invalid_raws_{one.slot}"}
    return fields
