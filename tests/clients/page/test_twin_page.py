"""The viewer of twins in a headless browser, with a feed of the test: bodies stand where the values say."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import numpy as np
import pytest

import umo.clients.page as umo_page
from umo.objects.presentation.described import shown_all
from umo.objects.presentation.value_text import SIGNS, WORDS
from umo.plant.twin.declared import declared_by
from umo.process.station import find

from .conftest import complaints_of

STATIC = Path(umo_page.__file__).parent / "static"
TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}
HOST = "http://twin.test"
PAGE = """<!doctype html><html><head><title>twin</title><link rel="stylesheet" href="static/twin.css">
<link rel="icon" href="data:,"><script type="importmap">{"imports": {
"three": "./static/vendor/three/three.module.min.js", "three/addons/": "./static/vendor/three/addons/"}}</script>
<style>body { margin: 0; font-family: sans-serif; color-scheme: light dark } section { height: 100vh }</style></head>
<body><section></section></body></html>"""
FEED = """async ([description, given]) => {
    const heard = {}, subscribers = new Set(), values = {}, qualities = {};
    const past = { times: [], columns: {} };
    const feed = {
        station: "test", asked: [], description: given,
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
    const drawing = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    window.test = {
        feed, twin, heard, subscribers, values, qualities, past, drawing,
        view: () => twin.View.shown,
        show: () => {
            window.test.mounted?.close();
            window.test.mounted = new twin.View(document.querySelector("section"), feed);
            return window.test.mounted.ready;
        },
        set: async (given, poor = {}) => {
            Object.assign(values, given); Object.assign(qualities, poor);
            subscribers.forEach(send); heard.state?.forEach((listener) => listener({}));
            await drawing();
        },
    };
    await window.test.show();
}"""


class Viewer:
    """A page that shows one twin, from files, without a server."""

    def __init__(self, browser: Any, description: dict[str, Any] | None, **context: Any) -> None:
        self.context = browser.new_context(viewport={"width": 640, "height": 480}, **context)
        self.page = self.context.new_page()
        self.complaints = complaints_of(self.page)
        self.page.route("**/*", self._answer)
        self.page.goto(f"{HOST}/")
        qualities = list(zip(SIGNS, WORDS, strict=True))
        told = {"qualities": qualities, "twin": description is not None}
        self.page.evaluate(FEED, [description, told])

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
    described = twin.describe(station.machine())
    described["paths"] = shown_all(described["paths"])
    found: dict[str, Any] = json.loads(json.dumps(described))
    return found


@pytest.fixture
def shown(chromium: Any) -> Iterator[Any]:
    """Opens viewers; in the end none of them has complained or asked another host."""
    opened: list[Viewer] = []

    def show(name: str) -> Viewer:
        opened.append(Viewer(chromium, described(name)))
        return opened[-1]

    yield show
    for viewer in opened:
        assert viewer.complaints == []
        viewer.close()


def rotated(quaternion: Any, vector: Any) -> Any:
    w, x, y, z = quaternion
    u = np.array([x, y, z])
    return vector + 2 * np.cross(u, np.cross(u, vector) + w * vector)


@pytest.mark.smoke
def test_the_bodies_of_z_theta_stand_where_mujoco_puts_them_for_the_values_of_the_encoders(shown: Any) -> None:
    mujoco = pytest.importorskip("mujoco")
    viewer = shown("ztheta")
    model = mujoco.MjModel.from_xml_path(str(find("ztheta").path / "plant.xml"))
    data = mujoco.MjData(model)
    random = np.random.default_rng(1)
    for z, theta in [(54_600.0, -270.0), (129_400.0, 270.0), *random.uniform((54_600, -270), (129_400, 270), (10, 2))]:
        viewer.set({"z.encoder": float(z), "theta.encoder": float(theta)})
        data.joint("z").qpos[0], data.joint("theta").qpos[0] = z * 1e-6, np.deg2rad(theta)
        mujoco.mj_kinematics(model, data)
        for body in ("world", "courier", "z", "theta", "cup"):
            position, rotation = viewer.pose(body)
            assert position == pytest.approx(data.body(body).xpos, abs=1e-6)
            for axis in np.eye(3):
                turned = data.body(body).xmat.reshape(3, 3) @ axis
                assert rotated(rotation, axis) == pytest.approx(turned, abs=1e-6)


def test_an_axis_that_is_not_referenced_stays_within_its_stops_and_is_drawn_faintly(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.set({"z.encoder": -147_871.0}, {"z.encoder": 2})
    assert viewer.pose("z")[0][2] == pytest.approx(0.0545)
    opacity = "test.view().scene.byName.get('z').meshes.map((mesh) => mesh.material.opacity)"
    assert max(viewer.run(opacity)) < 0.5
    viewer.set({"z.encoder": 100_000.0}, {"z.encoder": 0})
    assert min(viewer.run(opacity)) == 1.0


def test_the_view_tells_which_joints_are_not_referenced_until_they_are(shown: Any) -> None:
    viewer = shown("ztheta")
    told = viewer.page.locator(".twin-poor")
    viewer.set({"z.encoder": 0.0, "theta.encoder": 0.0}, {"z.encoder": 2, "theta.encoder": 2})
    assert told.inner_text() == "Drawn faintly: z.encoder unreferenced, theta.encoder unreferenced"
    viewer.set({}, {"theta.encoder": 0})
    assert told.inner_text() == "Drawn faintly: z.encoder unreferenced"
    viewer.set({}, {"z.encoder": 0})
    assert told.inner_text() == ""


def test_after_the_end_the_last_values_are_marked(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.set({"z.encoder": 100_000.0, "theta.encoder": 0.0})
    viewer.page.get_by_role("button", name="Labels").click()
    time, told = viewer.page.locator(".twin-time"), viewer.page.locator(".twin-poor")
    label = viewer.page.locator(".twin-label").filter(has_text="z.encoder").first
    assert ("(live)" in time.inner_text(), told.inner_text(), "(last)" in label.inner_text()) == (True, "", False)
    viewer.run("test.feed.ended = true")
    viewer.set({})
    assert "(last)" in time.inner_text()
    assert told.inner_text() == "Drawn faintly: the last values before the end"
    assert "(last)" in label.inner_text()
    assert max(viewer.run("test.view().scene.byName.get('z').meshes.map((mesh) => mesh.material.opacity)")) < 0.5


def test_states_show_bodies_and_colour_them(shown: Any) -> None:
    viewer = shown("ztheta")
    part = "test.view().scene.byName.get('part').node.visible"
    colour = "'#' + test.view().scene.byName.get('suction valve').meshes[0].material.color.getHexString()"
    viewer.set({"gripper.pressure": 1.0, "gripper.vacuum": 0.0})
    assert (viewer.run(part), viewer.run(colour)) == (False, "#3a4048")
    viewer.set({"gripper.pressure": 0.0, "gripper.vacuum": 1.0})
    assert (viewer.run(part), viewer.run(colour)) == (True, "#2ea043")


def test_a_zone_has_the_colour_of_its_temperature(shown: Any) -> None:
    viewer = shown("furnace")
    colour = "'#' + test.view().scene.byName.get('zones.3').meshes[0].material.color.getHexString()"
    path = "zones.3.temperature"  # the furnace has more values than a subscription takes: they come with the state
    shades = []
    for temperature in (20.0, 700.0, 1000.0, 2000.0):
        viewer.set({path: temperature})
        shades.append(viewer.run(colour))
    assert shades[0] == "#4a5568"
    assert shades[2] == "#ffd34d"
    assert len(set(shades)) == 4


RUN = """() => {  // 10 s of belt at 0.3 m/s; a part of 90 mm at 5 s, another of 60 mm at 5.6 s
    const { past } = test;
    past.times = Array.from({ length: 1001 }, (_, i) => i / 100);
    const covered = (t) => (t >= 5 && t < 5.3) || (t >= 5.6 && t < 5.8);
    for (const path of test.view().scene.paths) past.columns[path] = past.times.map(() => 0);
    past.columns["sorter.belt.speed"] = past.times.map(() => 0.3);
    past.columns["sorter.entry"] = past.times.map((t) => (covered(t) ? 1 : 0));
    return test.set({});
}"""
SETTLED = """async (time) => {
    test.view().player.seek(time);
    for (let i = 0; i < 20; i += 1) await test.drawing();
}"""


def loads(viewer: Viewer) -> list[tuple[float, float]]:
    return [(round(front, 2), round(rear, 2)) for front, rear in viewer.run("test.view().scene.loads('part')")]


def test_the_parts_on_the_belt_are_where_they_were_at_the_time_that_is_shown(shown: Any) -> None:
    viewer = shown("conveyor")
    viewer.run(RUN)
    assert loads(viewer) == []  # live: 4 s later both have left the belt
    viewer.page.evaluate(SETTLED, 6.0)
    assert loads(viewer) == [(0.3, 0.21), (0.12, 0.06)]
    viewer.page.evaluate(SETTLED, 5.1)
    assert loads(viewer) == [(0.03, 0.0)]


def test_the_past_is_shown_by_the_slider_and_live_again_by_a_key(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.run("""() => {
        test.past.times = [0, 1, 2];
        for (const path of test.view().scene.paths) test.past.columns[path] = [0, 0, 0];
        test.past.columns["z.encoder"] = [60000, 70000, 80000];
        return test.set({ "z.encoder": 80000 });
    }""")
    slider = viewer.page.locator("input[type=range]")
    slider.evaluate("(slider) => { slider.value = '0.5'; slider.dispatchEvent(new Event('input')); }")
    viewer.page.wait_for_function("Math.abs(test.view().scene.pose('z').position[2] - 0.065) < 1e-6")
    assert "-1.5 s" in viewer.page.locator("output").inner_text()
    viewer.page.locator(".twin-picture").press("End")
    viewer.page.wait_for_function("Math.abs(test.view().scene.pose('z').position[2] - 0.08) < 1e-6")


def test_playing_goes_on_from_where_it_is_and_ends_live(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.run("""() => {
        test.past.times = [0, 1, 2];
        for (const path of test.view().scene.paths) test.past.columns[path] = [0, 0, 0];
        test.view().player.speed = 5; test.view().player.seek(0.1); test.view().player.toggle();
    }""")
    assert viewer.run("test.view().player.playing")
    viewer.page.wait_for_function("test.view().player.time === null")
    assert not viewer.run("test.view().player.playing")


def test_nothing_is_drawn_while_nothing_changes(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.set({"z.encoder": 70_000.0})
    before = viewer.run("test.view().drawn")
    for _ in range(5):
        viewer.set({"z.encoder": 70_000.0})
    assert viewer.run("test.view().drawn") == before
    viewer.set({"z.encoder": 70_001.0})
    assert viewer.run("test.view().drawn") == before + 1


@pytest.mark.parametrize("key", ["ArrowLeft", "ArrowUp", "Shift+ArrowRight", "+", "-"])
def test_a_key_moves_the_eye_and_r_brings_it_back(shown: Any, key: str) -> None:
    viewer = shown("conveyor")
    where = "test.view().eye.camera.position.toArray()"
    first = viewer.run(where)
    viewer.page.locator(".twin-picture").press(key)
    assert viewer.run(where) != pytest.approx(first)
    viewer.page.locator(".twin-picture").press("r")
    assert viewer.run(where) == pytest.approx(first)


def test_everything_is_in_the_window_after_fit(shown: Any) -> None:
    viewer = shown("furnace")
    viewer.page.locator(".twin-picture").press("+")
    viewer.page.get_by_role("button", name="Fit").click()
    corners = """() => {
        const { min, max } = test.view().scene.bounds(), { camera } = test.view().eye;
        camera.updateMatrixWorld();
        return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) =>
            min.clone().set(x, y, z).project(camera).toArray())));
    }"""
    assert np.abs(np.array(viewer.run(corners))).max() <= 1.0


def test_labels_name_the_bodies_and_their_values_on_demand(shown: Any) -> None:
    viewer = shown("ztheta")
    viewer.set({"z.encoder": 87_000.0, "theta.encoder": 12.345}, {"theta.encoder": 2})
    labels = viewer.page.locator(".twin-label")
    assert labels.count() == 0
    viewer.page.get_by_role("button", name="Labels").click()
    viewer.run("test.drawing()")
    texts = labels.all_inner_texts()
    assert "z\nz.encoder 87000 µm" in texts
    assert "theta\ntheta.encoder 12.3450 ° (unreferenced)" in texts
    boxes = [box for label in labels.all() if (box := label.bounding_box())]
    for one, other in itertools.combinations(boxes, 2):
        beside = one["x"] + one["width"] <= other["x"] or other["x"] + other["width"] <= one["x"]
        above = one["y"] + one["height"] <= other["y"] or other["y"] + other["height"] <= one["y"]
        assert beside or above, "no label covers another"
    viewer.page.get_by_role("button", name="Labels").click()
    viewer.run("test.drawing()")
    assert labels.count() == 0


def test_a_click_on_a_body_shows_its_label(shown: Any) -> None:
    viewer = shown("conveyor")
    viewer.run("test.view().eye.fit()")
    place = viewer.run("""() => {
        const { camera } = test.view().eye, { body } = { body: test.view().scene.byName.get("belt") };
        camera.updateMatrixWorld();
        const at = body.meshes[0].getWorldPosition(camera.position.clone()).project(camera);
        const box = document.querySelector(".twin-picture").getBoundingClientRect();
        return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
    }""")
    viewer.page.mouse.click(*place)
    viewer.page.wait_for_function("document.querySelectorAll('.twin-label').length === 1")
    assert viewer.page.locator(".twin-label").inner_text() == "belt"


def test_the_view_says_that_the_twin_is_loading_and_why_it_does_not_come(shown: Any) -> None:
    viewer = shown("conveyor")
    section = viewer.page.locator("section")
    for comes, then in (
        ("given()", ""),
        ("Promise.reject(new Error('no answer'))", "The twin cannot be shown: no answer"),
    ):
        viewer.run(f"""() => {{
            const given = test.feed.json;
            test.feed.json = () => new Promise((come) => {{ test.come = () => come({comes}); }});
            test.ready = test.show();
            test.feed.json = given;
        }}""")
        assert section.inner_text() == "The twin is loading\u2026"
        viewer.run("() => { test.come(); return test.ready; }")
        assert section.inner_text() == then if then else section.locator("canvas").count() == 1


def test_unmounting_leaves_nothing_behind(shown: Any) -> None:
    viewer = shown("conveyor")
    assert viewer.run("test.subscribers.size") == 2
    viewer.run("test.mounted.close()")
    assert viewer.run("[test.subscribers.size, test.heard.state.size]") == [0, 0]
    assert viewer.page.locator("section").inner_html() == ""
    viewer.run("test.show()")
    assert viewer.page.locator("canvas").count() == 1


def test_a_station_without_a_twin_and_a_wrong_declaration_are_said_in_words(chromium: Any) -> None:
    for description, text in (
        (None, "declares no twin"),
        ({"error": "twin: body 'x': no object 'y'"}, "no object 'y'"),
    ):
        viewer = Viewer(chromium, description)
        assert text in viewer.page.locator("section").inner_text()
        assert viewer.complaints == []
        viewer.close()
