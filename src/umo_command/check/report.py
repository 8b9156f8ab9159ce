"""`umo check`: checks a station and prints the result."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from rich.text import Text

from umo.cycle.inhibition import interlocks_of
from umo.duration import duration
from umo.errors import Mistake, OptionError, WiringError
from umo.exit_status import ExitStatus
from umo.objects import Compound, actions_of, numbers_of
from umo.objects.paths import atoms, path_of
from umo.operation.alarms.alarming import declared_alarms, turn_text
from umo.plant.twin.declared import declared_by
from umo.process.frames import Reader
from umo.process.frames.machine_items import RUN_ITEMS
from umo.process.source_files import changed_files, changed_text
from umo.process.station import Station
from umo.text import count_of, cut_words, did_you_mean, some
from umo.wiring import check, resolve
from umo.wiring.patterns import places_below
from umo.wiring.process_table import remarks
from umo.wiring.settings import SettingsError
from umo.wiring.wired import Wired
from umo_command.check.code_check import mistakes_in
from umo_command.check.code_units import wrong_settings
from umo_command.console import err, out, say
from umo_command.run.faces_beside import faces_of, names_in
from umo_command.run.record_beside import check_installed
from umo_command.show.stations import readers
from umo_command.station_options import machine_of

MISTAKEN_UNITS = {"C": ("coulomb", "degC"), "F": ("farad", "degF")}
"""Units that are easily written for another one: the unit that it is, and the one that is probably meant."""
COMPILE = "compile"
"""The name of the target for compiled laws, used in place of a target of `umo new controller`."""


def check_station(
    station: Station,
    wiring: str | None,
    every: bool = False,
    arguments: Sequence[str] = (),
    target: str | None = None,
) -> int:
    """Print every error in the code and in one or all wirings. If there is none, print the wires, and the names of the
    wirings that were not checked. With a target, also print the code that cannot be translated. Return 2 if there are
    errors."""
    if every and wiring is not None:
        raise OptionError("give --wiring or --all, not both")
    _check_name_of(target)
    machine = machine_of(station, arguments)
    station.module("application")  # the application may fail to import, even if the wiring is right
    interlocks_of(machine)
    declared_alarms(machine)
    if (twin := declared_by(station, machine)) is not None:
        twin.describe(machine)
    check_recipes(machine)
    check_units(machine)
    in_code = reported([*wrong_settings(machine, station.name), *mistakes_in(station, machine)])
    files = list(station.wirings.values()) if every and station.wirings else [station.wiring(wiring)]
    statuses = [_check_wiring(machine, file, target) or _check_target(machine, file, target) for file in files]
    for reader in running_in(station.path):
        if changed := changed_text(changed_files(reader.about)):
            out.print(f"note: {station.name} is running (pid {reader.about['pid']}): {changed}", soft_wrap=True)
    if others := [name for name, file in station.wirings.items() if file not in files]:
        out.print(f"not checked: {', '.join(others)} (-w NAME, or --all)", soft_wrap=True)
    if in_code:  # printed last, because the lines above may say that the wiring is in order
        say(f"{count_of(in_code, 'error')} in the code")
    return max([*statuses, ExitStatus.MISTAKE] if in_code else statuses)


def running_in(folder: Path) -> Iterator[Reader]:
    """Return the active runs of the station in a folder."""
    for reader in readers():
        with reader:
            if reader.about["place"] == str(folder):
                yield reader


def check_units(machine: Compound) -> None:
    """Print a note for each unit that is probably another one, such as "C", the coulomb."""
    units = {path_of(each): str(getattr(each, "units", "")) for each in atoms(machine)}
    units |= {path: number.declared.unit for path, number in numbers_of(machine).items()}
    for unit, (name, meant) in MISTAKEN_UNITS.items():
        if paths := [path for path, found in units.items() if found == unit]:
            out.print(f'note: {some(paths)}: the unit "{unit}" is the {name}; degrees are "{meant}"', soft_wrap=True)


def check_recipes(machine: Compound) -> None:
    """Print how many recipes the machine has. Wrong recipes were already refused when the machine was declared."""
    if "umo.operation.recipe_book" not in sys.modules:
        return
    from umo.operation.recipe_book import books_of

    for book in books_of(machine).values():
        out.print(f"ok: {book.place}: {count_of(len(book.recipes), 'recipe')}", soft_wrap=True)


def _check_wiring(machine: Compound, file: Path | None, target: str | None) -> int:
    if reported(check(machine, file)):
        return ExitStatus.MISTAKE
    wired = resolve(machine, file, to_run=False)
    notes: list[str] = []
    try:
        faces = names_in(faces_of(str(file), wired.faces, notes.append))
        recorded = wired.record is not None
        if wired.record is not None:
            check_installed()
            from umo.recording.record_settings import record_of

            record_of(wired.record, str(file))
    except (WiringError, SettingsError) as error:
        reported(list(error.mistakes))
        return ExitStatus.MISTAKE
    tunable = sum(number.declared.tunable for number in numbers_of(machine).values())
    alarms = declared_alarms(machine)
    offered = [(len(actions_of(machine)), "action"), (tunable, "tunable number"), (len(alarms), "alarm")]
    period = "no timer" if wired.period is None else f"period {duration(wired.period)}"
    found = [
        f"{count_of(len(wired.wires), 'object')} on {count_of(len(wired.drivers), 'driver')}",
        period,
        *(count_of(number, what) for number, what in offered if number),
        *([f"served by {', '.join(faces)}"] if faces else []),
        *(["recorded"] if recorded else []),
    ]
    out.print(f"ok: {file or 'everything simulated'}: {', '.join(found)}", soft_wrap=True)
    for line in _rates(wired):
        out.print(line, soft_wrap=True)
    if late := turn_text(alarms, wired.period):
        out.print(late, soft_wrap=True)
    notes += [*_without_number(machine, wired), *([] if target == COMPILE else _in_python(machine, wired))]
    if wired.mixed_times:
        notes.append(f"{wired.mixed_times}: this wiring runs with --realtime only")
    for remark in [*remarks(wired), *notes]:
        out.print(f"note: {remark}", soft_wrap=True, markup=False)
    return 0


def _without_number(machine: Compound, wired: Wired) -> Iterator[str]:
    """Yield a remark for each dead band of the faces whose path matches no number. Only the run knows the signals."""
    known = [
        *(path_of(each) for each in atoms(machine) if not each._has_states),
        *(f"tunable:{path}" for path, number in numbers_of(machine).items() if number.declared.tunable),
        *(f"run:{path}" for path, about in RUN_ITEMS.items() if "states" not in about),
    ]
    for pattern in wired.faces.get("dead_bands", {}):
        if not places_below(pattern, known):
            near = did_you_mean(pattern, known)
            yield f"faces.dead_bands: {pattern!r} is no sensor, actuator or tunable number{near}; is it a signal?"


def _in_python(machine: Compound, wired: Wired) -> Iterator[str]:
    """Yield a remark if the wiring requests compiled laws and these will run in Python."""
    if wired.process.compile and (reasons := _not_compiled(machine, wired)):
        more = f", and {len(reasons) - 1} more (umo check --target {COMPILE} lists all)" if reasons[1:] else ""
        yield f"compile = true: the laws will run in Python: {reasons[0]}{more}"


def _not_compiled(machine: Compound, wired: Wired) -> list[str]:
    """Return why the laws of a machine cannot be compiled."""
    from umo.generate.compiled_laws import NotCompiled, source_of

    try:
        source_of(machine, wired)
    except NotCompiled as error:
        return error.reasons
    return []


def _check_target(machine: Compound, file: Path | None, target: str | None) -> int:
    """Print the parts of a machine that cannot be translated for a target, or None if no target is given."""
    if target is None:
        return 0
    reasons = _untranslated(machine, file, target)
    for reason in reasons:
        err.print(reason, soft_wrap=True, markup=False)
    what = "compile = true" if target == COMPILE else f"umo new controller --target {target}"
    if reasons:
        say(f"{what}: {count_of(len(reasons), 'place')} of {type(machine).__name__} cannot be translated")
        return ExitStatus.MISTAKE
    out.print(f"ok: {what}: all code can be translated", soft_wrap=True)
    return 0


def _check_name_of(target: str | None) -> None:
    """Raise OptionError if there is no such target."""
    if target in (None, COMPILE):
        return
    from umo.generate.controller_folder import TARGETS

    if target not in TARGETS:
        raise OptionError(f"--target {target} is not one of {', '.join((*TARGETS, COMPILE))}")


def _untranslated(machine: Compound, file: Path | None, target: str) -> list[str]:
    """Return what cannot be translated for a target."""
    if target == COMPILE:
        return _not_compiled(machine, resolve(machine, file, to_run=False))
    from umo.generate.controller_folder import NotTranslated
    from umo.generate.controller_generator import generated, target_of

    try:
        generated(machine, file, target_of(target))
    except NotTranslated as error:
        return error.reasons
    return []


def _rates(wired: Wired) -> Iterator[str]:
    """The parts with rates of their own, a line for each rate: `every 10 periods (10 ms): oven`."""
    for every, rates in groupby(wired.rates, lambda rate: rate.every):
        period = f" ({duration(every * wired.period)})" if wired.period else ""
        yield f"every {count_of(every, 'period')}{period}: {some([rate.part._path for rate in rates])}"


def reported(mistakes: list[Mistake]) -> int:
    """Print every error. Return the number of errors."""
    for mistake in mistakes:
        err.print(cut_words(str(mistake)), soft_wrap=True)
    return len(mistakes)


def label(*words: tuple[str, str]) -> Text:
    """Return a text of words, each with its style, separated by two blanks."""
    return Text("  ").join(Text(word, style) for word, style in words)
