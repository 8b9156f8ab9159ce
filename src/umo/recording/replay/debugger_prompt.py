"""pdb with commands to move through the periods of a replay."""

from __future__ import annotations

import bdb
import inspect
import os
import pdb
import sys
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any, Protocol, cast

from umo.cycle.machine import ConnectedMachine
from umo.errors import OptionError
from umo.objects import Compound
from umo.objects.paths import children
from umo.recording.replay.replaying import Replay
from umo.text import is_users

HELP = """\
back [N]      N periods back (1)      to TIME|PERIOD|first-difference|end   there, back or forth
step [N]      N periods on (1)        continue                              on to the next --break, or the end
where         where the sequences stand; m and the names of its parts are known everywhere
The rest is pdb's: p m.z.encoder.read(), b FILE:LINE, n, s (a line), w (the stack), q"""
MAX_HISTORY = 500
"""Number of lines of the command history that are passed on to another period."""


class Debugged(Protocol):
    """The interface of the replay that the prompt uses (`umo.recording.replay.debugger.DebuggedReplay`)."""

    replay: Replay

    @property
    def around(self) -> CodeType:
        """Return the file and the function that call the program."""

    def arrive(self) -> None:
        """Record that the prompt opens."""

    def in_prompt(self, yes: bool) -> None:
        """Set whether the prompt waits for a line."""

    def say_places(self) -> None:
        """Print the lines at which the sequences wait."""

    def back(self, count: int) -> None:
        """Go back by this number of periods."""

    def step(self, count: int) -> None:
        """Go forward by this number of periods."""

    def to(self, place: str) -> None:
        """Go to a place, given as a string."""

    def quit(self) -> None:
        """End the replay."""


def stand_in(m: Compound, period: int, time: float, replay: Debugged, begin: Callable[[], object]) -> None:
    """Do nothing. A replay stops in this function if no code of the user is running. `m` is the machine, `replay` has
    `back`, `step` and `to`."""
    begin()


class ReplayPdb(pdb.Pdb):
    """The prompt. It stops only in the user's code."""

    def __init__(self, debugged: Debugged) -> None:
        stdin = None if sys.stdin.isatty() else _Lines()
        super().__init__(stdin=stdin, stdout=None if stdin is None else sys.stdout, nosigint=True)  # type: ignore[arg-type]
        self._debugged = debugged
        self.prompt = "(replay) "
        machine = debugged.replay.program.machine
        self._folder = os.path.dirname(inspect.getsourcefile(type(machine)) or "") + os.sep
        """The folder of the machine's code, which may be an installed package."""
        self.seeking = False
        """True if the prompt stops in the first line of the user's code."""
        self._waiting: list[FrameType] = []
        """The innermost frames of the user's code in the sequences."""

    # Where it stops ------------------------------------------------------------------------------------

    def seek(self, machine: ConnectedMachine, frame: FrameType | None = None) -> None:
        """Stop at the next line of the user's code, or in the sequence that is resumed first."""
        self.seeking = True
        self._waiting = [
            found[-1] for each in machine.sequences.frames if (found := list(filter(self._is_users, each)))
        ]
        self.set_trace(frame or sys._getframe())

    def begin(self) -> None:
        """Stop in `stand_in`, which calls this method."""
        caller = sys._getframe().f_back
        self.seeking = False
        self.set_trace(caller)
        self.interaction(caller, None)

    def _is_users(self, frame: FrameType) -> bool:
        file = frame.f_code.co_filename
        return is_users(file) or (len(self._folder) > 1 and file.startswith(self._folder))

    def stop_here(self, frame: FrameType) -> bool:
        return self._is_users(frame) and bool(super().stop_here(frame))

    def user_call(self, frame: FrameType, argument_list: Any) -> None:
        if not self.seeking:
            super().user_call(frame, argument_list)
        elif any(frame is each for each in self._waiting):  # a sequence goes on; others are entered line by line
            self.interaction(frame, None)

    def interaction(self, frame: FrameType | None, traceback: Any) -> None:
        """Run the prompt. Reading values in the prompt does not affect the replay."""
        self.seeking, self._waiting = False, []
        self._debugged.arrive()
        with self._debugged.replay.paused():
            super().interaction(frame, traceback)

    def cmdloop(self, intro: Any = None) -> None:
        self._debugged.in_prompt(True)
        try:
            super().cmdloop(intro)
        finally:
            self._debugged.in_prompt(False)

    def get_stack(self, f: FrameType | None, t: Any) -> Any:
        """Return the stack without the frames of the code that calls the program."""
        stack, index = super().get_stack(f, t)
        outer = [number + 1 for number, (each, _) in enumerate(stack) if each.f_code is self._debugged.around]
        first = outer[-1] if outer and outer[-1] <= index else 0
        return stack[first:], index - first

    def setup(self, f: FrameType | None, tb: Any) -> Any:
        done = super().setup(f, tb)
        if f is None:  # an error: where the user's code is
            own = [number for number, (each, _) in enumerate(self.stack) if self._is_users(each)]
            self.curindex = own[-1] if own else self.curindex
            self.curframe = self.stack[self.curindex][0]
            self.curframe_locals = self.curframe.f_locals
        self._name_parts()
        return done

    def _select_frame(self, number: int) -> None:
        super()._select_frame(number)
        self._name_parts()

    def _name_parts(self) -> None:
        """Define the names of the machine and its parts in the prompt, except names that the code at the stop uses
        itself."""
        frame = self.curframe
        if frame is None or frame.f_code.co_name == "<module>":
            return
        machine, names = self._debugged.replay.program.machine, cast("dict[str, Any]", self.curframe_locals)
        taken = {*frame.f_code.co_varnames, *frame.f_code.co_freevars, *frame.f_code.co_cellvars, *frame.f_globals}
        for name, part in {**children(machine), "m": machine, "replay": self._debugged}.items():
            if name not in taken:
                names.setdefault(name, part)

    def print_stack_entry(self, frame_lineno: Any, prompt_prefix: str = "\n-> ") -> None:
        if frame_lineno[0].f_code is not stand_in.__code__:
            super().print_stack_entry(frame_lineno, prompt_prefix)

    # Commands ------------------------------------------------------------------------------------------

    def _go(self, move: Callable[[], None], straight: bool = False) -> bool | None:
        """Move to another place of the replay. With `straight` the replay does not stop at breakpoints on the way."""
        try:
            move()
        except OptionError as error:
            self.error(str(error))
            return None
        self.set_continue()
        if straight:
            sys.settrace(None)
        return True

    def do_back(self, arg: str) -> bool | None:
        """back [N]: go back by N periods."""
        return self._go(lambda: self._debugged.back(_count(arg)), straight=True)

    def do_step(self, arg: str) -> bool | None:
        """step [N]: go forward by N periods."""
        return self._go(lambda: self._debugged.step(_count(arg)))

    def do_to(self, arg: str) -> bool | None:
        """to TIME|PERIOD|first-difference|end: go to this place."""
        return self._go(lambda: self._debugged.to(arg), straight=True)

    def do_s(self, arg: str) -> Any:
        """s: go to the next line, into functions."""
        return super().do_step(arg)

    def do_next(self, arg: str) -> Any:
        """n: go to the next line."""
        return self.do_s(arg) if self.curframe and self.curframe.f_code is stand_in.__code__ else super().do_next(arg)

    do_n = do_next

    def do_where(self, arg: str) -> None:
        """where: print the places of the sequences."""
        self._debugged.say_places()

    def do_help(self, arg: str) -> bool | None:
        """h [COMMAND]: print what a command does."""
        if arg:
            return super().do_help(arg)
        self.message(HELP)
        return None

    do_h = do_help

    def do_quit(self, arg: str) -> bool | None:
        """q: end the replay."""
        self._debugged.quit()
        return True

    do_q = do_exit = do_EOF = do_quit

    # To another period ---------------------------------------------------------------------------------

    def saved(self) -> dict[str, Any]:
        """Return the state that is passed on to another period: breakpoints, aliases, and the history of lines."""
        points = [each for each in bdb.Breakpoint.bpbynumber if each is not None]
        breaks = [[each.file, each.line, each.temporary, each.cond, each.enabled] for each in points]
        history: list[str] = []
        if line := sys.modules.get("readline"):
            last = line.get_current_history_length()
            history = [line.get_history_item(each) or "" for each in range(max(1, last - MAX_HISTORY), last + 1)]
        return {"breaks": breaks, "aliases": self.aliases, "history": history}

    def restore(self, saved: dict[str, Any]) -> None:
        bdb.Breakpoint.clearBreakpoints()
        self.breaks: dict[str, list[int]] = {}
        for file, line, temporary, condition, enabled in saved["breaks"]:
            self.set_break(file, line, temporary, condition)
            if not enabled:
                bdb.Breakpoint.bpbynumber[-1].disable()  # type: ignore[union-attr]
        self.aliases = dict(saved["aliases"])
        if line := sys.modules.get("readline"):
            line.clear_history()
            for each in saved["history"]:
                line.add_history(each)


def _count(text: str) -> int:
    """Return a number of periods; the default is 1. Raises OptionError if the text is not a whole number of at least
    1."""
    if text and not (text.isdecimal() and int(text)):
        raise OptionError(f"{text!r} is not a number of periods")
    return int(text or 1)


class _Lines:
    """Reads lines of stdin without reading ahead, because another process may continue with the remaining lines."""

    def readline(self) -> str:
        line = b""
        while not line.endswith(b"\n") and (byte := os.read(0, 1)):
            line += byte
        return line.decode(errors="replace")
