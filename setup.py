"""The two extensions in C, which are left out where they cannot be built (docs/decisions/0019-an-extension-in-c.md).

All else is in pyproject.toml.
"""

import sys

from setuptools import Extension, setup

SEPARATE = [] if sys.platform == "win32" else ["-ffp-contract=off"]
"""a * b + c is two operations, as in Python."""
setup(
    ext_modules=[
        Extension("umo.cycle._scan", ["src/umo/cycle/scan.c"], extra_compile_args=SEPARATE, optional=True),
        Extension("umo.frames._body", ["src/umo/frames/body.c"], optional=True),
    ]
)
