"""Makes the pictures of README and docs from runs of the stations; wants the extras `all` and `dev`,
and for those of page and notebook Chromium."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

import umo
from umo.process.frames import Reader, published
from umo.process.station import find
from umo.recording.scope.svg import Scope
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine

if TYPE_CHECKING:
    from playwright.sync_api import Page

PICTURES = Path(__file__).parents[1] / "docs" / "images"
os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo's pictures without a display; it looks when it is imported
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def while_turning(take: Callable[[umo.connect], None]) -> None:
    """Run z-theta in virtual time, published, up to where the second part is half turned; then take a picture."""
    m, station = machine(), find("ztheta")
    connection = umo.connect(m, station.wirings["simulated"], seed=3)

    def observe(frame: umo.Frame) -> None:
        if frame.progress.text == "part 2 of 3: turning" and m.theta.encoder.read() > -10.0:
            connection.stop.request()

    with connection, published(connection, "ztheta", "simulated", place=station.path):
        connection.machine.observers.append(observe)
        umo.drive(m, main)
        take(connection)


def photograph(connection: umo.connect) -> None:
    import mujoco

    physics = connection.driver("plant").physics
    with mujoco.Renderer(physics.model, 640, 960) as renderer:
        renderer.update_scene(physics.data, camera="station")
        Image.fromarray(renderer.render()).save(PICTURES / "ztheta.png", optimize=True)


def show_notebook(connection: umo.connect) -> None:
    """A live table and a scope, without the notebook around them."""
    from playwright.sync_api import sync_playwright

    with umo.attach("ztheta") as station, sync_playwright() as playwright, Reader(station.reader.path) as reader:
        table = reader.html(["theta.encoder", "theta.step", "theta.error", "gripper.vacuum", "gripper.pressure"])
        scope = Scope(reader, ["theta.encoder", "theta.error", "theta.step", "gripper.vacuum"], 2.0).draw({})
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 760, "height": 100}, color_scheme="light")
        page.set_content(f'<!doctype html><body style="font: 13px sans-serif">{table}<br>{scope}</body>')
        page.screenshot(path=PICTURES / "notebook.png", full_page=True)
        browser.close()


@contextmanager
def open_page(width: int, height: int) -> Iterator[Page]:
    """`umo show page` of z-theta in Chromium."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-c", "from umo_command import main; main()", "show", "page", "ztheta", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="light")
        page.goto(server.stdout.readline().strip())
        try:
            yield page
        finally:
            browser.close()
            server.terminate()


def show_twin(connection: umo.connect) -> None:
    """The twin in the tab of the page."""
    with open_page(960, 640) as page:
        page.get_by_role("tab", name="Twin").click()
        page.get_by_role("button", name="Labels").click()
        page.get_by_text("gripper.pressure PASS").wait_for()
        page.get_by_role("button", name="Labels").click()
        page.locator(".twin-label").first.wait_for(state="detached")
        page.locator(".twin-view").screenshot(path=PICTURES / "twin.png")


def show_views() -> None:
    """Machine and scope, with z-theta at work in real time."""
    with umo.start("ztheta", realtime=True, acknowledge=True) as started, open_page(1200, 750) as page:
        page.get_by_role("tab", name="Machine").click()
        page.get_by_text("part 1 of 3: picking").first.wait_for(timeout=60_000)
        for path in ("z.error", "z.motor", "theta.encoder", "gripper.vacuum", "gripper.pressure"):
            page.locator(f'tr[data-path="{path}"] button.name').click()
        page.get_by_text("part 2 of 3: turning").first.wait_for(timeout=60_000)
        page.screenshot(path=PICTURES / "page-machine.png")
        page.get_by_role("tab", name="Scope").click()
        page.get_by_label("Time shown").select_option("20")
        page.get_by_text("part 2 of 3: placing").first.wait_for(timeout=60_000)
        page.screenshot(path=PICTURES / "page-scope.png")
        started.stop()


def show_operate() -> None:
    """In manual mode, after homing: no motion of the application has the axes."""
    with umo.start("ztheta", realtime=True, manual=True, acknowledge=True) as started, open_page(1200, 750) as page:
        page.get_by_role("tab", name="Operate").click()
        page.get_by_label("Your name").fill("Ann")
        page.get_by_role("button", name="Take control").click()
        page.locator('[data-control="home"] button').first.click()
        page.get_by_text("home: done").first.wait_for(timeout=60_000)
        field = page.get_by_label("z.move_to position")
        for position in ("200000", "100000"):
            field.fill(position)
            field.press("Enter")
        page.get_by_text("z.move_to position=100000: done").wait_for(timeout=60_000)
        page.locator('[data-control="z.jog"] [data-sign="-1"]').hover()
        page.mouse.down()
        page.get_by_text("z.jog: done").wait_for()
        page.screenshot(path=PICTURES / "page-operate.png")
        started.stop()


TUNED = ("furnace", "zones.3", "--relay", "5%", "--at", "2 min", "--zones", "8", "--peak", "150", "--soak", "600")


def plot(picture: str, *words: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        command(folder, "run", *words)
        (made,) = Path(folder).glob("runs/*/plot.png")
        shutil.copy(made, PICTURES / picture)


def command(folder: str | Path, *words: str) -> None:
    subprocess.run([sys.executable, "-c", "from umo_command import main; main()", *words], cwd=folder, check=True)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    while_turning(photograph)
    while_turning(show_twin)
    while_turning(show_notebook)
    show_views()
    show_operate()
    plot("run.png", "ztheta")
    plot("conveyor.png", "conveyor")
    plot("furnace.png", "furnace", "--zones", "8", "--faults", "broken-thermocouple:3")
    plot("batch.png", "batch", "--batches", "1")
    command(PICTURES, "tune", "law", *TUNED, "--out", "tune.png")
