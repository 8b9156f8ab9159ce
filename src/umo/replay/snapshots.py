"""Snapshots of a replay: processes that were forked and wait. Going back is to let one of them fork, and run on.

Only a fork carries coroutines, laws and profiles. One process keeps the list (`SnapshotList`) and holds no replay; it
lets one runner run at a time. A runner forks a snapshot now and then. Each process has one connection to the list: a
snapshot ends when it is closed, a runner when its snapshot ends (PDEATHSIG).
"""

from __future__ import annotations

import json
import os
import secrets
import select
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from umo.system.realtime import die_with_parent

EVERY = 2000
"""Periods between two snapshots."""
MOST = 15
"""Snapshots that are kept beside the first one, each of some MB: the last 30,000 periods that were visited."""
Orders = dict[str, Any]


class Link:
    """A connection of a runner or a snapshot to the list; messages are lines of JSON."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._rest = b""

    @classmethod
    def to(cls, address: str) -> Link:
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(address)
        return cls(connection)

    def fileno(self) -> int:
        return self._connection.fileno()

    def send(self, **message: Any) -> None:
        with suppress(OSError):  # the other end has ended
            self._connection.sendall(json.dumps(message).encode() + b"\n")

    def receive(self) -> Orders | None:
        """The next message; None: the other end has ended."""
        while b"\n" not in self._rest:
            try:
                data = self._connection.recv(65536)
            except OSError:
                return None
            if not data:
                return None
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        message: Orders = json.loads(line)
        return message

    def close(self) -> None:
        self._connection.close()


class Runner:
    """The end of a replay's process: `orders` are what it is to do, `known` the periods that have snapshots."""

    def __init__(self, address: str) -> None:
        self._address = address
        self.orders: Orders = {}
        self.known: set[int] = set()
        self._link = self._begin({})

    def _begin(self, orders: Orders) -> Link:
        self.orders, self.known = orders, set(orders.get("known", ()))
        link = Link.to(self._address)
        link.send(kind="runner")
        return link

    def snapshot(self, period: int) -> None:
        """Fork a snapshot of this moment, the end of a period. It returns in the runner, and again, with other orders,
        in each process that goes on from here."""
        ready, told = os.pipe()
        self.known.add(period)
        if os.fork() == 0:
            os.close(ready)
            self._link.close()
            self._wait(period, told)
            return
        os.close(told)
        os.read(ready, 1)
        os.close(ready)

    def _wait(self, period: int, told: int) -> None:
        """The life of a snapshot; it returns in the runners that begin here."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for the runners
        try:
            link = Link.to(self._address)
        except OSError:
            os._exit(0)
        link.send(kind="snapshot", period=period)
        os.close(told)
        while True:
            orders = link.receive()
            if orders is None:
                os._exit(0)
            parent = os.getpid()
            if os.fork() == 0:
                die_with_parent(parent, signal.SIGKILL)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                link.close()
                self._link = self._begin(orders)
                return

    def go(self, **orders: Any) -> NoReturn:
        """Let a process go on from an earlier snapshot, and end this one."""
        self._link.send(kind="go", **orders)
        os._exit(0)

    def end(self, status: int) -> NoReturn:
        """The replay is over."""
        self._link.send(kind="end", status=status)
        os._exit(0)


class SnapshotList:
    """The process that keeps the snapshots."""

    def __init__(self) -> None:
        self._address = f"\0umo-replay-{os.getpid()}-{secrets.token_hex(4)}"
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self._address)
        self._listener.listen(64)
        self._snapshots: dict[int, Link] = {}
        self._visited: list[int] = []
        """The periods of the snapshots, those that were made or used last at the end."""

    def run(self, begin: Callable[[Runner], int]) -> int:
        """Let `begin` replay in processes of their own, until one of them ends; the exit status. It returns an exit
        status, and may be left by `Runner.go` and `Runner.end` instead."""
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the runner
        parent = os.getpid()
        first = os.fork()
        if first == 0:
            self._listener.close()
            die_with_parent(parent, signal.SIGKILL)
            signal.signal(signal.SIGINT, before)
            runner = Runner(self._address)
            status = 1
            try:
                status = begin(runner)
            finally:
                runner.end(status)
        try:
            return self._serve()
        finally:
            signal.signal(signal.SIGINT, before)
            for link in self._snapshots.values():
                link.close()
            self._listener.close()
            with suppress(ChildProcessError):
                os.waitpid(first, 0)

    def _serve(self) -> int:
        runner: Link | None = None
        while True:
            watched: list[Any] = [self._listener, *([] if runner is None else [runner])]
            readable, _, _ = select.select(watched, [], [])
            runner = self._accept_all() or runner
            if runner is None or runner not in readable:
                continue
            message = runner.receive()
            if message is None or message["kind"] == "end":
                return 1 if message is None else int(message["status"])
            runner.close()
            runner = None
            self._go(message)

    def _accept_all(self) -> Link | None:
        """Take in who has come; the runner that is among them."""
        runner = None
        while select.select([self._listener], [], [], 0)[0]:
            link = Link(self._listener.accept()[0])
            message = link.receive()
            if message is None:
                link.close()
            elif message["kind"] == "runner":
                runner = link
            else:
                self._keep(int(message["period"]), link)
        return runner

    def _keep(self, period: int, link: Link) -> None:
        self._snapshots[period] = link
        self._visited.append(period)
        if len(self._visited) > MOST + 1:
            oldest = next(each for each in self._visited if each != min(self._snapshots))
            self._visited.remove(oldest)
            self._snapshots.pop(oldest).close()

    def _go(self, orders: Orders) -> None:
        """Let the last snapshot before a period go on to it."""
        period = max(each for each in self._snapshots if each <= max(orders["period"], min(self._snapshots)))
        self._visited.remove(period)
        self._visited.append(period)
        self._snapshots[period].send(**orders, known=list(self._snapshots))
