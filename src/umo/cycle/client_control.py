"""Clients: commands from outside a running machine, under one lease, through the same guards as the program's.

Once per period, before the sequences, `look` takes what has come in. Nothing of it can end the run: what is wrong is
refused, what fails is answered. In automatic mode the application runs, numbers can be tuned and harmless actions
called. In manual mode the application is suspended (`umo.cycle.suspension`); actuators can be written and all actions
called. What a client holds (a written actuator, a jog) is under dead-man control: it ends when the client gives no
sign of life for it, or loses the lease.

Signs of life and a stop are levels, not commands: they are looked up in each period, however full the queue is, and
their times are compared with the computer's clock, however long the period is.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from umo.cycle.client_commands import ClientCommand, Inbox, Lease, Levels, Mode
from umo.cycle.columns import Source
from umo.cycle.events import EVENT_TEXT_BYTES, CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.sequences import Sequences, Task
from umo.cycle.suspension import Suspension
from umo.errors import CommandRefused, DriverError, EquipmentFault, PathError, StateError, TaskFailed, UmoError
from umo.objects import Actuator, Atomic, Binary, Compound, Digital, Range, atoms, find
from umo.objects.paths import is_within
from umo.presentation.digits import setting_text
from umo.text import did_you_mean
from umo.user_code import Raised, as_json, attempt

log = logging.getLogger("umo")

DEAD_MAN_TIME = 0.5
"""Time without a sign of life after which a written actuator or a jog ends, s; shorter where the actuator expires
sooner."""
DEAD_MAN_REASON = "dead-man timeout"
"""Reason that is told when it has ended so."""
COMMANDS_PER_PERIOD = 4
"""Number of commands that are carried out in one period at most."""
MAX_ACTIONS = 32
"""Number of actions of clients that run at once at most."""


@dataclass(eq=False)
class _Action:
    """An action that has begun, and the sequences that it has started."""

    command: ClientCommand
    started: Sequences
    task: Task | None = None
    """The sequence that carries it out; None: it has ended, or it is no sequence itself."""

    @property
    def is_over(self) -> bool:
        return self.task is None and not self.started.running

    def cancel(self) -> None:
        try:
            if self.task is not None:
                self.task.cancel()
        finally:
            self.started.cancel()


@dataclass
class _Held:
    """An actuator or action under dead-man control."""

    command: ClientCommand
    lasts: float
    signed: float
    """The time of the last sign of life for it, in s on the clock of the clients."""
    release: Callable[[], object]
    slot: int = -1
    """The actuator; -1 for an action."""
    is_running: bool = False
    """Whether it is a sequence that still runs; the end of a sequence is told as such."""


class ClientControl:
    """Carries out the commands of one connected machine. `clock` is that of the signs of life, s."""

    def __init__(
        self,
        machine: ConnectedMachine,
        inbox: Inbox,
        levels: Levels,
        mode: Mode = Mode.AUTOMATIC,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._machine = machine
        self.inbox = inbox
        self._levels = levels
        self._asked = levels.asked
        self._clock = clock
        self.stopped_by = ""
        """The client that has asked for a stop."""
        self._stopping = False
        self.lease = Lease()
        self._actuators = {item.path: item for item in atoms(machine.root) if isinstance(item, Actuator)}
        self.at_work: Sequences | None = None
        """The sequences of the action that is being carried out at this moment: what it starts belongs here."""
        self._running: list[_Action] = []
        self._held: dict[str, _Held] = {}
        self._active = False
        self._suspension = Suspension(machine)
        self._changing: ClientCommand | None = None
        """The change to automatic mode that has begun: `on_resume` runs."""
        self.mode = mode
        machine.sequences.paused = mode is Mode.MANUAL

    # Once per period -----------------------------------------------------------------------------------

    def look(self) -> None:
        """See who is still there; take what has come in; go on with what runs."""
        if self._asked[0]:
            self.look_for_stop()
        if self._active:
            self._look_for_life()
        for _ in range(COMMANDS_PER_PERIOD):
            command = self.inbox.get()
            if command is None:
                break
            self._answer(command)
        if self._active:
            self._go_on()

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
        signed = {path: self._levels.signed(path, self.lease.number) for path in ("", *self._held)}
        now = self._clock()  # afterwards: no sign of life is of a later time, but a wrong one
        self.lease.renew(signed[""], now)
        if self.lease.expired(now):
            why = f"the lease of {self.lease.holder} has ended: it was not renewed"
            self._note(why)
            self._end_lease(why)
        commands = self._machine.commands
        for path, held in list(self._held.items()):
            if held.signed < signed[path] <= now:
                held.signed = signed[path]
            if held.slot >= 0 and not commands.client_of(held.slot):  # an interlock has reset it
                del self._held[path]
                self._tell(held.command, CommandState.CANCELLED, commands.inhibited(held.slot) or "it was reset")
            elif now - held.signed > held.lasts:
                self._release(path, DEAD_MAN_REASON)

    def _go_on(self) -> None:
        for each in self._running.copy():
            if each in self._running:  # or another one has cancelled it
                self._advance(each)
        if self._suspension.resuming is not None:
            self._resume()
        self._suspension.commands_taken()
        self._active = bool(self._running or self._held or self.lease.holder or self._suspension.resuming)

    def _advance(self, each: _Action) -> None:
        if each.task is not None:
            done, error = attempt(self._within, each, each.task.advance, self._machine.clock)
            if each not in self._running:  # it has put its own equipment in fault, and was told so
                return
            if error is not None:
                each.task = None
                self._tell(each.command, CommandState.FAILED, str(error))
                self._end(each, "")
                return
            if done:
                result, each.task = each.task.result, None
                self._tell(each.command, CommandState.DONE, _plain(result))
                held = self._held.get(each.command.path)
                if held is not None and held.command is each.command:
                    held.is_running = False
        _, error = attempt(self._within, each, each.started.advance, self._machine.clock)
        if error is not None:
            self._note(f"a sequence that {each.command.path} has started failed: {error}")
        if each.is_over and each in self._running:
            self._running.remove(each)

    def _new(self, command: ClientCommand) -> _Action:
        return _Action(command, Sequences(self._machine.equipment.contain_sequence))

    def _begin(self, action: _Action, call: Callable[[], Any]) -> Any:
        """Its result; the sequence that this is, and those that it starts, belong to the action."""
        result = self._within(action, call)
        if isinstance(result, Coroutine):
            action.task = Task(result, self._part(action.command.path))
        return result

    def _within(self, action: _Action, call: Callable[..., Any], *arguments: Any) -> Any:
        """A part of an action. The sequences that it starts are its own."""
        before, self.at_work = self.at_work, action.started
        try:
            return call(*arguments)
        finally:
            self.at_work = before

    # Commands ------------------------------------------------------------------------------------------

    def _answer(self, command: ClientCommand) -> None:
        answer, error = attempt(self._obey, command)
        if error is not None:
            refused = issubclass(error.kind, UmoError) and not issubclass(error.kind, DriverError)
            answer = CommandState.REFUSED if refused else CommandState.FAILED, str(error)
        state, text = answer
        self._active = True
        self._tell(command, state, text)

    def _obey(self, command: ClientCommand) -> tuple[CommandState, str]:
        if command.do not in COMMANDS:
            raise CommandRefused(f"there is no command {command.do!r}{did_you_mean(command.do, COMMANDS)}")
        return COMMANDS[command.do](self, command)

    def _take_lease(self, command: ClientCommand) -> tuple[CommandState, str]:
        if self.lease.acquire(command.who, command.key, command.seconds, self._clock(), over=command.over):
            self._drop(f"{command.who} has taken the lease over")
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
            return CommandState.DONE, ""
        if mode is Mode.AUTOMATIC:
            self._suspension.check()
        why = f"the mode has changed to {mode}"
        self._drop(why)
        if mode is Mode.MANUAL:
            self._end_change(CommandState.CANCELLED, why)
            self._suspend()
            return CommandState.DONE, ""
        try:
            begun = self._suspension.end()
        except BaseException:  # a device that did not accept a value
            self._suspend()
            raise
        self.mode = mode
        if not begun:
            return CommandState.DONE, ""
        self._changing = command
        return CommandState.BEGUN, ""

    def _tune(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        tunable = _known(self._machine.tunables, command.path, "tunable number")
        before = tunable.value
        tunable.set(command.value)
        return CommandState.DONE, json.dumps(" -> ".join(map(setting_text, (before, tunable.value))))

    def _write(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        self._need_manual("an actuator can be written by a client")
        item = _known(self._actuators, command.path, "actuator")
        value = _level(item, command.value)
        lasts = min(DEAD_MAN_TIME, item.expires or DEAD_MAN_TIME)
        signed = self._last_sign(item.path, lasts)
        slot, commands = item._slot, self._machine.commands
        if not commands.take_for_client(slot, command.who):
            raise CommandRefused(f"{item.path} is inhibited: {commands.inhibited(slot)}")
        self._held[item.path] = _Held(command, lasts, signed, lambda: commands.release_from_client(slot), slot)
        if not self._machine.image.command(slot, value, Source.CLIENT):
            raise CommandRefused(f"{item.path} is inhibited: {commands.inhibited(slot)}")
        return CommandState.DONE, ""

    def _let_go(self, command: ClientCommand) -> tuple[CommandState, str]:
        """End what a client holds."""
        self.lease.check(command.key)
        if command.path not in self._held:
            raise PathError(f"{command.path} is not held")
        self._release(command.path, "")
        return CommandState.DONE, ""

    def _call(self, command: ClientCommand) -> tuple[CommandState, str]:
        self.lease.check(command.key)
        action = _known(self._machine.actions, command.path, "action")
        part = self._part(action.path)
        if not action.harmless:
            self._need_manual(f"{action.path} can be called")
            if (fault := self._machine.fault_of(part)) is not None:
                raise fault
        arguments = action.converted(command.arguments)
        if len(self._running) >= MAX_ACTIONS:
            raise CommandRefused(f"{MAX_ACTIONS} actions are running already")
        begun = self._new(command)
        if action.release is not None:
            signed = self._last_sign(action.path, DEAD_MAN_TIME)
            self._held[action.path] = _Held(command, DEAD_MAN_TIME, signed, action.release)
        self._running.append(begun)
        try:
            result = self._begin(begun, partial(action.call, **arguments))
            if begun not in self._running:
                raise self._machine.fault_of(part) or CommandRefused(f"{action.path} was cancelled as it began")
        except BaseException:  # what it has begun until then ends with it
            attempt(self._within, begun, begun.cancel)
            if begun in self._running:
                self._running.remove(begun)
            if action.path in self._held:
                self._release(action.path, "")
            raise
        if begun.task is not None and action.path in self._held:
            self._held[action.path].is_running = True
        if begun.is_over:
            self._running.remove(begun)
        return (CommandState.BEGUN, "") if begun.task is not None else (CommandState.DONE, _plain(result))

    def _cancel(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The action of this path, or all."""
        self.lease.check(command.key)
        held = [path for path, each in self._held.items() if each.slot < 0]
        if command.path not in ("", *held, *(each.command.path for each in self._running)):
            raise PathError(f"no action {command.path} is running")
        why = f"by {command.who}"
        self._cancel_running(why, command.path)
        for path in held:
            if command.path in ("", path):
                self._release(path, why)
        return CommandState.DONE, ""

    def _acknowledge(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The latched interlocks of an object, "": of the machine; said if there was none. CommandRefused while the
        condition of one still holds."""
        self.lease.check(command.key)
        item = self._object(command.path)
        parts, commands = list(atoms(item)) if isinstance(item, Compound) else [item], self._machine.commands
        before = commands.latched(parts)
        item.acknowledge()
        if left := commands.latched(parts):
            raise CommandRefused(f"{command.path or 'the machine'} is still inhibited: {'; '.join(left)}")
        return CommandState.DONE, "" if before else _plain("nothing was latched")

    def _clear(self, command: ClientCommand) -> tuple[CommandState, str]:
        """The faults of the equipment in an object and around it, "": in the machine; told which."""
        self.lease.check(command.key)
        cleared = self._machine.clear(self._object(command.path))
        return CommandState.DONE, _plain(f"cleared: {', '.join(cleared)}" if cleared else "nothing was in fault")

    def end_in(self, compound: Compound, fault: Callable[[], EquipmentFault]) -> list[BaseException]:
        """End the actions of one compound, and the sequences of it that others have started; the errors of their
        cleaning up."""
        self._suspension.forget(compound)
        errors = [] if self._suspension.resuming is None else self._suspension.resuming.end_in(compound, fault)
        running = {each.command.path for each in self._running}
        for each in self._running.copy():
            if is_within(self._part(each.command.path), compound):
                self._end(each, str(fault()))
            else:
                errors += each.started.end_in(compound, fault)
        for path, held in list(self._held.items()):
            if held.slot < 0 and is_within(self._part(path), compound):
                self._release(path, "" if path in running else str(fault()))
        return errors

    def _part(self, action: str) -> Atomic | Compound:
        """The compound of the action at this path."""
        return self._object(action.rpartition(".")[0])

    def _object(self, path: str) -> Atomic | Compound:
        """At this path; "": the machine."""
        root = self._machine.root
        return cast("Atomic | Compound", find(root, path)) if path else root

    # Modes and ends ------------------------------------------------------------------------------------

    def _suspend(self) -> None:
        self.mode = Mode.MANUAL
        self._suspension.begin()

    def _resume(self) -> None:
        """Go on with what runs before the application goes on; back to manual mode if it fails."""
        self.at_work = self._suspension.resuming
        try:
            error = self._suspension.advance()
        finally:
            self.at_work = None
        if error is not None:
            text = f"back to manual mode: on_resume failed: {error}"
            log.warning("%s", text)
            self._note(text)
            self._end_change(CommandState.FAILED, text)
            self._suspend()
        elif self._suspension.resuming is None:
            self._end_change(CommandState.DONE, "")

    def _end_change(self, state: CommandState, text: str) -> None:
        """The change to automatic mode has ended, if one had begun."""
        command, self._changing = self._changing, None
        if command is not None:
            self._tell(command, state, text)

    def _end_lease(self, why: str) -> None:
        self._drop(why)
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
        if errors := self._cancel_running("the machine stops"):
            raise TaskFailed(str(errors[0]))

    def _drop(self, why: str) -> None:
        """End what the client has begun, and what that has started."""
        self._cancel_running(why)
        for path in list(self._held):
            self._release(path, why)

    def _cancel_running(self, why: str, path: str = "") -> list[Raised]:
        """The errors of the cleaning up."""
        found = [each for each in self._running if path in ("", each.command.path)]
        return [error for each in found if (error := self._end(each, why)) is not None]

    def _end(self, action: _Action, why: str) -> Raised | None:
        """Cancel an action and what it has started; the error of the cleaning up."""
        self._running.remove(action)
        asked = action.task is not None
        _, error = attempt(self._within, action, action.cancel)
        if asked:
            text = why if error is None else f"{why}; in its cleaning up: {error}"
            self._tell(action.command, CommandState.CANCELLED, text)
        elif error is not None:
            self._note(f"a sequence that {action.command.path} has started failed in its cleaning up: {error}")
        return error

    def _release(self, path: str, why: str) -> None:
        """End what is held. A release starts nothing; if it fails, the actuators of its part go to their defaults."""
        held = self._held.pop(path)
        self._cancel_running(why, path)
        begun = self._new(held.command)
        failed: object = attempt(self._begin, begun, held.release)[1]
        if not begun.is_over:
            attempt(self._within, begun, begun.cancel)
            failed = "a release starts no sequence"
        if failed is not None:
            self._note(f"{path} could not be released: {failed}")
            attempt(lambda: self._object(path.rpartition(".")[0]).reset())
        if why and not held.is_running:
            self._tell(held.command, CommandState.CANCELLED, why)

    # What is told --------------------------------------------------------------------------------------

    def _tell(self, command: ClientCommand, state: CommandState, text: str) -> None:
        now = self._machine.clock.now
        self._machine.events.add(Event(now, command.path, text, command.who, command.number, state, asked=str(command)))

    def _note(self, text: str) -> None:
        self._machine.events.add(Event(self._machine.clock.now, "", text))


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
}
"""The commands of clients, by name."""


def _known(table: Mapping[str, Any], path: str, what: str) -> Any:
    if path not in table:
        raise PathError(f"no {what} {path!r}{did_you_mean(path, table)}")
    return table[path]


def _level(item: Actuator, value: Any) -> float:
    """The value of the image for what a client gave: the name of a state, or a number within the range."""
    if isinstance(item, Binary):
        names = {state.name: state for state in item.states}
        if not isinstance(value, str) or value not in names:
            raise StateError(f"{item.path} has no state {value!r}{did_you_mean(str(value), names)}: {', '.join(names)}")
        return float(item._level(names[value]))
    return Range.of(cast(Digital, item)).check(item.path, value)


def _plain(result: Any) -> str:
    """A result as JSON that an event has room for; "" for None."""
    return "" if result is None else as_json(result, EVENT_TEXT_BYTES)
