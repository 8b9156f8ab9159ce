"""Clients: commands from outside a running machine, under one lease, through the same guards as the program's.

Once per period, before the sequences, `look` takes what has come in. Nothing of it can end the run: what is wrong is
refused, what fails is answered. In automatic mode the application runs, numbers can be tuned and harmless actions
called. In manual mode the application is suspended (`umo.clients.suspension`); actuators can be written and all actions
called. What a client holds (a written actuator, a jog) is under dead-man control: it ends when the client gives no
sign of life for it, or loses the lease.

Signs of life and a stop are levels, not commands: they are looked up in each period, however full the queue is, and
their times are compared with the computer's clock, however long the period is.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from umo.alarms.alarming import ALARM_COMMANDS, engine_of, operate
from umo.clients.client_actions import ClientActions, plain
from umo.clients.client_commands import (
    DEAD_MAN_REASON,
    DEAD_MAN_TIME,
    ClientCommand,
    Commanding,
    Inbox,
    Lease,
    Levels,
    Mode,
)
from umo.clients.suspension import Suspension
from umo.cycle.columns import TAKEN_BY_CLIENT, Source
from umo.cycle.equipment import Equipment
from umo.cycle.events import CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.sequences import Sequences
from umo.errors import CommandRefused, DriverError, PathError, TaskFailed, UmoError
from umo.objects import Actuator, Atomic, Compound, atoms, described, walk
from umo.presentation.digits import setting_text
from umo.presentation.run_facts import driven_text, facts_of
from umo.text import some, without_search
from umo.user_code import attempt

log = logging.getLogger("umo")

COMMANDS_PER_PERIOD = 4
"""Number of commands that are carried out in one period at most."""
OF_MANY = frozenset(("give back", "mode", "acknowledge", "clear", "cancel", *ALARM_COMMANDS))
"""The commands that may concern the whole machine: one of these is carried out in a period."""


class ClientControl(Commanding):
    """Carries out the commands of one connected machine, in COMMANDS. `clock` is that of the signs of life,
    s."""

    def __init__(
        self,
        inbox: Inbox,
        levels: Levels,
        mode: Mode = Mode.AUTOMATIC,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.inbox = inbox
        self._levels = levels
        self._asked = levels.asked
        self._clock = clock
        self.stopped_by = ""
        """The client that has asked for a stop."""
        self._stopping = False
        self.lease = Lease()
        self.mode = mode
        self._active = False
        self._next: ClientCommand | None = None
        """A command that has come in and is carried out in the next period."""
        self._changing: ClientCommand | None = None
        """The change to automatic mode that has begun: `on_resume` runs."""

    def attach(self, machine: ConnectedMachine) -> None:
        self._machine = machine
        self._objects: dict[str, Atomic | Compound] = {
            node._path: node for node in (machine.root, *walk(machine.root)) if isinstance(node, Atomic | Compound)
        }
        """By path; "": the machine."""
        self._actuators = {item.path: item for item in atoms(machine.root) if isinstance(item, Actuator)}
        self._actions = ClientActions(machine)
        (
            machine.parts.of(machine.root).actuators,
            machine.directory.actions,
            machine.directory.loops,
        )  # known from now on: they take long
        self._suspension = Suspension(machine)
        machine.sequences.paused = machine.is_manual = self.mode is Mode.MANUAL
        machine.phases.commanding.insert(0, self.look)
        machine.under_way.others.append(self.end_in)
        machine.under_way.before_cancel.append(self.cancel)
        machine.facts.append(self.facts)

    def facts(self) -> dict[str, str]:
        """The mode, the holder of the lease, and in manual mode what is driven."""
        image, holder, driven = self._machine.image, self.lease.holder, ""
        if self.mode is Mode.MANUAL:
            slots = [slot for slot, item in enumerate(image.items) if isinstance(item, Actuator)]
            taken = [image.restrictions[slot] == TAKEN_BY_CLIENT for slot in slots]
            about = [described(image.items[slot]) for slot in slots]
            driven = driven_text(zip(about, [image.values[slot] for slot in slots], taken, strict=True), holder)
        found = facts_of("", self.mode, holder, driven=driven)
        return {name: found[name] for name in ("mode", "lease", "driven")}

    # Once per period -----------------------------------------------------------------------------------

    def look(self) -> None:
        """See who is still there; take what has come in; go on with what runs."""
        if self._asked[0]:
            self.look_for_stop()
        if self._active:
            self._look_for_life()
        command, self._next = self._next or self.inbox.get(), None
        if command is not None:
            self._take(command)
        if self._active:
            self._go_on()

    def _take(self, command: ClientCommand | None) -> None:
        """Carry out a command and those that have come in after it, as far as one period has room for them."""
        room, has_many = COMMANDS_PER_PERIOD, False
        while command is not None and room:
            is_of_many = command.do in OF_MANY or command.over
            if is_of_many and has_many:
                self._next = command
                return
            has_many = has_many or is_of_many
            self._answer(command)
            room -= 1
            command = self.inbox.get() if room else None

    def look_for_stop(self) -> None:
        """The run ends as after a signal if somebody asks for it. It needs no lease."""
        asked = self._levels.stop
        if asked is not None and not self._stopping:
            self._stopping = True
            number, self.stopped_by = asked
            self._machine.stop.request(number)
            now = self._machine.clock.now
            self._machine.events.add(Event(now, "", "", self.stopped_by, state=CommandState.DONE, asked="stop"))

    def _look_for_life(self) -> None:
        """End what is held without a sign of life, and a lease whose holder gives none."""
        signed = {path: self._levels.signed(path, self.lease.number) for path in ("", *self._actions.held)}
        now = self._clock()  # afterwards: no sign of life is of a later time, but a wrong one
        self.lease.renew(signed[""], now)
        if self.lease.expired(now):
            why = f"the lease of {self.lease.holder} has ended: it was not renewed"
            self._actions.note(why)
            self._end_lease(why)
        self._actions.end_unsigned(signed, now)

    def _go_on(self) -> None:
        self._actions.advance()
        if self._suspension.resuming is not None:
            self._resume(self._suspension.resuming)
        self._suspension.commands_taken()
        self._active = bool(self._actions.any or self.lease.holder or self._suspension.resuming)

    # Commands ------------------------------------------------------------------------------------------

    def _answer(self, command: ClientCommand) -> None:
        with without_search():  # whoever asked does that
            answer, error = attempt(self._obey, command)
        if error is not None:
            refused = issubclass(error.kind, UmoError) and not issubclass(error.kind, DriverError)
            answer = CommandState.REFUSED if refused else CommandState.FAILED, str(error)
        state, text = answer
        self._active = True
        self._actions.tell(command, state, text)

    def _obey(self, command: ClientCommand) -> tuple[CommandState, str]:
        if command.refused:
            raise CommandRefused(command.refused)
        if command.do not in COMMANDS:
            raise CommandRefused(f"there is no command {command.do!r}")
        return COMMANDS[command.do](self, command)

    def _take_lease(self, command: ClientCommand) -> tuple[CommandState, str]:
        if self.lease.acquire(command.who, command.key, command.seconds, self._clock(), over=command.over):
            self._actions.drop(f"{command.who} has taken the lease over")
        return CommandState.DONE, str(self.lease.number)

    def _give_lease(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        self._end_lease("the lease was given back")
        return CommandState.DONE, ""

    def _last_sign(self, path: str, lasts: float) -> float:
        """The time of the last sign of life for it. CommandRefused if that is too long ago: in a long period its client
        may have died since it sent the command."""
        signed = self._levels.signed(path, self.lease.number)
        if not 0.0 <= self._clock() - signed <= lasts:
            raise CommandRefused(f"{path}: {DEAD_MAN_REASON}: no sign of life from its client for {lasts:g} s")
        return signed

    def _change_mode(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        try:
            mode = Mode[str(command.value).upper()]
        except KeyError:
            raise CommandRefused(f"there is no mode {command.value!r}; there are: automatic, manual") from None
        if mode is self.mode:
            if self._changing is not None:
                raise CommandRefused("the change to automatic mode has begun, and has not ended")
            return CommandState.DONE, ""
        if mode is Mode.AUTOMATIC:
            self._suspension.check()
        why = f"the mode has changed to {mode}"
        self._actions.drop(why)
        if mode is Mode.MANUAL:
            self._end_change(CommandState.CANCELLED, why)
            self._suspend()
            return CommandState.DONE, ""
        try:
            begun = self._suspension.end()
        except BaseException:  # a device that did not accept a value
            self._suspend()
            raise
        self.mode, self._machine.is_manual = mode, False
        if not begun:
            return CommandState.DONE, ""
        self._changing = command
        return CommandState.BEGUN, ""

    def _tune(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        tunable = _known(self._machine.directory.tunables, command.path, "tunable number")
        before = tunable.value
        tunable.set(command.value)
        return CommandState.DONE, json.dumps(" -> ".join(map(setting_text, (before, tunable.value))))

    def _write(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        self._need_manual("an actuator can be written by a client")
        item = _known(self._actuators, command.path, "actuator")
        value: float = item._from_plain(command.value)
        lasts = min(DEAD_MAN_TIME, item.expires or DEAD_MAN_TIME)
        signed = self._last_sign(item.path, lasts)
        slot, claims = item._slot, self._machine.claims
        if not claims.take_for_client(slot, command.who):
            raise CommandRefused(f"{item.path} is inhibited: {claims.inhibited(slot)}")
        self._actions.hold(command, lasts, signed, item, slot=slot)
        try:
            if not self._machine.image.command(slot, value, Source.CLIENT):
                raise CommandRefused(f"{item.path} is inhibited: {claims.inhibited(slot)}")
        except BaseException:  # a linearization, or a device, may raise anything
            self._actions.release(item.path, "")
            raise
        return CommandState.DONE, ""

    def _let_go(self, command: ClientCommand) -> tuple[CommandState, str]:
        """End what a client holds."""
        self.lease.check(command.key)
        if command.path not in self._actions.held:
            raise PathError(f"{command.path} is not held")
        self._actions.release(command.path, "")
        return CommandState.DONE, ""

    def _call(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        directory = self._machine.directory
        action = directory.action_at(command.path) or _known(directory.actions, command.path, "action")
        if not action.harmless:
            self._need_manual(f"{action.path} can be called")
            self._machine.equipment.check_may_begin(action.part)
        arguments = action.converted(command.arguments)
        signed = 0.0 if action.release is None else self._last_sign(action.path, DEAD_MAN_TIME)
        return self._actions.begin(command, action, arguments, signed)

    def _cancel(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The action of this path, or all."""
        self.lease.check(command.key)
        self._actions.cancel_or_release(f"by {command.who}", command.path)
        return CommandState.DONE, ""

    def _acknowledge(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The latched interlocks of an object, "": of the machine; said if there was none. CommandRefused while the
        condition of one still holds."""
        self.lease.check(command.key)
        part, claims = self._object(command.path), self._machine.claims
        slots = self._machine.parts.of(part).actuators
        before = claims.inhibiting(slots, latched=True)
        part.acknowledge()
        if left := claims.inhibiting(slots, latched=True):
            raise CommandRefused(f"{command.path or 'the machine'} is still inhibited: {'; '.join(left)}")
        return CommandState.DONE, "" if before else plain("nothing was latched")

    def _clear(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The faults of the equipment in an object and around it, "": in the machine; told which, and which interlocks
        still inhibit their actuators."""
        self.lease.check(command.key)
        cleared = self._machine.equipment.clear(self._object(command.path))
        text = f"cleared: {some(cleared)}" if cleared else "nothing was in fault"
        parts = [self._object(path) for path in cleared or [command.path]]
        slots = frozenset().union(*(self._machine.parts.of(part).actuators for part in parts))
        if left := self._machine.claims.inhibiting(slots):
            text += f"; still inhibited: {'; '.join(left)}"
        return CommandState.DONE, plain(text)

    def _operate_alarms(self, command: ClientCommand) -> tuple[CommandState, str]:
        """Told what was done with which alarms."""
        self.lease.check(command.key)
        return CommandState.DONE, plain(
            operate(engine_of(self._machine), command.do, command.path, command.value, command.who)
        )

    def _object(self, path: str) -> Atomic | Compound:
        found: Atomic | Compound = _known(self._objects, path, "object", f" in {type(self._machine.root).__name__}")
        return found

    # Modes and ends ------------------------------------------------------------------------------------

    def _suspend(self) -> None:
        self.mode, self._machine.is_manual = Mode.MANUAL, True
        self._suspension.begin()

    def _resume(self, resuming: Sequences) -> None:
        """Go on with what runs before the application goes on; back to manual mode if it fails."""
        error = self._actions.within(resuming, self._suspension.advance)
        if error is not None:
            text = f"back to manual mode: on_resume failed: {error}"
            log.warning("%s", text)
            self._actions.note(text)
            self._end_change(CommandState.FAILED, text)
            self._suspend()
        elif self._suspension.resuming is None:
            self._end_change(CommandState.DONE, "")

    def _end_change(self, state: CommandState, text: str) -> None:
        """The change to automatic mode has ended, if one had begun."""
        command, self._changing = self._changing, None
        if command is not None:
            self._actions.tell(command, state, text)

    def _end_lease(self, why: str) -> None:
        self._actions.drop(why)
        self.lease.end()
        if self.mode is Mode.MANUAL:
            self._suspension.lease_ended()

    def _need_manual(self, what: str) -> None:
        if self.mode is not Mode.MANUAL:
            raise CommandRefused(
                f"{what} in manual mode only; the machine runs in automatic mode (`umo mode` changes it)"
            )

    def cancel(self) -> None:
        """The machine stops: cancel what runs. TaskFailed with the first error of the cleaning up."""
        self._suspension.cancel()
        self._end_change(CommandState.CANCELLED, "the machine stops")
        if errors := self._actions.cancel("the machine stops"):
            raise TaskFailed(str(errors[0]))

    def end_in(self, equipment: Equipment, fault: Callable[[], BaseException]) -> list[BaseException]:
        """End the actions and sequences of one equipment; the errors of their cleaning up."""
        self._suspension.forget(equipment.compound)
        resuming = self._suspension.resuming
        errors = [] if resuming is None else resuming.end_in(equipment.nodes, fault)
        return errors + self._actions.end_in(equipment, fault)


COMMANDS: Mapping[str, Callable[[ClientControl, ClientCommand], tuple[CommandState, str]]] = {
    "lease": ClientControl._take_lease,
    "give back": ClientControl._give_lease,
    "mode": ClientControl._change_mode,
    "tune": ClientControl._tune,
    "write": ClientControl._write,
    "let go": ClientControl._let_go,
    "call": ClientControl._call,
    "cancel": ClientControl._cancel,
    "acknowledge": ClientControl._acknowledge,
    "clear": ClientControl._clear,
    **dict.fromkeys(ALARM_COMMANDS, ClientControl._operate_alarms),
}
"""The commands of clients, by name."""


def _known(table: Mapping[str, Any], path: str, what: str, where: str = "") -> Any:
    """What has this path in a table; PathError if nothing has. Whoever asked looks for the nearest one."""
    if path not in table:
        raise PathError(f"no {what} {path!r}{where}")
    return table[path]
