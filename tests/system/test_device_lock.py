"""One device, one holder: whoever comes second is told who holds it since when, and touches nothing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers.machines import Board, bench, on, wired
from helpers.waiting import until
from umo import connect
from umo.drivers import Channel, WiringError
from umo.errors import AcknowledgeRequired, DeviceHeld
from umo.system.device_lock import DeviceLock, holder, is_held
from umo.system.device_record import all_standing, standing
from umo.testing import Scripted, periods
from umo.wiring import resolve

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices are held on Linux")

NOBODY = 65534
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
HOLDING = """
import sys
from umo.system.device_lock import DeviceLock
kept = DeviceLock(sys.argv[1:], "press, bench")
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def device(tmp_path: Path) -> str:
    """One that no other test takes."""
    return f"test {tmp_path}"


@contextmanager
def another_process(*devices: str) -> Iterator[int]:
    """Holds the devices; its pid."""
    command = [sys.executable, "-c", HOLDING, *devices]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process.pid
        process.kill()


@contextmanager
def as_nobody(work: Callable[[], object]) -> Iterator[int]:
    """A child of another user that has done this work and waits; its pid."""
    waiting, going = os.pipe()
    ready, telling = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(going)
        os.setuid(NOBODY)
        kept = work()
        os.write(telling, b"!")
        os.read(waiting, 1)
        os._exit(kept is None)
    os.read(ready, 1)
    yield child
    os.close(going)
    os.waitpid(child, 0)
    for file in (waiting, ready, telling):
        os.close(file)


# Holding ------------------------------------------------------------------------------------------------


def test_a_device_that_another_process_holds_is_refused_with_its_pid_user_purpose_and_time(device: str) -> None:
    with another_process(device) as pid, pytest.raises(DeviceHeld) as caught:
        DeviceLock([device], "second")
    text = (
        rf"{re.escape(device)} is held by pid {pid} of user \w+ \(press, bench\), since 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d"
    )
    assert re.fullmatch(text, str(caught.value))


def test_the_hold_ends_with_the_process_however_that_ends(device: str) -> None:
    with another_process(device) as pid:
        assert is_held(device)
        os.kill(pid, signal.SIGKILL)
    assert not is_held(device)
    DeviceLock([device], "after").release()


@pytest.mark.full
def test_a_device_is_held_however_many_have_asked_before(device: str) -> None:
    with another_process(device) as pid:
        os.kill(pid, signal.SIGSTOP)  # it answers nobody
        assert all(is_held(device) for _ in range(10_000))
        with pytest.raises(DeviceHeld):
            DeviceLock([device], "second")
        os.kill(pid, signal.SIGCONT)


def test_who_gets_one_of_two_devices_only_holds_neither(device: str) -> None:
    with another_process(f"{device} b"), pytest.raises(DeviceHeld):
        DeviceLock([f"{device} a", f"{device} b"], "second")
    assert not is_held(f"{device} a")


def test_a_forked_process_keeps_the_hold_until_it_has_ended_too_and_the_one_that_uses_it_is_named(device: str) -> None:
    kept = DeviceLock([device], "first")
    reading, writing = os.pipe()
    ready, telling = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(writing)
        kept.used_here()
        os.write(telling, b"!")
        os.read(reading, 1)
        os._exit(0)
    os.read(ready, 1)
    assert re.match(rf"pid {child} of user \w+ \(first\), since", holder(device))
    kept.used_here()
    assert holder(device).startswith("this program itself (first), since")
    kept.release()
    assert is_held(device)
    os.close(writing)
    os.waitpid(child, 0)
    for file in (reading, ready, telling):
        os.close(file)
    assert not is_held(device)


INHERITED = """
import os, signal, sys
from umo.system.device_lock import DeviceLock
kept = DeviceLock(sys.argv[1:], "press, bench")
child = os.fork()
if child == 0:
    os.close(1)
    os.kill(os.getpid(), signal.SIGSTOP)
else:
    os.waitpid(child, os.WUNTRACED)
    print(child, flush=True)
"""


def test_a_process_that_has_inherited_a_device_is_named_when_the_owner_has_ended(device: str) -> None:
    command = [sys.executable, "-c", INHERITED, device]
    child = int(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    try:
        ended = rf"which has ended; pid {child} \(stopped by a signal\), which that process has started, still holds it"
        assert re.search(ended, holder(device))
    finally:
        os.kill(child, signal.SIGKILL)
    assert until(lambda: not is_held(device))


@pytest.mark.skipif(not ROOT, reason="becoming another user needs root")
def test_another_user_holds_against_this_one_and_is_named(device: str) -> None:
    with as_nobody(lambda: DeviceLock([device], "theirs")) as pid:
        assert f"pid {pid} of user " in holder(device)
        assert "user root" not in holder(device)


def test_a_note_that_another_process_forges_is_not_believed(device: str) -> None:
    """What a holder says of itself counts only under the pid that the kernel names."""
    import socket

    from umo.system import device_lock

    with another_process(device) as pid:
        forged = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        forged.bind(f"\0{device_lock._note(device, os.getpid())}1 forged".encode())
        assert f"pid {pid} " in holder(device)
        assert "forged" not in holder(device)
        forged.close()


# Connecting ---------------------------------------------------------------------------------------------


def test_two_machines_on_one_device_cannot_be_connected_at_once_and_the_second_touches_nothing(device: str) -> None:
    first, second, box = bench(), bench(), Board(device)
    with connect(first, on(Board(device), first)):
        with pytest.raises(DeviceHeld, match="this program itself"):
            connect(second, on(box, second)).__enter__()
        assert box.calls == []
    with connect(second, on(box, second)):
        assert box.calls


def test_a_machine_without_hardware_holds_nothing_and_leaves_no_record() -> None:
    machines = [bench() for _ in range(2)]
    with connect(machines[0], wired(machines[0], Scripted())), connect(machines[1], wired(machines[1], Scripted())):
        assert all_standing() == []


def test_a_wiring_that_is_wrong_holds_nothing(device: str) -> None:
    machine = bench()
    wiring = on(Board(device), machine)
    del wiring["wire"]["motor"]
    with pytest.raises(WiringError):
        connect(machine, wiring).__enter__()
    assert not is_held(device)


def test_one_machine_is_connected_once_however_many_threads_try() -> None:
    machine = bench()
    together, done = threading.Barrier(8), threading.Barrier(8)
    connected: list[bool] = []

    def one() -> None:
        connection = connect(machine, wired(machine, Scripted()))
        together.wait()
        try:
            connection.__enter__()
        except umo.errors.DeclarationError:
            done.wait()
            return
        connected.append(True)
        done.wait()
        connection.__exit__(None, None, None)

    threads = [threading.Thread(target=one) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert connected == [True]


# Standing stopped ---------------------------------------------------------------------------------------


def test_a_device_whose_default_was_not_reached_stands_stopped_until_it_is_acknowledged(
    device: str,
) -> None:
    first, second, box = bench(), bench(), Board(device)
    with pytest.raises(umo.errors.StopError), connect(first, on(box, first)) as m:
        periods(m)
        box.broken = OSError("unplugged")
    (ended,) = standing(device)
    assert (ended.state, sorted(ended.unreached)) == ("stopped", ["motor", "valve"])
    fresh = Board(device)
    with pytest.raises(AcknowledgeRequired, match="not reached: motor, valve"):
        connect(second, on(fresh, second)).__enter__()
    assert fresh.calls == []
    assert not is_held(device)
    with connect(second, on(fresh, second), acknowledge=True):
        pass
    assert standing(device) == []


def test_a_process_killed_while_it_drives_a_device_leaves_it_standing(device: str) -> None:
    machine = bench()
    child = os.fork()
    if child == 0:
        connect(machine, on(Board(device), machine)).__enter__()
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    with pytest.raises(AcknowledgeRequired, match="all of its processes ended without a report"):
        connect(machine, on(Board(device), machine)).__enter__()


def test_a_safe_end_leaves_nothing_behind(device: str) -> None:
    machine = bench()
    with connect(machine, on(Board(device), machine)):
        assert [ended.state for ended in standing(device)] == ["running"]
    assert standing(device) == []
    assert not is_held(device)


# The wiring's lint --------------------------------------------------------------------------------------


def test_a_timer_in_virtual_time_is_refused_beside_hardware(device: str) -> None:
    machine = bench()
    wiring = wired(machine, Board(device))
    refused = re.escape(f"driver box controls hardware ({device})")
    with pytest.raises(WiringError, match=refused) as caught, connect(machine, wiring):
        pytest.fail("it was connected")
    (fault,) = caught.value.mistakes
    assert fault.key == 'wire."timer".driver'
    assert umo.check(machine, wiring) == []  # it runs with --realtime
    resolved = resolve(machine, wiring, to_run=False)
    with pytest.raises(WiringError, match=refused), connect(machine, resolved):
        pytest.fail("it was connected")


@pytest.mark.parametrize("error", [KeyError("port"), SystemExit(0)])
def test_a_driver_that_cannot_name_its_devices_is_a_fault(error: BaseException) -> None:
    class Broken(Scripted):
        def devices(self) -> list[str]:
            raise error

    machine = bench()
    (fault,) = umo.check(machine, wired(machine, Broken()))
    assert fault.key == "drivers.box"
    assert fault.message.startswith(f"cannot name its devices: {type(error).__name__}: ")


def test_two_texts_of_one_output_are_found_by_the_address_in_the_channels_own_fields() -> None:
    from dataclasses import dataclass

    @dataclass(frozen=True)
    class Relay(Channel):
        number: int = 0

    class Card(Scripted):
        def channel(self, text: str) -> Relay:
            return Relay(text, umo.drivers.Direction.BOTH, 64, True, int(re.sub(r"\D", "", text) or 99))

    machine = bench()
    entries = {"motor": {"channel": "out1"}, "valve": {"channel": "out01"}, "encoder": {"channel": "in2"}}
    faults = umo.check(machine, wired(machine, Card(), entries=entries))
    assert [fault.key for fault in faults] == ['wire."valve"']
    assert "is already used by motor" in faults[0].message


@pytest.mark.parametrize(("options", "faults"), [({}, 1), ({"unit": 2}, 0), ({"port": 503}, 0)])
def test_one_output_by_two_drivers_of_one_device_is_found(options: dict[str, Any], faults: int) -> None:
    machine = bench()
    wiring = wired(machine, Scripted(), clock=Board("clock"))
    wiring["drivers"] |= {
        "left": {"type": "modbus", "host": "127.0.0.1", "port": 502, "unit": 1},
        "right": {"type": "modbus", "host": "localhost", "port": 502, "unit": 1} | options,
    }
    wiring["wire"]["valve"] = {"driver": "left", "channel": "coil:1"}
    wiring["wire"]["motor"] = {"driver": "right", "channel": "holding:1:int16"}
    assert umo.check(machine, wiring) == []
    wiring["wire"]["limit"] = {"driver": "right", "channel": "coil:1"}
    found = umo.check(machine, wiring)
    assert len(found) == faults
    assert all("is already used by valve" in fault.message for fault in found)


def test_connecting_gives_hardware_more_time_than_a_period_does(device: str) -> None:
    """A device that lets go of its last client late."""

    class Slow(Board):
        def __init__(self, *devices: str) -> None:
            super().__init__(*devices)
            self.given: dict[str, float] = {}

        def open(self) -> None:
            self.given["open"] = self.timeout

        def initialize(self, channel: Channel, default: int | None) -> None:
            self.given["initialize"] = self.timeout
            super().initialize(channel, default)

        def read_many(self, channels: Any, out: Any) -> None:
            self.given["sample"] = self.timeout
            super().read_many(channels, out)

    machine, box = bench(), Slow(device)
    box.timeout = 0.1
    with connect(machine, on(box, machine)):
        assert box.given["initialize"] == 3.0
        assert box.given["open"] == box.given["sample"] == box.timeout < 3.0


def test_a_connection_that_failed_leaves_an_earlier_unsafe_end_to_be_acknowledged(device: str) -> None:
    first, second = bench(), bench()
    box = Board(device)
    with pytest.raises(umo.errors.StopError), connect(first, on(box, first)) as m:
        periods(m)
        box.broken = OSError("unplugged")
    broken = Board(device)
    broken.broken = OSError("connection refused")
    with pytest.raises(umo.errors.DriverError), connect(second, on(broken, second), acknowledge=True):
        pass
    (ended,) = standing(device)
    assert (ended.state, sorted(ended.unreached)) == ("stopped", ["motor", "valve"])
