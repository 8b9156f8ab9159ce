"""The z-theta station's hardware as a driver: a MuJoCo model behind the five functions, in raw integers only.

| channel | direction, bits | meaning of the level |
| --- | --- | --- |
| dac:z | output, 12 signed | z motor, volts = raw * 10 / 2047, saturating at 10 V; positive lifts |
| pwm:z | output, 16 signed | the same by duty cycle, wired the other way round: volts = -raw * 10 / 32767 |
| dio:step, dio:direction | output, 1 | theta steps 0.225 deg on UP; direction 1 = CW from above = theta grows |
| dio:z_index, dio:theta_index | output, 1 | 1 = the next index pulse loads the preset, zeroes the count |
| dio:counterweight | output, 1 | 1 = valve open, the pressure rises; 0 = it stays, with a slow leak |
| dio:vacuum, dio:pressure | output, 1 | suction valve of the cup; release puff |
| counter:z, counter:theta | input, 16 / 24 signed | encoder counts: 0 at power-up, wrapping |
| adc:counterweight | input, 10 | pressure in the counterbalance cylinder, 80 Pa a count |
| dio:gripper | input, 1 | pressure switch of the cup: 1 = FAIL, 0 = PASS (above 30 kPa) |
| tick | input, 31 | the timer: lets one period of physics pass, returns 0 |

Heights are those of the cup's tip, which z counts. The stops are at 54.5 and 129.5 mm, and at 271 deg in both
directions. The top of a part is at 60.0 mm. The cup takes and leaves the part at 59.8 mm, pressing it by 0.2 mm (0.05
to 0.3 mm are enough; the vacuum draws a part up from 0.3 mm below the cup). With the valve closed and 0 V, z at rest
does not move while the pressure is between 680 and 820 counts; 752 counts carry the arm exactly.

Levels take effect at the next physics step of 1 ms. Each rising edge of dio:step makes a step in the direction that
was set before the transfer. A direction that is written together with UP is too late for this step.
The actual positions (`z_um`, `theta_deg`, `truth()`) are for tests and observers; no channel carries them.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, c_int64, sizeof
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.option_checks import one_of
from umo.drivers.optional import MovesInC, Reports, TransferInC
from umo.drivers.transfers_in_c import of_cells
from umo.errors import ChannelError, DriverError, WiringError
from umo.system.packages import how_to_install

from .courier import Report
from .devices import STEP

if TYPE_CHECKING:
    from .physics import Physics

Breakage = Literal[
    "no-part", "leaky-cup", "stalled-theta", "dead-z-encoder", "dead-theta-encoder", "no-courier", "dropped-part"
]
"""Faults of the plant: the courier comes empty; the cup never builds its vacuum; the rotor is blocked; a count is
frozen; no courier comes; the seal breaks while a lifted part is turned."""
MAX_PARTS = 6


@dataclass(frozen=True)
class PlantChannel(Channel):
    """A channel with its place in the plant's list of levels."""

    index: int = -1


def _channels() -> dict[str, PlantChannel]:
    """Return every channel by its text, outputs first, in the order of `Plant.advance`."""
    lines = ["step", "direction", "z_index", "theta_index", "counterweight", "vacuum", "pressure"]
    outputs = {"dac:z": 12, "pwm:z": 16} | {f"dio:{line}": 1 for line in lines}
    inputs = {"counter:z": 16, "counter:theta": 24, "adc:counterweight": 10, "dio:gripper": 1, "tick": 31}
    signed = {"dac:z", "pwm:z", "counter:theta"}
    return {
        text: PlantChannel(text, Direction.OUTPUT if text in outputs else Direction.INPUT, bits, text in signed, index)
        for index, (text, bits) in enumerate((outputs | inputs).items())
    }


CHANNELS = _channels()
RANGES = [(channel.lowest, channel.highest) for channel in CHANNELS.values()]
DAC, PWM, STEP_LINE, DIRECTION, INPUTS, TICK = (
    CHANNELS[text].index for text in ("dac:z", "pwm:z", "dio:step", "dio:direction", "counter:z", "tick")
)


class Plant(Driver[PlantChannel], Reports, MovesInC):
    """The station, simulated. The first `open` builds the machine; a later one finds the machine as it was left, with
    its circuits switched on again (counts at 0). After `close` the plant can still be advanced.

    Options:
        seed: seed of the random start positions.
        parts: number of parts on the courier, 1 to 6.
        preset: raw value that the z counter loads at its index; 58117 is 121,999.4 um.
        faults: failures of the plant, such as leaky-cup (`Breakage`).
    """

    simulates_time = True

    def __init__(
        self,
        *,
        seed: int = 0,
        parts: int = 3,
        preset: int = 58117,
        faults: Sequence[Breakage] = (),
    ) -> None:
        if not 1 <= parts <= MAX_PARTS:
            raise WiringError(f"parts must be 1 to {MAX_PARTS}, not {parts}")
        if not 0 <= preset < 1 << 16:
            raise WiringError(f"the preset {preset} does not fit the 16 bits of the z counter")
        for fault in faults:
            one_of("faults", fault, get_args(Breakage))
        self._seed, self._parts, self._preset, self._faults = seed, parts, preset, frozenset[str](faults)
        self._physics: Physics | None = None
        self._steps = 1
        self._drive: int | None = None
        self._levels = (c_int64 * len(CHANNELS))()
        self._seen = 0, 0
        """The levels of dio:step and dio:direction after the last transfer."""
        self._pulses = 0

    # The five functions -------------------------------------------------------------------------

    def channel(self, text: str) -> PlantChannel:
        try:
            return CHANNELS[text]
        except KeyError:
            raise ChannelError(text, CHANNELS) from None

    def finalize(self, channel: PlantChannel) -> None:
        if channel.index == self._drive:
            self._drive = None

    def read(self, channel: PlantChannel) -> int:
        """Return the level of an input. Raises DriverError for an output. Reading `tick` lets one period pass."""
        index = channel.index
        if index < INPUTS:
            raise DriverError(f"{channel.text} is an output and cannot be read")
        if index == TICK:
            self.advance()
            return 0
        return self._levels[index]

    def write(self, channel: PlantChannel, raw: int) -> None:
        """Set an output. The z drives saturate. Raises DriverError for a level other than 0 and 1 on a line."""
        self._count_step()
        self._put(channel, raw)
        self._count_step()

    def read_many(self, channels: Sequence[PlantChannel], out: IntArray) -> None:
        levels = self._levels
        out[:] = [
            levels[channel.index] if INPUTS <= channel.index < TICK else self.read(channel) for channel in channels
        ]

    def write_many(self, channels: Sequence[PlantChannel], raws: IntArray) -> None:
        levels = self._levels
        self._count_step()
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            if raw != levels[channel.index]:
                self._put(channel, raw)
        self._count_step()

    def in_c(self, channels: Sequence[PlantChannel], write: bool) -> TransferInC | str:
        places = [channel.index for channel in channels]
        if not all(place < INPUTS if write else INPUTS <= place < TICK for place in places):
            return "time passes in Python"
        if self._physics is None or any(place <= PWM and place != self._drive for place in places):
            return "it is not initialised"
        first = addressof(self._levels)
        return of_cells([first + place * sizeof(c_int64) for place in places], write, self._levels)

    def _count_step(self) -> None:
        """Count a rising edge of dio:step in the last transfer, which may have been made in C. The step has the
        direction that stood before the transfer."""
        step, direction = self._seen
        self._seen = self._levels[STEP_LINE], self._levels[DIRECTION]
        if self._seen[0] > step:
            self._pulses += 1 if direction else -1

    def _put(self, channel: PlantChannel, raw: int) -> None:
        """Set one output."""
        index = channel.index
        lowest, highest = RANGES[index]
        if index <= PWM:
            self._claim(index)
            raw = min(max(raw, lowest), highest)
        elif index >= INPUTS:
            raise DriverError(f"{channel.text} is an input and cannot be written")
        elif not lowest <= raw <= highest:
            raise DriverError(f"{channel.text} takes 0 or 1, not {raw}")
        if self._physics is None:
            raise DriverError("the plant is not open")
        self._levels[index] = raw

    def _claim(self, index: int) -> None:
        """Connect the z motor to the drive that was initialized first, until that drive is finalized."""
        if self._drive is None:
            self._drive = index
        elif self._drive != index:
            raise DriverError("dac:z and pwm:z drive the same motor; initialize only one of them")

    # Opening and time ---------------------------------------------------------------------------

    def open(self) -> None:
        """Switch the circuits on. The first call also builds the machine. Raises DriverError without MuJoCo."""
        self._steps = self._whole_steps()
        if self._physics is None:
            self._physics = self._build()
        else:
            self._physics.power_up()
        self._levels[:] = [0] * len(CHANNELS)
        self._seen = 0, 0
        self._pulses = 0
        self._drive = None
        self._refresh(self._physics)

    def _whole_steps(self) -> int:
        """Return the number of physics steps in a period; 1 without a timer (period 0)."""
        period = self.period or STEP
        steps = round(period / STEP)
        if steps < 1 or abs(steps * STEP - period) > 1e-9:
            raise DriverError(f"the plant's period is a whole number of ms, not {period * 1e3:g} ms")
        return steps

    def _build(self) -> Physics:
        try:
            from .physics import Physics
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "mujoco":
                raise
            raise DriverError(f"the plant needs MuJoCo: {how_to_install('plant')}") from error
        return Physics(seed=self._seed, parts=self._parts, preset=self._preset, faults=self._faults)

    def advance(self, periods: int = 1) -> None:
        """Simulate a number of periods with the present levels; this is also possible after `close`."""
        physics = self._opened()
        self._count_step()
        dac, pwm, _, _, z_index, theta_index, valve, vacuum, puff = self._levels[:INPUTS]
        steps, self._pulses = self._pulses, 0
        volts = -pwm * (10.0 / 32767) if self._drive == PWM else dac * (10.0 / 2047)
        volts = min(max(volts, -10.0), 10.0)
        for _ in range(periods * self._steps):
            physics.step(volts, steps, z_index, theta_index, valve, vacuum, puff)
            steps = 0
        self._refresh(physics)

    def _refresh(self, physics: Physics) -> None:
        self._levels[INPUTS:TICK] = [
            physics.z_counter.raw,
            physics.theta_counter.raw,
            physics.counterbalance.raw,
            physics.gripper.raw,
        ]

    def _opened(self) -> Physics:
        if self._physics is None:
            raise DriverError("the plant is not open")
        return self._physics

    # Truth, for tests and observers -------------------------------------------------------------

    @property
    def z_um(self) -> float:
        """Height of the cup's tip, um."""
        return self._opened().z_um

    @property
    def theta_deg(self) -> float:
        """Angle of the theta axis, deg."""
        return self._opened().theta_deg

    @property
    def physics(self) -> Physics:
        """The model itself, for rendering."""
        return self._opened()

    def truth(self) -> Report:
        """Report on every part so far."""
        return self._opened().courier.report()

    def report(self) -> dict[str, Any]:
        """Return the number of parts that were placed, and their largest errors (um, deg)."""
        parts = self.truth().parts
        return {
            "parts_placed": sum(part.placed for part in parts),
            "placing_error_um": max((part.error_um for part in parts if part.error_um is not None), default=None),
            "placing_error_deg": max((part.error_deg for part in parts if part.error_deg is not None), default=None),
        }
