"""The debugger of a replay. It stops in the control code of a period, with the machine in the state of that time, and
goes back and forth. It stops after the `sample` of a period. The sensors then have the values of the period, and the
control code is about to act. The prompt opens at the next line of the user's code. If a sequence waits, that line is in
the sequence.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable
from functools import partial
from types import CodeType, FrameType
from typing import Any

from umo.cycle.frame import Frame
from umo.drivers.optional import WaitEnded
from umo.errors import OptionError, text_of
from umo.exit_status import ExitStatus
from umo.recording.replay.debugger_prompt import ReplayPdb, stand_in
from umo.recording.replay.replaying import Replay
from umo.recording.replay.snapshots import EVERY, MOST, START, Runner
from umo.recording.replay.stops import BreakCondition, FirstDifference, Stop
from umo.user_code import Raised


class DebuggedReplay:
    """An observer that can stop a replay. `look` is called in each period."""

    def __init__(
        self,
        replay: Replay,
        runner: Runner,
        at: Stop | None,
        condition: BreakCondition | None,
        look: Callable[[Frame], object] = lambda frame: None,
    ) -> None:
        self.replay, self.runner = replay, runner
        self._stop, self._condition, self._look = at or Stop(), condition, look
        self.clear: Callable[[], object] = lambda: None
        """Function that clears the line of the progress."""
        self.has_stopped = False
        """True if it has stopped at least once."""
        self._found: FirstDifference | None = None
        """The first difference, or None if it is not known yet."""
        self._interrupted = self._in_prompt = False
        self._looked = self._said = START
        """`_looked`: the last period in which the stop was checked. `_said`: the last period that was printed."""
        self._prompt = ReplayPdb(self)
        replay.on_connected = self._begin
        replay.observers.append(self)

    def _begin(self) -> None:
        """Prepare the debugging. Called when the machine is connected and no period has begun. From now on Ctrl-C
        interrupts the debugger."""
        signal.signal(signal.SIGINT, self._interrupt)
        program = self.replay.program
        root: dict[str, Any] = vars(program.machine)
        root["sample"] = partial(self._sample, root["sample"])
        program.drive = partial(self._drive, program.drive)
        self._snapshot(START, 0.0)

    # In each period ------------------------------------------------------------------------------------

    def _sample(self, sample: Callable[[], bool]) -> bool:
        try:
            return sample()
        finally:
            self._guarded(self._sampled)

    def _sampled(self) -> None:
        """Check whether to stop. Called when the sensors of a period were read. A program can sample more than once in
        a period."""
        player = self.replay.player
        period = player.period
        if period is None or player.shown == self._looked:
            return
        self._looked = player.shown
        if not self._is_to_stop(player.shown, period.time):
            return
        if os.environ.get("PYTHONBREAKPOINT"):
            self.arrive()
            with self.replay.paused():
                stand_in(self.replay.program.machine, player.shown, period.time, self, breakpoint)
        else:
            self._prompt.seek(self.replay.connection.machine)

    def _is_to_stop(self, period: int, time: float) -> bool:
        last = self.replay.player.next is None
        found = (self.has_stopped and last) or self._interrupted or self._stop.is_at(period, time, last)
        if self._condition is not None:
            with self.replay.paused():
                became = self._condition.becomes_true(self.replay.program.machine, period, time)
            found |= became and self._stop == Stop()  # not on the way to another place
        return found

    def __call__(self, frame: Frame) -> None:
        self._guarded(partial(self._shown, frame))

    def _shown(self, frame: Frame) -> None:
        """Check for stops and make snapshots. Called when a period is over."""
        self._sampled()  # where the program did not sample the whole machine
        period, difference = self.replay.player.shown, self.replay.result.difference
        if self._prompt.seeking:  # there was no line of the user's code
            self._stand("none of your code ran in this period: this is the end of the period")
        if difference is not None and self._found is None:
            self._found = FirstDifference(period, str(difference))
            if self.has_stopped or self._stop.difference:
                self._travel(Stop(period=period))
        elif difference is not None and self._found and self._found.period == period and not self.replay.player.lenient:
            self._stand("the replay ends with this difference: this is the end of its period")
        self._look(frame)
        if period % EVERY == EVERY - 1 and not self._is_far(period):
            self._snapshot(period, frame.time)

    def _is_far(self, period: int) -> bool:
        """True if a snapshot of this period would be dropped before the replay stops."""
        return self._stop.period is not None and self._stop.period - period > EVERY * (MOST + 1)

    def _snapshot(self, period: int, time: float) -> None:
        """Fork a snapshot. A process that continues from the snapshot takes the orders that it has received."""
        if period in self.runner.known:
            return
        sys.stdout.flush()
        self.runner.snapshot(period, time)
        orders, self.runner.orders = self.runner.orders, {}
        if not orders:
            return
        sys.settrace(None)
        signal.signal(signal.SIGINT, self._interrupt)
        self.has_stopped, self._stop = True, Stop(**orders["stop"])
        self._found = None if orders["found"] is None else FirstDifference(*orders["found"])
        self._said, self._interrupted, self._in_prompt = START, False, False
        self._prompt = ReplayPdb(self)
        self._prompt.restore(orders["prompt"])

    def _guarded(self, work: Callable[[], object]) -> None:
        """Call a function, and end the replay if it fails. Otherwise the failing observer would be dropped, or its
        error would reach the control code."""
        try:
            work()
        except OptionError as error:
            self._give_up(str(error), ExitStatus.MISTAKE)
        except BaseException:
            self._give_up(traceback.format_exc().rstrip(), ExitStatus.FAILED)

    def _give_up(self, text: str, status: ExitStatus) -> None:
        self.clear()
        print(text, file=sys.stderr, flush=True)
        self.runner.end(status)

    # Stopping ------------------------------------------------------------------------------------------

    def arrive(self) -> None:
        """Record that the prompt opens."""
        self._stop, self._interrupted, self.has_stopped = Stop(), False, True
        self.clear()
        self._say()

    def _say(self) -> None:
        """Print the period, once."""
        player = self.replay.player
        if player.period is None or player.shown == self._said:
            return
        self._said = player.shown
        print(f"period {player.shown:,}, {player.period.time:g} s")
        if self._found is not None and self._found.period == player.shown:
            print(self._found.text)
        if player.next is None:
            print("the recording ends here")
        self.say_places()

    def say_places(self) -> None:
        for place in filter(None, self.replay.connection.machine.sequences.places):
            print(f"  a sequence stands at {place}")

    def _stand(self, why: str) -> None:
        """Stop at the end of a period, outside of the user's code."""
        period = self.replay.player.period
        self.arrive()
        print(why)
        time = 0.0 if period is None else period.time
        stand_in(self.replay.program.machine, self.replay.player.shown, time, self, self._prompt.begin)

    def _drive(self, drive: Callable[[Any], Any], machine: Any) -> Any:
        """Run the program. If an error ends it, stop once more before the error is raised."""
        try:
            return drive(machine)
        except WaitEnded:
            raise
        except BaseException as error:
            self._guarded(partial(self._failed, error))
            raise

    def _failed(self, error: BaseException) -> None:
        sys.settrace(None)
        known = self.replay.result.difference is not None  # its own error follows from this one
        if known or not (self.has_stopped or self._stop.end) or os.environ.get("PYTHONBREAKPOINT"):
            return
        self.arrive()
        print(f"the replay ends with {Raised(type(error), text_of(error))}")
        self._prompt.reset()
        self._prompt.interaction(None, error.__traceback__)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle Ctrl-C. The prompt begins a new line. A replay stops in its next period. At a second Ctrl-C it stops
        at its present line, because the control code may never return."""
        if self._in_prompt:
            raise KeyboardInterrupt
        if self._interrupted and not self._prompt.seeking:
            self._prompt.seek(self.replay.connection.machine, frame)
        self._interrupted = True

    @property
    def around(self) -> CodeType:
        """Return the file and the function that call the program."""
        return type(self)._drive.__code__

    def in_prompt(self, yes: bool) -> None:
        """Set whether the prompt waits for a line."""
        self._in_prompt = yes

    # Where to ------------------------------------------------------------------------------------------

    def back(self, count: int = 1) -> None:
        """Go a number of periods back."""
        self.to(str(max(self.replay.player.shown - count, 0)))

    def step(self, count: int = 1) -> None:
        """Go a number of periods forward. Raises OptionError at the end of the recording."""
        if self.replay.player.next is None:
            raise OptionError("the recording ends here")
        self._stop = Stop(period=self.replay.player.shown + max(count, 1))

    def to(self, place: str) -> None:
        """Go to a time, a period, the first difference or the end. Raises OptionError for any other string."""
        stop, player = Stop.parse(place), self.replay.player
        if stop.difference and self._found is not None:
            stop = Stop(period=self._found.period)
        time = 0.0 if player.period is None else player.period.time
        behind = player.period is None or stop.is_at(player.shown, time, player.next is None)
        if behind or stop.nearest(self.runner.known) > player.shown:
            self._travel(stop)
        self._stop = stop

    def _travel(self, stop: Stop) -> None:
        """Continue from the nearest snapshot in another process, and end this process."""
        sys.stdout.flush()
        found = None if self._found is None else list(self._found)
        self.runner.go(
            period=stop.nearest(self.runner.known), stop=vars(stop), found=found, prompt=self._prompt.saved()
        )

    def quit(self) -> None:
        self.clear()
        sys.stdout.flush()
        self.runner.end(ExitStatus.DONE)
