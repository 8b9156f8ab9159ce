"""The objects of the tunnel furnace: a heater, a fan and a thermocouple for each zone, and the timer."""

from umo import BinaryActuator, DigitalActuator, DigitalSensor, Thermocouple
from umo.errors import DeclarationError
from umo.states import OnOff

from .control import Furnace, Zone, ZoneWithLaw

MAX_ZONES = 5000


def machine(zones: int = 40, laws: int = 0) -> Furnace:
    """Return a tunnel of zones.

    Options: zones: number of zones, 1 to 5,000. laws: number of zones, from the first on, that have separate laws and
    may run on controllers.
    """
    if not 1 <= zones <= MAX_ZONES:
        raise DeclarationError(f"a tunnel has 1 to {MAX_ZONES} zones, not {zones}")
    if not 0 <= laws <= zones:
        raise DeclarationError(f"0 to {zones} zones may have laws of their own, not {laws}")
    return Furnace(
        zones=[zone(ZoneWithLaw if n < laws else Zone) for n in range(zones)],
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
    )


def zone(kind: type[Zone] = Zone) -> Zone:
    """Make a zone. Its safe values are heater off and fan on."""
    return kind(
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.1),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON),
        temperature=DigitalSensor(
            "degC",
            minimum=0.0,
            maximum=1300.0,
            resolution=0.002,  # mV
            linearization=Thermocouple("K"),
            invalid_raws=[0x7FFF],  # the converter's mark of an open circuit
            on_error="mark",
            max_age="2 s",
        ),
    )
