"""The extensions in C, which are left out where they cannot be built (docs/decisions/0019-an-extension-in-c.md).

They use Python's stable interface: one wheel serves all versions from 3.11 on. All else is in pyproject.toml.
"""

import sys

from setuptools import Extension, setup

SEPARATE = [] if sys.platform == "win32" else ["-ffp-contract=off", "-O3"]
"""a * b + c is two operations, as in Python."""
COLUMNS = Extension(
    "umo.cycle._columns",
    [f"src/umo/cycle/{name}.c" for name in ("columns", "laws", "period", "watch", "writes")],
    depends=[
        "src/umo/cycle/extension.h",
        "src/umo/drivers/umo_driver.h",
        *(f"src/umo/generate/runtime/umo_{name}.h" for name in ("scaling", "curves")),
    ],
    extra_compile_args=SEPARATE,
    py_limited_api=True,
    optional=True,
)
NATIVE = Extension(
    "umo.drivers._native",
    ["src/umo/drivers/native.c"],
    depends=["src/umo/drivers/umo_driver.h"],
    extra_compile_args=SEPARATE,
    py_limited_api=True,
    optional=True,
)
setup(ext_modules=[COLUMNS, NATIVE], options={"bdist_wheel": {"py_limited_api": "cp311"}})
