"""What an installed umo reads beside its Python is in its package."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
OF_A_BUILD = {".py", ".pyc", ".so", ".pyd"}


def files_of(table: str) -> set[Path]:
    """The files that a table of patterns by package names."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    return {
        file
        for package, patterns in tool[table].items()
        for pattern in patterns
        for file in (ROOT / "src" / package.replace(".", "/")).glob(pattern)
    }


def test_every_file_that_is_no_python_is_packaged_or_left_out_by_name() -> None:
    packages = (ROOT / "src" / "umo", ROOT / "src" / "umo_command")
    files = {each for package in packages for each in package.rglob("*") if each.is_file()}
    files = {each for each in files if each.suffix not in OF_A_BUILD}
    missing = files - files_of("package-data") - files_of("exclude-package-data")
    assert sorted(str(each.relative_to(ROOT)) for each in missing) == []
