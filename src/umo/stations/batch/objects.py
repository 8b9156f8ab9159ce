"""The objects of the batch plant: two reactors and the charging line that they share."""

from typing import Any

from umo import BinaryActuator, DigitalActuator, DigitalSensor
from umo.states import OpenClosed

from .control import BatchPlant, ChargingLine, Reactor

REACTORS = 2


KEPT: Any = {"max_age": "1 s"}
"""The time for which the last value is kept after a failed transfer."""


def machine() -> BatchPlant:
    """Return the machine: two reactors, and a hopper on a scale for two raw materials."""
    return BatchPlant(
        reactors=[reactor() for _ in range(REACTORS)],
        line=ChargingLine(
            inlets=[valve(), valve()],
            outlets=[valve() for _ in range(REACTORS)],
            waste=valve(),
            scale=sensor("kg", -2.0, 120.0, 0.01),
        ),
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
    )


def reactor() -> Reactor:
    """Make a reactor. Its safe values are heater and stirrer off, and valves closed."""
    return Reactor(
        feed=valve(),
        drain=valve(),
        stirrer=drive("rpm", 150.0, slew_rate=50.0),
        heater=drive("percent", 100.0),
        temperature=sensor("degC", -10.0, 150.0, 0.01, invalid_raws=[0x7FFF]),  # the mark of a broken wire
        level=sensor("l", -2.0, 200.0, 0.1),
    )


def sensor(units: str, minimum: float, maximum: float, resolution: float, **more: Any) -> DigitalSensor:
    """Make a sensor. A lost answer of its box is not a failure: the last value is held."""
    limits: Any = {"minimum": minimum, "maximum": maximum, "resolution": resolution}
    return DigitalSensor(units, on_error="hold", **limits, **KEPT, **more)


def drive(units: str, maximum: float, **more: Any) -> DigitalActuator:
    """Make an actuator. A lost answer of its box is not a failure: the value is sent again."""
    limits: Any = {"minimum": 0.0, "maximum": maximum, "resolution": 0.1}
    return DigitalActuator(units, default=0.0, on_error="retry", **limits, **KEPT, **more)


def valve() -> BinaryActuator[OpenClosed]:
    """Return a valve that is driven like a motor. Its effect may take longer."""
    return BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED, on_error="retry", max_age="3 s")
