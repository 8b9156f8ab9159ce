"""`umo recording replay`: replay a recording, and print the first difference."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from umo.cycle.fault_log import FaultLog
from umo.cycle.frame import Frame
from umo.errors import FramesError, OptionError, UmoError
from umo.exit_status import ExitStatus
from umo.operation.commands.client_commands import Mode
from umo.recording.replay.code_given import CodeGiven
from umo.recording.replay.opening import opened, other_hash_seed
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import Replay
from umo.recording.replay.stops import BreakCondition, Stop
from umo.recording.replay.tape import NotReplayable, Tape, events_of
from umo.recording.replay.what_if import RawCurves
from umo.system.packages import how_to_install
from umo.system.streams import limit_waits
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.run.event_lines import EventLines
from umo_command.shared import begin_again
from umo_command.values import check_picture

LOOK_PERIODS = 199
"""Number of periods between two updates of the progress."""


def replay_file(
    file: Path,
    code: CodeGiven,
    given: Sequence[str],
    plot: Path | None,
    at: str | None = None,
    condition: str | None = None,
) -> int:
    """Replay a recording and return the exit status. `given`: the numbers that are changed, as PATH=VALUE. `at`,
    `condition`: where to stop in the debugger."""
    check_picture(plot)
    settings = dict(map(setting, given))
    stop, expression = at and Stop.parse(at), condition and BreakCondition(condition)
    try:
        with opened(file) as tape:
            if (seed := other_hash_seed(tape.layout.about)) is not None:
                begin_again(seed)
            if stop or expression:
                return _debug(tape, code, settings, stop or None, expression or None)
            limit_waits()
            return _replay(tape, file, code, settings, plot)
    except (NotReplayable, FramesError) as error:
        say(str(error), "red")
        return ExitStatus.MISTAKE


def setting(text: str) -> tuple[str, Any]:
    """Return the path and the value in a string PATH=VALUE. The value is a number, true or false, or a string. Raises
    OptionError for any other string."""
    path, equals, value = text.partition("=")
    if not equals or not path.strip() or not value.strip():
        raise OptionError(f"--set {text!r}: write for example z.servo.gain=0.004")
    try:
        return path.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


class ReplayProgress:
    """An observer that shows the progress of a replay."""

    def __init__(self, line: OneLine, tape: Tape) -> None:
        ends = [event.time for event in events_of(tape) if event.is_end]
        self._line, self._end = line, ends[-1] if ends else 0.0
        self._periods = 0

    def __call__(self, frame: Frame) -> None:
        self._periods += 1
        if self._periods % LOOK_PERIODS == 0:
            share = min(frame.time / self._end, 1.0) if self._end else None
            self._line.show(frame.time, "replaying" if err.is_terminal else "", share)


def _replay(tape: Tape, file: Path, code: CodeGiven, settings: Mapping[str, object], plot: Path | None) -> int:
    replay = Replay(tape, Program.of(tape, code), settings)
    curves = RawCurves(replay)
    with OneLine(err) as line:
        mode = Mode.MANUAL if replay.program.manual else Mode.AUTOMATIC
        lines = EventLines(line.note, mode, clock=lambda: replay.connection.machine.clock.now)
        faults = FaultLog()

        def add_events(frame: object = None) -> None:
            for event in faults.add_new(replay.connection.machine.events):
                lines.add(event)

        replay.observers += [ReplayProgress(line, tape), add_events]
        if settings:
            replay.observers.append(curves)
        result = replay.run()
        add_events()
        lines.look(is_over=True)
    out.print(str(result), soft_wrap=True, markup=False, highlight=False)
    if settings and result.difference is not None:
        _draw(curves, plot or file.with_suffix(".what-if.png"), result.settings)
    return result.status


def _debug(
    tape: Tape, code: CodeGiven, settings: Mapping[str, object], stop: Stop | None, condition: BreakCondition | None
) -> int:
    from umo.recording.replay import snapshots

    if not snapshots.POSSIBLE:
        raise NotReplayable("--at and --break need Linux, because the debugger goes back with forks of its process")
    from umo.recording.replay.debugger import DebuggedReplay
    from umo.recording.replay.snapshots import Runner, SnapshotList

    def begin(runner: Runner) -> int:
        try:
            replay = Replay(tape, Program.of(tape, code), settings)
        except UmoError as error:
            say(str(error), "red")
            return ExitStatus.MISTAKE
        line = OneLine(err)
        debugged = DebuggedReplay(replay, runner, stop, condition, ReplayProgress(line, tape))
        debugged.clear = line.__exit__
        result = replay.run()
        debugged.clear()
        print(result, flush=True)
        if debugged.has_stopped:
            return result.status
        if condition is not None:
            failed = f" (its last evaluation failed: {condition.failed})" if condition.failed else ""
            say(f"--break {condition.text!r} never became true{failed}")
        if stop is not None and not stop.difference:
            say(f"--at: the replay has {result.periods:,} periods, and did not reach this one", "red")
            return ExitStatus.MISTAKE
        return result.status

    return SnapshotList().run(begin)


def _draw(curves: RawCurves, path: Path, settings: Mapping[str, Any]) -> None:
    from umo_command.recording.replay_plot import save_what_if

    if not curves.different():
        say("no plot: the difference is not a command of an actuator, or is too short to plot")
        return
    try:
        save_what_if(curves, path, settings)
    except ImportError:
        say(f"no plot: matplotlib is not installed ({how_to_install('plot')})")
    except OSError as error:
        say(f"{path}: {error.strerror}", "red")
    else:
        out.print(f"plot: {path}", soft_wrap=True, markup=False)
