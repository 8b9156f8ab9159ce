"""The conveyor's hardware as a driver: drive, parts on the belt, light barriers and diverter, in raw integers.

| channel | direction, bits | meaning of the level |
| --- | --- | --- |
| drive:run | output, 1 | 1 = the drive follows its setpoint, 0 = it brakes |
| drive:setpoint, drive:speed | output, input, 16 signed | 16384 = 1 m/s (as PROFIdrive's N2: 4000h is 100 %) |
| hertz:setpoint, hertz:speed | output, input, 16 signed | of another drive: 0.01 Hz a count, 50 Hz = 1 m/s |
| dio:diverter | output, 1 | 1 = the diverter moves out |
| dio:entry, dio:exit | input, 1 | 1 = the light barrier is covered |
| dio:stop | input, 1 | the emergency stop, normally closed: 0 = pressed |
| tick | input, 31 | the timer: lets one period pass, in virtual time |

Places are in mm from the entry barrier. No channel carries the data of `report`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, Literal

from umo.drivers import Channel, ChannelError, Direction, Driver, DriverError, IntArray, Reports, WiringError

START, EXIT, DIVERTER, END = -100.0, 300.0, 450.0, 460.0
REACH = 20.0  # the diverter rejects a part whose middle is so near to its own, mm
STROKE, LAG = 0.05, 0.05  # time that the diverter takes to move out, and time constant of the drive, s
JAMS = {"jam": 150.0, "jam-at-entry": 30.0, "jam-at-exit": 330.0}  # where the front of a part stops
Defect = Literal[
    "jam", "jam-at-entry", "jam-at-exit", "taken-away", "entry-stuck", "exit-stuck", "drive-dead", "emergency-stop"
]
OUTPUTS = {"drive:run": 1, "drive:setpoint": 16, "hertz:setpoint": 16, "dio:diverter": 1}
INPUTS = {"drive:speed": 16, "hertz:speed": 16, "dio:entry": 1, "dio:exit": 1, "dio:stop": 1, "tick": 31}
CHANNELS = {text: Channel(text, Direction.OUTPUT, bits, signed=bits == 16) for text, bits in OUTPUTS.items()}
CHANNELS |= {text: Channel(text, Direction.INPUT, bits, signed=bits == 16) for text, bits in INPUTS.items()}


@dataclass(eq=False)
class Workpiece:
    """A simulated part, with lengths in mm."""

    length: float
    good: bool
    gap: float  # to the part before it
    front: float = START

    @property
    def rear(self) -> float:
        return self.front - self.length


class Plant(Driver, Reports):
    """The conveyor, simulated. A third of the parts are out of tolerance. No part is so near to a limit that the
    measurement could be wrong.

    Options:
        seed: seed of the random part lengths and gaps.
        parts: number of parts.
        nominal: nominal length of a part, mm.
        tolerance: tolerance of this length, mm.
        faults: kinds of failures.
        fault_at: time at which the failures begin, s.
    """

    simulates_time = True

    def __init__(
        self,
        *,
        seed: int = 0,
        parts: int = 10,
        nominal: float = 80.0,
        tolerance: float = 4.0,
        faults: Sequence[Defect] = (),
        fault_at: float = 4.0,
    ) -> None:
        if not 20.0 <= nominal - 4 * tolerance < nominal + 4 * tolerance <= 250.0:
            raise WiringError("the plant makes parts of nominal +- 4 * tolerance; this must be within 20 to 250 mm")
        self.nominal, self.faults, self.fault_at = nominal, set[str](faults), fault_at
        self.outputs, self.inputs = dict.fromkeys(OUTPUTS, 0), dict.fromkeys(INPUTS, 0)
        self.time = self.speed = self.extension = 0.0  # s; mm/s; of the diverter, 0 (in) to 1 (out)
        self.coming = list(self._supply(Random(seed), parts, tolerance))
        self.belt: list[Workpiece] = []  # the foremost first
        self.accepted: list[Workpiece] = []
        self.rejected: list[Workpiece] = []
        self._show(set())

    def _supply(self, random: Random, parts: int, tolerance: float) -> Iterator[Workpiece]:
        for _ in range(parts):
            good = random.random() < 0.65
            error = tolerance * (random.uniform(0.0, 0.5) if good else random.uniform(1.5, 4.0))
            yield Workpiece(self.nominal + random.choice((-error, error)), good, gap=random.uniform(30.0, 80.0))

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.advance()
        return self.inputs[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        if channel.text not in self.outputs:
            raise DriverError(f"{channel.text} is an input and cannot be written")
        self.outputs[channel.text] = raw

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        inputs = self.inputs
        out[:] = [self.read(channel) if channel.text == "tick" else inputs[channel.text] for channel in channels]

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        outputs = self.outputs
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            if raw != outputs.get(channel.text):
                self.write(channel, raw)

    def advance(self, periods: int = 1) -> None:
        """Simulate a number of sampling periods."""
        for _ in range(periods):
            self.time += self.period
            present = self.faults if self.time >= self.fault_at else set()
            self._move(self._drive("drive-dead" in present), present)
            self._push()
            self._show(present)

    def _drive(self, dead: bool) -> float:
        """Return the travel of the belt in a period, mm. It is exact for a drive of the first order."""
        target = self.outputs["drive:setpoint"] / 16.384 + self.outputs["hertz:setpoint"] / 5.0  # one of them is wired
        if dead or not self.outputs["drive:run"]:
            target = 0.0
        decay, behind = math.exp(-self.period / LAG), self.speed - target
        self.speed = target + behind * decay
        return target * self.period + behind * LAG * (1.0 - decay)

    def _move(self, travel: float, present: set[str]) -> None:
        """Move the parts with the belt, up to the part before them or to the place where they jam."""
        jams = [JAMS[name] for name in present & JAMS.keys()] if present else ()
        free = math.inf
        for item in self.belt:
            before, front = item.front, item.front + travel
            if front > free:
                front = free
            for place in jams:
                if before <= place < front:
                    front = place
            item.front = front
            free = front - item.length
        if self.coming and free - self.coming[0].gap >= START:
            self.belt.append(item := self.coming.pop(0))
            item.front = min(START + travel, free - item.gap)
        if "taken-away" in present and (between := [item for item in self.belt if 0 < item.rear < item.front < EXIT]):
            self.belt.remove(between[0])
            self.faults.remove("taken-away")
        if self.belt and self.belt[0].rear > END:
            self.accepted.append(self.belt.pop(0))

    def _push(self) -> None:
        way = self.period / STROKE if self.outputs["dio:diverter"] else -self.period / STROKE
        self.extension = min(max(self.extension + way, 0.0), 1.0)
        if self.extension < 1.0:
            return
        for item in self.belt.copy():
            if abs((item.front + item.rear) / 2 - DIVERTER) <= REACH:
                self.belt.remove(item)
                self.rejected.append(item)

    def _show(self, present: set[str]) -> None:
        inputs, speed = self.inputs, self.speed
        inputs["dio:entry"] = int("entry-stuck" in present or self._covered(0.0))
        inputs["dio:exit"] = int("exit-stuck" in present or self._covered(EXIT))
        inputs["drive:speed"], inputs["hertz:speed"] = round(speed * 16.384), round(speed * 5.0)
        inputs["dio:stop"] = int("emergency-stop" not in present)

    def _covered(self, place: float) -> bool:
        for item in self.belt:
            front = item.front
            if front >= place >= front - item.length:
                return True
        return False

    def report(self) -> dict[str, Any]:
        """Return the parts delivered to the end of the belt or the chute, the number of wrongly sorted ones, and the
        largest deviation of an accepted part from the nominal length."""
        return {
            "parts_delivered": len(self.accepted) + len(self.rejected),
            "wrongly_sorted": sum(not item.good for item in self.accepted) + sum(item.good for item in self.rejected),
            "worst_length_error_mm": max((abs(item.length - self.nominal) for item in self.accepted), default=None),
        }
