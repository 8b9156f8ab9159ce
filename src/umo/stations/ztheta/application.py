"""Pick parts, turn each by 90 degrees, place them."""

from .control import Manipulator


async def main(m: Manipulator, parts: int = 3, start: float = -45.0, turn: float = 90.0) -> None:
    """Home, then serve `parts` parts: picked at the angle `start`, turned by `turn` (both deg), placed."""
    m.parts_total = parts
    m.task = "homing"
    await m.home()
    for number in range(1, parts + 1):
        part = f"part {number} of {parts}"
        m.task = f"{part}: waiting for the courier"
        await m.ready(start)
        m.task = f"{part}: picking"
        await m.pick()
        m.task = f"{part}: turning"
        await m.theta.move_to(start + turn)
        m.task = f"{part}: placing"
        await m.place()
        m.placed = number
    m.task = "done"
    await m.z.move_to(m.transit_height)
