"""The programs that this process begins, which only the part of umo that began them knows."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest


def programs_begun(patch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Those that are begun from now on with `subprocess.Popen`, the last one at the end."""
    begun: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *given: Any, **more: Any) -> None:
            super().__init__(*given, **more)
            begun.append(self)

    patch.setattr(subprocess, "Popen", Noted)
    return begun


def is_noted_as_ended(program: subprocess.Popen[bytes]) -> bool:
    """Whether the part that began it has noted its end: it has read the last of its output."""
    return program.stdout is not None and program.stdout.closed
