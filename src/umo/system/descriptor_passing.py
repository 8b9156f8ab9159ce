"""Messages with descriptors over a Unix socket (unix(7), SCM_RIGHTS).

Python's `socket.send_fds` and `recv_fds` drop their flags (up to 3.13): a full peer would be waited for, and what was
received inherited.
"""

from __future__ import annotations

import socket
from array import array
from collections.abc import Sequence


def send(connection: socket.socket, data: bytes, files: Sequence[int] = ()) -> None:
    """Send one message and hand over descriptors with it. Never waits: OSError if there is no room for it."""
    rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array("i", files))] if files else []
    connection.sendmsg([data], rights, socket.MSG_DONTWAIT)


def receive(connection: socket.socket, size: int, most: int) -> tuple[bytes, list[int]]:
    """The next message, of up to `size` bytes, and up to `most` descriptors that came with it: they are the receiver's
    to close, and no program that it starts inherits them. An empty message: the peer has ended."""
    data, rights, _, _ = connection.recvmsg(size, socket.CMSG_LEN(most * array("i").itemsize), socket.MSG_CMSG_CLOEXEC)
    files = array("i")
    for level, kind, content in rights:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            files.frombytes(content[: len(content) // files.itemsize * files.itemsize])
    return data, files.tolist()
