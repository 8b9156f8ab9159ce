"""The settings of a station's faces: the table `[faces]` of its wiring, and what the command line changes.

[faces]
rate = 10                          # looks at the machine a second
commands = true                    # default: clients only read
dead_bands = { "z.encoder" = 5 }   # changes up to this are not told, in the unit of each number

[faces.prometheus]
port = 9464
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from umo.errors import OptionError, text_of
from umo.faces.face import Face
from umo.faces.face_registry import FaceNotInstalled, find_face
from umo.faces.host import FASTEST, RATE, SLOWEST
from umo.signature import parameters_of
from umo.text import did_you_mean

KEYS = ("rate", "commands", "dead_bands")
"""Keys of the table that are no faces."""


@dataclass(frozen=True)
class FaceSettings:
    """What `[faces]` says, checked as far as no face has to be imported for it."""

    rate: float = RATE
    """Looks a second, 0.1 to 100."""
    commands: bool = False
    dead_bands: Mapping[str, float] = field(default_factory=dict)
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The options of each face, by its name."""
    file: str = "wiring"
    """The wiring: relative paths start from its station, or from its folder."""

    def __post_init__(self) -> None:
        if not _is_number(self.rate) or not SLOWEST <= self.rate <= FASTEST:
            raise OptionError(f"faces: the rate {self.rate!r} is not a number from {SLOWEST:g} to {FASTEST:g}")
        if not isinstance(self.commands, bool):
            raise OptionError(f"faces: commands = {self.commands!r} is neither true nor false")
        for path, band in self.dead_bands.items():
            if not _is_number(band) or not band >= 0 or not isfinite(band):
                raise OptionError(f"faces: the dead band {band!r} of {path} is not a number from 0 on")


def settings_of(table: Mapping[str, Any], file: str = "wiring") -> FaceSettings:
    """The settings of the table `[faces]` of a wiring; OptionError for what it cannot have."""
    faces: dict[str, Mapping[str, Any]] = {}
    for key, value in table.items():
        if key in KEYS:
            continue
        if not isinstance(value, Mapping):
            raise OptionError(
                f"faces: {key} = {value!r}{did_you_mean(key, KEYS)}; there are {', '.join(KEYS)}, and tables of faces"
            )
        faces[key] = value
    bands = table.get("dead_bands", {})
    if not isinstance(bands, Mapping):
        raise OptionError("faces: dead_bands is a table of numbers by path")
    return FaceSettings(table.get("rate", RATE), table.get("commands", False), dict(bands), faces, file)


def options_from(texts: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Options of faces as in a command line, `prometheus.port=9465`: by face and name; OptionError."""
    import tomllib

    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        face, dot, option = name.strip().rpartition(".")
        if not (equals and dot and face and option):
            raise OptionError(f"{text!r} is no option of a face; write for example prometheus.port=9465")
        try:
            found.setdefault(face, {})[option] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found.setdefault(face, {})[option] = value.strip()  # a text without quotes
    return found


def faces_of(
    settings: FaceSettings, names: Sequence[str], changes: Mapping[str, Mapping[str, Any]]
) -> list[tuple[str, Face]]:
    """The faces of these names (none: those of the settings), made with their options; OptionError."""
    chosen = list(names) or list(settings.options)
    if not chosen:
        raise OptionError(
            "name a face, as in `umo face prometheus`, or give the wiring of a running station "
            "a table [faces.prometheus]"
        )
    for face in changes:
        if face not in chosen:
            raise OptionError(f"an option of {face}{did_you_mean(face, chosen)}: the faces are {', '.join(chosen)}")
    return [(name, _made(name, settings, changes.get(name, {}))) for name in chosen]


def faces_present(settings: FaceSettings) -> tuple[FaceSettings, list[str]]:
    """The settings without the faces whose libraries are not installed, and how to install these. OptionError for a
    face that cannot be made."""
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

    from umo.wiring.schema import arguments_of, mistakes_of

    cls = find_face(name)
    signature = parameters_of(cls)
    given = {**settings.options.get(name, {}), **changes}
    try:
        options = arguments_of(cls, signature, given, settings.file, changes)
    except ValidationError as error:
        raise OptionError(
            "; ".join(f"{name}.{key}: {text}" for key, text in mistakes_of(error, list(signature)))
        ) from None
    try:
        return cls(**options)
    except OptionError as error:
        raise OptionError(f"{name}: {error}") from None
    except Exception as error:  # of a face of others
        raise OptionError(f"{name} cannot be made: {text_of(error)}") from error


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
