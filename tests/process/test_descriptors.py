"""A run that may open too few files says so before it starts, with the number that it needs and what to do."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from umo.errors import text_of
from umo.process.outcome import message_of
from umo.system import descriptors
from umo.system.descriptors import NEEDED, TooFewDescriptors

ADVICE = "run `ulimit -n 1024` in a new terminal, and start the run there (for a service set LimitNOFILE=1024)"


@pytest.mark.parametrize("allowed", [8, 12, 16, 24, 32, NEEDED - 1])
def test_too_few_are_told_with_the_number_that_is_needed_and_what_to_do(allowed: int) -> None:
    with pytest.raises(TooFewDescriptors) as raised:
        descriptors.ensure(lambda: (allowed, allowed), lambda soft, hard: None)
    text = str(raised.value)
    assert f"needs {NEEDED} open files" in text
    assert f"{allowed} are allowed here: {ADVICE}" in text


@pytest.mark.parametrize(
    ("limits", "set_to"),
    [
        ((NEEDED, NEEDED), None),
        ((1024, 4096), None),
        ((-1, -1), None),
        ((24, NEEDED), (NEEDED, NEEDED)),
        ((24, 4096), (1024, 4096)),
        ((24, -1), (1024, -1)),
    ],
)
def test_a_limit_that_the_process_may_raise_is_raised(limits: tuple[int, int], set_to: tuple[int, int] | None) -> None:
    done: list[tuple[int, int]] = []
    descriptors.ensure(lambda: limits, lambda soft, hard: done.append((soft, hard)))
    assert done == ([] if set_to is None else [set_to])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")
@pytest.mark.full
def test_umo_run_with_few_descriptors_ends_with_that_as_a_mistake(tmp_path: Path) -> None:
    umo = "from umo_command import main; main()"
    words = [sys.executable, "-c", umo, "run", "conveyor", "--realtime", "--until", "1 s"]
    limit = "resource.setrlimit(resource.RLIMIT_NOFILE, (24, 24))"
    script = f"import os, resource, sys; {limit}; os.execv(sys.argv[1], sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", script, *words], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 2, done.stderr
    assert "24 are allowed here: run `ulimit -n 1024`" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_a_device_that_finds_no_descriptor_any_more_names_the_limit() -> None:
    error = OSError(errno.EMFILE, os.strerror(errno.EMFILE), "/dev/ttyUSB0")
    for text in (text_of(error), message_of(error)):
        assert "Too many open files: '/dev/ttyUSB0' (`ulimit -n` shows and raises the number)" in text
    assert "ulimit" not in text_of(OSError(errno.ENOENT, os.strerror(errno.ENOENT)))
