"""A station that a test steps, a server of the page on a free port, and a page in Chromium."""

from __future__ import annotations

import asyncio
import hashlib
import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers.machines import bench, wired
from helpers.patient import patient
from umo import connect, published
from umo.clients.faces.conformance.tried_machine import OWN_DEVICES, plant
from umo.clients.page import feed
from umo.testing import Scripted, VirtualTimer, periods

TOKEN = "a token for the tests"
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE = 20.0
"""s"""


KEY_OF = cache(hashlib.scrypt)


@pytest.fixture(autouse=True)
def stations_are_found_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page looks for them once a second."""
    monkeypatch.setattr(feed, "SEARCH_PAUSE", 0.05)


@pytest.fixture(autouse=True)
def key_of_a_token_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes 50 ms of processor time, and each server makes one."""
    monkeypatch.setattr(hashlib, "scrypt", KEY_OF)


def eventually(condition: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """What the condition returns once it is true."""
    until = time.monotonic() + seconds
    while True:
        if found := condition():
            return found
        assert time.monotonic() < until, "the condition did not become true in time"
        time.sleep(0.02)


@contextmanager
def started(folder: Path, name: str = "conveyor", **options: Any) -> Iterator[umo.RemoteStation]:
    """A station in manual mode, attached to."""
    with umo.start(name, patient(name, folder), manual=True, realtime=True, **options) as process:
        eventually(lambda: process.stage.name == "RUNNING")
        with umo.attach(process.pid) as station:
            eventually(lambda: station.reader.head > 5)
            yield station


def search(feed: Any) -> None:
    """Have a feed look for rings once: in a thread, as Playwright's loop may be running in this one."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, feed.search()).result()


@contextmanager
def running(
    name: str = "press", count: int = 50, box: Scripted | None = None, place: Path | None = None, **facts: Any
) -> Iterator[Callable[[int], None]]:
    """A station that this process publishes; the function runs more of its periods of 1 ms. `facts`: of what is run."""
    m = bench()
    wiring = wired(m, box or Scripted({"encoder": range(1, 100_000)}), clock=VirtualTimer())
    connection = connect(m, wiring)
    with connection, published(connection, name, "rig", place=place, job=facts):
        periods(m, count)
        yield lambda more: periods(m, more)


@contextmanager
def alarming(name: str = "tank") -> Iterator[Callable[[int], None]]:
    """A station whose level becomes too high, and whose switch gives nothing any more, in the periods that the function
    runs: an alarm, and equipment in fault."""
    m = plant()
    devices = {"box": Scripted(), "gauge": Scripted({"cell.level": 20}), "ruler": Scripted()}
    wire: dict[str, Any] = {"timer": {"driver": "clock", "period": "1 ms"}}
    wire |= {f"cell.{each}": {"driver": "box"} for each in ("limit", "valve", "lamp")}
    wire |= {path: {"driver": driver} for path, driver in OWN_DEVICES.items()}
    connection = connect(m, {"drivers": {**devices, "clock": VirtualTimer()}, "wire": wire})

    def go_wrong(count: int) -> None:
        devices["gauge"].set("cell.level", 190)
        devices["box"].set("cell.limit", OSError("unplugged"))
        periods(m, count)

    with connection, published(connection, name, "rig"):
        periods(m, 20)
        yield go_wrong


@dataclass
class Served:
    """A server that runs."""

    port: int

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def url(self) -> str:
        return f"{self.origin}/?token={TOKEN.replace(' ', '%20')}"

    @property
    def socket(self) -> str:
        return self.url.replace("http", "ws", 1).replace("/?", "/ws?")


@contextmanager
def serving(port: int = 0, **options: Any) -> Iterator[Served]:
    from umo.clients.page.server import Options, listen, server

    listening = listen("127.0.0.1", port)
    port = listening.getsockname()[1]
    ready = threading.Event()
    serving = server(Options(**{"host": "127.0.0.1", "port": port, "token": TOKEN} | options), ready.set)
    thread = threading.Thread(target=serving.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        assert ready.wait(PATIENCE)
        yield Served(port)
    finally:
        serving.should_exit = True
        thread.join(PATIENCE)
        listening.close()
        assert not thread.is_alive(), "the server did not end in time"


@contextmanager
def viewing(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`umo show page` in a process of its own, and the address that it prints."""
    command = [sys.executable, "-c", "from umo_command import main; main()", "show", "page", "--port", "0", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


class Client:
    """A page without a browser: a websocket."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def send(self, **message: Any) -> None:
        self._socket.send(json.dumps(message))

    def send_text(self, message: str | bytes, text: bool | None = None) -> None:
        """`text`: whether bytes go as text or as binary; None: as what they are."""
        self._socket.send(message, text=text)

    def get(self, kind: str) -> Any:
        """The next message of a type; `points`: a binary one, as (head, times, low, high). TimeoutError after
        PATIENCE, whatever else comes."""
        until = time.monotonic() + PATIENCE
        while (left := until - time.monotonic()) > 0:
            message = self._socket.recv(left)
            if isinstance(message, bytes):
                if kind == "points":
                    return unpacked(message)
            elif (found := json.loads(message))["type"] == kind:
                return found
        raise TimeoutError(f"no {kind} came in time")


@contextmanager
def opened(url: str, **options: Any) -> Iterator[Client]:
    from websockets.sync.client import connect as open_socket

    with open_socket(url, open_timeout=PATIENCE, max_queue=None, **options) as socket:
        yield Client(socket)


def unpacked(message: bytes) -> tuple[dict[str, Any], Any, Any, Any]:
    """As static/feed.js does it."""
    import numpy as np

    length = int.from_bytes(message[:4], "little")
    head = json.loads(message[4 : 4 + length])
    numbers = np.frombuffer(message, "<f8", offset=4 + length)
    rows = numbers.reshape(-1, head["count"])
    low = rows[1 : 1 + head["traces"]]
    return head, rows[0], low, low if head["same"] else rows[1 + head["traces"] :]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of the tests in a browser, make test runs those with the mark smoke; make test-page and make test-all run all."""
    for item in items:
        if "chromium" in getattr(item, "fixturenames", ()) and not item.get_closest_marker("smoke"):
            item.add_marker(pytest.mark.full)


@pytest.fixture(scope="package")
def chromium() -> Iterator[Any]:
    """It ends with the tests of the page: while Playwright runs, asyncio.run cannot be called in its thread."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the tests in a browser need playwright")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("the tests in a browser need Debian's package chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


def complaints_of(page: Any) -> list[str]:
    """What a page of Chromium complains of from now on: errors in its console, exceptions that nobody catches."""
    found: list[str] = []
    page.on("console", lambda message: found.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: found.append(str(error)))
    return found


@pytest.fixture
def page(chromium: Any) -> Iterator[Any]:
    """A page without errors in its console, and without requests to other hosts."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    page = context.new_page()
    page.set_default_timeout(PATIENCE * 1e3)
    faults = complaints_of(page)
    page.on("request", lambda request: faults.append(request.url) if "//127.0.0.1:" not in request.url else None)
    page.faults = faults
    yield page
    context.close()
    allowed = ("ERR_CONNECTION_REFUSED", "WebSocket connection to")  # while a test has stopped the server
    assert [fault for fault in faults if "blob:" not in fault and not any(each in fault for each in allowed)] == []


def take_lease(page: Any, url: str, name: str = "Ann") -> None:
    page.goto(url + "#view=operate")
    page.get_by_label("Your name").fill(name)
    page.get_by_role("button", name="Take control").click()
    page.get_by_text("You have control.").wait_for()


def control(page: Any, path: str) -> Any:
    return page.locator(f'[data-control="{path}"]')
