"""The processes of the bench: started on a computer, stopped, killed, begun again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import umo

UMO = (sys.executable, "-c", "from umo_command import main; main()")
ROOT = Path(__file__).parents[2]
LIMIT = 10.0
"""Time in s within which a process that is told to end must have ended."""


def environment(folder: Path) -> dict[str, str]:
    """That of a computer of which the files are in `folder`."""
    places = {name: str(folder / name.lower()) for name in ("UMO_FRAMES", "UMO_STATE", "XDG_CONFIG_HOME")}
    for place in places.values():
        Path(place).mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join((str(Path(umo.__file__).parents[1]), str(ROOT)))
    return os.environ | places | {"PYTHONPATH": paths, "PYTHONUNBUFFERED": "1"}


class Part:
    """One process. `before`: the words that bring it to its computer. What it says goes to a file."""

    def __init__(
        self, name: str, words: Sequence[str], folder: Path, environ: Mapping[str, str], before: Sequence[str] = ()
    ) -> None:
        self.name, self._words, self._environ = name, (*before, *words), dict(environ)
        self.log = folder / f"{name.replace('/', '_')}.log"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with open(self.log, "ab") as log:
            self._process = subprocess.Popen(
                self._words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self._environ, cwd=ROOT
            )

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    @property
    def is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def said(self) -> str:
        """All that it has said."""
        return self.log.read_text(errors="replace")

    def signal(self, number: int) -> None:
        if self.is_running:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """As if the power failed: it does nothing any more."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def end(self, limit: float = LIMIT) -> None:
        """End it as a service manager does."""
        if self._process is None:
            return
        self.signal(signal.SIGCONT)
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(limit)
        self.kill()

    @property
    def processor(self) -> float:
        """s that it has had a processor."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    @property
    def memory(self) -> float:
        """Resident, MB."""
        return int(Path(f"/proc/{self.pid}/status").read_text().partition("VmRSS:")[2].split()[0]) / 1000
