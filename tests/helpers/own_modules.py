"""The modules of umo and of its command, and their texts. To parse them all takes 2 s of processor time: what a test
looks for is looked for in the texts first, and what has it is parsed."""

import re
from functools import cache
from pathlib import Path

import umo

SRC = Path(umo.__file__).parents[1]
BETWEEN = re.compile(r"""(["'])[ \t]*\n\s*[rRfFbB]*["']""")
"""What stands between two parts of one text of the code, which are on two lines."""


def own_modules() -> dict[str, Path]:
    """The files by their places, without templates: `process/reset.py` in umo, `umo_command/app.py` beside it."""
    files = [*sorted((SRC / "umo").rglob("*.py")), *sorted((SRC / "umo_command").rglob("*.py"))]
    places = {file.relative_to(SRC).as_posix().removeprefix("umo/"): file for file in files}
    return {place: file for place, file in places.items() if "template" not in file.parts}


@cache
def texts() -> dict[str, str]:
    """The code by place."""
    return {place: file.read_text("utf-8") for place, file in own_modules().items()}


def on_one_line(code: str) -> str:
    """The code with its texts of several parts in one line each."""
    return BETWEEN.sub("", code)
