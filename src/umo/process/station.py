"""Finding a station: a directory, or a package that ships with umo."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from umo.errors import DeclarationError, UmoError
from umo.objects import Compound
from umo.text import cause_of, did_you_mean, place_of

SHIPPED = "umo.stations"
"""The package of the stations that ship with umo."""


class StationError(UmoError, LookupError):
    """No such station, or one that lacks what a station has."""


@dataclass(frozen=True)
class Station:
    """A place with `objects.py` (`machine()`), `application.py` (`main(m, ...)`) and `wiring/*.toml`."""

    name: str
    path: Path
    package: str
    """Its package, with a dot at the end; empty for a directory, whose modules are imported by their bare names."""

    def module(self, name: str) -> ModuleType | None:
        """One of its modules, None where there is none; StationError if it cannot be imported."""
        if not (self.path / f"{name}.py").is_file():
            return None
        try:
            module = importlib.import_module(self.package + name)
        except (UmoError, KeyboardInterrupt):
            raise
        except BaseException as error:  # SystemExit too: a station that ends Python has not succeeded
            text = f"{self.path / name}.py cannot be imported: {cause_of(error)}{place_of(error)}"
            raise StationError(text) from error
        if module.__file__ is None or Path(module.__file__).resolve() != (self.path / f"{name}.py").resolve():
            raise StationError(f"{self.path / name}.py is hidden by another module {name!r}, {module.__file__}")
        return module

    def machine(self) -> Compound:
        """A new machine, declared and not connected."""
        objects = self.module("objects")
        make = getattr(objects, "machine", None)
        if not callable(make):
            raise StationError(f"{self.path / 'objects.py'} has no machine()")
        try:
            root = make()
        except (UmoError, KeyboardInterrupt):
            raise
        except BaseException as error:
            text = f"machine() of {self.path / 'objects.py'} failed: {cause_of(error)}{place_of(error)}"
            raise StationError(text) from error
        if not isinstance(root, Compound):
            raise DeclarationError(f"machine() of {self.path / 'objects.py'} returned {root!r}, not a Compound")
        return root

    @property
    def main(self) -> Callable[..., Any] | None:
        """`main` of application.py; None where there is none."""
        return getattr(self.module("application"), "main", None)

    @cached_property
    def wirings(self) -> dict[str, Path]:
        """The station's wirings by name, `simulated` first."""
        found = {path.stem: path for path in sorted(self.path.glob("wiring/*.toml"))}
        return {name: found[name] for name in sorted(found, key=lambda name: (name != "simulated", name))}

    def wiring(self, name: str | None) -> Path | None:
        """A wiring of the station by name, or any file; None (everything simulated) where it has none."""
        if name is None:
            return next(iter(self.wirings.values()), None)
        if name in self.wirings:
            return self.wirings[name]
        if Path(name).is_file():
            return Path(name)
        known = ", ".join(self.wirings) or "none"
        raise StationError(f"no wiring {name!r}{did_you_mean(name, self.wirings)}; {self.name} has: {known}")


def shipped() -> dict[str, Path]:
    """The stations that ship with umo, by name."""
    package = importlib.import_module(SHIPPED)  # by name: stations stand above this layer
    folders = [Path(folder) for folder in package.__path__]
    names = [module.name for module in pkgutil.iter_modules(package.__path__) if module.ispkg]
    return {name: next(folder / name for folder in folders if (folder / name).is_dir()) for name in names}


def find(text: str) -> Station:
    """The station of that name, or in that directory."""
    path = Path(text)
    if (path / "objects.py").is_file():
        folder = str(path.resolve())
        if folder not in sys.path:
            sys.path.insert(0, folder)  # so that its modules and its drivers are found by their bare names
        return Station(path.resolve().name, path.resolve(), "")
    if text in (known := shipped()):
        return Station(text, known[text], f"{SHIPPED}.{text}.")
    if path.is_dir():
        raise StationError(f"{text} is not a station: it has no objects.py (`umo new DIR` makes one)")
    raise StationError(f"no station {text!r}{did_you_mean(text, known)}: a directory, or one of: {', '.join(known)}")
