"""The C compiler of this computer."""

from __future__ import annotations

import os
import shutil

ROUNDING = "-ffp-contract=off", "-frounding-math"
"""Flags by which each operation is rounded individually. Without the second one GCC 12 computes 0.0 - (double)0 for
-0.0."""
FLAGS = ("-std=c99", "-O2", *ROUNDING, "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
"""Flags of a compiler: no number is converted without a warning."""
COMPILE_TIMEOUT = 120.0
"""Timeout in s for the compiler."""


def compiler() -> str | None:
    """The C compiler of this computer: $CC, cc, gcc or clang, or None if there is none."""
    names = filter(None, (os.environ.get("CC"), "cc", "gcc", "clang"))
    return next((found for name in names if (found := shutil.which(name))), None)
