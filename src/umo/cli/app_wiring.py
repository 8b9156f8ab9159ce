"""The commands for machines, wirings and drivers, and for making new ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import MACHINE_OPTIONS, Acknowledge, HelpPanel, StationName, Take, WiringName, finite

command = HelpPanel("Machines, wirings, drivers")
command_of_new = HelpPanel("New stations and drivers")
STATUS_OF_DEVICES = (
    "0 done; 1 a device failed; 2 a mistake, told on stderr; 3 an actuator is not at its default; 130 Ctrl-C"
)
"""Exit statuses of the commands that open devices."""


@command(
    epilog="Examples: umo check ztheta  |  umo check ztheta -w modbus  |  umo check ztheta --all  |  "
    "umo check furnace --zones 100  |  umo check furnace --target compile",
    status="0 no fault; 2 faults, or a mistake, told on stderr",
    context_settings=MACHINE_OPTIONS,
)
def check(
    context: typer.Context,
    station: StationName,
    wiring: WiringName = None,
    every: Annotated[bool, typer.Option("--all", help="Look at every wiring of the station.")] = False,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="TARGET",
            help="Say also what would not translate to C: for host, cortex-m, avr or arduino (umo generate), or for "
            "compile (compile = true).",
        ),
    ] = None,
) -> int:
    """Find every mistake in a wiring, wrong declarations of the machine, and sequences in its code that nobody awaits,
    without touching hardware.

    Without -w it looks at the first wiring (simulated), and names those that it did not look at. Options of the machine
    follow the station's name.
    """
    from umo.process.station import find

    from .check import check_station

    return check_station(find(station), wiring, every, context.args, target)


@command(
    epilog="Examples: umo generate ztheta --target host -o controller  |  umo generate furnace --zones 3 --target "
    "cortex-m -o firmware  |  umo generate my-machine -w bench --target arduino -o sketch",
    status="0 done; 2 something does not translate, or another mistake, told on stderr",
    context_settings=MACHINE_OPTIONS,
)
def generate(
    context: typer.Context,
    station: StationName,
    target: Annotated[str, typer.Option(metavar="TARGET", help="host, cortex-m, avr or arduino.")],
    folder: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="The folder that is written.")],
    wiring: WiringName = None,
    real: Annotated[
        str | None, typer.Option(metavar="double|float", help="Numbers; default: double, on avr and arduino float.")
    ] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only the part that runs on this controller of the wiring.")
    ] = None,
) -> int:
    """Write the controller of a machine in C: objects, interlocks, rates, expiry and control laws, without a heap and
    without hardware, with a loop and a watchdog around it.

    Scales, ranges and defaults are those of the wiring, numbers those of the machine with its parameters. No device is
    opened. Everything that has no C is told at once, with file and line, and nothing is written. What a user has filled
    in, io_board.c and the Makefile, is not written over. With `--controller` the code is that of one part, and its host
    is at the other end of a line (docs/howto-split.md). Sequences stay on the host. Options of the machine follow the
    station's name.
    """
    from umo.process.station import find

    from .generate_controller import generate_controller

    return generate_controller(find(station), wiring, target, real, folder, context.args, controller)


@command(
    epilog="Examples: umo recipes batch  |  umo recipes batch paint",
    status="0 done; 2 a mistake, told on stderr",
)
def recipes(
    station: StationName,
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="The recipe that the running station takes next.")
    ] = None,
    take: Take = False,
) -> int:
    """List the recipes of a station with their values, or choose one for the next batch of the running station.

    A recipe that is chosen is read and checked now. The machine checks its values again, and takes it with the next
    batch.
    """
    from umo.process.station import find

    from .recipe_list import choose_recipe, show_recipes

    found = find(station)
    return show_recipes(found, str(station)) if name is None else choose_recipe(found, str(station), name, take)


@command(
    epilog="Examples: umo tree ztheta  |  umo tree ztheta z -w second_generation  |  umo tree furnace --zones 3 --all  "
    "|  umo tree conveyor --period",
    context_settings={"ignore_unknown_options": True},
)
def tree(
    station: StationName,
    words: Annotated[
        list[str] | None, typer.Argument(metavar="[PATH]", help="An object or a list of the machine, such as z.")
    ] = None,
    wiring: WiringName = None,
    everything: Annotated[bool, typer.Option("--all", help="Show every member of a list.")] = False,
    period: Annotated[
        bool, typer.Option("--period", help="Show the phases of a period instead, and who acts in each.")
    ] = False,
) -> int:
    """Show the hierarchy of objects with units, ranges and wiring (the paper's Figure 4).

    Three or more like members of a list are shown once: with the parts of the first, and the wires of the first and
    the last. Members that differ are shown by themselves. Options of the machine follow the station's name.
    """
    from umo.process.station import find

    if period:
        from .period_table import show_period

        return show_period(find(station), wiring, words or [])
    from .tree import show_tree

    return show_tree(find(station), wiring, words or [], everything)


@command(
    epilog="Examples: umo get ztheta z.encoder  |  umo get ztheta z.encoder gripper.pressure --unit mm",
    status=STATUS_OF_DEVICES,
    context_settings={"ignore_unknown_options": True},
)
def get(
    station: StationName,
    paths: Annotated[
        list[str],
        typer.Argument(metavar="PATH...", help="Objects, such as z.encoder; of a station that runs also signals."),
    ],
    wiring: WiringName = None,
    unit: Annotated[str | None, typer.Option(help="Show digital values in this unit.")] = None,
    acknowledge: Acknowledge = False,
) -> None:
    """Read objects by path: from the frames if the station is running, wherever its folder is (its pid, where several
    runs go on), and there signals and tunable numbers too.

    Otherwise its devices are opened for this reading: every actuator goes to its default before and after it. Below a
    sensor stands what its circuit holds, if its driver says so, such as registers in each order of their bytes. Options
    of the machine follow the station's name.
    """
    from .get_set import get_values

    get_values(station, wiring, paths, unit, acknowledge)


@command(
    "set",
    epilog="Examples: umo set ztheta gripper.vacuum ON --hold 2  |  umo set ztheta z.motor '-500 mV' --hold 1",
    status="0 done; 1 a device failed; 2 a mistake, or it is held no longer, told on stderr; 3 an actuator is not at "
    "its default; 130 Ctrl-C, but 0 where it is held until Ctrl-C",
    context_settings=MACHINE_OPTIONS,
)
def set_(
    context: typer.Context,
    station: StationName,
    path: Annotated[str, typer.Argument(help="An actuator, such as gripper.vacuum.")],
    value: Annotated[str, typer.Argument(help="A state (ON), a number, or a number with a unit ('80 mm').")],
    wiring: WiringName = None,
    hold: Annotated[
        float | None, typer.Option(min=0.0, callback=finite, help="Hold time in s; default: until Ctrl-C.")
    ] = None,
    acknowledge: Acknowledge = False,
    take: Take = False,
) -> int:
    """Write and hold one actuator, show its value, then reset it.

    Of a station that runs, the actuator is taken from the application; that needs its manual mode (`umo mode`). Of one
    that does not run, its devices are opened for this write: every actuator goes to its default before and after it,
    and no control code runs. Where several runs of it go on, give the pid of one. Options of the machine follow the
    value.
    """
    from .get_set import set_value

    return set_value(station, wiring, path, value, hold, acknowledge, take, context.args)


@command(
    epilog="Examples: umo drivers  |  umo drivers modbus  |  umo drivers .card:Card  |  "
    "umo drivers fmu --model tank.fmu",
    context_settings=MACHINE_OPTIONS,
)
def drivers(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="A driver: its name, module:Class, or .module:Class for a module of the station in this folder.",
        ),
    ] = None,
) -> None:
    """List the drivers, or describe one: its options, channels and functions.

    Some drivers know their channels only with their options; give these after the name.
    """
    from .describe import show_driver, show_drivers

    if name is None:
        show_drivers()
    else:
        show_driver(name, context.args)


@command(
    epilog="Examples: umo conform oven/wiring/modbus.toml  |  umo conform oven -w modbus --only coil:3 --yes  |  "
    "umo conform oven -w bench --loopback dac:0=adc:0",
    status="0 every rule was kept; 1 a rule is broken, or a device failed; 2 a mistake, or no consent; 3 no rule is "
    "broken, but the line could not be disturbed, or something was left out for want of time; 130 Ctrl-C",
    context_settings=MACHINE_OPTIONS,
)
def conform(
    context: typer.Context,
    target: Annotated[
        str, typer.Argument(metavar="WIRING|STATION", help="A wiring file of a station, or a station (with -w).")
    ],
    wiring: WiringName = None,
    driver: Annotated[
        str | None, typer.Option(metavar="NAME", help="The driver to test; default: the only one with hardware.")
    ] = None,
    loopback: Annotated[
        list[str] | None,
        typer.Option(metavar="OUT=IN", help="The input that reads the level of an output. Can be repeated."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="Use this channel or object, and no others. Can be repeated."),
    ] = None,
    refused: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="A channel that the device refuses: its text. Can be repeated."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(min=0.0, callback=finite, help="Of loop-backs, in the unit of the output.")
    ] = 0.0,
    steady: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="An input that does not change by itself meanwhile. Can be repeated."),
    ] = None,
    unstructured: Annotated[
        bool, typer.Option("--unstructured", help="Any bytes are an answer of this device: no header, no line end.")
    ] = False,
    sole_writer: Annotated[
        bool, typer.Option("--sole-writer", help="Nobody else writes: the driver may keep a copy of a shared register.")
    ] = False,
    minutes: Annotated[float, typer.Option(min=0.05, callback=finite, help="What it may take.")] = 2.0,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the certificate to this file.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Drive the outputs without asking.")] = False,
    acknowledge: Acknowledge = False,
) -> int:
    """Prove that a driver keeps its contract, with its device.

    The outputs are driven over the ranges of their objects, after you have agreed to it; all go to their defaults at
    the end. A driver with the options host and port, or serial, is also tested with a disturbed line to its device.
    """
    from .conform import Choice, conform_wiring

    choice = Choice(
        driver=driver,
        only=only or (),
        loopbacks=loopback or (),
        refused=refused or (),
        steady=steady or (),
        structured=not unstructured,
        sole_writer=sole_writer,
        tolerance=tolerance,
        minutes=minutes,
        json=json_file,
        yes=yes,
        acknowledge=acknowledge,
    )
    return conform_wiring(target, wiring, choice, context.args)


@command_of_new(epilog="Examples: umo new my-machine && umo run my-machine")
def new(directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")]) -> None:
    """Create a small working station with tests."""
    from .new import make_station

    make_station(directory)


@command_of_new(
    "new-driver",
    epilog="Examples: umo new-driver my_card && pytest test_my_card.py  |  umo new-driver my_drive --serial",
)
def new_driver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_card.")],
    tcp: Annotated[bool, typer.Option("--tcp", help="For a device on the network, with binary frames.")] = False,
    serial: Annotated[bool, typer.Option("--serial", help="The same on a serial line.")] = False,
) -> None:
    """Create a driver with its tests in this folder: NAME.py and test_NAME.py.

    The driver works at once, with a device in memory; with --tcp or --serial with a device in a process of its own,
    NAME_device.py. Its tests run the conformance kit, which proves that a driver keeps the contract, and disturbs the
    line. Replace the device by the real one; the tests stay.
    """
    from .new import make_driver

    make_driver(name, Path.cwd(), ["tcp"] * tcp + ["serial"] * serial)
