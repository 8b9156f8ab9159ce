"""Sizes that a model can have: two banks, two frames, two commands, of two words of content each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from tools.memory_orders.client_protocols import COMMAND_BYTES, COMMAND_SLOT, COMMAND_SLOTS
from umo.drivers.off_cycle import shared_memory
from umo.process.frames import command_queue as queue_module
from umo.process.frames import reader as reader_module
from umo.process.frames import ring as ring_module
from umo.recording import ring_collector


class _Flock:
    """The lock of the cells' file, which stands for the memory here."""

    LOCK_EX, LOCK_NB, LOCK_UN = 1, 2, 4

    @staticmethod
    def flock(memory: Any, operation: int) -> None:
        memory.do("unlock" if operation == _Flock.LOCK_UN else "lock")


@contextmanager
def small(command_slots: int = COMMAND_SLOTS) -> Iterator[None]:
    """The sizes that a model can have."""
    sizes: list[tuple[Any, dict[str, Any]]] = [
        (queue_module, {"SLOT": COMMAND_SLOT, "SLOTS": command_slots, "MAX_COMMAND_BYTES": COMMAND_BYTES,
                        "SEND_TIMEOUT": -1.0, "fcntl": _Flock}),
        (ring_collector, {"SLOT": COMMAND_SLOT, "SLOTS": command_slots}),
        (shared_memory, {"MAX_READS": 1}), (reader_module, {"EVENTS": 1, "LEASE_TRIES": 1}),
        (ring_module, {"EVENTS": 1}),
    ]  # fmt: skip
    with ExitStack() as stack:
        for module, values in sizes:
            stack.enter_context(patch.multiple(module, **values))
        yield
