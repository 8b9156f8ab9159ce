"""Batches of programs, each played in a process of its own: what crashes or hangs does not end the rest, and is found
by halves."""

from __future__ import annotations

import gc
import logging
import os
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from resource import RLIMIT_CPU, setrlimit
from signal import SIGXCPU
from typing import Any

import umo.wiring.schema  # noqa: F401  # it is imported late, and would be in each batch
from tools.fuzz.board_target import BoardTarget
from tools.fuzz.compiled_target import CompiledTarget
from tools.fuzz.host_target import HostTarget
from tools.fuzz.line_target import LineTarget
from tools.fuzz.program import Program, program
from tools.fuzz.target import Target
from tools.fuzz.verdict import Verdict

TARGETS: dict[str, type[Target]] = {each.name: each for each in (HostTarget, CompiledTarget, LineTarget, BoardTarget)}
SIZE = 24
"""Programs in one library."""
TIMEOUT = 120
"""Time of a processor in s for a batch, after which it hangs; other work of the computer does not count."""
LATEST = 20 * TIMEOUT
"""The same of a clock, for one that waits."""
NICE = 0
OPTIMIZED, QUICK, SANITIZED = ("-O2",), ("-O0",), ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
_fork = get_context("fork")


@dataclass(frozen=True)
class Batch:
    """Programs for one target, compiled with these flags."""

    target: str
    flags: tuple[str, ...]
    programs: Sequence[Program]

    def of(self, programs: Sequence[Program]) -> Batch:
        return Batch(self.target, self.flags, programs)

    def line(self, seed: int) -> str:
        """The command that plays a program of it again, and reduces it."""
        how = {OPTIMIZED: " --optimized", SANITIZED: " --sanitize"}.get(self.flags, "")
        return f"python -m tools.fuzz --replay {seed} --target {self.target}{how}"


def batches(target: str, seeds: range, flags: tuple[str, ...] | None = None, size: int = SIZE) -> Iterator[Batch]:
    """The programs of these seeds; those with a hazard apart, as most of them are refused. Every eighth batch is
    optimized, unless flags are given."""
    number = 0
    for at in range(0, len(seeds), 2 * size):
        for rest in (0, 1):
            some = [seed for seed in seeds[at : at + 2 * size] if seed % 2 == rest]
            if some:
                chosen = flags or (OPTIMIZED if number % 8 == 7 else QUICK)
                yield Batch(target, chosen, [program(seed) for seed in some])
                number += 1


def played(waiting: Iterator[Batch], jobs: int = 1) -> Iterator[tuple[Batch, Program, Verdict]]:
    """Each program with its verdict, as they come."""
    again: list[Batch] = []
    running: dict[Connection, tuple[Any, Batch]] = {}
    while True:
        while len(running) < jobs and (batch := again.pop() if again else next(waiting, None)) is not None:
            process, answer = _begun(batch)
            running[answer] = process, batch
        if not running:
            return
        ready = wait([*running], LATEST) or [*running]  # none within that time: all hang
        for answer in ready:
            process, batch = running.pop(answer)  # type: ignore[index, arg-type]
            verdicts = _answer(process, answer)  # type: ignore[arg-type]
            if isinstance(verdicts, str):
                if len(batch.programs) == 1:
                    yield batch, batch.programs[0], Verdict("crashed", verdicts)
                half = len(batch.programs) // 2
                again += [batch.of(some) for some in (batch.programs[:half], batch.programs[half:]) if half]
                continue
            for each, verdict in zip(batch.programs, verdicts, strict=True):
                yield batch, each, verdict


def play(batch: Batch) -> list[Verdict]:
    """The verdicts of one batch, in its order."""
    found = {each: verdict for _, each, verdict in played(iter([batch]))}
    return [found[each] for each in batch.programs]


def _begun(batch: Batch) -> tuple[Any, Connection]:
    answer, end = _fork.Pipe(duplex=False)
    process = _fork.Process(target=_play, args=(batch, end), daemon=True)
    process.start()
    end.close()
    return process, answer


def _answer(process: Any, answer: Connection) -> list[Verdict] | str:
    """The verdicts; a text: it has crashed, or hangs."""
    try:
        found: list[Verdict] | str = answer.recv() if answer.poll() else "it hangs"
    except EOFError:
        process.join(LATEST)
        hangs = process.exitcode == -SIGXCPU
        found = "it hangs" if hangs else f"it ended with status {process.exitcode}"
    process.kill()
    process.join()
    answer.close()
    return found


def _play(batch: Batch, end: Connection) -> None:
    os.nice(NICE)
    gc.disable()  # the process ends with its batch
    setrlimit(RLIMIT_CPU, (TIMEOUT, TIMEOUT + 5))
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")  # numpy's, of what programs divide by zero
    with tempfile.TemporaryDirectory(prefix="umo-fuzz-") as name:
        end.send(TARGETS[batch.target](Path(name), batch.flags).played(batch.programs))
    end.close()
    os._exit(0)
