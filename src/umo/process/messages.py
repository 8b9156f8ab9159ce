"""Messages between starter, guardian and control process: JSON over one pair of sockets."""

from __future__ import annotations

import json
import select
import socket
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from umo.system import descriptor_passing

MAX_BYTES = 1 << 18
"""Size of a message at most, bytes."""


class MessageSocket:
    """One end. Both the guardian and the control process hold the other: it ends when both are gone."""

    def __init__(self, end: socket.socket) -> None:
        self._socket = end
        self._poll = select.poll()
        self._poll.register(end, select.POLLIN)
        self.ended = False

    @classmethod
    def pair(cls) -> tuple[MessageSocket, socket.socket]:
        """An end to keep and one to hand on."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (here, there):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_BYTES)
        return cls(here), there

    def send(self, kind: str, files: Sequence[int] = (), **content: Any) -> None:
        """Send a message with descriptors. Never blocks or raises, even if the starter has ended or does not read."""
        with suppress(OSError):
            text = json.dumps({"kind": kind, **content}).encode()
            descriptor_passing.send(self._socket, text, files)

    def receive(self, timeout: float = 0.0) -> dict[str, Any] | None:
        """The next message within `timeout` s; None if there is none, or none any more (`ended`). Its `files` are
        the receiver's to close. What is not a message is passed over."""
        if self.ended or not self._poll.poll(timeout * 1e3):
            return None
        data, files = self._next()
        if not data:
            self.ended = True
            return None
        try:
            message = json.loads(data)
            kind = message["kind"]
        except (ValueError, TypeError, KeyError, RecursionError):
            message, kind = {}, ""
        return {**message, "kind": str(kind), "files": list(files)}

    def _next(self) -> tuple[bytes, list[int]]:
        """A peer that ended with messages of ours unread makes one call fail; its own last messages come after that."""
        for _ in range(2):
            try:
                return descriptor_passing.receive(self._socket, MAX_BYTES, 4)
            except ConnectionResetError:
                continue
            except OSError:
                break
        return b"", []

    def peer_is_gone(self, within: float) -> bool:
        """Whether, now or `within` s, nobody holds the other end any more. Messages of its may still be unread."""
        end = select.poll()
        end.register(self._socket, 0)  # POLLHUP and POLLERR come unasked
        return any(event & (select.POLLHUP | select.POLLERR) for _, event in end.poll(within * 1e3))

    def close(self) -> None:
        self._socket.close()
