"""Trying the kinds: what became of each try, and what must not be."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from random import Random
from time import monotonic, sleep

from bench.kills.box import OUTPUTS, Box
from bench.kills.kinds import KINDS, Kind
from bench.kills.run import How, NotStruck, Run

SEED = 1998
AFTERWARDS = 1.0
"""s after the end at which the outputs are looked at again: a stale write may have undone a reset."""
ANSWERED_FOR = 0.5
"""s for which the box has to answer before the end for nothing to stay driven."""
AGAIN = 3
"""How often a try is begun whose machine ended before anything was done to it."""
TAKES = {How.PROGRAM: 2.0, How.COMMAND: 4.0}
"""s of one try, about."""


@dataclass
class Try:
    """The result of one try. Empty texts where all is well."""

    kind: str
    number: int
    how: How
    ms: float | None = None
    """From the strike to the last output at its default, if they all are."""
    unsafe: str = ""
    wrong: str = ""
    """A status that is not right or that nothing was said of, or a good reading that the box never had."""
    said: str = ""
    kept_age: float = 0.0
    """s from the period of which values were kept to the last one."""

    def __str__(self) -> str:
        what = "; ".join(filter(None, (self.unsafe, self.wrong)))
        return f"{self.kind}, try {self.number} ({self.how.value}): {what}. It said: {self.said or 'nothing'}"


@dataclass
class Row:
    """All tries of one kind."""

    kind: Kind
    tries: list[Try] = field(default_factory=list)

    @property
    def times(self) -> list[float]:
        """ms."""
        return [one.ms for one in self.tries if one.ms is not None]

    @property
    def wrong(self) -> list[Try]:
        return [one for one in self.tries if one.wrong]

    @property
    def unsafe(self) -> list[Try]:
        return [one for one in self.tries if one.unsafe]


def counts(kinds: Sequence[Kind], share: float) -> dict[str, int]:
    """How many tries of each: a share of the full number, at least one."""
    return {kind.name: max(1, round(kind.count * share)) for kind in kinds}


def expected(kinds: Sequence[Kind], numbers: dict[str, int]) -> float:
    """About how long that takes, in s."""
    each = ((kind, numbers[kind.name]) for kind in kinds)
    return sum(n * (kind.takes + sum(TAKES[how] for how in kind.how) / len(kind.how)) for kind, n in each)


def measure(
    kinds: Sequence[Kind] = KINDS,
    share: float = 1.0,
    seed: int = SEED,
    said: Callable[[Try], object] = lambda one: None,
    jobs: int = 1,
    first: int = 0,
) -> list[Row]:
    """Try them, in turns, so that a busy hour of this computer hits all alike; `jobs` of them at a time, from the
    `first` on, where another run had those before. `said` hears of every try."""
    rows = {kind.name: Row(kind) for kind in kinds}
    with _usual_signals(), ThreadPoolExecutor() as later, ThreadPoolExecutor(jobs) as trying:
        turns = islice(_turns(kinds, counts(kinds, share)), first, None)
        try:
            for one in [trying.submit(_try, kind, number, seed, later) for kind, number in turns]:
                found = one.result().result()
                rows[found.kind].tries.append(found)
                said(found)
        finally:
            trying.shutdown(cancel_futures=True)
    return list(rows.values())


def _turns(kinds: Sequence[Kind], numbers: dict[str, int]) -> Iterator[tuple[Kind, int]]:
    """Each kind spread over the whole."""
    order = [((i + 0.5) / numbers[kind.name], kind, i) for kind in kinds for i in range(numbers[kind.name])]
    for _, kind, i in sorted(order, key=lambda entry: entry[0]):
        yield kind, i


# One try ------------------------------------------------------------------------------------------------


def _try(kind: Kind, number: int, seed: int, later: ThreadPoolExecutor) -> Future[Try]:
    """Up to the end of its processes; the rest is looked at while the next one starts."""
    how = kind.how[number % len(kind.how)]
    found = Try(kind.name, number, how)
    for again in range(AGAIN):
        folder, box = _place()
        run = Run(how, box, folder, kind.setting)
        run.moments = Random(f"{kind.name} {number} {seed} power")
        if kind.beforehand is not None:
            box.fault(*kind.beforehand)
        try:
            moment = kind.strike(run, Random(f"{kind.name} {number} {seed} {again}"))
            return later.submit(_look_again, *_judge(kind, found, run, moment))
        except NotStruck as error:
            found.wrong = str(error)
            _clear(run)
        except BaseException:
            _clear(run)
            raise
    done: Future[Try] = Future()
    done.set_result(found)
    return done


def _judge(kind: Kind, found: Try, run: Run, moment: int) -> tuple[Try, Run, int, float]:
    """Judge the end; how often outputs had left their defaults then, and when to look again."""
    ended = run.wait_end(kind.limit)
    left, at_end, again = run.box.left, run.box.values, monotonic() + AFTERWARDS
    answered = run.box.answers_for - run.told_for
    found.wrong = ""
    if not ended:
        found.unsafe = f"its processes still ran {kind.limit:g} s later"
    if any(at_end) and run.status == 1:
        found.unsafe = _join(found.unsafe, f"told as reset: {_named(at_end)}")
    if any(at_end) and kind.resets and answered >= ANSWERED_FOR:
        found.unsafe = _join(found.unsafe, f"{_named(at_end)} not at the default at the end")
    elif not any(at_end):
        found.ms = max(0.0, (run.box.since - moment) * 1e-6)
    run.close()
    found.said = run.said()
    if ended and run.status not in kind.right(found.how):
        allowed = ", ".join(str(int(status)) for status in kind.right(found.how))
        found.wrong = f"status {run.status} in place of {allowed}"
    if run.status in (1, 2, 3) and not found.said:
        found.wrong = _join(found.wrong, f"status {run.status} without a word")
    found.wrong = _join(found.wrong, run.wrong_kept())
    found.kept_age = run.kept_age
    if run.wrong_readings:
        found.wrong = _join(found.wrong, f"{run.wrong_readings} good readings were not the box's")
    return found, run, left, again


def _look_again(found: Try, run: Run, left: int, moment: float) -> Try:
    """A write that was under way may be carried out after everything was reset."""
    sleep(max(0.0, moment - monotonic()))
    if run.box.left != left and found.ms is not None:
        came = _named(run.box.values) or "an output"
        found.unsafe = _join(found.unsafe, f"{came} left its default within {AFTERWARDS:g} s after the end")
        found.ms = None
    found.wrong = _join(found.wrong, run.wrong_start())
    _clear(run)
    return found


def _named(values: Sequence[int]) -> str:
    wrong = [f"coil {i}" if i < 10 else f"register {i - 10}" for i, value in enumerate(values) if value]
    return "every output" if len(wrong) == OUTPUTS else ", ".join(wrong)


def _join(*texts: str) -> str:
    return "; ".join(filter(None, texts))


def _place() -> tuple[Path, Box]:
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="umo-kills-", dir=shared))
    return folder, Box(folder)


def _clear(run: Run) -> None:
    run.close()
    run.box.close()
    with suppress(OSError):
        shutil.rmtree(run.folder)


@contextmanager
def _usual_signals() -> Iterator[None]:
    """Let no starter of a machine find a signal ignored, wherever the campaign itself was started from (a background
    job of a shell ignores SIGINT)."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    ignored = [number for number in numbers if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)
