"""The names that commands had before they were put into groups. They still work in this version, and print a line on
stderr that names the new command. The next version removes this file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import typer
from typer.main import get_command_name
from typer.models import CommandInfo

FOR = {"--seconds": "--for", "--hold": "--for"}


@dataclass(frozen=True)
class OldName:
    """An old command and the new one. A word in capitals is the next argument."""

    was: str
    now: str
    options: Mapping[str, str] = field(default_factory=dict)
    """Options whose names have also changed, each with its new name."""


OLD_NAMES = (
    OldName("plant", "device plant", {"--report": "--out"}),
    OldName("latency", "show latency", FOR | {"--json": "--out"}),
    OldName("service", "new service"),
    OldName("runs", "recording runs", {"--prune": "--keep-runs"}),
    OldName("record --save", "recording save"),
    OldName("record --repair", "recording repair"),
    OldName("record", "recording make"),
    OldName("ps", "show stations"),
    OldName("watch", "show values", FOR),
    OldName("face", "connect face", {"--option": "--set"}),
    OldName("view", "show page"),
    OldName("mode", "do STATION mode"),
    OldName("call", "do STATION call", FOR),
    OldName("tune --save", "tune save"),
    OldName("tune", "tune number"),
    OldName("kept", "tune kept"),
    OldName("acknowledge", "do STATION acknowledge"),
    OldName("clear", "do STATION clear"),
    OldName("alarms --history", "alarm history"),
    OldName("alarms --acknowledge", "alarm ack"),
    OldName("alarms --reset", "alarm reset"),
    OldName("alarms --shelve --for", "alarm shelve"),
    OldName("alarms --unshelve", "alarm unshelve"),
    OldName("alarms --remove", "alarm remove"),
    OldName("alarms --return", "alarm return"),
    OldName("alarms", "alarm list"),
    OldName("stop", "do STATION stop"),
    OldName("why", "show why"),
    OldName("tune-law", "tune law", {"--from": "--file", "--start": "--from", "--stop": "--to", "--set": "--gains"}),
    OldName("fleet serve", "connect fleet"),
    OldName("fleet router", "connect router"),
    OldName("fleet certificate", "connect certificate"),
    OldName("fleet record", "recording history", {"--keep": "--last"}),
    OldName("fleet query", "recording query", {"--csv": "--out"}),
    OldName("info", "recording info"),
    OldName("export", "recording export FILE --out OUT"),
    OldName("plot", "recording plot"),
    OldName("replay", "recording replay", {"--plot": "--out"}),
    OldName("shrink", "recording shrink", FOR | {"--output": "--out"}),
    OldName("generate", "new controller"),
    OldName("recipes", "tune recipe"),
    OldName("tree --period", "show period"),
    OldName("tree", "show parts"),
    OldName("get", "device get"),
    OldName("set", "device set", FOR),
    OldName("drivers", "device drivers"),
    OldName("conform", "device conform", {"--json": "--out"}),
    OldName("new-driver", "new driver"),
    OldName("new", "new station"),
)


def current(words: Sequence[str], app: typer.Typer) -> list[str]:
    """Replace old names of commands by the present ones. Changes are printed on stderr."""
    if _is_of_a_group(words, app):
        return list(words)
    for each in OLD_NAMES:
        name, *rest = each.was.split()
        if words[:1] == [name] and all(word in words[1:] for word in rest):
            from .console import say

            found = _translated(each, words)
            say(f"`umo {each.was}` is now `umo {each.now}`: the old name works in this version only")
            return found
    return list(words)


def _is_of_a_group(words: Sequence[str], app: typer.Typer) -> bool:
    """`umo new station`, and `umo new` alone: an old name is the name of a group today."""
    for group in app.registered_groups:
        if words[:1] == [group.name] and group.typer_instance is not None:
            below = [name_of(each) for each in group.typer_instance.registered_commands]
            return len(words) == 1 or words[1] in (*below, "--help", "-h")
    return False


def _translated(name: OldName, words: Sequence[str]) -> list[str]:
    rest = list(words)
    for word in name.was.split():
        rest.remove(word)
    rest = [_option(name.options, word) for word in rest]
    found: list[str] = []
    for word in name.now.split():
        if word.isupper():
            given = next((each for each in rest if not each.startswith("-")), None)
            if given is None:
                break
            rest.remove(given)
            word = given
        found.append(word)
    return [*found, *rest]


def _option(names: Mapping[str, str], word: str) -> str:
    option, equals, value = word.partition("=")
    return f"{names.get(option, option)}{equals}{value}"


def name_of(command: CommandInfo) -> str:
    """Return the name by which a command was called."""
    return command.name or get_command_name(getattr(command.callback, "__name__", ""))
