"""A release never starts anything: in any order of holding, switching off, release and end of the lease."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.letters import Letters
from helpers.machines import stations
from helpers.tiers import first
from umo import BinaryActuator, Compound, DigitalActuator, connect
from umo.objects import actions_of, atoms, find
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.operation.commands.client_control import ClientControl
from umo.states import OpenClosed
from umo.testing import periods, put

HELD: dict[tuple[str, str], tuple[dict[str, float], str]] = {
    ("ztheta", "z.jog"): ({"velocity": 1000.0}, "z.disable"),
    ("ztheta", "theta.jog"): ({"velocity": 1.0}, "theta.disable"),
    ("conveyor", "sorter.belt.run_at"): ({"speed": 0.2}, "sorter.belt.halt"),
}
"""Of what ships: station and held action, its arguments, and the action that switches off."""
STEPS = ["hold", "hold the other way", "switch off", "let go", "give back", "wait", "keep"]


def test_every_held_action_that_ships_is_tried() -> None:
    found = {
        (name, each.path) for name, make in stations().items() for each in actions_of(make()).values() if each.release
    }
    assert found == set(HELD)


@pytest.mark.parametrize(("station", "path"), first(1, HELD))
@settings(max_examples=30)
@given(steps=st.lists(st.sampled_from(STEPS), max_size=8))
def test_what_is_switched_off_stays_off_whatever_is_released(station: str, path: str, steps: list[str]) -> None:
    arguments, off = HELD[station, path]
    machine: Any = stations()[station]()
    with (connection := connect(machine)) as m:
        if station == "conveyor":
            put(m.sorter.emergency_stop, OpenClosed.CLOSED)
        letters = Letters()
        clock = connection.machine.clock
        clients = ClientControl(letters, letters, Mode.MANUAL, lambda: 1.0 + clock.now)
        connection.machine.attach(clients)

        def send(do: str, path: str = "", **more: Any) -> None:
            letters.waiting.append(ClientCommand(1, "client", "key", do, path, **more))
            periods(m, 3)

        part = find(m, path.rpartition(".")[0])
        send("lease", seconds=0.4)
        for step in [*steps, "switch off", *steps_that_release(steps)]:
            if not clients.lease.holder:
                send("lease", seconds=0.4)
            if step in ("hold", "hold the other way"):
                sign = -1.0 if step == "hold the other way" and path.endswith("jog") else 1.0
                send("call", path, arguments={key: sign * value for key, value in arguments.items()})
            elif step == "switch off":
                send("call", off)
            elif step == "let go":
                send("let go", path)
            elif step == "give back":
                send("give back")
            elif step == "keep":
                letters.signs |= dict.fromkeys(("", path), (clients.lease.number, 1.0 + clock.now))
                periods(m, 3)
            else:
                periods(m, 50)
        periods(m, 600)  # the lease has ended, and nothing is held
        assert at_defaults(part) == [], part
        assert not getattr(part, "enabled", False)


def steps_that_release(steps: list[str]) -> list[str]:
    return [step for step in reversed(steps) if not step.startswith("hold")]


def at_defaults(part: Compound) -> list[str]:
    """The actuators below that are not at their defaults."""
    found = (each for each in atoms(part) if isinstance(each, BinaryActuator | DigitalActuator))
    return [each.path for each in found if each.read() != each.default]
