"""The settings of a station's faces: the table `[faces]` of its wiring, and the options of the command line that
override them.

[faces]
rate = 10                          # looks at the machine a second
commands = true                    # default: clients only read
dead_bands = { "z.encoder" = 5 }   # changes up to this are not reported, in the unit of each number

[faces.prometheus]
port = 9464
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Annotated, Any

from umo.clients.faces.face import Face
from umo.clients.faces.face_registry import FaceNotInstalled, find_face
from umo.clients.faces.host import FASTEST, RATE, SLOWEST
from umo.errors import OptionError, text_of
from umo.signature import parameters_of
from umo.text import did_you_mean
from umo.wiring.settings import COMMAND_LINE, a_number, changed, names_of, refusal, settings_of


@dataclass(frozen=True)
class FacesTable:
    """The keys of the table `[faces]` that are not names of faces."""

    rate: Annotated[float, a_number(SLOWEST, FASTEST)] = RATE
    """Looks per second."""
    commands: bool = False
    dead_bands: Mapping[str, Annotated[float, a_number(0.0, inf)]] = field(default_factory=dict)


KEYS = names_of(FacesTable)


@dataclass(frozen=True)
class FaceSettings(FacesTable):
    """The settings in `[faces]`. They are checked as far as possible without importing a face."""

    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The options of each face, by its name."""
    file: str = "wiring"
    """The wiring file. Relative paths start from its station, or else from its folder."""


def faces_settings(
    table: Mapping[str, Any], file: str = "wiring", changes: Mapping[str, Any] | None = None
) -> FaceSettings:
    """Return the settings in the table `[faces]` of a wiring. Settings of the command line override them. Raises
    SettingsError for an invalid key or value."""
    faces = {key: value for key, value in table.items() if key not in KEYS and isinstance(value, Mapping)}
    given = settings_of(FacesTable, {key: value for key, value in table.items() if key not in faces}, file, "faces")
    return FaceSettings(**vars(changed(given, changes, "faces")), options=faces, file=file)


def options_from(texts: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return options of faces by face and name, parsed from a command line such as `prometheus.port=9465`. Raises
    OptionError if one is malformed."""
    import tomllib

    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        face, dot, option = name.strip().rpartition(".")
        if not (equals and dot and face and option):
            raise OptionError(f"{text!r} is not an option of a face; write for example prometheus.port=9465")
        try:
            found.setdefault(face, {})[option] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found.setdefault(face, {})[option] = value.strip()  # a text without quotes
    return found


def faces_of(
    settings: FaceSettings, names: Sequence[str], changes: Mapping[str, Mapping[str, Any]]
) -> list[tuple[str, Face]]:
    """Create and return the faces with these names; without names, those of the settings. Raises OptionError if one
    cannot be created."""
    chosen = list(names) or list(settings.options)
    if not chosen:
        raise OptionError(
            "name a face, as in `umo connect face prometheus`, or give the wiring of a running station "
            "a table [faces.prometheus]"
        )
    for face in changes:
        if face not in chosen:
            raise OptionError(
                f"an option was given for {face}, which is not served{did_you_mean(face, chosen)}; the faces are "
                f"{', '.join(chosen)}"
            )
    return [(name, _made(name, settings, changes.get(name, {}))) for name in chosen]


def faces_present(settings: FaceSettings) -> tuple[FaceSettings, list[str]]:
    """Return the settings without the faces whose libraries are not installed, and how to install these libraries.
    Raises OptionError for a face that cannot be created."""
    options, missing = {}, []
    for name, given in settings.options.items():
        try:
            _made(name, settings, {})
            options[name] = given
        except FaceNotInstalled as error:
            missing.append(str(error))
    return replace(settings, options=options), missing


def _made(name: str, settings: FaceSettings, changes: Mapping[str, Any]) -> Face:
    from pydantic import ValidationError

    from umo.wiring.schema import arguments_of
    from umo.wiring.schema_mistakes import mistakes_of

    cls = find_face(name)
    place = settings.file if name in settings.options else COMMAND_LINE
    signature = parameters_of(cls)
    given = {**settings.options.get(name, {}), **changes}
    try:
        options = arguments_of(cls, signature, given, settings.file, changes)
    except ValidationError as error:
        types = {key: each.annotation for key, each in signature.items()}
        mistakes = list(mistakes_of(error, list(signature), types))
        written = [each for each in mistakes if each[0].partition(".")[0] not in changes]
        file = place if written else COMMAND_LINE
        raise refusal(written or mistakes, file, f"faces.{name}") from None
    try:
        return cls(**options)
    except OptionError as error:
        raise refusal([("", str(error))], place, f"faces.{name}") from None
    except Exception as error:  # of a face of others
        raise OptionError(f"{name} cannot be created: {text_of(error)}") from error
