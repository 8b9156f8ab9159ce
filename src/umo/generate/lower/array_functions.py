"""The functions of numpy that can be translated."""

from __future__ import annotations

import ast
from typing import Any

import numpy as np

from umo.generate.c_types import BOOL, INT, REAL, CType

OF_ELEMENTS: dict[Any, tuple[str, CType, CType]] = {
    np.abs: ("umo_fabs", REAL, REAL),
    np.sign: ("sign", REAL, REAL),
    np.fabs: ("umo_fabs", REAL, REAL),
    np.sqrt: ("umo_sqrt", REAL, REAL),
    np.floor: ("umo_floor", REAL, REAL),
    np.ceil: ("umo_ceil", REAL, REAL),
    np.trunc: ("umo_trunc", REAL, REAL),
    np.isfinite: ("umo_is_finite", REAL, BOOL),
    np.isnan: ("umo_is_nan", REAL, BOOL),
    np.logical_not: ("!", BOOL, BOOL),
}
"""Element-wise functions: the runtime function or operator, the type that it takes and the type that it returns."""
WHOLE_BEFORE = np.floor, np.ceil, np.trunc
"""Functions that return integers for integers in some versions of numpy, and reals in other versions."""
BINARY: dict[Any, ast.operator | str] = {
    np.add: ast.Add(),
    np.subtract: ast.Sub(),
    np.multiply: ast.Mult(),
    np.divide: ast.Div(),
    np.floor_divide: ast.FloorDiv(),
    np.mod: ast.Mod(),
    np.logical_and: ast.BitAnd(),
    np.logical_or: ast.BitOr(),
    np.minimum: "umo_np_min",
    np.maximum: "umo_np_max",
}
"""Functions of two arguments, each with an operator or a function of the runtime."""
REDUCED: dict[Any, str] = {
    np.any: "any",
    np.all: "all",
    np.count_nonzero: "count",
    np.sum: "sum",
    np.max: "max",
    np.min: "min",
    np.mean: "mean",
}
"""Functions that return one number."""
CREATED: dict[Any, tuple[float | None, bool]] = {
    np.zeros: (0.0, False),
    np.ones: (1.0, False),
    np.full: (None, False),
    np.zeros_like: (0.0, True),
    np.ones_like: (1.0, True),
    np.full_like: (None, True),
}
"""Functions that create arrays, each with the fill value (None if it is an argument), and True if the length is that of
another array."""
DTYPES: dict[Any, CType] = {
    float: REAL,
    np.float64: REAL,
    int: INT,
    np.int64: INT,
    bool: BOOL,
    np.bool_: BOOL,
}
