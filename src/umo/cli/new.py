"""`umo new`: a small working station to begin from (the files of `template/`)."""

from __future__ import annotations

import shutil
from importlib.resources import as_file, files
from pathlib import Path

from umo.process.station import StationError

from .console import out


def make_station(directory: Path) -> None:
    """Copy the template. StationError if the directory exists and is not empty."""
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise StationError(f"{directory} is not empty; nothing was written")
    try:
        with as_file(files("umo.cli") / "template") as template:
            shutil.copytree(template, directory, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as error:
        raise StationError(f"{directory} cannot be written: {error}") from error
    out.print(f"{directory} is a station. Try:  umo run {directory}   umo tree {directory}   pytest {directory}")
