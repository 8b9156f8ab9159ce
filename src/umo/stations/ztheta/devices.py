"""The circuits and pneumatics of the plant: quadrature counters, step drive, counterbalance, gripper.

They are plain first-order models, advanced by the physics step, in raw levels and SI units. This module does not use
MuJoCo.
"""

from __future__ import annotations

import math

STEP = 0.001
"""Physics step, s. Every period is a whole multiple of it."""


class EncoderCounter:
    """A quadrature counter. It is 0 at power-up, rolls over at its width, and loads `preset` at the index pulse while
    this is enabled.

    `resolution` and `origin` place the encoder's lines (line n begins at `origin + n * resolution`); the index pulse is
    on the line `index` and is detected in both directions.
    """

    def __init__(self, *, resolution: float, origin: float, index: int, preset: int, bits: int, signed: bool) -> None:
        self._resolution = resolution
        self._origin = origin
        self._index = index
        self._loaded = preset - index
        self._span = 1 << bits
        self._half = self._span >> 1 if signed else 0
        self._line = 0
        self._offset = 0
        self.raw = 0
        self.dead = False

    def power_up(self, position: float) -> None:
        """Switch the circuit on. The position is lost: the count is 0 at any position."""
        self._line = math.floor((position - self._origin) / self._resolution)
        self._offset = -self._line
        self.raw = 0

    def follow(self, position: float, index_enabled: int) -> None:
        """Count up or down to the position; the index is passed if its line lies between the last position and the
        present one."""
        line = math.floor((position - self._origin) / self._resolution)
        if self.dead:
            return
        if index_enabled and (self._line <= self._index <= line or line <= self._index <= self._line):
            self._offset = self._loaded
        self._line = line
        self.raw = (line + self._offset + self._half) % self._span - self._half


class StepDrive:
    """A step-and-direction drive and its motor: `TORQUE * sin(TEETH * (field - rotor))`.

    A revolution has 1,600 steps (0.225 deg), and an electrical cycle of 7.2 deg has 32 steps.
    """

    TORQUE = 0.0135
    """Holding torque, N m: with the rotor's 0.00041 kg m2 the motor can start at a rate of up to about 350 steps/s."""
    TEETH = 50
    STEPS = 1600

    def __init__(self, rotor: float) -> None:
        angle = 2.0 * math.pi / self.STEPS
        # The driver powers up in the phase nearest to the rotor.
        self._angle = angle
        self._field = round(rotor / angle) * angle

    def torque(self, steps: int, rotor: float) -> float:
        """Return the torque in N m on the rotor (at the angle `rotor`, rad) after this number of further steps. A
        positive torque increases theta."""
        self._field += steps * self._angle
        return self.TORQUE * math.sin(self.TEETH * (self._field - rotor))


class Counterbalance:
    """The counterbalance cylinder behind its valve. While the valve is open, the cylinder fills; while it is closed,
    the cylinder keeps its pressure except for a leak.

    Only the leak lets the pressure fall.
    """

    SUPPLY = 76_000.0
    """Pressure of the supply, Pa."""
    FILL = 0.8
    """Time constant through the open valve, s."""
    LEAK = 180.0
    """Time constant of the leak, s: about 4 counts a second at the nominal pressure."""
    COUNT = 80.0
    """Pressure of one count of the converter, Pa: 1,000 counts are 80 kPa."""

    def __init__(self, pressure: float) -> None:
        self.pressure = pressure
        self._fill = 1.0 - math.exp(-STEP / self.FILL)
        self._leak = math.exp(-STEP / self.LEAK)

    def step(self, valve: int) -> float:
        """Return the pressure in Pa after one physics step."""
        if valve:
            self.pressure += (self.SUPPLY - self.pressure) * self._fill
        else:
            self.pressure *= self._leak
        return self.pressure

    @property
    def raw(self) -> int:
        return min(1023, int(self.pressure / self.COUNT))


class SuctionCup:
    """The vacuum in the suction cup. It holds a part only while all six points of the lip touch it."""

    SUCTION = 60_000.0
    """Vacuum of the sealed cup, Pa."""
    OPEN_FLOW = 8_000.0
    """Vacuum that the pump draws through an open cup, Pa."""
    LEAKY = 20_000.0
    """Vacuum that a leaky cup reaches, Pa."""
    SWITCH = 30_000.0
    """Vacuum above which the pressure switch passes, Pa."""
    AREA = math.pi * 0.005**2
    """Area within the lip, m2."""
    BUILD, BLEED, VENT = 0.020, 0.150, 0.003
    """Time constants, s: with the valve on; with the valve off and the seal kept, without the release puff; with the
    puff or without a seal."""

    def __init__(self, *, leaky: bool = False) -> None:
        self.vacuum = 0.0
        self.sealed = False
        self._suction = self.LEAKY if leaky else self.SUCTION
        self._build = 1.0 - math.exp(-STEP / self.BUILD)
        self._bleed = math.exp(-STEP / self.BLEED)
        self._vent = math.exp(-STEP / self.VENT)
        self._torn = False

    def tear(self) -> None:
        """Break the seal until the valve is switched off (the fault "dropped-part")."""
        self._torn = True

    def step(self, valve: int, puff: int, touching: bool) -> float:
        """Return the holding force in N after one physics step."""
        if not valve:
            self._torn = False
        self.sealed = sealed = touching and not self._torn
        if puff or not (valve or sealed):
            self.vacuum *= self._vent
        elif valve:
            self.vacuum += ((self._suction if sealed else self.OPEN_FLOW) - self.vacuum) * self._build
        else:
            self.vacuum *= self._bleed
        return self.vacuum * self.AREA if sealed else 0.0

    @property
    def raw(self) -> int:
        """The level of the pressure switch: FAIL = 1, PASS = 0."""
        return 0 if self.vacuum > self.SWITCH else 1
