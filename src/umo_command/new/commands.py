"""`umo new`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from umo_command.options import MACHINE_OPTIONS, StationName, WiringName, out_option
from umo_command.shared import group

command = group(
    "new",
    "Make",
    "Make files to start from: a station, a driver, a face, a controller in C, a service.",
    "umo new station my-machine  |  umo new driver my_card",
)


@command(epilog="Examples: umo new station my-machine && umo run my-machine")
def station(directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")]) -> None:
    """Create a small working station with tests."""
    from umo_command.new.templates import make_station

    make_station(directory)


@command(
    epilog="Examples: umo new driver my_card && pytest test_my_card.py  |  umo new driver my_drive --serial",
)
def driver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_card.")],
    tcp: Annotated[bool, typer.Option("--tcp", help="For a device on the network, with binary frames.")] = False,
    serial: Annotated[bool, typer.Option("--serial", help="The same on a serial line.")] = False,
) -> None:
    """Create a driver with its tests in this folder: NAME.py and test_NAME.py.

    The driver works immediately with a device in memory, or, with --tcp or --serial, with a device in a separate
    process, NAME_device.py. Its tests run the conformance kit, which tests whether the driver keeps the contract, also
    on a disturbed line. Replace the device by the real one; the tests stay the same.
    """
    from umo_command.new.templates import make_driver

    make_driver(name, Path.cwd(), ["tcp"] * tcp + ["serial"] * serial)


@command(epilog="Examples: umo new face my_face && pytest test_my_face.py")
def face(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the module, such as my_face.")]) -> None:
    """Create a face with its tests in this folder: NAME.py and test_NAME.py.

    The face works at once: JSON over TCP. Its tests run the conformance kit for faces: with a client of this
    protocol, the kit tests whether the face keeps the contract. Replace the protocol by yours; the tests stay the same.
    """
    from umo_command.new.templates import make_face

    make_face(name, Path.cwd())


@command(
    epilog="Examples: umo new controller ztheta --target host -o controller  |  "
    "umo new controller furnace --zones 3 --target "
    "cortex-m -o firmware  |  umo new controller my-machine -w bench --target arduino -o sketch",
    status="0 done; 2 some code cannot be translated, or another mistake, see stderr",
    context_settings=MACHINE_OPTIONS,
)
def controller(
    context: typer.Context,
    station: StationName,
    target: Annotated[str, typer.Option(metavar="TARGET", help="host, cortex-m, avr or arduino.")],
    out: Annotated[Path, out_option("DIR", "The folder that is written.")],
    wiring: WiringName = None,
    real: Annotated[
        str | None,
        typer.Option(metavar="double|float", help="Type of numbers; default: double, on avr and arduino float."),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            "--controller",
            metavar="NAME",
            help="Restrict the code to the part that runs on this controller of the wiring.",
        ),
    ] = None,
) -> int:
    """Write the controller of a machine in C: objects, interlocks, rates, expiry and control laws, without a heap and
    without hardware, with a loop and a watchdog around it.

    Scales, ranges and defaults come from the wiring, numbers from the machine with its parameters. No device is opened.
    If some code cannot be translated, all such code is listed with file and line, and nothing is written. Files that
    you fill in, io_board.c and the Makefile, are not overwritten. With `--controller` only one part is generated; the
    rest of the machine runs on a host that is connected by a line (docs/howto-split.md). Sequences run on the host.
    Options of the machine follow the station's name.
    """
    from umo.process.station import find
    from umo_command.new.controller import generate_controller

    return generate_controller(find(station), wiring, target, real, out, context.args, part)


@command(
    epilog="Examples: umo new service press -w modbus  |  "
    "umo new service press -w modbus --as operator -o press.service  |  "
    "umo new service press -w modbus --keep '1 GB' --user",
    status="0 the unit is written; 2 a mistake, see stderr",
    context_settings=MACHINE_OPTIONS,
)
def service(
    context: typer.Context,
    station: StationName,
    wiring: WiringName = None,
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the unit; default: umo-STATION.")] = None,
    as_: Annotated[
        str | None, typer.Option("--as", metavar="USER", help="User who runs it; default: the current user.")
    ] = None,
    user: Annotated[
        bool, typer.Option("--user", help="Write a unit for the user's own manager (systemctl --user).")
    ] = False,
    out: Annotated[Path | None, out_option("FILE", "Write the unit to this file; default: print it.")] = None,
) -> None:
    """Write a systemd unit that runs a station at boot, in the current folder, and print how to install it.

    The wiring is checked. The arguments after the station are options of `umo run` and of the station. Without systemd,
    the same command line is shown for the foreground. The unit restarts a run that has failed with every actuator at
    its default. It does not restart after status 2, 3 or 4: a mistake, devices that stand stopped, an actuator that is
    not at its default, a record that cannot be written.
    """
    from umo_command.new.service import write_unit

    write_unit(station, wiring, context.args, name=name, user=as_, own_manager=user, output=out)
