"""The table `[process]` of a wiring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from umo.drivers.contract import MAX_DEFAULT_TIMEOUT
from umo.drivers.off_cycle import OffCycle
from umo.duration import duration, seconds
from umo.errors import DeclarationError
from umo.system.realtime import SLEEPLESS, longest_busy_wait
from umo.wiring.settings import TakenBy, a_whole, above_0, one_of, values_of
from umo.wiring.source import WiringSource
from umo.wiring.wired import AT_NEXT_TICK, AT_ONCE, ProcessSettings, Wired

HANG_PERIODS = 20
"""The default time after which a process counts as hanging if no period has ended, in periods."""
AUTO = "auto"


def _busy(value: Any) -> float | None:
    if value == AUTO:
        return None
    try:
        return seconds(value)
    except DeclarationError:
        raise DeclarationError(f'{value!r} is neither "{AUTO}", nor a duration such as "120 us", nor 0') from None


@dataclass(frozen=True)
class ProcessTable:
    """The permitted content of the table."""

    hang_timeout: Annotated[float | None, above_0()] = None
    reset_for: Annotated[float, above_0()] = ProcessSettings().reset_for
    priority: Annotated[int, a_whole(1, 98)] = ProcessSettings().priority
    cpu: Annotated[int | None, a_whole(0, 4095)] = None
    busy_wait: Annotated[float | None, TakenBy(_busy)] = None
    outputs: Annotated[str, one_of(AT_ONCE, AT_NEXT_TICK)] = AT_ONCE
    compile: bool = False


def process_of(source: WiringSource, wired: Wired) -> ProcessSettings:
    """Return the settings of the control process. Contradictory settings become mistakes of the wiring."""
    if not source.process:
        table = ProcessTable()
    else:
        values, mistakes = values_of(ProcessTable, source.process)
        for key, text in mistakes:
            source.mistake(f"process.{key}", text)
        table = ProcessTable(**values)
    _check_busy_wait(source, table.busy_wait, wired)
    if table.outputs == AT_NEXT_TICK and wired.timer is None:
        source.mistake("process.outputs", f'"{AT_NEXT_TICK}": the machine has no timer')
    hang = _hang_timeout(source, table.hang_timeout, wired)
    return ProcessSettings(
        hang, table.reset_for, table.priority, table.cpu, table.busy_wait, table.outputs, table.compile
    )


def _hang_timeout(source: WiringSource, hang: float | None, wired: Wired) -> float:
    period, waits = wired.period or 0.0, longest_period(wired)
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


def _check_busy_wait(source: WiringSource, busy_wait: float | None, wired: Wired) -> None:
    """Check the time of busy waiting. A process that never sleeps keeps other processes from its core, and is throttled
    (sched(7))."""
    if not busy_wait:
        return
    if wired.period is None:
        source.mistake("process.busy_wait", "the machine has no timer")
    elif busy_wait > longest_busy_wait(wired.period):
        period, of = duration(wired.period), "" if wired.period <= SLEEPLESS else "half of "
        source.mistake("process.busy_wait", f"{duration(busy_wait)} is more than {of}the period, {period}")


def remarks(wired: Wired) -> list[str]:
    """Return remarks on permitted settings that have disadvantages."""
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
    """Return the longest duration of a period in s, for the case that every call of a driver times out: one block
    transfer for each driver and direction, further ones for each part with another rate, and one call for each
    asynchronous object. No period waits for a driver off the cycle."""
    calls = {
        (
            id(wire.driver),
            (wire.item.direction, wired.rates.number(wire.item)) if wire.item.synchronous else wire.path,
        ): wire.driver.timeout
        for wire in wired.wires
        if wire.item is not wired.timer and not isinstance(wire.driver, OffCycle)
    }
    return (wired.period or 0.0) + sum(calls.values())
