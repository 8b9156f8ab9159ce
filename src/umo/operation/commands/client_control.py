"""Clients: commands from outside a running machine, under one lease, through the same guards as the program's.

Once per period, before the sequences, `look` takes the commands that have arrived. No command can end the run: an
invalid command is refused, and a failure is reported in the answer. In automatic mode the application runs, numbers can
be tuned, and harmless actions can be called. In manual mode the application is suspended
(`umo.operation.commands.suspension`); actuators can be written, and all actions can be called. A hold of a client (a
written actuator, a jog) is under dead-man control: it ends when the client sends no heartbeat for it, or loses the
lease.

Heartbeats and a stop are levels, not commands: they are read in each period, even if the queue is full. The times of
heartbeats are compared with the computer's clock, even in a long period.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from umo.cycle.columns import TAKEN_BY_CLIENT
from umo.cycle.events import CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.errors import CommandRefused, DriverError, UmoError
from umo.objects import Actuator, described
from umo.objects.presentation.run_facts import driven_text, facts_of
from umo.operation.commands.client_commands import NOT_RENEWED, ClientCommand, Inbox, Levels, Mode
from umo.operation.commands.commanded import Commanded, VerbAnswer
from umo.operation.commands.verbs import STOP, VERBS
from umo.text import without_search
from umo.user_code import attempt

COMMANDS_PER_PERIOD = 4
"""Largest number of commands that are carried out in one period."""


class ClientControl(Commanded):
    """The part of one connected machine that carries out commands, by `umo.operation.commands.verbs`. `clock`: the
    clock of the heartbeats, in s."""

    def __init__(
        self,
        inbox: Inbox,
        levels: Levels,
        mode: Mode = Mode.AUTOMATIC,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(inbox, levels, mode, clock)
        self._asked = levels.asked
        self.stopped_by = ""
        """The client that has requested a stop."""
        self._stopping = False
        self._active = False
        self._next: ClientCommand | None = None
        """A command that has arrived and is carried out in the next period."""

    def attach(self, machine: ConnectedMachine) -> None:
        super().attach(machine)
        machine.phases.commanding.insert(0, self.look)
        machine.facts.append(self.facts)

    def facts(self) -> dict[str, str]:
        """Return the mode, the holder of the lease, and in manual mode the driven actuators."""
        image, holder, driven = self.machine.image, self.lease.holder, ""
        if self.mode is Mode.MANUAL:
            slots = [slot for slot, item in enumerate(image.items) if isinstance(item, Actuator)]
            taken = [image.restrictions[slot] == TAKEN_BY_CLIENT for slot in slots]
            about = [described(image.items[slot]) for slot in slots]
            driven = driven_text(zip(about, [image.values[slot] for slot in slots], taken, strict=True), holder)
        found = facts_of("", self.mode, holder, driven=driven)
        return {name: found[name] for name in ("mode", "lease", "driven")}

    # Once per period -----------------------------------------------------------------------------------

    def look(self) -> None:
        """Check which clients live, accept new commands, and continue running ones."""
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
        """Carry out a command and those after it, as many as one period allows."""
        room, has_many = COMMANDS_PER_PERIOD, False
        while command is not None and room:
            is_of_many = command.over or (command.do in VERBS and VERBS[command.do].of_many)
            if is_of_many and has_many:
                self._next = command
                return
            has_many = has_many or is_of_many
            self._answer(command)
            room -= 1
            command = self.inbox.get() if room else None

    def look_for_stop(self) -> None:
        """If a client requests a stop, end the run as after a signal. A stop needs no lease."""
        asked = self.levels.stop
        if asked is not None and not self._stopping:
            self._stopping = True
            number, self.stopped_by = asked
            self.machine.stop.request(number)
            now = self.machine.clock.now
            self.machine.events.add(Event(now, "", "", self.stopped_by, state=CommandState.DONE, asked=STOP.name))

    def _look_for_life(self) -> None:
        """End holds without a heartbeat, and a lease whose holder sends none."""
        signed = {path: self.levels.signed(path, self.lease.number) for path in ("", *self.actions.held)}
        now = self.clock()  # afterwards: no heartbeat is of a later time, but a wrong one
        self.lease.renew(signed[""], now)
        if self.lease.expired(now):
            why = f"the lease of {self.lease.holder} has ended, because it {NOT_RENEWED}"
            self.actions.note(why)
            self.end_lease(why)
        self.actions.end_unsigned(signed, now)

    def _go_on(self) -> None:
        self.actions.advance()
        if self.suspension.resuming is not None:
            self.resume(self.suspension.resuming)
        self.suspension.commands_taken()
        self._active = bool(self.actions.any or self.lease.holder or self.suspension.resuming)

    # Commands ------------------------------------------------------------------------------------------

    def _answer(self, command: ClientCommand) -> None:
        with without_search():  # whoever asked does that
            answer, error = attempt(self._obey, command)
        if error is not None:
            refused = issubclass(error.kind, UmoError) and not issubclass(error.kind, DriverError)
            answer = CommandState.REFUSED if refused else CommandState.FAILED, str(error)
        state, text = answer
        self._active = True
        self.actions.tell(command, state, text)

    def _obey(self, command: ClientCommand) -> VerbAnswer:
        if command.refused:
            raise CommandRefused(command.refused)
        if (verb := VERBS.get(command.do)) is None:
            raise CommandRefused(f"there is no command {command.do!r}")
        if verb.needs_lease:
            self.lease.check(command.key)
        if verb.only_manual:
            self.check_manual(f"{verb.name} is possible")
        return verb.work(self, command, verb.given(command))
