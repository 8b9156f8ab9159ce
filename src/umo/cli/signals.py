"""The signals that would end a command, handled in another way for a while."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from umo.cycle.stopping import SIGNALS, signal_name

Handler = Callable[[int, FrameType | None], object] | signal.Handlers


@contextmanager
def handling(handler: Handler) -> Iterator[None]:
    """Have this handler called for each of these signals in the block; `signal.SIG_IGN`: they are passed over."""
    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, signal.SIG_DFL if former is None else former)


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """A handler: the first signal raises KeyboardInterrupt as Ctrl-C does, later ones interrupt nothing."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt(signal_name(number))
