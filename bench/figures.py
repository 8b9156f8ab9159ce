"""What is not a period: memory, import, connecting, and the stations against real time."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import tempfile
import tracemalloc
from pathlib import Path
from statistics import median
from time import perf_counter, perf_counter_ns

import umo
from bench.driver import Fill
from bench.machine import Umo, machine, wiring
from bench.mix import layout
from umo import Compound, DigitalActuator, DigitalSensor, connect
from umo.control import ServoAxis
from umo.stations.ztheta import objects as ztheta
from umo.stations.ztheta.application import main


def bytes_per_object(count: int = 10_000) -> tuple[float, float]:
    """Declared, and connected besides, as tracemalloc counts it (numpy's arrays included); compounds and channels
    are in it, the wiring as written and the driver's registers are not."""
    plan = layout(count)
    Umo(layout(13), Fill(5, 8)).close()  # units, classes and modules are there beforehand
    gc.collect()
    tracemalloc.start()
    try:
        start, _ = tracemalloc.get_traced_memory()
        plant = machine(plan)
        declared, _ = tracemalloc.get_traced_memory()
        wires = wiring(plant, Fill(plan.sensors, plan.actuators))
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        with connect(plant, wires):
            gc.collect()
            connected, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return (declared - start) / count, (connected - before) / count


def seconds_to_connect(count: int = 10_000, repeats: int = 3) -> tuple[float, float]:
    """Declaring them, and entering `connect` with the wiring as a dict: the least of some."""
    plan = layout(count)
    declaring, connecting = [], []
    for _ in range(repeats):
        start = perf_counter()
        plant = machine(plan)
        declaring.append(perf_counter() - start)
        connection = connect(plant, wiring(plant, Fill(plan.sensors, plan.actuators)))
        start = perf_counter()
        with connection:
            connecting.append(perf_counter() - start)
    return min(declaring), min(connecting)


def seconds_to_import(repeats: int = 7) -> float:
    """`import umo` in a fresh interpreter less an interpreter that does nothing: the least of some. From
    compiled files, as an installed package has them, whatever the environment says of writing them."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}

    def run(code: str) -> float:
        start = perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, env=environment)
        return perf_counter() - start

    run("import umo")  # the files are in memory from here on
    pairs = [(run("import umo"), run("pass")) for _ in range(repeats)]
    return min(full for full, _ in pairs) - min(empty for _, empty in pairs)


def control_period(runs: int = 2) -> tuple[float, float]:
    """z-theta's `control` in virtual time, us: sequences and laws, for one part from homing to placing. The least of
    some runs of the time that half of the periods stay below, and the median over the runs."""
    medians = sorted(_control_median() for _ in range(runs))
    return medians[0], medians[len(medians) // 2]


def _control_median() -> float:
    folder = Path(umo.__file__).parent / "stations" / "ztheta" / "wiring"
    times = []
    with connect(ztheta.machine(), folder / "simulated.toml", seed=3) as m:
        task = m.cycle.start(main(m, parts=1))
        while not task.done:
            m.timer.read()
            m.sample()
            start = perf_counter_ns()
            m.control()
            times.append(perf_counter_ns() - start)
            m.update()
    return median(times) * 1e-3


class Slide(Compound):
    """One servo axis."""

    axis: ServoAxis
    timer: DigitalSensor


def slide() -> Slide:
    axis = ServoAxis(
        motor=DigitalActuator("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.01, limits="clamp"),
        encoder=DigitalSensor("mm", minimum=-1e6, maximum=1e6, resolution=0.01),
        gain=1.0,
        integral_time=0.1,
        derivative_time=1e-3,
        friction=0.1,
        feed_forward=0.02,
        velocity=100.0,
        acceleration=1e3,
        jerk=1e4,
        window=0.1,
        following_error=1e6,
    )
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=1e9, resolution=1.0, synchronous=False)
    return Slide(axis=axis, timer=timer)


def axis_period(periods: int = 20_000) -> tuple[float, float]:
    """`control` of one servo axis in motion, in virtual time, us: profile, PID, limits, following error. The time that
    half of the periods stay below, of the best and of the median of some thousands."""
    medians = []
    with connect(slide()) as m:
        m.timer.read()
        m.sample()
        m.axis.enable()
        for start in range(0, periods, 1000):
            m.axis.profile.to(1e3 if start % 2000 else -1e3)
            times = []
            for _ in range(1000):
                m.timer.read()
                m.sample()
                before = perf_counter_ns()
                m.axis.control()
                times.append(perf_counter_ns() - before)
                m.update()
            medians.append(median(times) * 1e-3)
    return min(medians), median(medians)


def station_ratio(*words: str) -> float | str:
    """How many times faster than real time `umo run WORDS` is; else the last line of its complaint."""
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        umo = str(Path(sys.executable).with_name("umo"))
        command = [umo, "run", *words, "--summary", str(summary)]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        if done.returncode or not summary.exists():
            return (done.stderr.strip() or done.stdout.strip() or f"umo run {words[0]} failed").splitlines()[-1]
        return float(json.loads(summary.read_text())["realtime_factor"])
