"""Carries out the words of the command line in this process."""

import sys


def carry_out() -> None:
    """Carry out the command of this process. typer and its dependencies are imported here, and not when umo is
    imported."""
    from umo.system.streams import keep_open, log_on_lines

    keep_open()
    log_on_lines()
    from umo_command.app import app
    from umo_command.left_threads import prepare_end
    from umo_command.old_names import current
    from umo_command.shared import keep_only

    words = current(sys.argv[1:], app)
    keep_only(words)
    try:
        app(words)
    except SystemExit as ended:
        prepare_end(ended.code if isinstance(ended.code, int) else int(ended.code is not None))
        raise
