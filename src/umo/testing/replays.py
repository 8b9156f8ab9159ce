"""Replays of recordings as tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from umo.recording.replay.result import Replayed


def assert_replays(
    file: Path | str,
    station: Path | str | None = None,
    wiring: Path | str | None = None,
    *,
    damaged: bool = False,
) -> None:
    """Replay a recording with the present control code. Raise AssertionError, with the first difference, if the replay
    differs.

        def test_the_run_of_monday_is_repeated() -> None:
            assert_replays("recordings/monday.mcap", "press")

    `station`: the code, as the folder or name of a station, or `FILE.py:MACHINE:APPLICATION`; None means the station
    that ships with umo or is installed under the recorded name. No other code is imported because the recording names
    it. `wiring`: a wiring of the station by name, or a file; None means the recorded wiring, as data. Raises
    NotReplayable (`umo.recording.replay`) if the recording cannot be replayed. `damaged`: also replay an incomplete
    recording, up to its first gap. By default a gap leads to an AssertionError, because the missing periods were not
    compared.

    A recording with another hash seed (PYTHONHASHSEED) than this process is replayed in a separate process.
    """
    result = _replayed(file, station, wiring, "assert_replays", damaged)
    if result is not None and not (result.identical or (damaged and result.difference is None)):
        raise AssertionError(str(result))


def assert_no_error(
    file: Path | str,
    station: Path | str | None = None,
    wiring: Path | str | None = None,
    *,
    damaged: bool = False,
) -> None:
    """Replay a recording from which `umo recording shrink` has removed periods. Raise AssertionError as long as the
    present control code ends with an error on these inputs. The arguments are those of `assert_replays`."""
    result = _replayed(file, station, wiring, "assert_no_error", damaged)
    if result is not None and result.error is not None:
        raise AssertionError(str(result.error))
    if result is not None and result.inexact and not damaged:
        raise AssertionError(str(result))


def _replayed(
    file: Path | str, station: Path | str | None, wiring: Path | str | None, check: str, damaged: bool
) -> Replayed | None:
    """Return the replay, or None if it was made and checked in a separate process."""
    from umo.recording.replay.code_given import CodeGiven
    from umo.recording.replay.opening import opened, other_hash_seed
    from umo.recording.replay.program import Program
    from umo.recording.replay.replaying import replay
    from umo.recording.replay.tape import NotReplayable
    from umo.system.processes import HASH_SEED

    with opened(file) as tape:
        seed = other_hash_seed(tape.layout.about)
        if seed is None:
            code = CodeGiven(*(None if each is None else str(each) for each in (station, wiring)))
            return replay(tape, Program.of(tape, code))
    words = ["" if each is None else str(each) for each in (file, station, wiring)]
    program = (
        f"import sys; from umo.testing import {check} as check; "
        f"check(*(each or None for each in sys.argv[1:]), damaged={damaged})"
    )
    command = [sys.executable, "-P", "-c", program]
    environ = os.environ | {HASH_SEED: seed, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([*command, *words], capture_output=True, text=True, env=environ, check=False)
    *_, end = ["", *done.stderr.strip().splitlines()]
    if "NotReplayable: " in end:
        raise NotReplayable(end.partition("NotReplayable: ")[2])
    if done.returncode:
        raise AssertionError(done.stderr.partition("AssertionError: ")[2] or done.stdout + done.stderr)
    return None
