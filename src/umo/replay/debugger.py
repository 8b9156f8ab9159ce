"""The debugger of a replay: it stops at the end of a period with the machine as it was, and goes back and forth."""

from __future__ import annotations

import os
import pdb
import signal
import sys
import traceback
from collections.abc import Callable
from types import FrameType, FunctionType
from typing import Any

from umo.cycle.frame import Frame
from umo.errors import UmoError
from umo.objects import Compound
from umo.objects.paths import children
from umo.replay.replaying import Replay
from umo.replay.snapshots import EVERY, Runner
from umo.replay.stops import BreakCondition, Stop

HELP = """\
back N        N periods back          to TIME|PERIOD|first-difference   there, back or forth
step [N]      N periods on (1)        continue                          on to the next --break, or the end
where         where the sequences stand; the rest is pdb's: p m.z.encoder.read(), b FILE:LINE, n, s (a line), q"""


class DebuggedReplay:
    """An observer of a replay that stops it. `look` is called in each period."""

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
        self._interrupted = False
        self.has_stopped = False
        """Whether it has stopped at all."""
        replay.on_connected = self._begin

    def _begin(self) -> None:
        """The machine is connected: Ctrl-C stops the replay in the debugger, not the machine."""
        signal.signal(signal.SIGINT, self._interrupt)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupted = True

    def __call__(self, frame: Frame) -> None:
        try:
            self._watch(frame)
        except BaseException:  # an observer that fails would be left out
            traceback.print_exc()
            self.runner.end(1)

    def _watch(self, frame: Frame) -> None:
        period = self.replay.player.shown
        if period % EVERY == 0 and period not in self.runner.known:
            sys.stdout.flush()
            self.runner.snapshot(period)
            self._take_orders()
        self._look(frame)
        if self._is_to_stop(period, frame.time):
            self._pause(period, frame.time)

    def _take_orders(self) -> None:
        """In a process that goes on from a snapshot: where to."""
        orders = self.runner.orders
        if orders:
            self.has_stopped = True
            self._stop = Stop(**orders["stop"])
            self.runner.orders = {}
            signal.signal(signal.SIGINT, self._interrupt)

    def _is_to_stop(self, period: int, time: float) -> bool:
        differs = self.replay.result.difference is not None
        at_the_end = self.has_stopped and (self.replay.player.next is None or differs)
        found = at_the_end or self._interrupted or self._stop.is_at(period, time, differs)
        if self._condition is not None:
            with self.replay.paused():
                became = self._condition.becomes_true(self.replay.program.machine, period, time)
            found |= became and self._stop == Stop()  # not on the way to another place
        return found

    def _pause(self, period: int, time: float) -> None:
        self._stop, self._interrupted, self.has_stopped = Stop(), False, True
        self.clear()
        self._say(period, time)
        if os.environ.get("PYTHONBREAKPOINT"):
            with self.replay.paused():
                _stopped(self.replay.program.machine, period, time, self, breakpoint)
        else:
            _stopped(self.replay.program.machine, period, time, self, ReplayPdb(self).begin)

    def _say(self, period: int, time: float) -> None:
        print(f"period {period:,}, {time:g} s")
        if self.replay.result.difference is not None:
            print(self.replay.result.difference)
        elif self.replay.player.next is None:
            print("the recording ends here")
        self.say_places()

    def say_places(self) -> None:
        for place in filter(None, self.replay.connection.machine.sequences.places):
            print(f"  a sequence stands at {place}")

    # Where to ------------------------------------------------------------------------------------------

    def back(self, count: int = 1) -> None:
        """So many periods back."""
        self.to(str(max(self.replay.player.shown - count, 0)))

    def step(self, count: int = 1) -> None:
        """So many periods on."""
        self._stop = Stop(period=self.replay.player.shown + count)

    def to(self, place: str) -> None:
        """To a time, a period or the first difference."""
        stop, player, frame = Stop.parse(place), self.replay.player, self.replay.connection.machine.frame
        if stop.is_at(player.shown, frame.time, False) or self.replay.result.difference is not None:
            first = stop.period if stop.period is not None else self._period_before(stop)
            sys.stdout.flush()
            self.runner.go(period=first, stop=vars(stop))
        self._stop = stop

    def _period_before(self, stop: Stop) -> int:
        """A period that is not after this time; 0 for what has no time."""
        if stop.time is None:
            return 0
        frame, player = self.replay.connection.machine.frame, self.replay.player
        period = self.replay.connection.machine.period or 1.0
        behind = (frame.time - stop.time) / period
        return max(int(player.shown - behind) - 1, 0) if frame.number == player.shown + 1 else 0

    def quit(self) -> None:
        sys.stdout.flush()
        self.runner.end(0)


def _place(m: Compound, period: int, time: float, replay: DebuggedReplay, begin: Callable[[], object]) -> None:
    """The place at which a replay stops: `m` is the machine, `replay` has `back`, `step` and `to`."""
    begin()
    return


SKIPPED = ["umo.replay.*", "umo.cycle.*", "umo.user_code", "umo.objects.*", "contextlib"]
"""Modules through which a debugger goes without a stop, on its way to the user's code."""
_stopped = FunctionType(
    _place.__code__, {"__name__": "replay", "__builtins__": __builtins__}
)  # in a module that is not passed over


class ReplayPdb(pdb.Pdb):
    """pdb, with commands that go through the periods of a replay."""

    def __init__(self, debugged: DebuggedReplay) -> None:
        stdin = None if sys.stdin.isatty() else _Lines()
        super().__init__(stdin=stdin, stdout=sys.stdout, skip=SKIPPED, nosigint=True)  # type: ignore[arg-type]
        self._debugged = debugged
        self.prompt = "(replay) "

    def begin(self) -> None:
        """Stop in who calls."""
        self.set_trace(sys._getframe().f_back)

    def setup(self, f: FrameType | None, tb: Any) -> None:
        super().setup(f, tb)
        if f is not None and f.f_code is _place.__code__:  # the parts of the machine have their names here
            self.curframe_locals: dict[str, Any] = {**children(f.f_locals["m"]), **self.curframe_locals}

    def interaction(self, *place: Any) -> None:
        """What is looked at in the prompt is no part of the replay."""
        with self._debugged.replay.paused():
            super().interaction(*place)

    def print_stack_entry(self, frame_lineno: Any, prompt_prefix: str = "\n-> ") -> None:
        if frame_lineno[0].f_code is not _place.__code__:
            super().print_stack_entry(frame_lineno, prompt_prefix)

    def _go(self, move: Callable[[], None]) -> bool | None:
        try:
            move()
        except (UmoError, ValueError) as error:
            self.error(str(error))
            return None
        self.set_continue()
        return True

    def do_back(self, arg: str) -> bool | None:
        """back [N]: N periods back."""
        return self._go(lambda: self._debugged.back(int(arg or 1)))

    def do_step(self, arg: str) -> bool | None:
        """step [N]: N periods on."""
        return self._go(lambda: self._debugged.step(int(arg or 1)))

    def do_to(self, arg: str) -> bool | None:
        """to TIME|PERIOD|first-difference."""
        return self._go(lambda: self._debugged.to(arg))

    def do_s(self, arg: str) -> Any:
        """s: a line on, into functions."""
        return super().do_step(arg)

    def do_where(self, arg: str) -> None:
        """where: the places of the sequences."""
        self._debugged.say_places()

    def do_help(self, arg: str) -> bool | None:
        if arg:
            return super().do_help(arg)
        self.message(HELP)
        return None

    do_h = do_help

    def do_quit(self, arg: str) -> bool | None:
        """quit: end the replay."""
        self._debugged.quit()
        return True

    do_q = do_exit = do_EOF = do_quit


class _Lines:
    """Lines of stdin, without reading ahead: another process may go on with the rest."""

    def readline(self) -> str:
        line = b""
        while not line.endswith(b"\n") and (byte := os.read(0, 1)):
            line += byte
        return line.decode(errors="replace")
