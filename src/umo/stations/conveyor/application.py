"""Sort parts by length."""

from umo.control import until
from umo.errors import RangeError

from .control import Conveyor, Part


async def main(
    m: Conveyor, parts: int = 10, speed: float = 0.3, nominal: float = 80.0, tolerance: float = 4.0
) -> dict[str, object]:
    """Sort parts by length: those within the tolerance stay on the belt, the others are pushed onto the chute. Returns
    how many of each, and the lengths in mm.

    Options:
        parts: how many.
        speed: of the belt, m/s.
        nominal: length, mm.
        tolerance: largest deviation of an accepted part from it, mm.

    RangeError if the belt moves by more than half of the tolerance in a period: a length is measured no better.
    """
    step = 1000.0 * speed * m.cycle.period
    if not 0 < step <= tolerance / 2:
        raise RangeError(f"{speed:g} m/s is {step:g} mm in a period: it must be above 0, at most {tolerance / 2:g} mm")
    m.cycle.progress("waiting for the first part", done=0, total=parts)
    m.begin(speed)
    measured: list[Part] = []
    for number in range(1, parts + 1):
        part = await m.next_part()
        part.accepted = abs(part.length - nominal) <= tolerance
        measured.append(part)
        m.cycle.progress(f"part {number} of {parts}: {part.length:.1f} mm", done=sum(each.gone for each in measured))
    await until(lambda: all(part.gone for part in measured))
    m.cycle.progress("stopping the belt", done=parts)
    await m.belt.halt()
    m.cycle.progress("done")
    accepted = sum(part.accepted for part in measured)
    lengths = [round(part.length, 1) for part in measured]
    return {"accepted": accepted, "rejected": parts - accepted, "lengths_mm": lengths}
