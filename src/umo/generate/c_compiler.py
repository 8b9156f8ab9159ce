"""The C compiler of this computer."""

from __future__ import annotations

import os
import shutil

ROUNDING = "-ffp-contract=off", "-frounding-math"
"""Each operation is rounded by itself. Without the second one GCC 12 takes 0.0 - (double)0 for -0.0."""
FLAGS = ("-std=c99", "-O2", *ROUNDING, "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
"""Flags of a compiler: nothing is converted in silence."""
COMPILE_TIMEOUT = 120.0
"""Timeout in s for the compiler."""


def compiler() -> str | None:
    """The C compiler of this computer: $CC, cc, gcc or clang, or None if there is none."""
    names = filter(None, (os.environ.get("CC"), "cc", "gcc", "clang"))
    return next((found for name in names if (found := shutil.which(name))), None)
