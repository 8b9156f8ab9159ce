"""On/off regulation with hysteresis: a valve and a pressure, a heater and a temperature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from umo.control.inputs import Accept, value_of
from umo.objects import BinaryActuator, DigitalSensor, TwoState

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

    @property
    def signals(self) -> Mapping[str, str]:
        return {"low": self.sensor.units, "high": self.sensor.units}

    def control(self, accept: Accept = ()) -> S:
        """One period: read, compare, write. Returns the state written. Raises BadInput like every control law."""
        value, actuator = value_of(self.sensor, accept), self.actuator
        if value < self.low:
            state = self.raising
        elif value > self.high:
            state = actuator.zero if self.raising is actuator.one else actuator.one
        else:
            state = actuator.pending
        actuator.write(state)
        return state

    @property
    def settled(self) -> bool:
        """Whether the value is between `low` and `high`. Raises BadInput like `control`."""
        return self.low <= value_of(self.sensor) <= self.high
