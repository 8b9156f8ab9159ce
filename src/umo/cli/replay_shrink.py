"""`umo shrink`: the fewest periods of a recording that still give its error."""

from __future__ import annotations

import logging
import os
import time
from contextlib import closing
from pathlib import Path

from umo.exit_status import ExitStatus
from umo.replay.opening import opened, other_hash_seed
from umo.replay.shrinking import Shrinking, ShrunkTape, periods_left
from umo.replay.tape import NotReplayable

from .console import err, out, say
from .progress_line import OneLine
from .replay_run import begin_again


def shrink_file(file: Path, station: str | None, output: Path | None, seconds: float) -> int:
    """Shrink it; the exit status."""
    target = output or file.with_suffix(".shrunk.mcap")
    if target.exists():
        say(f"{target} exists already; give another file with -o", "red")
        return ExitStatus.MISTAKE
    logging.getLogger("umo").setLevel(logging.CRITICAL)  # hundreds of replays that fail
    try:
        with opened(file) as tape:
            if (seed := other_hash_seed(tape.layout.about)) is not None:
                begin_again(seed)
            return _shrink(Shrinking(tape, station), target, seconds)
    except NotReplayable as error:
        say(str(error), "red")
        return ExitStatus.MISTAKE


def _shrink(shrinking: Shrinking, target: Path, seconds: float) -> int:
    until, begun = time.monotonic() + seconds, shrinking.source.count
    with OneLine(err) as line:

        def go_on() -> bool:
            text = f"{len(shrinking.places):,} periods left"
            line.show(time.monotonic() - until + seconds, text if err.is_terminal else "", None)
            return time.monotonic() < until

        tape, ended = None, ""
        try:
            tape = shrinking.run(go_on)
        except KeyboardInterrupt:
            ended = " (ended by Ctrl-C)"
        ended = ended or (f" (ended after {seconds:g} s)" if time.monotonic() >= until else "")
    tape = tape or shrinking.source.chosen(shrinking.places)
    _save(tape, target)
    left = f"{begun:,} periods, {len(shrinking.places):,} left{ended}: {periods_left(shrinking.places.tolist())}"
    out.print(f"{left}\nin open loop they give the same error: {shrinking.ending.text}", markup=False, soft_wrap=True)
    out.print(f"{shrinking.replays} replays; the recording of these: {target}", markup=False, soft_wrap=True)
    return ExitStatus.DONE


def _save(tape: ShrunkTape, target: Path) -> None:
    from umo.frames.reader import NumberedEvent
    from umo.recording.block import Block, TakenCommand
    from umo.recording.recording_file import RecordingFile

    block = tape.block
    commands = [TakenCommand(each.number, each.period, each.data) for each in block.commands]
    events = [NumberedEvent(number, event) for number, event in enumerate(tape.events)]
    part = target.with_name(f".{target.name}.{os.getpid()}")
    with closing(RecordingFile(part, tape.layout)) as file:
        file.add([Block(block.frames, block.entries, commands, events=events)])
    part.rename(target)
