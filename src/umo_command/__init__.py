"""The command `umo`: what a person types and sees on a terminal. This package uses `umo`; `umo` does not depend on it.

Ctrl-C ends the command without a traceback from the very start, even while umo is still being imported. For this reason
nothing is imported here.
"""

from __future__ import annotations

import signal


def main() -> None:
    """Run the command: the entry point. The exit status is 130 if Ctrl-C comes before a command has begun."""
    try:
        from umo_command.words import carry_out

        carry_out()
    except KeyboardInterrupt:
        raise SystemExit(128 + signal.SIGINT) from None
