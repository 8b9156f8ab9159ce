"""A device that misbehaves, on TCP or on a pseudo-terminal. Bytes only; the protocol is a function of the test:

    def answer(data: bytes) -> tuple[int, bytes]: ...  # the size of a request (0: not all of it yet), its answer

    with hostile(answer, ["right", "random bytes", "late"], line=True) as peer:
        driver = Text(serial=peer.path, ...)           # with line=False: host 127.0.0.1, port peer.port

Each request meets the next behaviour of the script, which begins anew at its end; `peer.met` counts them. `fuzz(seed)`
is an endless script. A behaviour without an end is ended by the client that leaves, on a line after `LONGEST`.
"""

from __future__ import annotations

import os
import select
import socket
import threading
import time
import tty
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import cycle, repeat
from random import Random

Answer = Callable[[bytes], tuple[int, bytes]]
Step = bytes | float | None
"""Bytes that are sent, a pause in s, or None: the connection is closed, which a line cannot do."""

LONGEST = 0.15
"""s that a behaviour lasts on a line. What is asked during its pauses is lost, as with a device that is busy: no answer
comes later than this."""
LATE = 0.08
"""s after which the late answers come: longer than the timeout of a test's driver, shorter than its patience."""
MOST_KEPT = 50


@dataclass
class Scene:
    """What a behaviour may use: the right answer, those to earlier requests, and randomness."""

    right: bytes
    earlier: Sequence[bytes]
    random: Random

    def noise(self, most: int) -> bytes:
        return self.random.randbytes(self.random.randint(1, most))

    def cut(self) -> bytes:
        """The answer without its end."""
        return self.right[: self.random.randrange(max(len(self.right), 1))]

    def old(self) -> bytes:
        return self.random.choice(self.earlier) if self.earlier else b""

    def flipped(self) -> bytes:
        """The answer with one wrong bit."""
        changed = bytearray(self.right)
        changed[self.random.randrange(len(changed))] ^= 1 << self.random.randrange(8)
        return bytes(changed)


Behaviour = Callable[[Scene], Iterable[Step]]


def _byte_by_byte(data: bytes, pause: float) -> Iterator[Step]:
    for byte in data:
        yield bytes([byte])
        yield pause


BEHAVIOURS: dict[str, Behaviour] = {
    "right": lambda scene: [scene.right],
    "byte by byte": lambda scene: _byte_by_byte(scene.right, 0.0005),
    "in two pieces": lambda scene: [scene.right[:3], 0.002, scene.right[3:]],
    "silent": lambda scene: [],
    "late": lambda scene: [LATE, scene.right],
    "too slow": lambda scene: _byte_by_byte(scene.right, 0.03),
    "cut": lambda scene: [scene.cut()],
    "cut and closed": lambda scene: [scene.cut(), None],
    "closed": lambda scene: [None],
    "twice": lambda scene: [scene.right, scene.right],
    "twice, apart": lambda scene: [scene.right, 0.01, scene.right],
    "an earlier answer": lambda scene: [scene.old()],
    "an earlier answer first": lambda scene: [scene.old(), scene.right],
    "all earlier answers": lambda scene: [b"".join(scene.earlier)],
    "random bytes": lambda scene: [scene.noise(64)],
    "noise before": lambda scene: [scene.noise(16), scene.right],
    "noise after": lambda scene: [scene.right, scene.noise(16)],
    "oversize": lambda scene: [scene.right + scene.random.randbytes(200_000)],
    "zeros": lambda scene: [bytes(scene.random.randint(1, 600))],
    "ones": lambda scene: [b"\xff" * scene.random.randint(1, 600)],
    "endless noise": lambda scene: (scene.noise(4096) for _ in repeat(None)),
    "endless answers": lambda scene: repeat(scene.right * 20),
    "endless byte": lambda scene: _endless_byte(scene.right[:1]),
    "endless silence": lambda scene: [LONGEST],
}
DAMAGED: dict[str, Behaviour] = {"one bit wrong": lambda scene: [scene.flipped()]}
"""For protocols with a check sum only: nothing else could notice."""


def _endless_byte(byte: bytes) -> Iterator[Step]:
    while True:
        yield byte
        yield 0.002


def fuzz(seed: int, names: Iterable[str] = (*BEHAVIOURS,), rights: float = 0.5) -> Iterator[str]:
    """Behaviours at random, the right one with this probability."""
    random, others = Random(seed), [name for name in names if name != "right"]
    while True:
        yield "right" if random.random() < rights else random.choice(others)


class Hostile:
    """The running device."""

    def __init__(self, answer: Answer, script: Iterable[str], line: bool, seed: int) -> None:
        self.met: Counter[str] = Counter()
        """How many requests have met each behaviour."""
        self.port, self.path = 0, ""
        self._answer = answer
        self._script = cycle(script) if isinstance(script, Sequence) else iter(script)
        self._random = Random(seed)
        self._earlier: deque[bytes] = deque(maxlen=MOST_KEPT)
        self._stopped = threading.Event()
        self._line = line
        self._threads = [threading.Thread(target=self._converse_on_line if line else self._listen, daemon=True)]
        if line:
            self._master, self._slave = os.openpty()
            self.path = os.ttyname(self._slave)
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
        else:
            self._server = socket.create_server(("127.0.0.1", 0))
            self.port = self._server.getsockname()[1]
        self._threads[0].start()

    def stop(self) -> None:
        self._stopped.set()
        if not self._line:
            with suppress(OSError):
                self._server.shutdown(socket.SHUT_RDWR)  # wakes `accept`
            self._server.close()
        for thread in self._threads:
            thread.join(10.0)
            assert not thread.is_alive(), "the hostile device does not end"
        if self._line:
            os.close(self._master)
            os.close(self._slave)

    def _converse_on_line(self) -> None:
        self._converse(self._master)

    def _listen(self) -> None:
        while not self._stopped.is_set():
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            self._threads = [thread for thread in self._threads if thread.is_alive()]
            self._threads.append(threading.Thread(target=self._serve, args=(client,), daemon=True))
            self._threads[-1].start()

    def _serve(self, client: socket.socket) -> None:
        with client:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.setblocking(False)
            with suppress(OSError):
                self._converse(client.fileno())

    def _converse(self, file: int) -> None:
        data = b""
        while not self._stopped.is_set():
            if not select.select([file], [], [], 0.02)[0]:
                continue
            taken = os.read(file, 4096)
            if not taken:
                return
            data += taken
            while (found := self._answer(data))[0]:
                data = data[found[0] :]
                if not self._play(file, found[1]):
                    return
            data = data[-4096:]

    def _play(self, file: int, right: bytes) -> bool:
        """Meet one request; False when the connection is to be closed."""
        name = next(self._script)
        self.met[name] += 1
        steps = (BEHAVIOURS | DAMAGED)[name](Scene(right, tuple(self._earlier), self._random))
        self._earlier.append(right)
        end = time.monotonic() + (LONGEST if self._line else 60.0)
        for step in steps:
            if self._stopped.is_set() or time.monotonic() > end:
                break
            if step is None and not self._line:
                return False
            if isinstance(step, float):
                self._stopped.wait(step)
                self._lose_requests(file)
            elif isinstance(step, bytes):
                self._send(file, step, end)
        return True

    def _lose_requests(self, file: int) -> None:
        while self._line and select.select([file], [], [], 0)[0]:
            os.read(file, 4096)

    def _send(self, file: int, data: bytes, end: float) -> None:
        """As much as the other end takes; OSError when it is gone."""
        while data and not self._stopped.is_set() and time.monotonic() < end:
            if select.select([], [file], [], 0.02)[1]:
                with suppress(BlockingIOError):
                    data = data[os.write(file, data) :]


@contextmanager
def hostile(answer: Answer, script: Iterable[str], *, line: bool = False, seed: int = 1) -> Iterator[Hostile]:
    """A hostile device that runs meanwhile: `script` names behaviours, one for each request."""
    peer = Hostile(answer, script, line, seed)
    try:
        yield peer
    finally:
        peer.stop()
