"""`umo tune law` with some kinds of models only, for tests of what is done with a model that is found."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from umo.commissioning.tuning import tuning_result
from umo.commissioning.tuning.identification import Identified, identify
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.models import FIRST_ORDER, INTEGRATOR, SECOND_ORDER

KINDS = (INTEGRATOR, FIRST_ORDER, SECOND_ORDER)
"""They take a tenth of the time of all."""


def few_kinds(patch: pytest.MonkeyPatch) -> None:
    """Only these are tried."""

    def simply(response: MeasuredResponse, kinds: Sequence[str] = KINDS, sign: float = 0.0) -> Identified:
        return identify(response, kinds, sign)

    patch.setattr(tuning_result, "identify", simply)
