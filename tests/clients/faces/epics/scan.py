"""ophyd-async builds the machine from the prefix alone; bluesky scans an axis of it. Told as one line of JSON."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from typing import Any

import bluesky.plan_stubs as bps
import bluesky.plans as bp
from bluesky.run_engine import RunEngine
from ophyd_async.core import Device, init_devices
from ophyd_async.epics.core import PviDeviceConnector
from ophyd_async.epics.motor import Motor

START, STOP, POINTS = 60000.0, 66000.0, 4


def tree(device: Any) -> Any:
    """The kinds of all signals, as ophyd-async has made them."""
    below = {name: tree(child) for name, child in device.children()}
    return below or type(device).__name__


async def answer_of(begin: Callable[[], Any]) -> str:
    try:
        await begin()
    except Exception as error:
        return str(error)
    return ""


async def stopped(z: Motor) -> dict[str, Any]:
    """What a motion answers that is stopped on its way, and where it ends."""
    await z.velocity.set(2000.0)
    motion = z.set(100000.0)
    while await z.motor_done_move.get_value():
        await asyncio.sleep(0.01)
    await z.stop()
    answer = await answer_of(lambda: motion)
    return {
        "answer": answer,
        "position": await z.user_readback.get_value(),
        "done": await z.motor_done_move.get_value(),
    }


def main(prefix: str) -> dict[str, Any]:
    engine = RunEngine({})
    with init_devices():
        m = Device(name="m", connector=PviDeviceConnector(prefix))
        z = Motor(f"pva://{prefix}z", name="z")

    def do(work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, engine._loop).result(60)

    told: dict[str, Any] = {"tree": tree(m), "events": []}
    engine(bps.trigger(m.home, wait=True))

    def note(name: str, document: dict[str, Any]) -> None:
        if name == "event":
            told["events"].append((document["data"], document["timestamps"]))
        elif name == "descriptor":
            told["keys"] = document["data_keys"]

    engine(bp.scan([m.z.encoder], z, START, STOP, POINTS), note)
    told["beyond"] = do(answer_of(lambda: z.user_setpoint.set(500000.0)))
    told["stopped"] = do(stopped(z))
    engine(bps.abs_set(m.z.servo.gain, 0.003, wait=True))
    told["gain"] = do(m.z.servo.gain.get_value())
    return told


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
