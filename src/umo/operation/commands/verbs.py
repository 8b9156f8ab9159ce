"""The table of verbs: all commands to a running machine, each with the function that carries it out. A verb is added
only here: `umo.attach`, the command line, the page, the faces, fleets, the roles and docs/verbs.md use `VERBS`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from typing import Any

from umo.cycle import events
from umo.cycle.columns import Source
from umo.cycle.events import CommandState
from umo.digits import setting_text
from umo.errors import CommandRefused, PathError
from umo.operation.alarms.alarm_states import Operation
from umo.operation.alarms.alarming import engine_of, operate
from umo.operation.alarms.engine import LONGEST_SHELF
from umo.operation.commands.client_actions import plain
from umo.operation.commands.client_commands import DEAD_MAN_TIME, LONGEST_LEASE, SHORTEST_LEASE, ClientCommand, Mode
from umo.operation.commands.commanded import DONE, Commanded, VerbAnswer, known
from umo.operation.commands.verb import ArgumentKind, Names, Role, Verb, VerbArgument
from umo.text import some

VerbArguments = Mapping[str, Any]


# What carries them out ----------------------------------------------------------------------------------


def _take_lease(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    if machine.lease.acquire(command.who, command.key, given["seconds"], machine.clock(), over=given["over"]):
        machine.actions.drop(f"{command.who} has taken the lease over")
    return CommandState.DONE, str(machine.lease.number)


def _give_back(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    machine.end_lease("the lease was given back")
    return DONE


def _stop(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    raise CommandRefused(f"{command.do} is sent as a level in shared memory, not through the queue of commands")


def _change_mode(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    return machine.change_mode(Mode[given["mode"].upper()], command)


def _tune(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    tunable = known(machine.machine.directory.tunables, command.path, "tunable number")
    before = tunable.value
    tunable.set(given["value"])
    return CommandState.DONE, json.dumps(" -> ".join(map(setting_text, (before, tunable.value))))


def _write(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    item = machine.actuator(command.path)
    value: float = item._from_plain(given["value"])
    lasts = min(DEAD_MAN_TIME, item.expires or DEAD_MAN_TIME)
    signed = machine.last_sign(item.path, lasts)
    slot, claims = item._slot, machine.machine.claims
    if not claims.take_for_client(slot, command.who):
        raise CommandRefused(f"{item.path} is inhibited: {claims.inhibited(slot)}")
    machine.actions.hold(command, lasts, signed, item, slot=slot)
    try:
        if not machine.machine.image.command(slot, value, Source.CLIENT):
            raise CommandRefused(f"{item.path} is inhibited: {claims.inhibited(slot)}")
    except BaseException:  # a linearization, or a device, may raise anything
        machine.actions.take_back(item.path)
        raise
    return DONE


def _let_go(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    if command.path not in machine.actions.held:
        raise PathError(f"{command.path} is not held")
    machine.actions.release(command.path, "")
    return DONE


def _call(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    directory = machine.machine.directory
    action = directory.action_at(command.path) or known(directory.actions, command.path, "action")
    if not action.harmless:
        machine.check_manual(f"{action.path} can be called")
        machine.machine.equipment.check_may_begin(action.part)
    arguments = action.converted(given)
    signed = 0.0 if action.release is None else machine.last_sign(action.path, DEAD_MAN_TIME)
    return machine.actions.begin(command, action, arguments, signed)


def _cancel(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    machine.actions.cancel_or_release(f"by {command.who}", command.path)
    return DONE


def _acknowledge(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    """Said if nothing was latched. CommandRefused while the condition of one still holds."""
    part, claims = machine.object(command.path), machine.machine.claims
    slots = machine.machine.parts.of(part).actuators
    before = claims.inhibiting(slots, latched=True)
    part.acknowledge()
    if left := claims.inhibiting(slots, latched=True):
        raise CommandRefused(f"{command.path or 'the machine'} is still inhibited: {'; '.join(left)}")
    return CommandState.DONE, "" if before else plain("nothing was latched")


def _clear(machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    """The answer lists which were cleared, and which interlocks still inhibit their actuators."""
    cleared = machine.machine.equipment.clear(machine.object(command.path))
    text = f"cleared: {some(cleared)}" if cleared else "nothing was in fault"
    parts = [machine.object(path) for path in cleared or [command.path]]
    slots = frozenset().union(*(machine.machine.parts.of(part).actuators for part in parts))
    if left := machine.machine.claims.inhibiting(slots):
        text += f"; still inhibited: {'; '.join(left)}"
    return CommandState.DONE, plain(text)


def _operate(operation: Operation, machine: Commanded, command: ClientCommand, given: VerbArguments) -> VerbAnswer:
    """Carry out an operation on alarms. The answer lists the alarms and what was done."""
    alarms, seconds = engine_of(machine.machine), given.get("time", 0.0)
    return CommandState.DONE, plain(operate(alarms, operation, command.path, command.who, seconds))


# The table ----------------------------------------------------------------------------------------------


def _of_alarms(name: str, help: str, operation: Operation, role: Role, *arguments: VerbArgument) -> Verb:
    """A verb of alarms."""
    return Verb(
        name, help, partial(_operate, operation), Names.ALARM, arguments, role, of_many=True, operation=operation
    )


VALUE = VerbArgument("value", ArgumentKind.VALUE, "The new value.")

TAKE_LEASE = Verb(
    "lease", "Take the right to command.", _take_lease, role=Role.TUNE, needs_lease=False, is_of_lease=True,
    arguments=(
        VerbArgument("seconds", ArgumentKind.NUMBER, "Time for which the lease lasts without a heartbeat.",
                     "s", SHORTEST_LEASE, LONGEST_LEASE, required=False),
        VerbArgument("over", ArgumentKind.FLAG, "Whether to take the lease over from another client.", required=False),
    ),
)  # fmt: skip
GIVE_BACK = Verb(
    "give back", "Give the lease back. Everything that the client holds with the lease is released.", _give_back,
    role=Role.TUNE, of_many=True, is_of_lease=True,
)  # fmt: skip
STOP = Verb(
    "stop", "End the run as SIGTERM does, with status 143: every actuator goes to its default.", _stop,
    role=Role.OPERATE, needs_lease=False, is_level=True,
)  # fmt: skip
MODE = Verb(
    "mode", "Change the mode. In manual mode the application waits, and clients drive the machine.", _change_mode,
    role=Role.OPERATE, of_many=True, lasts=True,
    arguments=(VerbArgument("mode", ArgumentKind.CHOICE, "The new mode.", choices=tuple(map(str, Mode))),),
)  # fmt: skip
TUNE = Verb("tune", "Set a tunable number.", _tune, Names.TUNABLE, (VALUE,), Role.TUNE)
WRITE = Verb(
    "write", "Take an actuator and write it. The value stays while the client holds the actuator.", _write,
    Names.ACTUATOR, (VALUE,), Role.OPERATE, only_manual=True, is_kept_up=True,
)  # fmt: skip
LET_GO = Verb(
    events.LET_GO, "Release a held actuator, which then goes to its default, or a held action, such as a jog.", _let_go,
    Names.HELD, role=Role.OPERATE, ends=True,
)  # fmt: skip
CALL = Verb(
    "call", "Call an action. In automatic mode only an action that is declared harmless can be called.", _call,
    Names.ACTION, (VerbArgument("arguments", ArgumentKind.OF_ACTION, "The arguments of the action, by name."),),
    Role.OPERATE, lasts=True,
)  # fmt: skip
CANCEL = Verb(
    "cancel", "Cancel a running action; without a path: all running actions.", _cancel, Names.ACTION, role=Role.OPERATE,
    of_many=True, ends=True,
)  # fmt: skip
ACKNOWLEDGE = Verb(
    "acknowledge", "Acknowledge latched interlocks, so that the actuators they inhibit can be written again.",
    _acknowledge, Names.PART, role=Role.OPERATE, of_many=True,
)  # fmt: skip
CLEAR = Verb(
    "clear", "End the faults of equipment, and initialise the parts that had failed. In automatic mode an application "
    "that waits for this continues immediately: the machine may move. A unit whose application does not wait stays "
    "Stopped until its `reset` and `start`.", _clear, Names.EQUIPMENT, role=Role.OPERATE, of_many=True,
)  # fmt: skip
ACKNOWLEDGE_ALARM = _of_alarms(
    "acknowledge alarm", "Acknowledge alarms: confirm that they were seen.", Operation.ACKNOWLEDGE, Role.OPERATE
)
RESET_ALARM = _of_alarms(
    "reset alarm", "Reset latched alarms that are acknowledged and no longer active.", Operation.RESET, Role.OPERATE
)
SHELVE = _of_alarms(
    "shelve", "Hide alarms for a time, or until the run ends.", Operation.SHELVE, Role.MAINTAIN,
    VerbArgument("time", ArgumentKind.TIME, 'The time in s, or a string such as "10 min".', "s", 1e-3, LONGEST_SHELF),
)  # fmt: skip
UNSHELVE = _of_alarms(
    "unshelve", "Show shelved alarms again, before their time is over.", Operation.UNSHELVE, Role.MAINTAIN
)
REMOVE_FROM_SERVICE = _of_alarms(
    "remove from service",
    "Remove alarms from service for maintenance, also in later runs, until they are returned to service.",
    Operation.REMOVE,
    Role.MAINTAIN,
)
RETURN_TO_SERVICE = _of_alarms(
    "return to service", "Return alarms to service that were removed from it.", Operation.RETURN, Role.MAINTAIN
)

VERBS: dict[str, Verb] = {
    each.name: each
    for each in (
        TAKE_LEASE, GIVE_BACK, STOP, MODE, TUNE, WRITE, LET_GO, CALL, CANCEL, ACKNOWLEDGE, CLEAR, ACKNOWLEDGE_ALARM,
        RESET_ALARM, SHELVE, UNSHELVE, REMOVE_FROM_SERVICE, RETURN_TO_SERVICE,
    )
}  # fmt: skip
"""All verbs by name."""


def verb_of(name: str) -> Verb | None:
    """Return the verb of this name, or None. The words of the name may be joined by underscores or hyphens
    ("acknowledge_alarm")."""
    return VERBS.get(name.replace("_", " ").replace("-", " "))


def naming(*names: Names) -> list[Verb]:
    """Return the verbs whose paths name one of these kinds of objects."""
    return [each for each in VERBS.values() if each.names in names]


def offered() -> list[Verb]:
    """Return the verbs for a client that takes the lease for each command."""
    return [each for each in VERBS.values() if not each.is_of_lease]
