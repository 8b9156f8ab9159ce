"""Trying gains for a limited time on a running station, through its tunable numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress

from umo.commissioning.tuning.running_station import RunningStation
from umo.errors import OptionError, UmoError


def check_tunable(station: RunningStation, law: str, names: Iterable[str]) -> None:
    """Check that these settings of a law are tunable. Raises OptionError if one of them is not."""
    known = station.reader.tunables()
    missing = [each for name in names if (each := f"{law}.{name}") not in known]
    if missing:
        raise OptionError(f"{' and '.join(missing)}: not tunable, so new gains cannot be tried on a running station")


@contextmanager
def trying(station: RunningStation, law: str, settings: Mapping[str, float]) -> Iterator[None]:
    """Return a context in which a law has these settings, by name; at its end the old settings are restored, if the
    lease is still held. Raises OptionError if a setting is not tunable, RangeError if it is outside of its range."""
    check_tunable(station, law, settings)
    known = station.reader.tunables()
    paths = {f"{law}.{name}": value for name, value in settings.items()}
    try:
        for path, value in paths.items():
            station[path] = value
        yield
    finally:
        for path in paths:
            with suppress(UmoError):  # of a lease that is lost: what ended it is raised
                station[path] = known[path]
