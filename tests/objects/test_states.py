from __future__ import annotations

import pytest

import umo
from umo.errors import DeclarationError
from umo.states import OnOff, PassFail, TwoState

TYPES = [cls for cls in TwoState.__subclasses__() if cls.__module__ == "umo.states"]


def test_umo_brings_the_papers_pairs_of_names():
    pairs = {cls.__name__: [state.name for state in cls] for cls in TYPES}
    assert pairs == {
        "ZeroOne": ["ZERO", "ONE"],
        "OnOff": ["ON", "OFF"],
        "LeftRight": ["LEFT", "RIGHT"],
        "UpDown": ["UP", "DOWN"],
        "HighLow": ["HIGH", "LOW"],
        "FrontBack": ["FRONT", "BACK"],
        "Rotation": ["CW", "CCW"],
        "EnableDisable": ["ENABLE", "DISABLE"],
        "PassFail": ["PASS", "FAIL"],
        "CompleteIncomplete": ["COMPLETE", "INCOMPLETE"],
        "OpenClosed": ["OPEN", "CLOSED"],
    }
    assert all(getattr(umo.states, name) in TYPES for name in pairs)


@pytest.mark.parametrize("state", [state for cls in TYPES for state in cls])
def test_a_state_has_no_truth_value(state):
    with pytest.raises(TypeError, match="no truth value; compare it"):
        if state:
            pass


def test_a_state_carries_no_level():
    assert not isinstance(OnOff.ON, int)
    with pytest.raises(TypeError):
        float(OnOff.ON)


def test_a_state_prints_as_its_name():
    assert str(PassFail.PASS) == "PASS"
    assert f"{PassFail.FAIL}" == "FAIL"


def test_three_states_are_refused():
    with pytest.raises(DeclarationError, match="Light has 3 states"):

        class Light(TwoState):
            RED = 1
            YELLOW = 2
            GREEN = 3


def test_one_state_is_refused():
    with pytest.raises(DeclarationError, match="Stuck has 1 states"):

        class Stuck(TwoState):
            ON = 1


def test_an_alias_is_no_second_state():
    with pytest.raises(DeclarationError):

        class Same(TwoState):
            ON = 1
            ALSO_ON = 1
