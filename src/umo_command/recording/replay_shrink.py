"""`umo recording shrink`: finds the fewest periods of a recording that still give its error or difference, and writes
them as a recording or a test."""

from __future__ import annotations

import logging
import os
import re
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from pprint import pformat
from typing import Any

from umo.exit_status import ExitStatus
from umo.process.station import packaged
from umo.recording.replay.closed_loop import ClosedShrinking, Trial, recorded_trial
from umo.recording.replay.code_given import CodeGiven, other_code
from umo.recording.replay.opening import opened, other_hash_seed
from umo.recording.replay.shrinking import ReplayedError, Shrinking, ShrunkTape, periods_left
from umo.recording.replay.tape import NotReplayable, Tape
from umo.text import count_of, shown_path
from umo.wiring.parameters import option_words
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.shared import begin_again

RECORDING, TEST = ".mcap", ".py"


def shrink_file(file: Path, code: CodeGiven, output: Path | None, seconds: float, closed: bool) -> int:
    """Shrink a recording. Return the exit status. `output`: the file for a recording or a test. `closed`: True to
    replay in closed loop with the plant."""
    target = output or (None if closed else file.with_suffix(".shrunk.mcap"))
    if (mistake := _mistake(target, closed)) is not None:
        say(mistake, "red")
        return ExitStatus.MISTAKE
    try:
        with _without_warnings(), opened(file) as tape:
            if (seed := other_hash_seed(tape.layout.about)) is not None:
                begin_again(seed)
            if closed:
                return _shrink_closed(tape, file, code, target, seconds)
            assert target is not None
            return _shrink(Shrinking(tape, code), file, code, target, seconds)
    except NotReplayable as error:
        say(str(error), "red")
        return ExitStatus.MISTAKE


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Return a context without warnings: otherwise hundreds of failing replays would each print theirs."""
    log = logging.getLogger("umo")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def _mistake(target: Path | None, closed: bool) -> str | None:
    if target is None:
        return None
    if target.suffix not in ((TEST,) if closed else (TEST, RECORDING)):
        return f"{target}: write a test (.py)" + ("" if closed else " or a recording (.mcap)")
    for each in {target, target if closed else target.with_suffix(RECORDING)}:
        if each.exists():
            return f"{each} exists already; give another file with -o"
    if not target.parent.is_dir():
        return f"{target}: there is no folder {target.parent}"
    return None


def _searched(search: Callable[[Callable[[], bool]], Any], left: Callable[[], str], seconds: float) -> str:
    """Search, and show the progress on a line. Return the reason in brackets if the search ended early, otherwise
    ""."""
    begun = time.monotonic()
    with OneLine(err) as line:

        def go_on() -> bool:
            passed = time.monotonic() - begun
            line.show(passed, f"{left()} left" if err.is_terminal else "", min(passed / seconds, 1.0))
            return passed < seconds

        try:
            search(go_on)
        except KeyboardInterrupt:
            return " (ended by Ctrl-C)"
    return f" (ended after {seconds:g} s)" if time.monotonic() - begun >= seconds else ""


def _shrink(shrinking: Shrinking, file: Path, code: CodeGiven, target: Path, seconds: float) -> int:
    begun = shrinking.source.count
    ended = _searched(shrinking.run, lambda: count_of(len(shrinking.places), "period"), seconds)
    count, is_error = len(shrinking.places), isinstance(shrinking.ending, ReplayedError)
    _save(shrinking.source.chosen(shrinking.places), target.with_suffix(RECORDING))
    what = "error" if is_error else "first difference"
    if target.suffix == TEST:
        facts = f"{count:,} of {begun:,} periods of {file.name}, in open loop: the {what} follows from these inputs."
        function = "assert_no_error" if is_error else "assert_replays"
        text = _comment(shrinking.ending.text)
        target.write_text(
            _TEST.format(
                what=what, facts=_comment(facts), text=text, function=function, code=_as_arguments(code, target)
            )
        )
    left = f"{count_of(begun, 'period')}, {count:,} left{ended}: {periods_left(shrinking.places.tolist())}"
    out.print(f"{left}\nin open loop they give the same {what}: {shrinking.ending.text}", markup=False, soft_wrap=True)
    if shrinking.code:
        say(shrinking.code)
    out.print(f"{shrinking.replays} replays; written: {target}", markup=False, soft_wrap=True)
    return ExitStatus.DONE


def _shrink_closed(tape: Tape, file: Path, code: CodeGiven, target: Path | None, seconds: float) -> int:
    shrinking = ClosedShrinking(recorded_trial(tape, code))
    begun = shrinking.trial
    if changed := other_code(tape.job, Path(begun.station)):
        say(changed)
    ended = _searched(shrinking.run, lambda: _counts(shrinking.trial), seconds)
    trial = shrinking.trial
    out.print(f"{_counts(begun)}; left{ended}: {_counts(trial)}", markup=False, soft_wrap=True)
    out.print(f"in closed loop with its plant the station gives the same error: {shrinking.ending.text}", markup=False,
              soft_wrap=True)  # fmt: skip
    out.print(_command(trial), markup=False, soft_wrap=True, highlight=False)
    for number, content in trial.commands:
        out.print(f"  at tick {number}: {dict(content)}", markup=False, soft_wrap=True, highlight=False)
    if target is not None:
        text = _comment(shrinking.ending.text)
        target.write_text(_CLOSED_TEST.format(file=_comment(file.name), text=text, trial=_shown(trial)))
        out.print(f"{shrinking.trials} runs; written: {target}", markup=False, soft_wrap=True)
    return ExitStatus.DONE


def _counts(trial: Trial) -> str:
    kinds = ((trial.faults, "fault"), (trial.options, "option"), (trial.commands, "command"))
    return ", ".join(count_of(len(found), noun) for found, noun in kinds)


def _command(trial: Trial) -> str:
    """Return the trial as a command line of `umo run`, without the commands of clients."""
    name = Path(trial.station).name
    is_shipped = packaged(name) == Path(trial.station)
    words = ["umo", "run", name if is_shipped else shown_path(trial.station)]
    words += [word for each in trial.faults for word in ("--fault", each)]
    if trial.faults and trial.fixed.get("fault_seed"):
        words += ["--fault-seed", str(trial.fixed["fault_seed"])]
    words += [word for name, value in trial.options.items() for word in option_words(name, value)]
    return shlex.join(words)


def _as_arguments(code: CodeGiven, target: Path) -> str:
    """Return the code that the command line named, as arguments of a test. Folders and files are relative to the folder
    of the test."""

    def shown(text: str) -> str:
        place, colon, names = text.partition(":")
        if not Path(place).exists():
            return repr(text)
        relative = os.path.relpath(Path(place).resolve(), target.parent.resolve())
        path = f"Path(__file__).parent / {relative!r}"
        return f'f"{{{path}}}{colon}{names}"' if colon else path

    given = [("station", code.station), ("wiring", code.wiring)]
    return "".join(f", {name}={shown(text)}" for name, text in given if text is not None)


def _comment(text: str) -> str:
    """Return one line that ends no text of Python."""
    return re.sub(r"[\s\"\\\\]+", " ", text)[:300].strip()


def _shown(trial: Trial) -> str:
    """Return a trial as a Python expression."""
    rows = (f"        {name}={pformat(value, width=100)}," for name, value in vars(trial).items())
    return "Trial(\n" + "\n".join(rows) + "\n    )"


_TEST = '''"""{facts}

Made by umo recording shrink. The {what}: {text}
It fails as long as the control code gives it.
"""
from pathlib import Path
from umo.testing import {function}


def test_the_inputs_of_the_recording() -> None:
    {function}(Path(__file__).with_suffix(".mcap"){code})
'''
_CLOSED_TEST = '''"""The fewest faults, options and commands of {file}, in closed loop with the plant of the station.

Made by umo recording shrink. The error: {text}
It fails as long as the control code gives it.
"""

from umo.recording.replay.closed_loop import Trial


def test_the_run_ends_without_the_error() -> None:
    trial = {trial}
    assert trial.ending() is None
'''


def _save(tape: ShrunkTape, target: Path) -> None:
    from umo.process.frames.run_reader import NumberedEvent
    from umo.recording.block import Block, TakenCommand
    from umo.recording.recording_file import RecordingFile

    block = tape.block
    commands = [TakenCommand(each.number, each.period, each.data) for each in block.commands]
    events = [NumberedEvent(number, event) for number, event in enumerate(tape.events)]
    part = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with closing(RecordingFile(part, tape.layout)) as file:
            file.add([Block(block.frames, block.entries, commands, events=events)])
        part.rename(target)
    finally:
        part.unlink(missing_ok=True)
