"""`umo do`: carries out any verb of a running station."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from umo.errors import OptionError
from umo.operation.commands.verb import ArgumentKind, Names, Verb
from umo.operation.commands.verbs import ACKNOWLEDGE, CALL, CLEAR, MODE, STOP, TUNE, VERBS, WRITE, offered, verb_of
from umo.process.frames.search import meant_by
from umo.text import did_you_mean, printable
from umo_command.console import err, out, plain_table
from umo_command.do.clearing import acknowledge, clear
from umo_command.do.commanding import (
    actions_table,
    call,
    hinting,
    leased,
    mode,
    set_running,
    station_of,
    tune,
)
from umo_command.do.stop_run import stop
from umo_command.show.stations import attach, readers


def do(name: str, verb: str | None, words: Sequence[str], over: bool, held: float | None) -> int:
    """Send a verb to a station and print its result, or list the verbs of a station. Return the exit status."""
    _check_station(name, verb, words)
    if verb is None:
        with station_of(name) as station:
            out.print(_listed())
            if station.reader.layout.actions:
                out.print(actions_table(station.reader))
        return 0
    if (found := verb_of(verb)) is None:
        raise OptionError(f"there is no command {verb!r}{_meant(name, verb)}; `umo do {name}` lists them")
    if held is not None and found not in (WRITE, CALL):
        raise OptionError(
            f"{found.name} ends by itself; --for can only be used to hold an actuator or a dead-man "
            f"action, such as a jog"
        )
    if found in HANDLERS:
        return HANDLERS[found](name, words, over, held) or 0
    for path, given in _paths_of(found, words):
        _give(name, found, path, given, over)
    return 0


def _check_station(name: str, verb: str | None, words: Sequence[str]) -> None:
    """Raise OptionError if a verb is in the place of the station, and a station runs."""
    if verb_of(name) is None or not (found := readers()) or meant_by(name, found):
        return
    line = " ".join(["umo do", str(found[0].about["station"]), name, *filter(None, [verb]), *words])
    raise OptionError(f"{name} is a verb; the station comes first: `{line}`")


def _meant(name: str, verb: str) -> str:
    """Return the nearest command, or the actions with this name, as the end of a sentence."""
    with station_of(name) as station:
        paths = [str(each["path"]) for each in station.reader.layout.actions]
    found = [path for path in paths if path.rpartition(".")[2] == verb]
    if not found:
        return did_you_mean(verb, VERBS)
    more = f" and {len(found) - 1} more" if len(found) > 1 else ""
    return f", but an action: `umo do {name} call {found[0]}`{more}"


def _give(name: str, verb: Verb, path: str, words: Sequence[str], over: bool) -> None:
    with station_of(name) as station:
        arguments = given_arguments(verb, words)
        if not verb.needs_lease:
            station.carry_out(verb, path, arguments)
            return
        with hinting(station.reader), leased(station, over):
            result = station.carry_out(verb, path, arguments)
    if result is None:
        err.print(f"{verb.name} {path}".rstrip() + ": done", soft_wrap=True)
    else:
        out.print(printable(result if isinstance(result, str) else json.dumps(result)), soft_wrap=True)


def _word(verb: Verb, words: Sequence[str]) -> str | None:
    """Return the one argument of a verb, given by its name or without, or None."""
    if len(words) > 1:
        raise OptionError(f"{verb.name}: {words[1]!r} is one argument too many")
    prefix = f"{verb.arguments[0].name}="
    return words[0].removeprefix(prefix) if words else None


def _path_and_word(verb: Verb, words: Sequence[str]) -> tuple[str | None, str | None]:
    return (words[0] if words else None), _word(verb, words[1:])


def _write(name: str, words: Sequence[str], over: bool, held: float | None) -> int:
    path, text = _path_and_word(WRITE, words)
    if path is None or text is None:
        raise OptionError(f"write: give an actuator and its value, as `umo do {name} write PATH VALUE`")
    return set_running(attach(name), path, text, held, over)


HANDLERS: Mapping[Verb, Callable[[str, Sequence[str], bool, float | None], int | None]] = {
    MODE: lambda name, words, over, held: mode(name, _word(MODE, words), over),
    STOP: lambda name, words, over, held: stop(name),
    CALL: lambda name, words, over, held: call(name, words[0] if words else None, words[1:], over, held),
    TUNE: lambda name, words, over, held: tune(name, *_path_and_word(TUNE, words), over),
    WRITE: _write,
    ACKNOWLEDGE: lambda name, words, over, held: acknowledge(name, words, over),
    CLEAR: lambda name, words, over, held: clear(name, words, over),
}
"""The verbs for which the terminal prints more than the answer of the machine."""


def _paths_of(verb: Verb, words: Sequence[str]) -> list[tuple[str, Sequence[str]]]:
    """Return each path with the words of its arguments. A verb without arguments may have several paths."""
    if verb.names is not Names.NOTHING and not verb.arguments and words:
        return [(path, ()) for path in words]
    return [_path_of(verb, words)]


def _path_of(verb: Verb, words: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return the path, and the words of the arguments."""
    if verb.names is not Names.NOTHING and words and "=" not in words[0]:
        return words[0], words[1:]
    return "", words


def given_arguments(verb: Verb, words: Sequence[str]) -> dict[str, Any]:
    """Return the arguments by name. The machine checks them."""
    kinds = {each.name: each.kind for each in verb.arguments}
    given: dict[str, Any] = {}
    for word in words:
        name, sign, text = word.partition("=")
        last = next(reversed(given), "")
        if not sign:  # the next of its arguments
            name, text = next((each for each in kinds if each not in given), ""), word
        if not name and kinds.get(last) is ArgumentKind.TIME and not isinstance(given[last], str):  # its unit: 10 min
            given[last] = f"{given[last]} {word}"
            continue
        if not name or name in given:
            raise OptionError(f"{verb.name}: {word!r} is one argument too many")
        given[name] = text if kinds.get(name) is ArgumentKind.CHOICE else _value(text)
    return given


def _value(text: str) -> Any:
    """Return a number, True or False; for any other text return the text itself."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return text
    return found if isinstance(found, bool | int | float) else text


def _listed() -> Any:
    """Return the verbs as they are typed, with their effect and the required role."""
    table = plain_table()
    for head in ("verb", "what it does", "role"):
        table.add_column(head, overflow="fold")
    for verb in offered():
        table.add_row(_typed(verb), verb.help, str(verb.role))
    return table


def _typed(verb: Verb) -> str:
    """`shelve [ALARM] TIME`."""
    words = [verb.name.replace(" ", "-")]
    if verb.names is not Names.NOTHING:
        words.append(f"[{verb.names.name}]" if verb.of_many else verb.names.name)
        words[-1] += "..." if verb.of_many and not verb.arguments else ""
    for each in verb.arguments:
        word = "|".join(each.choices) or ("NAME=VALUE..." if verb.of_action else each.name.upper())
        words.append(word if each.required and not verb.of_action else f"[{word}]")
    return " ".join(words)
