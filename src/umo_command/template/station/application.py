"""The application: the work of the machine in one `umo run`."""

from .control import Tank

from umo.control import wait


async def main(m: Tank, target: float = 300.0) -> None:
    """Fill, keep the level for a while, drain.

    Options:
        target: level, mm.
    """
    m.cycle.progress("filling")
    await m.fill(target)
    m.cycle.progress("keeping the level")
    await wait("20 s")
    m.cycle.progress("draining")
    await m.empty(50.0)
    m.cycle.progress("done")
