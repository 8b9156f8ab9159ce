"""Makes the pictures of README and docs from runs of the stations; wants `.venv/bin/pip install -e '.[all,render]'`,
and for those of page and notebook the extra `page`, Playwright and Chromium."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from PIL import Image

import umo
from umo.frames import Reader, published
from umo.frames.frames_table import html_of_frames
from umo.process.station import find
from umo.remote.scope import Scope
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine
from umo.stations.ztheta.render import render

HERE = Path(__file__).parent
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
    Image.fromarray(render(connection.driver("plant"), 960, 640)).save(HERE / "ztheta.png", optimize=True)


def show_notebook(connection: umo.connect) -> None:
    """A live table and a scope, without the notebook around them."""
    from playwright.sync_api import sync_playwright

    with umo.attach("ztheta") as station, sync_playwright() as playwright, Reader(station.reader.path) as reader:
        table = html_of_frames(
            reader, ["theta.encoder", "theta.step", "theta.error", "gripper.vacuum", "gripper.pressure"]
        )
        scope = Scope(reader, ["theta.encoder", "theta.error", "theta.step", "gripper.vacuum"], 2.0).draw({})
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 760, "height": 100}, color_scheme="light")
        page.set_content(f'<!doctype html><body style="font: 13px sans-serif">{table}<br>{scope}</body>')
        page.screenshot(path=HERE / "notebook.png", full_page=True)
        browser.close()


def show_twin(connection: umo.connect) -> None:
    """The twin in the tab of the page."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-c", "from umo.cli import main; main()", "view", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 960, "height": 640}, color_scheme="light")
        page.goto(server.stdout.readline().strip())
        page.get_by_role("tab", name="Twin").click()
        page.get_by_role("button", name="Labels").click()
        page.get_by_text("gripper.pressure PASS").wait_for()
        page.get_by_role("button", name="Labels").click()
        page.locator(".twin-label").first.wait_for(state="detached")
        page.locator(".twin-view").screenshot(path=HERE / "twin.png")
        browser.close()
        server.terminate()


def plot(picture: str, *words: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-c", "from umo.cli import main; main()", "run", *words], cwd=folder, check=True
        )
        (made,) = Path(folder).glob("runs/*/plot.png")
        shutil.copy(made, HERE / picture)


if __name__ == "__main__":
    while_turning(photograph)
    while_turning(show_twin)
    while_turning(show_notebook)
    plot("run.png", "ztheta")
    plot("conveyor.png", "conveyor")
    plot("furnace.png", "furnace", "--zones", "8", "--faults", "broken-thermocouple:3")
