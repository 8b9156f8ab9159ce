"""The circuits and pneumatics of the plant: quadrature counters, step drive, counterbalance, gripper.

Plain first-order models advanced by the physics step, in raw levels and SI units. Nothing here knows MuJoCo.
"""

from __future__ import annotations

import math

STEP = 0.001
"""Physics step, s. Every period is a whole multiple of it."""


class EncoderCounter:
    """A quadrature counter: 0 at power-up, wraps at its width, loads `preset` at the index pulse while enabled.

    `resolution` and `origin` place the encoder's lines (line n begins at `origin + n * resolution`); the index
    pulse stands on the line `index` and is seen in both directions.
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
        """Switch the circuit on, which loses the position: the count is 0 at any place."""
        self._line = math.floor((position - self._origin) / self._resolution)
        self._offset = -self._line
        self.raw = 0

    def follow(self, position: float, index_enabled: int) -> None:
        """Count up or down to the position; the index is passed if its line lies between the last position and this
        one."""
        line = math.floor((position - self._origin) / self._resolution)
        if self.dead:
            return
        if index_enabled and (self._line <= self._index <= line or line <= self._index <= self._line):
            self._offset = self._loaded
        self._line = line
        self.raw = (line + self._offset + self._half) % self._span - self._half


class StepDrive:
    """A step-and-direction drive and its motor: `TORQUE * sin(TEETH * (field - rotor))`.

    1,600 steps a revolution (0.225 deg), 32 to an electrical cycle of 7.2 deg.
    """

    TORQUE = 0.0135
    """Holding torque, N m: with the rotor's 0.00041 kg m2 it pulls in at about 350 steps/s, no faster."""
    TEETH = 50
    STEPS = 1600

    def __init__(self, rotor: float) -> None:
        angle = 2.0 * math.pi / self.STEPS
        # The driver powers up in the phase nearest to the rotor.
        self._angle = angle
        self._field = round(rotor / angle) * angle

    def torque(self, steps: int, rotor: float) -> float:
        """Torque in N m on the rotor (at the angle `rotor`, rad) after this number of further steps; positive turns
        theta up."""
        self._field += steps * self._angle
        return self.TORQUE * math.sin(self.TEETH * (self._field - rotor))


class Counterbalance:
    """The counterbalance cylinder behind its valve. Open, it fills; closed, it keeps its pressure except for a leak.

    Nothing lets the pressure fall faster than the leak does.
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
        """The pressure switch: FAIL = 1, PASS = 0."""
        return 0 if self.vacuum > self.SWITCH else 1
