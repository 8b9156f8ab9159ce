"""The I2C driver on the kernel's i2c-stub: chips that are memories, on an adapter of SMBus."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, connect
from umo.drivers import Driver
from umo.drivers.i2c import I2c
from umo.drivers.off_cycle import OffCycle
from umo.errors import DeviceTimeout, DriverError
from umo.states import OnOff
from umo.testing.conformance import Input, Output, Subject

from .i2c_stub import i2c_bus
from .proof import proved

smbus2 = pytest.importorskip("smbus2", reason='needs smbus2: pip install ".[i2c]"')

ADC, EXPANDER = 0x48, 0x20
REGISTERS: dict[str, dict[str, Any]] = {
    "temperature": {"address": 0x05, "bits": 16, "signed": True, "shift": 4, "access": "r"},
    "control": {"address": 0x01, "bits": 16, "fields": {"on": 15, "gain": "11:9"}},
}
PAGED = {
    "first": {"address": 0x10, "page": 0},
    "second": {"address": 0x10, "page": 1},
    "third": {"address": 0x11, "page": 2},
}


@pytest.fixture
def bus() -> Iterator[str]:
    """A bus with two chips. The second has pages: 0x10 to 0x1f, selected by 0x7f."""
    options = ("bank_reg=0,0x7f", "bank_mask=0,3", "bank_start=0,0x10", "bank_end=0,0x1f")
    with i2c_bus(ADC, EXPANDER, options=options) as path:
        yield path


@pytest.fixture
def chip(bus: str) -> Iterator[Any]:
    """The chip from the other side: smbus2 without the driver."""
    with smbus2.SMBus(bus) as other:
        yield other


def opened(bus: str, **options: Any) -> I2c:
    driver = I2c(**{"bus": bus, "address": ADC} | options)
    driver.open()
    return driver


@pytest.mark.parametrize("text", ["0x30:8", "0x30:16", "0x30:16:little", "0x30:24", "0x30:64", "0x30:32:big:signed"])
@pytest.mark.parametrize("auto_increment", [False, True])
def test_what_is_written_is_read(bus: str, text: str, auto_increment: bool) -> None:
    driver = opened(bus, auto_increment=auto_increment)
    channel = driver.channel(text)
    for raw in (channel.lowest, 1, min(channel.highest, 2**63 - 1)):
        driver.write(channel, raw)
        assert driver.read(channel) == raw
    driver.close()


def test_bytes_are_in_the_order_of_the_wiring(bus: str, chip: Any) -> None:
    driver = opened(bus, auto_increment=True)
    driver.write(driver.channel("0x30:16"), 0x1234)
    driver.write(driver.channel("0x32:16:little"), 0x1234)
    assert chip.read_i2c_block_data(ADC, 0x30, 4) == [0x12, 0x34, 0x34, 0x12]
    driver.close()


def test_a_register_of_16_bits_is_a_word_of_smbus_whose_first_byte_is_the_low_one(bus: str, chip: Any) -> None:
    driver = opened(bus, registers=REGISTERS)
    chip.write_word_data(ADC, 0x05, 0xF0FF)
    assert driver.read(driver.channel("temperature")) == -1
    driver.write(driver.channel("0x06:16"), 0x1234)
    assert chip.read_word_data(ADC, 0x06) == 0x3412
    driver.close()


def test_fields_are_written_without_the_other_bits(bus: str, chip: Any) -> None:
    chip.write_word_data(ADC, 0x01, 0xFFFF)
    driver = opened(bus, registers=REGISTERS)
    driver.write_many((driver.channel("control.on"), driver.channel("control.gain")), np.array([0, 2], np.int64))
    assert chip.read_word_data(ADC, 0x01) == int.from_bytes((0x75FF).to_bytes(2, "big"), "little")
    driver.close()


def test_a_block_moves_registers_that_follow_each_other(bus: str, chip: Any) -> None:
    driver = opened(bus, auto_increment=True)
    channels = tuple(driver.channel(f"{0x40 + 2 * i}:16") for i in range(20))  # 40 bytes: two blocks
    driver.write_many(channels, np.arange(20, dtype=np.int64) * 1000)
    out = np.zeros(20, np.int64)
    driver.read_many(channels, out)
    assert out.tolist() == [1000 * i for i in range(20)]
    assert chip.read_i2c_block_data(ADC, 0x40 + 38, 2) == list((19000).to_bytes(2, "big"))
    driver.close()


def test_pages_are_selected(bus: str, chip: Any) -> None:
    driver = opened(bus, address=EXPANDER, registers=PAGED, page_register=0x7F)
    channels = tuple(map(driver.channel, PAGED))
    driver.write_many(channels, np.array([1, 2, 3], np.int64))
    out = np.zeros(3, np.int64)
    driver.read_many(channels, out)
    assert out.tolist() == [1, 2, 3]
    for page, (address, value) in enumerate([(0x10, 1), (0x10, 2), (0x11, 3)]):
        chip.write_byte_data(EXPANDER, 0x7F, page)
        assert chip.read_byte_data(EXPANDER, address) == value
    driver.close()


def test_an_address_without_a_chip_is_an_error_and_no_timeout(bus: str) -> None:
    driver = opened(bus, address=0x50)
    with pytest.raises(DriverError, match=f"reading 0x00: nothing answers at address 0x50 of {bus}") as failed:
        driver.read(driver.channel("0:8"))
    assert not isinstance(failed.value, DeviceTimeout)
    driver.close()


def test_a_chip_that_the_kernel_has_a_driver_for_is_still_free_without_one(bus: str) -> None:
    """A device that is declared and has no driver may be used."""
    declared = Path(f"/sys/bus/i2c/devices/{Path(bus).name}/new_device")
    declared.write_text(f"nobody {ADC:#x}")
    opened(bus).close()
    declared.with_name("delete_device").write_text(f"{ADC:#x}")


def test_a_bus_that_is_not_there_is_named_with_those_that_are(bus: str) -> None:
    with pytest.raises(DriverError, match=f"no device /dev/i2c-77.*; there are: {bus}"):
        opened("/dev/i2c-77")


def test_a_bus_that_may_not_be_opened_is_an_error_of_one_line(bus: str) -> None:
    os.seteuid(65534)
    try:
        with pytest.raises(DriverError, match=rf"^no permission to open {bus}[^\n]*$"):
            opened(bus)
    finally:
        os.seteuid(0)


def test_an_identity_is_compared(bus: str, chip: Any) -> None:
    chip.write_byte_data(ADC, 0x0F, 0x33)
    opened(bus, registers={"who": {"address": 0x0F, "access": "r"}}, identity={"who": 0x33}).close()
    with pytest.raises(DriverError, match="who is 0x33 in place of 0x34"):
        opened(bus, registers={"who": {"address": 0x0F, "access": "r"}}, identity={"who": 0x34})


def test_checksums_need_an_adapter_that_has_them(bus: str) -> None:
    with pytest.raises(DriverError, match="has no pec"):
        opened(bus, pec=True)


class Bench(Compound):
    valve: DigitalActuator
    pump: BinaryActuator[OnOff]
    fan: BinaryActuator[OnOff]
    moving: BinarySensor[OnOff]


def test_a_machine_on_two_chips_of_one_bus(bus: str, chip: Any) -> None:
    outputs = {"address": 0x02, "fields": {"pump": 0, "fan": 1}}
    machine = Bench(
        valve=DigitalActuator("V", default=1.0, minimum=0.0, maximum=10.0, resolution=0.01),
        pump=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON),
        moving=BinarySensor(OnOff, one=OnOff.ON),
    )
    wiring = {
        "drivers": {
            "dac": {"type": "i2c", "bus": bus, "address": ADC},
            "io": {"type": "i2c", "bus": bus, "address": EXPANDER, "registers": {"outputs": outputs}},
        },
        "wire": {
            "valve": {"driver": "dac", "channel": "0x40:16"},
            "pump": {"driver": "io", "channel": "outputs.pump"},
            "fan": {"driver": "io", "channel": "outputs.fan"},
            "moving": {"driver": "io", "channel": "0x00:8.3"},
        },
    }
    chip.write_byte_data(EXPANDER, 0x02, 0x80)
    with connect(machine, wiring) as m:
        assert chip.read_byte_data(EXPANDER, 0x02) == 0x82
        m.pump.write(OnOff.ON)
        m.valve.write(2.5)
        chip.write_byte_data(EXPANDER, 0x00, 0x08)
        m.update()
        m.sample()
        assert m.moving.read() is OnOff.ON
        assert chip.read_byte_data(EXPANDER, 0x02) == 0x83
        assert chip.read_word_data(ADC, 0x40) == int.from_bytes((250).to_bytes(2, "big"), "little")
    assert chip.read_byte_data(EXPANDER, 0x02) == 0x82
    assert chip.read_word_data(ADC, 0x40) == int.from_bytes((100).to_bytes(2, "big"), "little")


@pytest.mark.parametrize(("auto_increment", "off_cycle"), [(False, False), (True, False), (False, True)])
def test_the_driver_keeps_the_contract(bus: str, auto_increment: bool, off_cycle: bool) -> None:
    """Without a device that vanishes: the kernel keeps i2c-stub while its bus is open (tests/drivers/test_i2c.py has
    one)."""
    outputs = (Output("control", 0x0102, 0, 0xFFFF), Output("0x40:32:little:signed", -5, -(2**31), 2**31 - 1))
    fields = (Output("mode.on", 1, 0, 1), Output("mode.gain", 2, 0, 7))
    mode = {"address": 0x08, "fields": {"on": 0, "gain": "3:1"}}

    def make() -> Driver:
        driver = I2c(bus=bus, address=ADC, registers={**REGISTERS, "mode": mode}, auto_increment=auto_increment)
        return OffCycle(driver, own_period=0.05, max_age=0.15) if off_cycle else driver

    subject = Subject(
        name="i2c" + " with auto_increment" * auto_increment + ", off the cycle" * off_cycle,
        make=make,
        sole_writer=True,
        outputs=outputs + fields,
        inputs=(Input("temperature"),),
        device="i2c-stub of the kernel",
    )
    proved(subject)


OBJECTS = """
from umo import BinaryActuator, Compound, DigitalSensor
from umo.states import OnOff


class Bench(Compound):
    heater: BinaryActuator[OnOff]
    fan: BinaryActuator[OnOff]
    timer: DigitalSensor


def machine() -> Bench:
    return Bench(
        heater=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        fan=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.ON),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo.states import OnOff
from umo.control import wait


async def main(m):
    m.heater.write(OnOff.ON)
    m.fan.write(OnOff.OFF)
    await wait("600 s")
"""
STATION_WIRING = """
[drivers.io]
type = "i2c"
bus = "%s"
address = 0x20
registers = { outputs = { address = 0x14, fields = { heater = 0, fan = 1 } } }
[wire]
heater = { driver = "io", channel = "outputs.heater" }
fan = { driver = "io", channel = "outputs.fan" }
timer = { driver = "timerfd", period = "20 ms" }
"""


def eventually(condition: Callable[[], bool], within: float = 60.0) -> None:
    end = monotonic() + within
    while not condition():
        assert monotonic() < end, "it has not come"
        sleep(0.02)


@pytest.mark.slow
def test_the_outputs_of_a_killed_run_are_reset_and_the_other_bits_stay(bus: str, chip: Any, tmp_path: Path) -> None:
    station = tmp_path / "bench"
    (station / "wiring").mkdir(parents=True)
    (station / "objects.py").write_text(OBJECTS)
    (station / "application.py").write_text(APPLICATION)
    (station / "wiring" / "simulated.toml").write_text(STATION_WIRING % bus)
    chip.write_byte_data(EXPANDER, 0x14, 0xA0)
    umo = [sys.executable, "-c", "from umo_command import main; main()"]
    log = (tmp_path / "log").open("w+")
    run = subprocess.Popen([*umo, "run", str(station)], cwd=station, stdout=subprocess.DEVNULL, stderr=log)
    try:
        eventually(lambda: chip.read_byte_data(EXPANDER, 0x14) == 0xA1)
        get = subprocess.run([*umo, "device", "get", str(station), "fan"], capture_output=True, text=True, check=True)
        (pid,) = re.findall(r"\(pid (\d+)\)", get.stdout + get.stderr)
        os.kill(int(pid), signal.SIGKILL)
        eventually(lambda: chip.read_byte_data(EXPANDER, 0x14) == 0xA2)
        run.wait(60)
        assert "the guardian reset every actuator" in (tmp_path / "log").read_text()
    finally:
        run.terminate()
        run.wait(60)
        log.close()
