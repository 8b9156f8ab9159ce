"""The form of a verb: a command to a running machine, with its arguments and the required role. The table of all verbs
is in `umo.operation.commands.verbs`. Every client, every face, the roles and the reference page use the table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import Any

from umo.duration import seconds
from umo.errors import DeclarationError, RangeError
from umo.operation.alarms.alarm_states import Operation
from umo.operation.commands.client_commands import ClientCommand
from umo.operation.commands.commanded import Commanded, VerbAnswer
from umo.text import NamedNumber, cut_repr


class Role(NamedNumber):
    """The rights of a user. Each role includes the roles before it."""

    SEE = 0
    TUNE = 1
    OPERATE = 2
    MAINTAIN = 3


class Names(Enum):
    """The kind of object that the path of a verb names."""

    NOTHING = "nothing"
    """The verb has no path: it concerns the run."""
    PART = "an object or a compound; empty: the whole machine"
    EQUIPMENT = "an object or a compound, for the equipment in it and around it; empty: all equipment"
    ACTUATOR = "an actuator"
    TUNABLE = "a tunable number"
    ACTION = "an action"
    HELD = "an actuator that a client has written, or an action that it holds"
    ALARM = "an alarm, an object or a compound for the alarms in it, or a pattern; empty: all alarms"


class ArgumentKind(Enum):
    """The kind of an argument."""

    NUMBER = "number"
    TIME = "time"
    """A number in s, or a string with a unit such as "10 min"."""
    CHOICE = "choice"
    FLAG = "bool"
    VALUE = "value"
    """A number in the unit of the object that the path names, or the name of one of the object's states. The object
    checks the value."""
    OF_ACTION = "arguments"
    """The arguments of the action that the path names, by name. The action checks them."""


TAKES = {
    ArgumentKind.NUMBER: "a number",
    ArgumentKind.TIME: "a time",
    ArgumentKind.FLAG: "true or false",
    ArgumentKind.VALUE: "a number in its unit, or the name of a state",
    ArgumentKind.OF_ACTION: "the arguments of the action",
}
"""The text for the values that an argument of each kind accepts; an argument with choices lists them."""
EXAMPLES = {ArgumentKind.TIME: ', such as "10 min"'}
"""The examples in the message for an argument that is missing."""
OWN_FIELDS = ("seconds", "over")
"""The arguments of the lease, which have separate fields in a command."""


@dataclass(frozen=True)
class VerbArgument:
    """One argument of a verb. `minimum`, `maximum`: bounds of a number or a time, in `unit`."""

    name: str
    kind: ArgumentKind
    help: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    required: bool = True

    def checked(self, value: Any) -> Any:
        """Return the value in the form that the verb takes, such as a time in s. Raises RangeError for a value that the
        declaration does not permit."""
        if self.kind is ArgumentKind.CHOICE:
            if value not in self.choices:
                raise RangeError(f"there is no {self.name} {value!r}; there are: {', '.join(self.choices)}")
            return value
        if self.kind is ArgumentKind.FLAG:
            if not isinstance(value, bool):
                raise RangeError(f"{self.name} must be {self.range}, not {cut_repr(value)}")
            return value
        return self._number(value) if self.kind in (ArgumentKind.NUMBER, ArgumentKind.TIME) else value

    def _number(self, value: Any) -> float:
        try:
            if isinstance(value, bool):
                raise TypeError
            number = seconds(value) if self.kind is ArgumentKind.TIME else float(value + 0)
        except (TypeError, ValueError, OverflowError, DeclarationError):
            raise RangeError(f"{self.name} must be {self.range}, not {cut_repr(value)}") from None
        low, high = self.minimum, self.maximum
        if not isfinite(number) or (low is not None and number < low) or (high is not None and number > high):
            raise RangeError(f"{self.name} must be {self.range}, not {cut_repr(value)}")
        return number

    @property
    def range(self) -> str:
        """The accepted values as a text: "a time from 1 to 604800 s"."""
        if self.choices:
            return " or ".join(self.choices)
        bounds = [f"{word} {end:g}" for word, end in (("from", self.minimum), ("to", self.maximum)) if end is not None]
        return " ".join([TAKES[self.kind], *bounds, *([self.unit] if self.unit and bounds else [])])

    def plain(self) -> dict[str, Any]:
        """Return the argument as plain data, in the form of the arguments of actions."""
        told: dict[str, Any] = {"name": self.name, "kind": self.kind.value, "help": self.help}
        told |= {"required": self.required, "range": self.range}
        more = {"unit": self.unit, "minimum": self.minimum, "maximum": self.maximum, "choices": list(self.choices)}
        return told | {name: value for name, value in more.items() if value not in ("", None, [])}


Work = Callable[[Commanded, ClientCommand, Mapping[str, Any]], VerbAnswer]
"""The function that carries out a command with its checked arguments and returns the answer. If it raises an error of
umo, the command is refused."""


@dataclass(frozen=True, eq=False)
class Verb:
    """One command that a running machine accepts."""

    name: str
    """The `do` of a command: lower-case words, separated by spaces."""
    help: str
    """The effect of the verb, in one sentence."""
    work: Work
    names: Names = Names.NOTHING
    arguments: tuple[VerbArgument, ...] = ()
    role: Role = Role.MAINTAIN
    """The least role that may give the command."""
    needs_lease: bool = True
    only_manual: bool = False
    """True if the command is refused in automatic mode."""
    of_many: bool = False
    """True if the command may concern the whole machine. Only one such command is carried out in a period."""
    is_kept_up: bool = False
    """True if the effect lasts only while the client sends heartbeats. For an action, the declaration of the action
    decides this."""
    lasts: bool = False
    """True if the command may end in a later period than that in which it begins."""
    ends: bool = False
    """True if the command ends something that its user has begun. A gateway passes on more commands of this kind."""
    is_level: bool = False
    """True if the command is sent as a level in shared memory, not through the queue."""
    is_of_lease: bool = False
    """True if the command takes the lease or gives it back. Clients that take the lease for each command do this
    themselves."""
    operation: Operation | None = None
    """The operation on alarms that the verb carries out."""

    @property
    def word(self) -> str:
        """The name of the verb as an identifier, such as "acknowledge_alarm"."""
        return self.name.replace(" ", "_")

    @property
    def title(self) -> str:
        """The name of the verb in CamelCase, such as "AcknowledgeAlarm"."""
        return self.name.title().replace(" ", "")

    @property
    def of_action(self) -> bool:
        """True if the arguments of the verb are those of the action that its path names."""
        return any(each.kind is ArgumentKind.OF_ACTION for each in self.arguments)

    @property
    def is_plain(self) -> bool:
        """True if the command can be given without arguments."""
        return not any(each.required for each in self.arguments)

    def fields(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields of a command with these arguments. They are checked when the machine takes the command."""
        if not arguments and not self.of_action:
            return {}
        if [each.name for each in self.arguments] == list(arguments) and not self.of_action and len(arguments) == 1:
            return {"value": next(iter(arguments.values()))}
        return {"arguments": dict(arguments)}

    def given(self, command: ClientCommand) -> dict[str, Any]:
        """Return the checked arguments of a command. Raises RangeError for an argument that is missing, unknown, or
        outside of its range."""
        if self.of_action:
            return dict(command.arguments)
        found = dict(command.arguments)
        if command.value is not None:
            if not self.arguments:
                raise RangeError(f"{self.name} takes no value")
            found.setdefault(self.arguments[0].name, command.value)
        known = {each.name: each for each in self.arguments}
        for name in found:
            if name not in known:
                takes = f"it takes {', '.join(known)}" if known else "it takes no arguments"
                raise RangeError(f"{self.name} has no argument {name!r}: {takes}")
        found |= {name: getattr(command, name) for name in known if name in OWN_FIELDS}
        for name, each in known.items():
            if name not in found and each.required:
                raise RangeError(f"{self.name} needs {name}: {each.range}{EXAMPLES.get(each.kind, '')}")
        return {name: known[name].checked(value) for name, value in found.items()}

    def plain(self) -> dict[str, Any]:
        """Return the verb as plain data, for programs in other languages."""
        arguments = [each.plain() for each in self.arguments]
        return {
            "name": self.name, "help": self.help, "names": self.names.name.lower(), "role": str(self.role),
            "arguments": arguments, "needs_lease": self.needs_lease, "only_manual": self.only_manual,
            "of_lease": self.is_of_lease, "holds": self.is_kept_up or self.of_action,
        }  # fmt: skip
