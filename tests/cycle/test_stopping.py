"""SIGINT and SIGTERM set a flag that is read between periods."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from threading import Timer
from typing import Any

import pytest

from helpers.machines import Board, bench, on, wired
from umo import connect, run
from umo.drivers import EndsWait
from umo.drivers.timerfd import TimerFd
from umo.errors import Interrupted
from umo.states import OnOff
from umo.system import calls
from umo.system.device_record import DeviceRecord, standing
from umo.testing import Scripted, VirtualTimer, periods

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is Linux")
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def uncaught():
    """Handlers that note what umo did not catch, instead of ending the tests; they must be there again at the end."""
    seen: list[int] = []

    def note(number: int, frame: Any) -> None:
        seen.append(number)

    before = {number: signal.signal(number, note) for number in SIGNALS}
    yield seen
    after = [signal.getsignal(number) for number in SIGNALS]
    for number, handler in before.items():
        signal.signal(number, handler)
    assert after == [note] * len(SIGNALS)
    assert seen == []


def cut(number: int) -> None:
    try:
        os.kill(os.getpid(), number)
    except KeyboardInterrupt:
        raise AssertionError("a signal raised") from None


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_the_loop_after_its_period_and_the_actuators_go_to_their_defaults(number):
    machine, box = bench(), Scripted()
    clock = VirtualTimer(on_period=lambda n: cut(number) if n == 3 else None)
    connection = connect(machine, wired(machine, box, clock=clock))
    with connection as m:
        while m.cycle.running and clock.reads < 10:
            m.valve.write(OnOff.ON)
            periods(m, 1)
        assert connection.stop.signal == number
    assert clock.reads == 3
    assert len(box.segments("write_many")) == 3  # the third period ran to its end
    assert box.get("valve") == 0


@pytest.mark.parametrize("segment", ["read_many", "write_many"])
def test_a_signal_never_raises_inside_a_driver_call(segment):
    finished: list[Any] = []

    class Signalled(Scripted):
        def _call(self, name, channels=(), raws=()):
            replaced = super()._call(name, channels, raws)
            if name == segment and len(self.calls) > 8:
                cut(signal.SIGINT)
                finished.append(name)  # not reached if the signal raised
            return replaced

    machine = bench()
    with pytest.raises(Interrupted):  # by `run` itself, when the machine has been reset
        run(machine, wired(machine, Signalled()))
    assert finished


def test_a_second_signal_does_not_interrupt_the_resetting():
    machine, box = bench(), Scripted()
    box.at(0, lambda call: None)
    clock = VirtualTimer(on_period=lambda n: cut(signal.SIGINT))

    class Late(Scripted):
        def reset(self, channel, default):
            cut(signal.SIGINT)
            cut(signal.SIGTERM)
            super().reset(channel, default)

        def finalize(self, channel):
            cut(signal.SIGINT)
            super().finalize(channel)

    late = Late()
    with connect(machine, wired(machine, late, clock=clock)) as m:
        m.valve.write(OnOff.ON)
        m.motor.write(5.0)
        periods(m, 1)
        assert not m.cycle.running
    assert [call.channels[0] for call in late.segments("reset")] == ["motor", "valve"]
    assert len(late.segments("finalize")) == 4
    assert (late.get("motor"), late.get("valve")) == (0, 0)


def test_a_timer_that_fails_to_stop_waiting_fails_no_call_of_a_driver():
    class Failing(VirtualTimer, EndsWait):
        def stop_waiting(self):
            raise OSError("no such wait")

    class Late(Scripted):
        def reset(self, channel, default):
            cut(signal.SIGINT)
            super().reset(channel, default)

    machine, late = bench(), Late()
    with connect(machine, wired(machine, late, clock=Failing())) as m:
        m.valve.write(OnOff.ON)
        periods(m, 1)
        cut(signal.SIGTERM)
        assert not m.cycle.running
    assert late.get("valve") == 0


def test_a_signal_while_connecting_ends_the_loop_before_its_first_period():
    machine, box = bench(), Scripted()
    box.at(2, lambda call: cut(signal.SIGTERM))
    with pytest.raises(Interrupted):
        run(machine, wired(machine, box))
    assert [call.segment for call in box.calls if call.segment == "write_many"] == []
    assert len(box.segments("initialize")) == len(box.segments("finalize")) == 4


@pytest.mark.parametrize("fails", [False, True])
def test_the_handlers_from_before_come_back(fails, uncaught):
    machine, box = bench(), Scripted()
    if fails:
        box.at(2, OSError("cut"))
        with pytest.raises(OSError):
            connect(machine, wired(machine, box)).__enter__()
    else:
        with connect(machine, wired(machine, box)):
            cut(signal.SIGTERM)
            assert uncaught == []
    cut(signal.SIGTERM)
    assert uncaught == [signal.SIGTERM]
    uncaught.clear()


def test_a_wrong_wiring_leaves_the_handlers_alone():
    with pytest.raises(ValueError):
        connect(bench(), {"wire": {}}).__enter__()


def test_one_signal_stops_every_machine_of_the_process():
    one, other = bench(), bench()
    with connect(one) as a:
        with connect(other) as b:
            cut(signal.SIGINT)
            assert (a.cycle.running, b.cycle.running) == (False, False)
        assert a.cycle.running is False
        with pytest.raises(
            Interrupted, match=r"the application does not end: tests/cycle/test_stopping.py:\d+ in test_one_"
        ):
            os.kill(os.getpid(), signal.SIGINT)  # still caught: the code after the loop does not end by itself


def test_machines_may_be_left_in_any_order_and_the_last_one_gives_the_handlers_back():
    first, second = connect(bench()), connect(bench())
    first.__enter__()
    m = second.__enter__()
    first.__exit__(None, None, None)
    cut(signal.SIGTERM)
    assert m.cycle.running is False
    second.__exit__(None, None, None)


def test_a_machine_in_a_thread_neither_takes_the_handlers_nor_keeps_them():
    entered, leave = threading.Event(), threading.Event()
    running: list[bool] = []

    def work():
        with connect(bench()) as m:
            entered.set()
            leave.wait(10)
            running.append(m.cycle.running)

    thread = threading.Thread(target=work)
    before = [signal.getsignal(number) for number in SIGNALS]
    thread.start()
    entered.wait(10)
    assert [signal.getsignal(number) for number in SIGNALS] == before
    with connect(bench()):
        cut(signal.SIGINT)  # stops both
    assert [signal.getsignal(number) for number in SIGNALS] == before
    leave.set()
    thread.join()
    assert running == [False]


def test_a_stop_can_be_requested_without_a_signal():
    connection = connect(bench())
    with connection as m:
        assert m.cycle.running is True
        connection.stop.request()
        assert m.cycle.running is False
        assert connection.stop.signal is None


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_the_safe_end_is_recorded_changes_nothing_of_the_record(tmp_path, monkeypatch, number):
    finish = DeviceRecord.finish

    def interrupted(self: DeviceRecord) -> None:
        cut(number)
        finish(self)

    monkeypatch.setattr(DeviceRecord, "finish", interrupted)
    machine, device = bench(), f"test {tmp_path}"
    with connect(machine, on(Board(device), machine)) as m:
        periods(m, 1)
    assert standing(device) == []


def test_a_disconnecting_that_is_interrupted_records_the_actuators_that_were_not_reached(tmp_path):
    machine, device = bench(), f"test {tmp_path}"
    state = Board(device)
    connection = connect(machine, on(state, machine))

    def interrupt() -> None:
        if len(state.segments("reset")) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), connection as m:
        periods(m, 1)
        connection.image.segments.on_call = interrupt
    (ended,) = standing(device)
    assert ended.unreached == ["valve"]


def test_an_actuator_whose_reset_may_still_be_undone_counts_as_not_reached(tmp_path):
    machine, device = bench(), f"test {tmp_path}"
    connection = connect(machine, on(Board(device), machine))

    def interrupt(seconds: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), connection as m:
        periods(m, 1)
        connection.image.transfer.unsure = True
        connection.pause = interrupt
    (ended,) = standing(device)
    assert sorted(ended.unreached) == ["motor", "valve"]


# A stop ends the wait for a tick -------------------------------------------------------------------------

LONG = 600.0
"""s of a period that no test waits for."""


def when_waiting(patch: pytest.MonkeyPatch, ask: Callable[[], object]) -> TimerFd:
    """A timer; a stop is asked for as soon as it waits."""
    read = calls.read

    def waits(file: int, size: int) -> bytes:
        if size == 8:
            Timer(0.01, ask).start()
        return read(file, size)

    patch.setattr(calls, "read", waits)
    return TimerFd()


@linux
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_the_wait_for_a_tick_without_another_period(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, box = bench(), Scripted()
    wiring = wired(machine, box, clock=when_waiting(monkeypatch, lambda: cut(number)))
    wiring["wire"]["timer"]["period"] = LONG
    shown: list[int] = []
    with pytest.raises(Interrupted) as ended:
        run(machine, wiring, observers=[lambda frame: shown.append(frame.number)])
    assert ended.value.number == number
    assert (box.segments("write_many"), shown) == ([], [])
    assert box.get("valve") == 0


@linux
def test_a_signal_ends_the_wait_of_a_paced_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, plant = bench(), VirtualTimer()
    wiring = wired(machine, Scripted(), clock=plant)
    wiring["wire"]["timer"]["period"] = LONG
    monkeypatch.setattr(plant, "_on_period", lambda number: Timer(0.05, cut, [signal.SIGINT]).start())
    with pytest.raises(Interrupted):
        run(machine, wiring, realtime=True)
    assert plant.reads == 1


@linux
def test_a_stop_ends_the_wait_of_a_machine_in_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = bench()
    wiring = wired(machine, Scripted(), clock=when_waiting(monkeypatch, lambda: connection.stop.request()))
    wiring["wire"]["timer"]["period"] = LONG
    connection = connect(machine, wiring)
    found: list[object] = []

    def loop() -> None:
        with connection as m:
            while m.cycle.running:
                found.append((m.timer.read(), m.now))

    thread = threading.Thread(target=loop)
    thread.start()
    thread.join(30.0)
    assert not thread.is_alive()
    assert found == [(-1.0, 0.0)]
