"""The grammar of sizes: a string such as "200 MB"."""

from __future__ import annotations

import re

from umo.errors import DeclarationError

_TEXT = re.compile(r"\s*(\d{1,15}(?:\.\d+)?)\s*(kB|MB|GB)\s*")
UNITS = {"kB": 10**3, "MB": 10**6, "GB": 10**9}


def byte_size(size: object, least: int) -> int:
    """Return a size in bytes. Raises DeclarationError if the string is not a size, or if the size is not a whole number
    of kB or is less than `least`."""
    match = _TEXT.fullmatch(size) if isinstance(size, str) else None
    if match is None:
        raise DeclarationError(f"{size!r} is not a size such as '200 MB'; units: {', '.join(UNITS)}")
    value = round(float(match[1]) * UNITS[match[2]])
    if value < least:
        fewest = f"{least // 10**3} kB" if least < 10**6 else f"{least // 10**6} MB"
        raise DeclarationError(f"{size!r} is less than {fewest}")
    return value
