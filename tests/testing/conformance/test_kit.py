"""What the kit says of drivers that do what no driver should, and how it ends."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import TypeAdapter

from conformance.careful import Careful
from conformance.device import READ, Device, frame
from conformance.subjects import careful, simulated
from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.simulated import Simulated
from umo.errors import DriverError, StopError
from umo.testing.conformance import (
    Certificate,
    Input,
    Judgement,
    Output,
    Subject,
    TcpTap,
    TimePlan,
    all_rules,
    conform,
    runner,
)
from umo.testing.conformance.budget import Budget, CallTime
from umo.testing.conformance.certificate import Finding
from umo.testing.conformance.closed_twice import Placeholders
from umo.testing.conformance.leak_rules import _grows
from umo.testing.conformance.level_rules import Witness
from umo.testing.conformance.probe import NotingArray, failed
from umo.testing.conformance.relay import Traffic
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Rule, RuleBroken, chosen_rules


def test_many_cycles_of_the_simulated_circuit_leave_nothing_behind() -> None:
    certificate = conform(simulated(), only=["descriptors", "long run", "memory"], cycles=3000)
    assert certificate.passed and not certificate.left_out, str(certificate)
    assert certificate.finding("long run").why.startswith("12,000 transfers")
    assert certificate.finding("memory").why.startswith("3 rounds of 1000 cycles")


def test_a_rule_that_does_not_exist_is_an_error_that_names_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"no rule 'blok write' \(did you mean 'block write'\?\); the rules are:"):
        conform(simulated(), only=["blok write"])


def test_a_fraction_that_is_stored_is_noted_and_what_is_calculated_beside_it_is_not() -> None:
    out = NotingArray.of(3)
    beside = np.empty_like(out, dtype=float)
    beside[:] = [1.2, 2.7, 3.0]
    out[:] = np.rint(beside).astype(np.int64)
    assert (out.tolist(), out.cut) == ([1, 3, 3], [])
    out[1:][0] = 2.5
    assert out.cut == ["values of type float64, such as 2.5"]


def test_the_documentation_has_the_text_of_each_rule() -> None:
    page = (Path(__file__).parents[3] / "docs" / "howto-prove-a-driver.md").read_text("utf-8")
    assert [rule.id for rule in all_rules() if f"| {rule.id} | {rule.text} |" not in page] == []


def test_a_default_outside_the_range_that_may_be_driven_is_an_error() -> None:
    with pytest.raises(ValueError, match="dac: the default 9 is not in 0 to 5"):
        Output("dac", default=9, least=0, greatest=5)


@pytest.mark.parametrize("error", [RuntimeError("no"), SystemExit(0), KeyError("x"), RecursionError()])
def test_whatever_a_driver_raises_is_a_finding_and_not_the_end_of_the_kit(error: BaseException) -> None:
    class Raises(Simulated):
        def write(self, channel: Channel, raw: int) -> None:
            raise error

    certificate = conform(Subject("raises", make=Raises, outputs=(Output("valve"),)), cycles=10)
    assert f"raised {type(error).__name__}" in certificate.finding("kind of errors").why
    assert certificate.unreached == ("valve",)
    assert not certificate.passed


def test_a_driver_that_cannot_be_made_is_an_error_at_once() -> None:
    def make() -> Any:
        raise TypeError("no such option")

    with pytest.raises(TypeError, match="no such option"):
        conform(Subject("none", make=make, outputs=(Output("valve"),)), cycles=10)


def test_outputs_go_to_their_defaults_when_the_kit_is_interrupted() -> None:
    before = threading.enumerate()
    with careful() as subject:

        def interrupt(rule: str, share: float) -> None:
            if rule == "block write":
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            conform(subject, cycles=10, progress=interrupt)
        assert subject.levels is not None
        assert [subject.levels(output.channel)[-1] for output in subject.outputs] == [5, 0, 0]
    left = [thread for thread in threading.enumerate() if thread not in before]
    assert not [thread for thread in left if thread.name.startswith("umo")]


def test_outputs_that_cannot_be_brought_to_their_defaults_are_named_when_it_is_interrupted() -> None:
    class Stuck(Simulated):
        def reset(self, channel: Channel, default: int | None) -> None:
            raise OSError("stuck")

    def interrupt(rule: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(StopError, match="not brought to their defaults: stuck: not reset; valve"):
        conform(Subject("stuck", make=Stuck, outputs=(Output("valve"),)), progress=interrupt)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="signals of Linux")
def test_a_signal_waits_for_the_call_under_way_before_the_outputs_are_brought_to_their_defaults() -> None:
    asked, meanwhile, reset = threading.Event(), [], threading.Event()

    class Slow(Simulated):
        def initialize(self, channel: Channel, default: int | None) -> None:
            if not asked.is_set():
                asked.set()
                os.kill(os.getpid(), signal.SIGINT)  # the thread that waits for this one
                meanwhile.append(reset.wait(0.2))
            super().initialize(channel, default)

        def reset(self, channel: Channel, default: int | None) -> None:
            reset.set()
            super().reset(channel, default)

    with pytest.raises(KeyboardInterrupt):
        conform(Subject("slow", make=Slow, outputs=(Output("valve"),)))
    assert meanwhile == [False]
    assert reset.is_set()


def test_a_driver_that_hangs_without_a_line_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "HANG", 0.1)
    monkeypatch.setattr("umo.testing.conformance.driver_factory.UNCONTROLLED_TIMEOUT", 0.05)
    end = threading.Event()

    class Hangs(Simulated):
        def finalize(self, channel: Channel) -> None:
            end.wait()

    certificate = conform(Subject("hangs", make=Hangs, outputs=(Output("valve"),), timeout=0.05), cycles=10)
    end.set()
    assert [each.rule for each in certificate.failed] == ["channels"]
    assert "finalize of valve did not end within" in certificate.failed[0].why
    assert certificate.finding("range").why == "the driver hangs in finalize of valve"
    assert certificate.unreached == ()  # reset did work


def test_a_call_that_hung_and_returns_after_all_is_the_last_one_of_its_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "HANG", 0.1)
    monkeypatch.setattr("umo.testing.conformance.driver_factory.UNCONTROLLED_TIMEOUT", 0.05)
    end = threading.Event()
    hung: list[threading.Thread] = []
    later: list[str] = []

    class Hangs(Simulated):
        def finalize(self, channel: Channel) -> None:
            hung.append(threading.current_thread())
            end.wait()
            raise OSError("the answer came too late")

        def reset(self, channel: Channel, default: int | None) -> None:
            if threading.current_thread() in hung:
                later.append("reset")
            elif hung:
                end.set()
                hung[0].join()

        def close(self) -> None:
            if threading.current_thread() in hung:
                later.append("close")

    certificate = conform(Subject("hangs", make=Hangs, outputs=(Output("valve"),), timeout=0.05), cycles=10)
    assert end.is_set()
    assert later == []
    assert certificate.unreached == ()


def test_a_loop_back_shows_the_level_where_the_device_keeps_no_record() -> None:
    with careful(levels=None) as subject:
        certificate = conform(subject, only=["glitch", "reset", "range", "block write"], cycles=10)
    assert certificate.passed, str(certificate)
    assert certificate.finding("range").why == "except out:1, whose level cannot be seen"
    assert certificate.finding("glitch").why == "the levels of out:1 were not watched"


def test_a_loop_back_shows_a_wrong_level_on_the_way() -> None:
    seen, tried = threading.Event(), threading.Event()

    class Slow(Careful):
        """It stays at 0 until the loop-back has been read."""

        def initialize(self, channel: Any, default: int | None) -> None:
            if channel.text == "out:0" and tried.is_set():
                seen.clear()
                self.write(channel, 0)
                seen.wait(1.0)
            super().initialize(channel, default)

        def read(self, channel: Any) -> int:
            raw = super().read(channel)
            if raw == 0:
                seen.set()
            return raw

    with careful(Slow, levels=None) as subject:
        certificate = conform(subject, only=["glitch"], cycles=10, progress=lambda rule, share: tried.set())
    assert "out:0 was at 5, 0, 5 while it was initialised at 5" in certificate.finding("glitch").why


def test_a_device_for_one_client_refuses_the_second() -> None:
    class Alone(Careful):
        taken: set[int] = set()

        def open(self) -> None:
            if self.port in self.taken:
                raise OSError("the device has another client")
            super().open()
            self.taken.add(self.port)

        def close(self) -> None:
            if self.is_open:
                self.taken.discard(self.port)
            super().close()

    with careful(Alone) as subject:
        found = conform(subject, only=["two clients"]).finding("two clients")
    assert found.verdict is Judgement.PASSED
    assert found.why == "the second client is refused: the device has another client"


def test_a_certificate_comes_back_from_json_and_names_no_computer(tmp_path: Any, most_rules: list[str]) -> None:
    certificate = conform(simulated(), cycles=10, only=most_rules)
    text = certificate.save(tmp_path / "made").read_text()
    assert TypeAdapter(Certificate).validate_json(text) == certificate
    assert "/" not in text.replace("umo.drivers", "")
    assert certificate.driver == "umo.drivers.simulated:Simulated"


def test_a_certificate_without_a_rule_that_passed_has_not_passed() -> None:
    certificate = conform(simulated(), only=["late answer"])
    assert certificate.finding("late answer").verdict is Judgement.NOT_TRIED
    assert not certificate.passed and certificate.failed == ()


CALLS_ALONE = "every call succeeded, but no level can be seen: it needs a loop-back, or a channel that can be read back"


@pytest.mark.parametrize("rule", ["finalise", "reopen", "vanish", "two clients", "end"])
def test_a_rule_whose_outputs_cannot_be_seen_has_not_passed(rule: str) -> None:
    unseen = (Output("out:0", 5, 0, 255), Output("out:1", 0, 0, 255))
    with careful(levels=None, loopbacks=(), outputs=unseen) as subject:
        found = conform(subject, only=[rule]).finding(rule)
    assert (found.verdict, found.why) == (Judgement.NOT_TRIED, CALLS_ALONE)


def test_the_end_is_seen_where_levels_can_be_seen() -> None:
    class Ignores(Careful):
        def reset(self, channel: Any, default: int | None) -> None:
            if default is not None:
                self.write(channel, 9)

    with careful(Ignores) as subject:
        found = conform(subject, only=["end"]).finding("end")
    assert found.why.startswith("out:0 is at 9 after reset(5) at the end, not at 5")


def test_a_refused_write_to_an_input_that_is_not_steady_is_seen_in_part() -> None:
    with careful(inputs=(Input("in:9", steady=False),), loopbacks=()) as subject:
        found = conform(subject, only=["directions"]).finding("directions")
    assert found.why == (
        "it could not be seen whether a refused write changes in:9, because the level is not known to be steady"
    )


def test_the_table_has_the_text_of_a_rule_and_the_remark_behind_it() -> None:
    certificate = conform(simulated(), only=["descriptors", "memory"], cycles=500)
    text = " ".join(str(certificate).replace("│", " ").split())
    assert "[5 openings; there is no line" in text
    assert "3 rounds of 166 cycles" in text


def test_what_a_constructor_changes_of_the_process_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_CHANGED", "secret")

    class Changes(Simulated):
        def __init__(self) -> None:
            super().__init__()
            os.environ["UMO_CHANGED"] = "another"

    found = conform(Subject("changes", make=Changes), only=["process"]).finding("process")
    assert found.why == "the driver changed the environment: UMO_CHANGED"


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_driver_that_cannot_be_made_again_is_told_and_ends_the_run() -> None:
    made = []

    class Limited(Simulated):
        def __init__(self) -> None:
            made.append(self)
            if len(made) > 4:
                raise OSError("the library has no more handles")
            super().__init__()

    subject = Subject("limited", make=Limited, inputs=(Input("valve"),))
    certificate = conform(subject, only=["channels", "answers", "reading", "readings"])
    first, *others = [each for each in certificate.findings if each.why]
    assert first.verdict is Judgement.FAILED and "no more handles" in first.why
    why = "making the driver failed: the library has no more handles"
    assert {each.why for each in others} == {f"since the rule {first.rule}: {why}"}


WIRE_DELAY = 0.006
"""Time in s that a level takes through the wire from an output to its input."""


class Wired(Simulated):
    """Outputs, each with a wire to an input `back:NAME`, through which a level takes its time. The device is away
    while `away`; it comes back with all outputs at 0, and the driver then brings those it uses to their defaults."""

    levels: ClassVar[dict[str, deque[tuple[float, int]]]] = {}
    """The last levels of each output, with the times at which they came."""
    away: ClassVar[bool] = False
    losses: ClassVar[int] = 0

    def __init__(self) -> None:
        super().__init__()
        self._defaults: dict[str, int] = {}
        self._seen = self.losses

    @contextmanager
    @staticmethod
    def gone() -> Iterator[None]:
        Wired.away = True
        for level in Wired.levels.values():
            level.append((time.monotonic(), 0))
        try:
            yield
        finally:
            Wired.away, Wired.losses = False, Wired.losses + 1

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.INPUT if text.startswith("back:") else Direction.BOTH, 8)

    def initialize(self, channel: Channel, default: int | None) -> None:
        if default is not None:
            self.write(channel, default)
            self._defaults[channel.text] = default

    def reset(self, channel: Channel, default: int | None) -> None:
        if default is not None:
            self.write(channel, default)

    def write(self, channel: Channel, raw: int) -> None:
        self._connect()
        if Direction.OUTPUT not in channel.direction:
            raise DriverError(f"{channel.text} is an input")
        channel.fit(raw)
        self.levels.setdefault(channel.text, deque(maxlen=100)).append((time.monotonic(), raw))

    def read(self, channel: Channel) -> int:
        self._connect()
        output = channel.text.removeprefix("back:")
        until = time.monotonic() - (0 if output == channel.text else WIRE_DELAY)
        return next((raw for at, raw in reversed(self.levels.get(output, ())) if at <= until), 0)

    read_many, write_many = Driver.read_many, Driver.write_many

    def _connect(self) -> None:
        if self.away:
            raise DriverError("the device is away")
        if self._seen != self.losses:
            self._seen = self.losses
            for text, default in self._defaults.items():
                self.write(self.channel(text), default)


def wired(driver: type[Wired] = Wired) -> Subject:
    """Outputs whose defaults differ from the level that the device comes back with."""
    outputs = tuple(Output(f"out:{number}", 5 * number, 0, 15) for number in range(4))
    return Subject(
        "wired",
        make=driver,
        outputs=outputs,
        inputs=tuple(Input(f"back:{each.channel}", steady=False) for each in outputs),
        loopbacks=tuple((each.channel, f"back:{each.channel}") for each in outputs),
        gone=Wired.gone,
        levels=lambda text: [Wired.levels[text][-1][1]],
        settle=0.2,
    )


def test_wires_that_take_their_time_break_no_rule() -> None:
    certificate = conform(wired(), only=["block read", "block write", "fresh", "long run"], cycles=20)
    assert certificate.passed, str(certificate)
    assert "the level changes slowly" in certificate.finding("long run").why


@pytest.mark.parametrize("wrong", [True, False])
def test_after_the_device_was_away_a_driver_may_bring_outputs_to_their_defaults_alone(wrong: bool) -> None:
    class Restores(Wired):
        def _connect(self) -> None:
            if wrong and self._seen != self.losses and not self.away:
                self._defaults = dict.fromkeys(self._defaults, 7)
            super()._connect()

    found = conform(wired(Restores), only=["levels kept"]).finding("levels kept")
    assert found.verdict is (Judgement.FAILED if wrong else Judgement.PASSED), found.why
    assert not wrong or "to 7 during a read of back:out:0, after the device was away" in found.why


class Answers:
    """A line on which a request is carried out until its answer comes, not sooner."""

    passes = False

    def __init__(self, carried_out: Callable[[], object]) -> None:
        self.carried_out = carried_out

    @contextmanager
    def counting(self, answers: bool = False) -> Iterator[Traffic]:
        yield Traffic()
        if answers:
            self.carried_out()


def test_a_level_that_moves_by_a_request_of_a_look_is_seen_also_if_the_look_does_not_wait_for_it() -> None:
    levels = [0]
    line: Any = Answers(lambda: levels.append(7))
    subject = replace(simulated(), levels=lambda text: levels[-1:], line=line, make=Simulated)
    context = RuleContext(subject)
    witness = Witness(context, context.new(), None)
    with witness.looking():
        context.watch.doing = "look"
    assert witness.seen == "valve went from 0 to 7 during a look"


# Status, causes, time ---------------------------------------------------------------------------------------


def test_a_certificate_without_a_line_says_so_in_its_status() -> None:
    certificate = conform(simulated(), only=["range", "late answer"])
    assert certificate.status == "passed (the line was not tried)"
    assert certificate.passed and not certificate.whole
    assert "simulated: passed (the line was not tried), on memory" in str(certificate)


def test_a_certificate_of_rules_without_a_line_is_whole() -> None:
    certificate = conform(simulated(), only=["range"])
    assert (certificate.status, certificate.whole) == ("passed", True)


def test_one_cause_is_told_once() -> None:
    class Stuck(Simulated):
        read_many = Driver.read_many

        def read(self, channel: Channel) -> int:
            return 7

    valve = Output("valve", 0, 0, 9)
    subject = Subject("stuck", make=Stuck, outputs=(valve,), inputs=(Input("valve"),), settle=0.01)
    certificate = conform(subject, cycles=10)
    assert [each.rule for each in certificate.failed if each.rule not in ("answers", "range")] == []
    why = "valve reads 7 after write(0), not 0"
    assert certificate.finding("range").why.startswith(why)
    assert certificate.finding("block write").why.startswith("as above (range): valve reads 7")


def test_a_device_that_is_not_there_is_told_as_such_and_nothing_else_is_tried() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        host, port = listener.getsockname()
    with TcpTap(host, port) as tap:
        subject = Subject("dead", make=lambda: Careful(port=tap.port), outputs=(Output("out:0"),), line=tap)
        certificate = conform(subject)
    assert certificate.finding("answers").why.startswith(f"the device is missing: {host}:{port}: Connection refused")
    assert certificate.finding("late answer").why == "as above: answers"
    assert [each.rule for each in certificate.failed] == ["answers", "end"]


def test_a_wrong_reading_is_told_as_a_wrong_reading_where_levels_are_recorded() -> None:
    class Misread(Careful):
        def read(self, channel: Any) -> int:
            return super().read(channel) + (channel.text == "in:0")

    with careful(Misread) as subject:
        why = conform(subject, only=["range"]).finding("range").why
    assert why.startswith("in:0 reads 6, but out:0 is at 5, which is right after write(5) (if the device has steps")


def test_the_plan_names_the_rules_that_do_not_fit() -> None:
    now = 0.0
    budget = Budget(120.0, all_rules(), clock=lambda: now)
    plan = budget.plan(CallTime(opening=1.0, transfer=0.2, wait=0.5, channels=3), cycles=None)
    for rule in all_rules():
        now += plan.least[rule.id] if budget.begin(rule) else 0.0
    assert tuple(budget.left_out) == plan.left_out and 0 < len(plan.left_out) < len(all_rules()) - 10
    assert now <= 120.0
    assert "late answer" not in budget.plan(CallTime(1.0, 0.2, 0.5, 3), None, line=False).left_out


@pytest.mark.parametrize("seed", range(20))
def test_what_the_plan_promises_is_tried_whatever_the_rules_save(seed: int) -> None:
    random, now = Random(seed), 0.0
    budget = Budget(random.uniform(20, 900), all_rules(), clock=lambda: now)
    now += random.uniform(0, 15)  # the calls that were measured: a device may start slowly
    pace = CallTime(
        opening=random.uniform(0, 4), transfer=random.uniform(0, 0.3), wait=0.3, channels=3,
        connecting=random.uniform(0, 4), settling=random.choice([0.0, 2.0]),
    )  # fmt: skip
    plan = budget.plan(pace, cycles=None)
    tried = set()
    for rule in all_rules():
        if rule.theme == "general" or budget.begin(rule):
            tried.add(rule.id)
            now += random.uniform(0.2, 1.0) * pace.of(rule.cost)
    assert set(plan.least) - set(plan.left_out) <= tried


@pytest.mark.parametrize("device", [0.001, 0.01])
def test_a_run_ends_within_its_budget_though_every_rule_takes_longer_than_planned(device: float) -> None:
    now = 0.0
    budget = Budget(120.0, all_rules(), clock=lambda: now)
    pace = CallTime(opening=10 * device, transfer=device, wait=0.2, channels=6, connecting=device)
    plan = budget.plan(pace, cycles=None)
    assert not plan.left_out and plan.full > 120.0
    for rule in all_rules():
        if rule.theme == "general" or budget.begin(rule):
            now += 1.05 * pace.of(rule.cost)
            while rule.cost.more and budget.has(device):
                now += device
    assert 110.0 < now <= 120.0


def test_a_rule_may_use_the_time_that_the_rules_after_it_cannot_use() -> None:
    now = openings = 0.0
    budget = Budget(180.0, all_rules(), clock=lambda: now)
    pace = CallTime(opening=0.01, transfer=1e-4, wait=0.2, channels=2, connecting=0.004)
    plan = budget.plan(pace, cycles=None)
    assert 97 * 0.7 < plan.full < 180.0
    for rule in all_rules():
        if rule.theme == "general" or budget.begin(rule):
            now += pace.of(rule.cost)
        while rule.id == "descriptors" and openings < 97 and budget.has(0.7):
            now, openings = now + 0.7, openings + 1
    assert openings == 97 and now <= 180.0


def test_what_was_left_out_is_tried_at_the_end_if_time_remains(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = Budget.begin

    def hesitate(budget: Budget, rule: Rule) -> bool:
        if rule.id == "reset":
            budget.left_out.append(rule.id)
            return False
        found = begin(budget, rule)
        if rule.id == "range":
            budget._until = 0.0
        return found

    monkeypatch.setattr(Budget, "begin", hesitate)
    certificate = conform(simulated(), only=["range", "one beyond", "reset", "end"])
    assert certificate.left_out == ()
    assert [each.rule for each in certificate.findings] == ["range", "one beyond", "reset", "end"]
    assert certificate.finding("reset").verdict is Judgement.PASSED
    assert "levels" not in certificate.finding("range").why


def test_what_passed_in_part_stays_so_if_the_time_is_over_in_its_second_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    right, tries = runner._tried, iter([1, 2])

    def tried(context: RuleContext, rule: Rule, causes: dict[str, str]) -> Finding:
        found = right(context, rule, causes)
        if next(tries) == 1:
            context.budget.parts[rule.id] = "3 of 600 levels"
            return found
        context.budget.left_out.append(rule.id)
        return replace(found, verdict=Judgement.NOT_TRIED)

    monkeypatch.setattr(runner, "_tried", tried)
    certificate = conform(simulated(), only=["range"])
    assert certificate.finding("range").verdict is Judgement.PASSED
    assert certificate.left_out == ("range: 3 of 600 levels",)
    assert next(tries, None) is None


def test_what_was_left_out_is_not_tried_again_if_it_does_not_fit() -> None:
    now = 0.0
    rules = chosen_rules(["range"])
    budget = Budget(100.0, rules, clock=lambda: now)
    plan = budget.plan(CallTime(opening=1.0, transfer=0.01, channels=2), cycles=None)
    assert budget.begin(rules[0]) and not budget.begin_again(rules[0])
    budget.parts["range"] = "3 of 600 levels"
    now = 99.0 - plan.full
    assert not budget.begin_again(rules[0])
    now -= 4.0
    assert budget.begin_again(rules[0]) and not budget.parts


def test_what_measures_memory_leaves_time_for_its_rounds() -> None:
    now = 0.0
    context = RuleContext(simulated(), None, Budget(2.0, all_rules(), clock=lambda: now))

    def call() -> None:
        nonlocal now
        now += 0.01

    assert _grows(context, call, "calls") == "3 rounds of 50 calls"
    assert now < 2.01


def test_a_few_calls_that_each_keep_some_small_objects_are_seen_to_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[object] = []
    monkeypatch.setattr("umo.testing.conformance.leak_rules.CACHE_FILLING_CALLS", 500)
    context = RuleContext(simulated(), 60, Budget(60.0, all_rules()))
    with pytest.raises(
        RuleBroken,
        match=r"the memory grew by \d+ objects and at least \d+ bytes in each round of 20 "
        r"calls",
    ):
        _grows(context, lambda: kept.extend(object() for _ in range(3)), "calls")


def test_a_call_that_fails_names_the_one_that_failed_before_it() -> None:
    context = RuleContext(simulated())

    def fail(text: str) -> None:
        raise DriverError(text)

    assert context.failure(context.watch.call, "read of a", 1.0, fail, "refused") is not None
    error = context.failure(context.watch.call, "read of b", 1.0, fail, "busy")
    assert error is not None
    assert failed(error) == "read of b failed, right after a read of a that failed: busy"


def test_placeholders_take_what_became_free_and_no_more() -> None:
    held = Placeholders()
    first, second = (os.open(os.devnull, os.O_RDONLY) for _ in range(2))
    for _ in range(20):
        held.look("read")
    before = len(os.listdir("/proc/self/fd"))
    os.close(first)
    held.look("close")
    assert len(os.listdir("/proc/self/fd")) == before
    os.close(first)
    held.look("close again")
    held.release()
    os.close(second)
    assert held.closed_by == "close again"


def test_one_refusal_of_several_channels_is_one_cause() -> None:
    context = RuleContext(replace(simulated(), refused=("valve:40",)))
    causes = {runner._failure(context, DriverError(f"{text}: status 3"), ())[0] for text in ("valve", "valve:40")}
    assert causes == {" failed: a channel: status #"}


class StartsWithEachConnection(Careful):
    """The device needs 300 ms after each connection."""

    def connect(self) -> None:
        before = self.connection
        super().connect()
        if self.connection is not before:
            time.sleep(min(0.3, self.left()))


@pytest.mark.full
@pytest.mark.parametrize("minutes", [0.3, 0.6])
def test_a_slow_start_leaves_out_no_rule_that_was_promised(minutes: float) -> None:
    plans: list[TimePlan] = []
    with careful(StartsWithEachConnection, timeout=0.5) as subject:
        certificate = conform(subject, minutes=minutes, plan=plans.append)
    promised = set(plans[0].least) - set(plans[0].left_out)
    assert not [each.rule for each in certificate.findings if each.rule in promised and "time was over" in each.why]
    assert certificate.passed, str(certificate)


def test_what_does_not_fit_into_the_time_is_left_out_and_named() -> None:
    plans: list[TimePlan] = []

    class Slow(Simulated):
        def write(self, channel: Channel, raw: int) -> None:
            time.sleep(0.02)
            super().write(channel, raw)

    subject = Subject("slow", make=Slow, outputs=(Output("valve", 0, 0, 4095),), inputs=(Input("valve"),))
    certificate = conform(subject, minutes=0.03, plan=plans.append)
    assert plans[0].full > 60 and plans[0].left_out
    assert ", ".join(plans[0].left_out) in str(plans[0])
    assert certificate.finding("range").verdict is Judgement.NOT_TRIED or any(
        "levels" in each for each in certificate.left_out
    )
    assert certificate.finding("memory").why == "left out, because the time was over (`minutes`, --for)"
    assert "the rule memory" in certificate.left_out
    assert "the rule end" not in certificate.left_out and certificate.finding("end").verdict is Judgement.PASSED
    assert certificate.passed and certificate.status.endswith("(the line was not tried, cut short)")


def test_a_rule_that_takes_much_longer_than_planned_is_cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Budget, "latest", 0.0)
    with careful() as subject:
        certificate = conform(subject, only=["range", "late answer", "end"])
        assert subject.levels is not None
        assert [subject.levels(output.channel)[-1] for output in subject.outputs] == [5, 0, 0]
    assert [each.verdict for each in certificate.findings] == [Judgement.NOT_TRIED] * 2 + [Judgement.PASSED]
    assert certificate.left_out[:2] == ("the rule range", "the rule late answer")


def test_without_a_steady_input_it_is_not_said_that_answers_have_no_number() -> None:
    moving = (Input("in:8", steady=False),)
    with careful(inputs=moving, outputs=(), loopbacks=(), refused=(), levels=None) as subject:
        why = conform(subject, only=["old answer"]).finding("old answer").why
    assert why.startswith("it could not be seen whether answers to reads carry a number") and "--steady" in why


def test_an_old_answer_is_told_of_a_driver_that_connects_for_each_call() -> None:
    class Connects(Careful):
        def exchange(self, *arguments: Any) -> list[tuple[int, int]]:
            try:
                return super().exchange(*arguments)
            finally:
                self.drop()

    with careful(Connects) as subject:
        found = conform(subject, only=["old answer"]).finding("old answer")
    assert found.verdict is Judgement.PASSED, found


def test_a_refused_input_says_nothing_about_writes() -> None:
    with careful(refused=("in:40",)) as subject:
        certificate = conform(subject, only=["block failures", "error answer"])
    assert certificate.passed
    assert "writes: no channel of this direction" in certificate.finding("block failures").why
    assert "the kit knows no writes that the device refuses" in certificate.finding("error answer").why


def test_the_requests_of_a_driver_that_sends_by_itself_are_not_counted() -> None:
    class Beats(Careful):
        def open(self) -> None:
            super().open()
            self.end = threading.Event()
            self.beat = threading.Thread(target=self.work, daemon=True)
            self.beat.start()

        def work(self) -> None:  # the device closes the connection when the test is over
            with suppress(ConnectionError), socket.create_connection((self.host, self.port)) as connection:
                while not self.end.wait(0.002):
                    connection.sendall(frame(1, READ, [(40, 0)]))
                    connection.recv(100)

        def close(self) -> None:
            if self.is_open:
                self.end.set()
                self.beat.join()
            super().close()

    with careful(Beats) as subject:
        found = conform(subject, only=["retry"]).finding("retry")
    assert (found.verdict, found.why) == (Judgement.NOT_TRIED, "the driver sends requests by itself")


# Words and causes -------------------------------------------------------------------------------------------


def test_a_connection_that_is_not_made_again_is_one_cause_of_one_rule() -> None:
    class Once(Careful):
        lost = False

        def drop(self) -> None:
            self.lost = self.lost or self.connection is not None
            super().drop()

        def connect(self) -> None:
            if self.lost:
                raise OSError("the connection was lost")
            super().connect()

        def open(self) -> None:
            self.lost = False
            super().open()

    with careful(Once) as subject:
        rules = [
            "late answer",
            "old answer",
            "retry",
            "reset after failure",
            "vanish",
            "look",
            "levels kept",
            "process",
        ]
        certificate = conform(subject, only=rules, cycles=10)
    first, *others = certificate.findings
    assert [each.rule for each in certificate.failed] == [first.rule], str(certificate)
    assert all(each.why.startswith(f"as above ({first.rule}): ") for each in others)


def test_a_certificate_that_a_test_shows_begins_with_the_reason() -> None:
    class Misread(Careful):
        def read(self, channel: Any) -> int:
            return super().read(channel) + (channel.text == "in:0")

    with careful(Misread) as subject:
        shown = repr(conform(subject, only=["range", "reading"]))
    assert shown.startswith("range: in:0 reads 6, but out:0 is at 5, which is right after write(5)")


UNSEEN = {
    "before open": "it could not be seen whether the driver connects before open",
    "vanish": "every call succeeded, but no level can be seen",
    "initialise": "it could not be seen whether the other outputs stay: there is no record of levels",
    "two clients": "there is only one output, so no other output was written",
    "end": "it could not be seen whether closing moves an output: this needs a line and a record of levels",
    "descriptors": "3 openings; there is no line, so no connections were lost and no answers were spoiled",
    "kind of errors": "no call can be made to fail: there is no line between driver and device",
    "idle": "not while the device is silent: there is no line",
    "watchdog": "the time of the watchdog is not known",
}


@pytest.mark.parametrize("rule", UNSEEN)
def test_a_rule_says_what_it_did_not_look_at(rule: str) -> None:
    outputs = (Output("io:0", 0, -2048, 2047), *([Output("io:1", 0, -2048, 2047)] if rule == "initialise" else []))
    missing: dict[str, Any] = {"outputs": outputs, "loopbacks": (), "refused": (), "levels": None}
    if rule == "vanish":
        missing["outputs"] = (Output("out:0"),)
    else:
        missing |= {"line": None}
    with careful(**missing) as subject:
        found = conform(replace(subject, watchdog=0.0), only=[rule], cycles=10).finding(rule)
    assert found.verdict is not Judgement.FAILED
    assert UNSEEN[rule] in found.why


# What the subject says of its levels, and what was disturbed -------------------------------------------------


def test_a_record_that_gives_no_level_is_told_as_a_fault_of_the_subject() -> None:
    with careful(levels=lambda text: []) as subject:
        certificate = conform(subject, only=["answers", "range", "levels kept"], cycles=10)
    assert certificate.finding("answers").why.startswith("`levels` of the subject gave no level of out:0; the first is")
    assert certificate.finding("levels kept").why.startswith("as above (answers): `levels` of the subject")


def test_a_record_that_does_not_begin_with_the_level_at_its_last_call_is_told_as_such() -> None:
    with careful() as subject:
        record = subject.levels
        assert record is not None
        found = conform(replace(subject, levels=lambda text: list(record(text))[1:] or [0]), only=["answers"])
    assert "the first must be the level at the last call of this function" in found.finding("answers").why


def test_a_call_that_fails_names_what_was_disturbed_just_before() -> None:
    with careful() as subject:
        context = RuleContext(subject)
        with context.opened() as probe:
            probe.timeout = context.haste
            while not context.line.disturbed:  # on a busy computer the call may end before its answer is lost
                context.unanswered(probe.read, "in:8")
            probe.driver.connect = lambda: [][0]
            error = context.failure(probe.read, "in:8")
            assert error is not None and failed(error).startswith("read of in:8 failed, right after a lost answer: ")
            del probe.driver.connect
            probe.read("in:8")
            error = context.failure(probe.read, "in:40")
            assert error is not None and failed(error).startswith("read of in:40 failed: ")


def test_what_a_failing_call_leaves_in_the_kit_does_not_count_as_memory_of_the_driver() -> None:
    class AnotherError(Careful):
        def check(self, channels: Any, answer: Any) -> None:
            if any(status for status, _ in answer):
                raise KeyError("refused")

    with careful(AnotherError) as subject:
        found = conform(subject, only=["memory"], cycles=60).finding("memory")
    assert found.verdict is Judgement.PASSED, found


class DisarmsItself(Device):
    """Its watchdog is disarmed once it has let go."""

    def _let_go(self) -> None:
        heard = self._heard
        super()._let_go()
        if heard != self._heard:
            self._watchdog = float("inf")


def test_a_watchdog_that_is_disarmed_once_it_has_let_go_is_armed_again_by_the_kit() -> None:
    with (
        careful() as subject,
        DisarmsItself(watchdog=float("inf"), defaults={0: 5}) as device,
        TcpTap(device.host, device.port) as tap,
    ):
        latched = replace(
            subject, line=tap, levels=device.levels, make=lambda: Careful(port=tap.port),
            direct=lambda: Careful(host=device.host, port=device.port),
        )  # fmt: skip
        found = conform(latched, only=["watchdog"]).finding("watchdog")
    assert found.verdict is Judgement.PASSED, found


def test_a_driver_that_umo_takes_off_the_cycle_only_is_wired_so() -> None:
    class Slow(Careful):
        only_off_cycle = True

    with careful(Slow) as subject:
        found = conform(subject, only=["errors are named"]).finding("errors are named")
    assert found.verdict is Judgement.NOT_TRIED
    assert found.why.startswith("umo uses this driver only off the cycle")
