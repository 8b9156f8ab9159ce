"""The tank's hardware, simulated, behind the five driver functions (the electrical developer's file).

For the real circuit only the wiring changes, as in `wiring/modbus.toml`.
"""

from umo.drivers import Channel, ChannelError, Direction, Driver, DriverError

CHANNELS = {
    "out:inlet": Channel("out:inlet", Direction.OUTPUT, 1),
    "out:drain": Channel("out:drain", Direction.OUTPUT, 1),
    "adc:level": Channel("adc:level", Direction.INPUT, 10),  # 0.5 mm per count
    "in:overflow": Channel("in:overflow", Direction.INPUT, 1),  # 1 = FAIL
    "tick": Channel("tick", Direction.INPUT, 31),  # the timer: each reading simulates one period
}


class Plant(Driver):
    """A tank of 520 mm. The inlet raises the level by 20 mm/s. The drain lowers it in proportion to the root of the
    level.

    Options:
        level: level at the start, mm.
        leak: leak of the tank, mm/s.
    """

    def __init__(self, *, level: float = 20.0, leak: float = 1.0) -> None:
        self.level = level
        self.leak = leak
        self._out = {"out:inlet": 0, "out:drain": 0}

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.advance(self.period)
            return 0
        if channel.text == "adc:level":
            return int(self.level / 0.5)
        if channel.text == "in:overflow":
            return int(self.level > 510.0)
        raise DriverError(f"{channel.text} is an output")

    def write(self, channel: Channel, raw: int) -> None:
        if channel.text not in self._out:
            raise DriverError(f"{channel.text} is an input")
        self._out[channel.text] = raw

    def advance(self, seconds: float) -> None:
        """Advance the simulation by `seconds` s."""
        flow = 20.0 * self._out["out:inlet"] - 3.0 * self.level**0.5 * self._out["out:drain"] - self.leak
        self.level = min(max(self.level + flow * seconds, 0.0), 520.0)
