"""The command `umo`."""


def main() -> None:
    """Entry point; typer and what it needs are imported here, not with umo."""
    from umo.system.streams import keep_open

    keep_open()
    from umo.cli.app import app

    app()
