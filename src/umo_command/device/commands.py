"""`umo device`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import (
    MACHINE_OPTIONS,
    Acknowledge,
    Faults,
    FaultSeed,
    Held,
    Help,
    OptionalStation,
    StationName,
    Take,
    WiringName,
    out_option,
    time_option,
)
from umo_command.run.commands import injected, named
from umo_command.shared import finite, group

STATUS_OF_DEVICES = (
    "0 done; 1 a device failed; 2 the command line, the wiring or a declaration is wrong (see stderr); 3 an actuator "
    "is not at its default; 130 Ctrl-C"
)
"""Exit statuses of the commands that open devices."""
command = group(
    "device",
    "Develop",
    "Try devices and drivers by hand: read and write single objects, test a driver, serve a plant in place of a "
    "device.",
    "umo device get ztheta z.encoder  |  umo device drivers modbus  |  umo device plant ztheta",
)


@command(
    epilog="Examples: umo device get ztheta z.encoder  |  umo device get ztheta z.encoder gripper.pressure --unit mm",
    status=STATUS_OF_DEVICES,
    context_settings={"ignore_unknown_options": True},
)
def get(
    station: StationName,
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="PATH...",
            help="Paths of objects, such as z.encoder; if the station runs, also of signals and tunable numbers.",
            autocompletion=completion.paths,
        ),
    ],
    wiring: WiringName = None,
    unit: Annotated[str | None, typer.Option(help="Show digital values in this unit.")] = None,
    acknowledge: Acknowledge = False,
) -> None:
    """Read objects by path.

    If the station runs, its live values are read. If several runs of the station are active, give the pid of one. If
    the station does not run, this command opens its devices, sets every actuator to its default, reads, and sets every
    actuator to its default again.

    If the driver supports it, the line after a sensor's value shows the raw content of its circuit, such as registers
    in each byte order. Options of the machine follow the station's name.
    """
    from umo_command.device.get_set import get_values

    get_values(station, wiring, paths, unit, acknowledge)


@command(
    "set",
    epilog="Examples: umo device set ztheta gripper.vacuum ON --for 2  |  "
    "umo device set ztheta z.motor '-500 mV' --for 1",
    status="0 done; 1 a device failed; 2 the command line, the wiring or a declaration is wrong, or the hold ended "
    "early (see stderr); 3 an actuator is not at its default; 130 Ctrl-C (0 if Ctrl-C ended a hold without --for)",
    context_settings=MACHINE_OPTIONS,
)
def set_(
    context: typer.Context,
    station: StationName,
    path: Annotated[
        str,
        typer.Argument(metavar="PATH", help="An actuator, such as gripper.vacuum.", autocompletion=completion.paths),
    ],
    value: Annotated[
        str, typer.Argument(metavar="VALUE", help="A state (ON), a number, or a number with a unit ('80 mm').")
    ],
    wiring: WiringName = None,
    held: Held = None,
    acknowledge: Acknowledge = False,
    take: Take = False,
) -> int:
    """Write one actuator, hold and show its value, then reset the actuator.

    If the station runs, this command takes the actuator from the application, which needs manual mode (`umo do STATION
    mode manual`). If several runs of the station are active, give the pid of one.

    If the station does not run, this command opens its devices, sets every actuator to its default, writes and holds
    this actuator, and sets every actuator to its default again. No control code of the station runs meanwhile. Options
    of the machine follow the value.
    """
    from umo_command.device.get_set import set_value

    return set_value(station, wiring, path, value, held, acknowledge, take, context.args)


@command(
    epilog="Examples: umo device drivers  |  umo device drivers modbus  |  umo new driver my_card  |  "
    "umo device drivers my_card:MyCard",
    context_settings=MACHINE_OPTIONS,
)
def drivers(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            autocompletion=completion.drivers,
            help="Name of a driver, or module:Class, or .module:Class for a module of the station in the current "
            "folder.",
        ),
    ] = None,
) -> None:
    """List the drivers, or show the options, channels and functions of one driver.

    Some drivers can list their channels only with their options. Give the options after the name.
    """
    from umo_command.device.drivers import show_driver, show_drivers

    if name is None:
        show_drivers()
    else:
        show_driver(name, context.args)


@command(
    epilog="Examples: umo device conform ztheta -w modbus  |  "
    "umo device conform ztheta -w modbus --only coil:5 --yes  |  "
    "umo device conform ztheta -w modbus --for '5 min' --out certificate.json",
    status="0 every rule was kept; 1 a rule is broken, or a device failed; 2 the command line or the wiring is wrong, "
    "or you did not agree; 3 no rule is broken, but the line could not be disturbed, or the time was too short for "
    "all rules; 130 Ctrl-C",
    context_settings=MACHINE_OPTIONS,
)
def conform(
    context: typer.Context,
    target: Annotated[
        str,
        typer.Argument(
            metavar="STATION|WIRING",
            help="A station (with -w), or a wiring file of a station.",
            autocompletion=completion.stations,
        ),
    ],
    wiring: WiringName = None,
    driver: Annotated[
        str | None, typer.Option(metavar="NAME", help="Driver to test; default: the only driver with hardware.")
    ] = None,
    loopback: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OUT=IN",
            help="An output, and an input that reads the level of this output. Each needs an object. May be repeated.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="Channel or object to use; default: all of the driver. May be repeated."),
    ] = None,
    refused: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="Channel that the device is expected to refuse. May be repeated."),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=0.0, callback=finite, help="Tolerance of loop-backs, in the unit of the output; default: 0."),
    ] = 0.0,
    steady: Annotated[
        list[str] | None,
        typer.Option(metavar="CHANNEL", help="Input that does not change by itself during the test. May be repeated."),
    ] = None,
    unstructured: Annotated[
        bool,
        typer.Option(
            "--unstructured",
            help="Declare that any bytes are a valid answer of this device, because an answer has no "
            "header and no line end.",
        ),
    ] = False,
    sole_writer: Annotated[
        bool,
        typer.Option(
            "--sole-writer",
            help="Declare that no other client writes to the device, so that the driver may keep a copy "
            "of a shared register.",
        ),
    ] = False,
    lasting: Annotated[float, time_option("--for", help="Time limit; default: 2 min.")] = 120.0,
    out: Annotated[Path | None, out_option("FILE.json", "Write the certificate to this file.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Drive the outputs without asking.")] = False,
    acknowledge: Acknowledge = False,
) -> int:
    """Test a driver with its device: does the driver keep the contract for drivers?

    The command asks before it drives the outputs over the ranges of their objects. At the end all outputs go to their
    defaults. If the driver has the options host and port, or serial, the line to its device is also disturbed.

    For the examples, start `umo device plant ztheta` in another terminal: the devices of this wiring.
    """
    from umo_command.device.conform import Choice, conform_wiring

    choice = Choice(
        driver=driver,
        only=only or (),
        loopbacks=loopback or (),
        refused=refused or (),
        steady=steady or (),
        structured=not unstructured,
        sole_writer=sole_writer,
        tolerance=tolerance,
        minutes=lasting / 60,
        json=out,
        yes=yes,
        acknowledge=acknowledge,
    )
    return conform_wiring(target, wiring, choice, context.args)


@command(
    epilog="Examples: umo device plant ztheta  |  umo device plant ztheta --port 1502 --seed 7 --faults leaky-cup  |  "
    "umo device plant ztheta --help",
    status="0 ended by Ctrl-C; 1 the plant failed; 2 the command line or a wiring is wrong (see stderr)",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
)
def plant(
    context: typer.Context,
    station: OptionalStation = None,
    wiring: Annotated[
        str | None,
        typer.Option(
            "--wiring",
            "-w",
            metavar="NAME|FILE",
            help="Modbus wiring, which has the register of each object; default: modbus, or the only Modbus wiring.",
            autocompletion=completion.wirings,
        ),
    ] = None,
    plant_wiring: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Simulated wiring, which has the plant; default: the first wiring of the station (simulated).",
            autocompletion=completion.wirings,
        ),
    ] = None,
    host: Annotated[
        str | None, typer.Option(metavar="HOST", help="Address to serve at; default: the address in the Modbus wiring.")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help="TCP port, or 0 for any free port; default: the port in the Modbus wiring."
        ),
    ] = None,
    watchdog: Annotated[
        float | None,
        time_option(
            may_be_0=True,
            help="Watchdog timeout, at most 65.535 s, or 0 for no watchdog; default: the timeout in the Modbus wiring.",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("FILE.json", "Write the report of the plant to this file.")] = None,
    fault: Faults = None,
    fault_seed: FaultSeed = None,
    help_: Help = False,
) -> None:
    """Serve the plant of a station over Modbus TCP in real time, in place of the controller boxes of the machine.

    The simulated wiring gives the plant channel of each object. The Modbus wiring gives the box and register of each
    object. Options of the plant's drivers follow the station's name.
    """
    name = named(context, help_, station, plant_wiring, application=False)

    from umo.process.station import find
    from umo_command.device.plant import serve_plant

    changes = {"host": host, "port": port, "watchdog": watchdog}
    serve_plant(find(name), wiring, plant_wiring, context.args, changes, out, injected(fault, fault_seed))
