"""Computers of one network on this one: a network namespace each, joined by a bridge in a namespace of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from types import TracebackType

PREFIX = "10.77.0."
FIRST = 10
"""The last part of the address of the first computer."""


def missing() -> str | None:
    """Why there can be no namespaces here; None: there can."""
    if not sys.platform.startswith("linux") or shutil.which("ip") is None:
        return "network namespaces need Linux and the command ip"
    if os.geteuid() != 0:
        return "network namespaces need root"
    name = f"umo{os.getpid()}try"
    if _ip("netns", "add", name, check=False):
        return "network namespaces are not permitted here"
    _ip("netns", "del", name)
    return None


class Network:
    """`count` computers, each with an address. `with` makes them, and removes them with all that is in them."""

    def __init__(self, count: int) -> None:
        self._tag = f"umo{os.getpid()}"
        self.names = [f"{self._tag}c{number}" for number in range(count)]
        self._switch = f"{self._tag}sw"

    def address(self, number: int) -> str:
        """The IP address of a computer."""
        return f"{PREFIX}{FIRST + number}"

    def command(self, number: int) -> Sequence[str]:
        """The words before a command that is to run on a computer. The process keeps its pid."""
        return "ip", "netns", "exec", self.names[number]

    def unplug(self, number: int) -> None:
        """Take the cable of a computer out: no end of a connection is told of it."""
        _ip("-n", self._switch, "link", "set", f"v{number}", "down")

    def plug(self, number: int) -> None:
        _ip("-n", self._switch, "link", "set", f"v{number}", "up")

    def __enter__(self) -> Network:
        try:
            _ip("netns", "add", self._switch)
            _ip("-n", self._switch, "link", "add", "bridge", "type", "bridge")
            _ip("-n", self._switch, "link", "set", "bridge", "up")
            for number, name in enumerate(self.names):
                self._add(number, name)
        except BaseException:
            self._remove()
            raise
        return self

    def _add(self, number: int, name: str) -> None:
        port = f"v{number}"
        _ip("netns", "add", name)
        _ip("-n", self._switch, "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", name)
        _ip("-n", self._switch, "link", "set", port, "master", "bridge")
        _ip("-n", self._switch, "link", "set", port, "up")
        _ip("-n", name, "address", "add", f"{self.address(number)}/24", "dev", "eth0")
        for link in ("lo", "eth0"):
            _ip("-n", name, "link", "set", link, "up")

    def _remove(self) -> None:
        for name in (*self.names, self._switch):
            _ip("netns", "del", name, check=False)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._remove()


def _ip(*words: str, check: bool = True) -> int:
    done = subprocess.run(["ip", *words], capture_output=True, text=True)
    if check and done.returncode:
        raise RuntimeError(f"ip {' '.join(words)}: {done.stderr.strip()}")
    return done.returncode
