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
    "Change the numbers of a machine: tunable numbers, gains of control laws, recipes and kept values.",
    "umo tune number ztheta  |  umo tune law furnace zones.3 --relay 5% --at '3 min' --peak 300  |  "
    "umo tune recipe batch",
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
    value: Annotated[
        str | None, typer.Argument(metavar="[VALUE]", help="New value: a number, with or without a unit.")
    ] = None,
    take: Take = False,
) -> None:
    """Change or show a tunable number of a running station, or list all tunable numbers.

    For the examples, start `umo run ztheta --manual` in another terminal.
    """
    from umo_command.do.commanding import tune

    tune(station, path, value, take)


@command(epilog="Examples: umo tune save ztheta")
def save(station: Running) -> None:
    """Print the numbers that clients tuned in this run, as lines for the wiring.

    Copy the lines into the table `parameters` of the wiring file. A number that is declared with kept=True needs no
    line: the next run begins with its last value.

    For the examples, start `umo run ztheta --manual` in another terminal.
    """
    from umo_command.do.commanding import station_of
    from umo_command.tune.kept import save_tuned

    with station_of(station) as running:
        save_tuned(running.reader)


@command(
    epilog="Examples: umo run conveyor --realtime --until 5  |  umo tune kept conveyor  |  "
    "umo tune kept conveyor --forget sorter.in_bin",
    status="0 done; 2 nothing is kept, a run is using the values, or the command line is wrong (see stderr)",
)
def kept(
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION",
            help="Name or folder of a station, running or not.",
            autocompletion=completion.stations_and_running,
        ),
    ],
    wiring: WiringName = None,
    forget: Annotated[
        str | None,
        typer.Option(
            metavar="PATH", help="Forget the kept value of this number: the next run begins with the default."
        ),
    ] = None,
) -> None:
    """List the values that a station keeps from one run in real time to the next, with their file and age.

    The machine declares these numbers with kept=True. `umo run STATION --fresh` starts without their kept values.
    """
    from umo_command.tune.kept import kept as work

    work(station, wiring, forget)


@command(
    epilog="Examples: umo tune law furnace zones.3 --relay 5% --at '3 min' --peak 300  |  umo tune law furnace zones.3 "
    "--step 10% --within 50 --at '3 min' --peak 300  |  umo run ztheta --record run.mcap  |  "
    "umo tune law ztheta z --file run.mcap --from '5 s'  |  umo tune law ztheta z --moves '20 mm'",
    status="0 gains were found; 1 the experiment or the machine failed; 2 no gains can be found, or the command line "
    "is wrong (see stderr); 130 Ctrl-C: the old output was restored, and the law is in control again",
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
            help="Path of a law, of its sensor or actuator, or of the part that it controls. Without a path the "
            "command lists the laws.",
        ),
    ] = "",
    relay: Annotated[
        str | None,
        typer.Option(
            metavar="AMPLITUDE",
            help="Make a relay experiment with this amplitude, such as 10% (of the actuator's range) or '2 V'.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="AMPLITUDE", help="Make a step experiment with this amplitude; a negative step goes down."
        ),
    ] = None,
    moves: Annotated[
        str | None, typer.Option(metavar="DISTANCE", help="For an axis: move this distance and back, twice.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Read the trace.csv of a run, or a recording (.mcap), instead of making an experiment."
        ),
    ] = None,
    start: From = None,
    stop: To = None,
    at: Annotated[
        float | None, time_option(help="Make the experiment in a separate simulated run, at this time.")
    ] = None,
    hysteresis: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="Hysteresis of the relay, in the sensor's unit; default: estimated from the noise.",
        ),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="Largest change of the measurement, in the sensor's unit; default: a tenth of its range.",
        ),
    ] = None,
    cycles: Annotated[
        int | None, typer.Option(min=2, max=100, help="Number of cycles of the relay experiment; default: 5.")
    ] = None,
    lasting: Annotated[
        float | None, time_option("--for", help="Time limit of the experiment; default: 10 min.")
    ] = None,
    chosen: Annotated[
        str,
        typer.Option(
            "--gains", metavar="NAME", help="Which gains to print: cautious, balanced or quick; default: balanced."
        ),
    ] = "balanced",
    derivative: Annotated[
        bool, typer.Option("--derivative", help="Allow a derivative term, even if the law has none now.")
    ] = False,
    sensor: Annotated[str, typer.Option(metavar="PATH", help="The sensor, if the law does not name one.")] = "",
    actuator: Annotated[str, typer.Option(metavar="PATH", help="The actuator, if the law does not name one.")] = "",
    cascade: Annotated[
        bool,
        typer.Option(
            "--cascade",
            help="Tune the inner law of this law first, then this law with the new inner gains.",
        ),
    ] = False,
    wiring: WiringName = None,
    picture: Annotated[Path | None, out_option("FILE.png", "Draw the result in this file.")] = None,
    as_json: Json = False,
    take: Take = False,
) -> int:
    """Find the gains of a control law, from an experiment or from a recorded run.

    An experiment on a running station needs manual mode and the lease. The output stays within the amplitude around its
    present value. An interlock, a fault, a bad sensor, the end of the lease and Ctrl-C end the experiment. Then the old
    output is restored, and the law is in control again.

    The command prints the gains, and the lines with which you try and keep them. It changes no gain, except with
    --cascade: during the experiment on the outer law, the inner law has its new gains.

    For the example with --moves, start `umo run ztheta --manual` in another terminal, and give `umo do ztheta call
    home`.
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
    status="0 done; 2 the command line or a recipe is wrong (see stderr)",
)
def recipe(
    station: StationName,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Recipe to use for all batches that begin from now on."),
    ] = None,
    take: Take = False,
) -> int:
    """List the recipes of a station with their values, or choose one for the running station.

    The recipe is read and checked immediately, and the machine checks its values again. The machine uses the recipe for
    all batches that begin from now on, also in later runs, until another recipe is chosen or the action follow_plan is
    called.
    """
    from umo_command.station_named import station_named
    from umo_command.tune.recipe_list import choose_recipe, show_recipes

    found = station_named(station)
    return show_recipes(found, str(station)) if name is None else choose_recipe(found, str(station), name, take)
