"""The search for a station: a directory, or a package that ships with umo."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from umo.cycle.not_awaited import heard
from umo.errors import DeclarationError, UmoError, text_of
from umo.objects import Compound
from umo.system.packages import MARK, SHIPPED, package_of, registered
from umo.text import did_you_mean, in_brackets, shown_place
from umo.user_code import definition, is_interrupt, raise_as

GROUP = "umo.stations"
"""The group of entry points for stations that packages install. Each has the name of the station and the package that
is the station's folder."""


class StationError(UmoError, LookupError):
    """The station does not exist, or lacks a required part."""


@dataclass(frozen=True)
class Station:
    """A folder with `objects.py` (`machine(...)`), `application.py` (`main(m, ...)`) and `wiring/*.toml`.

    The folder is imported as a package, so its modules import one another by `from .control import ...`.
    """

    name: str
    path: Path

    def module(self, name: str) -> ModuleType | None:
        """Return the module of the station with this name, or None if there is none. Raises StationError if the module
        cannot be imported."""
        file = self.path / f"{name}.py"
        if not file.is_file():
            return None
        try:
            return importlib.import_module(f"{package_of(self.path)}.{name}")
        except BaseException as error:  # SystemExit too: a station that ends Python has not succeeded
            if isinstance(error, UmoError) or is_interrupt(error):
                raise
            hint = self._hint(error)
            raise StationError(f"{file} cannot be imported: {text_of(error)}{hint}") from error

    def load(self, name: str) -> Any:
        """Return the module of the station with this name. It is the same object that the station itself imports, so
        that tests get the classes that the station uses (`Tank = station(__file__).load("control").Tank`). Raises
        StationError if there is no such module."""
        found = self.module(name)
        if found is None:
            known = [file.stem for file in sorted(self.path.glob("*.py"))]
            raise StationError(f"{self.path} has no {name}.py{did_you_mean(name, known)}")
        return found

    def _hint(self, error: BaseException) -> str:
        name = error.name if isinstance(error, ImportError) else None
        if name is None or not (self.path / f"{name}.py").is_file():
            return ""
        return f"; a station is a package: write `from .{name} import ...`"

    @property
    def make(self) -> Callable[..., Any]:
        """The function `machine` of objects.py. Its parameters are options of the station."""
        make: Callable[..., Any] | None = getattr(self.module("objects"), "machine", None)
        if not callable(make):
            raise StationError(f"{self.path / 'objects.py'} has no machine()")
        return make

    def machine(self, **options: Any) -> Compound:
        """Return a new machine, declared and not connected. The options are parameters of `machine` in objects.py."""
        return declared(self.make, f"machine() of {self.path / 'objects.py'}", options)

    @property
    def main(self) -> Callable[..., Any] | None:
        """The function `main` of application.py; None without this file. Raises StationError if the file has no
        `main`."""
        module = self.module("application")
        if module is None:
            return None
        main: Callable[..., Any] | None = getattr(module, "main", None)
        if main is None:
            names = [name for name, value in vars(module).items() if callable(value)]
            raise StationError(f"{self.path / 'application.py'} has no main(){did_you_mean('main', names)}")
        return main

    @cached_property
    def wirings(self) -> dict[str, Path]:
        """The station's wirings by name, `simulated` first."""
        found = {path.stem: path for path in sorted(self.path.glob("wiring/*.toml"))}
        return {name: found[name] for name in sorted(found, key=lambda name: (name != "simulated", name))}

    def wiring(self, name: str | None) -> Path | None:
        """Return a wiring of the station by name, or any file; None (everything simulated) if the station has no
        wiring."""
        if name is None:
            return next(iter(self.wirings.values()), None)
        if name in self.wirings:
            return self.wirings[name]
        if Path(name).is_file():
            return Path(name)
        known = ", ".join(self.wirings) or "none"
        raise StationError(f"there is no wiring {name!r}{did_you_mean(name, self.wirings)}; {self.name} has: {known}")


def declared(make: Callable[..., Any], what: str, options: Mapping[str, Any]) -> Compound:
    """Return the machine that a function declares. Raises DeclarationError if it fails or returns something else."""
    with raise_as(DeclarationError, f"{what} failed"), heard():
        root = make(**options)
    if not isinstance(root, Compound):
        raise DeclarationError(f"{what} returned {root!r}, not a Compound{_instead(root)}")
    if not hasattr(root, "_parent"):
        place = in_brackets(shown_place(definition(type(root).__init__)))
        text = (
            f"{type(root).__name__}.__init__ does not create the parts: write `setup` instead, which is called when "
            f"they exist"
        )
        raise DeclarationError(f"{text}{place}")
    return root


def _instead(root: object) -> str:
    """Return advice for the message if something else was given in place of a machine."""
    if root is None:
        return ": write `return` before the machine"
    if isinstance(root, type) and issubclass(root, Compound):
        return f": write `{root.__name__}(...)`, with its parts"
    return ""


def shipped() -> dict[str, Path]:
    """Return the stations that ship with umo, by name."""
    return {file.parent.name: file.parent for file in sorted(SHIPPED.glob(f"*/{MARK}"))}


def packaged(name: str) -> Path | None:
    """Return the folder of the station of this name that ships with umo, or that an installed package registers (entry
    points of the group `umo.stations`), or None if there is none."""
    if (folder := shipped().get(name)) is not None:
        return folder
    for point in registered(GROUP, name=name):
        with raise_as(StationError, f"the installed station {name!r} ({point.value}) cannot be imported"):
            spec = importlib.util.find_spec(point.value)
        for place in (spec.submodule_search_locations or ()) if spec else ():
            if (Path(place) / MARK).is_file():
                return Path(place).resolve()
    return None


def find(name: str | Path) -> Station:
    """Return the station with this name, or in this directory."""
    path, text = Path(name), str(name)
    if (path / MARK).is_file():
        return Station(path.resolve().name, path.resolve())
    if (folder := packaged(text)) is not None:
        return Station(text, folder)
    known = shipped()
    if path.is_dir():
        raise StationError(f"{text} is not a station: it has no {MARK} (`umo new station DIR` makes one)")
    if path.is_file() and (path.parent / MARK).is_file():
        raise StationError(f"{text} is a file of a station: give its folder, {path.parent}")
    near = did_you_mean(text, [*known, *(each.parent.name for each in Path().glob(f"*/{MARK}"))])
    raise StationError(f"there is no station {text!r}{near}: give a folder, or one of: {', '.join(known)}")
