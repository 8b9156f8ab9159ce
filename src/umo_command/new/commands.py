"""`umo new`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import MACHINE_OPTIONS, StationName, WiringName, out_option
from umo_command.shared import group

command = group(
    "new",
    "Make",
    "Create files to start from: a station, a driver, a face, a controller in C, a service.",
    "umo new station my-machine  |  umo new driver my_card",
)


@command(
    epilog="Examples: umo new station my-machine && umo run my-machine  |  "
    "umo new station my-batch --copy batch && umo run my-batch"
)
def station(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")],
    copied: Annotated[
        str | None,
        typer.Option(
            "--copy",
            metavar="STATION",
            help="Copy this station, such as one that ships with umo; default: a small tank.",
            autocompletion=completion.stations,
        ),
    ] = None,
) -> None:
    """Create a small working station with tests.

    With --copy it is a copy of another station, with its own name, code, wirings and tests. Change the wirings, or any
    other file, as you like. `umo show parts STATION` shows where the files of a station are.
    """
    from umo_command.new.templates import make_station
    from umo_command.station_named import station_named

    make_station(directory, None if copied is None else station_named(copied))


@command(
    epilog="Examples: umo new driver my_card && pytest test_my_card.py  |  umo new driver my_drive --serial",
)
def driver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_card.")],
    tcp: Annotated[
        bool, typer.Option("--tcp", help="Create a driver for a device on the network, with binary frames.")
    ] = False,
    serial: Annotated[
        bool, typer.Option("--serial", help="Create a driver for a device on a serial line, with binary frames.")
    ] = False,
) -> None:
    """Create a driver and its tests in the current folder: NAME.py and test_NAME.py.

    The driver works immediately, with a simulated device. The device is in memory; with --tcp or --serial it is a
    separate process, NAME_device.py. The tests run the conformance kit, which tests whether the driver keeps the
    contract, also on a disturbed line. Replace the simulated device by the real one; the tests stay the same.

    A device that speaks in lines of text needs no driver of its own: the driver `text` takes its commands from a few
    lines of the wiring (`umo device drivers text`).
    """
    from umo_command.new.templates import make_driver

    make_driver(name, Path.cwd(), ["tcp"] * tcp + ["serial"] * serial)


@command(epilog="Examples: umo new face my_face && pytest test_my_face.py")
def face(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_face.")]) -> None:
    """Create a face and its tests in the current folder: NAME.py and test_NAME.py.

    The face works immediately: it serves JSON over TCP. The tests run the conformance kit for faces, which tests with a
    client of this protocol whether the face keeps the contract. Replace the protocol by yours; the tests stay the same.
    """
    from umo_command.new.templates import make_face

    make_face(name, Path.cwd())


@command(
    epilog="Examples: umo new controller ztheta --target host -o controller  |  "
    "umo new controller furnace --zones 3 --target "
    "cortex-m -o firmware  |  umo new station my-machine  |  "
    "umo new controller my-machine --target arduino -o sketch",
    status="0 done; 2 some code cannot be translated, or the command line, the wiring or a declaration is wrong (see "
    "stderr)",
    context_settings=MACHINE_OPTIONS,
)
def controller(
    context: typer.Context,
    station: StationName,
    target: Annotated[
        str,
        typer.Option(metavar="TARGET", help="Processor or system that runs the code: host, cortex-m, avr or arduino."),
    ],
    out: Annotated[Path, out_option("DIR", "Folder for the C files.")],
    wiring: WiringName = None,
    real: Annotated[
        str | None,
        typer.Option(
            metavar="double|float",
            help="Type of numbers; default: float on avr and arduino, double on the other targets.",
        ),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="Generate only the part of the machine that runs on this controller of the wiring.",
        ),
    ] = None,
) -> int:
    """Write the controller of a machine in C: its objects, interlocks, rates, expiry times and control laws, with a
    loop and a watchdog. The code uses no heap. You fill in its access to the hardware.

    Scales, ranges and defaults come from the wiring. Numbers come from the machine with its parameters. No device is
    opened. If some code cannot be translated, all such code is listed with file and line, and nothing is written. The
    files that you fill in, io_board.c and the Makefile, are not overwritten. With `--controller` only one part is
    generated. The other parts and the sequences run on a host, and a line connects the two (docs/howto-split.md).
    Options of the machine follow the station's name.
    """
    from umo_command.new.controller import generate_controller
    from umo_command.station_named import station_named

    return generate_controller(station_named(station), wiring, target, real, out, context.args, part)


@command(
    epilog="Examples: umo new service ztheta -w modbus  |  "
    "umo new service ztheta -w modbus --as root -o ztheta.service  |  "
    "umo new service ztheta -w modbus --keep '1 GB' --user",
    status="0 the unit is written; 2 the command line, the wiring or a declaration is wrong (see stderr)",
    context_settings=MACHINE_OPTIONS,
)
def service(
    context: typer.Context,
    station: StationName,
    wiring: WiringName = None,
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the unit; default: umo-STATION.")] = None,
    as_: Annotated[
        str | None, typer.Option("--as", metavar="USER", help="User who runs the station; default: the current user.")
    ] = None,
    user: Annotated[
        bool, typer.Option("--user", help="Write a unit for the user's own manager (systemctl --user).")
    ] = False,
    out: Annotated[Path | None, out_option("FILE", "Write the unit to this file; default: print it.")] = None,
) -> None:
    """Write a systemd unit that runs a station in the current folder at boot, and print how to install the unit.

    The wiring is checked. The arguments after the station are options of `umo run` and of the station. If this computer
    has no systemd, the command line for the foreground is shown. The unit restarts a run that failed with every
    actuator at its default. It does not restart after status 2 (wrong options or wiring, or a device whose last run
    ended unsafely), 3 (an actuator is not at its default) or 4 (the record cannot be written).
    """
    from umo_command.new.service import write_unit

    write_unit(station, wiring, context.args, name=name, user=as_, own_manager=user, output=out)
