"""A nats-server with a JetStream on a free port of loopback, which can be killed and begun again with its store."""

from __future__ import annotations

import asyncio
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.fleets import free_port

PROGRAM = shutil.which("nats-server") or next(
    (str(each) for each in map(Path, ("/usr/sbin/nats-server", "/usr/local/bin/nats-server")) if each.exists()), None
)
needs_server = pytest.mark.skipif(PROGRAM is None, reason="the program nats-server is not installed")


class NatsServer:
    """`more`: lines of its configuration."""

    def __init__(self, folder: Path, more: str = "") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.port, self._folder = free_port(), folder
        self._config = folder / "nats.conf"
        self._config.write_text(f'jetstream {{ store_dir: "{folder}/store" }}\n{more}\n')
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"nats://127.0.0.1:{self.port}"

    def begin(self) -> None:
        """Start it, and wait until it takes connections."""
        assert PROGRAM is not None
        words = [PROGRAM, "-c", str(self._config), "-a", "127.0.0.1", "-p", str(self.port), "-l", f"{self._folder}/log"]
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        until = time.monotonic() + 20.0
        while time.monotonic() < until:
            with socket.socket() as tried:
                if tried.connect_ex(("127.0.0.1", self.port)) == 0 and "Server is ready" in self.log:
                    return
            time.sleep(0.02)
        raise AssertionError(f"nats-server does not begin: {self.log}")

    @property
    def log(self) -> str:
        file = self._folder / "log"
        return file.read_text() if file.exists() else ""

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            (self._folder / "log").unlink(missing_ok=True)

    async def killed(self) -> None:
        await asyncio.to_thread(self.kill)

    async def begun(self) -> None:
        await asyncio.to_thread(self.begin)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[NatsServer]:
    made = NatsServer(tmp_path / "nats")
    made.begin()
    yield made
    made.kill()
