"""Which test reaches which line, from one run of the tests with coverage, and how long each test takes."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

from tools.mutants.copied import PLUGIN, Copied

PACKAGES = ("cycle", "objects", "process", "operation", "generate", "recording", "clients/faces")
"""The parts of umo that are changed."""
CONFIGURATION = """
[run]
source = {sources}
data_file = {data}
parallel = true
context = ${{UMO_TEST-}}
patch =
    _exit
    fork
"""
"""Not `subprocess`: it would hand on the context of the process's start; the copy starts coverage by itself."""
HOURS = 6 * 3600.0


def collect(copied: Copied, folder: Path, words: list[str]) -> str:
    """Run the tests; the last line of pytest. `words` go to pytest."""
    for old in folder.glob("coverage*"):
        old.unlink()
    (folder / "times.jsonl").unlink(missing_ok=True)
    sources = ",".join(str(copied.root / "src" / "umo" / package) for package in PACKAGES)
    (folder / "coverage.ini").write_text(CONFIGURATION.format(sources=sources, data=folder / "coverage.data"))
    environment = {
        "COVERAGE_PROCESS_START": str(folder / "coverage.ini"),
        "UMO_MUTANTS_TIMES": str(folder / "times.jsonl"),
    }
    _, output = copied.pytest(["-p", PLUGIN, *words], HOURS, **environment)
    (folder / "collect.log").write_text(output)
    return (output.strip().splitlines() or [""])[-1]


class Reached:
    """What a run of `collect` left in a folder."""

    def __init__(self, folder: Path, root: Path) -> None:
        import coverage

        self._data = coverage.CoverageData(str(folder / "combined.data"))
        if not (folder / "combined.data").exists():
            parts = [str(file) for file in folder.glob("coverage.data.*")]
            found = coverage.Coverage(str(folder / "combined.data"), config_file=False)
            found.combine(parts, keep=True)
            found.save()
        self._data.read()
        self._root = root
        self.seconds: dict[str, float] = defaultdict(float)
        """Time of a test with all its cases."""
        for line in (folder / "times.jsonl").read_text().splitlines():
            name, seconds = json.loads(line)
            self.seconds[name] += seconds

    def tests(self, file: str, *lines: int) -> list[str]:
        """Tests that reach the first of the lines that any reaches, the quickest first."""
        known = self._data.contexts_by_lineno(str(self._root / file))
        contexts = next((found for line in lines if any(found := known.get(line, []))), [])
        return sorted(filter(None, contexts), key=lambda name: self.seconds[name])
