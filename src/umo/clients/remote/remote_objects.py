"""The objects, compounds, actions and tunable numbers of a running station as Python attributes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from inspect import Parameter, Signature
from math import isnan
from typing import Any

from umo.clients.remote.commander import Commander
from umo.errors import BadInput, PathError, RangeError
from umo.objects import Quality
from umo.objects.claims import Claim
from umo.objects.presentation.described import Described
from umo.objects.presentation.html_table import never_raises
from umo.objects.presentation.value_text import quality_text
from umo.objects.units import convert
from umo.operation.commands.verbs import CALL, LET_GO, TUNE, WRITE
from umo.process.frames import RunReader
from umo.text import did_you_mean


class Tree:
    """The items in a station's description, by path."""

    def __init__(self, reader: RunReader) -> None:
        layout = reader.layout
        self.objects = {each.path: each for each in layout.described.objects}
        self.actions = {entry["path"]: entry for entry in layout.actions}
        self.tunables = {each.path: each for each in layout.described.tunables}
        self.signals = {each.path: number for number, each in enumerate(layout.described.signals)}
        self.parts: set[str] = set()
        for path in (*self.objects, *self.actions, *self.tunables, *self.signals):
            names = path.split(".")
            self.parts |= {".".join(names[:count]) for count in range(1, len(names))}

    def below(self, path: str) -> list[str]:
        """Return the names of the members directly below a part."""
        start = f"{path}." if path else ""
        tables = (self.objects, self.actions, self.tunables, self.signals, self.parts)
        found = (each for table in tables for each in table if each.startswith(start))
        names = {each.removeprefix(start).partition(".")[0] for each in found}
        return sorted(names)

    def keys(self, path: str) -> list[str | int]:
        """Return the keys that are possible in the brackets of a part: its names and numbers, and the paths of the
        objects below it."""
        start = f"{path}." if path else ""
        paths = [each.removeprefix(start) for each in self.objects if each.startswith(start)]
        return [int(key) if key.isdigit() else key for key in dict.fromkeys([*self.below(path), *paths])]


class RemotePart:
    """A compound of a running station, or another part, such as a law."""

    def __init__(self, station: Commander, tree: Tree, path: str) -> None:
        self.__dict__.update(_station=station, _tree=tree, _path=path)

    _station: Commander
    _tree: Tree
    _path: str

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, name: str | int) -> Any:
        """Get a member by name, by the key of a list or dict, or by path: `zones[3]`, `station["zones.3.heater"]`."""
        tree, path = self._tree, f"{self._path}.{name}".lstrip(".")
        if path in tree.objects:
            return RemoteObject(self._station, tree.objects[path])
        if path in tree.actions:
            return _caller(self._station, tree.actions[path])
        if path in tree.tunables:
            return self._station.reader.tunables()[path]
        if path in tree.parts:
            return RemotePart(self._station, tree, path)
        if path in tree.signals:
            frame = self._station.reader.latest()
            number = float("nan") if frame is None else float(frame["signals"][tree.signals[path]])
            return self._station.reader.layout.described.signals[tree.signals[path]].value(number)
        raise NoMember(
            f"{self._path or 'the station'} has no {name!r}{did_you_mean(str(name), tree.below(self._path))}"
        )

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value

    def __setitem__(self, name: str | int, value: Any) -> None:
        """Tune a number: as an attribute, or by path, such as `station["zones.3.gain"] = 2.0`."""
        path = f"{self._path}.{name}".lstrip(".")
        if path not in self._tree.tunables:
            what = "is an object: use its write()" if path in self._tree.objects else "is not a tunable number"
            raise NoMember(f"{path} {what}{did_you_mean(path, self._tree.tunables)}")
        self._station.carry_out(TUNE, path, {"value": value})

    def _ipython_key_completions_(self) -> list[str | int]:
        return self._tree.keys(self._path)

    @never_raises
    def _repr_html_(self) -> str:
        return self._station.reader.html([self._path] if self._path else [])

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *(name for name in self._tree.below(self._path) if name.isidentifier())]

    def __repr__(self) -> str:
        return f"<{self._path}: {', '.join(self._tree.below(self._path))}>"


class NoMember(PathError, AttributeError):
    """Raised if a station, or a part of it, has no member with this name."""


class RemoteObject:
    """One object of a running station. Values are those of the last finished period."""

    def __init__(self, station: Commander, about: Described) -> None:
        self._station = station
        self._about = about
        self.path = about.path
        self._number = station.reader.index(self.path)

    def _frame(self) -> Any:
        frame = self._station.reader.latest()
        if frame is None:
            raise PathError(f"{self.path} has not been read yet: no period has ended")
        return frame

    def read(self) -> float | str:
        """Return a number in the unit of the object, or the name of a state. If the object was not read yet, a number
        is NaN, and a state raises BadInput."""
        value = float(self._frame()["values"][self._number])
        if self._about.is_number:
            return value
        if isnan(value):
            raise BadInput(self.path, Quality.BAD, why="it was never read")
        return self._about.state(value)

    def read_in(self, unit: str) -> float:
        """Return the result of `read()` in another unit of the same dimension. Raises DeclarationError for a unit of
        another dimension, RangeError for an object that has states."""
        if not self._about.is_number:
            raise RangeError(f"{self.path} has states, so it has no unit: use read()")
        return convert(float(self.read()), self.units, unit)

    @property
    def raw(self) -> int:
        return int(self._frame()["raws"][self._number])

    @property
    def quality(self) -> Quality:
        return Quality(int(self._frame()["quality"][self._number]))

    @property
    def actuator(self) -> bool:
        """True if the object can be written."""
        return self._about.is_actuator

    @property
    def units(self) -> str:
        """The unit; "" for an object that has states."""
        return self._about.unit

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the object's states; empty for a number."""
        return tuple(self._about.states.values())

    @property
    def inhibited(self) -> str | None:
        """The reason why only the default is sent to this actuator, or the client that has taken the actuator, or None
        if it is free."""
        return self._station.reader.inhibited(self._frame(), self._number)

    @property
    def claim(self) -> Claim:
        """The claim: who drives this actuator, and who drives it next."""
        return self._station.reader.claim(self._frame(), self._number)

    def write(self, value: Any) -> None:
        """Take the actuator and write a number in its unit, or the name of a state. Needs the lease and manual mode.
        The hold lasts until `release`, or until the lease ends."""
        text = getattr(value, "name", value)  # a state of the declaration
        self._station.carry_out(WRITE, self.path, {"value": text})

    def release(self) -> None:
        """Release the actuator. Its default is sent, and the program may write it again."""
        self._station.carry_out(LET_GO, self.path)

    @never_raises
    def _repr_html_(self) -> str:
        return self._station.reader.html([self.path])

    def __repr__(self) -> str:
        frame = self._frame()
        value, quality = frame["values"][self._number], frame["quality"][self._number]
        return f"<{self._about.kind} {self.path} = {self._about.text(value)} {quality_text(quality)}>"


def _caller(station: Commander, action: dict[str, Any]) -> Callable[..., Any]:
    """Return a function that calls an action and waits for its end. For a dead-man action, the function has the
    attribute `release`: `station.z.jog.release()`."""
    arguments = action["arguments"]
    path = action["path"]
    signature = Signature([_parameter(each) for each in arguments])

    def call(*values: Any, **named: Any) -> Any:
        try:
            given = signature.bind(*values, **named).arguments
        except TypeError as error:
            raise RangeError(f"{path}: {error}") from None
        given = {name: getattr(value, "name", value) for name, value in given.items()}
        return station.carry_out(CALL, path, given)

    call.__name__ = call.__qualname__ = path.rpartition(".")[2]
    call.__doc__ = action["help"]
    call.__signature__ = signature  # type: ignore[attr-defined]
    if action["dead_man"]:
        call.release = partial(station.carry_out, LET_GO, path)  # type: ignore[attr-defined]
    return call


def _parameter(argument: dict[str, Any]) -> Parameter:
    default = Parameter.empty if argument["required"] else argument.get("default")
    return Parameter(argument["name"], Parameter.POSITIONAL_OR_KEYWORD, default=default)
