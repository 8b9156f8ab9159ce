"""The C compiler of this computer."""

from __future__ import annotations

import os
import shutil

ROUNDING = "-ffp-contract=off", "-frounding-math"
"""Flags by which each operation is rounded separately. Without the second flag GCC 12 computes 0.0 - (double)0 as
-0.0."""
FLAGS = ("-std=c99", "-O2", *ROUNDING, "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
"""Flags of the compiler. With them an implicit conversion of a number is an error."""
COMPILE_TIMEOUT = 120.0
"""Timeout in s for the compiler."""


def compiler() -> str | None:
    """Return the C compiler of this computer: $CC, cc, gcc or clang, or None if there is none."""
    names = filter(None, (os.environ.get("CC"), "cc", "gcc", "clang"))
    return next((found for name in names if (found := shutil.which(name))), None)
