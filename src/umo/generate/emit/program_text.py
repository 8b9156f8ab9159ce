"""The translated functions of a machine as text of C, with their structs, tables and faults."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from umo.generate.c_types import BOOL, ArrayType, CType, TupleType, optional
from umo.generate.emit.c_text import array, comment
from umo.generate.emit.fault_tests import IS_LIMIT, tests_of
from umo.generate.emit.function_text import function_text, statements_text
from umo.generate.form import Finally, MachineForm, Struct, statements
from umo.generate.names import member_name
from umo.generate.translation import CodeFault, ControllerTarget


def header_text(program: MachineForm) -> str:
    """Return the struct declarations: one for each kind of array, each tuple and each object."""
    records = [_record(each) for each in program.records]
    return "\n".join([*records, *(part for each in program.structs for part in _object(each))])


def members_text(program: MachineForm) -> str:
    """Return the members of `struct umo_machine` for the objects, one per line."""
    return "".join(f"    machine_of_{each.name} {each.name};\n" for each in program.structs)


def source_text(program: MachineForm, target: ControllerTarget) -> str:
    """Return the functions, after the tables and the tests of faults."""
    tables = "".join(array("int16_t", name, list(map(str, slots))) for name, slots in program.tables.items())
    asked = [(name, program.handled[kinds]) for kinds, name in tests_of(program).items()]
    if program.limits and any(isinstance(each, Finally) and each.pending for each in statements(*program.functions)):
        asked.append((IS_LIMIT, program.limits))
    tests = "\n".join(_test(*each) for each in asked)
    bodies = "\n".join(function_text(each, program, target) for each in program.functions)
    return "\n".join(part for part in (tables, tests, bodies) if part)


def faults_text(faults: Sequence[CodeFault]) -> str:
    """Return the names of the faults of translated code, as an enum."""
    told = (f"{each.kind}: {comment(each.text)} ({comment(each.file)}:{each.line})" for each in faults)
    lines = [f"    {each.name} = {each.number}, /* {text} */\n" for each, text in zip(faults, told, strict=True)]
    return f"enum {{\n{''.join(lines)}}};\n" if lines else ""


def begin_text(program: MachineForm, target: ControllerTarget) -> str:
    """Return the function that sets the initial values of the fields."""
    lines = statements_text(program.begin, target) or ["    (void)m;"]
    return "\n".join(["static void init_objects(umo_machine *m)", "{", *lines, "}"]) + "\n"


def access_text(program: MachineForm) -> str:
    """Return the function that finds the structs by number."""
    cases = "".join(f"    case {n}:\n        return &m->{each.name};\n" for n, each in enumerate(program.structs))
    access = f"    switch (number) {{\n{cases}    default:\n        (void)m;\n        return NULL;\n    }}\n"
    return f"void *machine_struct(umo_machine *m, int16_t number)\n{{\n{access}}}\n"


def _record(of: CType) -> str:
    """Return a type of several numbers, and its optional type."""
    if isinstance(of, ArrayType):
        own = f"typedef struct {{\n    {of.of.name} at[{of.length}];\n}} {of.name};\n"
    else:
        assert isinstance(of, TupleType)
        own = _struct(of.name, of.members)
    return own + _struct(optional(of).name, [("has", BOOL), ("value", of)])


def _object(struct: Struct) -> tuple[str, str]:
    return f"/* {comment(struct.title)} */\n", _struct(f"machine_of_{struct.name}", struct.fields)


def _struct(name: str, members: Iterable[tuple[str, CType]]) -> str:
    lines = [f"    {of.name} {member_name(each)};\n" for each, of in members]
    return f"typedef struct {{\n{''.join(lines)}}} {name};\n"


def _test(name: str, faults: Sequence[str]) -> str:
    if not faults:
        return f"static bool {name}(int32_t fault)\n{{\n    (void)fault;\n    return false;\n}}\n"
    cases = "".join(f"    case {each}:\n" for each in faults)
    return (
        f"static bool {name}(int32_t fault)\n{{\n    switch (fault) {{\n{cases}"
        "        return true;\n    default:\n        return false;\n    }\n}\n"
    )
