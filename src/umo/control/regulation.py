"""On/off regulation with hysteresis: a valve and a pressure, a heater and a temperature."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Generic, TypeVar

from umo.control.inputs import value_of
from umo.objects import BinaryActuator, DigitalSensor, Quality, TwoState

S = TypeVar("S", bound=TwoState)


@dataclass
class Hysteresis(Generic[S]):
    """`raising` below `low`, the other state above `high` (both in the sensor's units), no change between."""

    sensor: DigitalSensor
    actuator: BinaryActuator[S]
    raising: S
    """The state of the actuator that makes the sensor's value rise."""
    low: float
    high: float

    def control(self, accept: Container[Quality] = ()) -> S:
        """One period: read, decide, write; the state written. BadInput as for every control law."""
        value = value_of(self.sensor, accept)
        state = self.actuator.pending
        if value < self.low:
            state = self.raising
        elif value > self.high:
            one, zero = self.actuator.one, self.actuator.zero
            state = zero if self.raising is one else one
        self.actuator.write(state)
        return state

    @property
    def settled(self) -> bool:
        """Whether the value was within the band when last read."""
        return self.low <= self.sensor.read() <= self.high
