"""Rules about the optional functions of a driver: the scale of a channel, ages, a report, the watchdog of its
circuit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import isfinite, isnan
from time import monotonic, sleep
from typing import Any

import numpy as np

from umo.digits import number_text
from umo.drivers.optional import (
    HasWatchdog,
    Inspects,
    PhysicalScale,
    Reports,
    ages_of,
    inspection_of,
    report_of,
    scale_of,
)
from umo.duration import duration
from umo.errors import DeclarationError, text_of
from umo.objects.units import check_unit, convert, line_between
from umo.testing.conformance.probe import Probe, WrongKind
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import MADE_UP, WRITTEN_MANY, Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import device_sends_by_itself
from umo.testing.conformance.subject import Output
from umo.testing.conformance.timing_rules import clock_set_back
from umo.text import some

SCALE_SHARE = 0.05
"""Share of an output's range by which the two ends of a loop-back may differ."""
AGE_TOLERANCE = 0.02
"""Time in s by which an age may be wrong, because the calls around it take time."""
AGE_INTERVAL = 0.005
"""Time in s until the age is read again."""
AGE_LOOKS = 5
"""Largest number of `settle` times that the rule waits for the old level. A driver may keep its readings for longer
than `settle`."""
AGE_WAITS = (0.0, 0.05, 0.15, 0.0, 0.1)
"""Times in s after which a level that has arrived is read."""
PAIR_WAITS = (0.0, 0.0, 0.0)
"""Times in s after which a level of a pair of channels is read."""
MAX_AGE_PAIRS = 3
"""Largest number of pairs of channels whose ages are checked with each output."""
CLOCK_STEP = 3600.0
"""Time in s by which the wall clock is set back and forward."""
WATCHDOG_EXPIRY = 1.5
"""Number of watchdog times after which the watchdog has certainly run out."""
NO_TIMES = (1e9, -1.0)
"""Times in s that no watchdog supports: 31 years, and a time in the past."""
SILENCES = (0.04, 0.1)
"""Times in s for which no data come from the device. Readings during this time get older. A driver may return its last
values only for a short silence."""
REPORTS = 3
"""Number of times that a report is requested twice in succession."""
WATCHDOG_REQUESTS = 6
"""Number of requests within the time of a watchdog that must not run out."""


@rule(Cost(each=5, calls=10, sleeps=1))
def physical_scale(context: RuleContext) -> str:
    """The scale that a driver returns for a channel is valid: the resolution is not 0, the unit is known, and the scale
    is the same before and after `open`, and at any level. With their scales both ends of a loop-back have the same
    value."""
    given = {text: _scale(context.new(), text) for text in context.channels}
    with context.opened() as probe:
        for text, before in given.items():
            given[text] = now = _scale(probe, text)
            if before is not None and now not in (None, before):
                raise RuleBroken(
                    f"physical_scale of {text} is {_words(before)} before open, and {_words(now)} after open"
                )
        if not any(given.values()):
            raise NotTried("the driver gives no scale")
        _same_at_each_level(context, probe, given)
        compared = [each for each in context.viewed if _compared(context, probe, each, given)]
    alone = [text for text, scale in given.items() if scale and text not in _ends(context, compared)]
    return f"there is nothing with which the scale of {some(alone)} can be compared" if alone else ""


def _same_at_each_level(context: RuleContext, probe: Probe, given: Mapping[str, PhysicalScale | None]) -> None:
    for end in ("least", "greatest"):
        for output in context.subject.outputs:
            probe.write(output.channel, getattr(output, end))
        for text, scale in given.items():
            if (now := _scale(probe, text)) != scale:
                at = f"with the outputs at their {end} levels"
                raise RuleBroken(f"physical_scale of {text} is {_words(scale)}, and {_words(now)} {at}")


def _scale(probe: Probe, text: str) -> PhysicalScale | None:
    """Return the scale of a channel. Raises RuleBroken if it is not a valid scale."""
    try:
        scale = probe.call(f"physical_scale of {text}", scale_of, probe.driver, probe.channel(text))
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
    """Return True if the two ends of a loop-back could be compared. Raises RuleBroken if their values differ."""
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


@rule(Cost(each=1, calls=77, waits=1, sleeps=1.6))
def ages(context: RuleContext) -> str | None:
    """The age of a reading that still has an old level is at least the time since the level has changed. The age of a
    reading with the new level is at most that time. While no data arrive from the device, the age is at least the time
    of this silence. There is one age for each channel of the block. No age depends on the wall clock."""
    texts = context.readable
    if not texts:
        raise NotTried("the driver has no inputs")
    with context.opened() as probe:
        probe.read_many(texts)
        if _ages(probe, texts) is None:
            raise NotTried("the driver gives no ages, so its readings have the age of the transfer")
        if context.subject.line is not None:
            _grow_in_silence(context, probe, texts)
        _clock_is_set(probe, texts)
        if not context.viewed:
            return "no output moves an input, so it could not be seen whether the age of a level is right"
        speaks = context.subject.line is not None and device_sends_by_itself(context)
        for output in context.viewed:
            for block, waits in _age_blocks(context.view(output), texts):
                for number, pause in enumerate(waits):
                    _moves(context, probe, output, block, (number, pause), speaks)
    still = [text for text in texts if text not in _ends(context, list(context.viewed))]
    return f"{some(still)}: the kit checked only that there is an age" if still else None


def _grow_in_silence(context: RuleContext, probe: Probe, texts: tuple[str, ...]) -> None:
    """Check that a driver returns only earlier values while nothing comes from its device."""
    for silence in SILENCES:
        probe.read_many(texts)
        with context.line.silent(), context.in_haste(probe):
            began = monotonic()
            sleep(silence)
            if context.failure(probe.read_many, texts) is None:
                least = monotonic() - began - AGE_TOLERANCE
                for text, age in zip(texts, _ages(probe, texts) or (), strict=True):
                    if age < least:
                        why = f"the device has sent nothing for {_time(least + AGE_TOLERANCE)}"
                        raise RuleBroken(f"{text} was read with an age of {_time(age)}; {why}")
        context.insist(probe.read_many, texts)


def _clock_is_set(probe: Probe, texts: tuple[str, ...]) -> None:
    """Set the wall clock (`time.time`) back, and forward, between a reading and the request for its age. A driver that
    does not return ages below 0 shows the fault only when the clock is set forward."""
    for seconds, where in ((CLOCK_STEP, "back"), (-CLOCK_STEP, "forward")):
        probe.read_many(texts)
        right = _ages(probe, texts) or []
        set_by = f"the clock of the day was set {where} by {duration(CLOCK_STEP)} meanwhile"
        try:
            with clock_set_back(lambda: seconds):  # noqa: B023
                found = _ages(probe, texts) or []
        except RuleBroken as broken:
            raise RuleBroken(f"{broken}; {set_by}") from broken
        for text, age, now in zip(texts, right, found, strict=True):
            if abs(now - age) > CLOCK_STEP / 2:
                raise RuleBroken(f"the age of {text} went from {_time(age)} to {_time(now)}; {set_by}")


def _ages(probe: Probe, texts: tuple[str, ...]) -> list[float] | None:
    """Return the ages of the last reading. Raises RuleBroken if they are not valid."""
    given = probe.call("ages", ages_of, probe.driver, tuple(map(probe.channel, texts)))
    if given is None:
        return None
    found = list(given)
    if len(found) != len(texts):
        raise RuleBroken(f"ages gave {len(found)} ages for a block of {len(texts)} channels")
    for text, age in zip(texts, found, strict=True):
        if isnan(age) or age < 0:
            raise RuleBroken(f"ages gave {age} s for {text}")
    return found


def _age_blocks(view: str, texts: tuple[str, ...]) -> list[tuple[tuple[str, ...], tuple[float, ...]]]:
    """Return the blocks to read: all channels, and pairs with this channel. Each block has the times in s after which
    it is read."""
    pairs = [(view, text) for text in texts if text != view]
    return [(texts, AGE_WAITS), *((pair, PAIR_WAITS) for pair in pairs[:MAX_AGE_PAIRS])]


def _moves(
    context: RuleContext, probe: Probe, output: Output, texts: tuple[str, ...], turn: tuple[int, float], speaks: bool
) -> None:
    """Change a level, read it in a block after pauses, and check its age. `speaks`: True if the device sends by
    itself."""
    number, pause = turn
    old, new = (output.other(), output.default) if number % 2 else (output.default, output.other())
    probe.write(output.channel, old)
    any(context.is_read(probe, output, old) for _ in range(AGE_LOOKS))
    before = monotonic()
    probe.read_many(texts)
    sleep(1.5 * AGE_TOLERANCE)  # what is kept of it is too old for the new level
    began = monotonic()
    probe.write(output.channel, new)
    context.arrive(None, output, new)
    came = monotonic()
    # when a value has come, and the one before it, a driver may know no better than since which reading
    last = before if speaks else began
    for wait, since in ((pause, before), (AGE_INTERVAL, before), (AGE_INTERVAL, last)):
        sleep(wait)
        _check_age(context, probe, output, texts, (old, new), (since, came))


def _check_age(
    context: RuleContext,
    probe: Probe,
    output: Output,
    texts: tuple[str, ...],
    levels: tuple[int, int],
    times: tuple[float, float],
) -> None:
    """Read a level that has changed between these two times, and check its age."""
    (old, new), (began, came) = levels, times
    view = context.view(output)
    found = dict(zip(texts, probe.read_many(texts), strict=True))[view]
    least = monotonic() - came - context.watch.took - AGE_TOLERANCE
    age = dict(zip(texts, _ages(probe, texts) or (), strict=True))[view]
    most = monotonic() - began + AGE_TOLERANCE
    if context.same(output, new, found) and age > most:
        raise RuleBroken(
            f"{view} read {found} with an age of {_time(age)}; it has had this level for at most {_time(most)}"
        )
    if context.alike(view, old, found) and not context.same(output, new, found) and age < least:
        raise RuleBroken(
            f"{view} read {found} with an age of {_time(age)}, but the level has been {new} for {_time(least)}"
        )


def _time(seconds: float) -> str:
    return duration(round(seconds, 3)) if isfinite(seconds) else f"{seconds} s"


@rule(Cost(each=4, calls=24, connects=2, waits=3))
def report(context: RuleContext) -> str | None:
    """The result of `report` is plain data by name; the result of `inspect` for an input is a line of text. The two
    calls change no reading and no output, not even for a short time, and raise nothing except an OSError if the device
    is away. A later report still has the entries of the earlier one, even after the device was away."""
    if not isinstance(context.new().driver, Reports | Inspects):
        raise NotTried("the driver reports nothing")
    with context.opened() as probe:
        for number, output in enumerate(context.subject.outputs):
            probe.write(output.channel, output.other(number))
        goals = {
            each: each.other(place) for place, each in enumerate(context.subject.outputs) if each in context.visible
        }
        with context.straight(goals, "report or inspect"):
            _check_report(probe)
            for text in context.readable:
                said = probe.call(f"inspect of {text}", inspection_of, probe.driver, probe.channel(text))
                if not isinstance(said, str) or "\n" in said:
                    raise RuleBroken(f"inspect of {text} returned {said!r}, not a line of text")
        for output, raw in goals.items():
            context.expect(probe, output, raw, "report")
        _reports_again(context, probe)
        _reports_of_now(context, probe)
        _inspects_aside(context, probe)
        _reports_while_away(context, probe)
    return context.remark() if context.subject.outputs else None


def _reports_again(context: RuleContext, probe: Probe) -> None:
    """Check that a report does not lose entries because it was requested. An entry may become zero by itself now and
    then."""
    driver, gone = probe.driver, None
    if not isinstance(driver, Reports):
        return
    for _ in range(REPORTS):
        context.use(probe)
        first, second = (dict(probe.call("report", driver.report)) for _ in range(2))
        now = {name for name, value in first.items() if _holds(value) and not _holds(second.get(name))}
        gone = now if gone is None else gone & now
    if gone:
        lost = some(sorted(map(repr, gone)))
        raise RuleBroken(
            f"report has lost {lost} when it is called again immediately, in {REPORTS} of {REPORTS} attempts"
        )


def _reports_of_now(context: RuleContext, probe: Probe) -> None:
    """Check that a report is up to date after the outputs were moved."""
    driver, late = probe.driver, None
    if not isinstance(driver, Reports):
        return
    for turn in range(REPORTS):
        before = probe.call("report", driver.report)
        levels = {each: each.default if turn % 2 else each.other() for each in context.subject.outputs}
        for output, raw in levels.items():
            probe.write(output.channel, raw)
            if output in context.viewed:
                context.is_read(probe, output, raw)
        first, second = (dict(probe.call("report", driver.report)) for _ in range(2))
        now = {name for name, was in before.items() if _is(first.get(name), was) and not _is(second.get(name), was)}
        late = now if late is None else late & now
    if late:
        names = some(sorted(map(repr, late)))
        raise RuleBroken(
            f"the first report after a movement of the outputs gives the old values of {names}, and the "
            f"second report the new values"
        )


def _is(one: Any, other: Any) -> bool:
    return bool(np.array_equal(np.asarray(one, object), np.asarray(other, object)))


def _holds(value: Any) -> bool:
    """Return True if the value contains anything other than zeros."""
    if isinstance(value, Mapping):
        return any(map(_holds, value.values()))
    return any(map(_holds, value)) if isinstance(value, list | tuple) else bool(np.any(value))


def _inspects_aside(context: RuleContext, probe: Probe) -> None:
    """Check that a reading right after `inspect` of another channel is that of its own channel, alone and in a
    block."""
    for asked, text in zip(context.known, (*context.known[1:], *context.known[:1]), strict=True):
        before = probe.read(text)
        for many in (False, True):
            probe.call(f"inspect of {asked}", inspection_of, probe.driver, probe.channel(asked))
            now = probe.read_many((text,))[0] if many else probe.read(text)
            if not context.alike(text, before, now):
                why = f"{text} read {before}, and {now} right after inspect of {asked}"
                raise RuleBroken(why, f"reading of {text}")


def _reports_while_away(context: RuleContext, probe: Probe) -> None:
    if context.subject.line is None and context.subject.gone is None:
        return
    before = report_of(probe.driver)
    with context.in_haste(probe), context.loss():
        context.failure(context.transfers(probe)[0])
        for call in context.enquiries(probe):
            if isinstance(error := context.failure(call), WrongKind):
                raise RuleBroken(f"while the device is away, {context.watch.doing} raises {text_of(error)}")
    context.try_out(probe)
    if lost := before.keys() - context.insist(probe.call, "report", report_of, probe.driver).keys():
        raise RuleBroken(f"report has lost {some(sorted(map(repr, lost)))} after the device was away and came back")


def _check_report(probe: Probe) -> None:
    driver = probe.driver
    if not isinstance(driver, Reports):
        return
    try:
        found = probe.call("report", driver.report)
    except OSError as error:
        raise RuleBroken(f"report raised {text_of(error)}") from error
    if not isinstance(found, Mapping):
        raise RuleBroken(f"report returned a {type(found).__name__}, not a dict by name")
    if odd := next((f"{key!r}: {value!r}" for key, value in found.items() if not _is_plain({key: value})), ""):
        raise RuleBroken(
            f"report returned {odd}, which is not plain data (numbers, strings, and lists and dicts of these)"
        )


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(isinstance(key, str | int) and _is_plain(each) for key, each in value.items())
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, str | bool | int | float) or hasattr(value, "dtype")


@rule(Cost(each=2, calls=4, waits=1, connects=1, watchdogs=9))
def watchdog(context: RuleContext) -> str | None:
    """Once the watchdog of the circuit is armed with a time, it switches the outputs off when nothing was called for
    that time, and not before, even if the driver has reconnected since. Requests that the driver sends by itself do not
    prevent this. Each call of `watchdog` sets the time again, and fails if its answer gets lost. `check_watchdog`
    refuses a time that the circuit does not support."""
    seconds = context.subject.watchdog
    if not isinstance(context.new().driver, HasWatchdog):
        raise NotTried("the driver has no watchdog of its circuit")
    context.required_outputs  # noqa: B018  NotTried
    if not seconds:
        raise NotTried("the time of the watchdog is not known (`watchdog` of the subject, or of the wiring)")
    long = 2 * WATCHDOG_EXPIRY * seconds
    with context.opened() as probe:
        _drive(context, probe)
        for output in context.required_outputs:
            context.expect(probe, output, output.other(), f"write_many of {output.other()}", WRITTEN_MANY)
        try:
            _check_limits(context, probe)
            longer = _arm(probe, long) is None
            if longer:
                _drive(context, probe)
                sleep(WATCHDOG_EXPIRY * seconds)
                silence = f"after {duration(WATCHDOG_EXPIRY * seconds)} of silence"
                _check_held(context, probe, f"armed with {duration(long)}, {silence}")
            _drive(context, probe)
            if (error := _arm(probe, seconds)) is not None:
                raise RuleBroken(f"the watchdog does not take {duration(seconds)}: {text_of(error)}") from error
            _check_held(context, probe, f"while it was armed with {duration(seconds)}")
            _feed(context, probe, seconds)
            _check_let_go(context, probe, seconds, "")
            if context.subject.line is not None:
                _connects_again(context, probe, seconds)
                _check_let_go(context, probe, seconds, ", and the driver has reconnected since")
                _arms_in_vain(context, probe, seconds)
        finally:
            _arm(probe, 0.0)
    return context.remark(*(() if longer else (f"it does not take {duration(long)}, so it was armed once",)))


def _watched(probe: Probe) -> HasWatchdog:
    assert isinstance(probe.driver, HasWatchdog)
    return probe.driver


def _arm(probe: Probe, seconds: float) -> OSError | None:
    """Arm the watchdog. Return the error if it does not accept this time."""
    try:
        probe.call("check_watchdog", _watched(probe).check_watchdog, seconds)
        probe.call(f"watchdog({seconds:g})", _watched(probe).watchdog, seconds)
    except OSError as error:
        return error
    return None


def _check_limits(context: RuleContext, probe: Probe) -> None:
    """Check that the watchdog can be armed with every time that `check_watchdog` accepts. Without a limit the time
    would overflow in the circuit."""
    for seconds in NO_TIMES:
        if context.failure(probe.call, "check_watchdog", _watched(probe).check_watchdog, seconds) is not None:
            continue
        if (error := _arm(probe, seconds)) is not None:
            fails = f"{context.watch.doing} fails: {text_of(error)}"
            raise RuleBroken(f"check_watchdog takes {seconds:g} s, and then {fails}")
        if seconds < 0:
            raise RuleBroken(f"check_watchdog and watchdog accept {seconds:g} s, which is in the past")


def _sends_by_itself(context: RuleContext, seconds: float) -> bool:
    """Return True if the driver sends requests while nothing is called."""
    with context.counted() as traffic:
        sleep(seconds)
    return bool(traffic.asked)


def _connects_again(context: RuleContext, probe: Probe, seconds: float) -> None:
    """Lose the connection, and arm the watchdog again only if the next call fails. umo does the same: after a
    successful call that has reconnected, it does not arm the watchdog again."""
    _arm(probe, seconds)
    context.line.drop()
    if context.failure(_drive, context, probe) is not None:
        context.insist(_drive, context, probe)
        _arm(probe, seconds)


def _arms_in_vain(context: RuleContext, probe: Probe, seconds: float) -> None:
    """Check that `watchdog` fails if its answer gets lost, because it is then unknown whether the watchdog is armed."""
    _drive(context, probe)
    with context.in_haste(probe):
        armed = partial(probe.call, f"watchdog({seconds:g})", _watched(probe).watchdog, seconds)
        error, lost = context.unanswered(armed)
    if error is None and lost:
        raise RuleBroken(f"{context.watch.doing} succeeded without an answer", MADE_UP)
    context.failure(_drive, context, probe)


def _drive(context: RuleContext, probe: Probe) -> None:
    probe.write_many([each.channel for each in context.subject.outputs],
                     [each.other() for each in context.subject.outputs])  # fmt: skip


def _feed(context: RuleContext, probe: Probe, seconds: float) -> None:
    """Send requests in time, and check that the outputs keep their levels."""
    for _ in range(2 * WATCHDOG_REQUESTS):
        _drive(context, probe)
        if context.readable:
            probe.read_many(context.readable)
        sleep(seconds / WATCHDOG_REQUESTS)
    _check_held(
        context, probe, f"armed with {duration(seconds)}, with a request every {duration(seconds / WATCHDOG_REQUESTS)}"
    )


def _check_held(context: RuleContext, probe: Probe, when: str) -> None:
    for output in context.required_outputs:
        if not context.same(output, output.other(), context.level(probe, output)):
            raise RuleBroken(f"the watchdog has released {output.channel}, {when}")


def _check_let_go(context: RuleContext, probe: Probe, seconds: float, since: str) -> None:
    """Wait without requests until the watchdog must have acted. The circuit decides which outputs it releases, and to
    what levels."""
    outputs = context.required_outputs
    _drive(context, probe)
    sends = _sends_by_itself(context, WATCHDOG_EXPIRY * seconds)
    if all(context.same(each, each.other(), context.level(probe, each)) for each in outputs):
        at = some([f"{each.channel} at {each.other()}" for each in outputs])
        armed = f"armed with {duration(seconds)}{since}"
        why = ": the driver sends requests by itself during this time" if sends else ""
        silence = f"nothing was called for {duration(WATCHDOG_EXPIRY * seconds)}"
        raise RuleBroken(f"the watchdog was {armed}, and {silence}, but the outputs are still driven: {at}{why}")
