"""The commands for stations that run: their arguments and where they go."""

from __future__ import annotations

from typing import Annotated

import typer

from .app import Take, _finite, app, guarded

Running = Annotated[
    str, typer.Argument(metavar="STATION", help="Name or pid of a station that runs in real time (see `umo ps`).")
]


@app.command(epilog="Examples: umo mode ztheta  |  umo mode ztheta manual  |  umo mode ztheta automatic --take")
def mode(
    station: Running,
    wanted: Annotated[str | None, typer.Argument(metavar="[automatic|manual]", help="The new mode.")] = None,
    take: Take = False,
) -> None:
    """Show the mode of a running station and who has its lease, or change the mode.

    automatic: the application runs; numbers can be tuned. manual: the application waits, and no time passes for it;
    control laws go on; actuators can be set and actions called. What a hand has begun ends when the mode changes.
    """
    from .commanding import mode as work

    guarded(lambda: work(station, wanted, take))


@app.command(
    epilog="Examples: umo call ztheta  |  umo call ztheta home  |  umo call ztheta z.move_to 'position=100 mm'  |  "
    "umo call ztheta z.jog velocity=5000 --hold 2"
)
def call(
    station: Running,
    action: Annotated[str | None, typer.Argument(metavar="[ACTION]", help="Such as z.move_to.")] = None,
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME=VALUE]...", help="Numbers may have a unit.")
    ] = None,
    hold: Annotated[
        float | None,
        typer.Option(min=0.0, callback=_finite, help="Of a jog: how long it is kept up in s; default: until Ctrl-C."),
    ] = None,
    take: Take = False,
) -> None:
    """Call an action of a running station and wait for its end; without an action, list them. Ctrl-C cancels it."""
    from .commanding import call as work

    guarded(lambda: work(station, action, arguments or [], take, hold))


@app.command(epilog="Examples: umo tune ztheta  |  umo tune ztheta z.servo.gain  |  umo tune ztheta z.servo.gain 0.004")
def tune(
    station: Running,
    path: Annotated[str | None, typer.Argument(metavar="[PATH]", help="Such as z.servo.gain.")] = None,
    value: Annotated[str | None, typer.Argument(metavar="[VALUE]", help="A number, or one with a unit.")] = None,
    take: Take = False,
) -> None:
    """Change a tunable number of a running station, show it, or list them all."""
    from .commanding import tune as work

    guarded(lambda: work(station, path, value, take))


@app.command(epilog="Examples: umo stop ztheta  |  umo stop 4711")
def stop(station: Running) -> None:
    """End a run safely: every actuator goes to its default. It needs no lease."""
    from .commanding import stop as work

    guarded(lambda: work(station))
