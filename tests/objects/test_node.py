"""What every object of a machine is: one place in one tree."""

from __future__ import annotations

import copy
import pickle

import pytest

from helpers.machines import bench
from umo import connect
from umo.errors import DeclarationError


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, pickle.dumps])
def test_an_object_of_a_machine_is_not_copied_or_pickled(again) -> None:
    m = bench()
    for _ in range(2):
        for node, name in ((m, "Bench"), (m.motor, r"motor \(DigitalActuator\)")):
            with pytest.raises(DeclarationError, match=f"^{name} cannot be copied or pickled; call machine"):
                again(node)
        with connect(m):
            pass


def test_what_python_looks_for_in_any_object_is_missing_outside_connect_and_not_an_error() -> None:
    assert not hasattr(bench()._machine, "__deepcopy__")
    assert not hasattr(bench().motor._image, "__array_interface__")
