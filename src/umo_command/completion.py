"""Completes words in the shell: stations, running machines, paths, actions, wirings, recordings. `umo
--install-completion` installs it for bash, zsh and fish. Only the words are printed. Data that cannot be read give no
completions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from functools import wraps
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from umo.process.frames import Reader, RunReader

RECORDING = ".mcap"


def completing(words: Callable[[typer.Context, str], Iterable[str]]) -> Callable[[typer.Context, str], list[str]]:
    """Return a function that completes these words."""

    @wraps(words)
    def found(ctx: typer.Context, incomplete: str) -> list[str]:
        with suppress(Exception), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            return sorted({each for each in words(ctx, incomplete) if each.startswith(incomplete)})
        return []

    found.__annotations__ = {"ctx": typer.Context, "incomplete": str}
    return found


@completing
def stations(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return folders of stations, folders that lead to one, and the stations that ship with umo or are installed."""
    from umo.process.station import shipped
    from umo.system.packages import MARK, registered

    yield from shipped()
    yield from (each.name for each in registered("umo.stations"))
    for text, folder in _below(incomplete):
        if folder.is_dir() and not folder.name.startswith("."):
            yield text if (folder / MARK).is_file() else f"{text}/"


@completing
def running(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return the names of the stations that run, or their pids if several have the same name."""
    names: list[str] = []
    for about in (reader.about for reader in _readers()):
        names += [str(about["pid"])] if about["station"] in names else [str(about["station"])]
    return names


@completing
def stations_and_running(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    return [*running(ctx, incomplete), *stations(ctx, incomplete)]


@completing
def wirings(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return the wirings of the named station, and files."""
    from umo_command.station_named import station_named

    with suppress(Exception):
        yield from station_named(_station(ctx)).wirings
    yield from (text for text, each in _below(incomplete) if each.suffix == ".toml")


@completing
def recordings(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    for text, each in _below(incomplete):
        if each.is_dir() or each.suffix == RECORDING:
            yield f"{text}/" if each.is_dir() else text


@completing
def running_and_recordings(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    return [*running(ctx, incomplete), *recordings(ctx, incomplete)]


@completing
def paths(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return the objects, signals and numbers of the named station, or of the only one that runs."""
    with _machine(ctx) as reader:
        if reader is not None:
            return [*reader.paths, *reader.signals, *reader.tunables()]
    from umo.objects import atoms
    from umo.process.station import find

    return [each.path for each in atoms(find(_station(ctx)).machine())]


@completing
def running_and_paths(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return stations for the first word, and paths of this station for the other words."""
    return [*_first_running(ctx, incomplete), *paths(ctx, incomplete)]


def _first_running(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return stations for the first word, and nothing for later words. From then on the first word is the station."""
    words = ctx.params.get("words") or []
    ctx.params |= {"station": words[0]} if words else {}
    return [] if words else running(ctx, incomplete)


@completing
def drivers(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    from umo.drivers.registry import known

    return known()


@completing
def faces(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    from umo.clients.faces.face_registry import known_faces

    return known_faces()


@completing
def numbers(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return the tunable numbers of a running station."""
    with _machine(ctx) as reader:
        return [] if reader is None else reader.tunables()


@completing
def running_and_alarms(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return stations for the first word, and the station's alarms for the other words."""
    first = _first_running(ctx, incomplete)
    with _machine(ctx) as reader:
        return [*first, *([] if reader is None else _alarms(reader))]


@completing
def verbs(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    from umo.operation.commands.verbs import VERBS

    return (each.replace(" ", "-") for each in VERBS)


@completing
def words_of_verb(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Return the words that may follow a verb: actions and their arguments, alarms, numbers, objects."""
    from umo.operation.commands.verb import Names
    from umo.operation.commands.verbs import verb_of

    verb, given = verb_of(ctx.params["verb"]), ctx.params.get("words") or []
    with _machine(ctx) as reader:
        if verb is None or reader is None:
            return []
        if verb.of_action:
            actions = {each["path"]: each for each in reader.layout.actions}
            if given:
                return [f"{each['name']}=" for each in actions[given[0]]["arguments"]]
            return actions
        if verb.names is Names.ALARM:
            return _alarms(reader)
        if verb.names is Names.TUNABLE:
            return reader.tunables()
        if verb.names is Names.NOTHING:
            return [choice for each in verb.arguments for choice in each.choices]
        return reader.paths


def _alarms(reader: RunReader) -> list[str]:
    return [each["path"] for each in reader.layout.alarms]


@contextmanager
def _machine(ctx: typer.Context) -> Iterator[Reader | None]:
    """Yield the frames of the named station, or of the only running one if none was named; None if it does not run."""
    wanted = _station(ctx) or None
    found = [each for each in _readers() if wanted in (None, str(each.about["station"]), str(each.about["pid"]))]
    yield found[0] if len(found) == 1 else None


def _station(ctx: typer.Context) -> str:
    """Return the station that was named, or "" if none was named. After an option without its value, the arguments
    cannot be distinguished."""
    return str(ctx.params.get("station") or next(iter(ctx.args), ""))


def _readers() -> list[Reader]:
    from umo.process.frames.search import readers

    return readers()


def _below(incomplete: str) -> Iterable[tuple[str, Path]]:
    """The files and folders whose path begins with the typed text, as they would be typed."""
    start, slash, name = incomplete.rpartition("/")
    for each in Path(start or slash or ".").glob(f"{name}*"):
        yield f"{start}{slash}{each.name}", each
