"""Live tables and scopes of a running station in a notebook. IPython is imported only when a table or scope is
requested."""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from umo.errors import FramesError
from umo.objects.presentation.html_table import never_raises
from umo.process.frames import Reader, Stage
from umo.system.packages import how_to_install

MAX_RATE = 4.0
"""Largest number of pictures per second."""
PAUSE_RATIO = 9
"""Pause after a picture, as a multiple of the time to draw that picture. The pause leaves the computer time for the
station."""
Draw = Callable[[dict[str, str]], str]
"""Function that returns the HTML of a picture, and further facts for its heading."""


class LiveView:
    """A picture in a notebook, displayed in the cell that created it. A thread draws it again until the station has
    ended, until `stop()`, or until this program ends."""

    def __init__(self, reader: Reader, make: Callable[[Reader], Draw]) -> None:
        """`make` is called with a separate reader, which only the thread uses and closes."""
        display = _display()
        self.station = str(reader.about["station"])
        if reader.closed or reader.state is Stage.ENDED:
            raise FramesError(f"{self.station} has ended")
        self._stopped = threading.Event()
        self._reader = reader.again()
        self._reader.skip_older_half()
        try:
            self._draw = make(self._reader)
            self._handle = display(self._bundle(self._draw({})), raw=True, display_id=True)
        except BaseException:
            self._reader.close()
            raise
        self._thread = threading.Thread(target=self._follow, name="umo live view", daemon=True)
        atexit.register(self.stop)
        self._thread.start()

    @property
    def live(self) -> bool:
        """True while the picture is updated."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Stop updating the picture."""
        self._stopped.set()
        self._thread.join()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the station has ended and its last picture is shown. Raises TimeoutError after `timeout` s."""
        self._thread.join(timeout)
        if self.live:
            raise TimeoutError(f"{self.station} is still running after {timeout:g} s")

    def _follow(self) -> None:
        pause = 1 / MAX_RATE
        with suppress(Exception), self._reader:  # the notebook may be gone, with all that it displays
            while not self._stopped.wait(pause):
                began = time.monotonic()
                ended = self._reader.state is Stage.ENDED  # before the picture, which then has the last frame
                self._handle.update(self._bundle(self._repr_html_()), raw=True)
                if ended:
                    break
                pause = max(1 / MAX_RATE, PAUSE_RATIO * (time.monotonic() - began))
            else:
                self._handle.update(self._bundle(self._repr_html_()), raw=True)
        atexit.unregister(self.stop)

    @never_raises
    def _repr_html_(self) -> str:
        return self._draw({"view": "stopped"} if self._stopped.is_set() else {})

    def _bundle(self, html: str) -> dict[str, str]:
        return {"text/html": html, "text/plain": repr(self)}

    def _ipython_display_(self) -> None:
        """Display nothing if the view is the last expression of a cell, because the picture is already displayed."""

    def __repr__(self) -> str:
        return f"<live view of {self.station}>"


def _display() -> Any:
    """Return the function `display` of IPython. Raises FramesError outside of a notebook, because a terminal would
    print every picture."""
    try:
        from IPython import get_ipython
        from IPython.display import display
    except ImportError:
        raise FramesError(f"a live view needs IPython: {how_to_install('notebook')}") from None
    shell = get_ipython()
    if shell is None or type(shell).__name__ == "TerminalInteractiveShell":
        raise FramesError("a live view needs a notebook; in a terminal use `umo show values`")
    return display
