"""The commands of `umo`, which `umo_command` starts."""


def main() -> None:
    """Carry out the command of this process; typer and what it needs are imported here, not with umo."""
    from umo.system.streams import keep_open, log_on_lines

    keep_open()
    log_on_lines()
    from umo.cli.app import app

    app()
