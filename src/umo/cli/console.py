"""The two consoles; what is piped is not cut to 80 columns."""

import sys

from rich.console import Console

WIDE = 160

out = Console(highlight=False, width=None if sys.stdout.isatty() else WIDE)
err = Console(highlight=False, stderr=True, width=None if sys.stderr.isatty() else WIDE)
