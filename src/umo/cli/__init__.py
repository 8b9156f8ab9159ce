"""The commands of `umo`, which `umo_command` starts."""

import sys


def main() -> None:
    """Carry out the command of this process; typer and what it needs are imported here, not with umo."""
    from umo.system.streams import keep_open, log_on_lines

    keep_open()
    log_on_lines()
    from umo.cli.app import app
    from umo.cli.left_threads import prepare_end
    from umo.cli.shared import keep_only

    keep_only(sys.argv[1] if sys.argv[1:] else "")
    try:
        app()
    except SystemExit as ended:
        prepare_end(ended.code if isinstance(ended.code, int) else int(ended.code is not None))
        raise
