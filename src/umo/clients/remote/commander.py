"""Commands of a program that waits for the answers of a running machine, and the lease in a `with` block."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from umo.clients.remote.client_session import LEASE_TIME, ClientSession
from umo.errors import CommandRefused, FramesError, LeaseHeld, RangeError, UmoError
from umo.operation.commands.client_commands import LONGEST_LEASE, SHORTEST_LEASE
from umo.operation.commands.verb import Verb
from umo.operation.commands.verbs import CALL, CANCEL, GIVE_BACK, TAKE_LEASE, VERBS, verb_of
from umo.process.frames import Reader
from umo.system.processes import user_name
from umo.text import did_you_mean

ANSWER_PAUSE = 0.002
"""Time in s between two looks for an answer."""
EVENT_DELAY = 0.05
"""Time in s within which the machine's event follows the end of a lease."""


class Commander:
    """A client of a running station: the frames of the station, and the commands to it."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        """Reader of its frames."""
        self.held_lease: HeldLease | None = None
        """The lease that this client holds."""
        self.wake = threading.Event()
        self.session = ClientSession(reader, self.wake.set)

    @property
    def running(self) -> bool:
        return self.session.running

    def lease(self, who: str = "", *, seconds: float = LEASE_TIME, over: bool = False) -> HeldLease:
        """Return the right to command, for a `with` block. `who` is shown to all clients; default: user and program.

        Raises CommandRefused while another client has the lease, unless it is deliberately taken over (`over`). The
        lease is renewed during the block, and ends `seconds` (0.2 to 60) after this process has died or hangs.
        """
        return HeldLease(self, who or _myself(), seconds, over)

    def stop(self, who: str = "") -> None:
        """Ask the run to end safely: every actuator goes to its default. Returns immediately. It needs no lease, and no
        queue of commands delays it. `who` is named in the report of the end; default: user and program."""
        self.session.stop(who or _myself())

    def do(self, verb: str, path: str = "", /, **arguments: Any) -> Any:
        """Give any verb of docs/verbs.md by name, such as `station.do("shelve", "tank.overfill", time="10 min")`, and
        return its result. A hold lasts until `do("let go", path)`, or until the lease ends. Raises CommandRefused for a
        name that is not a verb, RangeError for wrong arguments, and otherwise the error with which the machine answers.
        The row of the verb in docs/verbs.md says whether it needs the lease."""
        found = verb_of(verb)
        if found is None:
            raise CommandRefused(f"there is no command {verb!r}{did_you_mean(verb, VERBS)}")
        return self.carry_out(found, path, arguments)

    def carry_out(
        self,
        verb: Verb,
        path: str = "",
        arguments: Mapping[str, Any] | None = None,
        while_running: Callable[[], object] = lambda: None,
    ) -> Any:
        """Send a verb, and return its result when it has ended (see `do`)."""
        if verb.is_level:
            return self.stop()
        if verb.is_of_lease:
            raise CommandRefused(f"{verb.name}: `with station.lease():` takes the lease and gives it back")
        return self.ask(verb, path, while_running, **verb.fields(arguments or {}))

    def ask(self, verb: Verb, path: str = "", while_running: Callable[[], object] = lambda: None, **fields: Any) -> Any:
        """Send a command with these fields, and return its result. The machine's errors are raised here. Ctrl-C cancels
        an action."""
        fields = {"who": self.held_lease.who if self.held_lease else _myself()} | fields
        asked = self.session.asking(verb.name, path, **fields)
        try:
            asked.send()
            while asked.end is None:
                asked.look()
                if asked.begun:
                    while_running()
                time.sleep(ANSWER_PAUSE)
        except BaseException as error:
            asked.forget()
            if isinstance(error, KeyboardInterrupt) and verb is CALL:
                with suppress(UmoError):
                    self.session.asking(CANCEL.name, path, who=fields["who"]).send()
            raise
        return asked.outcome()

    def close(self) -> None:
        """Detach. A lease that this station still holds is given back."""
        if self.held_lease is not None:
            self.held_lease.give_back()
        self.session.close()


class HeldLease:
    """`with station.lease("commissioning"):`. Only the holder of the lease commands the station.

    A thread renews the lease and the holds (`ClientSession.keep`), until the block ends. If this process dies, the
    lease ends after `seconds`, and the actuators that it held go to their defaults. Raises RangeError if `seconds` is
    not from 0.2 to 60.
    """

    def __init__(self, station: Commander, who: str, seconds: float, over: bool) -> None:
        if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
            raise RangeError(f"a lease can last from {SHORTEST_LEASE:g} to {LONGEST_LEASE:g} s, not {seconds:g} s")
        self.who = who
        self._station = station
        self._seconds, self._over = seconds, over
        self._ended = False
        self._thread = threading.Thread(target=self._keep, name="umo lease", daemon=True)

    @property
    def lost(self) -> bool:
        """True if the lease has ended by itself or with the station, or if another client has taken it over."""
        return not self._station.session.has_lease

    @property
    def held(self) -> Mapping[str, object]:
        """The holds, by path."""
        return self._station.session.held

    def __enter__(self) -> HeldLease:
        """Take the lease. Raises LeaseHeld if another client has it; its text names the argument that takes it over."""
        station = self._station
        try:
            if station.session.has_lease and station.held_lease is not None:
                raise LeaseHeld(f"{station.held_lease.who} has the lease")
            station.ask(TAKE_LEASE, who=self.who, seconds=self._seconds, over=self._over)
        except LeaseHeld as error:
            raise LeaseHeld(
                f"{error}; take it over with station.lease(over=True), or wait until it is given back"
            ) from error
        station.held_lease = self
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.give_back()

    def give_back(self) -> None:
        """End the lease. The actuators that it held go to their defaults."""
        if self._station.held_lease is not self:  # it was given back before
            return
        try:
            with suppress(UmoError, OSError):  # it is lost, or the station has ended
                if not self.lost:
                    self._station.ask(GIVE_BACK)
        finally:
            self._ended = True
            self._station.wake.set()
            self._thread.join()
            self._station.held_lease = None
            self._station.session.held.clear()

    def ended(self, path: str) -> str:
        """Return the reason why the hold on this path has ended, as the machine reports it; "" if the hold lasts or
        does not exist."""
        session, lost = self._station.session, self.lost  # before the events: the last of them may tell why
        if not (told := session.ended(path)) and lost and session.running:
            time.sleep(EVENT_DELAY)
            told = session.ended(path)
        if told or not lost:
            return told
        return "the lease has ended" if session.running else f"{session.reader.about['station']} has ended"

    def _keep(self) -> None:
        """Send heartbeats until the block ends, or the lease is lost."""
        session, wake = self._station.session, self._station.wake
        with suppress(FramesError):  # the station has just ended
            while not (self._ended or self.lost):
                session.keep()
                wake.wait(session.pause)
                wake.clear()


def _myself() -> str:
    program = os.path.basename(sys.argv[0]) if sys.argv and sys.argv[0] else "python"
    return f"{user_name()}, {program} (pid {os.getpid()})"
