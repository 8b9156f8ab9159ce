"""The application that heats the tunnel to its profile of temperatures, keeps the profile, and reports."""

from typing import Any

from .control import Furnace


async def main(m: Furnace, peak: float = 850.0, soak: float = 120.0, ramp: float = 3.0) -> dict[str, Any]:
    """Heat up and keep the profile.

    Options:
        peak: highest temperature of the profile, degC.
        soak: time for which this temperature is kept, s.
        ramp: rate of heating, K/s.
    """
    await m.heat_up(peak, ramp)
    await m.soak(soak)
    m.say("done", done=2)
    return m.results()
