"""The modules of umo and of its command."""

from pathlib import Path

import umo

SRC = Path(umo.__file__).parents[1]


def own_modules() -> dict[str, Path]:
    """The files by their places, without templates: `process/reset.py` in umo, `umo_command/app.py` beside it."""
    files = [*sorted((SRC / "umo").rglob("*.py")), *sorted((SRC / "umo_command").rglob("*.py"))]
    places = {file.relative_to(SRC).as_posix().removeprefix("umo/"): file for file in files}
    return {place: file for place, file in places.items() if "template" not in file.parts}
