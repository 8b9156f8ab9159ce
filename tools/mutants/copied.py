"""A copy of a checkout, with an environment in which every process of the tests imports the copy."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

PLUGIN = "umo_mutants_plugin"
COVERED = """\
import os
if os.environ.get("COVERAGE_PROCESS_START"):
    import coverage
    coverage.process_startup()
"""
"""Run at the start of each process of the copy."""
NOTE_TEST = """\
import json, os, time
import pytest

@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item, nextitem):
    import coverage
    name = item.nodeid.partition("[")[0]
    os.environ["UMO_TEST"] = name  # of the processes that the test starts
    running = coverage.Coverage.current()
    if running is not None:
        running.switch_context(name)
    began = time.monotonic()
    yield
    with open(os.environ["UMO_MUTANTS_TIMES"], "a") as file:
        file.write(json.dumps([name, time.monotonic() - began]) + "\\n")
"""


class Copied:
    """`folder`/copy, from the files of the checkout `tree` that git knows and its built extensions."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.root = folder / "copy"
        if not (self.root / ".venv").exists():
            self._copy(tree)
            self._environment(tree)
        self.python = self.root / ".venv" / "bin" / "python"

    def _copy(self, tree: Path) -> None:
        shutil.rmtree(self.root, ignore_errors=True)
        known = subprocess.run(["git", "ls-files", "-z"], cwd=tree, capture_output=True, text=True, check=True)
        built = [str(file.relative_to(tree)) for file in tree.glob("src/**/*.so")]
        for name in [*filter(None, known.stdout.split("\0")), *built]:
            if (tree / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(tree / name, self.root / name)

    def _environment(self, tree: Path) -> None:
        """What the checkout has installed but umo itself, and after it what this program has: coverage."""
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", self.root / ".venv"], check=True)
        (place,) = (self.root / ".venv").glob("lib/python*/site-packages")
        theirs = next((tree / ".venv").glob("lib/python*/site-packages"))
        lines = [self.root / "src", theirs, sysconfig.get_path("purelib"), "import umo_mutants_start"]
        (place / "umo_mutants.pth").write_text("\n".join(map(str, lines)) + "\n")
        (place / "umo_mutants_start.py").write_text(COVERED)
        (place / f"{PLUGIN}.py").write_text(NOTE_TEST)
        command = self.root / ".venv" / "bin" / "umo"
        command.write_text(
            f"#!{command.with_name('python')}\nimport sys\nfrom umo_command import main\nsys.exit(main())\n"
        )
        command.chmod(0o755)

    def pytest(self, words: list[str], seconds: float, **environment: str) -> tuple[int | None, str]:
        """Status and output of pytest in the copy; without a status if it took longer. No process of it stays."""
        command = [self.python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
        with subprocess.Popen(
            command, cwd=self.root, env=os.environ | environment, text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        ) as process:  # fmt: skip
            try:
                output, _ = process.communicate(timeout=seconds)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                return None, process.communicate()[0]
            return process.returncode, output
