"""Clients of a machine in virtual time: lost at every step of a command, and many at once."""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.client_world import ClientWorld, WorldClient, client_world
from helpers.own_modules import texts
from helpers.tiers import budget, some
from umo.clients.remote.client_session import LEASE_TIME
from umo.cycle.events import CommandState
from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError
from umo.operation.commands.client_commands import DEAD_MAN_TIME
from umo.process.frames import Reader
from umo.process.frames import command_queue as queue
from umo.process.frames.client_memory import QUEUE, SLOT, SLOTS, ClientMemory

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
LONG = LEASE_TIME + DEAD_MAN_TIME + 0.5
"""s after which a client that was lost has left nothing."""
COMMANDS: dict[str, tuple[str, dict[str, Any]]] = {
    "lease": ("", {"seconds": LEASE_TIME}),
    "give back": ("", {}),
    "mode": ("", {"value": "automatic"}),
    "tune": ("gain", {"value": 2.0}),
    "write": ("valve", {"value": 3.0}),
    "let go": ("valve", {}),
    "call": ("count", {"arguments": {"number": 7}}),
    "cancel": ("", {}),
    "acknowledge": ("", {}),
}
CALLS: dict[str, tuple[str, dict[str, Any]]] = {
    "jog": ("jog", {"arguments": {"velocity": 2.0}}),
    "cook": ("cook", {"arguments": {}}),
}
STEPS = ("asked", "half written", "sent", "taken", "answered", "a second later")
"""How far a client comes with a command before it is lost."""


@pytest.fixture(autouse=True)
def full_queue_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(queue, "SEND_TIMEOUT", 0.0)


def write_half(world: ClientWorld) -> None:
    """What a client leaves that is killed while it writes a command: its head comes last."""
    assert world.reader.ends is not None
    cells = ClientMemory(world.reader.ends.cells, world.reader.layout)
    at = QUEUE + cells.head[0] % SLOTS * SLOT
    cells.memory[at : at + 100] = b"\xa5" * 100
    cells.close()


def begin(world: ClientWorld, client: WorldClient, do: str) -> None:
    """What has to be before a command can be done."""
    if do != "lease":
        assert client.do("lease", seconds=LEASE_TIME).state is CommandState.DONE
    if do == "let go":
        client.do("write", "valve", value=1.0)


def lose(world: ClientWorld, client: WorldClient, step: str, do: str, path: str, fields: dict[str, Any]) -> None:
    """A command up to this step, at which its client is lost."""
    asked = client.asking(do, path, **fields)
    if step == "half written":
        write_half(world)
    if step in STEPS[2:]:
        asked.send()
    if step in STEPS[4:]:
        client.waits.append(asked)
        world.step()
    client.is_alive = step not in STEPS[:4]
    if step != "sent":
        world.step()
    if step == "a second later":
        world.step(1.0)
    client.is_alive = False


LOST = [(name, step) for name in (*COMMANDS, *CALLS) for step in STEPS]
WHOLE = ("call", "write", "jog")
"""A command that is done once, one that holds a value, one that holds an action: in make test they are lost at every
step, the others at one that differs from that of their neighbours."""


@pytest.mark.parametrize(
    ("name", "step"),
    some(lambda case: case[0] in WHOLE or case in LOST[:: len(STEPS) + 1], LOST),
)
def test_a_client_that_is_lost_at_any_step_of_a_command_leaves_nothing_and_bars_nobody(name: str, step: str) -> None:
    do = "call" if name in CALLS else name
    path, fields = (COMMANDS | CALLS)[name]
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, do)
        lose(world, ann, step, do, path, fields)
        world.step(LONG)
        assert world.is_at_rest
        assert world.m.counted == ([7] if path == "count" and step in STEPS[2:] else [])
        bert = world.client("bert")
        assert bert.do("lease", seconds=LEASE_TIME).state is CommandState.DONE
        bert.do("mode", value="manual")
        assert bert.do("write", "valve", value=4.0).state is CommandState.DONE
        assert world.valve == 4.0
        world.check_answered()


@pytest.mark.parametrize("name", ["write", "jog"])
def test_what_is_held_lasts_as_long_as_its_client_gives_heartbeats_and_no_longer(name: str) -> None:
    do = "call" if name in CALLS else name
    path, fields = (COMMANDS | CALLS)[name]
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, do)
        ann.do(do, path, **fields)
        world.step(5.0)
        assert world.control.actions.held == [path] == list(ann.session.held)
        ann.is_frozen = True
        world.step(DEAD_MAN_TIME + 0.2)
        assert world.control.actions.held == [] and world.valve == 0.0
        ann.is_frozen = False
        world.step()
        assert ann.session.has_lease and ann.session.ended(path) == "dead-man timeout"


def test_a_wrong_value_leaves_what_is_held_as_it_is_and_lets_nothing_else_be_held() -> None:
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, "write")
        assert ann.do("write", "valve", value=99.0).state is CommandState.REFUSED
        assert not ann.session.held
        ann.do("write", "valve", value=3.0)
        assert ann.do("write", "valve", value=99.0).state is CommandState.REFUSED
        world.step(2.0)
        assert world.valve == 3.0


def test_what_is_held_is_held_on_where_the_queue_has_no_room_for_another_command() -> None:
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, "write")
        ann.do("write", "valve", value=3.0)
        for _ in range(SLOTS):
            ann.ask("tune", "gain", value=2.0)
        with pytest.raises(CommandRefused, match="the queue of commands is full"):
            ann.asking("write", "valve", value=4.0).send()
        world.step(2.0)
        assert world.valve == 3.0 and not ann.waits


def test_a_command_that_fails_once_it_has_begun_ends_what_the_one_before_it_held_and_that_is_told() -> None:
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, "call")
        assert ann.do("call", "jog", arguments={"velocity": 2.0}).state is CommandState.DONE
        world.step()
        assert world.valve == 4.0
        assert "RangeError" in ann.do("call", "jog", arguments={"velocity": 9.0}).text
        world.step()
        assert world.valve == 0.0 and not world.control.actions.held
        assert ann.session.ended("jog") == "the next command failed"


def test_one_class_sends_commands_and_knows_whether_its_lease_lasts() -> None:
    for use in ("now.lease == ", "Sender("):
        found = [name for name, text in texts().items() if use in text and re.search(rf"\b{re.escape(use)}", text)]
        assert found == ["clients/remote/client_session.py"]


def test_who_takes_a_lease_over_from_itself_ends_what_it_did() -> None:
    with client_world() as world:
        ann = world.client("ann")
        begin(world, ann, "write")
        ann.do("write", "valve", value=3.0)
        assert ann.do("lease", seconds=LEASE_TIME, over=True).state is CommandState.DONE
        world.step()
        assert world.valve == 0.0 and ann.session.has_lease


COUNT = 20
DEEDS = (
    *((name, *COMMANDS[name]) for name in COMMANDS if name != "call"),
    ("lease", "", {"seconds": LEASE_TIME, "over": True}),
    ("mode", "", {"value": "manual"}),
    ("write", "valve", {"value": 99.0}),
    *(("call", *given) for given in CALLS.values()),
    ("cancel", "cook", {}),
    ("tune", "nothing", {"value": 1.0}),
    ("nonsense", "valve", {}),
)
EVENTS = ("count", "step", "step", "freeze", "thaw", "die")
"""What happens beside the deeds."""


class Crowd:
    """Clients by their places; in the place of one that has died comes another."""

    def __init__(self, world: ClientWorld) -> None:
        self.world = world
        self._places = [self._new() for _ in range(COUNT)]
        self.asked: dict[int, int] = {}
        """The number of each command that counts, by the number that it counts."""

    def _new(self) -> WorldClient:
        return self.world.client(f"client {len(self.world.clients)}")

    def act(self, place: int, what: Any) -> None:
        client = self._places[place]
        if not client.is_alive:
            client = self._places[place] = self._new()
        if what == "step":
            self.world.step()
        elif what == "die":
            client.is_alive = False
        elif what in ("freeze", "thaw"):
            client.is_frozen = what == "freeze"
        elif client.is_frozen:
            return
        elif what == "count":
            number = len(self.asked) + 1
            self.asked[number] = client.ask("call", "count", arguments={"number": number}).number
        else:
            do, path, fields = what
            client.ask(do, path, **fields)

    def end(self) -> None:
        """Who lives is answered; then all are lost."""
        self.world.step(2.0)
        for client in self.world.clients.values():
            client.is_frozen = False
        self.world.step(1.0)
        for client in self.world.clients.values():
            cooking = [each for each in client.waits if each.path == "cook"]
            assert not client.is_alive or client.waits == cooking, "a command has no answer"
            client.is_alive = False
        self.world.step(LONG)


@budget(12, 30)
@given(
    st.lists(
        st.tuples(st.integers(0, COUNT - 1), st.one_of(st.sampled_from(DEEDS), st.sampled_from(EVENTS))),
        min_size=30,
        max_size=200,
    )
)
def test_of_many_clients_at_once_each_command_is_answered_once_and_done_at_most_once(deeds: list[Any]) -> None:
    with client_world() as world:
        crowd = Crowd(world)
        for place, what in deeds:
            crowd.act(place, what)
        crowd.end()
        assert world.is_at_rest
        world.check_answered()
        assert sorted(world.m.counted) == sorted(
            number for number, command in crowd.asked.items() if command in world.done
        )


def test_an_answer_that_was_overwritten_before_it_was_read_is_told_as_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    with client_world() as world:
        client, other = world.client("a"), world.client("b")
        asked = client.asking("lease", seconds=LEASE_TIME)
        asked.send()
        world.step()
        other.do("acknowledge")
        reader = client.session.reader
        events = reader.events
        monkeypatch.setattr(reader, "events", lambda start=0: [each for each in events(start) if each.number > start])
        with pytest.raises(FramesError, match="it is not known whether the command was carried out"):
            asked.look()


def test_a_full_queue_of_a_run_that_has_ended_is_told_as_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    with client_world() as world:
        client = world.client("a")
        for _ in range(SLOTS):
            client.asking("acknowledge").send()
        monkeypatch.setattr(Reader, "state", Stage.ENDED)
        assert client.session._sender is not None
        with pytest.raises(FramesError, match="has ended"):
            client.session._sender.send({"do": "acknowledge"})
