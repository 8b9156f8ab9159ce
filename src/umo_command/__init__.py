"""The command `umo`: what a person types, and sees on a terminal. It uses `umo`, which does not know it.

From its first moment on Ctrl-C ends it without a traceback, also while umo is still imported: nothing is imported here.
"""

from __future__ import annotations

import signal


def main() -> None:
    """Entry point. Status 130: Ctrl-C before a command has begun."""
    try:
        from umo_command.words import carry_out

        carry_out()
    except KeyboardInterrupt:
        raise SystemExit(128 + signal.SIGINT) from None
