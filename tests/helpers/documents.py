"""The pages of the documentation and their code blocks."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```", re.M | re.S)


def blocks(page: Path, language: str) -> list[tuple[str, str]]:
    """(what stands behind the language, text) of each block of the page."""
    return [(rest.strip(), text) for name, rest, text in BLOCK.findall(page.read_text("utf-8")) if name == language]


def write_files(page: Path, folder: Path) -> None:
    """The blocks that name a file: ```python objects.py, ```toml wiring/bench.toml; then what `$ pythonfmu` builds."""
    for language in ("python", "toml"):
        for rest, text in blocks(page, language):
            if "." in rest:
                (folder / rest).parent.mkdir(exist_ok=True)
                (folder / rest).write_text(text)
    for _, text in blocks(page, "console"):
        for line in re.findall(r"^\$ pythonfmu (.*)$", text, re.M):
            subprocess.run([sys.executable, "-m", "pythonfmu", *shlex.split(line)], cwd=folder, check=True)
