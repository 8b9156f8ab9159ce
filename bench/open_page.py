"""The z-theta loop at 1 ms with the page of `umo show page` open and without, in turns in one run.

The page shows 16 traces over 60 s in Chromium; then a hundred pages are open, as websockets that ask for what a scope
asks for, read it, and draw nothing.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np

import umo
from bench.realtime import ENOUGH, take
from bench.report import Doing, Target
from umo.commissioning.latency import Samples
from umo.cycle.stage import Stage
from umo.process.frames import Reader
from umo.process.start import Started

TITLE = "The page beside the loop"
TRACES, SPAN = 16, 60
PAGES = 100
LIMIT = 1.05
SETTLE = 1.5
"""s after the page was opened or closed."""
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
CLIENTS = """
import asyncio, json, sys, time
from websockets.asyncio.client import connect
url, count, span, paths = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), json.loads(sys.argv[4])
shown = 0
async def page():
    global shown
    begun, asked = False, float("inf")
    async with connect(url, max_size=None) as socket:
        async for message in socket:
            if isinstance(message, bytes):
                if not begun:
                    begun, asked, shown = True, 0.0, shown + 1
                    if shown == count:
                        print("shown", flush=True)
                continue
            message = json.loads(message)
            if message["type"] == "description":
                await socket.send(json.dumps({"type": "live", "id": 1, "paths": paths, "span": span, "width": 1200}))
            elif message["type"] == "measured":
                asked = sent
            elif message["type"] == "state" and time.monotonic() > asked + 1:
                sent, asked = time.monotonic(), float("inf")
                about = {"paths": paths, "start": max(0, message["stop"] - span), "stop": message["stop"]}
                await socket.send(json.dumps({"type": "measure", "id": 2} | about))
async def main():
    await asyncio.gather(*(page() for _ in range(count)))
asyncio.run(main())
"""
UMO = [sys.executable, "-c", "from umo_command import main; main()"]
Open = Callable[[str, list[str]], AbstractContextManager[object]]


def measure(rounds: int, seconds: float, doing: Doing) -> Iterator[Target]:
    """Rounds of so many s with the page and as many without, for each kind of page that can be had here."""
    kinds: list[tuple[str, Open]] = [(f"{PAGES} pages, {TRACES} traces each, without a browser", pages)]
    with served() as server, _browser() as browser:
        if browser is not None:
            kinds.insert(0, (f"the page in Chromium, {TRACES} traces over {SPAN} s", browser))
        for what, kind in kinds:
            doing(what)
            yield from _compared(what, kind, server, rounds, seconds)


def _compared(what: str, kind: Open, server: Server, rounds: int, seconds: float) -> list[Target]:
    without, beside = Samples(), Samples()
    busy, taken = 0.0, rounds * (SETTLE + seconds)
    while rounds:
        with running_station(parts=6) as started:
            frames, left = started.frames, rounds
            assert frames is not None
            paths = [*frames.paths, *frames.signals][:TRACES]
            while rounds and frames.state is Stage.RUNNING:
                _sample(frames, without, seconds)
                with kind(server.address, paths):
                    before = server.busy()
                    _sample(frames, beside, seconds)
                    busy += server.busy() - before
                rounds -= 1
            if rounds == left:
                raise RuntimeError(f"the station did not run: {started.outcome}")
    ratios = [np.percentile(beside.total, share) / np.percentile(without.total, share) for share in (50, 99)]
    verdict = "met" if ratios[0] <= LIMIT else f"missed by {ratios[0] / LIMIT - 1:.0%}"
    ratio = f"p50 {ratios[0]:.3f}, p99 {ratios[1]:.3f} times"
    return [
        Target(what, f"p50 at most {LIMIT} times without", ratio, verdict),
        Target("  with it", "-", _two(beside), f"missed {beside.missed:,}"),
        Target("  without", "-", _two(without), f"missed {without.missed:,}"),
        Target("  the server", "-", f"{busy / taken:.0%} of a core", ""),
    ]


@contextmanager
def running_station(**options: Any) -> Iterator[Started]:
    """z-theta at work in real time. RuntimeError if it ends before."""
    with umo.start("ztheta", realtime=True, acknowledge=True, **options) as started:
        while started.frames is None or started.frames.state is not Stage.RUNNING:
            started.poll(0.1)
            expect_running(started)
        yield started
        started.stop()


def expect_running(started: Started) -> None:
    """RuntimeError if the station has ended."""
    if started.outcome is not None:
        raise RuntimeError(f"the station did not run: {started.outcome}")


def _two(samples: Samples) -> str:
    middle, late = np.percentile(samples.total, [50, 99])
    return f"waking up + execution p50 {middle:.1f}, p99 {late:.1f} us of {len(samples.total):,}"


def _sample(frames: Reader, into: Samples, seconds: float) -> None:
    time.sleep(SETTLE)
    frames.read()
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(ENOUGH)
        take(frames, into)


@dataclass(frozen=True)
class Server:
    """`umo show page ztheta`."""

    address: str
    pid: int

    def busy(self) -> float:
        """s that it has had the processor."""
        times = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(times[11]) + int(times[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def served() -> Iterator[Server]:
    command = [*UMO, "show", "page", "ztheta", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield Server(server.stdout.readline().strip(), server.pid)
        finally:
            server.terminate()


@contextmanager
def pages(address: str, paths: list[str], count: int = PAGES) -> Iterator[None]:
    """So many pages that show the traces, until the end of the block."""
    url = address.replace("http", "ws", 1).replace("/?", "/ws?")
    command = [sys.executable, "-c", CLIENTS, url, str(count), str(SPAN), json.dumps(paths)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            if not process.stdout.readline():
                raise RuntimeError("not all pages were shown: see the error above")
            yield
        finally:
            process.kill()


@contextmanager
def _browser() -> Iterator[Open | None]:
    """Opens the page in Chromium; None without Chromium or Playwright."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        path = None
    if path is None:
        yield None
        return
    with sync_playwright() as driver:
        chromium: Any = driver.chromium.launch(executable_path=path, args=list(FLAGS))

        @contextmanager
        def opened(address: str, paths: list[str]) -> Iterator[None]:
            page = chromium.new_page(viewport={"width": 1440, "height": 900})
            page.goto(f"{address}#{urlencode({'traces': ','.join(paths), 'span': SPAN})}")
            page.locator(".legend tbody tr").nth(len(paths) - 1).wait_for()
            try:
                yield
            finally:
                page.close()

        try:
            yield opened
        finally:
            chromium.close()
