"""What holds of every error of umo, and of one that a station derives from it."""

from __future__ import annotations

import copy
import pickle

import pytest

from umo import errors
from umo.errors import (
    BadInput,
    ChannelError,
    ChannelsFailed,
    DeviceTimeout,
    DriverError,
    Failure,
    Interlocked,
    Mistake,
    StopError,
    TaskFailed,
    UmoError,
    WiringError,
    text_of,
)
from umo.objects import Quality


class GripError(TaskFailed):
    """A station's own, with a constructor of its own."""

    def __init__(self, tries: int, *, where: str) -> None:
        super().__init__(f"no part was gripped in {tries} tries at {where}")
        self.tries = tries


FAILURE = Failure("z.motor", "dac:0", "no answer")
MADE: list[UmoError] = [
    BadInput("z.encoder", Quality.STALE),
    Interlocked("spindle", "the door is open"),
    ChannelError("dax:0", ["dac:N", "adc:N"]),
    ChannelsFailed({"dac:0": TimeoutError("no answer"), "dac:1": "short circuit"}),
    WiringError("1 error in the wiring", [Mistake("box.toml", "wire.z", "is not wired")]),
    DriverError("could not be sent", [FAILURE]),
    DeviceTimeout("no answer within 10 ms", [FAILURE]),
    StopError("not brought to their defaults", [FAILURE]),
    GripError(2, where="the tray"),
]
PLAIN = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, UmoError) and "__init__" not in vars(kind)
]


@pytest.mark.parametrize("again", [lambda e: pickle.loads(pickle.dumps(e)), copy.copy, copy.deepcopy])
@pytest.mark.parametrize("error", [*MADE, *(kind("words") for kind in PLAIN)], ids=lambda e: type(e).__name__)
def test_an_error_survives_pickle_and_copy_with_all_that_it_holds(error, again) -> None:
    error.add_note("while picking")
    found = again(error)
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert vars(found) == vars(error)
    assert found.args == error.args


def test_the_cause_of_an_exception_without_a_text_is_its_type() -> None:
    assert text_of(AssertionError()) == "AssertionError"
    assert text_of(OSError()) == "OSError"
    assert text_of(ValueError("no\nsecond line")) == "ValueError: no"
