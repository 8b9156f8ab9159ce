"""The process variables of a machine: their names and types, and the effect of a put or a call."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from math import isnan, nan
from typing import Any

from p4p import Value

from umo.clients.faces.command_users import PATH, arguments_of
from umo.clients.faces.epics.process_variable import INVALID, CarryOut, ProcessVariable, choice, pvi, scalar, undefined
from umo.clients.faces.face import Changes, Commands
from umo.errors import CommandRefused
from umo.objects import Quality
from umo.objects.presentation.identity import NO_NAME, coded, escaped, is_word
from umo.operation.commands.verb import ArgumentKind, Names, Verb, VerbArgument
from umo.operation.commands.verbs import CALL, naming, offered
from umo.process.frames.machine_items import QUIET, Declaration, ItemKind, MachineItem

SUFFIXES = {ItemKind.EQUIPMENT: "equipment", ItemKind.AXIS: "axis", ItemKind.ALARM: "alarm"}
"""Last parts of the names of states. They are needed because an object can have the same path as the equipment, axis or
alarm."""
SEVERITIES = {Quality.GOOD: 0, Quality.OUT_OF_RANGE: 2, Quality.UNREFERENCED: 1, Quality.STALE: 1, Quality.BAD: 3}
MINOR, MAJOR = 1, 2
DEVICE, RECORD = 1, 3
"""Sources of an alarm status: the device, and the meaning of a state."""
RESERVED = frozenset((
    "check_value", "children", "clear_sub", "collect", "collect_asset_docs", "collect_pages", "complete", "connect",
    "describe", "describe_collect", "describe_configuration", "get_index", "hints", "kickoff", "locate", "log", "name",
    "parent", "pause", "prepare", "read", "read_configuration", "resume", "set", "set_name", "stage", "stop",
    "subscribe", "trigger", "unstage",
))  # fmt: skip
"""Names that bluesky's devices reserve. A `_` is appended to an entry of the tree that has such a name."""
TEXTS = ("text", ArgumentKind.CHOICE.value, ArgumentKind.OF_ACTION.value)
"""Kinds of arguments that are passed as strings."""
RUN = "run"
"""First part of the names of variables of the run."""
AXIS_ENTRIES = ("target", "stop")
"""Entries of an axis in the tree that are not parts of the axis."""
PRECISION = 3
"""Number of digits after the decimal point for a number whose resolution and range do not determine it."""
JOINED = coded(".")
"""The string between the entry of an object and the entry of an alarm below it, where the object is not a device. It
occurs in no part of a name."""
IN_LIST = "__"
"""The string before the number of an entry in a list."""
TREE = "PVI"
"""Last part of the name of a device's tree."""
OF_ITEMS = {ItemKind.EQUIPMENT: Names.EQUIPMENT, ItemKind.ALARM: Names.ALARM}
"""Kinds of items that verbs name. Each of these items has a variable for each of those verbs."""
NameParts = tuple[str, ...]
"""The parts of a name without its prefix. They consist of ASCII letters, digits and `_`."""
Ask = Callable[..., Any]
Show = Callable[[float, Mapping[str, Any]], None]
"""Function that shows a value, with the fields of its alarm and time."""


class EpicsVariables:
    """The variables of a machine. `prefix` stands before each path, and a point becomes a colon: `ztheta:z:encoder`.
    Letters outside ASCII and punctuation are escaped (`umo.objects.presentation.identity`). `commands` are the commands
    of the run."""

    def __init__(self, machine: Declaration, prefix: str, commands: Commands) -> None:
        self.by_name: dict[str, ProcessVariable] = {}
        self.machine, self.prefix, self.ask = machine, prefix, commands.ask
        self._shows: dict[int, list[Show]] = {item.number: [] for item in machine.items}
        self._tree: dict[NameParts, dict[str, dict[str, str]]] = {(): {}}
        """Entries of each device, by the parts of its name."""
        within = [item.path for item in machine.items if item.kind not in (*SUFFIXES, ItemKind.RUN)]
        self._leaves = {parts_of(path) for path in (*within, *(str(each["path"]) for each in machine.actions))}
        """Names that are not devices of the tree, though alarms may be below them."""
        self._axes = {parts_of(str(each["path"])) for each in machine.axes}

    # Building ------------------------------------------------------------------------------------------

    def add(self, parts: NameParts, access: str, variable: ProcessVariable) -> None:
        """Add a variable of the tree."""
        name = self.name_of(parts)
        self.by_name[name] = variable
        *device, last = parts
        is_taken = tuple(device) in self._axes and last in AXIS_ENTRIES
        self.enter((*device, escaped(last, is_word, AXIS_ENTRIES) if is_taken else last), {access: name})

    def name_of(self, parts: NameParts) -> str:
        return self.prefix + ":".join(parts)

    def enter(self, parts: NameParts, entry: dict[str, str]) -> None:
        """Add an entry to the tree, with the devices above it."""
        device, name = parts[:-1], entry_of(parts[-1])
        if device in self._leaves:  # an alarm of an object
            device, name = device[:-1], f"{entry_of(device[-1])}{JOINED}{name}"
        if device not in self._tree:
            self._tree[device] = {}
            self.enter(device, {"d": self.name_of((*device, TREE))})
        self._tree[device][name] = entry

    def follow(self, item: MachineItem, show: Show) -> None:
        """Call a function with each new value of an item."""
        self._shows[item.number].append(show)

    def add_item(self, item: MachineItem) -> None:
        if item.kind is ItemKind.SIGNAL and f"tunable:{item.path}" in self.machine.by_name:
            return  # the same number
        parts = (RUN, item.path) if item.kind is ItemKind.RUN else parts_of(item.path, SUFFIXES.get(item.kind, ""))
        write = self._write_of(item)
        value = undefined(choice(0, list(item.states.values()), _about(item)) if item.states else _number(item))
        variable = ProcessVariable(value, write, kept_up=item.kind is ItemKind.ACTUATOR)
        self.follow(item, _state_shown(variable, item) if item.states else number_shown(variable))
        self.add(parts, "r" if write is None else "rw", variable)
        for verb in naming(OF_ITEMS[item.kind]) if item.kind in OF_ITEMS else ():
            self.add_verb(parts_of(item.path, verb.word), verb, item.path)

    def _write_of(self, item: MachineItem) -> CarryOut | None:
        if (verb := item.verb) is None:
            return None
        path = "" if verb.names is Names.NOTHING else item.path
        whole = isinstance(item.about.get("start"), int)
        read = partial(_name_in, item) if item.states else partial(number_in, whole=whole)
        return lambda user, given: self.ask(user, verb.name, path, value=read(given))

    def add_action(self, about: Mapping[str, Any]) -> None:
        """Add a variable for an action. A put of any value calls the action without arguments; an RPC calls it with the
        arguments of its query."""
        path = str(about["path"])
        arguments = {str(each["name"]): each for each in about["arguments"]}

        def call(user: Any, given: Value) -> Any:
            named = {name: _argument(arguments.get(name), value) for name, value in _query(path, given).items()}
            return self.ask(user, CALL.name, path, arguments=named)

        def write(user: Any, given: Value) -> Any:
            return self.ask(user, CALL.name, path, arguments={})

        value = scalar(0, "i", description=str(about["help"]))
        self.add(parts_of(path), "x", ProcessVariable(value, write, call, kept_up=bool(about["dead_man"])))

    def add_verb(self, parts: NameParts, verb: Verb, path: str | None) -> None:
        """Add a variable for a verb. A put or an RPC carries out the verb. The value that is put is arbitrary if the
        verb has no argument; otherwise it is the number or string of the only argument. An RPC passes the arguments by
        name. If `path` is None, the path is an argument too. The value put for a verb without other arguments is then
        the path."""
        about = {each.name: each.plain() for each in verb.arguments}
        single = verb.arguments[0] if len(verb.arguments) == 1 and path is not None else None

        def call(user: Any, given: Value) -> Any:
            named = {name: _argument(about.get(name), value) for name, value in _query(verb.name, given).items()}
            place = str(named.pop(PATH, "")) if path is None else path
            if verb.of_action:
                named = arguments_of(named.get(verb.arguments[0].name, ""))
            return self.ask(user, verb.name, place, **verb.fields(named))

        def write(user: Any, given: Value) -> Any:
            if path is None and verb.is_plain:
                return self.ask(user, verb.name, str(given["value"]))
            more = {} if single is None else verb.fields({single.name: _put(single, given)})
            return self.ask(user, verb.name, path or "", **more)

        numbers = (ArgumentKind.NUMBER, ArgumentKind.TIME)
        if single is not None:
            value = scalar(0.0, "d", units=single.unit) if single.kind in numbers else scalar("", "s")
        else:
            value = scalar("", "s") if path is None else scalar(0, "i")
        value["display.description"] = verb.help
        self.add(parts, "x", ProcessVariable(value, write, call, kept_up=verb.is_kept_up))

    def add_tree(self) -> None:
        for device, entries in self._tree.items():
            self.by_name[self.name_of((*device, TREE))] = ProcessVariable(pvi(entries))

    # Showing -------------------------------------------------------------------------------------------

    def show(self, changes: Changes) -> None:
        for place in changes.places:
            if shows := self._shows[place]:
                value, marks = float(changes.values[place]), _marks(changes, place)
                for each in shows:
                    each(value, marks)

    def end(self, why: str) -> None:
        """Mark all values as no longer available."""
        for variable in self.by_name.values():
            variable.show({"alarm.severity": 3, "alarm.status": 6, "alarm.message": why})


def variables_of(machine: Declaration, prefix: str, commands: Commands) -> EpicsVariables:
    """Return all variables of a machine, except those of its axes."""
    variables = EpicsVariables(machine, prefix, commands)
    for item in machine.items:
        variables.add_item(item)
    for action in machine.actions:
        variables.add_action(action)
    for verb in offered():
        if variables.name_of((RUN, verb.word)) not in variables.by_name:  # the mode has a variable of its own
            variables.add_verb((RUN, verb.word), verb, "" if verb.names is Names.NOTHING else None)
    return variables


def own_parts() -> frozenset[str]:
    """Return the last parts of names that umo uses itself. A part of a path with such a name is escaped."""
    return frozenset((*SUFFIXES.values(), TREE, *(verb.word for verb in naming(*OF_ITEMS.values()))))


def parts_of(path: str, own: str = "") -> NameParts:
    """Return the parts of the name for an object with this path. `own` is one of `own_parts` and becomes the last part.
    A part of the path is escaped if it is one of `own_parts`, or if it is the first and equals `RUN`."""
    first, *others = (escaped(each or NO_NAME, is_word, own_parts()) for each in path.split("."))
    parts = (escaped(first, is_word, (RUN,)), *others) if path else ()
    return (*parts, own) if own else parts


def entry_of(part: str) -> str:
    """Return a part of a name as an entry of the tree. An entry is a field of pvData, so it must not begin with a
    digit. It must not be one of `RESERVED` either."""
    if part.isdigit():
        return f"{IN_LIST}{part}"
    if part[0].isdigit() or part.removeprefix(IN_LIST).isdigit():
        return f"{coded(part[0])}{part[1:]}"
    return f"{part}_" if part.rstrip("_") in RESERVED else part


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


def _state_shown(variable: ProcessVariable, item: MachineItem) -> Show:
    places = {number: place for place, number in enumerate(item.states)}

    def show(value: float, marks: Mapping[str, Any]) -> None:
        fields = dict(marks)
        if (state := item.state_of(value)) is not None:
            fields["value.index"] = places[int(value)]
            severity, text = _severity(item, state), str(item.about.get("text", state))
        else:  # the index is the last one
            severity, text = INVALID, f"{value:g} is not one of its states"
        if severity > fields["alarm.severity"]:
            fields |= {"alarm.severity": severity, "alarm.status": RECORD, "alarm.message": text}
        variable.show(fields)

    return show


def _severity(item: MachineItem, state: str) -> int:
    """Return the severity of a state: of an alarm by its priority, or of a fault."""
    if item.kind is ItemKind.ALARM and state not in QUIET:
        return MINOR if item.about.get("priority") in ("low", "medium") else MAJOR
    return MAJOR if item.kind is ItemKind.EQUIPMENT and state == "fault" else 0


def _about(item: MachineItem) -> str:
    return str(item.about.get("text") or f"{item.kind.value} {item.path}".strip())


def _number(item: MachineItem) -> Value:
    limits: dict[str, float] = {}
    if item.minimum is not None and item.maximum is not None:
        limits = {"limitLow": float(item.minimum), "limitHigh": float(item.maximum)}
    about: dict[str, Any] = {"units": item.unit, "description": _about(item), "precision": precision_of(item)}
    value = scalar(nan, "d", **about, **limits)
    value["control"] = {**limits, "minStep": item.resolution}
    return value


def precision_of(item: MachineItem) -> int:
    """Return the number of digits after the decimal point."""
    return PRECISION if item.digits is None else item.digits


def number_in(given: Value, *, whole: bool = False) -> float:
    """Return the number that was put. Raises CommandRefused if it is not a number."""
    if not given.changed("value"):
        raise CommandRefused("the put contains no value")
    number = float(given["value"])
    return int(number) if whole and number.is_integer() else number


def _name_in(item: MachineItem, given: Value) -> str:
    """Return the name of the state that was put."""
    names = list(item.states.values())
    index = int(given["value.index"]) if given.changed("value") or given.changed("value.index") else -1
    if not 0 <= index < len(names):
        raise CommandRefused(
            f"{item.path}: {index} is not one of {', '.join(f'{n} {each}' for n, each in enumerate(names))}"
        )
    return names[index]


def _put(argument: VerbArgument, given: Value) -> Any:
    """Return the value of the only argument of a verb."""
    return number_in(given) if argument.kind in (ArgumentKind.NUMBER, ArgumentKind.TIME) else given["value"]


def _query(what: str, given: Any) -> Any:
    """Return the arguments of an RPC by name. Raises CommandRefused if its query is not a structure."""
    query = given["query"] if given.has("query") else {} if given.has("scheme") else given
    if not isinstance(query, Value | Mapping):
        raise CommandRefused(f"{what}: the query is not a structure with arguments")
    return query


def _argument(about: Mapping[str, Any] | None, value: Any) -> Any:
    """Return an argument of an RPC in its declared type. Clients in a shell send every argument as text."""
    if isinstance(value, str) and about is not None and about["kind"] not in TEXTS:
        try:
            return json.loads(value)
        except ValueError:
            return value
    return value
