"""Context of its own."""

from __future__ import annotations

import threading

from helpers.written_programs import Program


class ContextOfItsOwn(Program):
    def begin(self) -> None:
        self.lock = threading.Lock()

    def control(self) -> None:
        # refused: `with` cannot be translated; with suppress(...), with np.errstate(all='ignore')
        with self.lock:
            self.k = 1.0
