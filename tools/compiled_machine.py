"""Compiles a generated controller as a shared library of this computer and calls it through ctypes."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from ctypes import CDLL, c_bool, c_double, c_int, c_int16, c_int32, c_size_t, c_uint8, c_void_p, create_string_buffer
from pathlib import Path
from typing import Any

from umo.errors import DeclarationError, RangeError
from umo.generate.c_compiler import COMPILE_TIMEOUT, FLAGS, compiler
from umo.generate.compiler_errors import compiler_message
from umo.generate.lower.live_fields import LiveStruct
from umo.generate.struct_memory import StructMemory

LIBRARY = "machine.so"


def compiled(folder: Path, *flags: str) -> Path:
    """Compile a generated folder and return the shared library. DeclarationError if there is no compiler, or with the
    Python code whose C the compiler refuses."""
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
        raise DeclarationError(compiler_message(done.stderr, lambda name: (folder / name).read_text("utf-8")))
    return library


class CompiledMachine:
    """One machine in a shared library. A fault is a number, 0 for none. Raw integers are lists of ints, by place in the
    image."""

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
        self.restart()

    def restart(self) -> None:
        """Begin as after switching on."""
        self._library.machine_init(self._machine)

    def number(self, name: str) -> c_int32:
        """A variable of the program, an int32_t."""
        return c_int32.in_dll(self._library, name)

    def struct(self, number: int, struct: LiveStruct) -> StructMemory:
        """Return the memory of a struct of translated code, by its number."""
        return StructMemory(struct, int(self._library.machine_struct(self._machine, c_int16(number))))

    @property
    def raws_out(self) -> list[int]:
        return list(self._out[: self._outputs])

    def begin(self, raws: Sequence[int], failed: Sequence[bool] = ()) -> int:
        """Read the sensors for the first time and return the fault."""
        self._give(raws, failed)
        return int(self._library.machine_begin(self._machine, self._in, self._failed_in, self._out))

    def step(self, ticks: int, raws: Sequence[int], failed: Sequence[bool] = ()) -> int:
        """Carry out one period and return its fault."""
        self._give(raws, failed)
        return int(self._library.machine_step(self._machine, c_int32(ticks), self._in, self._failed_in, self._out))

    def sent(self, failed: Sequence[bool] = ()) -> int:
        """Confirm that `raws_out` was sent; `failed`: which values were not accepted."""
        self._failed_out[: self._outputs] = [int(each) for each in failed] or [0] * self._outputs
        return int(self._library.machine_sent(self._machine, self._failed_out))

    def stop(self) -> list[int]:
        """Set every actuator to its default and return the raw integers."""
        self._library.machine_stop(self._machine, self._out)
        return self.raws_out

    def acknowledge(self) -> None:
        self._library.machine_acknowledge(self._machine)

    def clear(self, equipment: int = -1) -> bool:
        """Clear the equipment with this number and the equipment around it and in it, or all for -1. As
        `Containment.clear`."""
        return bool(self._library.machine_clear(self._machine, c_int16(equipment)))

    def equipment_fault(self, number: int) -> int:
        return int(self._library.host_equipment_fault(self._machine, c_int16(number)))

    def brake(self) -> int:
        """Decelerate every axis to standstill from the next period on and return the fault."""
        return int(self._library.machine_brake(self._machine))

    def moves(self) -> bool:
        """True if an axis moves."""
        return bool(self._library.machine_moves(self._machine))

    @property
    def changed(self) -> bool:
        """True if `raws_out` must be sent again: a fault of equipment has changed it, or a part with a rate of its own
        has acted."""
        return bool(self._library.host_changed(self._machine))

    @property
    def given(self) -> bool:
        """True if there are new values to send that are not only defaults of equipment in fault."""
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
        """Return the slot of the object of the runtime's last fault; -1 if there is none."""
        return int(self._library.host_fault_object(self._machine))

    def _give(self, raws: Sequence[int], failed: Sequence[Any]) -> None:
        self._in[: self._inputs] = list(raws)
        self._failed_in[: self._inputs] = [int(each) for each in failed] or [0] * self._inputs
