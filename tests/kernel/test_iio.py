"""The IIO driver on the kernel's IIO dummy: an ADC, a DAC and an accelerometer, scanned by a timer."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from umo import Compound, DigitalActuator, DigitalSensor, check, connect
from umo.drivers.iio import Iio
from umo.drivers.optional import PhysicalScale
from umo.errors import ChannelError, DeviceTimeout, DriverError, WiringError
from umo.testing.conformance import Input, Output, Subject

from .proof import proved

CONFIGFS = Path("/sys/kernel/config/iio")
SYSFS = Path("/sys/bus/iio/devices")
SCANNED = {"in_voltage0": 7, "in_voltage1-voltage2": -33, "in_voltage3-voltage4": -2, "in_accel_x": 344}
"""What the dummy puts into every scan; read one by one, its channels have other values."""


@pytest.fixture
def make() -> Iterator[Callable[[str], Path]]:
    """Makes devices and triggers: `make("devices/dummy/adc")`."""
    made = []

    def one(path: str) -> Path:
        made.append(CONFIGFS / path)
        made[-1].mkdir()
        return made[-1]

    yield one
    for folder in reversed(made):
        with suppress(FileNotFoundError):
            folder.rmdir()


@pytest.fixture
def adc(make: Callable[[str], Path]) -> Path:
    """The sysfs folder of a device named "adc"."""
    make("devices/dummy/adc")
    (folder,) = (name.parent for name in SYSFS.glob("iio:device*/name") if name.read_text() == "adc\n")
    return folder


@pytest.fixture
def tick(make: Callable[[str], Path]) -> Path:
    make("triggers/hrtimer/tick")
    (folder,) = (name.parent for name in SYSFS.glob("trigger*/name") if name.read_text() == "tick\n")
    return folder


def opened(**options: Any) -> Iio:
    driver = Iio(**{"device": "adc"} | options)
    driver.open()
    return driver


def many(driver: Iio, *names: str) -> list[int]:
    out = np.zeros(len(names), np.int64)
    driver.read_many(tuple(map(driver.channel, names)), out)
    return out.tolist()


def test_raw_values_are_those_of_the_kernel(adc: Path) -> None:
    driver = opened()
    assert many(driver, *SCANNED) == [int((adc / f"{name}_raw").read_text()) for name in SCANNED] == [73, 33, -34, 34]
    for raw in (0, 1, 4095, -7):
        driver.write(driver.channel("out_voltage0"), raw)
        assert int((adc / "out_voltage0_raw").read_text()) == raw
        assert driver.read(driver.channel("out_voltage0")) == raw
    driver.close()


def test_the_channels_are_those_with_a_raw_value(adc: Path) -> None:
    with pytest.raises(
        ChannelError, match="the forms are: in_accel_x, in_voltage0, in_voltage1-voltage2, in_voltage3-vol"
    ):
        Iio(device="adc").channel("in_steps")


def test_the_scale_is_that_of_the_kernel(adc: Path) -> None:
    driver = Iio(device="adc")
    found = {name: driver.physical_scale(driver.channel(name)) for name in [*SCANNED, "out_voltage0"]}
    assert found["in_voltage0"] == PhysicalScale(0.001333, 7 * 0.001333, "mV")
    assert found["in_voltage1-voltage2"] == PhysicalScale(0.000001344, 0.0, "mV")
    assert found["in_accel_x"] is found["out_voltage0"] is None


def test_all_channels_of_a_scan_are_from_one_record(adc: Path, tick: Path) -> None:
    driver = opened(trigger="tick", sampling_frequency=200.0)
    assert many(driver, *SCANNED) == list(SCANNED.values())
    assert many(driver, *reversed(SCANNED)) == list(reversed(SCANNED.values()))
    assert float((tick / "sampling_frequency").read_text()) == 200.0
    assert (adc / "buffer/enable").read_text() == "1\n"
    assert (adc / "scan_elements/in_timestamp_en").read_text() == "0\n"
    driver.close()
    assert (adc / "buffer/enable").read_text() == "0\n"
    assert (adc / "trigger/current_trigger").read_text().strip() == ""


@pytest.mark.parametrize("names", [["in_accel_x"], ["in_voltage0", "in_accel_x"], ["in_voltage3-voltage4"]])
def test_the_order_of_the_buffer_does_not_matter(adc: Path, tick: Path, names: list[str]) -> None:
    """The dummy fills a record by the enabled channels."""
    driver = opened(trigger="tick")
    assert many(driver, *names) == [SCANNED[name] for name in names]
    assert many(driver, *SCANNED) == list(SCANNED.values())  # more channels: the scan starts anew
    driver.close()


def test_width_and_sign_are_those_of_the_scan_element(adc: Path, tick: Path) -> None:
    driver = Iio(device="adc", trigger="tick")
    channels = [driver.channel(name) for name in SCANNED]
    assert [(channel.bits, channel.signed) for channel in channels] == [(13, False), (12, True), (11, True), (16, True)]


def test_an_output_is_written_while_a_scan_runs(adc: Path, tick: Path) -> None:
    driver = opened(trigger="tick")
    many(driver, "in_voltage0")
    driver.write(driver.channel("out_voltage0"), 99)
    with pytest.raises(DriverError, match="in use by pid"):  # the dummy's rule: it reads nothing for itself then
        driver.read(driver.channel("out_voltage0"))
    driver.close()
    assert int((adc / "out_voltage0_raw").read_text()) == 99


def test_a_trigger_that_does_not_fire_is_a_timeout(adc: Path, tick: Path) -> None:
    driver = opened(trigger="tick", sampling_frequency=0.5)
    driver.timeout = 0.05
    with pytest.raises(DeviceTimeout, match="the trigger has not fired within 50 ms"):
        many(driver, "in_voltage0")
    assert (adc / "buffer/enable").read_text() == "0\n"
    (tick / "sampling_frequency").write_text("1000")
    driver.close()
    driver = opened(trigger="tick")
    driver.timeout = 5.0
    assert many(driver, "in_voltage0") == [7]
    driver.close()


def test_a_trigger_that_stops_is_a_timeout_when_the_last_record_is_too_old(adc: Path, tick: Path) -> None:
    driver = opened(trigger="tick", sampling_frequency=500.0)
    driver.timeout = 5.0
    assert many(driver, "in_voltage0") == [7]
    (tick / "sampling_frequency").write_text("0.1")
    driver.timeout = 0.1
    with pytest.raises(DeviceTimeout):
        for _ in range(1_000_000):
            many(driver, "in_voltage0")
    driver.close()


def test_a_trigger_that_is_not_there_is_named_with_those_that_are(adc: Path, tick: Path) -> None:
    with pytest.raises(
        DriverError, match=r"no trigger 'tock' \(did you mean 'tick'\?\); there are: tick; .*hrtimer/tock"
    ):
        opened(trigger="tock")


def test_a_buffer_that_another_process_reads_names_it(adc: Path, tick: Path) -> None:
    code = "import os, sys; fd = os.open(sys.argv[1], os.O_RDONLY); print(flush=True); sys.stdin.read()"
    words = [sys.executable, "-c", code, f"/dev/{adc.name}"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None and other.stdin is not None
        other.stdout.readline()
        driver = opened(trigger="tick")
        with pytest.raises(DriverError, match=rf"/dev/{adc.name} is in use by pid {other.pid} \(python"):
            many(driver, "in_voltage0")
        other.stdin.close()
    assert many(driver, "in_voltage0") == [7]
    driver.close()


def test_a_buffer_that_a_killed_process_left_on_is_taken_over(adc: Path, tick: Path) -> None:
    child = os.fork()
    if child == 0:
        many(opened(trigger="tick"), "in_voltage0")
        os._exit(0)
    os.waitpid(child, 0)
    assert (adc / "buffer/enable").read_text() == "1\n"
    driver = opened()
    with pytest.raises(DriverError, match=rf"/dev/{adc.name} is in use; its buffer is on"):
        driver.read(driver.channel("in_voltage0"))
    driver.close()
    driver = opened(trigger="tick")
    assert many(driver, *SCANNED) == list(SCANNED.values())
    driver.close()


def test_a_device_that_goes_is_an_error_and_found_again_when_it_returns(adc: Path, make: Callable[[str], Path]) -> None:
    driver = opened()
    channel = driver.channel("in_voltage0")
    assert driver.read(channel) == 73
    (CONFIGFS / "devices/dummy/adc").rmdir()
    for _ in range(2):
        with pytest.raises(DriverError, match=r"the device adc is gone|no IIO device 'adc'"):
            driver.read(channel)
    make("devices/dummy/adc")
    assert driver.read(channel) == 73
    driver.close()


def test_a_device_that_goes_while_it_is_scanned_is_an_error(adc: Path, tick: Path, make: Callable[[str], Path]) -> None:
    driver = opened(trigger="tick")
    driver.timeout = 2.0
    channel = driver.channel("in_voltage0")
    assert driver.read(channel) == 7
    (CONFIGFS / "devices/dummy/adc").rmdir()
    driver.timeout = 0.2
    with pytest.raises(DriverError):
        for _ in range(1_000_000):
            driver.read(channel)
    with pytest.raises(DriverError, match="no IIO device 'adc'"):
        driver.read(channel)
    make("devices/dummy/adc")
    driver.timeout = 2.0
    assert driver.read(channel) == 7
    driver.close()


def test_what_may_not_be_written_or_scanned_is_an_error_of_one_line(adc: Path, tick: Path) -> None:
    os.seteuid(65534)
    try:
        driver = opened(trigger="tick")
        with pytest.raises(DriverError, match=rf"^no permission to open /dev/{adc.name}[^\n]*$"):
            many(driver, "in_voltage0")
        with pytest.raises(DriverError, match=r"^no permission to open [^\n]*out_voltage0_raw[^\n]*$"):
            driver.write(driver.channel("out_voltage0"), 1)
        driver.close()
    finally:
        os.seteuid(0)


def test_no_descriptor_is_left_open(adc: Path, tick: Path) -> None:
    before = os.listdir("/proc/self/fd")
    for _ in range(20):
        driver = opened(trigger="tick")
        many(driver, "in_voltage0")
        driver.write(driver.channel("out_voltage0"), 1)
        driver.close()
    assert os.listdir("/proc/self/fd") == before


class Bench(Compound):
    supply: DigitalSensor
    motor: DigitalActuator


def bench(resolution: float = 1.333e-6) -> Bench:
    supply = DigitalSensor("V", minimum=0.0, maximum=0.01, resolution=resolution, zero_offset=7 * 1.333e-6)
    return Bench(supply=supply, motor=DigitalActuator("V", default=1.0, minimum=0.0, maximum=4.0, resolution=0.001))


WIRING = {
    "drivers": {"adc": {"type": "iio", "device": "adc"}},
    "wire": {
        "supply": {"driver": "adc", "channel": "in_voltage0"},
        "motor": {"driver": "adc", "channel": "out_voltage0"},
    },
}


def test_a_machine_on_the_dummy(adc: Path) -> None:
    with connect(bench(), WIRING) as m:
        assert (adc / "out_voltage0_raw").read_text() == "1000\n"
        m.motor.write(2.5)
        m.update()
        m.sample()
        assert (adc / "out_voltage0_raw").read_text() == "2500\n"
        assert m.supply.read() == pytest.approx(80 * 1.333e-6)
    assert (adc / "out_voltage0_raw").read_text() == "1000\n"


def test_a_declaration_that_does_not_fit_the_kernels_scale_is_a_fault(adc: Path) -> None:
    (fault,) = check(bench(resolution=1.4e-6), WIRING)
    assert fault.message.endswith("resolution = 1.333e-06, zero_offset = 9.331e-06")
    with (
        pytest.raises(WiringError, match="away from the scale of the circuit, channel in_voltage0"),
        connect(bench(1.4e-6), WIRING),
    ):
        pass


@pytest.mark.parametrize("trigger", [None, "tick"])
def test_the_driver_keeps_the_contract(adc: Path, tick: Path, trigger: str | None) -> None:
    """An output is seen by the kernel's own file. While it scans, the dummy reads no output back."""

    @contextmanager
    def gone() -> Iterator[None]:
        (CONFIGFS / "devices/dummy/adc").rmdir()
        try:
            yield
        finally:
            (CONFIGFS / "devices/dummy/adc").mkdir()

    frequency = None if trigger is None else 1000.0
    subject = Subject(
        name="iio" if trigger is None else "iio with a trigger",
        make=lambda: Iio(device="adc", trigger=trigger, sampling_frequency=frequency),
        outputs=(Output("out_voltage0", 7, -(2**31), 2**31 - 1),) if trigger is None else (),
        inputs=tuple(map(Input, SCANNED)),
        device="IIO dummy of the kernel",
        gone=gone,
        levels=lambda text: [int((adc / f"{text}_raw").read_text())],
    )
    proved(subject)
