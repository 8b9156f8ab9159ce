"""The rows of the table in docs/face-opcua.md with node-opcua, a client of another project."""

from __future__ import annotations

import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from helpers.opcua import OpcUaClient, let_in, named
from helpers.opcua_asyncua import Rig, run
from umo.clients.faces.conformance.tried_machine import until

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]
VALUE, BOTH = 13, 2
ROOT = {"nodeId": {"node": "i=84"}}
LEVEL = {"nodeId": {"node": "cell.level"}, "attributeId": VALUE}


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


def tried(work: Any) -> None:
    async def whole(rig: Rig) -> None:
        client = await OpcUaClient.connect(rig.face.address, named("ann"))
        try:
            await work(rig, client)
        finally:
            await client.close()

    run(whole)


async def send(client: OpcUaClient, request: str, **given: Any) -> tuple[str, Any]:
    told = await client.node.ask("send", request=request, given=given)
    return told["status"], told["response"]


def band(kind: int, size: float) -> dict[str, Any]:
    return {"class": "DataChangeFilter", "given": {"trigger": 1, "deadbandType": kind, "deadbandValue": size}}


def number(kind: str, value: Any) -> dict[str, Any]:
    return {"type": kind, "value": value}


def written(value: Any, **more: Any) -> dict[str, Any]:
    return {"nodeId": {"node": "tunable:cell.gain"}, "attributeId": VALUE, "value": {"value": value}, **more}


WHOLE = (
    ("Read", {"maxAge": -1, "nodesToRead": [LEVEL]}, "BadMaxAgeInvalid"),
    ("Read", {"nodesToRead": []}, "BadNothingToDo"),
    ("Browse", {"nodesToBrowse": []}, "BadNothingToDo"),
    ("Browse", {"view": {"viewId": {"node": "i=87"}}, "nodesToBrowse": [ROOT]}, "BadViewIdUnknown"),
    ("TranslateBrowsePathsToNodeIds", {"browsePaths": []}, "BadNothingToDo"),
    ("RegisterNodes", {"nodesToRegister": [{"node": ""}]}, "BadNodeIdInvalid"),
    ("RegisterNodes", {"nodesToRegister": [{"node": "cell.level"}]}, "Good"),
    ("UnregisterNodes", {"nodesToUnregister": [{"node": "cell.level"}]}, "Good"),
    ("ModifySubscription", {"subscriptionId": 99}, "BadSubscriptionIdInvalid"),
    ("Republish", {"subscriptionId": 99, "retransmitSequenceNumber": 1}, "BadSubscriptionIdInvalid"),
    ("TransferSubscriptions", {"subscriptionIds": [1]}, "BadServiceUnsupported"),
    ("AddNodes", {"nodesToAdd": []}, "BadServiceUnsupported"),
)  # fmt: skip
"""Requests, and the code of the whole."""
SINGLE = (
    ("Read", "nodesToRead", {"nodeId": {"node": "cell.no"}, "attributeId": VALUE}, "BadNodeIdUnknown"),
    ("Read", "nodesToRead", {"nodeId": {"node": ""}, "attributeId": VALUE}, "BadNodeIdInvalid"),
    ("Read", "nodesToRead", {**LEVEL, "attributeId": 21}, "BadAttributeIdInvalid"),
    ("Read", "nodesToRead", {**LEVEL, "dataEncoding": {"name": "Default Binary"}}, "BadDataEncodingInvalid"),
    ("HistoryRead", "nodesToRead", {"nodeId": {"node": "cell.level"}}, "BadHistoryOperationUnsupported"),
    ("HistoryRead", "nodesToRead", {"nodeId": {"node": "cell.no"}}, "BadNodeIdUnknown"),
    ("Write", "nodesToWrite", written(number("Double", 2.0)), "Good"),
    ("Write", "nodesToWrite", written(number("Int32", 2)), "BadTypeMismatch"),
    ("Write", "nodesToWrite", written(number("Double", 11.0)), "BadOutOfRange"),
    ("Write", "nodesToWrite", {**written(number("Double", 2.0)), "nodeId": {"node": "cell.no"}}, "BadNodeIdUnknown"),
    ("Write", "nodesToWrite", {**written(number("Double", 2.0)), "nodeId": {"node": "cell.level"}}, "BadNotWritable"),
    ("Browse", "nodesToBrowse", {"nodeId": {"node": "cell.no"}}, "BadNodeIdUnknown"),
    ("Browse", "nodesToBrowse", {**ROOT, "referenceTypeId": {"node": "i=85"}}, "BadReferenceTypeIdInvalid"),
    ("BrowseNext", "continuationPoints", None, "BadContinuationPointInvalid"),
    ("SetPublishingMode", "subscriptionIds", 99, "BadSubscriptionIdInvalid"),
    ("DeleteSubscriptions", "subscriptionIds", 99, "BadSubscriptionIdInvalid"),
)  # fmt: skip
"""Requests with one operation, and its code."""
CALLS = (
    ("part:cell", "action:cell.add", [number("Double", 1.0)], "Good", []),
    ("part:cell", "action:cell.add", [], "BadArgumentsMissing", []),
    ("part:cell", "action:cell.add", [number("Double", 1.0)] * 2, "BadTooManyArguments", []),
    ("part:cell", "action:cell.add", [number("String", "1")], "BadInvalidArgument", ["BadTypeMismatch"]),
    ("part:cell", "action:cell.add", [number("Double", 6.0)], "BadInvalidArgument", ["BadOutOfRange"]),
    ("machine", "action:cell.add", [number("Double", 1.0)], "BadMethodInvalid", []),
    ("part:no", "action:cell.add", [number("Double", 1.0)], "BadNodeIdUnknown", []),
    ("i=2253", "i=12871", [number("UInt32", 99), number("UInt32", 1)], "BadTooManyArguments", []),
)
"""Object, method, arguments; code, and those of the arguments."""


def test_codes_of_requests_operations_and_arguments() -> None:
    async def work(rig: Rig, client: OpcUaClient) -> None:
        for request, given, code in WHOLE:
            assert (await send(client, request, **given))[0] == code, (request, given)
        for request, field, operation, code in SINGLE:
            status, response = await send(client, request, **{field: [operation]})
            [result] = response["results"]
            assert (status, result if isinstance(result, str) else result["statusCode"]) == ("Good", code), operation
        for node, method, arguments, code, inputs in CALLS:
            call = {"objectId": {"node": node}, "methodId": {"node": method}, "inputArguments": arguments}
            [result] = (await send(client, "Call", methodsToCall=[call]))[1]["results"]
            told = result["statusCode"], result["inputArgumentResults"] or []
            assert told == (code, inputs), (node, method, arguments)

    tried(work)


def test_a_browse_has_as_many_references_as_are_asked_for() -> None:
    async def work(rig: Rig, client: OpcUaClient) -> None:
        asked = {"nodeId": {"node": "part:cell"}, "referenceTypeId": {"node": "i=33"}, "includeSubtypes": True}
        [every] = (await send(client, "Browse", nodesToBrowse=[asked]))[1]["results"]
        part = await send(client, "Browse", nodesToBrowse=[asked], requestedMaxReferencesPerNode=3)
        assert len(part[1]["results"][0]["references"]) == 3
        assert len(every["references"]) > 6

    tried(work)


ITEMS = (
    ({"filter": band(1, 30.0), "queueSize": 10}, "Good", [10.0, 41.0, 10.5]),
    ({"filter": band(2, 30.0), "queueSize": 10}, "Good", [10.0, 41.0, 10.5]),
    ({"filter": band(2, 101.0)}, "BadDeadbandFilterInvalid", []),
    ({"filter": band(1, -1.0)}, "BadDeadbandFilterInvalid", []),
    ({"filter": {"class": "AggregateFilter", "given": {}}}, "BadMonitoredItemFilterUnsupported", []),
    ({"mode": 0, "queueSize": 10}, "Good", []),
    ({"mode": 1, "queueSize": 10}, "Good", []),
    ({"samplingInterval": 3_600_000, "queueSize": 10}, "Good", [10.0]),
    ({"queueSize": 10}, "Good", [10.0, 41.0, 42.0, 10.5]),
)
"""Parameters of an item of the level, the code, and what is told of it in the end."""


def test_monitored_items_keep_their_parameters() -> None:
    async def work(rig: Rig, client: OpcUaClient) -> None:
        heard: list[Any] = []

        async def told(handle: int, last: float) -> bool:
            heard.extend((await client.node.ask("heard"))["heard"])
            return [each[1] for each in heard if each[0] == handle][-1:] == [last]

        for handle, (parameters, code, _) in enumerate(ITEMS):
            given = {"samplingInterval": 0, "discardOldest": True, "queueSize": 1} | parameters
            result = await client.node.ask("monitor", handle=handle, name="cell.level", interval=50, given=given)
            assert result["status"] == code, parameters
        for raw in (20, 82, 84, 21):
            rig.machine.set("cell.level", raw)
            while not await told(len(ITEMS) - 1, raw / 2):
                pass
        while not await told(0, 10.5) or not await told(1, 10.5):
            pass
        for handle, (parameters, _, values) in enumerate(ITEMS):
            assert [each[1] for each in heard if each[0] == handle] == values, parameters
        rig.machine.set("cell.level", OSError("unplugged"))  # each that reports hears of it, whatever its filter

        async def statuses() -> set[int]:
            heard.extend((await client.node.ask("heard"))["heard"])
            return {each[0] for each in heard if each[2] == "UncertainLastUsableValue"}

        while await statuses() != {0, 1, 7, 8}:
            pass

    tried(work)


def test_a_full_queue_says_so() -> None:
    async def work(rig: Rig, client: OpcUaClient) -> None:
        given = {"samplingInterval": 0, "discardOldest": False, "queueSize": 2}
        await client.node.ask("monitor", handle=1, name="cell.level", interval=1500, given=given)
        node = rig.face._nodes.values[next(item.number for item in rig.face._shown.items if item.name == "cell.level")]
        heard: list[Any] = []
        while not heard:
            heard += (await client.node.ask("heard"))["heard"]
        for raw in (60, 80, 100):
            rig.machine.set("cell.level", raw)
            await until(lambda raw=raw: node.value.Value.Value == raw / 2)
        while len(heard) < 3:
            heard += (await client.node.ask("heard"))["heard"]
        assert [each[1:] for each in heard] == [[10.0, "Good", False], [30.0, "Good", False], [50.0, "Good", True]]

    tried(work)
