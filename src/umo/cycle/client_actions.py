"""The actions of clients that run, and what clients hold: begun, advanced in each period, and ended."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any, cast

from umo.cycle.client_commands import DEAD_MAN_REASON, DEAD_MAN_TIME, ClientCommand
from umo.cycle.events import EVENT_TEXT_BYTES, CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.sequences import Sequences, Task
from umo.errors import CommandRefused, EquipmentFault, PathError
from umo.objects import Action, Atomic, Compound, find
from umo.objects.paths import is_within
from umo.user_code import Raised, as_json, attempt

MAX_ACTIONS = 32
"""Number of actions of clients that run at once at most."""
PROGRESS_PAUSE = 0.5
"""s on the cycle's clock from one event of an action's progress to the next, at least."""


@dataclass(eq=False)
class _Action:
    """An action that has begun, and the sequences that it has started."""

    command: ClientCommand
    part: Atomic | Compound
    """The object whose action it is."""
    started: Sequences
    task: Task | None = None
    """The sequence that carries it out; None: it has ended, or it is no sequence itself."""
    progress: str = ""
    """What it said last of its progress, and what was told of that, and when."""
    told: str = ""
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
    """The time of the last sign of life for it, in s on the clock of the clients."""
    release: Callable[[], object]
    slot: int = -1
    """The actuator; -1 for an action."""
    is_running: bool = False
    """Whether it is a sequence that still runs; the end of a sequence is told as such."""


class ClientActions:
    """The actions of the clients of one connected machine, and what they hold, with all that is told of them."""

    def __init__(self, machine: ConnectedMachine) -> None:
        self._machine = machine
        self.at_work: Sequences | None = None
        """The sequences of the action that is being carried out at this moment: what it starts belongs here."""
        self._running: list[_Action] = []
        self._held: dict[str, _Held] = {}

    @property
    def any(self) -> bool:
        """Whether an action runs, or anything is held."""
        return bool(self._running or self._held)

    @property
    def held(self) -> list[str]:
        """The paths of what is held."""
        return list(self._held)

    # Begun ---------------------------------------------------------------------------------------------

    def begin(
        self, command: ClientCommand, action: Action, arguments: Mapping[str, Any], signed: float
    ) -> tuple[CommandState, str]:
        """Call an action; the answer. One with a release is held; `signed`: the last sign of life for it."""
        if len(self._running) >= MAX_ACTIONS:
            raise CommandRefused(f"{MAX_ACTIONS} actions are running already")
        begun, path = self._new(command), action.path
        if action.release is not None:
            self.hold(command, DEAD_MAN_TIME, signed, action.release)
        self._running.append(begun)
        try:
            result = self._call(begun, partial(action.call, **arguments))
            if begun not in self._running:
                raise self._machine.fault_of(begun.part) or CommandRefused(f"{path} was cancelled as it began")
        except BaseException:  # what it has begun until then ends with it
            self._end(begun, "")
            self.release(path, "")
            raise
        if begun.task is not None and path in self._held:
            self._held[path].is_running = True
        if begun.is_over:
            self._running.remove(begun)
        return (CommandState.BEGUN, "") if begun.task is not None else (CommandState.DONE, plain(result))

    def hold(
        self, command: ClientCommand, lasts: float, signed: float, release: Callable[[], object], slot: int = -1
    ) -> None:
        """Put what is at the path of the command under dead-man control: `release` ends it `lasts` s after the last
        sign of life."""
        self._held[command.path] = _Held(command, lasts, signed, release, slot)

    def _new(self, command: ClientCommand) -> _Action:
        return _Action(command, self._part_of(command.path), self._machine.sequences.others())

    def _part_of(self, path: str) -> Atomic | Compound:
        """The object whose action this is, or that has this actuator."""
        action = self._machine.actions.get(path)
        return object_at(self._machine.root, path.rpartition(".")[0]) if action is None else action.part

    def _call(self, action: _Action, call: Callable[[], Any]) -> Any:
        """Its result; the sequence that this is, and those that it starts, belong to the action. EquipmentFault if a
        sequence is to be started in equipment in fault."""
        result = self.within(action.started, call)
        if isinstance(result, Coroutine):
            task = action.started.task(result, action.part)
            if (fault := self._machine.fault_of(action.part)) is not None:
                task.cancel()  # it never begins
                raise fault
            action.task = task
        return result

    def within(self, sequences: Sequences, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call it; the sequences that it starts join these."""
        before, self.at_work = self.at_work, sequences
        try:
            return call(*arguments)
        finally:
            self.at_work = before

    # In each period ------------------------------------------------------------------------------------

    def end_unsigned(self, signed: Mapping[str, float], now: float) -> None:
        """End what is held without a sign of life. `signed`: the times of the last ones by path, until now."""
        commands = self._machine.commands
        for path, held in list(self._held.items()):
            if held.signed < signed[path] <= now:
                held.signed = signed[path]
            if held.slot >= 0 and not commands.client_of(held.slot):  # an interlock has reset it
                del self._held[path]
                self.tell(held.command, CommandState.CANCELLED, commands.inhibited(held.slot) or "it was reset")
            elif now - held.signed > held.lasts:
                self.release(path, DEAD_MAN_REASON)

    def advance(self) -> None:
        """A step of each."""
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
            self.note(f"a sequence that {each.command.path} has started failed: {error}")
        if each.is_over:
            self._remove(each)
        elif each.progress != each.told:
            self._tell_progress(each)

    def progress(self, text: str) -> None:
        """The action that is being carried out says this of its progress. It is told now and then."""
        for each in self._running:
            if each.started is self.at_work:
                each.progress = text[:EVENT_TEXT_BYTES]

    def _tell_progress(self, each: _Action) -> None:
        """As another event that it has begun: its end is still to come."""
        now = self._machine.clock.now
        if each.task is not None and now - each.told_at >= PROGRESS_PAUSE:
            each.told, each.told_at = each.progress, now
            self.tell(each.command, CommandState.BEGUN, each.progress)

    # Ended ---------------------------------------------------------------------------------------------

    def cancel(self, why: str, path: str = "") -> list[Raised]:
        """Cancel the action at this path, "": all that run; the errors of their cleaning up."""
        found = [each for each in self._running if path in ("", each.command.path)]
        return [error for each in found if (error := self._end(each, why)) is not None]

    def cancel_or_release(self, why: str, path: str) -> None:
        """Cancel the action at this path, "": all, and release those that are held. PathError if there is none."""
        held = [held for held, each in self._held.items() if each.slot < 0]
        if path not in ("", *held, *(each.command.path for each in self._running)):
            raise PathError(f"no action {path} is running")
        self.cancel(why, path)
        for each in held:
            if path in ("", each):
                self.release(each, why)

    def drop(self, why: str) -> None:
        """End everything."""
        self.cancel(why)
        for path in self.held:
            self.release(path, why)

    def end_in(self, compound: Compound, fault: Callable[[], EquipmentFault]) -> list[BaseException]:
        """End the actions of one compound, and the sequences of it that others have started; the errors of their
        cleaning up."""
        errors: list[BaseException] = []
        running = {each.command.path for each in self._running}
        for each in self._running.copy():
            if is_within(each.part, compound):
                self._end(each, str(fault()))
            else:
                errors += each.started.end_in(compound, fault)
        for path, held in list(self._held.items()):
            if held.slot < 0 and is_within(self._part_of(path), compound):
                self.release(path, "" if path in running else str(fault()))
        return errors

    def _end(self, action: _Action, why: str) -> Raised | None:
        """Cancel an action and what it has started; the error of the cleaning up. Of one that has ended nothing is told
        again: the cleaning up of another one may have put its equipment in fault."""
        asked = action.task is not None and action in self._running
        self._remove(action)
        _, error = attempt(self.within, action.started, action.cancel)
        if asked:
            text = why if error is None else f"{why}; in its cleaning up: {error}"
            self.tell(action.command, CommandState.CANCELLED, text)
        elif error is not None:
            self.note(f"a sequence that {action.command.path} has started failed in its cleaning up: {error}")
        return error

    def _remove(self, action: _Action) -> None:
        if action in self._running:
            self._running.remove(action)

    def release(self, path: str, why: str) -> None:
        """End what is held, if it is. A release starts nothing; if it fails, the actuators of its part go to their
        defaults."""
        held = self._held.pop(path, None)
        if held is None:
            return
        self.cancel(why, path)
        begun = self._new(held.command)
        failed: object = attempt(self._call, begun, held.release)[1]
        if not begun.is_over:
            attempt(self.within, begun.started, begun.cancel)
            failed = "a release starts no sequence"
        if failed is not None:
            self.note(f"{path} could not be released: {failed}")
            attempt(begun.part.reset)
        if why and not held.is_running:
            self.tell(held.command, CommandState.CANCELLED, why)

    # What is told --------------------------------------------------------------------------------------

    def tell(self, command: ClientCommand, state: CommandState, text: str) -> None:
        """The answer to a command."""
        now = self._machine.clock.now
        self._machine.events.add(Event(now, command.path, text, command.who, command.number, state, asked=str(command)))

    def note(self, text: str) -> None:
        """What the machine itself says."""
        self._machine.events.add(Event(self._machine.clock.now, "", text))


def object_at(root: Compound, path: str) -> Atomic | Compound:
    """The object at a path; "": the machine."""
    return cast("Atomic | Compound", find(root, path)) if path else root


def plain(result: Any) -> str:
    """A result as JSON that an event has room for; "" for None."""
    return "" if result is None else as_json(result, EVENT_TEXT_BYTES)
