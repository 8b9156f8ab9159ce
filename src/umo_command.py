"""The command `umo`, from its first moment on: Ctrl-C while the package is still imported ends it without a traceback.

The module stands beside the package: what stands in it is run when the package has been imported.
"""

from __future__ import annotations

import signal


def main() -> None:
    """Entry point. Status 130: Ctrl-C before a command has begun."""
    try:
        from umo.cli import main as command

        command()
    except KeyboardInterrupt:
        raise SystemExit(128 + signal.SIGINT) from None


if __name__ == "__main__":
    main()
