"""Requests: sets of lines that one process holds. This module is imported only if the Python binding of libgpiod is
installed."""

from __future__ import annotations

import os
from datetime import timedelta

import gpiod
from gpiod.line import Bias, Direction, Drive, Edge, Value

from umo.drivers.gpio.channel import Settings


class Bank:
    """A request of lines whose levels are transferred."""

    def __init__(self, request: gpiod.LineRequest, settings: dict[int, gpiod.LineSettings]) -> None:
        self.request = request
        self._settings = settings
        """Settings of the lines that were initialised."""
        self.levels = {offset: each.output_value for offset, each in settings.items()}
        """The level last set of each output."""

    def set(self, levels: dict[int, Value]) -> None:
        self.request.set_values(levels)  # type: ignore[arg-type]  # its keys may be names too
        self.levels.update(levels)

    def configure(self, settings: dict[int, gpiod.LineSettings]) -> None:
        """Change these lines. The other lines are passed to the kernel unchanged, because kernels before 6.11 require
        this."""
        for offset, each in self._settings.items():
            each.output_value = self.levels[offset]
        merged = self._settings | settings
        self.request.reconfigure_lines({(offset,): each for offset, each in merged.items()})
        self._settings = merged
        self.levels |= {offset: each.output_value for offset, each in settings.items()}


class EdgeCount:
    """The edges of one line since it was initialised.

    The kernel numbers the edges of a line, and the newest event has the number of edges. So the count is right even
    after an overflow of the kernel's buffer of events, in which the oldest events are dropped.
    """

    def __init__(self) -> None:
        self.request: gpiod.LineRequest | None = None
        self._count = 0
        self._before = 0
        """Edges that were counted through requests before this one."""

    def attach(self, request: gpiod.LineRequest) -> None:
        """Continue with a new request, whose numbers begin at 1."""
        os.set_blocking(request.fd, False)
        self.request = request
        self._before = self._count

    def read(self) -> int:
        assert self.request is not None
        try:
            last = self.request.read_edge_events()[-1].line_seqno  # 32 bits
        except BlockingIOError:  # no edge since the last call
            return self._count
        self._count += (last - (self._count - self._before)) & 0xFFFFFFFF
        return self._count

    def release(self) -> None:
        if self.request is not None:
            self.request.release()
            self.request = None


def line_settings(settings: Settings, level: Value | None, edges: str = "") -> gpiod.LineSettings:
    """Return the settings of a line: an output at this level, or an input."""
    output = level is not None
    return gpiod.LineSettings(
        direction=Direction.OUTPUT if output else Direction.INPUT,
        edge_detection=Edge[edges.upper()] if edges else Edge.NONE,
        bias=Bias[settings.bias.upper().replace("-", "_")],
        drive=Drive[settings.drive.upper().replace("-", "_")] if output else Drive.PUSH_PULL,
        active_low=settings.active_low,
        debounce_period=timedelta(microseconds=0 if output else settings.debounce),
        output_value=level if level is not None else Value.INACTIVE,
    )
