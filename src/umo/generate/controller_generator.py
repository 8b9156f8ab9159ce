"""Generates the files of a controller from a machine and a wiring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from umo.errors import DeclarationError
from umo.generate.controller_folder import TARGETS, files_of
from umo.generate.controller_model import laid_out
from umo.generate.known_setters import settings_of
from umo.generate.translation import ControllerTarget
from umo.generate.translator import translate
from umo.objects import Compound
from umo.text import did_you_mean


def target_of(name: str, real: Literal["double", "float"] | None = None) -> ControllerTarget:
    """Return the target of this name, with the number type `real` if given. Raises DeclarationError if there is no such
    target."""
    if name not in TARGETS:
        raise DeclarationError(
            f"there is no target {name!r}{did_you_mean(name, TARGETS)}; choose from: {', '.join(TARGETS)}"
        )
    if real == "double" and TARGETS[name].real == "float":
        raise DeclarationError(f"the target {name} has no doubles: its compiler treats them as floats")
    return TARGETS[name] if real is None else replace(TARGETS[name], real=real)


def generated(
    root: Compound, wiring: Path | str | Mapping[str, Any] | None, target: ControllerTarget
) -> dict[str, str]:
    """Return the text of each file by name. Raises NotTranslated, which lists all obstacles. No device is opened."""
    with laid_out(root, wiring) as model:
        translation = translate(root, model.conditions, model.steps, target)
        translation.problems += settings_of(translation.known, root)
        return files_of(model, translation, target)
