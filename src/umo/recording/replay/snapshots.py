"""Snapshots of a replay. A snapshot is a forked process that waits. To go back, a snapshot forks, and the copy
continues.

Only a fork preserves coroutines, laws and profiles. One process keeps the list (`SnapshotList`) and has no replay
itself. It lets one runner run at a time. A runner forks a snapshot from time to time. Each process has one connection
to the list. A snapshot ends when its connection is closed; a runner ends when its snapshot ends (PDEATHSIG).
"""

from __future__ import annotations

import json
import os
import secrets
import select
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

from umo.system import calls
from umo.system.processes import Child, wait_for_any
from umo.system.realtime import adopt_orphans

POSSIBLE = sys.platform.startswith("linux") and hasattr(os, "fork")
"""True if this platform supports snapshots: it must have forks, and processes that end with their parents."""
START = -1
"""The period number of the snapshot that stands before the first period."""
EVERY = 2000
"""Number of periods between two snapshots."""
MOST = 15
"""Number of snapshots that are kept in addition to the first one. They take some MB each, and cover the last 30,000
visited periods."""
BEGIN_TIMEOUT = 5.0
"""Timeout in s for a process to register in the list: for a forked snapshot, and for a new connection."""
CHILD_END_TIMEOUT = 2.0
"""Time in s within which the processes must end."""
Orders = dict[str, Any]


class Link:
    """A connection of a runner or a snapshot to the list. Messages are lines of JSON."""

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
        """Return the next message, or None if the other end has ended."""
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
    """The connection in the process of a replay. `orders`: the orders that the process has received; `known`: the times
    in s of the periods with snapshots."""

    def __init__(self, address: str) -> None:
        self._address = address
        self.orders: Orders = {}
        self.known: dict[int, float] = {}
        self._children: list[Child] = []
        """The processes of the snapshots that this runner has forked and that have not ended."""
        self._link = self._begin({})

    def _begin(self, orders: Orders) -> Link:
        self.orders, self.known = orders, dict(orders.get("known", ()))
        link = Link.to(self._address)
        link.send(kind="runner")
        return link

    def snapshot(self, period: int, time: float) -> None:
        """Fork a snapshot of the present state, at the end of a period. The call returns in the runner. It returns
        again, with other orders, in each process that continues from here. If the computer has no memory for the
        snapshot, none is made."""
        self._children = [each for each in self._children if not each.ended]
        ready, told = os.pipe()
        try:
            child = os.fork()
        except OSError:
            os.close(ready)
            os.close(told)
            return
        if child == 0:
            os.close(ready)
            self._link.close()
            self._wait(period, time, told)
            return
        self._children.append(Child(child))
        os.close(told)
        if not select.select([ready], [], [], BEGIN_TIMEOUT)[0]:  # stopped: there is no snapshot of this moment
            self._children[-1].end(CHILD_END_TIMEOUT)
        elif os.read(ready, 1):
            self.known[period] = time
        os.close(ready)

    def _wait(self, period: int, time: float, told: int) -> None:
        """Wait for requests in a snapshot. Returns only in the runners that are forked from it."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for the runners
        self._children = []
        try:
            link = Link.to(self._address)
        except OSError:
            os._exit(0)
        link.send(kind="snapshot", period=period, time=time)
        os.write(told, b"1")
        os.close(told)
        while True:
            orders = link.receive()
            if orders is None:
                os._exit(0)
            parent = os.getpid()
            try:
                child = os.fork()
            except OSError:  # the list sees its end, and takes an earlier one
                os._exit(0)
            if child == 0:
                calls.die_with_parent(parent, signal.SIGKILL)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                link.close()
                self._link = self._begin(orders)
                return

    def go(self, **orders: Any) -> NoReturn:
        """Let a process continue from an earlier snapshot, and end this process."""
        self._link.send(kind="go", **orders)
        os._exit(0)

    def end(self, status: int) -> NoReturn:
        """End the replay."""
        self._link.send(kind="end", status=status)
        os._exit(0)


def _is_own(connection: socket.socket) -> bool:
    """True if a process of the same user is at the other end."""
    _, user, _ = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return bool(user == os.getuid())


class SnapshotList:
    """The process that keeps the snapshots."""

    def __init__(self) -> None:
        self._address = f"\0umo-replay-{os.getpid()}-{secrets.token_hex(4)}"
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self._address)
        self._listener.listen(64)
        self._snapshots: dict[int, Link] = {}
        self._times: dict[int, float] = {}
        self._origin = START
        """The period of the snapshot from which the runner was forked. The runner lives only as long as this
        snapshot."""
        self._orders: Orders = {}
        self._visited: list[int] = []
        """The periods of the snapshots, in the order in which they were last made or used."""

    def run(self, begin: Callable[[Runner], int]) -> int:
        """Let `begin` replay in separate processes until one of them ends, and return the exit status. `begin` returns
        an exit status, or ends through `Runner.go` or `Runner.end`."""
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the runner
        adopt_orphans(True)
        try:
            self._fork_first(begin, before)
            return self._serve()
        finally:
            for link in self._snapshots.values():
                link.close()
            self._listener.close()
            _await_all()
            adopt_orphans(False)
            signal.signal(signal.SIGINT, before)

    def _fork_first(self, begin: Callable[[Runner], int], handler: Any) -> None:
        parent = os.getpid()
        if os.fork() == 0:
            self._listener.close()
            calls.die_with_parent(parent, signal.SIGKILL)
            signal.signal(signal.SIGINT, handler)
            runner = Runner(self._address)
            status = 1
            try:
                status = begin(runner)
            finally:
                runner.end(status)

    def _serve(self) -> int:
        runner: Link | None = None
        while True:
            asked = self._snapshots.get(self._origin) if runner is None and self._orders else None
            readable, _, _ = select.select(
                [each for each in (self._listener, runner, asked) if each is not None], [], []
            )
            wait_for_any()
            came = self._accept_all()
            if came is not None:
                runner, self._orders = came, {}
            elif asked in readable and asked is not None:  # it has ended instead
                self._drop(self._origin)
                if not self._snapshots:
                    return _lost()
                self._go(self._orders)
            elif runner is not None and runner in readable:
                message = runner.receive()
                if message is None:
                    return _lost()
                if message["kind"] == "end":
                    return int(message["status"])
                runner.close()
                runner = None
                self._go(message)

    def _accept_all(self) -> Link | None:
        """Accept all new connections. Return the connection of a new runner, or None if there is no new runner."""
        runner = None
        while select.select([self._listener], [], [], 0)[0]:
            connection = self._listener.accept()[0]
            if not _is_own(connection):
                connection.close()
                continue
            connection.settimeout(BEGIN_TIMEOUT)
            link = Link(connection)
            message = link.receive()
            connection.settimeout(None)
            if message is None:
                link.close()
            elif message["kind"] == "runner":
                runner = link
            else:
                self._keep(int(message["period"]), float(message["time"]), link)
        return runner

    def _keep(self, period: int, time: float, link: Link) -> None:
        self._snapshots[period], self._times[period] = link, time
        self._visited.append(period)
        if len(self._visited) > MOST + 1:
            kept = (min(self._snapshots), self._origin)  # and the runner ends with its origin
            self._drop(next(each for each in self._visited if each not in kept))

    def _drop(self, period: int) -> None:
        self._visited.remove(period)
        self._snapshots.pop(period).close()
        del self._times[period]

    def _go(self, orders: Orders) -> None:
        """Continue from the last snapshot that is not after a period; from the first one if there is none."""
        first = min(self._snapshots)
        self._origin = max((each for each in self._snapshots if each <= orders["period"]), default=first)
        self._orders = orders
        self._visited.remove(self._origin)
        self._visited.append(self._origin)
        self._snapshots[self._origin].send(**orders, known=list(self._times.items()))


def _await_all() -> None:
    """Wait until all child processes have ended, at most `CHILD_END_TIMEOUT` s. Processes that control code has started
    in the background may continue."""
    until = time.monotonic() + CHILD_END_TIMEOUT
    while wait_for_any() and time.monotonic() < until:
        time.sleep(0.002)


def _lost() -> int:
    print("the process of the replay has been ended", file=sys.stderr)
    return 1
