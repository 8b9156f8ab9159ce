"""The keys of a fleet: `umo/SITE/STATION/` and one word for each kind of message."""

from __future__ import annotations

import re
from typing import NamedTuple

from umo.errors import OptionError
from umo.objects.presentation.identity import escaped, is_word, shortened

ROOT = "umo"
DECLARATION, DELTA, EVENT, STATUS, ALIVE, COMMAND, SIGN, TWIN, PAST = (
    "declaration",
    "delta",
    "event",
    "status",
    "alive",
    "command",
    "sign",
    "twin",
    "past",
)
ANY = "*"
MAX_SEGMENT = 64
"""Largest number of characters of one word of a key."""
_SEGMENT = re.compile(rf"[\w.-]{{1,{MAX_SEGMENT}}}", re.ASCII)


class StationKey(NamedTuple):
    """A station of a fleet, as in `cell7/press`."""

    site: str
    station: str

    def __str__(self) -> str:
        return f"{self.site}/{self.station}"

    def key(self, *words: str) -> str:
        return "/".join((ROOT, self.site, self.station, *words))


EVERY = StationKey(ANY, ANY)


def station_key(text: str) -> StationKey:
    """Return the station that `SITE/STATION` names. Raises OptionError if the string does not name one."""
    site, slash, station = text.partition("/")
    if not (slash and _SEGMENT.fullmatch(site) and _SEGMENT.fullmatch(station)):
        raise OptionError(
            f"{text!r} is not a station of a fleet; write SITE/STATION, as `umo show stations --fleet` lists them"
        )
    return StationKey(site, station)


def is_station_key(text: str) -> bool:
    """True if a name can be that of a station of a fleet."""
    site, slash, station = text.partition("/")
    return bool(slash) and all(_SEGMENT.fullmatch(each) and each.strip(".") for each in (site, station))


def segment(text: str) -> str:
    """Return a name as one word of a key (`umo.objects.presentation.identity`). Characters other than ASCII letters,
    digits, `_`, `.` and `-` are escaped. A name that is too long for a key is shortened, and ends with a digest."""
    dots = {text} if text and not text.strip(".") else ()
    return shortened(escaped(text, lambda each: is_word(each) or each in ".-", dots), MAX_SEGMENT)


def station_of(key: str) -> StationKey:
    """Return the station that a key belongs to."""
    _, site, station, *_ = key.split("/")
    return StationKey(site, station)
