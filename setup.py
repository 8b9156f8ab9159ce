"""The extension in C, which is left out where it cannot be built (docs/decisions/0019-an-extension-in-c.md).

It uses Python's stable interface: one wheel serves all versions from 3.11 on. All else is in pyproject.toml.
"""

import sys

from setuptools import Extension, setup

SEPARATE = [] if sys.platform == "win32" else ["-ffp-contract=off", "-O3"]
"""a * b + c is two operations, as in Python."""
COLUMNS = Extension(
    "umo.cycle._columns",
    ["src/umo/cycle/columns.c", "src/umo/cycle/laws.c", "src/umo/cycle/watch.c", "src/umo/cycle/writes.c"],
    depends=["src/umo/cycle/extension.h", "src/umo/generate/runtime/umo_scaling.h"],
    extra_compile_args=SEPARATE,
    py_limited_api=True,
    optional=True,
)
setup(ext_modules=[COLUMNS], options={"bdist_wheel": {"py_limited_api": "cp311"}})
