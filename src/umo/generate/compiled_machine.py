"""A generated controller as a shared library of this computer: compiled, and driven through ctypes."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from ctypes import CDLL, c_bool, c_double, c_int, c_int16, c_int32, c_size_t, c_uint8, c_void_p, create_string_buffer
from pathlib import Path
from typing import Any

from umo.errors import DeclarationError, RangeError
from umo.generate.compiler_errors import told
from umo.generate.lower.live_fields import LiveStruct
from umo.generate.struct_memory import StructMemory

ROUNDING = "-ffp-contract=off", "-frounding-math"
"""Each operation is rounded by itself. Without the second one GCC 12 takes 0.0 - (double)0 for -0.0."""
FLAGS = ("-std=c99", "-O2", *ROUNDING, "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
"""Flags of a compiler: nothing is converted in silence."""
LIBRARY = "machine.so"
COMPILE_TIMEOUT = 120.0
"""Timeout in s for the compiler."""


def compiler() -> str | None:
    """The C compiler of this computer; None: there is none."""
    return next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)


def compiled(folder: Path, *flags: str) -> Path:
    """The shared library of a generated folder. DeclarationError with the Python that the compiler refuses, or if there
    is none."""
    cc = compiler()
    if cc is None:
        raise DeclarationError("there is no C compiler: none of cc, gcc, clang was found")
    sources = [str(file) for file in sorted(folder.glob("*.c")) if file.stem in ("machine", "host_access")]
    sources += [str(file) for file in sorted(folder.glob("umo_*.c"))]
    library = folder / LIBRARY
    command = [cc, *FLAGS, *flags, "-fPIC", "-shared", "-o", str(library), *sources, "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=COMPILE_TIMEOUT)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeclarationError(f"the compiler {cc} failed: {error}") from None
    if done.returncode:
        raise DeclarationError(told(done.stderr, lambda name: (folder / name).read_text("utf-8")))
    return library


class CompiledMachine:
    """One machine in a shared library. A fault is a number, 0 for none. Raw integers are lists of ints, by place."""

    def __init__(self, library: Path, inputs: int, outputs: int) -> None:
        self._library = lib = CDLL(str(library))
        lib.host_size.restype = c_size_t
        lib.machine_struct.restype = c_void_p
        for name in ("host_value", "host_pending", "host_velocity"):
            getattr(lib, name).restype = c_double
        for name in ("machine_begin", "machine_step", "machine_sent", "host_set_reading"):
            getattr(lib, name).restype = c_int16
        lib.machine_clear.restype = lib.machine_moves.restype = c_bool
        lib.host_raw.restype = c_int32
        lib.host_set_reading.argtypes = [c_void_p, c_int16, c_double]
        self._machine = create_string_buffer(lib.host_size())
        self._in, self._out = (c_int32 * max(1, inputs))(), (c_int32 * max(1, outputs))()
        self._failed_in, self._failed_out = (c_uint8 * max(1, inputs))(), (c_uint8 * max(1, outputs))()
        self._inputs, self._outputs = inputs, outputs
        lib.machine_init(self._machine)

    def struct(self, number: int, struct: LiveStruct) -> StructMemory:
        """The memory of a struct of translated code, by its number."""
        return StructMemory(struct, int(self._library.machine_struct(self._machine, c_int16(number))))

    @property
    def raws_out(self) -> list[int]:
        return list(self._out[: self._outputs])

    def begin(self, raws: Sequence[int], failed: Sequence[bool] = ()) -> int:
        """The first reading of the sensors."""
        self._give(raws, failed)
        return int(self._library.machine_begin(self._machine, self._in, self._failed_in, self._out))

    def step(self, ticks: int, raws: Sequence[int], failed: Sequence[bool] = ()) -> int:
        """One period."""
        self._give(raws, failed)
        return int(self._library.machine_step(self._machine, c_int32(ticks), self._in, self._failed_in, self._out))

    def sent(self, failed: Sequence[bool] = ()) -> int:
        """What is in `raws_out` was sent; `failed`: what was not accepted."""
        self._failed_out[: self._outputs] = [int(each) for each in failed] or [0] * self._outputs
        return int(self._library.machine_sent(self._machine, self._failed_out))

    def stop(self) -> list[int]:
        """Every actuator goes to its default; the raw integers."""
        self._library.machine_stop(self._machine, self._out)
        return self.raws_out

    def acknowledge(self) -> None:
        self._library.machine_acknowledge(self._machine)

    def clear(self, equipment: int = -1) -> bool:
        """As `Containment.clear`, of the equipment of this number and what is around it and in it; -1: of all."""
        return bool(self._library.machine_clear(self._machine, c_int16(equipment)))

    def equipment_fault(self, number: int) -> int:
        return int(self._library.host_equipment_fault(self._machine, c_int16(number)))

    def brake(self) -> int:
        """Every axis decelerates to standstill from the next period on; the fault of that."""
        return int(self._library.machine_brake(self._machine))

    def moves(self) -> bool:
        """Whether an axis moves."""
        return bool(self._library.machine_moves(self._machine))

    @property
    def changed(self) -> bool:
        """Whether `raws_out` is to be sent again: a fault of equipment has changed it, or a part with a rate of its own
        has acted."""
        return bool(self._library.host_changed(self._machine))

    @property
    def given(self) -> bool:
        """Whether values are to be sent that were not before; not only defaults of equipment in fault."""
        return bool(self._library.host_given(self._machine))

    def referenced(self, slot: int, known: bool = True, at: float | None = None) -> None:
        """As `DigitalSensor.referenced`."""
        if at is not None and self._library.host_set_reading(self._machine, c_int16(slot), c_double(at)):
            raise RangeError(f"object {slot} has no reading, or {at} is no number")
        self._library.host_referenced(self._machine, c_int16(slot), c_int(known))

    def value(self, slot: int) -> float:
        return float(self._library.host_value(self._machine, c_int16(slot)))

    def velocity(self, slot: int) -> float:
        return float(self._library.host_velocity(self._machine, c_int16(slot)))

    def raw(self, slot: int) -> int:
        return int(self._library.host_raw(self._machine, c_int16(slot)))

    def quality(self, slot: int) -> int:
        return int(self._library.host_quality(self._machine, c_int16(slot)))

    def pending(self, place: int) -> float:
        return float(self._library.host_pending(self._machine, c_int16(place)))

    def inhibited(self, place: int) -> bool:
        return bool(self._library.host_inhibited(self._machine, c_int16(place)))

    @property
    def fault_object(self) -> int:
        """The slot of the object of the last fault of the runtime; -1: none."""
        return int(self._library.host_fault_object(self._machine))

    def _give(self, raws: Sequence[int], failed: Sequence[Any]) -> None:
        self._in[: self._inputs] = list(raws)
        self._failed_in[: self._inputs] = [int(each) for each in failed] or [0] * self._inputs
