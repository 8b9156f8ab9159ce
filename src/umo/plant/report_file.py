"""A report that is a file of JSON, kept by a process that runs for long."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from umo.errors import DriverError, WiringError
from umo.text import reason_of


class ReportFile:
    """Replaced whole: whoever reads it never finds half of one. A symlink stays, the file behind it is replaced.

    Nothing but a regular file is ever replaced. WiringError at once where none can be written.
    """

    def __init__(self, path: Path) -> None:
        self._given = path
        try:
            self._path = path.resolve()
            self._look()
            self._draft = self._path.with_name(f".umo-report-{os.getpid()}")
            self._fill_draft("")
            self._draft.unlink()
        except (OSError, RuntimeError, ValueError) as error:  # the last two: a loop of symlinks, a null byte
            raise WiringError(f"no report can be written to {path}: {reason_of(error)}") from None

    def write(self, content: Mapping[str, object]) -> None:
        """DriverError where it cannot be written any more; the file then is as it was."""
        try:
            self._fill_draft(json.dumps(content, indent=2) + "\n")
            self._look()
            self._draft.replace(self._path)
        except OSError as error:
            with suppress(OSError):
                self._draft.unlink()
            raise DriverError(f"the report {self._given} cannot be written: {reason_of(error)}") from None

    def _look(self) -> None:
        try:
            mode = self._path.lstat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISREG(mode):
            raise OSError("this is not a regular file")

    def _fill_draft(self, text: str) -> None:
        self._draft.unlink(missing_ok=True)
        with self._draft.open("x") as file:  # a new file, not one that somebody else has put there
            file.write(text)
