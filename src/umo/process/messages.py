"""The messages between starter, guardian and control process: JSON over one pair of sockets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from umo.system import calls

MAX_BYTES = 1 << 18
"""Largest size of a message, in bytes."""


class MessageSocket:
    """One end of a pair of sockets. The guardian and the control process both hold the other end, which closes when
    both have ended."""

    def __init__(self, end: calls.Socket) -> None:
        self._socket = end
        self._file = end.fileno()
        self.ended = False

    @classmethod
    def pair(cls) -> tuple[MessageSocket, calls.Socket]:
        """Return an end to keep and an end to pass on."""
        here, there = calls.message_sockets(MAX_BYTES)
        return cls(here), there

    def send(self, kind: str, files: Sequence[int] = (), **content: Any) -> None:
        """Send a message with descriptors. Never blocks or raises, even if the starter has ended or does not read."""
        with suppress(OSError):
            text = json.dumps({"kind": kind, **content}).encode()
            calls.send_message(self._socket, text, files)

    def receive(self, timeout: float = 0.0) -> dict[str, Any] | None:
        """Return the next message within `timeout` s, or None (after the last message, `ended` is True). The receiver
        closes the `files` of the message. Other data are skipped."""
        if self.ended or not calls.ready(self._file, timeout):
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
        """Return the next message as received. If the peer ended without reading all messages, one call fails, and the
        peer's last messages come after it."""
        for _ in range(2):
            try:
                return calls.receive_message(self._socket, MAX_BYTES, 4)
            except ConnectionResetError:
                continue
            except OSError:
                break
        return b"", []

    def peer_is_gone(self, within: float) -> bool:
        """Return True if the other end is closed now, or is closed `within` this time in s. Messages from it may still
        be unread."""
        return bool(calls.ready(self._file, within, 0) & calls.HUNG_UP)

    def close(self) -> None:
        self._socket.close()
