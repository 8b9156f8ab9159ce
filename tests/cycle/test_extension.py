"""The extension in C: it is built where it can be, and does what Python does with the same numbers."""

from __future__ import annotations

import ctypes
import gc
import math
import mmap
import struct
import subprocess
import sys
import sysconfig
import tracemalloc
import weakref
from collections.abc import Callable
from enum import Enum
from functools import partial
from pathlib import Path
from shutil import which
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.conversions import BUILT
from umo.cycle import conversion
from umo.cycle.columns import LAST, NOW, TOLD, UNSEEN
from umo.cycle.writes import PlainTurn
from umo.objects.linearization import Linearizations, LookupTable
from umo.objects.scaling import to_raws, to_value
from umo.objects.thermocouple import Thermocouple

TREE = Path(__file__).parents[2]
SOURCES = sorted(file for room in ("cycle", "drivers") for file in (TREE / "src" / "umo" / room).glob("*.c"))
COMPILER = (sysconfig.get_config_var("CC") or "").split()
HEADERS = Path(sysconfig.get_paths()["include"])


@pytest.mark.skipif(
    not COMPILER or which(COMPILER[0]) is None or not (HEADERS / "Python.h").exists(),
    reason="no C compiler, or no headers of Python",
)
def test_where_a_compiler_is_it_is_built_without_a_warning(tmp_path: Path) -> None:
    strict = ["-fPIC", "-isystem", str(HEADERS), "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
    done = subprocess.run([*COMPILER, *strict, "-c", *map(str, SOURCES)], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert conversion.is_built()


def arrays(*lengths: int) -> list[Any]:
    return [np.zeros(length) for length in lengths]


# The image ----------------------------------------------------------------------------------------------

RAW = st.integers(-(2**63), 2**63 - 1) | st.integers(-99, 99) | st.sampled_from([2**53 + 1, -(2**53) - 1])
SCALE = st.tuples(
    st.floats(allow_nan=False) | st.sampled_from([1.0, -1.0, 0.1, -0.3, 1e-18, 5e-324]),
    st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 1.5, -7.3]),
)
BOUND = st.sampled_from([0.0, 10.0, 1e19, math.inf])
LENGTH = {"inputs": 8, "outputs": 12}


def outputs(views: Any, written: Any = None) -> Any:
    """A block of outputs, with bytes that tell what is written."""
    return conversion.extension.Outputs(views, np.zeros(len(views[0]), np.uint8) if written is None else written)


@BUILT
@given(st.lists(st.tuples(RAW, SCALE, BOUND, BOUND), max_size=6))
def test_an_input_block_is_converted_as_each_number_by_itself(objects: list[Any]) -> None:
    count = len(objects)
    moved = np.array([raw for raw, *_ in objects], np.int64)
    scales = np.array([(*scale, -low, high) for _, scale, low, high in objects]).reshape(-1, 4).T.copy()
    raws, values, times = np.zeros(count, np.int64), np.full(count, 3.0), np.full(count, 4.0)
    outside = conversion.extension.Inputs((moved, *scales, raws, values, times), 7, (), ()).convert(5.0)
    expected, refused = [3.0] * count, []
    for place, (raw, scale, low, high) in enumerate(objects):
        value = to_value(raw, *scale)
        if -low <= value <= high:
            expected[place] = value
        else:
            refused.append((7 + place, value))
    assert values.tobytes() == np.array(expected).tobytes()
    assert raws.tolist() == moved.tolist()
    assert [(slot, bits(value)) for slot, value in outside] == [(slot, bits(value)) for slot, value in refused]
    assert times.tolist() == [4.0 if refused else 5.0] * count


CURVES = [None, LookupTable([-5.0, 0.0, 2.0, 9.0], [80.0, 30.0, 1.0, -3.0]), Thermocouple("K").over(-100.0, 1300.0)]


@BUILT
@given(st.lists(st.tuples(st.integers(-200, 200), st.sampled_from(CURVES), st.booleans()), max_size=6))
def test_a_block_with_linearizations_and_invalid_readings_is_converted_as_each_number_by_itself(
    objects: list[Any],
) -> None:
    resolution, low, high = 0.25, -3.0, 1200.0
    columns = [np.full(len(objects), number) for number in (resolution, 0.0, low, high)]
    moved = np.array([raw for raw, *_ in objects], np.int64)
    raws, values, times = np.zeros(len(objects), np.int64), np.full(len(objects), 3.0), np.zeros(len(objects))
    curves = Linearizations([each for _, each, _ in objects]).in_c
    assert curves is not None
    invalid = tuple((place, raw) for place, (raw, _, refused) in enumerate(objects) if refused)
    of_block = (moved, *columns, raws, values, times), 0, tuple((place, *curve) for place, curve in curves), invalid
    outside = conversion.extension.Inputs(*of_block).convert(5.0)
    found = [x if each is None else each.to_value(x) for x, each in ((raw * resolution, f) for raw, f, _ in objects)]
    found = [math.nan if refused else value for value, (*_, refused) in zip(found, objects, strict=True)]
    inside = [low <= value <= high for value in found]
    expected = [value if yes else 3.0 for value, yes in zip(found, inside, strict=True)]
    assert values.tobytes() == np.array(expected).tobytes()
    refused = [(place, value) for place, (value, yes) in enumerate(zip(found, inside, strict=True)) if not yes]
    assert [(slot, bits(value)) for slot, value in outside] == [(slot, bits(value)) for slot, value in refused]


@BUILT
@pytest.mark.parametrize(
    ("curves", "invalid", "text"),
    [
        (((2, True, 1, 0.0, 1.0, bytes(120)),), (), "no such object"),
        (((0, True, 1, 0.0, 1.0, bytes(112)),), (), "another length"),
        (((0, False, 2, 0.0, 0.0, bytes(48)),), (), "another length"),
        (((0, False, 1, 0.0, 0.0, bytes(16)),), (), "another length"),
        ((), ((-1, 7),), "no such object"),
    ],
)
def test_a_curve_that_does_not_fit_the_block_is_refused(curves: Any, invalid: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        conversion.extension.Inputs(tuple(arrays(*[2] * LENGTH["inputs"])), 0, curves, invalid)


def bits(value: float) -> bytes:
    return b"nan" if math.isnan(value) else struct.pack("d", value)


@BUILT
def test_a_product_is_rounded_before_the_sum() -> None:
    """0.1 * 3 - 0.3 is 5.6e-17; in one operation, without rounding in between, 2.8e-17."""
    scales = (np.array([number]) for number in (0.1, -0.3, -1.0, 1.0))
    raws, values, times = arrays(1, 1, 1)
    assert conversion.extension.Inputs((np.array([3]), *scales, raws, values, times), 0, (), ()).convert(0.0) == ()
    assert values[0] == 0.1 * 3 - 0.3


@BUILT
@given(st.lists(st.tuples(st.floats(), SCALE, BOUND, BOUND), max_size=6))
def test_an_output_block_gives_the_nearest_raw_integers_within_their_bounds(objects: list[Any]) -> None:
    """Whatever is pending: NaN and infinities, which the objects refuse, too."""
    count, limit = len(objects), 2.0**63 - 1024.0
    pending = np.array([value for value, *_ in objects], float)
    scales = np.array([(r or 1.0, z, -low, high) for _, (r, z), low, high in objects], float).reshape(-1, 4).T.copy()
    resolution, zero_offset = scales[:2]
    least, greatest = np.maximum(scales[2], -limit), np.minimum(scales[3], limit)
    moved, raws = np.zeros((2, count), np.int64)
    rate, (stepped, values, times) = np.full(count, math.inf), arrays(*[count] * 3)
    sent = (pending.view(np.int64) ^ 1).view(np.float64)  # anything else: what is sent already is not converted again
    views = moved, resolution, zero_offset, least, greatest, raws, values, times, rate, pending, sent, stepped
    block = outputs(views)
    block.give(1.0, 0.001)
    with np.errstate(all="ignore"):
        scaled = (pending - zero_offset) / resolution
        inside = scaled == scaled
        expected = to_raws(pending[inside], *(each[inside] for each in (resolution, zero_offset, least, greatest)))
    assert moved[inside].tolist() == expected.tolist()
    assert moved[~inside].tolist() == least[~inside].astype(np.int64).tolist()
    block.commit(1.5)
    assert (raws.tolist(), values.tobytes(), times.tolist()) == (moved.tolist(), pending.tobytes(), [1.5] * count)


@BUILT
@pytest.mark.parametrize("wrong", [0, 3, 7])
def test_a_block_takes_only_views_that_fit_together(wrong: int) -> None:
    views = arrays(*[2] * LENGTH["inputs"])
    views[wrong] = np.zeros(3)
    with pytest.raises(ValueError, match="differ in length"):
        conversion.extension.Inputs(tuple(views), 0, (), ())
    with pytest.raises(ValueError, match="differ in length"):
        outputs((*views, *arrays(2, 2, 2, 2)))
    with pytest.raises(ValueError, match="differ in length"):
        outputs(tuple(bytearray(7) for _ in range(LENGTH["outputs"])))
    with pytest.raises(ValueError, match="differ in length"):
        outputs(tuple(arrays(*[2] * LENGTH["outputs"])), np.zeros(3, np.uint8))


@BUILT
def test_a_block_takes_a_tuple_of_as_many_views_as_it_has() -> None:
    with pytest.raises(ValueError, match="a tuple of 8"):
        conversion.extension.Inputs(tuple(arrays(2, 2)), 0, (), ())
    with pytest.raises(ValueError, match="a tuple of 12"):
        outputs(arrays(*[2] * LENGTH["outputs"]))


@BUILT
@pytest.mark.parametrize("place", [0, 5, 6, 7, 10, 11])
def test_a_block_is_not_made_of_views_that_cannot_be_written_to(place: int) -> None:
    views = arrays(*[2] * LENGTH["outputs"])
    views[place].flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        outputs(tuple(views))


@BUILT
def test_a_time_that_is_not_a_number_is_refused() -> None:
    for call in (
        conversion.extension.Inputs(tuple(arrays(*[2] * LENGTH["inputs"])), 0, (), ()).convert,
        outputs(tuple(arrays(*[2] * LENGTH["outputs"]))).commit,
        partial(outputs(tuple(arrays(*[2] * LENGTH["outputs"]))).give, 0.0),
    ):
        with pytest.raises(TypeError):
            call("now")


# Frames -------------------------------------------------------------------------------------------------


@BUILT
def test_a_body_is_not_written_to_memory_that_is_read_only() -> None:
    with mmap.mmap(-1, 4096, access=mmap.ACCESS_READ) as file, pytest.raises(BufferError):
        conversion.extension.Body(file, *arrays(1), 100)


# Memory -------------------------------------------------------------------------------------------------


@BUILT
def test_views_are_let_go_of() -> None:
    views = arrays(*[2] * LENGTH["outputs"])
    before = [sys.getrefcount(view) for view in views]
    for _ in range(100):
        outputs(tuple(views)).commit(1.0)
        conversion.extension.Body(*views[:2], 16)
        with pytest.raises(ValueError, match="differ"):
            conversion.extension.Inputs((*views[:7], np.zeros(3)), 0, (), ())
    assert [sys.getrefcount(view) for view in views] == before


@BUILT
def test_values_out_of_bounds_leave_nothing_behind() -> None:
    scales = (np.full(3, number) for number in (1.0, 0.0, 5.0, 6.0))
    views = np.arange(3) + 100, *scales, *arrays(3, 3, 3)
    convert = conversion.extension.Inputs(views, 1000, (), ()).convert
    assert kept(lambda: convert(1.5)) < 2000


def kept(call: Callable[[], object]) -> int:
    """Bytes more after 1,000 calls."""
    call()
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(1000):
            call()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after - before


# Attributes of compiled laws --------------------------------------------------------------------------------


class Light(Enum):
    OFF = "off"
    ON = "on"


class Point(NamedTuple):
    at: float
    count: int


def refuse(owner: Any, value: Any) -> None:
    raise TypeError(f"{value!r} is refused")


class Fields:
    """One field of each kind at the beginning of 64 bytes of memory."""

    def __init__(self, put: Callable[[Any, Any], object] = refuse) -> None:
        self.memory = ctypes.create_string_buffer(64)
        at = ctypes.addressof(self.memory)
        field = conversion.extension.Field
        parts = field("d", at, None, None, put), field("i", at + 8, None, None, put)
        self.names = {
            "real": parts[0],
            "whole": parts[1],
            "flag": field("?", at, None, None, put),
            "light": field("s", at, tuple(Light), None, put),
            "point": field("t", at, Point, parts, put),
            "pair": field("t", at, None, parts, put),
            "perhaps": field("o", at + 16, None, (parts[0],), put),
        }
        self.owner = type("Owner", (), {**self.names, "__slots__": ()})()

    def set(self, *numbers: Any, layout: str = "@di") -> None:
        struct.pack_into(layout, self.memory, 0, *numbers)


@BUILT
def test_a_field_in_memory_has_the_value_and_the_type_of_python() -> None:
    fields = Fields()
    owner: Any = fields.owner
    fields.set(-0.0, -7)
    assert str(owner.real) == "-0.0" and owner.whole == -7
    assert owner.pair == (0.0, -7) and type(owner.pair) is tuple
    assert owner.point == Point(0.0, -7) and type(owner.point) is Point and owner.point.count == -7
    fields.set(True, layout="@?")
    assert owner.flag is True and owner.light is Light.ON
    assert owner.perhaps is None
    fields.memory[16] = 1
    assert owner.perhaps == owner.real
    assert type(owner).real is fields.names["real"]


@BUILT
def test_what_is_set_is_in_the_memory_and_what_is_not_plain_goes_to_python() -> None:
    found: list[Any] = []
    fields = Fields(lambda owner, value: found.append((owner, value)))
    owner: Any = fields.owner
    owner.real = 2.5
    assert struct.unpack_from("@d", fields.memory) == (2.5,)
    owner.real = -1.5
    assert owner.real == -1.5 and type(owner.real) is float
    owner.flag = False
    assert fields.memory[0] == b"\0"
    owner.light = Light.ON
    assert fields.memory[0] == b"\1" and not found
    owner.real = number = np.float64(2.0)  # what is computed with it would be another class of number
    owner.real = 3
    owner.whole = 4
    owner.light = "on"
    owner.flag = 1
    owner.perhaps = 2.0
    assert found.pop(0)[1] is number
    assert found == [(owner, 3), (owner, 4), (owner, "on"), (owner, 1), (owner, 2.0)]


@BUILT
def test_what_a_field_cannot_do_is_an_error_of_python() -> None:
    fields = Fields()
    owner: Any = fields.owner
    with pytest.raises(TypeError, match="'x' is refused"):
        owner.real = "x"
    with pytest.raises(AttributeError, match="cannot be deleted"):
        del owner.real
    fields.memory[0] = 2
    with pytest.raises(IndexError):
        _ = owner.light


@BUILT
@pytest.mark.parametrize(
    "given", [("x", 0, None, None), ("s", 0, None, None), ("t", 0, None, (1,)), ("t", 0, int, ()), ("o", 0, None, ())]
)
def test_what_is_no_field_is_refused(given: tuple[Any, ...]) -> None:
    with pytest.raises(TypeError):
        conversion.extension.Field(*given, refuse)


@BUILT
def test_a_field_that_refers_to_its_own_class_is_collected() -> None:
    def kept() -> weakref.ref[Any]:
        holder: Any = type("Holder", (), {})
        fields = Fields(lambda owner, value: holder)
        holder.fields = fields
        return weakref.ref(holder)

    found = kept()
    gc.collect()
    assert found() is None


# What control code writes -----------------------------------------------------------------------------------


class PlainWrites:
    """What `Writes` of the extension does, in Python."""

    def __init__(
        self,
        restrictions: Any,
        pending: Any,
        written: Any,
        owners: Any,
        turn: Any,
        command: Callable[[int, float], bool],
        changed: Any,
    ) -> None:
        self._restrictions, self._pending, self._written = restrictions, pending, written
        self._owners: list[Any] = [self] * len(owners)
        """Who has written each last; here: nobody has."""
        self._turn, self._command, self._changed = turn, command, changed

    def write(self, slot: int, value: float) -> bool:
        before = self._pending[slot]
        if self._restrictions[slot]:
            taken = self._command(slot, value)
            if taken:
                self.note(slot, before, value)
            return taken
        self.note(slot, before, value)
        self._pending[slot] = value
        return True

    def write_many(self, slots: Any, values: Any) -> bool:
        each = range(len(self._owners))[slots] if isinstance(slots, slice) else slots.tolist()
        if any(self._restrictions[slot] for slot in each):
            return False
        owner, owners, written, pending = self._owner, self._owners, self._written, self._pending
        numbers = values.tolist()
        other = [pair for pair in zip(each, numbers, strict=True) if owners[pair[0]] is not owner]
        new = [(slot, value) for slot, value in other if written[slot] < TOLD and pending[slot] != value]
        if new:
            self._changed([slot for slot, _ in new], [pending[slot] for slot, _ in new], [value for _, value in new])
        for slot, value in other:
            if pending[slot] == value:
                written[slot] |= UNSEEN
        for slot, value in zip(each, numbers, strict=True):
            owners[slot], pending[slot] = owner, value
            written[slot] |= NOW
        return True

    def note(self, slot: int, before: float, value: float) -> None:
        owner = self._owner
        if self._owners[slot] is not owner:
            if before == value:
                self._written[slot] |= UNSEEN
            elif self._written[slot] < TOLD:
                self._changed([slot], [before], [value])
            self._owners[slot] = owner
        self._written[slot] |= NOW

    @property
    def _owner(self) -> Any:
        turn = self._turn
        return turn.law if turn.task is None else turn.task


class Written:
    """The columns of five actuators, with what is called when they are written; those at odd slots are restricted."""

    def __init__(self, way: Any) -> None:
        self.restrictions = np.array([0, 1, 0, 1, 0], np.uint8)
        self.pending, self.written, self.owners = np.zeros(5), np.zeros(5, np.uint8), np.zeros(5, np.uint64)
        self.calls: list[Any] = []
        self.turn = PlainTurn() if way is PlainWrites else way.Turn()
        make = way if way is PlainWrites else way.Writes
        columns = (each.data for each in (self.restrictions, self.pending, self.written, self.owners))
        self.writes = make(*columns, self.turn, self.command, self.changed)

    def command(self, slot: int, value: float) -> bool:
        self.calls.append(("command", slot, value))
        if value > 0.0:
            self.pending[slot] = value
        return value > 0.0

    def changed(self, *what: Any) -> None:
        self.calls.append(("changed", *what))


SLOT, VALUE = st.integers(0, 4), st.sampled_from([-1.0, -0.0, 0.0, 2.5])
OPERATION = st.one_of(
    st.tuples(st.just("write"), SLOT, VALUE),
    st.tuples(st.just("note"), SLOT, VALUE, VALUE),
    st.tuples(st.just("write_many"), st.sampled_from([slice(0, 5), slice(0, 5, 2), slice(4, 5)]), VALUE),
    st.tuples(st.just("write_many"), st.lists(SLOT, unique=True), VALUE),
    st.tuples(st.just("law"), st.sampled_from([None, "heating", "cooling"])),
    st.tuples(st.just("task"), st.sampled_from([None, "filling", "draining"])),
    st.tuples(st.just("send")),
    st.tuples(st.just("told"), SLOT),
)


def carry_out(on: Written, what: str, *given: Any) -> Any:
    if what in ("law", "task"):
        setattr(on.turn, what, given[0])
    elif what == "send":
        if isinstance(on.writes, PlainWrites):
            on.written[:] = (on.written & (TOLD | UNSEEN)) | (on.written & NOW) // NOW * LAST
        else:
            conversion.extension.end_period(on.written)
    elif what == "told":
        on.written[given[0]] |= TOLD
    elif what == "write_many":
        slots, value = given
        places = slots if isinstance(slots, slice) else np.array(slots, np.int64)
        values = np.full(2 * len(range(5)[slots] if isinstance(slots, slice) else slots), value)
        values[::2] += np.arange(len(values) // 2)
        return on.writes.write_many(places, values[::2])
    else:
        return getattr(on.writes, what)(*given)
    return None


@BUILT
@given(st.lists(OPERATION, max_size=20))
def test_what_is_written_and_who_has_written_it_is_the_same_in_c_and_in_python(operations: list[Any]) -> None:
    native, plain = Written(conversion.extension), Written(PlainWrites)
    for operation in operations:
        assert carry_out(native, *operation) == carry_out(plain, *operation)
        assert native.calls == plain.calls
        assert native.pending.tobytes() == plain.pending.tobytes()
        assert native.written.tobytes() == plain.written.tobytes()


@BUILT
def test_what_does_not_fit_is_not_written() -> None:
    on = Written(conversion.extension)
    for wrong, error in (((5, 1.0), IndexError), ((-1, 1.0), IndexError), ((0, "1"), TypeError), ((0,), TypeError)):
        with pytest.raises(error):
            on.writes.write(*wrong)
    for slots, values in ((slice(0, 3), np.zeros(2)), (slice(0, 1), np.zeros(1, np.float32)), (slice(0, 1), 1.0)):
        with pytest.raises((ValueError, TypeError)):
            on.writes.write_many(slots, values)
    with pytest.raises(IndexError):
        on.writes.write_many(np.array([0, 5]), np.zeros(2))
    assert (on.pending.tolist(), on.written.tolist()) == ([0.0] * 5, [0] * 5)


@BUILT
def test_writes_take_only_columns_of_one_length_and_a_turn() -> None:
    columns = [np.zeros(2, np.uint8), np.zeros(2), np.zeros(2, np.uint8), np.zeros(2, np.uint64)]
    turn = conversion.extension.Turn()
    with pytest.raises(TypeError, match="Turn"):
        conversion.extension.Writes(*columns, PlainTurn(), bool, bool)
    with pytest.raises(ValueError, match="differ in length"):
        conversion.extension.Writes(columns[0], np.zeros(3), *columns[2:], turn, bool, bool)


@BUILT
def test_an_error_of_what_is_called_keeps_the_value_from_being_written() -> None:
    on = Written(conversion.extension)
    on.changed = lambda *what: 1 / 0  # type: ignore[method-assign]
    columns = (each.data for each in (on.restrictions, on.pending, on.written, on.owners))
    writes = conversion.extension.Writes(*columns, on.turn, on.command, on.changed)
    with pytest.raises(ZeroDivisionError):
        writes.write(0, 1.0)
    with pytest.raises(ZeroDivisionError):
        writes.write_many(slice(0, 1), np.ones(1))
    assert on.pending[0] == 0.0


@BUILT
def test_writing_leaves_nothing_behind() -> None:
    writes, values = Written(conversion.extension).writes, np.ones(3)
    assert kept(lambda: writes.write(0, 1.0)) < 2000
    assert kept(lambda: writes.write_many(slice(0, 5, 2), values)) < 2000
    assert kept(lambda: writes.write_many(np.array([2]), values[:1])) < 2000


@BUILT
def test_writes_that_refer_to_whom_they_call_are_collected() -> None:
    here = weakref.ref(Written(conversion.extension))
    gc.collect()
    assert here() is None
