"""The forms of the process image, for tests that run with each of them."""

from __future__ import annotations

from typing import Any

import pytest

from umo.cycle import forms
from umo.cycle.forms import ArrayImage, CompiledImage, ListImage
from umo.cycle.image import Image

BUILT = pytest.mark.skipif(forms.extension is None, reason="the extension in C is not built")
FORMS: list[Any] = [
    pytest.param(ListImage, id="lists"),
    pytest.param(ArrayImage, id="arrays"),
    pytest.param(CompiledImage, id="compiled", marks=BUILT),
]
CHOSEN_FIRST = FORMS if forms.extension is None else FORMS[::-1]
"""The form that a machine has here comes first. The others are the subject of test_image_forms.py."""


def choose(patch: pytest.MonkeyPatch, form: type[Image]) -> None:
    """Machines that are connected from now on have this form."""
    patch.setattr(forms, "form_for", lambda count: form)
