"""On/off control with hysteresis, for example control of a pressure by a valve or of a temperature by a heater."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Generic, TypeVar

from umo.control.checks import check_numbers
from umo.control.inputs import Accept, value_of
from umo.digits import number_text
from umo.errors import DeclarationError, RangeError
from umo.objects import BinaryActuator, DigitalSensor, Number
from umo.states import TwoState

S = TypeVar("S", bound=TwoState)


@dataclass
class Hysteresis(Generic[S]):
    """A law that writes the state `raising` below `low` and the other state above `high` (both in the sensor's units),
    and does not change the actuator in between."""

    sensor: DigitalSensor
    actuator: BinaryActuator[S]
    raising: S
    """The state of the actuator that makes the sensor's value rise."""
    low: float
    high: float

    def __post_init__(self) -> None:
        self.check_settings()

    def check_settings(self) -> None:
        """Check the settings. Raises DeclarationError unless `low` and `high` are finite and in this order, and
        `raising` is a state of the actuator."""
        check_numbers(self, finite=("low", "high"))
        if self.low > self.high:
            raise DeclarationError(f"Hysteresis: low {number_text(self.low)} is above high {number_text(self.high)}")
        if type(self.raising) is not self.actuator.states:
            raise DeclarationError(f"Hysteresis: {self.raising!r} is not a state of {self.actuator.states.__name__}")

    @property
    def numbers(self) -> Mapping[str, Number]:
        """The numbers that are shown: its bounds."""
        return dict.fromkeys(("low", "high"), Number(self.sensor.units, shown=True))

    def control(self, accept: Accept = ()) -> S:
        """Carry out one period: read, compare, write. Returns the state that the actuator has accepted; while the
        actuator is inhibited, this is its default. Raises BadInput like every control law, RangeError if a number is
        not finite."""
        value, actuator = value_of(self.sensor, accept), self.actuator
        if self.low <= value <= self.high:
            state = actuator.pending
        elif -inf < value < self.low < inf:
            state = self.raising
        elif -inf < self.high < value < inf:
            state = actuator.zero if self.raising is actuator.one else actuator.one
        else:
            bounds = f"with the bounds {self.low} and {self.high}"
            raise RangeError(f"{self.sensor.path}: the value {value} cannot be controlled {bounds}")
        return state if actuator.write(state) else actuator.pending

    @property
    def settled(self) -> bool:
        """True if the value is between `low` and `high`. Raises BadInput like `control`."""
        return self.low <= value_of(self.sensor) <= self.high
