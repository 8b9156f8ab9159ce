"""The face Prometheus, read by Prometheus itself; its text is judged by promtool and taken by VictoriaMetrics."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from helpers.faced import Recorder, hosted
from umo.clients.faces.conformance import RULES, ForeignClient, Seen, TriedFace, TriedMachine, try_rule
from umo.clients.faces.conformance.client import Grade
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.face import Face
from umo.clients.faces.prometheus import MAX_CLIENTS, Prometheus
from umo.errors import OptionError, UmoError

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(shutil.which("promtool") is None, reason="Debian's package prometheus is not installed"),
]
CONFIG = """
global: {{scrape_interval: 100ms, scrape_timeout: 100ms}}
scrape_configs: [{{job_name: umo, static_configs: [{{targets: ["{target}"]}}]}}]
"""
LEVEL = 'umo_value{path="cell.level"}'
NO_VALUE = Seen(None, Grade.NONE)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def fetched(address: str) -> str:
    with urllib.request.urlopen(address, timeout=5) as answer:
        return str(answer.read().decode())


def target_of(face: Face) -> str:
    assert isinstance(face, Prometheus)
    return urllib.parse.urlsplit(face.address).netloc


class PrometheusServer(ForeignClient):
    """A Prometheus that scrapes the face, asked by its own API."""

    has_times = False

    def __init__(self, folder: Path, target: str) -> None:
        self._port = free_port()
        config = folder / f"prometheus-{self._port}.yml"
        config.write_text(CONFIG.format(target=target))
        self._process = subprocess.Popen(
            [
                "prometheus", f"--config.file={config}", f"--storage.tsdb.path={folder / str(self._port)}",
                f"--web.listen-address=127.0.0.1:{self._port}", "--log.level=error", "--query.lookback-delta=1s",
            ],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    async def query(self, text: str) -> list[dict[str, Any]]:
        address = f"http://127.0.0.1:{self._port}/api/v1/query?query={urllib.parse.quote(text)}"
        with suppress(OSError, ValueError):
            found = json.loads(await asyncio.to_thread(fetched, address))
            return list(found["data"]["result"])
        return []

    async def read(self, name: str) -> Seen:
        kind, _, path = name.rpartition(":")
        where = f'path="{path}"' + (f',kind="{kind}"' if kind else ',kind!~"alarm|equipment|tunable|axis|run"')
        values, states, qualities = await asyncio.gather(
            self.query(f"umo_value{{{where}}}"),
            self.query(f"umo_state{{{where}}} == 1"),
            self.query(f'umo_quality{{path="{path}"}}'),
        )
        number = float(qualities[0]["value"][1]) if qualities and not kind else 0.0
        grade = Grade.GOOD if number == 0.0 else Grade.DOUBTFUL
        if values:
            return Seen(float(values[0]["value"][1]), grade, unit=values[0]["metric"]["unit"])
        return Seen(states[0]["metric"]["state"], grade) if states else NO_VALUE

    async def close(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def tried(tmp_path: Path) -> TriedFace:
    async def client(face: Face, user: str) -> ForeignClient:
        return PrometheusServer(tmp_path, target_of(face))

    return TriedFace("prometheus", lambda: Prometheus(port=0), client, commands=False)


@pytest.mark.parametrize("name", RULES)
def test_prometheus_passes_the_kit(tried: TriedFace, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "umo.clients.faces.conformance.face_rules.CHANGE_TIMEOUT", 8.0
    )  # scrapes, and Prometheus begins
    assert asyncio.run(try_rule(tried, RULES[name])) in (None, "")


@pytest.mark.smoke
def test_its_text_pleases_promtool() -> None:
    async def work() -> str:
        async with TriedMachine() as machine:
            face, other = Prometheus(port=0), Recorder()
            async with hosted(machine, face, other):
                await until(lambda: other.told)
                return await asyncio.to_thread(fetched, face.address)

    text = asyncio.run(work())
    judged = subprocess.run(["promtool", "check", "metrics"], input=text, text=True, capture_output=True, timeout=30)
    assert (judged.returncode, judged.stdout + judged.stderr) == (0, "")
    assert 'umo_value{kind="sensor",path="cell.level",station="plant",unit="mm"} 10.0' in text
    assert 'umo_up{station="plant"} 1.0' in text


def test_without_a_machine_only_that_is_told() -> None:
    async def work() -> tuple[str, str]:
        async with TriedMachine() as machine:
            face, other = Prometheus(port=0), Recorder()
            async with hosted(machine, face, other):
                await until(lambda: other.told)
                await machine.end()
                await until(lambda: other.why)
                return await asyncio.to_thread(fetched, face.address), other.why

    text, _ = asyncio.run(work())
    assert [line for line in text.splitlines() if not line.startswith("#")] == ['umo_up{station="plant"} 0.0']


def test_more_clients_than_are_served_are_refused_and_the_others_go_on() -> None:
    async def work() -> str:
        async with TriedMachine() as machine:
            face, other = Prometheus(port=0), Recorder()
            async with hosted(machine, face, other):
                await until(lambda: other.told)
                host, port = target_of(face).split(":")
                idle = [await asyncio.open_connection(host, int(port)) for _ in range(MAX_CLIENTS + 4)]
                for _, writer in idle:
                    writer.close()
                return await asyncio.to_thread(fetched, face.address)

    assert "umo_up" in asyncio.run(work())


def test_clients_that_ask_nothing_or_take_nothing_are_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.prometheus.IDLE_TIMEOUT", 0.2)

    async def work() -> None:
        async with TriedMachine() as machine:
            face, other = Prometheus(port=0), Recorder()
            async with hosted(machine, face, other):
                await until(lambda: other.told)
                host, port = target_of(face).split(":")
                opened = [await asyncio.open_connection(host, int(port)) for _ in range(MAX_CLIENTS + 4)]
                for number, (_, writer) in enumerate(opened):
                    writer.write(b"" if number % 2 else b"GET /metrics HTT")  # half a request
                for reader, writer in opened:
                    with suppress(ConnectionError):
                        assert await asyncio.wait_for(reader.read(), 10.0) == b""
                    writer.close()
                assert "umo_up" in await asyncio.to_thread(fetched, face.address)

    asyncio.run(work())


def test_a_port_that_is_taken_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        face = Prometheus(port=server.getsockname()[1])
        with pytest.raises(UmoError, match=r"port \d+: Address already in use"):
            asyncio.run(face.open())


def test_other_computers_need_certificates() -> None:
    with pytest.raises(OptionError, match="give `certificate`"):
        Prometheus(host="0.0.0.0")


@pytest.mark.skipif(shutil.which("victoria-metrics") is None, reason="Debian's victoria-metrics is not installed")
def test_victoria_metrics_takes_it(tmp_path: Path) -> None:
    async def work() -> list[str]:
        async with TriedMachine() as machine:
            face, other = Prometheus(port=0), Recorder()
            async with hosted(machine, face, other):
                await until(lambda: other.told)
                return await asyncio.to_thread(imported, tmp_path, face.address)

    assert "10" in asyncio.run(work())


def imported(folder: Path, address: str) -> list[str]:
    """The values that VictoriaMetrics has of the level once it has taken the text."""
    port = free_port()
    server = subprocess.Popen(
        ["victoria-metrics", f"-httpListenAddr=127.0.0.1:{port}", f"-storageDataPath={folder / 'vm'}"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        return list(_values(port, fetched(address)))
    finally:
        server.kill()
        server.wait()


def _values(port: int, text: str) -> Iterator[str]:
    base = f"http://127.0.0.1:{port}"
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            urllib.request.urlopen(f"{base}/api/v1/import/prometheus", text.encode(), timeout=5).close()
            found = fetched(f"{base}/api/v1/export?match={urllib.parse.quote(LEVEL)}")
        except OSError:  # it begins
            continue
        if found:
            yield from map(str, json.loads(found.splitlines()[0])["values"])
            return
