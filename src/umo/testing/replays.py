"""Replays of recordings as tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def assert_replays(file: Path | str, station: Path | str | None = None) -> None:
    """Replay a recording with the control code of today: AssertionError with the first difference.

        def test_the_run_of_monday_is_repeated() -> None:
            assert_replays("recordings/monday.mcap")

    `station`: another one than that of the recording, such as the folder of a copy. NotReplayable (`umo.replay`) if the
    recording cannot be replayed. A recording whose order of hashes was fixed to another one than this process has is
    replayed in a process of its own.
    """
    from umo.replay.opening import HASH_SEED, opened, other_hash_seed
    from umo.replay.program import Program
    from umo.replay.replaying import replay
    from umo.replay.tape import NotReplayable

    with opened(file) as tape:
        seed = other_hash_seed(tape.layout.about)
        if seed is None:
            program = Program.of(tape, None if station is None else str(station))
            result = replay(tape, program)
            assert result.identical, str(result)
            return
    command = [sys.executable, "-m", "umo_command", "replay", str(file), *([] if station is None else [str(station)])]
    environ = os.environ | {HASH_SEED: seed, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(command, capture_output=True, text=True, env=environ, check=False)
    if done.returncode == 2:
        raise NotReplayable(done.stderr.strip())
    assert done.returncode == 0, done.stdout + done.stderr
