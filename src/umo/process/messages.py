"""The line between a starter, its guardian and the control process: messages in JSON over one pair of sockets."""

from __future__ import annotations

import json
import select
import socket
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

MOST = 1 << 18


class MessageSocket:
    """One end. Both the guardian and the control process hold the other: it ends when both are gone."""

    def __init__(self, end: socket.socket) -> None:
        self._socket = end
        self.ended = False

    @classmethod
    def pair(cls) -> tuple[MessageSocket, socket.socket]:
        """An end to keep and one to hand on."""
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (here, there):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST)
        return cls(here), there

    def send(self, kind: str, files: Sequence[int] = (), **content: Any) -> None:
        """Never blocks and never fails: a starter that is gone or does not listen is no reason to stop.
        `files` are handed over with the message."""
        with suppress(OSError):
            text = json.dumps({"kind": kind, **content}).encode()
            socket.send_fds(self._socket, [text], files, socket.MSG_DONTWAIT)

    def receive(self, timeout: float | None = 0.0) -> dict[str, Any] | None:
        """The next message within `timeout` s; None if there is none, or none any more (`ended`). Its `files` are
        the receiver's to close."""
        if self.ended or not select.select([self._socket], [], [], timeout)[0]:
            return None
        try:
            data, files, _, _ = socket.recv_fds(self._socket, MOST, 4)
        except OSError:
            data, files = b"", []
        if not data:
            self.ended = True
            return None
        message: dict[str, Any] = json.loads(data)
        return message | {"files": list(files)}

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()
