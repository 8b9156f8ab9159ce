"""The published test helpers do what their docstrings say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import umo.testing
from helpers.machines import bench, wired
from umo import Compound, DigitalSensor, connect, run
from umo.drivers import Channel, ChannelError, Direction
from umo.errors import DeclarationError
from umo.states import OnOff, PassFail
from umo.testing import Call, Scripted, VirtualTimer, periods, put

A, B = (Channel(text, Direction.BOTH, 64, signed=True) for text in "ab")


def test_a_channel_reads_its_script_whose_last_reading_stays():
    box = Scripted({"a": [1, 2, 3], "b": (7,)})
    assert [box.read(A) for _ in range(5)] == [1, 2, 3, 3, 3]
    assert [box.read(B) for _ in range(2)] == [7, 7]


def test_a_script_may_hold_callables_and_exceptions():
    box = Scripted({"a": [1, OSError("cut"), ValueError, lambda: 9], "b": lambda: 4})
    assert box.read(A) == 1
    with pytest.raises(OSError, match="cut"):
        box.read(A)
    with pytest.raises(ValueError):
        box.read(A)
    assert (box.read(A), box.read(B)) == (9, 4)


def test_an_empty_script_is_a_mistake():
    with pytest.raises(ValueError, match="empty"):
        Scripted({"a": []})


def test_a_channel_without_a_script_reads_what_was_written_last():
    box = Scripted()
    assert box.read(A) == 0
    box.write(A, 5)
    assert box.read(A) == box.get("a") == 5
    box.write_many([A, B], np.array([6, 7]))
    out = np.zeros(2, np.int64)
    box.read_many([A, B], out)
    assert out.tolist() == [6, 7]
    box.set("a", 9)
    assert box.read(A) == 9


def test_every_call_is_kept_in_order_with_its_segment_the_failing_ones_too():
    box = Scripted()
    box.open()
    box.initialize(A, 3)
    box.initialize(B, None)
    box.watchdog(0.5)
    box.at(4, OSError("cut"))
    with pytest.raises(OSError):
        box.read(B)
    box.write_many([A], np.array([4]))
    box.reset(A, 0)
    box.finalize(A)
    box.close()
    assert box.calls == [
        Call(0, "open"),
        Call(1, "initialize", ("a",), (3,)),
        Call(2, "initialize", ("b",), (None,)),
        Call(3, "watchdog", (), (0.5,)),
        Call(4, "read", ("b",)),
        Call(5, "write_many", ("a",), (4,)),
        Call(6, "reset", ("a",), (0,)),
        Call(7, "finalize", ("a",)),
        Call(8, "close"),
    ]
    assert [call.number for call in box.segments("initialize", "close")] == [1, 2, 8]


def test_a_chosen_call_raises_calls_back_or_reads_garbage():
    box, seen = Scripted(), []
    box.at(0, TimeoutError)
    box.at(1, seen.append)
    box.at(2, "garbage")
    box.at(3, lambda call: 42)
    with pytest.raises(TimeoutError):
        box.read(A)
    assert box.read(A) == 0
    assert seen == [Call(1, "read", ("a",))]
    assert (box.read(A), box.read(A), box.read(A)) == ("garbage", 42, 0)


def test_a_failed_write_changes_nothing():
    box = Scripted()
    box.broken = OSError("dead")
    for call in (lambda: box.write(A, 5), lambda: box.initialize(A, 5), lambda: box.reset(A, 5)):
        with pytest.raises(OSError, match="dead"):
            call()
    box.broken = None
    assert box.get("a") == 0


def test_given_channels_are_the_only_ones():
    box = Scripted(channels=[Channel("out", Direction.OUTPUT, 8)])
    assert box.channel("out").bits == 8
    with pytest.raises(ChannelError, match="the forms are: out"):
        box.channel("in")


def test_the_virtual_timer_scripts_missed_periods_and_ends_the_run():
    machine, seen = bench(), []
    clock = VirtualTimer(missed=[0, 3], end_after=4, on_period=seen.append)
    assert run(machine, wired(machine, Scripted(), clock=clock)) is None
    assert (clock.reads, seen) == (4, [1, 2, 3, 4])


def test_the_virtual_timer_serves_in_a_file(tmp_path: Path):
    class Clocked(Compound):
        timer: DigitalSensor

    from helpers.machines import timer

    path = tmp_path / "virtual.toml"
    path.write_text(
        '[drivers.clock]\ntype = "umo.testing:VirtualTimer"\nmissed = [2]\nend_after = 3\n'
        '[wire]\ntimer = { driver = "clock", period = "1 ms" }\n'
    )
    connection = connect(Clocked(timer=timer()), path)
    with connection as m:
        while m.cycle.running:
            periods(m)
        assert m.now == pytest.approx(0.004)


def test_put_needs_a_channel_on_which_something_can_be_put():
    machine = bench()
    with connect(machine, wired(machine, Scripted())) as m, pytest.raises(DeclarationError, match="VirtualTimer"):
        put(m.timer, 1.0)


def test_periods_runs_the_loop_also_without_a_timer():
    class Still(Compound):
        encoder: DigitalSensor

    from helpers.machines import sensor

    with connect(Still(encoder=sensor())) as m:
        put(m.encoder, 5.0)
        periods(m)
        assert m.encoder.read() == 5.0


def test_the_packages_example():
    """As in its docstring: two periods, a reading, a state."""
    assert "put(m.pressure, 6.5)" in (umo.testing.__doc__ or "")
    machine, box = bench(), Scripted()
    with connect(machine, wired(machine, box)) as m:
        put(m.encoder, 6.5)
        put(m.limit, PassFail.FAIL)
        m.valve.write(OnOff.ON)
        periods(m, 2)
        assert (m.encoder.read(), m.limit.read(), m.valve.read()) == (6.5, PassFail.FAIL, OnOff.ON)
