"""Boxes on the network. Each box serves its registers over Modbus TCP. All boxes are in one process and have the time
of one plant."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import stat
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from umo.cycle.insisting import asked_by_signals
from umo.duration import duration
from umo.errors import DriverError, WiringError
from umo.objects.presentation.value_text import measure
from umo.process.outcome import plain
from umo.system.folders import remove
from umo.text import reason_of
from umo.wiring import Wired

from .box import Box
from .modbus_server import Connection
from .register_map import RegisterMap
from .simulation import Simulation

MAX_WATCHDOG = 65.535
"""Longest time in s that the register of a watchdog can hold."""
REPORT_INTERVAL = 0.1
"""The time in s between two checks of the plant's report."""

Ready = Callable[[str, str, int], object]
"""The function that is called with the name, host and port of each box when requests are accepted."""
Summary = dict[str, Any]


def serve_until_signal(plant: Wired, maps: Sequence[RegisterMap], *, ready: Ready, report: Path | None) -> Summary:
    """Run `serve` until SIGINT or SIGTERM. A further signal ends a plant whose step does not end."""

    async def main() -> Summary:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        with asked_by_signals(lambda: loop.call_soon_threadsafe(stop.set)):
            return await serve(plant, maps, ready=ready, stop=stop, report=report)

    return asyncio.run(main())


async def serve(
    plant: Wired,
    maps: Sequence[RegisterMap],
    *,
    stop: asyncio.Event,
    ready: Ready = lambda name, host, port: None,
    report: Path | None = None,
) -> Summary:
    """Serve each map at its host and port (0 for a free one) until `stop` is set, and return the report.

    `report` is a JSON file that is replaced completely whenever the plant's report has changed, and at the end. Raises
    WiringError for a watchdog's time that its register cannot hold, if `report` is not a regular file or an address is
    taken. Raises DriverError if the plant cannot be opened. An exception of the plant's code ends the service.
    """
    for each in maps:
        if not 0 <= each.watchdog <= MAX_WATCHDOG:
            raise WiringError(
                f"the watchdog takes 0 (off) to {duration(MAX_WATCHDOG)}, not {measure(each.watchdog, 's')}"
            )
    file = None if report is None else ReportFile(report)
    simulation = Simulation(plant, asyncio.get_running_loop().time)
    boxes = [Box(simulation, each) for each in maps]
    peers: set[asyncio.Transport] = set()
    with contextlib.ExitStack() as stack:
        servers = [await _listen(box, peers, stack) for box in boxes]
        stack.enter_context(simulation)
        for box, server in zip(boxes, servers, strict=True):
            await server.start_serving()  # not before: opening the plant may take longer than a client waits
            ready(box.registers.name, *server.sockets[0].getsockname()[:2])
        await _keep_pace(simulation, boxes, stop, file)
        summary = summary_of(simulation, boxes)
        if file is not None:
            file.write(summary)
    return summary


async def _listen(box: Box, peers: set[asyncio.Transport], stack: contextlib.ExitStack) -> asyncio.Server:
    host, port = box.registers.host, box.registers.port
    try:
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: Connection(box.request, peers), host, port, start_serving=False)
    except UnicodeError:
        raise WiringError(f"cannot serve at {host}:{port}: not the name of a host") from None
    except OSError as error:
        number = error.errno or 0  # below 0 for a name that was not found
        reason = os.strerror(number) if number > 0 else error.strerror or str(error)
        raise WiringError(f"cannot serve at {host}:{port}: {reason.lower()}") from None

    def close() -> None:
        server.close()
        for peer in tuple(peers):
            peer.abort()

    stack.callback(close)
    return server


async def _keep_pace(
    simulation: Simulation, boxes: Sequence[Box], stop: asyncio.Event, report: ReportFile | None
) -> None:
    """Let time pass in the plant, in small steps between the requests, and check the watchdogs."""
    clock = simulation.clock
    reported: object = None
    next_look = clock()
    while not stop.is_set():
        turn(simulation, boxes)
        if report is not None and clock() >= next_look:
            next_look = clock() + REPORT_INTERVAL
            summary = summary_of(simulation, boxes)
            if reported != (reported := summary | {"requests": 0}):
                with contextlib.suppress(DriverError):  # it is written again, and said, at the end
                    report.write(summary)
        await asyncio.sleep(simulation.pace.left(clock()))
        await asyncio.sleep(0)  # requests that lay waiting are read before the watchdogs are looked at


def turn(simulation: Simulation, boxes: Sequence[Box]) -> None:
    """Advance the plant to the present time. Raises the error of the plant, even if it was raised in a request."""
    if simulation.failure is None:
        for box in boxes:
            box.watch()
        simulation.catch_up()
    if simulation.failure is not None:
        raise simulation.failure


def summary_of(simulation: Simulation, boxes: Sequence[Box]) -> Summary:
    """Return the plant's report as plain data, with the additions of the boxes."""
    return {str(key): plain(value) for key, value in simulation.report().items()} | {
        "requests": sum(box.requests for box in boxes),
        "watchdog_drops": sum(box.watchdog.drops for box in boxes),
        "periods_given_up": simulation.pace.given_up,
    }


class ReportFile:
    """A report in JSON that is always replaced completely, so that readers never find a part of a report. For a
    symlink, its target is replaced. Only a regular file is ever replaced. Raises WiringError immediately if the file
    cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._given = path
        try:
            self._path = path.resolve()
            self._look()
            self._draft = self._path.with_name(f".umo-report-{os.getpid()}")
            self._fill_draft("")
            self._draft.unlink()
        except (OSError, RuntimeError, ValueError) as error:  # the last two: a loop of symlinks, a null byte
            raise WiringError(f"no report can be written to {path}: {reason_of(error)}") from None

    def write(self, content: Mapping[str, object]) -> None:
        """Write the report. Raises DriverError if the report can no longer be written; the file is then unchanged."""
        try:
            self._fill_draft(json.dumps(content, indent=2) + "\n")
            self._look()
            self._draft.replace(self._path)
        except OSError as error:
            remove(self._draft)
            raise DriverError(f"the report {self._given} cannot be written: {reason_of(error)}") from None

    def _look(self) -> None:
        try:
            mode = self._path.lstat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISREG(mode):
            raise OSError("this is not a regular file")

    def _fill_draft(self, text: str) -> None:
        self._draft.unlink(missing_ok=True)
        with self._draft.open("x") as file:  # a new file, not one that somebody else has put there
            file.write(text)
