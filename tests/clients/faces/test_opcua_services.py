"""Each parameter of the services that a client may send is kept, or refused with the code of the standard: the rows of
the table in docs/face-opcua.md, with a client of asyncua."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import Client, ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import variant_from_binary, variant_to_binary

from helpers.opcua import let_in
from helpers.opcua_asyncua import FIRST, VALUE, Asker, Heard, Rig, run
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_connection import Answer
from umo.clients.faces.opcua.ua_services import (
    BrowseDescription,
    BrowseParameters,
    HistoryReadParameters,
    ReadParameters,
)
from umo.clients.faces.opcua.ua_values import result_of
from umo.operation.commands.client_commands import Mode

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")]
BOTH = ua.TimestampsToReturn.Both
A = ua.AttributeIds
SERVER = ua.NodeId(ua.ObjectIds.Server)
DOUBLE, INT32, STRING = ua.VariantType.Double, ua.VariantType.Int32, ua.VariantType.String


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


def tried(work: Any, user: str | None = None, mode: Mode = Mode.AUTOMATIC, **options: Any) -> None:
    async def whole(rig: Rig) -> None:
        async with rig.client(user) as client:
            await work(rig, client)

    run(whole, mode, **options)


def name(status: ua.StatusCode) -> str:
    return str(status.name)


# Read ------------------------------------------------------------------------------------------------------


def test_what_cannot_be_read_has_its_code() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        server_array, limit = ua.NodeId(ua.ObjectIds.Server_ServerArray), rig.node("cell.level/EURange")
        for node, more, code in (
            (ua.NodeId(), {}, "BadNodeIdInvalid"),
            (rig.node("cell.no"), {}, "BadNodeIdUnknown"),
            (rig.node("cell.level"), {"attribute": 27}, "BadAttributeIdInvalid"),
            (rig.node("cell.level"), {"attribute": 999}, "BadAttributeIdInvalid"),
            (rig.node("cell.level"), {"IndexRange": "0"}, "BadIndexRangeNoData"),
            (rig.node("cell.level"), {"IndexRange": "3:1"}, "BadIndexRangeInvalid"),
            (rig.node("cell.level"), {"IndexRange": "x"}, "BadIndexRangeInvalid"),
            (server_array, {"IndexRange": "0"}, "Good"),
            (server_array, {"IndexRange": "5:9"}, "BadIndexRangeNoData"),
            (rig.node("cell.level"), {"DataEncoding": ua.QualifiedName("Default Binary")}, "BadDataEncodingInvalid"),
            (limit, {"DataEncoding": ua.QualifiedName("Default Binary")}, "Good"),
            (limit, {"DataEncoding": ua.QualifiedName("Default XML")}, "BadDataEncodingUnsupported"),
            (limit, {"DataEncoding": ua.QualifiedName("own", 6)}, "BadDataEncodingInvalid"),
        ):
            given = dict(more)
            told = await client.read(node, given.pop("attribute", VALUE), **given)
            assert name(told.StatusCode) == code, (node, more)

    tried(work)


def test_parts_of_texts_and_arrays_are_read() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        build = await client.read(ua.NodeId(ua.ObjectIds.Server_ServerStatus_BuildInfo_ProductName), IndexRange="0:1")
        assert build.Value.Value == "um"
        spaces = await client.read(ua.NodeId(ua.ObjectIds.Server_NamespaceArray), IndexRange="0,0:6")
        assert spaces.Value.Value == ["http://"]

    tried(work)


@pytest.mark.parametrize("stamps", range(4))
def test_a_read_has_the_timestamps_that_are_asked_for(stamps: int) -> None:
    async def work(rig: Rig, client: Asker) -> None:
        asked = [ua.ReadValueId(rig.node("cell.level"), VALUE), ua.ReadValueId(rig.node("cell.level"), A.DisplayName)]
        value, other = (await client.ask("Read", ua.ReadParameters(0.0, ua.TimestampsToReturn(stamps), asked))).Results
        assert (value.SourceTimestamp is not None) == (stamps in (0, 2))
        assert (value.ServerTimestamp is not None) == (stamps in (1, 2))
        assert other.SourceTimestamp is None

    tried(work)


def test_the_server_timestamp_says_until_when_a_value_was_true() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        first = await client.read("cell.limit")
        await until(lambda: rig.face._utc > first.ServerTimestamp.timestamp() + 0.2)
        second = await client.read("cell.limit")
        assert second.ServerTimestamp > first.ServerTimestamp
        await rig.machine.end()

        async def gone() -> bool:
            return name((await client.read("cell.limit")).StatusCode) == "UncertainNoCommunicationLastUsableValue"

        while not await gone():
            pass
        assert (await client.read("cell.limit")).ServerTimestamp == (await client.read("cell.limit")).ServerTimestamp
        assert (await client.read(ua.NodeId(ua.ObjectIds.Server_ServerArray))).ServerTimestamp is not None

    tried(work)


def test_every_attribute_and_reference_of_every_node_is_read() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        nodes = list(rig.face.server.iserver.aspace.keys())
        assert len(nodes) > 5_000
        for first in range(0, len(nodes), 300):
            some = nodes[first : first + 300]
            asked = [ua.ReadValueId(node, attribute) for node in some for attribute in range(1, 28)]
            results = (await client.ask("Read", 0.0, BOTH, asked)).Results
            wrong = {name(each.StatusCode) for each in results} & {"BadInternalError", "BadUnexpectedError"}
            assert not wrong
            described = [ua.BrowseDescription(node, ua.BrowseDirection.Both, ResultMask=63) for node in some]
            response = await client.ask("Browse", ua.BrowseParameters(NodesToBrowse=described))
            assert all(each.StatusCode.is_good() for each in response.Results)

    tried(work)


def test_requests_as_a_whole_are_refused() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        one = [ua.ReadValueId(rig.node("cell.level"), VALUE)]

        async def refused(service: str, kind: Any, *given: Any) -> Any:
            request = getattr(ua, f"{service}Request")()
            request.Parameters = kind(*given)
            return await client.send(service, request)

        history = (ua.ReadRawModifiedDetails(), 9, True, [ua.HistoryReadValueId(SERVER)])
        view = ua.ViewDescription(SERVER)
        for code, *asked in (
            ("BadMaxAgeInvalid", "Read", ReadParameters, -1.0, 2, one),
            ("BadMaxAgeInvalid", "Read", ReadParameters, float("nan"), 2, one),
            ("BadTimestampsToReturnInvalid", "Read", ReadParameters, 0.0, 4, one),
            ("BadNothingToDo", "Read", ReadParameters, 0.0, 2, []),
            ("BadTooManyOperations", "Read", ReadParameters, 0.0, 2, one * (limits.MAX_READ + 1)),
            ("BadTimestampsToReturnInvalid", "HistoryRead", HistoryReadParameters, *history),
            ("BadNothingToDo", "Write", ua.WriteParameters, []),
            ("BadNothingToDo", "Call", ua.CallParameters, []),
            ("BadNothingToDo", "Browse", BrowseParameters),
            ("BadViewIdUnknown", "Browse", BrowseParameters, view, 0, [BrowseDescription(SERVER)]),
            ("BadNothingToDo", "BrowseNext", ua.BrowseNextParameters, True, []),
            ("BadNothingToDo", "TranslateBrowsePathsToNodeIds", ua.TranslateBrowsePathsToNodeIdsParameters, []),
            ("BadNothingToDo", "RegisterNodes", ua.RegisterNodesParameters, []),
            ("BadNodeIdInvalid", "RegisterNodes", ua.RegisterNodesParameters, [ua.NodeId()]),
            ("BadNothingToDo", "UnregisterNodes", ua.UnregisterNodesParameters, []),
            ("BadNothingToDo", "SetPublishingMode", ua.SetPublishingModeParameters, True, []),
            ("BadNothingToDo", "DeleteSubscriptions", ua.DeleteSubscriptionsParameters, []),
            ("BadSubscriptionIdInvalid", "ModifySubscription", ua.ModifySubscriptionParameters, 9),
            ("BadSubscriptionIdInvalid", "Republish", ua.RepublishParameters, 9, 1),
            ("BadNoSubscription", "Publish", ua.PublishParameters),
            ("BadServiceUnsupported", "TransferSubscriptions", ua.TransferSubscriptionsParameters, [1]),
            ("BadServiceUnsupported", "SetTriggering", ua.SetTriggeringParameters, 1, 1),
            ("BadServiceUnsupported", "HistoryUpdate", ua.HistoryUpdateParameters),
            ("BadServiceUnsupported", "QueryFirst", ua.QueryFirstParameters),
            ("BadServiceUnsupported", "Cancel", ua.CancelParameters),
            ("BadServiceUnsupported", "AddNodes", ua.AddNodesParameters),
            ("BadServiceUnsupported", "DeleteReferences", ua.DeleteReferencesParameters),
        ):  # fmt: skip
            assert await refused(*asked) == code, asked[:1]

    tried(work)


def test_there_is_no_history_and_it_says_so() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        nodes = [ua.HistoryReadValueId(each) for each in (rig.node("cell.level"), rig.node("cell.no"), ua.NodeId())]
        asked = ua.HistoryReadParameters(ua.ReadRawModifiedDetails(), BOTH, False, nodes)
        results = (await client.ask("HistoryRead", asked)).Results
        assert [name(each.StatusCode) for each in results] == [
            "BadHistoryOperationUnsupported", "BadNodeIdUnknown", "BadNodeIdInvalid",
        ]  # fmt: skip

    tried(work)


# Write -----------------------------------------------------------------------------------------------------


def test_what_cannot_be_written_has_its_code() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        gain, now = rig.node("tunable:cell.gain"), datetime.now(UTC)
        two = ua.Variant(2.0, DOUBLE)
        cases: tuple[tuple[Any, ...], ...] = (
            (gain, ua.DataValue(two), "Good"),
            (gain, ua.DataValue(ua.Variant(2, INT32)), "BadTypeMismatch"),
            (gain, ua.DataValue(ua.Variant("2", STRING)), "BadTypeMismatch"),
            (gain, ua.DataValue(ua.Variant([2.0], DOUBLE)), "BadTypeMismatch"),
            (gain, ua.DataValue(ua.Variant()), "BadTypeMismatch"),
            (gain, ua.DataValue(ua.Variant(11.0, DOUBLE)), "BadOutOfRange"),
            (gain, ua.DataValue(ua.Variant(float("nan"), DOUBLE)), "BadOutOfRange"),
            (gain, ua.DataValue(two, SourceTimestamp=now), "BadWriteNotSupported"),
            (gain, ua.DataValue(two, ServerTimestamp=now), "BadWriteNotSupported"),
            (gain, ua.DataValue(two, ua.StatusCode(ua.StatusCodes.UncertainInitialValue)), "BadWriteNotSupported"),
            (rig.node("cell.lamp"), ua.DataValue(ua.Variant(1, INT32)), "BadTypeMismatch"),
            (rig.node("cell.level"), ua.DataValue(two), "BadNotWritable"),
            (SERVER, ua.DataValue(two), "BadAttributeIdInvalid"),
            (rig.node("cell.no"), ua.DataValue(two), "BadNodeIdUnknown"),
            (ua.NodeId(ua.ObjectIds.Server_ServerStatus_State), ua.DataValue(ua.Variant(0, INT32)), "BadNotWritable"),
        )
        values = [ua.WriteValue(node, VALUE, None, data) for node, data, _ in cases]
        results = (await client.ask("Write", values)).Results
        assert [name(each) for each in results] == [code for *_, code in cases]
        for range, attribute, code in (
            ("0", VALUE, "BadIndexRangeNoData"),
            ("?", VALUE, "BadIndexRangeInvalid"),
            (None, A.DisplayName, "BadNotWritable"),
            (None, A.Executable, "BadAttributeIdInvalid"),
        ):
            [result] = (await client.ask("Write", [ua.WriteValue(gain, attribute, range, ua.DataValue(two))])).Results
            assert name(result) == code

    tried(work, "ann")


def test_a_session_sees_what_it_may() -> None:
    async def work(rig: Rig) -> None:
        add, gain = rig.node("action:cell.add"), rig.node("tunable:cell.gain")
        shown = (gain, A.AccessLevel), (gain, A.UserAccessLevel), (add, A.Executable), (add, A.UserExecutable)
        for user, rights in (("ann", [3, 3, True, True]), (None, [3, 1, True, False])):
            async with rig.client(user) as client:
                assert [(await client.read(node, each)).Value.Value for node, each in shown] == rights
        async with rig.client("ann") as ann:
            there_is_none = ua.NodeId(ua.ObjectIds.ServerType_SetSubscriptionDurable)
            assert (await ann.read(there_is_none, A.Executable)).Value.Value is False

    run(work)


def test_nobody_may_anything_where_the_face_only_reads() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        assert (await client.read("tunable:cell.gain", A.UserAccessLevel)).Value.Value == 1
        assert (await client.read("action:cell.add", A.UserExecutable)).Value.Value is False

    tried(work, "ann", read_only=True)


def test_after_the_end_of_a_run_commands_are_refused() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        await rig.machine.end()
        await until(lambda: rig.face._commands is None)
        two = ua.DataValue(ua.Variant(2.0, DOUBLE))
        [result] = (await client.ask("Write", [ua.WriteValue(rig.node("tunable:cell.gain"), VALUE, None, two)])).Results
        assert name(result) == "BadNoCommunication"
        request = ua.CallMethodRequest(rig.node("part:cell"), rig.node("action:cell.add"), [ua.Variant(1.0, DOUBLE)])
        [result] = (await client.ask("Call", [request])).Results
        assert name(result.StatusCode) == "BadNoCommunication"

    tried(work, "ann")


# Call ------------------------------------------------------------------------------------------------------


def test_what_cannot_be_called_has_its_code() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        cell, add, machine = rig.node("part:cell"), rig.node("action:cell.add"), rig.node("machine")
        one, text = ua.Variant(1.0, DOUBLE), ua.Variant("one", STRING)
        alarm, acknowledge = (
            rig.node("condition:cell.full"),
            ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge),
        )
        refresh, kind = ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh), ua.NodeId(ua.ObjectIds.ConditionType)
        subscription = ua.Variant(99, ua.VariantType.UInt32)
        for node, method, given, code, arguments in (
            (cell, add, [one], "Good", []),
            (cell, add, [], "BadArgumentsMissing", []),
            (cell, add, [one, one], "BadTooManyArguments", []),
            (cell, add, [text], "BadInvalidArgument", ["BadTypeMismatch"]),
            (cell, add, [ua.Variant(1, INT32)], "BadInvalidArgument", ["BadTypeMismatch"]),
            (cell, add, [ua.Variant([1.0], DOUBLE)], "BadInvalidArgument", ["BadTypeMismatch"]),
            (cell, add, [ua.Variant()], "BadInvalidArgument", ["BadTypeMismatch"]),
            (cell, add, [ua.Variant(6.0, DOUBLE)], "BadInvalidArgument", ["BadOutOfRange"]),
            (machine, add, [one], "BadMethodInvalid", []),
            (SERVER, add, [one], "BadMethodInvalid", []),
            (cell, ua.NodeId(), [one], "BadNodeIdInvalid", []),
            (cell, rig.node("action:cell.no"), [one], "BadMethodInvalid", []),
            (cell, rig.node("cell.level"), [one], "BadMethodInvalid", []),
            (rig.node("part:no"), add, [one], "BadNodeIdUnknown", []),
            (ua.NodeId(), add, [one], "BadNodeIdInvalid", []),
            (machine, rig.node("command:mode"), [text], "BadInvalidArgument", ["BadOutOfRange"]),
            (machine, rig.node("command:mode"), [], "BadArgumentsMissing", []),
            (alarm, acknowledge, [one], "BadInvalidArgument", ["BadTypeMismatch"]),
            (alarm, acknowledge, [one, one], "BadInvalidArgument", ["BadTypeMismatch", "BadTypeMismatch"]),
            (cell, acknowledge, [ua.Variant(), ua.Variant()], "BadMethodInvalid", []),
            (kind, refresh, [subscription], "BadSubscriptionIdInvalid", []),
            (kind, refresh, [], "BadArgumentsMissing", []),
            (kind, refresh, [text], "BadInvalidArgument", ["BadTypeMismatch"]),
            (SERVER, ua.NodeId(ua.ObjectIds.Server_SetSubscriptionDurable), [subscription], "BadNotExecutable", []),
        ):  # fmt: skip
            [result] = (await client.ask("Call", [ua.CallMethodRequest(node, method, given)])).Results
            told = [name(each) for each in result.InputArgumentResults or []]
            assert (name(result.StatusCode), told) == (code, arguments), (node, method, given)
            assert not result.InputArgumentDiagnosticInfos

    tried(work, "ann")


# View ------------------------------------------------------------------------------------------------------


def test_a_browse_keeps_its_limits_and_masks() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        cell, components = rig.node("part:cell"), ua.NodeId(ua.ObjectIds.HasComponent)
        everything = ua.NodeId(ua.ObjectIds.References)

        async def browse(most: int = 0, **given: Any) -> Any:
            asked = BrowseDescription(**{"NodeId": cell, "ResultMask": 63} | given)
            request = ua.BrowseRequest()
            request.Parameters = BrowseParameters(RequestedMaxReferencesPerNode=most, NodesToBrowse=[asked])
            return (await client.send("Browse", request)).Results[0]

        every = (await browse(ReferenceTypeId=components)).References
        assert len(every) > 6
        for given, code in (
            ({"NodeId": rig.node("cell.no")}, "BadNodeIdUnknown"),
            ({"NodeId": ua.NodeId()}, "BadNodeIdInvalid"),
            ({"BrowseDirection": 3}, "BadBrowseDirectionInvalid"),
            ({"ReferenceTypeId": SERVER}, "BadReferenceTypeIdInvalid"),
            ({"ReferenceTypeId": rig.node("cell.no")}, "BadReferenceTypeIdInvalid"),
        ):
            assert name((await browse(**given)).StatusCode) == code
        part = await browse(4, ReferenceTypeId=components)
        found, point = list(part.References), part.ContinuationPoint
        while point:
            request = ua.BrowseNextParameters(False, [point])
            [part] = (await client.ask("BrowseNext", request)).Parameters.Results
            assert len(part.References) <= 4
            found, point = found + list(part.References), part.ContinuationPoint
        assert [each.NodeId for each in found] == [each.NodeId for each in every]
        points = [(await browse(1)).ContinuationPoint for _ in range(limits.MAX_CONTINUATIONS)]
        assert name((await browse(1)).StatusCode) == "BadNoContinuationPoints"
        await client.ask("BrowseNext", ua.BrowseNextParameters(True, points))
        [result] = (await client.ask("BrowseNext", ua.BrowseNextParameters(False, points[:1]))).Parameters.Results
        assert name(result.StatusCode) == "BadContinuationPointInvalid"
        [methods, plain] = [await browse(**each) for each in ({"NodeClassMask": 4}, {"ResultMask": 0})]
        assert {each.NodeClass for each in methods.References} == {ua.NodeClass.Method}
        assert {(each.BrowseName.Name, each.DisplayName.Text) for each in plain.References} == {(None, None)}
        assert not (await browse(ReferenceTypeId=everything, IncludeSubtypes=False)).References
        assert all(not each.IsForward for each in (await browse(BrowseDirection=1)).References)

    tried(work)


def test_a_path_is_translated_or_refused() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        own = rig.node("machine").NamespaceIndex
        down = ua.NodeId(ua.ObjectIds.HierarchicalReferences)

        def step(text: str | None, space: int = own, kind: ua.NodeId = down, **more: Any) -> ua.RelativePathElement:
            return ua.RelativePathElement(kind, False, True, ua.QualifiedName(text, space))

        for start, steps, code in (
            (rig.node("machine"), [step("cell"), step("level")], "Good"),
            (rig.node("machine"), [step("cell"), step("level"), step("EURange", 0)], "Good"),
            (rig.node("machine"), [step("cell", 0)], "BadNoMatch"),
            (rig.node("machine"), [], "BadNothingToDo"),
            (rig.node("machine"), [step(None)], "BadBrowseNameInvalid"),
            (rig.node("machine"), [step("cell", kind=SERVER)], "BadReferenceTypeIdInvalid"),
            (rig.node("no"), [step("cell")], "BadNodeIdUnknown"),
            (ua.NodeId(), [step("cell")], "BadNodeIdInvalid"),
        ):
            path = ua.BrowsePath(start, ua.RelativePath(steps))
            [result] = (await client.ask("TranslateBrowsePathsToNodeIds", [path])).Results
            assert name(result.StatusCode) == code
            assert bool(result.Targets) == (code == "Good")

    tried(work)


def test_registered_nodes_are_the_nodes() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        nodes = [rig.node("cell.level"), rig.node("cell.no")]
        assert (await client.ask("RegisterNodes", nodes)).Parameters.RegisteredNodeIds == nodes
        assert not isinstance(await client.ask("UnregisterNodes", nodes), str)

    tried(work)


def test_a_server_tells_its_limits() -> None:
    async def work(rig: Rig, client: Asker) -> None:
        for capability, told in (
            ("OperationLimits_MaxNodesPerWrite", limits.MAX_OPERATIONS),
            ("OperationLimits_MaxNodesPerRead", limits.MAX_READ),
            ("MaxBrowseContinuationPoints", limits.MAX_CONTINUATIONS),
            ("MaxMonitoredItemsQueueSize", limits.MAX_QUEUE),
        ):
            node = ua.NodeId(getattr(ua.ObjectIds, f"Server_ServerCapabilities_{capability}"))
            assert (await client.read(node)).Value.Value == told

    tried(work)


# Sessions --------------------------------------------------------------------------------------------------


def test_the_token_of_another_session_is_refused() -> None:
    async def whole(rig: Rig) -> None:
        async with rig.client() as client:
            protocol = client.client.uaclient.protocol
            token = protocol.authentication_token
            protocol.authentication_token = ua.NodeId(b"\0" * 32, 0, ua.NodeIdType.ByteString)
            asked = [ua.ReadValueId(rig.node("cell.level"), VALUE)]
            assert await client.ask("Read", 0.0, BOTH, asked) == "BadSessionIdInvalid"
            protocol.authentication_token = token

    run(whole)


def test_a_response_is_not_longer_than_its_client_takes() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            [session] = rig.face.server.iserver._external_sessions.values()
            session.most = 1000
            asked = [ua.ReadValueId(rig.node("cell.level"), VALUE)]
            assert not isinstance(await client.ask("Read", 0.0, BOTH, asked), str)
            assert await client.ask("Read", 0.0, BOTH, asked * 100) == "BadResponseTooLarge"

    run(work)


def test_a_call_whose_result_cannot_be_encoded_is_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(rig: Rig) -> None:
        async def call(session: Any, request: Any) -> Answer:
            return Answer(ua.CallMethodResult(OutputArguments=[ua.Variant(1 << 64, ua.VariantType.Int64)]))

        monkeypatch.setattr(rig.face.server.iserver, "call", call)
        async with rig.client() as client:
            asked = [ua.CallMethodRequest(rig.node("machine"), rig.node("command:stop"))]
            assert await client.ask("Call", asked) == "BadEncodingError"
            assert await reads(client, rig) == "Good"

    run(work)


@pytest.mark.smoke
@pytest.mark.parametrize("number", [0, -1, (1 << 63) - 1, 1 << 63, -(1 << 64), True])
def test_every_whole_number_can_be_the_result_of_an_action(number: int) -> None:
    told = variant_from_binary(Buffer(variant_to_binary(result_of(number)))).Value
    assert told in (number, str(number)) and isinstance(told, str) == (abs(number) >= 1 << 63)


def test_what_is_published_is_not_longer_than_its_client_takes_and_nothing_is_lost() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            [session] = rig.face.server.iserver._external_sessions.values()
            heard = Heard()
            mine = await client.subscribe(heard)
            heard.listen(mine)
            nodes = [ua.ReadValueId(rig.node("cell.level"), VALUE)] * 20
            asked = [ua.MonitoredItemCreateRequest(each, 0, ua.MonitoringParameters(n)) for n, each in enumerate(nodes)]
            given = ua.CreateMonitoredItemsParameters(mine.subscription_id, BOTH, asked)
            await client.ask("CreateMonitoredItems", given)
            session.most = 400
            numbers = [each.number for each in session.publisher.subscriptions[mine.subscription_id].items.values()]
            given = ua.SetMonitoringModeParameters(mine.subscription_id, ua.MonitoringMode.Reporting, numbers)
            await client.ask("SetMonitoringMode", given)
            await until(lambda: {each[0] for each in heard.values} == set(range(20)))
            assert max(heard.sizes) < 20

    run(work)


@asynccontextmanager
async def taking_up(rig: Rig, session: Asker) -> AsyncIterator[Asker]:
    """Another connection with the token of a session."""
    other = Client(rig.face.address)
    await other.connect_socket()
    await other.send_hello()
    await other.open_secure_channel()
    other.uaclient.protocol.authentication_token = session.client.uaclient.protocol.authentication_token
    yield Asker(other, rig)
    other.disconnect_socket()


async def activated(connection: Asker, password: bytes = b"hunter2") -> str:
    """Take the session of ann up; the name of the code."""
    request = ua.ActivateSessionRequest()
    request.Parameters.UserIdentityToken = ua.UserNameIdentityToken("username", "ann", password)
    response = await connection.send("ActivateSession", request)
    return response if isinstance(response, str) else "Good"


async def reads(connection: Asker, rig: Rig) -> str:
    response = await connection.ask("Read", 0.0, BOTH, [ua.ReadValueId(rig.node("cell.level"), VALUE)])
    return response if isinstance(response, str) else "Good"


async def gone(rig: Rig, count: int) -> None:
    """The server has so many connections left."""
    server = rig.face.server.bserver
    assert server is not None
    await until(lambda: len(server.clients) == count and not server.closing_tasks, FIRST)


def test_a_session_that_is_taken_up_on_another_connection_is_not_on_the_first_any_more() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client("ann") as first, taking_up(rig, first) as second:
            request = ua.ActivateSessionRequest()
            request.Parameters.UserIdentityToken = ua.AnonymousIdentityToken("anonymous")
            assert await second.send("ActivateSession", request) == "BadIdentityChangeNotSupported"
            assert await reads(first, rig) == "Good"
            assert await reads(second, rig) == "BadSecureChannelIdInvalid"
            assert await activated(second) == "Good"
            assert await reads(first, rig) == "BadSecureChannelIdInvalid"
            assert await reads(second, rig) == "Good"
            assert await activated(first) == "Good"

    run(work)


@pytest.mark.parametrize("how", ["breaks", "closes"])
def test_a_session_that_is_taken_up_outlives_the_connection_that_it_was_on(how: str) -> None:
    async def work(rig: Rig) -> None:
        async with rig.client("ann") as first, taking_up(rig, first) as second:
            [old] = [each.processor for each in rig.face.server.bserver.clients if each.processor.session is not None]
            assert await activated(second) == "Good"
            assert old._session_watchdog_task is None
            if how == "closes":
                assert await first.send("CloseSession", ua.CloseSessionRequest()) == "BadSecureChannelIdInvalid"
            else:
                first.client.uaclient.protocol.transport.abort()
                await gone(rig, 1)
            assert await reads(second, rig) == "Good"
            async with taking_up(rig, second) as third:
                assert await activated(third) == "Good"

    run(work)


def test_a_session_outlives_a_connection_that_could_not_take_it_up() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client("ann") as first:
            async with taking_up(rig, first) as second:
                assert await activated(second, b"wrong") == "BadUserAccessDenied"
                assert await second.send("CloseSession", ua.CloseSessionRequest()) == "BadSecureChannelIdInvalid"
            await gone(rig, 1)
            assert await reads(first, rig) == "Good"

    run(work)
