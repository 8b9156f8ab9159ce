"""The two consoles; what is piped is not cut to 80 columns, and brackets in a user's names are not markup."""

import sys

from rich.console import Console

WIDE = 160

out = Console(highlight=False, markup=False, emoji=False, width=None if sys.stdout.isatty() else WIDE)
err = Console(highlight=False, markup=False, emoji=False, stderr=True, width=None if sys.stderr.isatty() else WIDE)
