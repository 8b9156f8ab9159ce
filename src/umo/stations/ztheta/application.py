"""The application that picks parts, turns each by 90 degrees, and places them."""

from .control import Manipulator


async def main(m: Manipulator, parts: int = 3, start: float = -45.0, turn: float = 90.0) -> dict[str, int] | None:
    """Home the axes, then pick, turn and place each part. Return the number of parts that were placed without the puff
    of pressure, if there were any.

    Options:
        parts: number of parts.
        start: angle at which the parts are picked, deg.
        turn: angle by which the parts are turned, deg.
    """
    m.cycle.progress("homing", done=0, total=parts)
    await m.home()
    for number in range(1, parts + 1):
        part = f"part {number} of {parts}"
        m.cycle.progress(f"{part}: waiting for the courier")
        await m.ready(start)
        m.cycle.progress(f"{part}: picking")
        await m.pick()
        m.cycle.progress(f"{part}: turning")
        await m.theta.move_to(start + turn)
        m.cycle.progress(f"{part}: placing")
        await m.place()
        m.cycle.progress(f"{part}: placed", done=number)
    m.cycle.progress("done")
    await m.z.move_to(m.transit_height)
    return {"placed_without_puff": m.unblown} if m.unblown else None
