"""`umo new controller`: writes the files of a controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from umo.errors import OptionError
from umo.exit_status import ExitStatus
from umo.generate.controller_folder import NotTranslated, write_folder
from umo.generate.controller_generator import generated, target_of
from umo.generate.split.part_generator import part_files
from umo.process.station import Station
from umo_command.console import err, out
from umo_command.station_options import machine_of


def generate_controller(
    station: Station,
    wiring: str | None,
    target: str,
    real: str | None,
    folder: Path,
    arguments: Sequence[str],
    controller: str | None = None,
) -> int:
    """Write the folder, and print which files were kept. If some code cannot be translated, print its places, one per
    line, and write nothing."""
    if real not in (None, "double", "float"):
        raise OptionError(f"--real {real} is neither double nor float")
    chosen = target_of(target, real)  # type: ignore[arg-type]
    try:
        machine, lines = machine_of(station, arguments), station.wiring(wiring)
        if controller is None:
            files = generated(machine, lines, chosen)
        else:
            files = part_files(machine, lines, controller, chosen)
    except NotTranslated as error:
        for line in str(error).splitlines():
            err.print(line, soft_wrap=True, markup=False)
        return ExitStatus.MISTAKE
    kept = write_folder(files, folder)
    out.print(f"{folder}: {len(files) - len(kept)} files, numbers are {chosen.real}s", soft_wrap=True)
    if kept:
        out.print(f"kept as they were: {', '.join(kept)}", soft_wrap=True)
    return 0
