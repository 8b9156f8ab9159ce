"""Experiments on a running loop: a relay, or a step, around its present output.

During the experiment, its values replace the results of the law's `step`. The law still reads, checks quality, limits
and writes through the command stage, under its interlocks. Whatever ends the experiment, the next output of the law is
the old output. Then the law is in control again, with the integral that it had before. An experiment is an action
(`umo.objects.action`). Like any action, it ends when the lease or the dead-man control ends, at a change of mode, and
at a fault of equipment.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from typing import Any, Literal

from umo.control.excitation import NOISE_FACTOR, Baseline, RelaySwitching, StepChange, fitting, room_for
from umo.control.loops import ControlLoop, Next
from umo.cycle.sequences import one_period
from umo.digits import number_text
from umo.errors import Busy, CommandRefused, RangeError
from umo.objects import Compound, Range, action
from umo.objects.presentation.value_text import measure

BASE_TIME, BASE_STEPS = 1.0, 20
"""The least time in s and the least number of steps for which the law is observed before the experiment."""
MAX_IDLE_PERIODS = 3
"""The number of steps that the law can omit before it counts as switched off."""
MAX_EXPERIMENT_TIME = 86_400.0
"""Longest time in s of an experiment."""
WITHIN_SHARE = 0.1
"""The share of the sensor's range by which the measurement may move by default."""


class LoopExperiments:
    """The experiments on one loop of a machine."""

    def __init__(self, part: Compound, path: str, loop: ControlLoop) -> None:
        self._part, self._path, self._loop = part, path, loop
        self._outer: list[ControlLoop] = []
        """The loops that are held during the experiment."""
        self._base = Baseline()
        self._excitation: RelaySwitching | StepChange | None = None
        self._plan: Callable[[Baseline, float, float], RelaySwitching | StepChange] | None = None
        """The function that makes the excitation from the baseline and the bounds of the output; None without an
        experiment."""
        self._ended = self._failed = ""
        self._idle = 0
        """The number of checks since the last step of the law."""
        self._most_idle = MAX_IDLE_PERIODS + 1
        """The largest number of such checks at which the law still counts as acting."""
        self._dt = 0.0
        self._within = inf
        self._until = 0.0
        """The time in s until which the law's next step gives the old output."""
        self._driven: float | None = None
        """The output that the experiment has returned last; None before the first."""
        self._steps = self._limited = 0
        """The number of steps of the excitation, and the number of steps in which the inner law of a cascade was
        limited."""

    @action(harmless=True)
    def law(self) -> dict[str, Any]:
        """Return the description of the law as plain data."""
        loop = self._loop
        numbers = {name: value if isfinite(value) else None for name, value in loop.gains.items()}
        ends = {"sensor": loop.sensor, "actuator": loop.output}
        paths = {name: "" if each is None else each.path for name, each in ends.items()}
        dt = self._dt or self._part._machine.period or self._part.dt
        more = {} if loop.output is None else loop.output.told
        axis = hasattr(type(self._part), "describe_axis")
        return {"law": self._path, **paths, **more, **numbers, "dt": dt, "axis": axis}

    @action(
        amplitude=lambda each: each.amplitudes,
        hysteresis=lambda each: Range(each.units, 0.0, inf),
        within=lambda each: Range(each.units, 0.0, inf),
        cycles=Range("", 2, 100),
        duration=Range("s", 0.0, MAX_EXPERIMENT_TIME),
        release="end",
    )
    async def experiment(
        self,
        kind: Literal["relay", "step"],
        amplitude: float,
        *,
        hysteresis: float = 0.0,
        within: float = 0.0,
        cycles: int = 5,
        duration: float = 600.0,
    ) -> dict[str, Any]:
        """Excite the loop around its present output. If `hysteresis` is 0, it is computed from the noise. If `within`
        is 0, it is a tenth of the sensor's range.

        Returns the old output and measurement, the noise, the times at which the excitation began and ended, and the
        share of this time in which the inner law of a cascade was at its limit. Raises RangeError if there is no room
        for the amplitude, or if the measurement moves by more than `within`. Raises CommandRefused if the law does not
        act, or if its actuator is inhibited or written by somebody else; raises Busy during another experiment. A law
        whose output is the setpoint of this law holds this setpoint during the experiment.
        """
        self._outer = self._loop.outer
        if any(each.is_taken for each in (self._loop, *self._outer)):
            raise Busy(f"{self._path}: an experiment is in progress")
        if not amplitude or (kind == "relay" and amplitude < 0.0):
            hint = "; a step may go down" if kind == "relay" else ""
            must = "above 0" if kind == "relay" else "below or above 0"
            raise RangeError(
                f"{self._path}: the amplitude of a {kind} must be {must}, not {number_text(amplitude)}{hint}"
            )
        self._within = within or WITHIN_SHARE * self._loop.measured_range or inf
        self._plan = lambda base, low, high: self._made(kind, amplitude, hysteresis, cycles, base, low, high)
        self._base, self._excitation, self._driven = Baseline(), None, None
        self._ended = self._failed = ""
        self._idle = self._steps = self._limited = 0
        self._loop.take(self._next)
        for each in self._outer:
            each.take(_holding())
        began = not_begun = -1.0
        try:
            while not (self._ended or self._failed):
                self._look((await one_period()).period)
                if self._excitation is not None:
                    began = began if began != not_begun else self._part.now
                    self._part.cycle.progress(self._excitation.progress)
                    if self._part.now - began > duration:
                        self._ended = "the time limit was reached"
        finally:
            self.end()
        if self._failed:
            raise CommandRefused(f"{self._path}: {self._failed}")
        base, ends = self._base, {"from": began, "to": self._part.now}
        seen = {"output": base.output, "measurement": base.measurement, "noise": base.noise}
        seen["limited"] = self._limited / max(self._steps, 1)
        return {"ended": self._ended, **{name: round(value, 9) for name, value in {**seen, **ends}.items()}}

    def end(self) -> None:
        """End the experiment: restore the old output, then return control to the law."""
        if self._plan is None:
            return
        for each in self._outer:
            each.give_back()
        self._plan, self._until = (
            None,
            self._part.now + (MAX_IDLE_PERIODS + 1) * max(self._dt, self._part._machine.period),
        )
        if self._driven is None or self._is_idle:
            self._loop.give_back()
        if self._driven is None:
            return
        output = self._loop.output
        if output is not None and output.commanded == self._driven:  # else somebody else is in charge
            output.write(self._base.output)

    @property
    def units(self) -> str:
        """The units of the measurement."""
        return "" if self._loop.sensor is None else self._loop.sensor.units

    @property
    def amplitudes(self) -> Range:
        """The range of the output, in its units."""
        output = self._loop.output
        if output is None:
            return Range("", -inf, inf)
        span = output.range[1] - output.range[0]
        return Range(output.units, -span, span)

    # In each step of the law -------------------------------------------------------------------------------

    def _next(self, output: float, measurement: float, dt: float, low: float, high: float) -> float | None:
        """Return the output that replaces the law's output, or None for the law's own output."""
        self._idle, self._dt = 0, dt
        if self._plan is None:  # it has ended: the old output, once
            self._loop.give_back()
            return None if self._part.now > self._until else min(max(self._base.output, low), high)
        if self._ended or self._failed:
            return None if self._driven is None else self._drive(self._base.output, low, high)
        if self._excitation is None:
            self._base.add(output, measurement, dt)
            if self._base.count < BASE_STEPS or self._base.time < BASE_TIME:
                return None
            try:
                self._excitation = self._plan(self._base, *self._loop.bounds(low, high))
            except RangeError as error:
                self._failed = str(error)
                return None
        moved = abs(measurement - self._base.measurement)
        wanted = self._excitation.next(measurement, dt)
        if moved > self._within:
            bound = measure(self._within, self.units)
            told = (
                f"the measurement has moved by {measure(moved, self.units)}, more than {bound} (`--within` sets this)"
            )
            if isinstance(self._excitation, StepChange):
                self._ended = told
            else:
                self._failed = told
            wanted = None
        elif wanted is None:
            self._ended = "done"
        return self._drive(self._base.output if wanted is None else wanted, low, high)

    def _drive(self, wanted: float, low: float, high: float) -> float:
        self._steps += 1
        self._limited += self._loop.output is not None and self._loop.output.limited
        self._driven = min(max(wanted, low), high)
        return self._driven

    def _made(
        self, kind: str, amplitude: float, hysteresis: float, cycles: int, base: Baseline, low: float, high: float
    ) -> RelaySwitching | StepChange:
        room = room_for(base, amplitude, low, high, kind == "relay")
        if abs(amplitude) > room:
            units = "" if self._loop.output is None else self._loop.output.units
            raise RangeError(
                f"the output is at {measure(base.output, units)}, in a range of {number_text(low)} to "
                f"{measure(high, units)}: {fitting(base, low, high, self.amplitudes.maximum, units)} fits"
            )
        if kind == "step":
            return StepChange(base, amplitude)
        width = hysteresis or max(NOISE_FACTOR * base.noise, 2.0 * self._loop.resolution)
        return RelaySwitching(base, amplitude, self._loop.gains["gain"] >= 0.0, width, cycles)

    # In each period ----------------------------------------------------------------------------------------

    def _look(self, period: float) -> None:
        """Check that the law still acts, and that nobody else writes its output. `period`: the time in s between two
        checks, which may differ from the period of the law."""
        self._idle += 1
        each = max(self._dt, self._part._machine.period) / period if period else 1.0
        self._most_idle = MAX_IDLE_PERIODS * max(round(each), 1) + 1
        if self._is_idle:
            self._failed = (
                "the law does not act: nothing calls its `control`, or its sensor is not GOOD; run in automatic mode "
                "until the law controls, then change to manual mode and try again"
            )
        output = self._loop.output
        if output is None or self._driven is None or self._failed:
            return
        if (reason := output.inhibited) is not None:
            self._failed = reason
        elif output.commanded != self._driven:
            self._failed = f"{output.path} was written by somebody else"

    @property
    def _is_idle(self) -> bool:
        """True if the law has not acted for some of its periods."""
        return self._idle > self._most_idle


def _holding() -> Next:
    """Return a function that keeps the first output of a law."""
    held: list[float] = []

    def next_(output: float, measurement: float, dt: float, low: float, high: float) -> float:
        if not held:
            held.append(output)
        return min(max(held[0], low), high)

    return next_
