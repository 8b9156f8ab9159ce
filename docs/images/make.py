"""Makes the pictures of README and docs from runs of the stations; wants `.venv/bin/pip install -e '.[all,render]'`."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

import umo
from umo.process.station import find
from umo.stations.ztheta.application import main
from umo.stations.ztheta.objects import machine
from umo.stations.ztheta.render import render

HERE = Path(__file__).parent


def photograph() -> None:
    """The second part, half turned."""
    m = machine()
    connection = umo.connect(m, find("ztheta").wirings["simulated"], seed=3)

    def observe(frame: umo.Frame) -> None:
        if frame.progress.text == "part 2 of 3: turning" and m.theta.encoder.read() > -10.0:
            Image.fromarray(render(connection.driver("plant"), 960, 640)).save(HERE / "ztheta.png", optimize=True)
            connection.stop.request()

    with connection:
        connection.machine.observers.append(observe)
        umo.drive(m, main)


def plot(picture: str, *words: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-c", "from umo.cli import main; main()", "run", *words], cwd=folder, check=True
        )
        (made,) = Path(folder).glob("runs/*/plot.png")
        shutil.copy(made, HERE / picture)


if __name__ == "__main__":
    photograph()
    plot("run.png", "ztheta")
    plot("conveyor.png", "conveyor")
    plot("furnace.png", "furnace", "--zones", "8", "--faults", "broken-thermocouple:3")
