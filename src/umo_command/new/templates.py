"""`umo new station`, `driver` and `face`: write a small working example from which the user continues (the files of
`template/`)."""

from __future__ import annotations

import importlib.util
import json
import keyword
import re
import shutil
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import as_file, files
from pathlib import Path

from umo.drivers.registry import GROUP
from umo.process.station import Station, StationError
from umo.system.packages import MARK, package_of, registered
from umo.text import printable
from umo_command.console import out

EXAMPLE, CLASS = "my_card", "MyCard"
"""The names in the templates of a driver that are replaced."""
SETTINGS = "pyproject.toml"
NOT_COPIED = shutil.ignore_patterns("__pycache__", ".*", "runs")
FACE, FACE_CLASS = "my_face", "MyFace"
"""The names in the template of a face that are replaced."""


def make_station(directory: Path, source: Station | None = None) -> None:
    """Copy the template, or another station. Raises StationError if the directory exists and is not empty, or if the
    name is not suitable or belongs to an installed module."""
    own = _checked_name(directory)
    if source is not None and source.path in directory.absolute().parents:
        raise StationError(f"{directory} is a folder of {source.name}: a copy must have a place outside")
    try:
        with as_file(files("umo_command") / "template") as templates:
            if source is None:
                shutil.copytree(templates / "station", directory, dirs_exist_ok=True, ignore=NOT_COPIED)
            else:
                _copy(source, directory, templates)
        for before in ("station", *([] if source is None else [source.name])):
            _rename(directory, before, own)
    except OSError as error:
        raise StationError(f"{directory} cannot be written: {error}") from error
    is_what = "is a station" if source is None else f"is a copy of {source.name}"
    by_hand = " call fill target=200mm" if source is None else ""
    out.print(
        f"{directory} {is_what}. Try:  umo run {directory}   umo show parts {directory}   pytest {directory}\n"
        f"To find errors before a run:  umo check {directory}   and, in {directory}, mypy (pip install mypy)\n"
        f"By hand:  umo run {directory} --manual   and in another terminal  umo do {directory}{by_hand}",
        soft_wrap=True,
    )
    if source is not None:
        names = [f"{file.stem} ({directory / 'wiring' / file.name})" for file in source.wirings.values()]
        out.print(f"Its wirings: {', '.join(names)}", soft_wrap=True)


def _checked_name(directory: Path) -> str:
    """Return the name of a new station. Raises StationError, as `make_station` does."""
    name = directory.name
    if name and not directory.exists() and not re.fullmatch(r"\w[\w.-]*", name):
        near = re.sub(r"[^\w.-]+", "-", name).strip("-.") or "my-machine"
        what = "letters, digits, _, - and ., beginning with a letter or a digit"
        raise StationError(f"{printable(name)!r} is not a name for a station: {what}; try {near}")
    own = directory.absolute().name
    if _is_module(own):
        what = "is the name of an installed module, which type checkers would read instead of the station"
        raise StationError(f"{own} {what}; try {own}-machine")
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise StationError(f"{directory} is not empty; nothing was written")
    return own


def _copy(source: Station, directory: Path, templates: Path) -> None:
    """Copy a station. If it has no tests or no settings of type checkers, add those of the templates. Wirings that name
    a driver of the station by a registered name, name the module of the copy."""
    shutil.copytree(source.path, directory, dirs_exist_ok=True, ignore=NOT_COPIED)
    if not (directory / "tests").exists():
        shutil.copytree(templates / "copy" / "tests", directory / "tests", ignore=NOT_COPIED)
    if not (directory / SETTINGS).exists():
        shutil.copy(templates / "station" / SETTINGS, directory)
    package = package_of(source.path)
    own = {each.name: each.value.removeprefix(package) for each in registered(GROUP) if _is_in(each.value, package)}
    for wiring in directory.glob("wiring/*.toml"):
        text = wiring.read_text("utf-8")
        for name, module in own.items():
            text = text.replace(f'type = "{name}"', f'type = "{module}"')
        wiring.write_text(text, "utf-8")


def _is_in(name: str, package: str) -> bool:
    return name.startswith(f"{package}.")


def _rename(directory: Path, before: str, own: str) -> None:
    """Write the name of a station into its settings and into the name of its test."""
    settings = directory / SETTINGS
    text = settings.read_text("utf-8")
    settings.write_text(text.replace(json.dumps(before), json.dumps(own, ensure_ascii=False)), "utf-8")
    test = directory / "tests" / f"test_{_module_of(before)}.py"
    if test.exists():
        test.rename(test.with_name(f"test_{_module_of(own)}.py"))  # pytest takes no two modules of one name


def _module_of(station: str) -> str:
    return re.sub(r"\W", "_", station)


def make_driver(name: str, folder: Path, lines: Sequence[str] = ()) -> None:
    """Write `NAME.py` and `test_NAME.py` into the folder. With a `line`, "tcp" or "serial", also write
    `NAME_device.py`. Raises StationError if the name cannot be used, a file exists, or there are two lines."""
    if len(lines) > 1:
        raise StationError(f"give --{' or --'.join(lines)}, not both")
    line = "".join(lines)
    _check_module(name, folder, "driver")
    cls = _class_of(name)
    template = files("umo_command") / "template" / ("line" if line else "driver")
    changes = tomllib.loads((template / "serial.toml").read_text("utf-8"))["changes"] if line == "serial" else []
    texts = {}
    for pattern in ("{}.py", "{}_device.py", "test_{}.py") if line else ("{}.py", "test_{}.py"):
        text = (template / pattern.format(EXAMPLE)).read_text("utf-8")
        for before, after in changes:
            text = text.replace(before, after)
        texts[folder / pattern.format(name)] = text.replace(EXAMPLE, name).replace(CLASS, cls)
    _write(texts)
    in_station = (folder / MARK).is_file()
    kind = f"{'.' if in_station else ''}{name}:{cls}"
    elsewhere = "" if in_station else f'; with {name}.py in the folder of a station: type = ".{kind}"'
    driver, *device, test = (file.name for file in texts)
    stand_in = f"{device[0]} the device for its tests" if device else "with a device in memory"
    own = "the options and the frames" if device else "the options and the class Device"
    out.print(
        f"{driver} is a driver, {stand_in}; {test} tests whether it keeps its contract. Try:\n"
        f"  pytest {test}\n"
        f"  umo device drivers {kind}\n"
        f"In {driver}, replace CHANNELS, {own} by those of your device.\n"
        f'In a wiring: [drivers.{name}] type = "{kind}"{elsewhere}',
        soft_wrap=True,
    )
    if device:
        out.print(
            "A device that speaks in lines of text needs no driver of its own: the driver text takes its commands from "
            "a few lines of the wiring (docs/driver-text.md).",
            soft_wrap=True,
        )


def make_face(name: str, folder: Path) -> None:
    """Write `NAME.py` and `test_NAME.py` into the folder. Raises StationError if the name cannot be used, or a file
    exists."""
    _check_module(name, folder, "face")
    cls, template = _class_of(name), files("umo_command") / "template" / "face"
    patterns = ("{}.py", "test_{}.py")
    texts = {pattern: (template / pattern.format(FACE)).read_text("utf-8") for pattern in patterns}
    made = {
        folder / each.format(name): text.replace(FACE, name).replace(FACE_CLASS, cls) for each, text in texts.items()
    }
    _write(made)
    face, test = (file.name for file in made)
    out.print(
        f"{face} is a face that serves JSON over TCP; {test} tests whether it keeps its contract. Try:\n"
        f"  pytest {test}\n"
        f"  umo connect face {name}:{cls} --commands\n"
        f"In {face}, replace the lines by the protocol of your clients (docs/howto-write-a-face.md).",
        soft_wrap=True,
    )


def _class_of(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _write(texts: Mapping[Path, str]) -> None:
    """Write the files, all or none. Raises StationError if there is one already."""
    for file in texts:
        if file.exists():
            raise StationError(f"{file.name} exists; nothing was written")
    for file, text in texts.items():
        file.write_text(text, "utf-8")


def _check_module(name: str, folder: Path, kind: str) -> None:
    """Raise StationError for a name that a user's module cannot have. `kind`: the kind of module."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        near = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)  # MyCard
        near = re.sub(r"[^a-z0-9]+", "_", near.lower()).strip("_").lstrip("0123456789_")
        near = f"{near}_{kind}" if keyword.iskeyword(near) else near or {"driver": EXAMPLE, "face": FACE}[kind]
        what = "small letters, digits and _, beginning with a letter, and not a word of Python"
        raise StationError(f"{printable(name)!r} is not the name of a module: {what}; try {near}")
    if name in sys.stdlib_module_names or name == "umo" or _is_installed(name, folder):
        raise StationError(f"{name} is the name of an installed module, which the {kind} would hide; try {name}_{kind}")


def _is_module(name: str) -> bool:
    """Return True if a module of this name is imported in place of a folder without `__init__.py`, as a station's
    is."""
    spec = importlib.util.find_spec(name) if name.isidentifier() and not name.startswith("_") else None
    return spec is not None and spec.origin is not None


def _is_installed(name: str, folder: Path) -> bool:
    spec = importlib.util.find_spec(name)
    return spec is not None and (spec.origin is None or Path(spec.origin).parent != folder.resolve())
