"""Prometheus: the machine as metrics. Prometheus, and any other program that reads its text format, scrapes them. The
face only reads."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from math import isnan
from pathlib import Path
from typing import Any

import uvicorn
from prometheus_client import CollectorRegistry, make_asgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from uvicorn.protocols.http.h11_impl import H11Protocol

from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.face import Changes, Commands, Face
from umo.objects import Quality
from umo.process.frames.machine_items import Declaration, ItemKind

PORT = 9464
MAX_CLIENTS = 16
"""Largest number of simultaneous connections; further ones are refused with status 503."""
IDLE_TIMEOUT = 5
"""Time in s after which a connection is closed if its client sends no request, or does not read the response. Closing
may take up to twice this time."""
NUMBERS = (ItemKind.SENSOR, ItemKind.ACTUATOR, ItemKind.SIGNAL, ItemKind.TUNABLE)
FRESH = Quality.UNREFERENCED
"""The worst quality with which a value is exported. A value that is STALE or BAD is left out."""


class MetricsConnection(H11Protocol):
    """A connection with a limit on idle time. uvicorn would keep a connection open for ever if it never sends a
    request, and would count it as a client."""

    _watching: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._watching = self.loop.call_later(IDLE_TIMEOUT, self._watch, None)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._watching is not None:
            self._watching.cancel()
        super().connection_lost(exc)

    def _watch(self, before: Any) -> None:
        if self.cycle is before and (before is None or before.response_complete):
            self.transport.abort()
        else:
            self._watching = self.loop.call_later(IDLE_TIMEOUT, self._watch, self.cycle)


class MetricsServer(uvicorn.Server):
    """A server that does not change the signal handlers of the process."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class Prometheus(Face):
    """Serves `/metrics`.

    Options:
        port: the TCP port of the server.
        host: the address of the server. If other computers reach it, it needs `certificate` and `clients`.
        certificate: file of the server's certificate and key (PEM).
        clients: file of the certificates by which clients are known (PEM).
    """

    takes_commands = False

    def __init__(
        self, port: int = PORT, host: str = "127.0.0.1", certificate: Path | None = None, clients: Path | None = None
    ) -> None:
        self._endpoint = Endpoint(host, port, certificate, clients)
        self._metrics = Metrics()
        self._server: MetricsServer | None = None
        self._serving: asyncio.Task[None] | None = None

    async def open(self) -> None:
        registry = CollectorRegistry()
        registry.register(self._metrics)
        config = uvicorn.Config(
            make_asgi_app(registry), http=MetricsConnection, ws="none", lifespan="off", log_level="error",
            access_log=False, server_header=False, proxy_headers=False, limit_concurrency=MAX_CLIENTS,
            timeout_keep_alive=IDLE_TIMEOUT, timeout_graceful_shutdown=1,
        )  # fmt: skip
        context = self._endpoint.context()
        config.load()
        config.ssl = context
        listening = self._endpoint.listening()
        self.address = f"http{'s' if context else ''}://{self._endpoint.host}:{listening.getsockname()[1]}/metrics"
        self._server = MetricsServer(config)
        self._serving = asyncio.create_task(self._server.serve([listening]))

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self._metrics.machine = machine

    async def frames(self, changes: Changes) -> None:
        self._metrics.changes = changes

    async def end(self, why: str) -> None:
        self._metrics.changes = None

    async def close(self) -> None:
        if self._server is not None and self._serving is not None:
            self._server.should_exit = True
            await self._serving


class Metrics(Collector):
    """Makes the metrics on request. Without `changes` the metrics only report that the machine is not available."""

    def __init__(self) -> None:
        self.machine: Declaration | None = None
        self.changes: Changes | None = None

    def collect(self) -> Iterator[Metric]:
        machine, changes = self.machine, self.changes
        up = GaugeMetricFamily("umo_up", "Whether the station runs.", labels=["station"])
        up.add_metric([machine.station if machine else ""], float(changes is not None))
        yield up
        if machine is None or changes is None:
            return
        info = GaugeMetricFamily("umo_run", "The run: always 1.", labels=["station", "wiring", "run"])
        info.add_metric([machine.station, machine.wiring, machine.run], 1.0)
        yield info
        yield from _run_metrics(machine, changes)
        yield from _value_metrics(machine, changes)


def _run_metrics(machine: Declaration, changes: Changes) -> Iterator[Metric]:
    """Yield the metrics of the run: periods, missed periods, latency, and the UTC of the last period."""
    places = {item.path: item.number for item in machine.of_kind(ItemKind.RUN)}
    values = {path: float(changes.values[place]) for path, place in places.items()}
    counters = {
        "periods": "Number of periods of the run.",
        "missed": "Number of missed periods of the run.",
    }
    for name, text in counters.items():
        counter = CounterMetricFamily(f"umo_{name}", text, labels=["station"])
        counter.add_metric([machine.station], values[name])
        yield counter
    gauges = {
        "execution": "Longest time from waking up to the end of a period, since the last reading.",
        "wake": "Longest time from the tick to waking up, since the last reading.",
    }
    for name, text in gauges.items():
        if changes.quality[places[name]] <= FRESH:
            gauge = GaugeMetricFamily(f"umo_{name}_seconds", text, labels=["station"])
            gauge.add_metric([machine.station], values[name])
            yield gauge
    last = GaugeMetricFamily("umo_last_period_timestamp_seconds", "UTC of the last period.", labels=["station"])
    last.add_metric([machine.station], changes.utc)
    yield last


def _value_metrics(machine: Declaration, changes: Changes) -> Iterator[Metric]:
    labels = ["station", "path", "kind"]
    value = GaugeMetricFamily(
        "umo_value", "Value of a number; missing while the quality is stale or bad.", labels=[*labels, "unit"]
    )
    state = GaugeMetricFamily(
        "umo_state", "1 for the current state, 0 for each other state.", labels=[*labels, "state"]
    )
    quality = GaugeMetricFamily(
        "umo_quality", f"{', '.join(f'{int(each)} {each}' for each in Quality)}.", labels=["station", "path"]
    )
    for item in machine.items:
        number = float(changes.values[item.number])
        grade = int(changes.quality[item.number])
        if item.kind in (ItemKind.SENSOR, ItemKind.ACTUATOR):
            quality.add_metric([machine.station, item.path], grade)
        if grade > FRESH or isnan(number) or (item.kind is ItemKind.RUN and not item.states):
            continue
        about = [machine.station, item.path, item.kind.value]
        if item.states:
            for name in dict.fromkeys(item.states.values()):  # a series that is there twice spoils the scrape
                state.add_metric([*about, name], float(name == item.state_of(number)))
        elif item.kind in NUMBERS:
            value.add_metric([*about, item.unit], number)
    yield from (value, state, quality)
