"""The running actions and the holds of clients: their begin, their step in each period, and their end."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any

from umo.cycle.equipment import Equipment
from umo.cycle.events import EVENT_TEXT_BYTES, LET_GO, CommandState, Event, around
from umo.cycle.machine import ConnectedMachine
from umo.cycle.sequences import Sequences, Task
from umo.cycle.writes import CalledAction
from umo.errors import CommandRefused, PathError
from umo.objects import Action, Atomic, Compound
from umo.objects.paths import is_within
from umo.operation.commands.client_commands import DEAD_MAN_REASON, DEAD_MAN_TIME, ClientCommand
from umo.text import some
from umo.user_code import Raised, as_json, attempt

MAX_ACTIONS = 32
"""The largest number of actions of clients that run simultaneously."""
PROGRESS_PAUSE = 0.5
"""Shortest time in s on the cycle's clock between two events of an action's progress."""


@dataclass(eq=False)
class _Action:
    """An action that has begun, and the sequences that it has started."""

    command: ClientCommand
    part: Atomic | Compound
    """The object whose action it is."""
    started: Sequences
    task: Task | None = None
    """The sequence that carries it out, or None if it has ended, or it is not a sequence itself."""
    told: str = ""
    """Its last progress, and when it was reported."""
    told_at: float = -inf

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
    """The time of the last heartbeat for it, in s on the clock of the clients."""
    part: Atomic | Compound
    """The object whose action it is, or the actuator."""
    release: Callable[[], object] | None = None
    """The method that ends an action."""
    slot: int = -1
    """The actuator; -1 for an action."""
    before: _Held | None = None
    """The earlier hold on the same path, or None."""
    is_running: bool = False
    """True if it is a sequence that still runs; the end of a sequence has an event of its own."""


class ClientActions:
    """The actions of the clients of one connected machine, the actuators that clients hold, and the events of both."""

    def __init__(self, machine: ConnectedMachine) -> None:
        self._machine = machine
        self._running: list[_Action] = []
        self._held: dict[str, _Held] = {}
        self._held_actions: set[str] = set()
        """The paths of the actions among what is held."""

    @property
    def any(self) -> bool:
        """True if an action runs, or anything is held."""
        return bool(self._running or self._held)

    @property
    def held(self) -> list[str]:
        """The paths under dead-man control."""
        return list(self._held)

    # Begun ---------------------------------------------------------------------------------------------

    def begin(
        self, command: ClientCommand, action: Action, arguments: Mapping[str, Any], signed: float
    ) -> tuple[CommandState, str]:
        """Call an action, and return the answer. An action with a release is held. `signed`: the time of the last
        heartbeat for the action."""
        if len(self._running) >= MAX_ACTIONS:
            raise CommandRefused(f"{MAX_ACTIONS} actions are already running")
        begun, path = self._new(command, action.part), action.path
        if action.release is not None:
            self.hold(command, DEAD_MAN_TIME, signed, action.part, release=action.release)
        self._running.append(begun)
        try:
            result = self._call(begun, partial(action.call, **arguments))
            if begun not in self._running:
                self._machine.equipment.check_may_begin(begun.part)
                raise CommandRefused(f"{path} was cancelled as it began")
        except BaseException:  # what it has begun until then ends with it
            self._end(begun, "")
            self.take_back(path)
            raise
        if begun.task is not None and path in self._held:
            self._held[path].is_running = True
        if begun.is_over:
            self._running.remove(begun)
        return (CommandState.BEGUN, "") if begun.task is not None else (CommandState.DONE, plain(result))

    def hold(
        self,
        command: ClientCommand,
        lasts: float,
        signed: float,
        part: Atomic | Compound,
        *,
        release: Callable[[], object] | None = None,
        slot: int = -1,
    ) -> None:
        """Put the object at the path of the command under dead-man control: the hold ends `lasts` s after the last
        heartbeat. `part`: the object of the action with the method that ends the action, or the actuator with its
        slot."""
        before = self._held.get(command.path)
        if before is not None:
            before.before = None
        self._held[command.path] = _Held(command, lasts, signed, part, release, slot, before)
        if slot < 0:
            self._held_actions.add(command.path)

    def _new(self, command: ClientCommand, part: Atomic | Compound) -> _Action:
        return _Action(command, part, self._machine.sequences.others(CalledAction(command.path)))

    def _call(self, action: _Action, call: Callable[[], Any]) -> Any:
        """Its result; the sequence that this is, and those that it starts, belong to the action. One that may not begin
        is refused."""
        turn = self._machine.sequences.current
        before, turn.law = turn.law, action.started.action
        try:
            result = self.within(action.started, call)
        finally:
            turn.law = before
        if isinstance(result, Coroutine):
            task = action.started.task(result, action.part)
            try:
                self._machine.equipment.check_may_begin(action.part)
            except BaseException:
                task.cancel()  # it never begins
                raise
            action.task = task
        return result

    def within(self, sequences: Sequences, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function. The sequences that the function starts join the given sequences."""
        machine = self._machine
        before, machine.at_work = machine.at_work, sequences
        try:
            return call(*arguments)
        finally:
            machine.at_work = before

    # In each period ------------------------------------------------------------------------------------

    def end_unsigned(self, signed: Mapping[str, float], now: float) -> None:
        """End holds without a heartbeat. `signed`: the times of the last signs so far, by path."""
        claims = self._machine.claims
        lapsed: list[str] = []
        reset: dict[str, list[_Held]] = {}
        for path, held in self._held.items():
            if held.signed < signed[path] <= now:
                held.signed = signed[path]
            if held.slot >= 0 and not claims.client_of(held.slot):  # an interlock has reset it
                reset.setdefault(claims.inhibited(held.slot) or "it was reset", []).append(held)
            elif now - held.signed > held.lasts:
                lapsed.append(path)
        for why, each in reset.items():
            for held in each:
                del self._held[held.command.path]
            self._tell_ended(each, why)
        if len(lapsed) == len(self._held):
            self._release_each(lapsed, DEAD_MAN_REASON)
        else:  # told one by one: a replay is to know which
            for path in lapsed:
                self.release(path, DEAD_MAN_REASON)

    def advance(self) -> None:
        """Advance each action by one step."""
        for each in self._running.copy():
            if each in self._running:  # or another one has cancelled it
                self._advance(each)

    def _advance(self, each: _Action) -> None:
        if each.task is not None:
            done, error = attempt(self.within, each.started, each.task.advance, self._machine.clock)
            if each not in self._running:  # it has put its own equipment in fault, and was told so
                return
            if error is not None:
                each.task = None
                self.tell(each.command, CommandState.FAILED, str(error))
                self._end(each, "")
                return
            if done:
                result, each.task = each.task.result, None
                self.tell(each.command, CommandState.DONE, plain(result))
                held = self._held.get(each.command.path)
                if held is not None and held.command is each.command:
                    held.is_running = False
        _, error = attempt(self.within, each.started, each.started.advance, self._machine.clock)
        if error is not None:
            self.note(f"a sequence that {each.command.path} had started failed: {error}")
        if each.is_over:
            self._remove(each)
        elif each.started.progress != each.told:
            self._tell_progress(each)

    def _tell_progress(self, each: _Action) -> None:
        """Report in an event now and then that the action runs: its end is still to come."""
        now = self._machine.clock.now
        if each.task is not None and now - each.told_at >= PROGRESS_PAUSE:
            each.told, each.told_at = each.started.progress, now
            self.tell(each.command, CommandState.BEGUN, each.told[:EVENT_TEXT_BYTES])

    # Ended ---------------------------------------------------------------------------------------------

    def cancel(self, why: str, path: str = "") -> list[Raised]:
        """Cancel the action at this path, or all running actions for "". Return the errors of their cleanup."""
        found = [each for each in self._running if path in ("", each.command.path)]
        return [error for each in found if (error := self._end(each, why)) is not None]

    def cancel_or_release(self, why: str, path: str) -> None:
        """Cancel the action at this path, or all actions for "", and release held actions. Raises PathError if there is
        no such action."""
        held = [each for each in self._held if each in self._held_actions]
        if path not in ("", *held, *(each.command.path for each in self._running)):
            raise PathError(f"no action {path} is running")
        self.cancel(why, path)
        for each in held:
            if path in ("", each):
                self.release(each, why)

    def drop(self, why: str) -> None:
        """End all actions and holds."""
        self.cancel(why)
        self._release_each(self.held, why)

    def end_in(self, equipment: Equipment, fault: Callable[[], BaseException]) -> list[BaseException]:
        """End the actions of one equipment, and sequences in it that other actions have started. Return the errors of
        their cleanup."""
        errors: list[BaseException] = []
        if not self._running and not self._held_actions:
            return errors
        compound = equipment.compound
        running = {each.command.path for each in self._running}
        for each in self._running.copy():
            if is_within(each.part, compound):
                self._end(each, str(fault()))
            else:
                errors += each.started.end_in(equipment.nodes, fault)
        for path in [each for each in self._held if each in self._held_actions] if self._held_actions else ():
            if path in self._held and is_within(self._held[path].part, compound):
                self.release(path, "" if path in running else str(fault()))
        return errors

    def _end(self, action: _Action, why: str) -> Raised | None:
        """Cancel an action and the sequences that it has started. Return the error of the `finally` blocks. An action
        that has ended gets no second event: the `finally` block of another one may have put its equipment in fault."""
        asked = action.task is not None and action in self._running
        self._remove(action)
        _, error = attempt(self.within, action.started, action.cancel)
        if asked:
            text = why if error is None else f"{why}; then, while cleaning up: {error}"
            self.tell(action.command, CommandState.CANCELLED, text)
        elif error is not None:
            self.note(f"a sequence that {action.command.path} had started failed while cleaning up: {error}")
        return error

    def _remove(self, action: _Action) -> None:
        if action in self._running:
            self._running.remove(action)

    def release(self, path: str, why: str) -> None:
        """End a hold, if it exists. A release starts no sequence. If the release fails, the actuators of its part go to
        their defaults."""
        self._release_each([path], why)

    def take_back(self, path: str) -> None:
        """End the hold of a command that failed. An earlier hold on this path also ends, and this is reported."""
        before = self._held[path].before if path in self._held else None
        self.release(path, "")
        if before is not None and not before.is_running:
            self._tell_ended([before], "the next command failed")

    def _release_each(self, paths: Iterable[str], why: str) -> None:
        """End several holds for one reason."""
        found = [held for path in paths if (held := self._held.pop(path, None)) is not None]
        self._machine.claims.release_from_client([held.slot for held in found if held.slot >= 0])
        for held in found:
            if held.slot < 0 and (failed := self._release_action(held, why)) is not None:
                self.note(f"{held.command.path} could not be released: {failed}")
                attempt(held.part.reset)
        if why:
            self._tell_ended([held for held in found if not held.is_running], why)

    def _release_action(self, held: _Held, why: str) -> object:
        """Release an action. Return why that failed, or None."""
        self._held_actions.discard(held.command.path)
        self.cancel(why, held.command.path)
        begun = self._new(held.command, held.part)
        assert held.release is not None
        failed: object = attempt(self._call, begun, held.release)[1]
        if not begun.is_over:
            attempt(self.within, begun.started, begun.cancel)
            failed = "a release starts no sequence"
        return failed

    # What is told --------------------------------------------------------------------------------------

    def tell(self, command: ClientCommand, state: CommandState, text: str) -> None:
        """Report the answer to a command."""
        now = self._machine.clock.now
        self._machine.events.add(Event(now, command.path, text, command.who, command.number, state, asked=str(command)))

    def _tell_ended(self, ended: Sequence[_Held], why: str) -> None:
        """Holds have ended for one reason. An action, or a single actuator, gets an event with the number of its
        command; several actuators get one event together, because the frames show which they are."""
        actuators = [held for held in ended if held.slot >= 0]
        for held in ended:
            if held.slot < 0 or len(actuators) == 1:
                self.tell(held.command, CommandState.CANCELLED, why)
        if len(actuators) > 1:
            paths, who = [held.command.path for held in actuators], actuators[0].command.who
            self._machine.events.add(partial(_several_ended, self._machine.clock.now, who, why, paths), needed=True)

    def note(self, text: str) -> None:
        """Report an event of the machine itself."""
        self._machine.events.add(Event(self._machine.clock.now, "", text))


def _several_ended(now: float, who: str, why: str, paths: Sequence[str]) -> Event:
    text = f"{why}: {len(paths):,} released: {some(paths)}"
    return Event(now, around(paths), text, who, state=CommandState.CANCELLED, asked=LET_GO)


def plain(result: Any) -> str:
    """Return a result as JSON that fits an event; "" for None."""
    return "" if result is None else as_json(result, EVENT_TEXT_BYTES)
