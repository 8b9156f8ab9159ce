"""What a run shows while it works. No thread of its own: the loop's process holds no other (design.md section 7)."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from umo.cycle import Frame
from umo.objects import Compound

INTERVAL = 0.1
"""Seconds of wall-clock time between two pictures."""


def task_of(machine: Compound) -> str:
    """What the machine says that it is doing: its `task`, if it has one."""
    return str(getattr(machine, "task", ""))


class Shown:
    """An observer that draws a bar on a terminal; elsewhere it writes a line for every new task."""

    def __init__(self, machine: Compound, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._machine = machine
        self._console = console
        self._clock = clock
        self._next = 0.0
        self._task: str | None = None
        self._bar: Progress | None = None
        self._row: Any = None

    def __enter__(self) -> Shown:
        if self._console.is_terminal:
            columns = [
                TextColumn("{task.description}"),
                BarColumn(),
                TaskProgressColumn(),
                TextColumn("{task.fields[at]}"),
            ]
            self._bar = Progress(*columns, console=self._console, auto_refresh=False, transient=True)
            self._bar.start()
            self._row = self._bar.add_task("", total=None, at="")
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, frame: Frame) -> None:
        if self._bar is None:
            self._line(frame)
        elif (now := self._clock()) >= self._next:
            self._next = now + INTERVAL
            self._draw(self._bar, frame)

    def _draw(self, bar: Progress, frame: Frame) -> None:
        total = getattr(self._machine, "parts_total", None)
        done = getattr(self._machine, "placed", 0)
        text = task_of(self._machine) or "running"
        bar.update(self._row, description=text, total=total or None, completed=done, at=f"{frame.time:.1f} s")
        bar.refresh()

    def _line(self, frame: Frame) -> None:
        task = task_of(self._machine)
        if task and task != self._task:
            self._task = task
            self._console.print(f"{frame.time:8.3f} s  {task}", highlight=False)
