"""`umo do`: its arguments, and the functions that carry it out."""

from __future__ import annotations

from typing import Annotated

import typer

from umo_command import completion
from umo_command.options import Held, Take, running_argument
from umo_command.shared import HelpPanel

command = HelpPanel("Operate")


@command(
    epilog="Examples: umo do ztheta  |  umo do ztheta mode manual  |  "
    "umo do ztheta call home  |  umo do ztheta call z.move_to 'position=100 mm'  |  "
    "umo do ztheta call z.jog velocity=-5000 --for 2s  |  umo do ztheta acknowledge  |  umo do ztheta stop",
    status="0 done; 1 the machine, a device or code failed; 2 the command is wrong or refused, or the hold ended "
    "early (see stderr); 3 after stop: an actuator may not be at its default; 130 Ctrl-C (0 if Ctrl-C ended a hold "
    "without --for)",
)
def do(
    station: Annotated[
        str,
        running_argument(
            "STATION",
            "Name or pid of a station that runs in real time (see `umo`); for acknowledge also a station or a device "
            "whose last run ended unsafely.",
        ),
    ],
    verb: Annotated[
        str | None,
        typer.Argument(
            metavar="[VERB]",
            help="A verb, such as mode, call, stop, or 'remove from service'.",
            autocompletion=completion.verbs,
        ),
    ] = None,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PATH] [NAME=VALUE]...",
            help="The path, then the arguments of the verb, as NAME=VALUE or in their order.",
            autocompletion=completion.words_of_verb,
        ),
    ] = None,
    held: Held = None,
    take: Take = False,
) -> int:
    """Command a running station: change its mode, call an action, write, acknowledge, clear, stop.

    Without a verb, the command lists all verbs (docs/verbs.md) and the actions of the station. `mode` alone shows the
    mode and the lease, `call` alone the actions, `tune` alone the numbers. Ctrl-C cancels an action.

    In manual mode the application waits, and no time passes for it. The outputs that it drives go to their defaults or
    are held, as declared; control laws continue.

    `acknowledge` and `clear` take several paths and patterns; without a path they apply to everything. If a run ended
    unsafely, no other run can use its devices. `acknowledge` with the name of the station or device allows the next
    run. Inspect the machine first.

    `stop` waits until the actuators on devices of this computer are at their defaults, or until umo has given up a
    device that does not answer.

    For the examples, start `umo run ztheta --manual` in another terminal, which ends with status 143 after `stop`.
    """
    from umo_command.do.do_verb import do as work

    return work(station, verb, words or [], take, held)
