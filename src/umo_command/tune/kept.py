"""`umo tune kept` lists the kept values of a station. `umo tune save` prints the lines of a wiring that keep the tuned
numbers."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.digits import setting_text
from umo.duration import lasting
from umo.errors import CommandRefused, PathError, UmoError
from umo.objects.presentation.value_text import shown_unit
from umo.process import kept_file
from umo.process.frames import RunReader
from umo.process.frames.search import station_name
from umo.process.kept_file import KeptFileError, KeptValues
from umo.text import did_you_mean, printable, time_of_day
from umo_command.console import err, out

LOCK_TIMEOUT = 0.5
"""Time in s to wait for a run that has just ended."""


def kept(station: str, wiring: str | None, forget: str | None) -> None:
    """List the kept values of a station, for all wirings or for one, or forget one number."""
    name = station_name(station) if Path(station).is_dir() else station
    try:
        files = [(path, values) for path, values in kept_file.all_kept(name) if _is_of(values, wiring)]
    except OSError as error:
        raise KeptFileError(f"the kept values cannot be found: {error.strerror or error}") from None
    if not files:
        of = f" with the wiring {wiring}" if wiring is not None else ""
        raise PathError(
            f"no values are kept of {name}{of}; a run in real time keeps the numbers that are declared kept=True"
        )
    if forget is not None:
        _forget(files, forget)
        return
    for path, values in files:
        if isinstance(values, KeptFileError):
            err.print(f"{path}: {values}", style="red", soft_wrap=True)
        else:
            _list(path, values)


def _is_of(values: KeptValues | KeptFileError, wiring: str | None) -> bool:
    return wiring is None or (isinstance(values, KeptValues) and values.wiring == Path(wiring).stem)


def _list(path: Path, values: KeptValues) -> None:
    name = ", ".join(filter(None, (values.station, values.wiring)))
    age = time.time() - values.utc  # other clocks begin at the start of the computer, maybe after the values
    when = f"{lasting(age)} ago" if age >= 0 else f"at {time_of_day(values.utc)}, later than the clock shows now"
    out.print(f"{printable(name)}: kept {when}, in period {values.period}", soft_wrap=True)
    table = Table("number", "value", "unit", header_style="bold")
    for number, entry in values.numbers.items():
        table.add_row(printable(number), _text(entry["value"]), shown_unit(entry["unit"]))
    out.print(table)
    if states := values.sections.get(kept_file.STATES):
        told = ", ".join(f"{part} {state}" for part, state in states.items())
        out.print(f"in that period: {printable(told)}", soft_wrap=True)
    out.print(str(path), soft_wrap=True)


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    return setting_text(value) if isinstance(value, int | float) else printable(str(value))


def _forget(files: list[tuple[Path, KeptValues | KeptFileError]], number: str) -> None:
    """Remove a number from every file of kept values. Raises CommandRefused while a run uses the values."""
    known = {path for _, values in files if isinstance(values, KeptValues) for path in values.numbers}
    if number not in known:
        raise PathError(f"{number!r} is not kept{did_you_mean(number, known)}")
    for path, _ in files:
        try:
            with kept_file.locked(path, LOCK_TIMEOUT) as mine:
                if not mine:
                    raise CommandRefused("a run is using the kept values; end the run first: umo do STATION stop")
                values = kept_file.read(path)
                if values is not None and values.numbers.pop(number, None) is not None:
                    kept_file.write(path, kept_file.dump(values))
                    out.print(f"{number} is forgotten: the next run has its default", soft_wrap=True)
        except OSError as error:
            raise UmoError(f"{path} cannot be written: {error.strerror or error}") from None


def save_tuned(reader: RunReader) -> None:
    """Print which tuned numbers are kept values. For the others, print the lines of the wiring that keep them, as valid
    TOML with all digits."""
    kept, tuned = reader.kept, reader.tuned()
    for path in tuned:
        if path in kept:
            err.print(f"{path} is declared kept: the next run has it without a line in the wiring", soft_wrap=True)
    lines = [toml_line(path, repr(value)) for path, value in tuned.items() if path not in kept]
    if lines:
        out.print("[parameters]", *lines, sep="\n", markup=False, highlight=False, soft_wrap=True)
    elif not tuned:
        err.print(f"nothing was tuned in {reader.about['station']} since it was started", soft_wrap=True)


def toml_line(path: str, number: str) -> str:
    """Return the line of `[parameters]` that gives a number its value. It is valid TOML for every path."""
    text = path.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{text}" = {number}'
