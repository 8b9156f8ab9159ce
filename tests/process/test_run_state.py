"""The locks of the processes of a run: whoever holds one is known by it until its death."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from helpers.tiers import first
from umo.process import run_state
from umo.process.run_state import RunState, Who
from umo.system import calls
from umo.system.processes import Child, carry_out


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_state, "HOLD_LIMIT", 0.01)


class Holder:
    """A process that holds a lock, and answers each byte by whether it finds that it does."""

    def __init__(self, state: RunState, who: int) -> None:
        (asked, self._ask), (self._answer, answer) = os.pipe(), os.pipe()
        pid = state.fork(who)
        if pid == 0:
            os.close(self._ask)
            carry_out(lambda: self._serve(state, who, asked, answer))
        self.child = Child(pid)
        os.close(asked)
        os.close(answer)

    def _serve(self, state: RunState, who: int, asked: int, answer: int) -> int:
        while os.read(asked, 1):
            os.write(answer, b"1" if state.holds(who) else b"0")
        return 0

    def holds(self) -> bool:
        os.write(self._ask, b"?")
        return os.read(self._answer, 1) == b"1"

    def end(self) -> None:
        self.child.send(signal.SIGKILL)
        assert self.child.end(5.0)
        os.close(self._ask)
        os.close(self._answer)


@pytest.fixture
def state() -> Iterator[RunState]:
    state = RunState(workers=1)
    yield state
    for who in range(len(Who) + 1):
        if state.holds(who):
            state.release(who)  # its memory ends with the test


@pytest.mark.parametrize("who", first(1, [Who.RESERVE, Who.RESET, run_state.worker(0)]))
def test_the_holder_of_a_lock_is_known_until_its_death_however_others_try_to_take_it(state: RunState, who: int) -> None:
    holder = Holder(state, who)
    for _ in range(3):
        assert not state.hold(who)
        assert not state.holds(who)
        assert holder.holds()
        assert state.is_able(who)
        process = state.process(who)
        assert process is not None and process.pid == holder.child.pid
    holder.end()
    assert not state.is_able(who)
    assert state.hold(who)
    assert state.holds(who)
    state.release(who)
    assert not state.holds(who)
    assert state.gone(0.0, who)


def test_a_look_at_a_lock_does_not_take_it(state: RunState, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is stopped while it looks would keep the lock from those that follow the dead holder."""
    monkeypatch.setattr(calls, "lock_mutex", lambda *_: pytest.fail("taken"))
    assert state.gone(0.0, Who.STANDBY)  # never held
    monkeypatch.undo()
    holder = Holder(state, Who.STANDBY)
    monkeypatch.setattr(calls, "lock_mutex", lambda *_: pytest.fail("taken"))
    assert not state.gone(0.0, Who.STANDBY)
    holder.end()
    assert state.gone(0.0, Who.STANDBY)
    assert state.gone(0.0, Who.STANDBY)


def test_a_process_that_is_forked_holds_no_lock_of_the_one_before(state: RunState) -> None:
    assert state.hold(Who.GUARDIAN)
    pid = os.fork()
    if pid == 0:
        carry_out(lambda: int(state.holds(Who.GUARDIAN)))
    assert os.waitpid(pid, 0)[1] == 0
    assert state.holds(Who.GUARDIAN)
