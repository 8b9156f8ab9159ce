"""The table `[process]` of a wiring."""

from __future__ import annotations

import dataclasses
from typing import Any

from umo.drivers.contract import MAX_DEFAULT_TIMEOUT
from umo.drivers.off_cycle import OffCycle
from umo.duration import seconds
from umo.errors import DeclarationError
from umo.presentation.durations import duration
from umo.wiring.source import WiringSource
from umo.wiring.wired import AT_NEXT_TICK, AT_ONCE, ProcessSettings, Wired

HANG_PERIODS = 20
"""Periods without a finished one after which a process counts as hanging, by default."""
AUTO = "auto"


def process_of(source: WiringSource, wired: Wired) -> ProcessSettings:
    """The settings of the control process. Contradictory ones become mistakes of the wiring."""
    table, names = source.process, [field.name for field in dataclasses.fields(ProcessSettings)]
    for name in table.keys() - set(names):
        source.mistake(f"process.{name}", f"unknown key{source.near(name, names)}; known: {', '.join(names)}")
    cpu = table.get("cpu")
    return ProcessSettings(
        _hang_timeout(source, table.get("hang_timeout"), wired),
        source.duration("process.reset_for", table.get("reset_for")) or ProcessSettings().reset_for,
        source.whole("process.priority", table.get("priority", ProcessSettings().priority), 1, 98),
        None if cpu is None else source.whole("process.cpu", cpu, 0, 4095),
        _busy_wait(source, table.get("busy_wait", AUTO), wired),
        _outputs(source, table.get("outputs", AT_ONCE), wired),
        _compile(source, table.get("compile", False)),
    )


def _hang_timeout(source: WiringSource, given: Any, wired: Wired) -> float:
    period, waits = wired.period or 0.0, longest_period(wired)
    hang = source.duration("process.hang_timeout", given)
    if hang is None:
        return max(HANG_PERIODS * period, ProcessSettings().hang_timeout, 1.2 * waits)
    if hang < 2 * period:
        source.mistake("process.hang_timeout", f"{duration(hang)} is less than two periods")
    elif hang <= waits and wired.realtime:
        source.mistake(
            "process.hang_timeout",
            f"{duration(hang)} must be above {duration(waits)}, the sum of the timeouts of one period",
        )
    return hang


def _busy_wait(source: WiringSource, given: Any, wired: Wired) -> float | None:
    """A process that never sleeps keeps others from its core, and is throttled (sched(7))."""
    if given == AUTO:
        return None
    try:
        busy_wait = seconds(given)
    except DeclarationError:
        source.mistake("process.busy_wait", f'{given!r} is neither "{AUTO}", nor a duration such as "120 us", nor 0')
        return None
    if busy_wait and wired.period is None:
        source.mistake("process.busy_wait", "the machine has no timer")
    elif busy_wait > (wired.period or 0.0) / 2:
        period = duration(wired.period or 0.0)
        source.mistake("process.busy_wait", f"{duration(busy_wait)} is more than half of the period, {period}")
    return busy_wait


def _outputs(source: WiringSource, given: Any, wired: Wired) -> str:
    if given not in (AT_ONCE, AT_NEXT_TICK):
        source.mistake("process.outputs", f'{given!r} is neither "{AT_ONCE}" nor "{AT_NEXT_TICK}"')
        return AT_ONCE
    if given == AT_NEXT_TICK and wired.timer is None:
        source.mistake("process.outputs", f'"{AT_NEXT_TICK}": the machine has no timer')
    return str(given)


def _compile(source: WiringSource, given: Any) -> bool:
    if not isinstance(given, bool):
        source.mistake("process.compile", f"{given!r} is neither true nor false")
    return given is True


def remarks(wired: Wired) -> list[str]:
    """Remarks on settings that a wiring may have, with what they cost."""
    period = f"a period takes up to {duration(longest_period(wired))}, and so does a stop"
    costs = f"{period}; a process that hangs is found after {duration(wired.process.hang_timeout)}"
    most = duration(MAX_DEFAULT_TIMEOUT)
    return [
        f"drivers.{name}.timeout is {duration(driver.timeout)}, more than {most}: if nothing answers, {costs} "
        "(process.hang_timeout)"
        for name, driver in wired.drivers.items()
        if driver.timeout > MAX_DEFAULT_TIMEOUT and not isinstance(driver, OffCycle)
    ]


def longest_period(wired: Wired) -> float:
    """The longest duration of a period in s, if every call of a driver times out: a block transfer for each driver and
    direction, of each part with a rate of its own as well, and a call for each asynchronous object. No period waits for
    a driver off the cycle."""
    calls = {
        (
            id(wire.driver),
            (wire.item.direction, wired.rates.number(wire.item)) if wire.item.synchronous else wire.path,
        ): wire.driver.timeout
        for wire in wired.wires
        if wire.item is not wired.timer and not isinstance(wire.driver, OffCycle)
    }
    return (wired.period or 0.0) + sum(calls.values())
