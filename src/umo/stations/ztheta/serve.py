"""The z-theta plant as a controller box on a bench: a process of its own that serves Modbus TCP in real time.

| table | address | channel of the plant |
| --- | --- | --- |
| coil | 0 to 6 | dio:step, :direction, :z_index, :theta_index, :counterweight, :vacuum, :pressure |
| discrete | 0 | dio:gripper |
| input | 0 | counter:z, uint16 |
| input | 1, 2 | counter:theta, int32, high word first (24 bits, sign-extended) |
| input | 3 | adc:counterweight, uint16 |
| holding | 0 | dac:z, int16; what the 12 bits of the DAC cannot make is answered by exception 3 |
| holding | 4096 | the watchdog's time in ms, 0 for none |

Any other address is answered by exception 2; every unit number is the box's. At power-up, and when the watchdog
drops them, the outputs have the levels of `POINTS`. The watchdog is armed by a write and fed by every request;
after a drop it waits for the next write and wants no other acknowledgement.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from umo.errors import DriverError, WiringError

from ._box import Box, Point, ServedPlant
from ._modbus_server import Connection
from ._report_file import ReportFile
from .plant import Plant

POINTS = (
    Point("coil", 0, "dio:step"),
    Point("coil", 1, "dio:direction", level=1),
    Point("coil", 2, "dio:z_index"),
    Point("coil", 3, "dio:theta_index"),
    Point("coil", 4, "dio:counterweight"),
    Point("coil", 5, "dio:vacuum"),
    Point("coil", 6, "dio:pressure"),
    Point("discrete", 0, "dio:gripper"),
    Point("input", 0, "counter:z"),
    Point("input", 1, "counter:theta", words=2),
    Point("input", 3, "adc:counterweight"),
    Point("holding", 0, "dac:z"),
)
WATCHDOG_REGISTER = 4096
LONGEST_WATCHDOG = 65.535
"""Seconds: what the register can say."""
REPORT_EVERY = 0.1
"""How often, in s, the box looks whether another part has been placed."""

Ready = Callable[[str, int], object]


def announce(host: str, port: int) -> None:
    print(f"z-theta plant: Modbus TCP at {host}:{port}", flush=True)


def serve_plant(
    *,
    seed: int = 0,
    parts: int = 3,
    faults: Sequence[str] = (),
    host: str = "127.0.0.1",
    port: int = 5020,
    period: float = 0.001,
    watchdog: float = 0.2,
    ready: Ready = announce,
    report: Path | None = None,
) -> None:
    """Serve the station's plant until SIGINT or SIGTERM, then print its final state in one line.

    `ready(host, port)` is called once requests are taken (port 0 takes a free one). `watchdog` is 0 (none) to
    65.535 s. `report` is a JSON file, replaced whole, written whenever another part has been placed and at the
    end. WiringError for what cannot be served so, or no regular file to report to; DriverError when the address is
    taken or MuJoCo is missing.
    """
    plant = Plant(seed=seed, parts=parts, faults=faults)
    serve_until_signal(plant, host=host, port=port, period=period, watchdog=watchdog, ready=ready, report=report)


def serve_until_signal(
    plant: ServedPlant[Any],
    *,
    host: str,
    port: int,
    period: float = 0.001,
    watchdog: float = 0.2,
    ready: Ready = announce,
    report: Path | None = None,
) -> None:
    """`serve` for any plant, blocking until SIGINT or SIGTERM; prints the final state."""
    watchdog_ms = _milliseconds(watchdog)

    async def main() -> str:
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(NotImplementedError):  # Windows: Ctrl-C still ends asyncio.run
                asyncio.get_running_loop().add_signal_handler(number, stop.set)
        return await serve(
            plant,
            host=host,
            port=port,
            period=period,
            watchdog_ms=watchdog_ms,
            ready=ready,
            stop=stop,
            report=report,
        )

    print(asyncio.run(main()), flush=True)


def _milliseconds(watchdog: float) -> int:
    """What the watchdog's register holds: of a time above 0 never 0, which is none."""
    if not 0 <= watchdog <= LONGEST_WATCHDOG:
        raise WiringError(f"the watchdog takes 0 (none) to {LONGEST_WATCHDOG} s, not {watchdog:g} s")
    return max(round(watchdog * 1000), 1 if watchdog else 0)


async def serve(
    plant: ServedPlant[Any],
    *,
    host: str = "127.0.0.1",
    port: int = 5020,
    period: float = 0.001,
    watchdog_ms: int = 200,
    ready: Ready | None = None,
    stop: asyncio.Event | None = None,
    report: Path | None = None,
) -> str:
    """Serve the plant until `stop` is set; returns its final state in one line."""
    file = None if report is None else ReportFile(report)
    loop = asyncio.get_running_loop()
    box = Box(
        plant,
        POINTS,
        watchdog_register=WATCHDOG_REGISTER,
        watchdog=watchdog_ms / 1000,
        period=period,
        clock=loop.time,
    )
    peers: set[asyncio.Transport] = set()
    try:
        server = await _listen(lambda: Connection(box.request, peers), host, port)
        try:
            box.power_up()
            await server.start_serving()  # not before: building the plant takes longer than a client waits
            if ready is not None:
                ready(*server.sockets[0].getsockname()[:2])
            await _keep_pace(box, stop or asyncio.Event(), file)
        finally:
            server.close()
            for peer in tuple(peers):
                peer.abort()
        if file is not None:
            file.write(summary(box))
        return final_state(box)
    finally:
        plant.close()


async def _listen(connection: Callable[[], Connection], host: str, port: int) -> asyncio.Server:
    try:
        loop = asyncio.get_running_loop()
        return await loop.create_server(connection, host, port, start_serving=False)
    except UnicodeError:
        raise DriverError(f"cannot serve at {host}:{port}: not the name of a host") from None
    except OSError as error:
        number = error.errno or 0  # below 0 for a name that was not found
        reason = os.strerror(number) if number > 0 else error.strerror or str(error)
        raise DriverError(f"cannot serve at {host}:{port}: {reason.lower()}") from None


async def _keep_pace(box: Box[Any], stop: asyncio.Event, report: ReportFile | None) -> None:
    """Physics in real time, in small steps between the requests."""
    loop = asyncio.get_running_loop()
    placed = 0
    look = loop.time()
    while not stop.is_set():
        left = box.turn()
        if loop.time() >= look:
            look = loop.time() + REPORT_EVERY
            if placed != (placed := box.plant.truth().placed) and report is not None:
                with contextlib.suppress(DriverError):  # it is written again, and said, at the end
                    report.write(summary(box))
        await asyncio.sleep(left)


def summary(box: Box[Any]) -> dict[str, object]:
    """The plant's report, and what the box has to add to it."""
    report = box.plant.truth()
    return {
        "placed": report.placed,
        **dataclasses.asdict(report),
        "watchdog_drops": box.watchdog.drops,
        "requests": box.requests,
        "periods_given_up": box.pace.given_up,
    }


def final_state(box: Box[Any]) -> str:
    report, drops = box.plant.truth(), box.watchdog.drops
    return (
        f"{report.placed} of {len(report.parts)} parts placed; z at {box.plant.z_um / 1000:.3f} mm, theta at "
        f"{box.plant.theta_deg:.3f} deg; {box.requests} requests, the watchdog dropped the outputs "
        f"{drops} time{'' if drops == 1 else 's'}"
    )
