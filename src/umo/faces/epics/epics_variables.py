"""The process variables of a machine: names, types, and what a put or a call means."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from math import floor, isfinite, isnan, log10, nan
from typing import Any

from p4p import Value

from umo.errors import CommandRefused
from umo.faces.epics.process_variable import CarryOut, ProcessVariable, choice, pvi, scalar, undefined
from umo.faces.face import Changes, Commands
from umo.faces.face_declaration import Declaration, FaceItem, ItemKind
from umo.objects import Quality
from umo.presentation.digits import digits_of

SUFFIXES = {ItemKind.EQUIPMENT: "equipment", ItemKind.AXIS: "axis", ItemKind.ALARM: "alarm"}
"""Last part of the names of states: an object may have the path before it."""
SEVERITIES = {Quality.GOOD: 0, Quality.OUT_OF_RANGE: 2, Quality.UNREFERENCED: 1, Quality.STALE: 1, Quality.BAD: 3}
MINOR, MAJOR = 1, 2
QUIET = ("normal", "shelved", "out of service")
"""States of an alarm that raise no severity."""
DEVICE, RECORD = 1, 3
"""Status: what the device gave; what a state means."""
RESERVED = frozenset((
    "check_value", "children", "clear_sub", "collect", "collect_asset_docs", "collect_pages", "complete", "connect",
    "describe", "describe_collect", "describe_configuration", "get_index", "hints", "kickoff", "locate", "log", "name",
    "parent", "pause", "prepare", "read", "read_configuration", "resume", "set", "set_name", "stage", "stop",
    "subscribe", "trigger", "unstage",
))  # fmt: skip
"""Names that bluesky's devices have for themselves: an entry of the tree gets a `_`."""
NO_NAME = re.compile(r"[^A-Za-z0-9_.]")
"""What neither a field of pvData nor a name of EPICS may have: alarms may, as "no parts"."""
PRECISION = 3
"""Digits after the point where neither a resolution nor a range tells them."""
Ask = Callable[..., Any]
Show = Callable[[float, Mapping[str, Any]], None]
"""Shows a value, with the fields of its alarm and time."""


class EpicsVariables:
    """`prefix` stands before each path; a point becomes a colon: `ztheta:z:encoder`. `commands`: of the run."""

    def __init__(self, machine: Declaration, prefix: str, commands: Commands) -> None:
        self.by_name: dict[str, ProcessVariable] = {}
        self.machine, self.prefix, self.ask = machine, prefix, commands.ask
        self._shows: dict[int, list[Show]] = {item.number: [] for item in machine.items}
        self._tree: dict[str, dict[str, dict[str, str]]] = {"": {}}
        """Entries of each device, by its path."""
        self._leaves: set[str] = set()
        """Paths of entries that are no devices."""

    # Building ------------------------------------------------------------------------------------------

    def add(self, path: str, access: str, variable: ProcessVariable) -> None:
        """A variable that stands in the tree. What no name may have becomes a `_`; a name that another has gets one."""
        path = NO_NAME.sub("_", path)
        while self.prefix + path.replace(".", ":") in self.by_name:
            path += "_"
        name = self.prefix + path.replace(".", ":")
        self.by_name[name] = variable
        self.enter(path, {access: name})

    def enter(self, path: str, entry: dict[str, str]) -> None:
        """An entry of the tree, and the devices above it. What stands there stays."""
        device, _, last = path.rpartition(".")
        if device in self._leaves:  # an alarm of an object
            device, last = device.rpartition(".")[0], f"{device.rpartition('.')[2]}_{last}"
        elif "d" not in entry:
            self._leaves.add(path)
        if device not in self._tree:
            self._tree[device] = {}
            self.enter(device, {"d": f"{self.prefix}{device.replace('.', ':')}:PVI"})
        named = f"{last}_" if last in RESERVED else last
        self._tree[device].setdefault(f"__{last}" if last.isdigit() else named, entry)

    def follow(self, item: FaceItem, show: Show) -> None:
        """Call it with each new value of an item."""
        self._shows[item.number].append(show)

    def add_item(self, item: FaceItem) -> None:
        if item.kind is ItemKind.SIGNAL and f"tunable:{item.path}" in self.machine.by_name:
            return  # the same number
        path = ".".join(filter(None, (item.path, SUFFIXES.get(item.kind))))
        path = f"run.{path}" if item.kind is ItemKind.RUN else path
        write = self._write_of(item)
        value = undefined(choice(0, list(item.states.values()), _about(item)) if item.states else _number(item))
        variable = ProcessVariable(value, write, kept_up=item.kind is ItemKind.ACTUATOR)
        self.follow(item, _state_shown(variable, item) if item.states else number_shown(variable))
        self.add(path, "r" if write is None else "rw", variable)
        if item.kind is ItemKind.EQUIPMENT:
            self.add_button(
                f"{item.path}.clear".lstrip("."), "clear its fault", partial(self.ask, do="clear", path=item.path)
            )
        elif item.kind is ItemKind.ALARM:
            acknowledge = partial(self.ask, do="acknowledge alarm", path=item.path)
            self.add_button(f"{item.path}.acknowledge", "acknowledge it", acknowledge)

    def _write_of(self, item: FaceItem) -> CarryOut | None:
        if item.kind is ItemKind.TUNABLE:
            do, whole = "tune", isinstance(item.about.get("start"), int)
            return lambda user, given: self.ask(user, do, item.path, value=number_in(given, whole=whole))
        if item.kind is ItemKind.ACTUATOR:
            read = partial(_name_in, item) if item.states else number_in
            return lambda user, given: self.ask(user, "write", item.path, value=read(given))
        if (item.kind, item.path) == (ItemKind.RUN, "mode"):
            return lambda user, given: self.ask(user, "mode", value=_name_in(item, given))
        return None

    def add_action(self, about: Mapping[str, Any]) -> None:
        """A put of anything calls it without arguments, an RPC with those of its query."""
        path = str(about["path"])
        arguments = {str(each["name"]): each for each in about["arguments"]}

        def call(user: Any, given: Value) -> Any:
            query = given["query"] if given.has("query") else {} if given.has("scheme") else given
            if not isinstance(query, Value | Mapping):
                raise CommandRefused(f"{path}: the query is no structure of arguments")
            named = {name: _argument(arguments.get(name), value) for name, value in query.items()}
            return self.ask(user, "call", path, arguments=named)

        def write(user: Any, given: Value) -> Any:
            return self.ask(user, "call", path, arguments={})

        value = scalar(0, "i", description=str(about["help"]))
        self.add(path, "x", ProcessVariable(value, write, call, kept_up=bool(about["dead_man"])))

    def add_button(self, path: str, about: str, command: Callable[[Any], Any]) -> None:
        """A put of anything gives the command."""

        def press(user: Any, given: Value) -> Any:
            return command(user)

        self.add(path, "x", ProcessVariable(scalar(0, "i", description=about), press, press))

    def add_tree(self) -> None:
        for device, entries in self._tree.items():
            self.by_name[f"{self.prefix}{device.replace('.', ':') + ':' if device else ''}PVI"] = ProcessVariable(
                pvi(entries)
            )

    # Showing -------------------------------------------------------------------------------------------

    def show(self, changes: Changes) -> None:
        for place in changes.places:
            if shows := self._shows[place]:
                value, marks = float(changes.values[place]), _marks(changes, place)
                for each in shows:
                    each(value, marks)

    def end(self, why: str) -> None:
        """Nothing has a value any longer."""
        for variable in self.by_name.values():
            variable.show({"alarm.severity": 3, "alarm.status": 6, "alarm.message": why})


def variables_of(machine: Declaration, prefix: str, commands: Commands) -> EpicsVariables:
    """All that a machine has, without its axes."""
    variables = EpicsVariables(machine, prefix, commands)
    for item in machine.items:
        variables.add_item(item)
    for action in machine.actions:
        variables.add_action(action)
    variables.add_button(
        "run.stop", "end the run: every actuator goes to its default", partial(variables.ask, do="stop")
    )
    return variables


def _marks(changes: Changes, place: int) -> dict[str, Any]:
    quality, moment = changes.quality_of(place), float(changes.times[place])
    seconds = 0.0 if isnan(moment) else moment
    return {
        "alarm.severity": SEVERITIES[quality],
        "alarm.status": DEVICE if SEVERITIES[quality] else 0,
        "alarm.message": str(quality) if SEVERITIES[quality] else "",
        "timeStamp.secondsPastEpoch": int(seconds),
        "timeStamp.nanoseconds": int(seconds % 1.0 * 1e9),
        "timeStamp.userTag": changes.period & 0x7FFFFFFF,
    }


def number_shown(variable: ProcessVariable) -> Show:
    return lambda value, marks: variable.show({"value": value, **marks})


def _state_shown(variable: ProcessVariable, item: FaceItem) -> Show:
    places = {number: place for place, number in enumerate(item.states)}

    def show(value: float, marks: Mapping[str, Any]) -> None:
        fields = dict(marks)
        if not isnan(value) and int(value) in places:
            fields["value.index"] = places[int(value)]
            severity = _severity(item, item.states[int(value)])
            if severity > fields["alarm.severity"]:
                fields |= {"alarm.severity": severity, "alarm.status": RECORD}
                fields["alarm.message"] = str(item.about.get("text", item.states[int(value)]))
        variable.show(fields)

    return show


def _severity(item: FaceItem, state: str) -> int:
    """Of what a state means: an alarm by its priority, a fault."""
    if item.kind is ItemKind.ALARM and state not in QUIET:
        return MINOR if item.about.get("priority") in ("low", "medium") else MAJOR
    return MAJOR if item.kind is ItemKind.EQUIPMENT and state == "fault" else 0


def _about(item: FaceItem) -> str:
    return str(item.about.get("text") or f"{item.kind.value} {item.path}".strip())


def _number(item: FaceItem) -> Value:
    limits: dict[str, float] = {}
    if item.minimum is not None and item.maximum is not None:
        limits = {"limitLow": float(item.minimum), "limitHigh": float(item.maximum)}
    about: dict[str, Any] = {"units": item.unit, "description": _about(item), "precision": precision_of(item)}
    value = scalar(nan, "d", **about, **limits)
    value["control"] = {**limits, "minStep": abs(float(item.about.get("resolution") or 0.0))}
    return value


def precision_of(item: FaceItem) -> int:
    """Digits after the point: of the resolution, else six of the greatest value."""
    if resolution := item.about.get("resolution"):
        return digits_of(float(resolution), float(item.about.get("zero_offset", 0.0)))
    ends = [abs(end) for end in (item.minimum, item.maximum) if end is not None and isfinite(end)]
    greatest = max(ends, default=0.0)
    return min(max(5 - floor(log10(greatest)), 0), 15) if greatest else PRECISION


def number_in(given: Value, *, whole: bool = False) -> float:
    """The number that was put; CommandRefused if there is none."""
    if not given.changed("value"):
        raise CommandRefused("no value was put")
    number = float(given["value"])
    return int(number) if whole and number.is_integer() else number


def _name_in(item: FaceItem, given: Value) -> str:
    """The name of the state that was put."""
    names = list(item.states.values())
    index = int(given["value.index"]) if given.changed("value") or given.changed("value.index") else -1
    if not 0 <= index < len(names):
        raise CommandRefused(
            f"{item.path}: {index} is none of {', '.join(f'{n} {each}' for n, each in enumerate(names))}"
        )
    return names[index]


def _argument(about: Mapping[str, Any] | None, value: Any) -> Any:
    """Clients in a shell send every argument as a text."""
    if isinstance(value, str) and about is not None and about["kind"] not in ("text", "choice"):
        try:
            return json.loads(value)
        except ValueError:
            return value
    return value
