"""Steps of a block transfer, of which some may fail."""

from __future__ import annotations

import pytest

from umo.drivers import ChannelsFailed, DeviceTimeout, DriverError
from umo.drivers._block_driver import in_turn


class Connection(DriverError):
    """After it nothing more can succeed."""


def carry_out(errors: dict[int, Exception], done: list[int], steps: int = 4) -> None:
    """Steps of which some raise; `done` gets the others."""

    def step(number: int) -> None:
        if number in errors:
            raise errors[number]
        done.append(number)

    in_turn(range(steps), step, lambda number: [f"c{number}"], lambda error: isinstance(error, Connection))


def test_a_step_that_fails_does_not_stop_the_others() -> None:
    done: list[int] = []
    with pytest.raises(ChannelsFailed) as caught:
        carry_out({1: DriverError("no"), 2: ChannelsFailed({"x": "bad"})}, done)
    assert caught.value.causes == {"c1": "no", "x": "bad"}
    assert done == [0, 3]


def test_after_a_lost_connection_the_later_steps_fail_by_it_too() -> None:
    done: list[int] = []
    with pytest.raises(ChannelsFailed) as caught:
        carry_out({2: Connection("gone")}, done)
    assert caught.value.causes == {"c2": "gone", "c3": "gone"}
    assert done == [0, 1]


@pytest.mark.parametrize(
    ("step", "error", "steps"), [(0, Connection("gone"), 4), (2, DeviceTimeout("late"), 4), (0, DriverError("no"), 1)]
)
def test_an_error_of_all_steps_is_raised_as_it_is(step: int, error: DriverError, steps: int) -> None:
    with pytest.raises(type(error)) as caught:
        carry_out({step: error}, [], steps)
    assert caught.value is error


def test_without_an_error_every_step_is_carried_out_in_order() -> None:
    done: list[int] = []
    carry_out({}, done)
    assert done == [0, 1, 2, 3]
