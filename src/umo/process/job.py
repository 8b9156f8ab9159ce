"""The description of a run: a station, or a machine and an application given as functions."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from umo.cycle.run import Application
from umo.errors import DeclarationError
from umo.objects import actions_of, numbers_of
from umo.process.source_files import source_files
from umo.process.station import declared, find
from umo.user_code import raise_as
from umo.wiring import Wired, distribute_options, resolve
from umo.wiring.json_values import as_plain

if TYPE_CHECKING:
    from umo.generate.compiled_laws import PreparedLaws

MAIN_MODULE = "__umo_main__"
"""The name under which the user's script is imported again in the new process."""


@dataclass
class Job:
    """A run as plain data, so that another process can carry it out."""

    station: str | None = None
    machine: str | None = None
    """The function that declares the machine, as `module:function`, if there is no station."""
    application: str | None = None
    wiring: str | dict[str, Any] | None = None
    options: dict[str, Any] = field(default_factory=dict)
    acknowledge: bool = False
    manual: bool = False
    """True if the run starts in manual mode: the application waits until the mode is automatic."""
    fresh: bool = False
    """True if the run starts without the kept values of the last run."""
    traceback: bool = False
    """True if the traceback of an error that puts equipment into fault is printed."""
    until: float | None = None
    """Time in s on the machine's clock at which the run is stopped."""
    path: list[str] = field(default_factory=lambda: list(sys.path))
    script: str | None = None
    """The file of `__main__`, if the machine or the application is a function in it."""

    @property
    def name(self) -> str:
        """The name of the run in lists of processes."""
        return self.station or str(self.machine)

    def dump(self) -> bytes:
        try:
            return json.dumps(vars(self), default=as_plain).encode()
        except TypeError as error:
            raise DeclarationError(
                f"options and wiring must be plain data (JSON) for another process: {error}"
            ) from None

    @classmethod
    def load(cls, data: bytes) -> Job:
        return cls(**json.loads(data))


def reference(function: Callable[..., Any]) -> tuple[str, str | None]:
    """Return a function as `module:name`, and the script that contains it. Raises DeclarationError if it cannot be
    imported."""
    name, module = getattr(function, "__qualname__", ""), getattr(function, "__module__", None)
    if not name.isidentifier() or module is None:
        raise DeclarationError(f"{function!r} is not a function of a module: the control process cannot import it")
    if module != "__main__":
        return f"{module}:{name}", None
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script is None or not Path(script).is_file():
        raise DeclarationError(
            f"{name} was defined interactively: the control process cannot import it; "
            "put machine and application into a module or a station (`umo new station DIR`)"
        )
    return f"{MAIN_MODULE}:{name}", str(Path(script).resolve())


class Plan:
    """A job with everything that it needs: the declared machine, its resolved wiring, and the options for each part."""

    def __init__(self, job: Job) -> None:
        self.job = job
        station = None if job.station is None else find(job.station)
        make, main = (station.make, station.main) if station else functions_of(job)
        self.wiring: Path | Mapping[str, Any] | None
        if station is not None and (job.wiring is None or isinstance(job.wiring, str)):
            self.wiring = station.wiring(job.wiring)
        else:
            self.wiring = Path(job.wiring) if isinstance(job.wiring, str) else job.wiring
        self.shares = shares = distribute_options(job.options, machine=make, application=main, wiring=self.wiring)
        """The options for each part of the run."""
        self.application: Application[Any] | None = None if main is None else partial(main, **shares.application)
        self.machine_options = {name: value for name, value in job.options.items() if name in shares.machine}
        if station is not None:
            self.machine, self.name, self.place = station.machine(**shares.machine), station.name, station.path
        else:
            self.machine = declared(make, str(job.machine), shares.machine)
            self.name, self.place = type(self.machine).__name__, Path(job.script or inspect.getfile(make))
        actions_of(self.machine), numbers_of(self.machine)  # DeclarationError
        self.wired: Wired = resolve(self.machine, self.wiring, shares.wiring)
        self.sources = self._sources()
        """The hashes of the files that were read for the run (`source_files`), computed immediately after reading."""
        self.prepared: PreparedLaws | None = None
        """The machine's laws, if they are compiled (`umo.process.compiling`)."""

    def _sources(self) -> dict[str, str]:
        return source_files(self.place, self.wiring, self.machine)

    def all_sources(self) -> dict[str, str]:
        """Return the hashes of all sources, including modules that were imported later, for example by `setup`."""
        return self._sources() | self.sources

    @property
    def wiring_name(self) -> str:
        return self.wiring.stem if isinstance(self.wiring, Path) else ""

    @property
    def launch(self) -> str:
        """A digest that is the same for each start with the same station, wiring and options, such as a start by a
        supervisor."""
        wiring = str(self.wiring.resolve()) if isinstance(self.wiring, Path) else self.wiring
        what = [str(self.place), self.job.machine, wiring, self.job.options]
        return hashlib.sha256(json.dumps(what, sort_keys=True, default=as_plain).encode()).hexdigest()[:24]


def functions_of(job: Job) -> tuple[Callable[..., Any], Callable[..., Any] | None]:
    if job.machine is None:
        raise DeclarationError("a job needs a station, or a function that returns the machine")
    make = _import(job.machine, job.script)
    return make, None if job.application is None else _import(job.application, job.script)


def _import(text: str, script: str | None) -> Any:
    name, _, attribute = text.partition(":")
    with raise_as(DeclarationError, f"{text} cannot be imported"):
        if name == MAIN_MODULE and getattr(sys.modules.get(MAIN_MODULE), "__file__", None) != script:
            import runpy

            module = ModuleType(MAIN_MODULE)
            sys.modules[MAIN_MODULE] = module
            module.__dict__.update(runpy.run_path(str(script), run_name=MAIN_MODULE))
        found = getattr(importlib.import_module(name), attribute)
    if not callable(found):
        raise DeclarationError(f"{text} is not a function")
    return found
