"""Subscriptions and monitored items of the face OPC UA: what a client asks for is kept (OPC 10000-4, 5.13 and 5.14)."""

from __future__ import annotations

import sys
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import ua

from helpers.opcua import let_in
from helpers.opcua_asyncua import Asker, Heard, Rig, run
from umo.clients.faces.conformance.tried_machine import until

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


@pytest.mark.parametrize("trigger", [0, 1, 2])
@pytest.mark.parametrize("size", [(0, 0.0), (ABSOLUTE, 1e9), (PERCENT, 100.0)], ids=["none", "absolute", "percent"])
def test_a_change_of_status_is_told_whatever_the_filter(size: tuple[int, float], trigger: int) -> None:
    """STALE, GOOD again, BAD, GOOD again, the end of the run."""
    asked = band(*size, ua.DataChangeTrigger(trigger))

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


# Items ----------------------------------------------------------------------------------------------------


def name(status: ua.StatusCode) -> str:
    return str(status.name)


def test_what_cannot_be_monitored_has_its_code() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, _ = await listening(client)
            server, quality = ua.NodeId(ua.ObjectIds.Server), ua.QualifiedName("Default Binary")
            for node, given, code in (
                ("cell.level", {"Filter": band(ABSOLUTE, 5.0)}, "Good"),
                ("cell.level", {"Filter": band(PERCENT, 100.0)}, "Good"),
                ("cell.level", {"Filter": band(PERCENT, 100.5)}, "BadDeadbandFilterInvalid"),
                ("cell.level", {"Filter": band(PERCENT, -1.0)}, "BadDeadbandFilterInvalid"),
                ("cell.level", {"Filter": band(ABSOLUTE, -1.0)}, "BadDeadbandFilterInvalid"),
                ("cell.level", {"Filter": band(ABSOLUTE, float("nan"))}, "BadDeadbandFilterInvalid"),
                ("cell.level", {"Filter": band(ABSOLUTE, float("inf"))}, "BadDeadbandFilterInvalid"),
                ("cell.level", {"Filter": band(3, 1.0)}, "BadDeadbandFilterInvalid"),
                ("run:execution", {"Filter": band(ABSOLUTE, 1.0)}, "Good"),
                ("run:execution", {"Filter": band(PERCENT, 1.0)}, "BadDeadbandFilterInvalid"),
                ("cell.limit", {"Filter": band(ABSOLUTE, 1.0)}, "BadFilterNotAllowed"),
                ("cell.limit", {"Filter": band(0, 0.0)}, "Good"),
                ("refusal", {"Filter": band(ABSOLUTE, 1.0)}, "BadFilterNotAllowed"),
                ("cell.level", {"Filter": band(0, 0.0), "attribute": 4}, "BadFilterNotAllowed"),
                ("cell.level", {"Filter": ua.AggregateFilter()}, "BadMonitoredItemFilterUnsupported"),
                ("cell.level", {"Filter": ua.EventFilter()}, "BadFilterNotAllowed"),
                ("cell.level", {"Filter": ua.Range(0, 1)}, "BadMonitoredItemFilterInvalid"),
                ("cell.no", {}, "BadNodeIdUnknown"),
                (ua.NodeId(), {}, "BadNodeIdInvalid"),
                ("part:cell", {}, "BadAttributeIdInvalid"),
                ("cell.level", {"range": "2:1"}, "BadIndexRangeInvalid"),
                ("cell.level", {"encoding": quality}, "BadDataEncodingInvalid"),
                ("cell.level", {"attribute": ua.AttributeIds.UserAccessLevel}, "Good"),
                (server, {"attribute": 12}, "BadEventFilterInvalid"),
                (server, {"attribute": 12, "Filter": band(0, 0.0)}, "BadFilterNotAllowed"),
                ("cell.level", {"attribute": 12}, "BadAttributeIdInvalid"),
            ):
                result = await client.monitor(mine, node, **given)
                assert name(result.StatusCode) == code, (node, given)
            assert await client.monitor(mine, "cell.level", stamps=7) == "BadTimestampsToReturnInvalid"
            wrong = await client.monitor(mine, "cell.level", mode=3)
            assert name(wrong.StatusCode) == "BadMonitoringModeInvalid"

    run(work)


def test_what_is_asked_for_is_revised_and_told() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, _ = await listening(client, 200.0)
            for asked, revised in ((0.0, 0.0), (-1.0, 200.0), (-9.0, 200.0), (70.0, 70.0), (1e9, 3_600_000.0)):
                result = await client.monitor(mine, "cell.level", SamplingInterval=asked, QueueSize=1 << 31)
                assert (result.RevisedSamplingInterval, result.RevisedQueueSize) == (revised, 100)
            given = ua.ModifySubscriptionParameters(mine.subscription_id, 1.0, 5, 4, 3, 2)
            changed = (await client.ask("ModifySubscription", given)).Parameters
            assert changed == ua.ModifySubscriptionResult(50.0, 12, 4)

    run(work)


@pytest.mark.parametrize("filter", [band(PERCENT, 30.0), band(ABSOLUTE, 30.0)], ids=["percent", "absolute"])
def test_a_deadband_is_kept(filter: Any) -> None:
    """30 % of the range of the level are 30 mm."""

    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client)
            await client.monitor(mine, "cell.level", ClientHandle=1, Filter=filter, QueueSize=10)
            await client.monitor(mine, "cell.level", ClientHandle=2, QueueSize=10)
            for raw in (20, 70, 80, 82, 21):
                rig.machine.set("cell.level", raw)
                await until(lambda raw=raw: heard.of(2)[-1:] == [(raw / 2, "Good")])
            rig.machine.set("cell.level", 199)
            await until(lambda: heard.of(1)[-1:] == [(99.5, "Good")])
            assert [value for value, _ in heard.of(1)] == [10.0, 41.0, 10.5, 99.5]

    run(work)


def test_a_value_waits_for_its_sample_and_the_modes_are_kept() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client)
            every = await client.monitor(mine, "cell.level", ClientHandle=1, QueueSize=10)
            await client.monitor(mine, "cell.level", ClientHandle=2, SamplingInterval=3_600_000.0, QueueSize=10)
            for handle, mode in ((3, ua.MonitoringMode.Disabled), (4, ua.MonitoringMode.Sampling)):
                result = await client.monitor(mine, "cell.level", ClientHandle=handle, mode=mode, QueueSize=10)
                assert result.StatusCode.is_good()
            rig.machine.set("cell.level", 60)
            await until(lambda: heard.of(1)[-1:] == [(30.0, "Good")])
            assert [heard.of(each) for each in (2, 3, 4)] == [[(10.0, "Good")], [], []]
            given = ua.SetMonitoringModeParameters(mine.subscription_id, ua.MonitoringMode.Reporting)
            given.MonitoredItemIds = [result.MonitoredItemId, 999]
            results = (await client.ask("SetMonitoringMode", given)).Parameters.Results
            assert [name(each) for each in results] == ["Good", "BadMonitoredItemIdInvalid"]
            await until(lambda: heard.of(4) == [(10.0, "Good"), (30.0, "Good")])
            removed = ua.DeleteMonitoredItemsParameters(mine.subscription_id, [every.MonitoredItemId] * 2)
            results = (await client.ask("DeleteMonitoredItems", removed)).Results
            assert [name(each) for each in results] == ["Good", "BadMonitoredItemIdInvalid"]

    run(work)


def test_handles_and_the_last_values_of_a_subscription_are_told_again() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client, rig.client() as other:
            mine, heard = await listening(client)
            item = await client.monitor(mine, "cell.level", ClientHandle=77)
            await until(lambda: heard.of(77))
            number = ua.Variant(mine.subscription_id, ua.VariantType.UInt32)
            server = client.client.nodes.server
            assert await server.call_method("0:GetMonitoredItems", number) == [[item.MonitoredItemId], [77]]
            await server.call_method("0:ResendData", number)
            await until(lambda: len(heard.of(77)) == 2)
            with pytest.raises(ua.UaStatusCodeError, match="BadSubscriptionIdInvalid"):
                await other.client.nodes.server.call_method("0:ResendData", number)
            again = ua.RepublishParameters(mine.subscription_id, 999)
            assert await client.ask("Republish", again) == "BadMessageNotAvailable"

    run(work)


# Events ---------------------------------------------------------------------------------------------------

O = ua.ObjectIds  # noqa: E741
ALARM, CONDITION = ua.NodeId(O.AlarmConditionType), ua.NodeId(O.ConditionType)


def field(text: str, kind: ua.NodeId = ALARM, attribute: int = ua.AttributeIds.Value) -> ua.SimpleAttributeOperand:
    path = [ua.QualifiedName(each, 0) for each in text.split("/") if each]
    return ua.SimpleAttributeOperand(kind, path, attribute)


def element(operator: str, *operands: Any) -> ua.ContentFilterElement:
    literal = (ua.LiteralOperand(ua.Variant(each)) if not hasattr(each, "data_type") else each for each in operands)
    return ua.ContentFilterElement(ua.FilterOperator[operator], list(literal))


SELECT = (field("Message"), field("ActiveState/Id"))


def events(*elements: Any, select: Any = SELECT) -> ua.EventFilter:
    return ua.EventFilter(list(select), ua.ContentFilter(list(elements)))


def of_type(kind: int) -> ua.ContentFilterElement:
    return element("OfType", ua.LiteralOperand(ua.Variant(ua.NodeId(kind))))


IS_CONDITION, SEVERE = of_type(O.ConditionType), element("GreaterThan", field("Severity"), 300)
FIRST, SECOND = ua.ElementOperand(1), ua.ElementOperand(2)
WHERE = {
    "nothing": ((), True),
    "a type above": ((IS_CONDITION,), True),
    "another type": ((of_type(O.SystemEventType),), False),
    "greater": ((SEVERE,), True),
    "not": ((element("Not", FIRST), SEVERE), False),
    "and": ((element("And", FIRST, SECOND), IS_CONDITION, SEVERE), True),
    "or": ((element("Or", FIRST, SECOND), of_type(O.SystemEventType), SEVERE), True),
    "like": ((element("Like", field("Message"), "too full%"),), True),
    "between": ((element("Between", field("Severity"), 401, 500),), False),
    "in list": ((element("InList", field("Severity"), 7, 400),), True),
    "null": ((element("IsNull", field("ClientUserId")),), True),
    "equal to null": ((element("Equals", field("ClientUserId"), 1),), False),
    "not equal to null": ((element("Not", FIRST), element("Equals", field("ClientUserId"), 1)), False),
}
"""Elements of a where clause, and whether it lets an alarm of the severity 400 pass."""


def test_a_where_clause_is_kept() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client)
            for handle, (elements, _) in enumerate(WHERE.values()):
                given = {"ClientHandle": handle, "Filter": events(*elements), "attribute": 12}
                assert name((await client.monitor(mine, ua.NodeId(O.Server), **given)).StatusCode) == "Good"
            rig.machine.set("cell.level", 170)
            await until(lambda: any("too full" in value[0] for value, _ in heard.of(0)))
            for handle, (case, (_, told)) in enumerate(WHERE.items()):
                assert any("too full" in value[0] and value[1] for value, _ in heard.of(handle)) is told, case

    run(work)


def test_what_is_wrong_with_an_event_filter_is_told() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, _ = await listening(client)

            async def result(filter: ua.EventFilter) -> Any:
                return await client.monitor(mine, ua.NodeId(O.Server), Filter=filter, attribute=12)

            good = field("Message")
            for clause, code in (
                (field("Nothing"), "BadNodeIdUnknown"),
                (field("Message", ua.NodeId(O.Server)), "BadTypeDefinitionInvalid"),
                (field("Message", attribute=99), "BadAttributeIdInvalid"),
                (ua.SimpleAttributeOperand(ALARM, [ua.QualifiedName(None, 0)], 13), "BadBrowseNameInvalid"),
                (ua.SimpleAttributeOperand(ALARM, [ua.QualifiedName("Message", 0)], 13, "x"), "BadIndexRangeInvalid"),
            ):
                told = await result(events(select=[good, clause]))
                assert name(told.StatusCode) == "Good"
                assert [name(each) for each in told.FilterResult.SelectClauseResults] == ["Good", code]
                assert name((await result(events(select=[clause]))).StatusCode) == "BadEventFilterInvalid"
            for wrong, code in (
                (element("Cast", 1, 2), "BadFilterOperatorUnsupported"),
                (element("Equals", 1), "BadFilterOperandCountMismatch"),
                (element("Not", ua.ElementOperand(0)), "BadFilterOperandInvalid"),
                (element("Not", ua.ElementOperand(9)), "BadFilterOperandInvalid"),
                (element("Not", field("Nothing")), "BadFilterOperandInvalid"),
            ):
                told = await result(events(wrong))
                assert name(told.StatusCode) == "BadEventFilterInvalid"
                [about] = told.FilterResult.WhereClauseResult.ElementResults
                assert name(about.StatusCode) == code

    run(work)


def test_events_that_are_left_out_are_told_by_an_event() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client, 1000.0)
            select = (field("Message", ua.NodeId(O.BaseEventType)), field("EventType", ua.NodeId(O.BaseEventType)))
            for handle, oldest in ((1, True), (2, False)):
                given = {"ClientHandle": handle, "Filter": events(select=select), "attribute": 12}
                await client.monitor(mine, ua.NodeId(O.Server), QueueSize=2, DiscardOldest=oldest, **given)
            for number in range(6):
                rig.face._happenings.tell("", f"event {number}", 100)
            await until(lambda: len(heard.of(2)) >= 3)
            overflow = ua.NodeId(O.EventQueueOverflowEventType)
            told = [[message for (message, kind), _ in heard.of(each) if kind != overflow] for each in (1, 2)]
            places = [[kind == overflow for (_, kind), _ in heard.of(each)].index(True) for each in (1, 2)]
            assert told == [["event 4", "event 5"], ["event 0", "event 5"]]
            assert places == [0, 2]

    run(work)


def test_a_refresh_of_one_item_tells_its_conditions_between_two_events() -> None:
    async def work(rig: Rig) -> None:
        async with rig.client() as client:
            mine, heard = await listening(client)
            kind = ua.NodeId(O.BaseEventType)
            select = (field("EventType", kind), field("Message", kind))
            given = {"Filter": events(IS_CONDITION, select=select), "attribute": 12}
            items = [await client.monitor(mine, ua.NodeId(O.Server), ClientHandle=each, **given) for each in (1, 2)]
            rig.machine.set("cell.level", 170)
            await until(lambda: heard.of(1) and heard.of(2))
            heard.values.clear()
            identifiers = (mine.subscription_id, items[0].MonitoredItemId, 999)
            numbers = [ua.Variant(each, ua.VariantType.UInt32) for each in identifiers]
            method = ua.NodeId(O.ConditionType_ConditionRefresh2)
            asked = ua.CallMethodRequest(CONDITION, method, numbers[:2])
            [result] = (await client.ask("Call", [asked])).Results
            assert name(result.StatusCode) == "Good"
            await until(lambda: len(heard.of(1)) >= 3)
            kinds = [kind for (kind, _), _ in heard.of(1)]
            assert kinds[0] == ua.NodeId(O.RefreshStartEventType)
            assert kinds[-1] == ua.NodeId(O.RefreshEndEventType)
            assert ALARM in kinds
            assert not heard.of(2)
            [result] = (await client.ask("Call", [ua.CallMethodRequest(CONDITION, method, numbers[::2])])).Results
            assert name(result.StatusCode) == "BadMonitoredItemIdInvalid"

    run(work)
