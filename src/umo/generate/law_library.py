"""Compiles the laws of a machine, once per source, as a shared library that works on the memory of Python."""

from __future__ import annotations

import hashlib
import os
import subprocess
import tempfile
from collections.abc import Sequence
from ctypes import (
    CFUNCTYPE,
    POINTER,
    PyDLL,
    Structure,
    c_bool,
    c_double,
    c_int16,
    c_int32,
    c_size_t,
    c_uint16,
    c_void_p,
    create_string_buffer,
)
from dataclasses import replace
from pathlib import Path
from typing import Any

from umo.errors import DeclarationError
from umo.generate.c_compiler import COMPILE_TIMEOUT, FLAGS, compiler
from umo.generate.c_types import CType
from umo.generate.compiler_errors import compiler_message
from umo.generate.controller_folder import RUNTIME, TARGETS, target_header
from umo.generate.controller_model import ControllerModel
from umo.generate.emit.object_tables import tables_of
from umo.generate.lower.live_fields import LiveStruct
from umo.generate.struct_memory import StructMemory
from umo.generate.translation import CFunction, Translation

ON_HOST = Path(__file__).parent / "on_host"
SHARED = "umo.h", "umo_scaling.h", "umo_curves.h", "umo_python.h", "umo_digits.h", "umo_access.c", "umo_sums.c"
"""The files of the controllers' runtime that compiled laws use too."""
TAKEN = POINTER(c_bool)
CHANGED = CFUNCTYPE(None, c_int32, c_double)
WRITE = CFUNCTYPE(c_int16, c_int32, c_double, TAKEN)
WRITE_MANY = CFUNCTYPE(c_int16, POINTER(c_int16), c_int16, POINTER(c_double), POINTER(c_bool), TAKEN)
READ = CFUNCTYPE(c_int16, c_int32, POINTER(c_double))
HOST_CALL = CFUNCTYPE(c_int16, c_uint16, POINTER(c_double), c_uint16)
TEXT_CALLBACK = CFUNCTYPE(c_int16, c_uint16, POINTER(c_void_p))
BESIDE_PYTHON = replace(TARGETS["host"], makes_texts=True)
"""The target for laws that Python calls. Python also makes texts for these laws."""
TARGET = target_header(BESIDE_PYTHON, 1)
"""The file umo_target.h, with which the clocks of parts are those of Python."""
SOURCE = """\
#include "umo_columns.h"

{structs}
struct umo_machine {{
    umo_core core; /* the first member */
    umo_object objects[{objects_1}];
{members}}};

{fault_names}
{source}
{tables}{access}
static const umo_plan plan = {{.period = {period}, .objects = {objects}, .traits = traits}};

size_t law_size(void)
{{
    return sizeof(umo_machine);
}}

void law_begin(umo_machine *m, umo_columns *columns)
{{
    m->core.plan = &plan;
    m->core.objects = m->objects;
    m->core.outputs = (umo_output *)(void *)columns;
    for (int16_t i = 0; i < {objects}; i++) {{
        m->objects[i].core = &m->core;
        m->objects[i].traits = &traits[i];
    }}
}}

int16_t law_fault_object(const umo_machine *m)
{{
    return m->core.fault_object;
}}

int16_t law_call(umo_machine *m, int32_t law, double now, double dt, int32_t ticks)
{{
    m->core.now = now;
    m->core.dt = dt;
    m->core.ticks = ticks;
    m->core.fault_object = -1;
    columns_of(&m->core)->line = 0;
    umo_fault fault = UMO_OK;
    bool holds = false;
    switch (law) {{
{cases}    default:
        return UMO_NO_HOST;
    }}
    return fault == UMO_OK && holds ? {true} : fault;
}}
"""
TRUE = -1
"""The number that a true condition returns in place of a fault."""
LAW = """\
    case {number}:
        return {call};
"""
CONDITION = """\
    case {number}:
        fault = {call};
        break;
"""


class ColumnPointers(Structure):
    """The struct umo_columns of umo_columns.h."""

    _fields_ = [
        ("values", c_void_p),
        ("raws", c_void_p),
        ("quality", c_void_p),
        ("restrictions", c_void_p),
        ("pending", c_void_p),
        ("written", c_void_p),
        ("owners", c_void_p),
        ("law", c_void_p),
        ("groups", c_void_p),
        ("changed", CHANGED),
        ("write", WRITE),
        ("write_many", WRITE_MANY),
        ("velocity", READ),
        ("read_now", READ),
        ("host_call", HOST_CALL),
        ("tell", TEXT_CALLBACK),
        ("file", c_int32),
        ("line", c_int32),
    ]


def source_of_laws(model: ControllerModel, translation: Translation, conditions: Sequence[CFunction]) -> str:
    """Return the source of the library, in C: the laws, then the conditions."""
    laws = [translation.entry[law.control] for law in model.laws]
    cases = [LAW.format(number=number, call=each.call()) for number, each in enumerate(laws)]
    cases += [CONDITION.format(number=n, call=each.call("&holds")) for n, each in enumerate(conditions, len(laws))]
    return SOURCE.format(
        structs=translation.header,
        objects=len(model.objects),
        objects_1=max(1, len(model.objects)),
        members=translation.members,
        fault_names=translation.fault_names,
        source=translation.source,
        tables=tables_of(model, BESIDE_PYTHON),
        access=translation.access,
        period=repr(model.period),
        true=TRUE,
        cases="".join(cases),
    )


def library_of(source: str) -> Path:
    """Return the compiled library of a source, from the cache if it was compiled before. Raises DeclarationError with
    the compiler's message, or if there is no compiler."""
    cc = compiler()
    if cc is None:
        raise DeclarationError("there is no C compiler: none of cc, gcc, clang was found")
    folder = _cache()
    parts = [source, TARGET, " ".join(FLAGS), _version(cc), *(file.read_text("utf-8") for file in _files())]
    path = folder / f"{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()[:32]}.so"
    if not _is_sound(path):
        _compile(cc, source, path)
    return path


def _is_sound(path: Path) -> bool:
    """True if the library exists and can be loaded: a power failure may have left an incomplete file."""
    if not path.exists():
        return False
    try:
        PyDLL(str(path))
    except OSError:
        path.unlink(missing_ok=True)
        return False
    return True


def _files() -> list[Path]:
    return [*(RUNTIME / name for name in SHARED), *sorted(ON_HOST.iterdir())]


def _version(cc: str) -> str:
    try:
        words = [cc, "--version"]
        return subprocess.run(words, capture_output=True, text=True, check=False, timeout=COMPILE_TIMEOUT).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeclarationError(f"the compiler {cc} failed: {error}") from None


def _cache() -> Path:
    """Return a folder of this user only; if none can be made, a new folder for this run."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "umo" / "laws"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        if status.st_uid == os.getuid() and not status.st_mode & 0o022 and os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="umo-laws-"))


def _compile(cc: str, source: str, path: Path) -> None:
    """Compile to a temporary name, then rename: an existing file is always complete."""
    with tempfile.TemporaryDirectory(dir=path.parent) as name:
        folder = Path(name)
        (folder / "laws.c").write_text(source, "utf-8")
        (folder / "umo_target.h").write_text(TARGET, "utf-8")
        for file in _files():
            (folder / file.name).write_bytes(file.read_bytes())
        sources = ["laws.c", *(file.name for file in _files() if file.suffix == ".c")]
        command = [cc, *FLAGS, "-Wno-unused-function", "-fPIC", "-shared", "-o", "laws.so", *sources, "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, check=False, timeout=COMPILE_TIMEOUT
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise DeclarationError(f"the compiler {cc} failed: {error}") from None
        if done.returncode:
            raise DeclarationError(compiler_message(done.stderr, lambda name: (folder / name).read_text("utf-8")))
        os.replace(folder / "laws.so", path)


class LawLibrary:
    """The loaded laws of one machine. `columns` is the memory on which they work."""

    def __init__(self, path: Path, columns: ColumnPointers) -> None:
        self._library = library = PyDLL(str(path))  # it calls Python back
        library.law_size.restype = c_size_t
        library.machine_struct.restype = c_void_p
        library.law_call.restype = library.law_fault_object.restype = c_int16
        library.law_call.argtypes = [c_void_p, c_int32, c_double, c_double, c_int32]
        self._columns = columns
        self._memory = create_string_buffer(library.law_size())
        library.law_begin(self._memory, c_void_p(_address(columns)))
        self._variables = StructMemory(LiveStruct(None, "", "variables"), _address(self._memory))

    def structs(self, structs: Sequence[LiveStruct]) -> list[StructMemory]:
        """Return the fields of the live objects."""
        found = (int(self._library.machine_struct(self._memory, c_int16(n))) for n in range(len(structs)))
        keep = self._memory
        return [StructMemory(struct, address, keep=keep) for struct, address in zip(structs, found, strict=True)]

    def variable(self, address: int, of: CType) -> Any:
        """Return a variable of a law that calls Python, as a value of Python."""
        return self._variables.at(address, of)

    def call(self, law: int, clock: Any) -> int:
        """Carry out one period of a law and return its fault."""
        return int(self._library.law_call(self._memory, law, clock.now, clock.dt, clock.ticks))

    @property
    def addresses(self) -> tuple[int, int]:
        """The addresses of the function `law_call` and of the machine."""
        function = c_void_p.from_buffer(self._library.law_call).value
        assert function is not None
        return function, _address(self._memory)

    @property
    def fault_object(self) -> int:
        """The slot of the object of the last fault, or -1 if there is none."""
        return int(self._library.law_fault_object(self._memory))

    @property
    def fault_place(self) -> tuple[int, int]:
        """The number of the file, and the line, of the runtime's last fault in this call. The line is 0 if there was
        none."""
        return int(self._columns.file), int(self._columns.line)


def _address(memory: Any) -> int:
    from ctypes import addressof

    return addressof(memory)
