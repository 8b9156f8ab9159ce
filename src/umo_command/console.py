"""The two consoles through which all text reaches the terminal. Piped text is not cut to 80 columns, and brackets in a
user's names are not markup.

Texts also come from other processes and users: names of stations and devices, records, holders of a lease, errors. None
of these texts reaches the terminal with its control characters.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from umo.system.streams import CLEAR_LINE
from umo.text import cut_words, printable

PIPE_WIDTH = 160


class PrintableConsole(Console):
    """A console that shows control characters of a text as `?`, because a terminal would obey them."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                text = "\n".join(map(printable, segment.text.split("\n")))
                yield Segment(text, segment.style, segment.control)


def _console(stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else PIPE_WIDTH
    return PrintableConsole(highlight=False, markup=False, emoji=False, width=width, stderr=stderr)


out, err = _console(stderr=False), _console(stderr=True)


def plain_table() -> Table:
    """Return a table without a frame, with a line below its headings."""
    return Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="bold", padding=(0, 1, 0, 0))


def say(text: str, style: str = "") -> None:
    """Print a message of umo on stderr, on a separate line. Long words in the message are cut."""
    if err.is_terminal:
        err.file.write(CLEAR_LINE)
    err.print(f"umo: {cut_words(text)}", style=style, soft_wrap=True)
