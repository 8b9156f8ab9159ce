"""Folders that are imported as packages, so that the modules of a station can import one another by relative imports;
and the entry points that installed packages register."""

from __future__ import annotations

import importlib.util
import re
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

SHIPPED = Path(__file__).resolve().parents[1] / "stations"
PREFIX = "umo_station_"
MARK = "objects.py"
"""The file that every station's folder has."""
DISTRIBUTION = "umo-machines"
"""The name of umo for pip. On the package index `umo` is another project."""


def umo_version() -> str:
    """Return the version of umo that is installed, such as `0.2.0`."""
    from importlib.metadata import version  # a sixth of what importing umo took

    return version(DISTRIBUTION)


def how_to_install(extra: str) -> str:
    """Return the command that installs the packages of an extra. umo is not on a package index yet, so the command
    names the clone."""
    return f'pip install ".[{extra}]" in the clone of umo'


def package_of(folder: Path) -> str:
    """Return the name under which a folder is imported as a package, whatever its place and name."""
    folder = folder.resolve()
    if folder.parent == SHIPPED:
        return f"umo.stations.{folder.name}"
    base = PREFIX + re.sub(r"\W", "_", folder.name)
    name, number = base, 1
    while name in sys.modules and sys.modules[name].__path__[:1] != [str(folder)]:
        number += 1
        name = f"{base}_{number}"
    if name not in sys.modules:
        _make(name, folder)
    return name


def station_of(file: Path) -> Path | None:
    """Return the folder of the station that a file belongs to: the file's own folder, or the one above."""
    parents = file.resolve().parents
    return next((folder for folder in parents[:2] if (folder / MARK).is_file()), None)


def registered(group: str, name: str | None = None) -> list[EntryPoint]:
    """Return the entry points that installed packages register in a group, or only those with one name, sorted. None of
    them is imported."""
    from importlib.metadata import entry_points  # a sixth of what importing umo took

    return sorted(entry_points(group=group) if name is None else entry_points(group=group, name=name))


def _make(name: str, folder: Path) -> None:
    file = folder / "__init__.py"
    places = [str(folder)]
    if file.is_file():
        spec = importlib.util.spec_from_file_location(name, file, submodule_search_locations=places)
    else:
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = places
    assert spec is not None
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    if spec.loader is None:
        return
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)  # so that it fails again, and is not used half made
        raise
