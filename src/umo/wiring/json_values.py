"""Options as plain data."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any

from umo.drivers.faults.fault_syntax import InjectedFault


def as_plain(value: Any) -> Any:
    """Return plain data for an Enum, a Path or a fault among the options. The receiver makes the object again from
    these data. Raises TypeError for anything else (`json.dumps(default=as_plain)`)."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path | InjectedFault):
        return str(value)
    raise TypeError(f"Object of type {type(value).__name__} is not JSON serializable")
