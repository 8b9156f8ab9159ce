"""The black boxes that the page tells of."""

from __future__ import annotations

import time

from umo.clients.page.ending import BoxInWords, newest_box
from umo.process.frames import Reader, blackbox, rings

from .conftest import running


def kept(reason: str) -> Reader:
    """The station that runs, with a new black box."""
    (ring,) = rings()
    reader = Reader(ring)
    path = blackbox.name_for(blackbox.folder(), "press", time.time())
    blackbox.save(reader, path.with_name(path.name.replace(".box", f"-{reason}.box")), reason)
    return reader


def test_a_black_box_belongs_to_its_run() -> None:
    with running(), kept("first") as reader:
        first = newest_box(reader.about, BoxInWords())
        assert first.text.endswith(": first")
        assert newest_box(reader.about, first) is first
    with running(), Reader(rings()[0]) as reader:
        assert newest_box(reader.about, BoxInWords()) == BoxInWords()  # that of the run before is not this one's
        with kept("second"):
            assert newest_box(reader.about, BoxInWords()).text.endswith(": second")


def test_a_damaged_black_box_is_nobodys() -> None:
    with running(), kept("whole") as reader:
        damaged = blackbox.name_for(blackbox.folder(), "press", time.time() + 1)
        damaged.write_bytes(b"umoframe" + bytes(500))
        assert newest_box(reader.about, BoxInWords()).text.endswith(": whole")
