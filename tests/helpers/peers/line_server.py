"""A device for tests of one behaviour each: it answers lines on 127.0.0.1 as a function of the test says."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


class LineServer:
    """`answer(line)` gives the bytes that are sent back; None closes the connection. `received` has all lines."""

    def __init__(self, answer: Callable[[str], bytes | None], hello: bytes) -> None:
        self.received: list[str] = []
        self.connections = 0
        self._answer, self._hello = answer, hello
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self.clients: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._listen, daemon=True)]
        self._threads[0].start()

    def stop(self) -> None:
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)  # wakes `accept`
        self._server.close()
        for client in self.clients:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(10.0)

    def _listen(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            self.connections += 1
            self.clients.append(client)
            self._threads.append(threading.Thread(target=self._serve, args=(client,), daemon=True))
            self._threads[-1].start()

    def _serve(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            client.sendall(self._hello)
            for line in client.makefile("r", encoding="latin-1", newline="\n"):
                self.received.append(line.rstrip("\n"))
                answer = self._answer(self.received[-1])
                if answer is None:
                    return
                client.sendall(answer)


@contextmanager
def line_server(answer: Callable[[str], bytes | None], hello: bytes = b"") -> Iterator[LineServer]:
    server = LineServer(answer, hello)
    try:
        yield server
    finally:
        server.stop()
