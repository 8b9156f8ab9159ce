"""Subscriptions and monitored items of the face OPC UA: what a client asks for is kept (OPC 10000-4, 5.13 and 5.14)."""

from __future__ import annotations

import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install 'umo[opcua]'")

from asyncua import ua

from helpers.opcua import let_in
from helpers.opcua_asyncua import Asker, Heard, Rig, run
from umo.testing.faces.tried_machine import until

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")]
ABSOLUTE, PERCENT = 1, 2


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


def band(kind: int, size: float, trigger: Any = ua.DataChangeTrigger.StatusValue) -> ua.DataChangeFilter:
    return ua.DataChangeFilter(trigger, kind, size)


async def listening(client: Asker, interval: float = 50.0) -> tuple[Any, Heard]:
    heard = Heard()
    subscription = await client.subscribe(heard, interval)
    heard.listen(subscription)
    return subscription, heard


# Status ---------------------------------------------------------------------------------------------------


@pytest.mark.smoke
@pytest.mark.parametrize("asked", [band(ABSOLUTE, 50.0)], ids=["absolute"])
def test_a_change_of_status_is_told_whatever_the_filter(asked: Any) -> None:
    statuses_are_told(asked)


@pytest.mark.parametrize("trigger", [0, 1, 2])
@pytest.mark.parametrize("size", [(0, 0.0), (ABSOLUTE, 1e9), (PERCENT, 100.0)], ids=["none", "absolute", "percent"])
def test_a_change_of_status_is_told_with_each_trigger_and_deadband(size: tuple[int, float], trigger: int) -> None:
    statuses_are_told(band(*size, ua.DataChangeTrigger(trigger)))


def statuses_are_told(asked: Any) -> None:
    """STALE, GOOD again, BAD, GOOD again, the end of the run."""

    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client)
            for handle, name in enumerate(("cell.level", "cell.position")):
                result = await client.monitor(
                    mine, name, ClientHandle=handle, SamplingInterval=10_000.0, QueueSize=100, Filter=asked
                )
                assert result.StatusCode.is_good(), result

            async def told(handle: int, *statuses: str) -> None:
                await until(lambda: [status for _, status in heard.of(handle)][-len(statuses) :] == list(statuses))

            await told(0, "Good")
            await told(1, "UncertainInitialValue")
            for handle, name, becomes in (
                (0, "cell.level", "UncertainLastUsableValue"),
                (1, "cell.position", "BadDeviceFailure"),
            ):
                before = heard.of(handle)[-1][1]
                rig.machine.set(name, OSError("unplugged"))
                await told(handle, before, becomes)
                rig.machine.set(name, 20)
                await told(handle, becomes, before)
            await rig.machine.end()
            await told(0, "UncertainNoCommunicationLastUsableValue")

    run(work)
