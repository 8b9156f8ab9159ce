"""`umo tune`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import From, Json, Running, StationName, Take, To, WiringName, out_option, time_option
from umo_command.shared import finite, group

command = group(
    "tune",
    "Develop",
    "Change the numbers of a machine: tunable numbers, the gains of its laws, recipes, and kept values.",
    "umo tune number ztheta  |  umo tune law furnace zones.3 --relay 10%  |  umo tune recipe batch",
)


@command(
    epilog="Examples: umo tune number ztheta  |  umo tune number ztheta z.servo.gain  |  "
    "umo tune number ztheta z.servo.gain 0.004"
)
def number(
    station: Running,
    path: Annotated[
        str | None,
        typer.Argument(
            metavar="[PATH]", help="Path of a number, such as z.servo.gain.", autocompletion=completion.numbers
        ),
    ] = None,
    value: Annotated[str | None, typer.Argument(metavar="[VALUE]", help="A number, or one with a unit.")] = None,
    take: Take = False,
) -> None:
    """Change a tunable number of a running station, show it, or list them all."""
    from umo_command.do.commanding import tune

    tune(station, path, value, take)


@command(epilog="Examples: umo tune save ztheta")
def save(station: Running) -> None:
    """Print the lines of a wiring for the numbers that were tuned in this run, by any client. They belong in the table
    `parameters` of the wiring file. A number that is declared kept needs no line there: the next run begins with its
    last value.
    """
    from umo_command.do.commanding import station_of
    from umo_command.tune.kept import save_tuned

    with station_of(station) as running:
        save_tuned(running.reader)


@command(
    epilog="Examples: umo tune kept press  |  umo tune kept press -w modbus  |  umo tune kept press --forget count",
    status="0 done; 2 a mistake, nothing is kept, or a run is using it, see stderr",
)
def kept(
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION",
            help="Name or folder of a station; it need not run.",
            autocompletion=completion.stations_and_running,
        ),
    ],
    wiring: WiringName = None,
    forget: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="Forget the kept value of this number, so that it has its default again."),
    ] = None,
) -> None:
    """List the values that a station keeps from one run in real time to the next, with their file and age. They are
    declared with kept=True. `umo run STATION --fresh` starts without them.
    """
    from umo_command.tune.kept import kept as work

    work(station, wiring, forget)


@command(
    epilog="Examples: umo tune law furnace zones.3 --relay 10%  |  umo tune law furnace zones.3 --step 10% --within 50"
    "  |  umo tune law furnace zones.3 --relay 5% --at '3 min' --peak 300  |  umo tune law furnace zones.3 --file "
    "trace.csv --from '2 min'  |  umo tune law ztheta z --moves '20 mm'  |  umo tune law ztheta z --file run.mcap",
    status="0 gains were found; 1 the experiment or the machine failed; 2 a mistake, or no gains can be found, "
    "see stderr; 130 Ctrl-C: the old output is restored, and the law is in control",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def law(
    context: typer.Context,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION",
            help="Name, folder or pid of a station, running or not.",
            autocompletion=completion.stations_and_running,
        ),
    ],
    path: Annotated[
        str,
        typer.Argument(
            metavar="[LAW]",
            help="Path of a law, of its sensor or actuator, or of the part that it is for; without it the laws are "
            "listed.",
        ),
    ] = "",
    relay: Annotated[
        str | None,
        typer.Option(metavar="AMPLITUDE", help="Relay experiment: such as 10% of the actuator's range, or '2 V'."),
    ] = None,
    step: Annotated[
        str | None, typer.Option(metavar="AMPLITUDE", help="Step experiment; a negative step goes down.")
    ] = None,
    moves: Annotated[
        str | None, typer.Option(metavar="DISTANCE", help="For an axis: move this distance and back, twice.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Use the trace.csv of a run, or a recording (.mcap), instead of an experiment."
        ),
    ] = None,
    start: From = None,
    stop: To = None,
    at: Annotated[
        float | None, time_option(help="Make the experiment at this time of a simulated run of its own.")
    ] = None,
    hysteresis: Annotated[
        float | None,
        typer.Option(
            min=0.0, callback=finite, help="Hysteresis of the relay, in the sensor's units; default: from the noise."
        ),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="Largest change of the measurement, in the sensor's units; default: a tenth of its range.",
        ),
    ] = None,
    cycles: Annotated[
        int | None, typer.Option(min=2, max=100, help="Number of cycles of the relay; default: 5.")
    ] = None,
    lasting: Annotated[
        float | None, time_option("--for", help="Time limit of the experiment; default: 10 min.")
    ] = None,
    chosen: Annotated[
        str, typer.Option("--gains", metavar="NAME", help="Which gains to print: cautious, balanced or quick.")
    ] = "balanced",
    derivative: Annotated[
        bool, typer.Option("--derivative", help="Allow a derivative, even if the law has none now.")
    ] = False,
    sensor: Annotated[str, typer.Option(metavar="PATH", help="The sensor, if the law does not name one.")] = "",
    actuator: Annotated[str, typer.Option(metavar="PATH", help="The actuator, if the law does not name one.")] = "",
    cascade: Annotated[
        bool,
        typer.Option(
            "--cascade",
            help="For an outer law: tune first its inner law, then, with the new inner gains, the outer one.",
        ),
    ] = False,
    wiring: WiringName = None,
    picture: Annotated[Path | None, out_option("FILE.png", "Draw the result.")] = None,
    as_json: Json = False,
    take: Take = False,
) -> int:
    """Find the gains of a control law, from an experiment or from a recorded run. The experiment needs manual mode and
    the lease. The output stays within the amplitude around its present value. An interlock, a fault, a bad sensor, the
    end of the lease and Ctrl-C end the experiment. Then the old output is restored, and the law is in control. The
    command does not change the gains: it prints lines to try and to keep them. Only `--cascade` sets the new gains of
    the inner law during the experiment on the outer one.
    """
    from umo_command.tune.law import TuningOrder
    from umo_command.tune.law import tune_law as work

    order = TuningOrder(
        relay, step, moves, file, start, stop, at, hysteresis, within, cycles, lasting, chosen, derivative, sensor,
        actuator, wiring, picture, as_json, take, cascade,
    )  # fmt: skip
    options = context.args
    if path.startswith("-"):  # an option of the station, and no law
        path, options = "", [path, *options]
    return work(station, path, order, options)


@command(
    epilog="Examples: umo tune recipe batch  |  umo tune recipe batch paint",
    status="0 done; 2 a mistake, see stderr",
)
def recipe(
    station: StationName,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="The recipe of all batches that begin from now on."),
    ] = None,
    take: Take = False,
) -> int:
    """List the recipes of a station with their values, or choose one for the running station.

    The chosen recipe is read and checked now. The machine checks its values again, and uses it for all batches that
    begin from now on, also in later runs, until another one is chosen or its action follow_plan is called.
    """
    from umo.process.station import find
    from umo_command.tune.recipe_list import choose_recipe, show_recipes

    found = find(station)
    return show_recipes(found, str(station)) if name is None else choose_recipe(found, str(station), name, take)
