"""Rules of what a driver may leave out: the scale of a channel, ages, a report, the watchdog of its circuit."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, isnan
from time import monotonic, sleep
from typing import Any

from umo.drivers.contract import Driver, PhysicalScale
from umo.errors import DeclarationError, text_of
from umo.objects.units import check_unit, convert, line_between
from umo.presentation.digits import number_text
from umo.presentation.durations import duration
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.subject import Output
from umo.text import some

SCALE_SHARE = 0.05
"""Share of an output's range by which the two ends of a loop-back may differ."""
AGE_TOLERANCE = 0.02
"""Time in s by which an age may be wrong: the calls around it take their time."""
AGE_INTERVAL = 0.01
"""Time in s until it is read once more."""
AGE_LOOKS = 5
"""How many times `settle` is waited for the old level at most: a driver may keep its readings for longer than that."""
AGE_WAITS = (0.0, 0.05, 0.15, 0.0, 0.1)
"""Times in s after which a level that has come is read."""
UNFED = 1.5
"""Times of the watchdog after which it has run out."""
TOO_LONG = 1e9
"""Time in s that no watchdog has: 31 years."""
FEEDS = 6
"""Requests within the time of a watchdog that is not to run out."""


@rule(Cost(each=1, calls=10, sleeps=1))
def physical_scale(context: RuleContext) -> str:
    """The scale that a driver gives for a channel is one: a resolution that is not 0, a known unit; the same before and
    after `open`. Both ends of a loop-back are the same value by it."""
    given = {text: _scale(context.new(), text) for text in context.channels}
    with context.opened() as probe:
        for text, before in given.items():
            given[text] = now = _scale(probe, text)
            if before is not None and now not in (None, before):
                raise RuleBroken(f"physical_scale of {text} is {_words(before)} before open and {_words(now)} after it")
        if not any(given.values()):
            raise NotTried("the driver gives no scale")
        compared = [each for each in context.viewed if _compared(context, probe, each, given)]
    alone = [text for text, scale in given.items() if scale and text not in _ends(context, compared)]
    return f"nothing to compare the scale of {some(alone)} with" if alone else ""


def _scale(probe: Probe, text: str) -> PhysicalScale | None:
    """RuleBroken for what is no scale."""
    try:
        scale = probe.call(f"physical_scale of {text}", probe.driver.physical_scale, probe.channel(text))
    except OSError as error:
        raise RuleBroken(f"physical_scale of {text} raised {text_of(error)}: None says that it is unknown") from error
    if scale is None:
        return None
    if not isinstance(scale, PhysicalScale):
        raise RuleBroken(f"physical_scale of {text} returned {scale!r}, not a PhysicalScale")
    try:
        usable = isfinite(scale.resolution) and isfinite(scale.zero_offset) and scale.resolution != 0
        check_unit(scale.units)
    except (TypeError, DeclarationError) as error:
        raise RuleBroken(f"physical_scale of {text} is {_words(scale)}: {text_of(error)}") from error
    if not usable:
        raise RuleBroken(f"physical_scale of {text} is {_words(scale)}: every level has the same value")
    return scale


def _words(scale: PhysicalScale | None) -> str:
    return "None" if scale is None else f"{scale.resolution} {scale.units}, zero_offset {scale.zero_offset}"


def _ends(context: RuleContext, outputs: list[Output]) -> set[str]:
    return {text for each in outputs for text in (each.channel, context.view(each))}


def _compared(context: RuleContext, probe: Probe, output: Output, given: Mapping[str, PhysicalScale | None]) -> bool:
    """Whether the two ends of a loop-back could be compared; RuleBroken if their values differ."""
    one, other = given.get(output.channel), given.get(context.view(output))
    if context.view(output) == output.channel or one is None or other is None:
        return False
    if line_between(other.units, one.units) is None:
        return False
    rounding = abs(one.resolution) + abs(convert(other.resolution, other.units, one.units)
                                         - convert(0.0, other.units, one.units))  # fmt: skip
    allowed = max(rounding, SCALE_SHARE * abs(one.resolution) * (output.greatest - output.least))
    for raw in (output.least, output.greatest, *output.inner):
        probe.write(output.channel, raw)
        if not context.is_read(probe, output, raw):
            return False
        value = raw * one.resolution + one.zero_offset
        back = convert(context.last_level * other.resolution + other.zero_offset, other.units, one.units)
        if abs(back - value) > allowed:
            of = f"{output.channel} is at {number_text(value)} {one.units} by its physical_scale"
            raise RuleBroken(f"{of}, {context.view(output)}, which reads it, at {number_text(back)}")
    return True


@rule(Cost(each=1, calls=34, sleeps=0.5))
def ages(context: RuleContext) -> str | None:
    """The age of a reading is no less than the time since the level has changed, if it is an old level, and no more, if
    it is the new one. There is one for each channel of the block."""
    texts = context.readable
    if not texts:
        raise NotTried("the driver has no inputs")
    with context.opened() as probe:
        probe.read_many(texts)
        if _ages(probe, texts) is None:
            raise NotTried("the driver gives no ages: its readings are as old as the transfer")
        if not context.viewed:
            return "no output moves an input: it was only seen that there is an age for each channel"
        for output in context.viewed:
            for number, pause in enumerate(AGE_WAITS):
                _moves(context, probe, output, number, pause)
    still = [text for text in texts if text not in _ends(context, list(context.viewed))]
    return f"{some(still)}: only that there is an age" if still else None


def _ages(probe: Probe, texts: tuple[str, ...]) -> list[float] | None:
    """RuleBroken for what are no ages."""
    given = probe.call("ages", probe.driver.ages, tuple(map(probe.channel, texts)))
    if given is None:
        return None
    found = list(given)
    if len(found) != len(texts):
        raise RuleBroken(f"ages gave {len(found)} ages for a block of {len(texts)} channels")
    for text, age in zip(texts, found, strict=True):
        if isnan(age) or age < 0:
            raise RuleBroken(f"ages gave {age} s for {text}")
    return found


def _moves(context: RuleContext, probe: Probe, output: Output, number: int, pause: float) -> None:
    """A level changes between two times, and is read after a pause."""
    texts = context.readable
    old, new = (output.other(), output.default) if number % 2 else (output.default, output.other())
    probe.write(output.channel, old)
    any(context.is_read(probe, output, old) for _ in range(AGE_LOOKS))
    probe.read_many(texts)
    began = monotonic()
    probe.write(output.channel, new)
    context.arrive(None, output, new)
    came = monotonic()
    for wait in (pause, AGE_INTERVAL):
        sleep(wait)
        _check_age(context, probe, output, (old, new), (began, came))


def _check_age(
    context: RuleContext, probe: Probe, output: Output, levels: tuple[int, int], times: tuple[float, float]
) -> None:
    """A level is read that has changed between these times."""
    (old, new), (began, came), texts = levels, times, context.readable
    view = context.view(output)
    found = dict(zip(texts, probe.read_many(texts), strict=True))[view]
    least = monotonic() - came - context.watch.took - AGE_TOLERANCE
    age = dict(zip(texts, _ages(probe, texts) or (), strict=True))[view]
    most = monotonic() - began + AGE_TOLERANCE
    if context.same(output, new, found) and age > most:
        raise RuleBroken(f"{view} read {found} with an age of {_time(age)}; it has been so for {_time(most)} at most")
    if context.alike(view, old, found) and not context.same(output, new, found) and age < least:
        raise RuleBroken(f"{view} read {found} with an age of {_time(age)}; it has been {new} for {_time(least)}")


def _time(seconds: float) -> str:
    return duration(round(seconds, 3)) if isfinite(seconds) else f"{seconds} s"


@rule(Cost(each=2, calls=2))
def report(context: RuleContext) -> str | None:
    """What a driver reports (`report`, and `inspect` of an input) is plain data by name, a line of text; to ask for it
    moves no output."""
    kind = type(context.new().driver)
    if kind.report is Driver.report and kind.inspect is Driver.inspect:
        raise NotTried("the driver reports nothing")
    with context.opened() as probe:
        for number, output in enumerate(context.subject.outputs):
            probe.write(output.channel, output.other(number))
        _check_report(probe)
        for text in context.readable:
            said = probe.call(f"inspect of {text}", probe.driver.inspect, probe.channel(text))
            if not isinstance(said, str) or "\n" in said:
                raise RuleBroken(f"inspect of {text} returned {said!r}, not a line of text")
        for output in context.visible:
            place = context.subject.outputs.index(output)
            context.expect(probe, output, output.other(place), "report")
    return context.remark() if context.subject.outputs else None


def _check_report(probe: Probe) -> None:
    try:
        found = probe.call("report", probe.driver.report)
    except OSError as error:
        raise RuleBroken(f"report raised {text_of(error)}") from error
    if not isinstance(found, Mapping):
        raise RuleBroken(f"report returned a {type(found).__name__}, not a dict by name")
    if odd := next((f"{key!r}: {value!r}" for key, value in found.items() if not _is_plain({key: value})), ""):
        raise RuleBroken(f"report returned {odd}, which is not plain data (numbers, texts, lists and dicts of them)")


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(isinstance(key, str | int) and _is_plain(each) for key, each in value.items())
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, str | bool | int | float) or hasattr(value, "dtype")


@rule(Cost(each=1, calls=1, watchdogs=7))
def watchdog(context: RuleContext) -> str | None:
    """Armed with a time, the watchdog of the circuit lets go of the outputs after that time without a request, and not
    before; each call of `watchdog` sets the time anew. `check_watchdog` refuses what the circuit cannot take."""
    seconds = context.subject.watchdog
    if type(context.new().driver).watchdog is Driver.watchdog:
        raise NotTried("the driver has no watchdog of its circuit")
    context.required_outputs  # noqa: B018  NotTried
    if not seconds:
        raise NotTried("nothing says with which time to arm it (`watchdog` of the subject, or of the wiring)")
    long = 2 * UNFED * seconds
    with context.opened() as probe:
        try:
            _check_limits(context, probe)
            longer = _arm(probe, long) is None
            if longer:
                _drive(context, probe)
                sleep(UNFED * seconds)
                silence = f"after {duration(UNFED * seconds)} of silence"
                _check_held(context, probe, f"armed with {duration(long)}, {silence}")
            _drive(context, probe)
            if (error := _arm(probe, seconds)) is not None:
                raise RuleBroken(f"the watchdog does not take {duration(seconds)}: {text_of(error)}") from error
            _check_held(context, probe, f"while it was armed with {duration(seconds)}")
            _feed(context, probe, seconds)
            _check_let_go(context, probe, seconds)
        finally:
            _arm(probe, 0.0)
    return context.remark(*(() if longer else (f"it does not take {duration(long)}, so it was armed once",)))


def _arm(probe: Probe, seconds: float) -> OSError | None:
    """The error, if the watchdog does not take this time."""
    try:
        probe.call("check_watchdog", probe.driver.check_watchdog, seconds)
        probe.call(f"watchdog({seconds:g})", probe.driver.watchdog, seconds)
    except OSError as error:
        return error
    return None


def _check_limits(context: RuleContext, probe: Probe) -> None:
    """A time that is taken can be armed: without a limit it would wrap in the circuit."""
    refusal = context.failure(probe.call, "check_watchdog", probe.driver.check_watchdog, TOO_LONG)
    if refusal is None and (error := _arm(probe, TOO_LONG)) is not None:
        raise RuleBroken(f"check_watchdog takes {TOO_LONG:g} s, and then {context.watch.doing} fails: {text_of(error)}")


def _drive(context: RuleContext, probe: Probe) -> None:
    probe.write_many([each.channel for each in context.subject.outputs],
                     [each.other() for each in context.subject.outputs])  # fmt: skip


def _feed(context: RuleContext, probe: Probe, seconds: float) -> None:
    """Requests come in time: the outputs stay."""
    for _ in range(2 * FEEDS):
        _drive(context, probe)
        if context.readable:
            probe.read_many(context.readable)
        sleep(seconds / FEEDS)
    _check_held(context, probe, f"armed with {duration(seconds)}, with a request every {duration(seconds / FEEDS)}")


def _check_held(context: RuleContext, probe: Probe, when: str) -> None:
    for output in context.required_outputs:
        if not context.same(output, output.other(), context.level(probe, output)):
            raise RuleBroken(f"the watchdog has let go of {output.channel}, {when}")


def _check_let_go(context: RuleContext, probe: Probe, seconds: float) -> None:
    """Nothing is asked for long enough. It is the circuit's own choice which outputs it lets go of, and to what."""
    outputs = context.required_outputs
    _drive(context, probe)
    with context.counted() as traffic:
        sleep(UNFED * seconds)
    if traffic.asked:
        raise NotTried("the driver sends requests by itself while nothing is called, so the watchdog does not run out")
    if all(context.same(each, each.other(), context.level(probe, each)) for each in outputs):
        at = some([f"{each.channel} at {each.other()}" for each in outputs])
        raise RuleBroken(f"armed with {duration(seconds)}, still {at} after {duration(UNFED * seconds)} of silence")
