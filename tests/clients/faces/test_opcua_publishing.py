"""The state machine of a subscription and the queues of its items, with a clock of the test's own."""

from __future__ import annotations

from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AttributeValue
from hypothesis import given
from hypothesis import strategies as st

from umo.clients.faces.opcua import ua_limits as limits
from umo.clients.faces.opcua.ua_data_filter import DataFilter
from umo.clients.faces.opcua.ua_event_filter import like
from umo.clients.faces.opcua.ua_items import DISABLED, REPORTING, SAMPLING, DataItem, EventItem
from umo.clients.faces.opcua.ua_subscriptions import Publisher, PublishRequest, UaSubscription
from umo.clients.faces.opcua.ua_tree import put

pytestmark = pytest.mark.smoke
BAD = ua.StatusCode(ua.StatusCodes.BadDeviceFailure)
STAMPS = ua.TimestampsToReturn.Both
NOW = datetime(2026, 1, 1, tzinfo=UTC)


def value(number: Any, status: ua.StatusCode | None = None) -> ua.DataValue:
    return ua.DataValue(ua.Variant(number), status or ua.StatusCode(), NOW, NOW)


class Bench:
    """One subscription with its items; `now` in s."""

    def __init__(self, **given: Any) -> None:
        self.now = 0.0
        self.answers: list[Any] = []
        self.publisher = Publisher(self.send, lambda: self.now)
        self.subscription = self.subscribe(1, **given)
        self.values: list[AttributeValue] = []

    def send(self, request: PublishRequest, response: Any) -> int:
        self.answers.append(response)
        return 0

    def subscribe(self, number: int, **given: Any) -> UaSubscription:
        asked = ua.CreateSubscriptionParameters(RequestedPublishingInterval=1000.0, **given)
        made = UaSubscription(number, ua.NodeId(), self.publisher, asked, lambda ended: None)
        self.publisher.subscriptions[number] = made
        return made

    def item(self, start: Any = 0, filter: Any = None, mode: int = REPORTING, **given: Any) -> DataItem:
        asked = SimpleNamespace(MonitoringMode=mode, ItemToMonitor=ua.ReadValueId(AttributeId=13))
        asked.RequestedParameters = ua.MonitoringParameters(**given)
        self.values.append(AttributeValue(value(start)))
        number, new, interval = len(self.values), filter or DataFilter(), self.subscription.interval
        made = DataItem(number, self.subscription.stir, lambda: self.now, self.values[-1], new, asked, STAMPS, interval)
        self.subscription.items[number] = made
        return made

    def request(self, hint: int = 0, acknowledged: Any = ()) -> None:
        self.publisher.publish(SimpleNamespace(TimeoutHint=hint), None, acknowledged)

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.now += self.subscription.interval / 1e3
            for each in list(self.publisher.subscriptions.values()):
                each.tick()

    def told(self) -> list[Any]:
        """What the responses since the last call say: a keep-alive as "alive", values as a list, codes of faults."""
        answers, self.answers[:] = list(self.answers), []
        return [self._said(each) for each in answers]

    def _said(self, response: Any) -> Any:
        if isinstance(response, ua.ServiceFault):
            return response.ResponseHeader.ServiceResult.name
        data = response.Parameters.NotificationMessage.NotificationData
        if not data:
            return "alive"
        if isinstance(data[0], ua.StatusChangeNotification):
            return data[0].Status.name
        return [each.Value.Value.Value for each in data[0].MonitoredItems]


# Publishing ------------------------------------------------------------------------------------------------


def test_a_first_cycle_is_told_then_keep_alives_in_their_number() -> None:
    bench = Bench(RequestedMaxKeepAliveCount=3)
    for _ in range(8):
        bench.request()
    said = []
    for _ in range(8):
        bench.tick()
        said.append(bench.told())
    assert said == [["alive"], [], [], ["alive"], [], [], ["alive"], []]


def test_notifications_come_in_portions_with_more_notifications() -> None:
    bench = Bench(MaxNotificationsPerPublish=2)
    item = bench.item(QueueSize=10)
    for number in range(1, 5):
        item.take(value(number))
    bench.request()
    bench.tick()
    assert [each.Parameters.MoreNotifications for each in bench.answers] == [True]
    assert bench.told() == [[0, 1]]
    bench.request()  # what is late is told at once
    bench.request()
    assert bench.told() == [[2, 3], [4]]


def test_a_subscription_without_requests_ends_after_its_lifetime_and_says_so() -> None:
    bench = Bench(RequestedMaxKeepAliveCount=2, RequestedLifetimeCount=1)
    assert bench.subscription.lifetime == 6
    bench.tick(5)
    bench.request()
    assert bench.told() == ["alive"]
    bench.tick(6)
    assert not bench.publisher.subscriptions
    bench.request()
    assert bench.told() == ["BadTimeout"]
    with pytest.raises(ServiceError) as refused:
        bench.request()
    assert refused.value.code == ua.StatusCodes.BadNoSubscription


def test_requests_wait_as_long_as_their_hint_and_not_without_bound() -> None:
    bench = Bench()
    bench.request(hint=500)
    bench.tick()
    assert bench.told() == ["BadTimeout"]
    for _ in range(limits.MAX_PUBLISH + 2):
        bench.request()
    assert bench.told() == ["alive", "BadTooManyPublishRequests"]


def test_the_late_subscription_of_higher_priority_is_told_first() -> None:
    bench = Bench(Priority=1)
    bench.subscribe(2, Priority=9)
    bench.tick()
    for _ in range(2):
        bench.request()
    assert [each.Parameters.SubscriptionId for each in bench.answers] == [2, 1]


def test_messages_are_kept_until_they_are_acknowledged() -> None:
    bench = Bench()
    item = bench.item(QueueSize=10)
    bench.request()
    bench.tick()
    item.take(value(7))
    bench.request()
    bench.tick()
    assert bench.told() == [[0], [7]]
    assert list(bench.subscription.kept) == [1, 2]
    acknowledged = [ua.SubscriptionAcknowledgement(each, number) for each, number in ((1, 1), (1, 9), (5, 1))]
    bench.request(acknowledged=acknowledged)
    bench.tick(limits.KEEP_ALIVE)
    [answer] = bench.answers
    assert [each.name for each in answer.Parameters.Results] == [
        "Good", "BadSequenceNumberUnknown", "BadSubscriptionIdInvalid",
    ]  # fmt: skip
    assert answer.Parameters.AvailableSequenceNumbers == [2]
    assert answer.Parameters.NotificationMessage.SequenceNumber == 3  # of the next message, as it is a keep-alive


def test_messages_that_nobody_acknowledges_are_not_kept_without_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_KEPT", 5)
    bench = Bench()
    items = [bench.item(QueueSize=10) for _ in range(3)]
    for number in range(1, 4):
        bench.request()
        bench.tick()
        for item in items:
            item.take(value(number))
    assert list(bench.subscription.kept) == [3]
    monkeypatch.setattr(limits, "MAX_KEPT", 1000)
    for number in range(limits.MAX_UNACKNOWLEDGED + 5):
        items[0].take(value(number))
        bench.request()
        bench.tick()
    assert len(bench.subscription.kept) == limits.MAX_UNACKNOWLEDGED


def test_nothing_is_told_while_publishing_is_disabled() -> None:
    bench = Bench(PublishingEnabled=False, RequestedMaxKeepAliveCount=2)
    bench.item()
    bench.request()
    bench.tick()
    assert bench.told() == ["alive"]
    bench.subscription.is_enabled = True
    bench.request()
    bench.tick()
    assert bench.told() == [[0]]


@pytest.mark.parametrize(
    "interval, keep_alive, lifetime, revised",
    [
        (0.0, 0, 0, (50.0, 10, 30)),
        (-5.0, 7, 100, (50.0, 7, 100)),
        (float("nan"), 7, 20, (50.0, 7, 21)),
        (float("inf"), 1 << 31, 1 << 31, (3_600_000.0, 5_000, 15_000)),
        (250.0, 3, 9, (250.0, 3, 9)),
    ],
)
def test_what_is_asked_for_is_revised(interval: float, keep_alive: int, lifetime: int, revised: Any) -> None:
    asked = ua.CreateSubscriptionParameters(interval, lifetime, keep_alive)
    made = UaSubscription(1, ua.NodeId(), Bench().publisher, asked, lambda ended: None)
    assert (made.interval, made.keep_alive, made.lifetime) == revised


class Choosy(Bench):
    """Its client takes so many notifications of one response, and no value of `refused`."""

    def __init__(self, most: int, refused: Any = (), **given: Any) -> None:
        super().__init__(**given)
        self.most, self.refused, self.tried = most, refused, 0

    def send(self, request: PublishRequest, response: Any) -> int:
        self.tried += 1
        found = response.Parameters.NotificationMessage.NotificationData if hasattr(response, "Parameters") else []
        items = [each for data in found for each in data.MonitoredItems]
        if any(each.Value.Value is not None and each.Value.Value.Value in self.refused for each in items):
            return int(ua.StatusCodes.BadEncodingError)
        if len(items) > self.most:
            return int(ua.StatusCodes.BadResponseTooLarge)
        return super().send(request, response)


def every(answers: list[Any]) -> list[tuple[Any, str]]:
    """Values and names of their statuses, as they were told."""
    messages = [each.Parameters.NotificationMessage for each in answers if isinstance(each, ua.PublishResponse)]
    values = [item.Value for each in messages for data in each.NotificationData for item in data.MonitoredItems]
    return [(each.Value and each.Value.Value, each.StatusCode.name) for each in values]


@pytest.mark.parametrize("most", [1, 2, 3, 100])
def test_what_is_too_large_for_one_response_comes_in_several(most: int) -> None:
    bench = Choosy(most)
    item = bench.item(QueueSize=20)
    for number in range(1, 10):
        item.take(value(number))
    for _ in range(3):
        bench.request()
    bench.tick()
    while bench.subscription._has_told():
        bench.request()
    assert every(bench.answers) == [(number, "Good") for number in range(10)]
    numbers = [each.Parameters.NotificationMessage.SequenceNumber for each in bench.answers]
    assert numbers == list(bench.subscription.kept) == list(range(1, len(numbers) + 1))
    assert [each.Parameters.MoreNotifications for each in bench.answers] == [True] * (len(numbers) - 1) + [False]
    bench.tried = 0
    for number in range(10, 20):
        item.take(value(number))
    for _ in range(10):
        bench.request()
    bench.tick()
    assert bench.tried <= 10  # it is known now what the client takes


def test_a_value_that_cannot_be_encoded_costs_itself_and_the_others_come() -> None:
    bench = Choosy(100, refused=(3, 4))
    item = bench.item(QueueSize=20)
    for number in range(1, 8):
        item.take(value(number))
    for _ in range(9):
        bench.request()
    bench.tick()
    told = [(0, "Good"), (1, "Good"), (2, "Good"), *[(None, "BadEncodingError")] * 2, *[(n, "Good") for n in (5, 6, 7)]]
    assert every(bench.answers) == told


def test_what_cannot_even_be_told_as_a_status_is_a_fault_and_the_subscription_goes_on() -> None:
    bench = Choosy(0)
    bench.item()
    bench.request()
    bench.tick()
    assert bench.told() == ["BadResponseTooLarge"]
    bench.request()
    bench.tick(limits.KEEP_ALIVE)
    assert bench.told() == ["alive"]


def test_a_portion_has_no_more_bytes_than_a_response_may_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_RESPONSE", 1000)
    bench = Bench()
    item = bench.item(QueueSize=100)
    for number in range(30):
        item.take(value(f"{number:090}"))
    for _ in range(10):
        bench.request()
    bench.tick()
    sizes = [len(each) for each in bench.told()]
    assert sum(sizes) == 31 and max(sizes) <= 12


# Items -----------------------------------------------------------------------------------------------------


def queue_of(item: DataItem) -> list[tuple[Any, int]]:
    return [(each.Value.Value, each.StatusCode.value) for each in item.queue]


@pytest.mark.parametrize(
    "size, oldest, left",
    [
        (1, True, [(5, 0)]),
        (1, False, [(5, 0)]),
        (3, True, [(3, 0x480), (4, 0), (5, 0)]),
        (3, False, [(0, 0), (1, 0), (5, 0x480)]),
        (6, True, [(number, 0) for number in range(6)]),
    ],
)
def test_a_full_queue_leaves_out_what_discard_oldest_says(size: int, oldest: bool, left: Any) -> None:
    item = Bench().item(QueueSize=size, DiscardOldest=oldest)
    for number in range(1, 6):
        item.take(value(number))
    assert queue_of(item) == left


def test_values_are_sampled_in_the_interval_and_failures_at_once() -> None:
    bench = Bench()
    item = bench.item(QueueSize=100, SamplingInterval=100.0)
    for step in range(1, 30):  # every 10 ms
        bench.now = step * 0.01
        item.take(value(step, BAD if step == 15 else None))
    assert [number for number, _ in queue_of(item)] == [0, 9, 15, 16, 19]
    bench.now = 0.31
    item.settle(bench.now)
    assert queue_of(item)[-1] == (29, 0)


@given(
    st.lists(st.tuples(st.integers(0, 400), st.integers(0, 3)), max_size=30),
    st.sampled_from((0.0, 50.0, 1000.0)),
    st.sampled_from((0.0, 2.0, 1e9)),
)
def test_the_last_status_is_always_the_one_that_is_told_last(steps: Any, sampling: float, deadband: float) -> None:
    bench = Bench()
    item = bench.item(QueueSize=100, SamplingInterval=sampling, filter=DataFilter(deadband=deadband))
    status = ua.StatusCode()
    for after, kind in steps:
        bench.now += after / 1e3
        status = BAD if kind == 0 else ua.StatusCode()
        item.take(value(None if kind == 0 else kind, status))
    assert item.queue[-1].StatusCode == status


def parameters(size: int, oldest: bool) -> Any:
    return ua.MonitoringParameters(QueueSize=size, DiscardOldest=oldest)


SIZES = st.integers(1, 5)
STEPS = st.lists(
    st.one_of(
        st.just("bad"), st.just("value"), st.just("value"), st.just("told"),
        st.sampled_from((SAMPLING, REPORTING)), st.tuples(SIZES, st.booleans()),
    ),
    max_size=30,
)  # fmt: skip
"""A value comes, a portion is told, the mode or the queue is another."""


@given(SIZES, st.booleans(), STEPS)
def test_the_last_value_always_waits_or_is_told_and_what_is_left_out_is_marked(
    size: int, oldest: bool, steps: Any
) -> None:
    item = Bench().item(QueueSize=size, DiscardOldest=oldest)
    told: list[tuple[Any, int]] = []
    taken, last, smallest = 1, (0, 0), size
    for number, step in enumerate(steps, 1):
        if step == "told" and item.is_told:
            shown = item.notification().Value
            told.append((shown.Value.Value, shown.StatusCode.value))
        elif step in ("value", "bad"):
            last = (number, BAD.value) if step == "bad" else (number, 0)
            item.take(value(number, BAD if step == "bad" else None))
            taken += 1
        elif isinstance(step, tuple):
            item.modify(parameters(*step), DataFilter(), STAMPS, 1000.0)
            smallest = min(smallest, step[0])
        elif isinstance(step, int):
            item.set_mode(step)
        assert len(item.queue) <= item.size
        known = [*told, *queue_of(item)]
        number, code = known[-1]
        assert (number, code & ~0x480) == last
        if smallest > 1 and len(known) < taken:
            assert any(code & 0x480 for _, code in known)


@pytest.mark.parametrize(
    "size, oldest, left",
    [
        (2, True, [(20, 0x480), (None, BAD.value)]),
        (2, False, [(15, 0), (None, BAD.value | 0x480)]),
        (1, True, [(None, BAD.value)]),
        (1, False, [(None, BAD.value)]),
    ],
)
def test_a_queue_that_becomes_smaller_keeps_the_last_value_and_marks_what_is_left_out(
    size: int, oldest: bool, left: Any
) -> None:
    item = Bench().item(start=15, QueueSize=10, DiscardOldest=oldest)
    item.take(value(20))
    item.take(value(None, BAD))
    item.modify(parameters(size, oldest), DataFilter(), STAMPS, 1000.0)
    assert queue_of(item) == left


class Whole:
    """In the place of an EventFilter: each event passes, as its own fields."""

    def passes(self, event: Any) -> bool:
        return True

    def fields(self, event: Any) -> list[Any]:
        return [event]


@pytest.mark.parametrize("oldest, left", [(True, ["lost", 3, 4]), (False, [1, 4, "lost"])])
@pytest.mark.parametrize("how", ["full", "smaller"])
def test_events_that_are_left_out_are_told_by_an_event(how: str, oldest: bool, left: Any) -> None:
    asked: Any = SimpleNamespace(MonitoringMode=REPORTING)
    asked.RequestedParameters = parameters(2 if how == "full" else 10, oldest)
    whole: Any = Whole()
    item = EventItem(1, lambda item: None, ua.NodeId(), asked, whole, lambda: "lost")
    for number in range(1, 5):
        item.take(number)
    item.modify(parameters(2, oldest), whole)
    told = []
    while item.is_told:
        told += item.notification().EventFields
    assert told == left


def test_modes_sample_and_report_as_they_say() -> None:
    bench = Bench()
    item = bench.item(mode=DISABLED, QueueSize=10)
    put(bench.values[0], value(1))
    assert not item.queue
    item.set_mode(SAMPLING)
    put(bench.values[0], value(2))
    assert queue_of(item) == [(1, 0), (2, 0)]
    assert not item.is_told
    item.set_mode(REPORTING)
    assert item.is_told
    item.set_mode(DISABLED)
    assert not item.queue


def test_a_value_that_cannot_be_compared_costs_itself_and_not_the_face() -> None:
    class Odd:
        def __eq__(self, other: object) -> bool:
            raise TypeError("it cannot be compared")

        __hash__ = None  # type: ignore[assignment]

    bench = Bench()
    broken, whole = bench.item(QueueSize=10), bench.item(QueueSize=10)
    broken._last = ua.DataValue(ua.Variant("x"), ua.StatusCode(), NOW, NOW)
    broken._last.Value.Value = Odd()
    for where in bench.values:
        put(where, value(1))
    assert broken.queue[-1].StatusCode.name == "BadInternalError"
    assert queue_of(whole) == [(0, 0), (1, 0)]
    put(bench.values[0], value(2))
    assert queue_of(broken)[-1] == (2, 0)


# Filters ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "before, after, tells", [(0.0, 5.0, False), (0.0, 5.1, True), (5.0, -0.1, True), ([1, 2], [1, 9], True)]
)
def test_an_absolute_deadband_tells_what_is_beyond_it(before: Any, after: Any, tells: bool) -> None:
    assert DataFilter(deadband=5.0).tells(value(before), value(after)) is tells


@pytest.mark.parametrize(
    "text, pattern, is_like",
    [
        ("abc", "a%", True), ("abc", "a_c", True), ("abc", "a_", False), ("a%", "a\\%", True), ("ab", "a\\%", False),
        ("ab", "a[a-c]", True), ("ad", "a[^a-c]", True), ("", "%", True), ("a" * 200, "%a" * 100 + "b", False),
        (5, "%", None),
    ],
)  # fmt: skip
def test_like_is_that_of_the_standard_in_linear_time(text: Any, pattern: str, is_like: Any) -> None:
    assert like(text, pattern) is is_like
