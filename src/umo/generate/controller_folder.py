"""The folder of a generated controller: machine.h and machine.c, the runtime, and the files that a board needs around
them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from umo.errors import DeclarationError
from umo.generate.controller_model import ControllerModel, NotGenerated, inexact_as_floats
from umo.generate.emit.machine_source import header_of, source_of
from umo.generate.emit.object_tables import large_tables
from umo.generate.translation import (
    FIRST_FAULT,
    RUNTIME_FAULTS,
    CodeFault,
    ControllerTarget,
    Translation,
    Untranslatable,
)
from umo.system.folders import written

HERE = Path(__file__).parent
RUNTIME, BOARDS = HERE / "runtime", HERE / "boards"
TARGETS: Mapping[str, ControllerTarget] = {
    "host": ControllerTarget("host", "double", exact_libm=True),
    "cortex-m": ControllerTarget("cortex-m", "double"),
    "avr": ControllerTarget("avr", "float", table_bytes=32_767),
    "arduino": ControllerTarget("arduino", "float"),
}
"""The targets by name, with their number types."""
TARGET_HEADER = {
    "double": "/* umo_target.h: numbers are doubles. */\n",
    "float": "/* umo_target.h: numbers are floats of 32 bits. */\n#define UMO_FLOAT\n",
}
"""The file umo_target.h for machines whose parts all have the same rate."""


def target_header(target: ControllerTarget, groups: int) -> str:
    """Return the file umo_target.h. `groups`: number of parts that have their own rate."""
    own = f"#define UMO_GROUPS {groups} /* parts that have a rate of their own */\n" if groups else ""
    return TARGET_HEADER[target.real] + own


class NotTranslated(DeclarationError):
    """Raised if a machine cannot be generated as a controller. `reasons` has all obstacles."""

    def __init__(self, machine: str, reasons: list[str]) -> None:
        super().__init__("\n".join([f"{machine} cannot be generated:", *reasons]))
        self.reasons = reasons


def check(model: ControllerModel, translation: Translation, tables: Iterable[NotGenerated] = ()) -> None:
    """Raise NotTranslated with all obstacles. `tables`: the tables that are too large."""
    problems: list[NotGenerated | Untranslatable] = [
        *model.problems,
        *tables,
        *translation.problems,
        *translation.on_host,
    ]
    if problems:
        raise NotTranslated(model.name, list(dict.fromkeys(map(str, problems))))


def faults_of(translation: Translation) -> list[CodeFault]:
    """Return all faults by number: those of the runtime, followed by those of translated code."""
    own = [CodeFault(number, kind, text, "", 0, name) for number, (name, kind, text) in enumerate(RUNTIME_FAULTS, 1)]
    return [*own, *translation.faults]


def files_of(model: ControllerModel, translation: Translation, target: ControllerTarget) -> dict[str, str]:
    """Return the text of each file by name. Raises NotTranslated with all obstacles."""
    check(model, translation, large_tables(model, target))
    files = {file.name: file.read_text("utf-8") for file in sorted(RUNTIME.iterdir()) if file.suffix in (".h", ".c")}
    if target.name != "host":
        del files["host_access.c"]
    files["machine.h"] = header_of(model, translation, target)
    files["machine.c"] = source_of(model, translation, target)
    files["umo_target.h"] = target_header(target, len(model.groups))
    files["machine_faults.h"] = _faults_header(translation)
    files["faults.json"] = json.dumps([each._asdict() for each in faults_of(translation)], indent=1) + "\n"
    for name in ("common", target.name, *(["lines"] if target.name != "arduino" else [])):
        files |= {file.name: file.read_text("utf-8") for file in sorted((BOARDS / name).iterdir())}
    files["README.md"] = _readme(files.pop("README.md.in", ""), model, translation, target)
    return files


def write_folder(files: Mapping[str, str], folder: Path) -> list[str]:
    """Write the files. Existing files that a user fills in (io_board.c and the build file) are not overwritten. Their
    names are returned. An Arduino sketch gets the name of its folder. Raises OSError if a file cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {f"{folder.resolve().name}.ino" if name == "sketch.ino" else name: text for name, text in files.items()}
    kept = [name for name in files if _is_users(name) and (folder / name).exists()]
    for name, text in files.items():
        if name not in kept:
            with written(folder / name, 0o644) as file:
                file.write(text.encode())
    return kept


def _is_users(name: str) -> bool:
    return name.startswith(("io_board.", "io_link.")) or name == "Makefile"


def _faults_header(translation: Translation) -> str:
    number = f"#define MACHINE_FAULTS {len(translation.faults)} /* from {FIRST_FAULT} on; below: umo.h */\n"
    head = "/* machine_faults.h: what the faults of machine_step mean. */\n#ifndef MACHINE_FAULTS\n"
    return f"{head}{number}{translation.fault_names}#endif\n"


def _readme(text: str, model: ControllerModel, translation: Translation, target: ControllerTarget) -> str:
    notes = [*model.notes, *translation.notes]
    if target.real == "float" and (inexact := inexact_as_floats(model.objects)):
        notes.append(f"32-bit floats cannot distinguish all raw integers of: {', '.join(inexact)}")
    taken = [f"taken as known: {each}" for each in translation.known.names.values() if each.is_worth_noting]
    told = "".join(f"- {note}\n" for note in (*notes, *taken)) or "- Nothing.\n"
    numbers = {"double": "doubles: equal to the bit with Python", "float": "floats: within one raw step of Python"}
    return text.replace("@NAME@", model.name).replace("@NUMBERS@", numbers[target.real]).replace("@NOTES@", told)
