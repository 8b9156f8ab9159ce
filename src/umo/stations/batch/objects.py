"""The objects of the batch plant: two reactors and the charging line that they share."""

from umo import BinaryActuator, DigitalActuator, DigitalSensor
from umo.states import OpenClosed

from .control import BatchPlant, ChargingLine, Reactor

REACTORS = 2


def machine() -> BatchPlant:
    """Two reactors, and a hopper on a scale for two raw materials."""
    return BatchPlant(
        reactors=[reactor() for _ in range(REACTORS)],
        line=ChargingLine(
            inlets=[valve(), valve()],
            outlets=[valve() for _ in range(REACTORS)],
            waste=valve(),
            scale=DigitalSensor("kg", minimum=-2.0, maximum=120.0, resolution=0.01),
        ),
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
    )


def reactor() -> Reactor:
    """Heater and stirrer off and valves closed are the safe values."""
    return Reactor(
        feed=valve(),
        drain=valve(),
        stirrer=DigitalActuator("rpm", default=0.0, minimum=0.0, maximum=150.0, resolution=0.1, slew_rate=50.0),
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.1),
        temperature=DigitalSensor(
            "degC",
            minimum=-10.0,
            maximum=150.0,
            resolution=0.01,
            invalid_raws=[0x7FFF],  # the transmitter's mark of a broken wire
        ),
        level=DigitalSensor("l", minimum=-2.0, maximum=200.0, resolution=0.1),
    )


def valve() -> BinaryActuator[OpenClosed]:
    """A lost answer of its box is no failure: it is sent again for as long as what it does can wait."""
    return BinaryActuator(OpenClosed, one=OpenClosed.OPEN, default=OpenClosed.CLOSED, on_error="retry", max_age="3 s")
