"""Replays a recorded run. A tape replaces the drivers, the clients and the time; everything else is the present
program."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

from umo.cycle.clock import WallClock
from umo.cycle.connect import connect
from umo.cycle.events import CommandState
from umo.cycle.frame import Frame, Observer
from umo.cycle.journal import CAPACITY, Journal
from umo.cycle.machine import ConnectedMachine
from umo.cycle.phase_times import PhaseTimes
from umo.drivers.optional import WaitEnded
from umo.errors import DriverError, text_of
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.client_control import ClientControl
from umo.recording.replay.comparison import Comparison
from umo.recording.replay.player import CAUSE, Player
from umo.recording.replay.program import Program
from umo.recording.replay.recorded_clients import TapeInbox, TapeLevels
from umo.recording.replay.result import Difference, Replayed
from umo.recording.replay.tape import OPEN_LOOP, NotReplayable, Periods, Tape, events_of, first_sample
from umo.recording.replay.tape_driver import count_as_hardware, taped, watch_blocks
from umo.system.processes import HASH_SEED

MAX_COMPARED = 100
"""Number of compared characters of an error's text."""
SHORT = 20
"""Number of compared characters in a comparison that ignores the numbers in the texts."""
RANDOM_HASHES = "the recorded run had no fixed hash seed (PYTHONHASHSEED): the order of sets of strings may differ"


class Replay:
    """One replay of a tape."""

    def __init__(
        self,
        tape: Tape,
        program: Program | None = None,
        settings: Mapping[str, object] = MappingProxyType({}),
    ) -> None:
        """`program`: the program to run; default: the station of the recording. `settings`: other values of numbers, by
        path. With settings the replay continues after differences, in open loop, because the recorded sensors do not
        react to the new commands. Raises NotReplayable, with a text in one line, if the recording cannot be
        replayed."""
        self._tape = tape
        _check(tape)
        self.program = program or Program.of(tape)
        self.on_connected: Callable[[], object] = lambda: None
        """Function that is called when the machine is connected."""
        self.observers: list[Observer] = []
        """Functions that are called in each period with its frame, before the next one begins."""
        if settings:
            self.program.set(settings)
        self.layout = tape.layout
        initial = dict(self.layout.about.get("initial", {}))
        self.periods = Periods(tape)
        raws = initial.get("raws") or [0] * len(self.layout.objects)
        self.player = Player(self.periods, raws)
        self._first = first_sample(initial, raws)
        self._open_loop = bool(self.layout.about.get(OPEN_LOOP))
        self.player.lenient = bool(settings) or self._open_loop
        self.result = Replayed(self.program.name, settings=dict(settings), code=self.program.code)
        seed = initial.get("hash_seed", "random")
        if seed == "random" or seed != os.environ.get(HASH_SEED):
            self.result.hashes = RANDOM_HASHES
        self.connection = self._connection(initial)
        self.comparison: Comparison

    def _connection(self, initial: Mapping[str, Any]) -> connect[Any]:
        program = self.program
        recorded = {str(each["path"]): slot for slot, each in enumerate(self.layout.objects)}
        today = {wire.path for wire in program.wired.wires}
        for missing, where in (recorded.keys() - today, "present machine"), (today - recorded.keys(), "recording"):
            if missing:
                raise NotReplayable(f"the {where} has no object {min(missing)}: inputs and outputs must be the same")
        faults = self.layout.about.get("injected_faults", [])
        connection = connect(program.machine, taped(program.wired, self.player, recorded, faults))
        connection.kept = {
            path: value for path, value in initial.get("kept", {}).items() if path not in self.result.settings
        }
        connection.states = initial
        connection.seed = initial.get("seed", 0)
        connection.pause = lambda seconds: None
        connection.before_first_sample = self._play_first_sample
        return connection

    def _play_first_sample(self) -> None:
        """Prepare the tape to answer the sample that is made while connecting."""
        machine, player = self.connection.machine, self.player
        transfer = machine.image.transfer
        transfer.now = lambda: machine.clock.now  # a replay on a busy computer takes no longer than its run
        count_as_hardware(transfer, self.program.wired, self.connection.wired.drivers)
        watch_blocks(transfer, player)
        transfer.bind(machine.image.inputs, machine.image.outputs)
        player.connect(transfer.journal, self._first)

    def run(self) -> Replayed:
        """Replay to the end of the tape, or to the first difference."""
        result, begun = self.result, time.perf_counter()
        try:
            with self.connection as machine, self._played(self.connection.machine):
                self.on_connected()
                if self.player.skipped > 0:
                    self.connection.machine.skip_ticks()
                if not self.player.over:
                    self.program.drive(machine)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit too: of control code; what leaving raises is in no recording
            if not self.connection.started:
                raise NotReplayable(f"the machine cannot be connected: {text_of(error)}") from error
        if self.connection.stop.signal == signal.SIGINT:  # Ctrl-C, which asks a connected machine to stop
            raise KeyboardInterrupt
        result.elapsed = time.perf_counter() - begun
        result.inexact = self.player.ended
        self._compare_ends()
        return result

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Return a context in which an observer of the machine may call its drivers without affecting the replay."""
        transfer, player = self.connection.machine.image.transfer, self.player
        journal, transfer.journal, player.paused = transfer.journal, None, True
        try:
            yield
        finally:
            transfer.journal, player.paused = journal, False

    @contextmanager
    def _played(self, machine: ConnectedMachine) -> Iterator[None]:
        """Return a context in which the tape answers, period by period."""
        image, player, result = machine.image, self.player, self.result
        phases = PhaseTimes(image, self.connection.wired.drivers, machine.groups.parts)
        watch_blocks(image.transfer, player)
        image.transfer.bind(image.inputs, image.outputs)
        journal = image.transfer.journal = Journal(CAPACITY + len(image.items))
        player.connected(journal)
        inbox = TapeInbox(player)
        levels = TapeLevels(player, inbox, events_of(self._tape))
        mode = Mode.MANUAL if self.program.manual else Mode.AUTOMATIC
        machine.attach(ClientControl(inbox, levels, mode, levels.now))
        self.comparison = comparison = Comparison(machine, journal, player, self.layout, result)
        player.wrong = comparison.tell
        comparison.compares = not self._open_loop
        if not player.lenient:
            comparison.on_difference = self.connection.stop.request

        def shown(frame: Frame) -> None:
            comparison(frame)
            for observer in self.observers:
                observer(frame)
            phases.clear()
            journal.clear()
            player.finish()
            if player.over:
                self.connection.stop.request()

        machine.observers.append(shown)
        if isinstance(machine.clock, WallClock):
            _play_time(machine.clock, player)
        try:
            yield
        except WaitEnded:
            raise
        except BaseException as error:  # leaving may raise another one
            result.error = error
            raise

    def _compare_ends(self) -> None:
        """Compare the ends of both runs. If the replay ends by another error than the recorded run, or earlier, that is
        a difference."""
        result, end = self.result, _end_of(self._tape)
        result.ended = "" if end is None else end.text
        if self._open_loop:
            self._compare_errors(end)
            return
        if result.difference is not None or self.player.lenient:
            return
        if result.error is not None:
            recorded = end.text if end is not None and end.state is CommandState.FAILED else ""
            text = text_of(result.error)
            if end is not None and not _same_error(result.error, text, recorded):
                result.difference = self._end_difference(recorded or "no error", text)
            elif self.player.next is not None:
                result.difference = self._end_difference("the run continued", text)
        elif self.player.next is not None and not self.player.ended:
            period, moment = self.player.shown, self.player.next.time  # the first one that is missing
            result.difference = Difference(period, moment, "", "the run continued", "the program has ended")

    def _compare_errors(self, end: Any) -> None:
        """Compare only the errors, because a recording that was shrunk can only be expected to give the same error."""
        recorded = "no error" if end is None or end.state is not CommandState.FAILED else end.text
        error = self.result.error
        replayed = "no error" if error is None else text_of(error)
        self.result.open_loop = True
        same = (error is None) == (recorded == "no error")
        if not same or (error is not None and not _same_kind(error, recorded)):
            self.result.difference = self._end_difference(recorded, replayed)

    def _end_difference(self, recorded: str, replayed: str) -> Difference:
        return Difference(max(self.player.shown - 1, 0), self.result.simulated, "", recorded, replayed)


def replay(
    tape: Tape, program: Program | None = None, settings: Mapping[str, object] = MappingProxyType({})
) -> Replayed:
    """Replay a recorded run, and return the result (see `Replay`)."""
    return Replay(tape, program, settings).run()


def _check(tape: Tape) -> None:
    late = getattr(tape, "replayable_from", None)
    if late is not None:
        raise NotReplayable(str(late))


def _play_time(clock: WallClock, player: Player) -> None:
    """Set the clock of a machine without a timer to the recorded times."""
    tick: Callable[[], None] = clock.on_tick
    clock._start = 0.0
    clock._source = lambda: 0.0 if player.period is None else player.period.time

    def on_tick() -> None:
        tick()
        player.tick()

    clock.on_tick = on_tick


def _end_of(tape: Tape) -> Any:
    """Return the last event of the run, or None if the recording has none because the run was killed."""
    ends = [event for event in events_of(tape) if event.is_end]
    return ends[-1] if ends else None


def _same_kind(error: BaseException, recorded: str) -> bool:
    """True if the beginnings of both texts are the same except for numbers. An error of a driver that failed in the
    recording always counts as the same."""
    first, second = (
        re.sub(r"[\d.,:]+", "0", text.partition("\n")[0])[:MAX_COMPARED] for text in (text_of(error), recorded)
    )
    return first[:SHORT] == second[:SHORT] or CAUSE in text_of(error)


def _same_error(error: BaseException, text: str, recorded: str) -> bool:
    """True if this is the recorded error. The texts may differ, because a driver's own text about its failure is not
    recorded, and events contain only the beginning of a long text."""
    if not recorded:
        return False
    if CAUSE in text or isinstance(error, DriverError):
        failures = getattr(error, "failures", ())
        if any(failure.path in recorded for failure in failures):  # it names some of them
            return True
        return not failures and text.partition(CAUSE)[0][:MAX_COMPARED] in recorded
    return recorded.startswith((text.partition("\n")[0][:MAX_COMPARED], type(error).__name__))
