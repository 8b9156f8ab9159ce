"""The viewer of twins in a headless browser, with a feed of the test: bodies stand where the values say."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import numpy as np
import pytest

import umo.page as umo_page
from umo.process.station import find
from umo.twin.station import declared_by

playwright = pytest.importorskip("playwright.sync_api", reason="the tests of the page need Playwright")
CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("the tests of the page need Chromium (apt-get install chromium)", allow_module_level=True)

STATIC = Path(umo_page.__file__).parent / "static"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}
HOST = "http://twin.test"
PAGE = """<!doctype html><html><head><title>twin</title><link rel="stylesheet" href="static/twin.css">
<link rel="icon" href="data:,"><script type="importmap">{"imports": {
"three": "./static/vendor/three/three.module.min.js", "three/addons/": "./static/vendor/three/addons/"}}</script>
<style>body { margin: 0; font-family: sans-serif; color-scheme: light dark } section { height: 100vh }</style></head>
<body><section></section></body></html>"""
FEED = """async (description) => {
    const heard = {}, subscribers = new Set(), values = {}, qualities = {};
    const past = { times: [], columns: {} };
    const feed = {
        station: "test", asked: [],
        json: async () => description,
        on: (kind, listener) => ((heard[kind] ??= new Set()).add(listener), () => heard[kind].delete(listener)),
        latest: (path) => path in values ? { value: values[path], quality: qualities[path] ?? 0, time: 0 } : null,
        range: () => ({ start: past.times[0] ?? 0, stop: past.times.at(-1) ?? 0 }),
        subscribe(asked, listener) {
            const made = { asked, listener, close: () => subscribers.delete(made) };
            subscribers.add(made);
            return made;
        },
        async window(asked) {
            feed.asked.push(asked);
            const rows = past.times.map((t, i) => [t, i]).filter(([t]) => t >= asked.start && t <= asked.stop);
            const columns = asked.paths.map((path) => Float64Array.from(rows, ([, i]) => past.columns[path][i]));
            return { times: Float64Array.from(rows, ([t]) => t), low: columns, high: columns };
        },
    };
    const send = ({ asked, listener }) => {
        if (asked.span) return listener({
            from: 0, times: Float64Array.from(past.times),
            low: asked.paths.map((path) => Float64Array.from(past.columns[path] ?? [])),
            high: asked.paths.map((path) => Float64Array.from(past.columns[path] ?? [])),
        });
        const columns = asked.paths.map((path) => Float64Array.of(values[path] ?? NaN));
        listener({ from: 0, times: Float64Array.of(0), low: columns, high: columns });
    };
    const twin = await import("./static/twin.js");
    await twin.mount(document.querySelector("section"), feed);
    const drawing = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    window.test = {
        feed, twin, heard, subscribers, values, qualities, past, drawing,
        view: () => twin.shown(),
        set: async (given, poor = {}) => {
            Object.assign(values, given); Object.assign(qualities, poor);
            subscribers.forEach(send); heard.state?.forEach((listener) => listener({}));
            await drawing();
        },
    };
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


class Viewer:
    """A page that shows one twin, from files, without a server."""

    def __init__(self, browser: Any, description: dict[str, Any] | None, **context: Any) -> None:
        self.context = browser.new_context(viewport={"width": 640, "height": 480}, **context)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.page.on("console", lambda message: message.type == "error" and self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.route("**/*", self._answer)
        self.page.goto(f"{HOST}/")
        self.page.evaluate(FEED, description)

    def _answer(self, route: Any) -> None:
        address = urlparse(route.request.url)
        file = STATIC / address.path.removeprefix("/static/")
        if f"{address.scheme}://{address.netloc}" != HOST:
            self.complaints.append(f"asked for {route.request.url}")
            route.abort()
        elif address.path == "/":
            route.fulfill(body=PAGE, content_type="text/html")
        elif file.is_file():
            route.fulfill(body=file.read_bytes(), content_type=TYPES[file.suffix])
        else:
            self.complaints.append(f"no file {address.path}")
            route.fulfill(status=404)

    def set(self, values: dict[str, float], qualities: dict[str, int] | None = None) -> None:
        self.page.evaluate("([values, qualities]) => test.set(values, qualities)", [values, qualities or {}])

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)

    def pose(self, body: str) -> tuple[Any, Any]:
        found = self.page.evaluate("(name) => test.view().scene.pose(name)", body)
        return np.array(found["position"]), np.array(found["rotation"])

    def close(self) -> None:
        self.context.close()


def described(name: str) -> dict[str, Any]:
    station = find(name)
    twin = declared_by(station)
    assert twin is not None
    found: dict[str, Any] = json.loads(json.dumps(twin.describe(station.machine())))
    return found


@pytest.fixture
def shown(browser: Any) -> Iterator[Any]:
    """Opens viewers; in the end none of them has complained or asked another host."""
    opened: list[Viewer] = []

    def show(name: str) -> Viewer:
        opened.append(Viewer(browser, described(name)))
        return opened[-1]

    yield show
    for viewer in opened:
        assert viewer.complaints == []
        viewer.close()
