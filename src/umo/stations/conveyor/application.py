"""Sort parts by length."""

from umo import Range
from umo.control import until
from umo.errors import CommandRefused, RangeError, TimeExpired
from umo.operation import PackMLState

from .control import Conveyor, Lot
from .errors import PartsLost

STANDING = (PackMLState.STOPPED, PackMLState.IDLE, PackMLState.SUSPENDED, PackMLState.ABORTED)
"""The states in which the sorter waits for an operator. In Held it waits because the operator has requested this."""
RESTING = (*STANDING, PackMLState.COMPLETE)


async def main(
    m: Conveyor,
    parts: int = 10,
    speed: float = 0.3,
    nominal: float = 80.0,
    tolerance: float = 4.0,
    patience: float = 60.0,
) -> dict[str, object]:
    """Sort parts by length: parts within the tolerance stay on the belt, other parts are pushed onto the chute. Returns
    the numbers of both, and the lengths in mm.

    Options:
        parts: number of parts.
        speed: speed of the belt, m/s.
        nominal: nominal length of a part, mm.
        tolerance: largest deviation of an accepted part from this length, mm.
        patience: time in s within which an operator must continue after a fault, a stop, or a lack of parts.

    Raises RangeError if the drive does not have this speed, or if the belt moves by more than half of the tolerance in
    a period, which limits the accuracy of a measured length. Raises PartsLost if not all parts were sorted.
    """
    Range.of(m.sorter.belt.setpoint).check("speed", speed)
    step = 1000.0 * speed * m.cycle.period
    if not 0 < step <= tolerance / 2:
        raise RangeError(f"{speed:g} m/s is {step:g} mm in a period: it must be above 0, at most {tolerance / 2:g} mm")
    m.cycle.progress("waiting for the first part", done=0, total=parts)
    lot = m.sorter.lot = Lot(parts, speed, nominal, tolerance)
    m.cycle.result(lambda: report(lot))  # also of a lot that is stopped
    await start(m)
    await complete(m, patience)
    m.cycle.progress("done")
    return report(lot)


def report(lot: Lot) -> dict[str, object]:
    """Return the results of the sorting so far."""
    accepted = sum(part.accepted for part in lot.measured)
    lengths = [round(part.length, 1) for part in lot.measured]
    return {"accepted": accepted, "rejected": lot.done - accepted, "lengths_mm": lengths}


async def start(m: Conveyor) -> None:
    """Reset and start the sorter, as an operator would. If this is refused, the operator must act."""
    unit = m.sorter.unit
    try:
        unit.reset()
        await until(lambda: unit.state is PackMLState.IDLE)
        unit.start()
    except CommandRefused as refused:
        m.cycle.progress(str(refused))


async def complete(m: Conveyor, patience: float) -> None:
    """Wait until the sorter is complete. Raises PartsLost if the sorter stands for longer than `patience` in s."""
    unit, lot = m.sorter.unit, m.sorter.lot
    while unit.state is not PackMLState.COMPLETE:
        await until(lambda: unit.state in RESTING)
        try:
            await until(lambda: unit.state not in STANDING, timeout=patience)
        except TimeExpired:
            left = f"{lot.parts - lot.done} of {lot.parts} parts were not sorted"
            raise PartsLost(f"{m.sorter.cause} ({left})") from None
