"""Messages with descriptors: never waited for, never inherited."""

from __future__ import annotations

import os
import socket
import sys

import pytest

from helpers.publishing import running
from umo.process.frames import Reader
from umo.process.messages import MAX_BYTES, MessageSocket
from umo.system import calls

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="machines run in other processes on Linux")


def test_a_message_that_nobody_reads_is_not_waited_for() -> None:
    """The guardian has something else to do, such as watching."""
    here, there = MessageSocket.pair()
    for _ in range(100):
        here.send("notice", text="x" * (MAX_BYTES // 10))
    peer = MessageSocket(there)
    messages = 0
    while peer.receive() is not None:
        messages += 1
    assert 1 <= messages < 100
    here.close()
    peer.close()


def test_descriptors_that_were_received_are_not_inherited() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there, open(os.devnull) as file:
        calls.send_message(here, b"message", [file.fileno(), file.fileno()])
        data, files = calls.receive_message(there, 100, 4)
        assert data == b"message"
        assert [os.get_inheritable(each) for each in files] == [False, False]
        assert {os.fstat(each).st_rdev for each in files} == {os.stat(os.devnull).st_rdev}
        for each in files:
            os.close(each)
        calls.send_message(here, b"no files")
        assert calls.receive_message(there, 100, 4) == (b"no files", [])
    with running() as (_, ring, _connection), Reader(ring.path) as reader:
        assert reader.ends is not None
        assert not any(map(os.get_inheritable, reader.ends))
