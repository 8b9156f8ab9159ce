"""The command `umo tune-law`: its arguments and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import HelpPanel, Take, WiringName, finite

command = HelpPanel("Running stations")


@command(
    "tune-law",
    epilog="Examples: umo tune-law furnace zones.3 --relay 10%  |  umo tune-law furnace zones.3 --step 10% --within 50"
    "  |  umo tune-law furnace zones.3 --relay 10% --at '5 min' --peak 300  |  umo tune-law furnace zones.3 --from "
    "trace.csv --start '2 min'  |  umo tune-law ztheta z --moves '20 mm'  |  umo tune-law ztheta z --from run.mcap",
    status="0 gains were found; 1 the experiment or the machine failed; 2 a mistake, or nothing can be learnt, told on "
    "stderr; 130 Ctrl-C: the old output is back, and the law in control",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def tune_law(
    context: typer.Context,
    station: Annotated[str, typer.Argument(metavar="STATION", help="Name, folder or pid; it may run, or not.")],
    law: Annotated[
        str,
        typer.Argument(metavar="LAW", help="Path of a law, of its sensor or actuator, or of the part that it is for."),
    ],
    relay: Annotated[
        str | None,
        typer.Option(metavar="AMPLITUDE", help="Relay experiment: such as 10% of the actuator's range, or '2 V'."),
    ] = None,
    step: Annotated[
        str | None, typer.Option(metavar="AMPLITUDE", help="Step experiment; a negative step goes down.")
    ] = None,
    moves: Annotated[
        str | None, typer.Option(metavar="DISTANCE", help="Of an axis: move so far and back, twice.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option("--from", metavar="FILE", help="No experiment: the trace.csv of a run, or a recording (.mcap)."),
    ] = None,
    start: Annotated[str | None, typer.Option(metavar="TIME", help="With --from: begin here.")] = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="With --from: end here.")] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Make the experiment at this time of a simulated run of its own, such as '5 min'."
        ),
    ] = None,
    hysteresis: Annotated[
        float | None,
        typer.Option(min=0.0, callback=finite, help="Of the relay, in the sensor's units; default: by the noise."),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="By how much the measurement may move, in the sensor's units; default: a tenth of its range.",
        ),
    ] = None,
    cycles: Annotated[int | None, typer.Option(min=2, max=100, help="Of the relay; default: 5.")] = None,
    lasting: Annotated[
        str | None, typer.Option("--for", metavar="TIME", help="The experiment ends after this time; default: 10 min.")
    ] = None,
    chosen: Annotated[
        str, typer.Option("--set", metavar="NAME", help="The gains to tell: cautious, balanced or quick.")
    ] = "balanced",
    derivative: Annotated[
        bool, typer.Option("--derivative", help="The gains may have a derivative, also if the law has none now.")
    ] = False,
    sensor: Annotated[str, typer.Option(metavar="PATH", help="Of a law that does not know its sensor.")] = "",
    actuator: Annotated[str, typer.Option(metavar="PATH", help="Of a law that does not know its actuator.")] = "",
    cascade: Annotated[
        bool,
        typer.Option(
            "--cascade", help="Of an outer law: first its inner law, then, with the new inner gains, the outer one."
        ),
    ] = False,
    wiring: WiringName = None,
    picture: Annotated[Path | None, typer.Option("--out", metavar="FILE.png", help="Draw the result.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
    take: Take = False,
) -> int:
    """Find the gains of a control law, from an experiment on it or from what was recorded.

    The experiment needs manual mode and the lease. It keeps within the amplitude around the present output; an
    interlock, a fault, a bad sensor, the end of the lease and Ctrl-C end it. Then the old output is back, and the law
    in control. Nothing is changed: the lines that are printed try the gains, and keep them. `--cascade` tries those of
    the inner law meanwhile.
    """
    from .tune_law import TuningOrder
    from .tune_law import tune_law as work

    order = TuningOrder(
        relay, step, moves, file, start, stop, at, hysteresis, within, cycles, lasting, chosen, derivative, sensor,
        actuator, wiring, picture, as_json, take, cascade,
    )  # fmt: skip
    return work(station, law, order, context.args)
