"""The z-theta loop at 1 ms with the page of `umo view` open and without, in turns in one run.

The page shows 16 traces over 60 s in Chromium; then a hundred pages are open, as websockets that read and draw nothing.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any
from urllib.parse import urlencode

import numpy as np

import umo
from bench.realtime import ENOUGH, take
from bench.realtime import Loops as Loop
from bench.report import Target
from umo.cycle.stage import Stage
from umo.frames import Reader
from umo.latency import Samples
from umo.process.start import Started

TITLE = "The page beside the loop"
TRACES, SPAN = 16, 60
PAGES = 100
LIMIT = 1.05
SETTLE = 1.5
"""s after the page was opened or closed."""
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
CLIENTS = """
import asyncio, json, sys
from websockets.asyncio.client import connect
url, count, paths = sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3])
async def page():
    async with connect(url, max_size=None) as socket:
        async for text in socket:
            if isinstance(text, str) and json.loads(text)["type"] == "description":
                await socket.send(json.dumps({"type": "live", "id": 1, "paths": paths, "span": 60, "width": 1200}))
async def main():
    await asyncio.gather(*(page() for _ in range(count)))
asyncio.run(main())
"""
Open = Callable[[str, list[str]], AbstractContextManager[object]]


def measure(rounds: int, seconds: float) -> list[Target]:
    """Rounds of so many s with the page and as many without, for each kind of page that can be had here."""
    found = []
    with _served() as address, _browser() as browser:
        if browser is not None:
            found += _compared(
                f"the page in Chromium, {TRACES} traces over {SPAN} s", browser, address, rounds, seconds
            )
        what = f"{PAGES} pages, {TRACES} traces each, without a browser"
        return found + _compared(what, _clients, address, rounds, seconds)


def _compared(what: str, kind: Open, address: str, rounds: int, seconds: float) -> list[Target]:
    without, beside = Loop(Samples(), None, 0), Loop(Samples(), None, 0)
    while rounds:
        with _station() as started:
            frames, left = started.frames, rounds
            assert frames is not None, started.outcome
            paths = [*frames.paths, *frames.signals][:TRACES]
            while rounds and frames.state is Stage.RUNNING:
                _sample(frames, without, seconds)
                with kind(address, paths):
                    _sample(frames, beside, seconds)
                rounds -= 1
            if rounds == left:
                raise RuntimeError(f"the station did not run: {started.outcome}")
    ratios = [np.percentile(beside.umo.total, share) / np.percentile(without.umo.total, share) for share in (50, 99)]
    verdict = "met" if ratios[0] <= LIMIT else f"missed by {ratios[0] / LIMIT - 1:.0%}"
    ratio = f"p50 {ratios[0]:.3f}, p99 {ratios[1]:.3f} times"
    return [
        Target(what, f"p50 at most {LIMIT} times without", ratio, verdict),
        Target("  with it", "-", _two(beside.umo), f"missed {beside.umo.missed:,}"),
        Target("  without", "-", _two(without.umo), f"missed {without.umo.missed:,}"),
    ]


@contextmanager
def _station() -> Iterator[Started]:
    """z-theta at work, with as many parts as it takes."""
    with umo.start("ztheta", parts=6, realtime=True, acknowledge=True) as started:
        while started.outcome is None and (started.frames is None or started.frames.state is not Stage.RUNNING):
            started.poll(0.1)
        yield started
        started.stop()


def _two(samples: Samples) -> str:
    middle, late = np.percentile(samples.total, [50, 99])
    return f"waking up + execution p50 {middle:.1f}, p99 {late:.1f} us of {len(samples.total):,}"


def _sample(frames: Reader, into: Loop, seconds: float) -> None:
    time.sleep(SETTLE)
    frames.read()
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(ENOUGH)
        take(frames, into)


@contextmanager
def _served() -> Iterator[str]:
    """`umo view`, and its address."""
    command = [sys.executable, "-c", "from umo.cli import main; main()", "view", "ztheta", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().strip()
        finally:
            server.terminate()


@contextmanager
def _clients(address: str, paths: list[str]) -> Iterator[None]:
    url = address.replace("http", "ws", 1).replace("/?", "/ws?")
    command = [sys.executable, "-c", CLIENTS, url, str(PAGES), json.dumps(paths)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
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
