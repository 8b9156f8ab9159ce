"""What one request of OPC UA, and one event, costs the face is bounded."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import ua

from helpers.opcua import let_in
from helpers.opcua_asyncua import VALUE, Heard, Rig, run
from umo.clients.faces.face import User
from umo.clients.faces.gateway import Gateway
from umo.clients.faces.opcua import ua_limits as limits
from umo.operation.commands.roles import Roles

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")]
BOTH = ua.TimestampsToReturn.Both
DICTIONARY = ua.NodeId(8252)
"""The greatest value of the standards: 343 kB."""


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


def test_a_read_of_much_is_refused_while_it_is_made() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            asked = [ua.ReadValueId(DICTIONARY, VALUE)]
            assert not isinstance(await client.ask("Read", 0.0, BOTH, asked * 3), str)
            assert await client.ask("Read", 0.0, BOTH, asked * limits.MAX_READ) == "BadResponseTooLarge"
            asked = [ua.ReadValueId(rig.node("cell.level"), VALUE)] * limits.MAX_READ
            assert len((await client.ask("Read", 0.0, BOTH, asked)).Results) == limits.MAX_READ
            asked = [
                ua.BrowseDescription(ua.NodeId(58), ua.BrowseDirection.Both, ResultMask=63)
            ] * limits.MAX_OPERATIONS
            asked = ua.BrowseParameters(NodesToBrowse=asked)
            assert await client.ask("Browse", asked) == "BadResponseTooLarge"

    run(work)


def where(count: int) -> Any:
    field = ua.SimpleAttributeOperand(ua.NodeId(ua.ObjectIds.BaseEventType), [ua.QualifiedName("Message", 0)], VALUE)
    pattern = ua.LiteralOperand(ua.Variant("%a" * 50 + "q"))
    elements = [ua.ContentFilterElement(ua.FilterOperator.Like, [field, pattern])] * count
    return ua.EventFilter([field], ua.ContentFilter(elements))


def test_the_filters_of_all_event_items_have_a_cost_together() -> None:
    async def work(rig: Rig) -> None:
        server = ua.NodeId(ua.ObjectIds.Server)
        async with rig.client() as client, rig.client() as other:
            mine, theirs = await client.subscribe(Heard()), await other.subscribe(Heard())
            made = [await client.monitor(mine, server, attribute=12, Filter=where(100)) for _ in range(3)]
            codes = [each.StatusCode.name for each in made]
            assert codes == ["Good", "Good", "BadTooManyMonitoredItems"]
            small = await other.monitor(theirs, server, attribute=12, Filter=where(2))
            assert small.StatusCode.is_good()
            changed = ua.MonitoringParameters(1, 0.0, where(100), 10, True)
            asked = [ua.MonitoredItemModifyRequest(each.MonitoredItemId, changed) for each in (made[0], small)]
            for client_, subscription, item, code in (
                (client, mine, asked[0], "Good"), (other, theirs, asked[1], "BadTooManyMonitoredItems"),
            ):  # fmt: skip
                given = ua.ModifyMonitoredItemsParameters(subscription.subscription_id, BOTH, [item])
                assert (await client_.ask("ModifyMonitoredItems", given)).Results[0].StatusCode.name == code
            removed = ua.DeleteMonitoredItemsParameters(mine.subscription_id, [made[0].MonitoredItemId])
            await client.ask("DeleteMonitoredItems", removed)
            again = await client.monitor(mine, server, attribute=12, Filter=where(100))
            assert again.StatusCode.is_good()

    run(work)


@pytest.mark.smoke
def test_the_roles_are_read_once_for_a_request_and_again_for_the_next_one() -> None:
    read: list[Roles] = []

    def load() -> Roles:
        read.append(Roles())
        return read[-1]

    async def work() -> None:
        gateway: Any = object.__new__(Gateway)
        vars(gateway).update(
            _roles=load, _known=None, _is_closed=False, _is_reader=False, _face="opcua", _dead_man=set(), _pending={}
        )
        user = User("ann", True)
        for turn in range(1, 4):
            assert not any(gateway.may(user, "tune", "cell.gain") for _ in range(100))
            assert len(read) == turn
            await asyncio.sleep(0)

    asyncio.run(work())
