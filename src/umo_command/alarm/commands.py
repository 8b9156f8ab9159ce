"""`umo alarm`: its commands, their arguments, and the functions that carry them out."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

import typer

from umo_command import completion
from umo_command.options import Json, OneRunning, Take
from umo_command.shared import CommandLine, HelpPanel, group

if TYPE_CHECKING:
    from umo.operation.commands.verb import Verb


class AlarmCommands(CommandLine):
    """A group whose commands are the verbs of alarms. The commands are created only when they are needed, because
    importing the table of verbs takes a second."""

    def list_commands(self, ctx: Any) -> list[str]:
        self.commands.update(commands_of_verbs())
        return super().list_commands(ctx)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        self.commands.update(commands_of_verbs())
        return super().get_command(ctx, cmd_name)


command = group(
    "alarm",
    "Operate",
    "List the alarms of a station, acknowledge them, or hide them for a time.",
    "umo alarm list  |  umo alarm ack batch reactors.0.hot  |  umo alarm shelve batch reactors.0.full '10 min'",
    cls=AlarmCommands,
)


@command(
    "list",
    epilog="Examples: umo alarm list  |  umo alarm list batch  |  umo alarm list batch --raised  |  "
    "umo alarm list --all",
)
def list_(
    station: OneRunning = None,
    raised: Annotated[
        bool, typer.Option("--raised", help="Also list alarms that were raised in this run and are normal now.")
    ] = False,
    every: Annotated[bool, typer.Option("--all", help="List every alarm that the machine declares.")] = False,
    as_json: Json = False,
) -> None:
    """List the alarms of a running station that are not normal.

    Unacknowledged alarms come first, then those with a higher priority. Times are local times, as in `umo alarm
    history`; with --json they are in s on the machine's clock.

    For the examples of `umo alarm`, start `umo run batch --manual` in another terminal.
    """
    from umo_command.alarm.listing import list_alarms

    list_alarms(station, as_json, raised, every)


@command(epilog="Examples: umo alarm history batch")
def history(
    station: Annotated[
        str | None,
        typer.Argument(
            metavar="[STATION]",
            help="Name or folder of a station; default: the only running station.",
            autocompletion=completion.stations_and_running,
        ),
    ] = None,
) -> None:
    """List the stored changes of alarms, also those of earlier runs. The station need not run."""
    from umo_command.alarm.listing import show_history

    show_history(station)


@cache
def commands_of_verbs() -> dict[str, Any]:
    """Return a command for each verb of alarms, by its name."""
    from umo.operation.commands.verb import Names
    from umo.operation.commands.verbs import naming

    made = typer.Typer()
    for verb in naming(Names.ALARM):
        _add(HelpPanel("Commands", made), verb)
    return dict(typer.main.get_group(made).commands)


def _add(command: HelpPanel, verb: Verb) -> None:
    """Add the command that gives this verb."""
    from umo.operation.commands.verbs import ACKNOWLEDGE_ALARM, RESET_ALARM, RETURN_TO_SERVICE, UNSHELVE

    name = "ack" if verb is ACKNOWLEDGE_ALARM else verb.name.partition(" ")[0]
    more = "".join(f" {each.name.upper()}" for each in verb.arguments)
    time = " '10 min'" if verb.arguments else ""
    first = {UNSHELVE: "shelve batch reactors.0.full '10 min'", RETURN_TO_SERVICE: "remove batch reactors.0.full"}
    one = f"{name} batch" if verb is RESET_ALARM else f"{name} batch reactors.0.full{time}"  # no alarm can be reset
    examples = [*filter(None, [first.get(verb)]), one, f"{name} batch 'reactors.*'{time}"]
    about = typer.Argument(
        metavar=f"[STATION] PATH{more}" if more else "[STATION] [PATH]...",
        help=f"Name or pid of a station, required if several run; then one or more paths. A path names an alarm "
        f"(reactors.0.full), or an object or compound with all its alarms. It can be a pattern ('reactors.*.full'). "
        f"{'The last argument is the time, at most 7 days.' if more else 'Default: all alarms.'}",
        autocompletion=completion.running_and_alarms,
    )

    def give(words: list[str] | None = None, take: Take = False) -> int:
        from umo_command.do.do_verb import do
        from umo_command.show.stations import attach_first

        reader, rest = attach_first(words or [])
        with reader:
            station = words[0] if words and len(rest) < len(words) else str(reader.about["station"])
        return do(station, verb.name, rest, take, None)

    give.__annotations__["words"] = Annotated[list[str] | None, about]
    command(name, help=verb.help, epilog=f"Examples: {'  |  '.join(f'umo alarm {each}' for each in examples)}")(give)
