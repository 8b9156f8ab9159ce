"""The text driver against foreign devices: firmware in C on an emulated AVR, and a SCPI supply behind socat."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.peers.text_devices import PATIENT, PEERS, CannotRun, Supply, avr, built, supply
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, connect
from umo.drivers.text import Text
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError
from umo.states import OnOff

PAGE = (Path(__file__).parents[2] / "docs" / "driver-text.md").read_text("utf-8")
SUPPLY: dict[str, Any] = {
    "volt{n}": {"ask": ":CH{n}:VOLT?", "set": ":CH{n}:VOLT {:.3f}", "scale": 0.001},
    "measured{n}": {"ask": ":CH{n}:MEAS?", "scale": 0.001},
    "output": {"ask": ":OUTP?", "set": {"0": ":OUTP OFF", "1": ":OUTP ON"}},
    "overflow": {"ask": ":OVER?"},
    "nan": {"ask": ":NAN?"},
    "twice": {"ask": ":TWICE?"},
    "hang": {"ask": ":HANG?"},
}
SCPI: dict[str, Any] = {
    "host": "127.0.0.1",
    "errors": ['-*,"*"'],
    "confirm": {"ask": "SYST:ERR?", "answer": '0,"No error"'},
    "identify": {"ask": "*IDN?", "answer": "SOCAT,*"},
}
INSTRUMENT: dict[str, Any] = {
    "out{n}": {"ask": "OUT? {n}", "answer": "OUT {n}={}", "set": "OUT {n},{}", "bits": 1},
    "adc{n}": {"ask": "ADC? {n}", "bits": 10, "signed": False},
    "level": {"ask": "LEVEL?", "set": "LEVEL {:.2f}", "scale": 0.01},
    "long": {"set": "A REQUEST THAT IS LONGER THAN FORTY CHARACTERS {}"},
}
AVR: dict[str, Any] = {"baudrate": 38400, "errors": ["ERR*"], "acknowledge": "OK", "quiet": 0.03}


@pytest.fixture
def scpi() -> Iterator[Supply]:
    try:
        with supply() as running:
            yield running
    except CannotRun as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def board() -> Iterator[str]:
    try:
        with avr() as path:
            yield path
    except CannotRun as error:
        pytest.skip(str(error))


def opened(**options: Any) -> Text:
    driver = Text(**options)
    driver.timeout = PATIENT
    driver.open()
    return driver


@pytest.fixture
def instrument(board: str) -> Iterator[Text]:
    """Its outputs are off, its level is 0."""
    driver = opened(serial=board, channels=INSTRUMENT, **AVR)
    for name in ("out0", "out1", "out2", "level"):
        driver.write(driver.channel(name), 0)
    yield driver
    driver.close()


def read(driver: Text, *names: str) -> list[int]:
    out = np.zeros(len(names), np.int64)
    driver.read_many(tuple(map(driver.channel, names)), out)
    return out.tolist()  # type: ignore[no-any-return]


# The SCPI supply ----------------------------------------------------------------------------------


@pytest.mark.parametrize("together", [None, ";"])
def test_a_scpi_supply_is_set_and_measured(scpi: Supply, together: str | None) -> None:
    driver = opened(port=scpi.port, channels=SUPPLY, together=together, **SCPI)
    names = ("volt1", "volt2", "output")
    driver.write_many(tuple(map(driver.channel, names)), np.array([1500, 59_999, 1]))
    assert read(driver, *names, "measured1", "measured2") == [1500, 59_999, 1, 1500, 59_999]
    driver.write(driver.channel("output"), 0)
    assert read(driver, "measured1") == [0]
    if together:
        assert scpi.lines()[1:4] == [
            ":CH1:VOLT 1.500;:CH2:VOLT 59.999;:OUTP ON",
            "SYST:ERR?",
            ":CH1:VOLT?;:CH2:VOLT?;:OUTP?;:CH1:MEAS?;:CH2:MEAS?",
        ]
    driver.close()


def test_errors_and_overflow_of_a_scpi_supply_name_their_channels(scpi: Supply) -> None:
    driver = opened(port=scpi.port, channels=SUPPLY, **SCPI)
    with pytest.raises(ChannelsFailed) as raised:
        driver.write_many(tuple(map(driver.channel, ("volt1", "volt2"))), np.array([60_000, 5]))
    assert raised.value.causes == {
        "volt1": """the device answers '-222,"Data out of range"' to 'SYST:ERR?' after ':CH1:VOLT 60.000'"""
    }
    with pytest.raises(ChannelsFailed) as raised:
        read(driver, "volt2", "overflow", "nan")
    assert set(raised.value.causes) == {"overflow", "nan"}
    with pytest.raises(DriverError, match="unasked"):
        read(driver, "twice")
    driver.timeout = 0.1
    with pytest.raises(DeviceTimeout):
        read(driver, "hang")
    driver.timeout = PATIENT
    assert read(driver, "volt2") == [5]
    driver.close()


class Bench(Compound):
    voltage: DigitalActuator
    measured: DigitalSensor
    output: BinaryActuator[OnOff]


def test_a_machine_runs_on_a_scpi_supply_and_is_reset(scpi: Supply) -> None:
    machine = Bench(
        voltage=DigitalActuator("V", default=0.0, minimum=0.0, maximum=30.0, resolution=0.001),
        measured=DigitalSensor("V", minimum=0.0, maximum=60.0, resolution=0.001),
        output=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
    )
    wiring = {
        "drivers": {
            "supply": {"type": "umo.drivers.text:Text", "port": scpi.port, "channels": SUPPLY, "timeout": "5 s"} | SCPI
        },
        "wire": {
            "voltage": {"driver": "supply", "channel": "volt1"},
            "measured": {"driver": "supply", "channel": "measured1"},
            "output": {"driver": "supply", "channel": "output"},
        },
    }
    with connect(machine, wiring) as m:
        m.voltage.write(12.345)
        m.output.write(OnOff.ON)
        m.update()
        m.sample()
        assert m.measured.read() == pytest.approx(12.345)
    assert scpi.lines()[-4::2] == [":CH1:VOLT 0.000", ":OUTP OFF"]


# The emulated AVR ---------------------------------------------------------------------------------


def test_outputs_of_the_firmware_are_seen_by_its_converter(instrument: Text) -> None:
    for n in range(3):
        instrument.write(instrument.channel(f"out{n}"), 1)
        *levels, count, fixed = read(instrument, "out0", "out1", "out2", "adc0", "adc1")
        assert levels == [1, n >= 1, n >= 2]
        assert count == pytest.approx((n + 1) * 500 * 1024 / 5000, abs=2)
        assert fixed == pytest.approx(1250 * 1024 / 5000, abs=2)


def test_numbers_go_to_the_firmware_and_back(instrument: Text) -> None:
    for raw in (0, 1, -1, 99, -100, 1234, -199_999, 199_999):
        instrument.write(instrument.channel("level"), raw)
        assert instrument.read(instrument.channel("level")) == raw


def test_errors_of_the_firmware_leave_the_line_in_step(instrument: Text) -> None:
    for call, text in (
        (lambda: read(instrument, "out7"), "ERR 2 range"),
        (lambda: instrument.write(instrument.channel("level"), 200_000), "ERR 2 range"),
        (lambda: instrument.write(instrument.channel("long"), 1), "ERR 3 line too long"),
    ):
        with pytest.raises(DriverError, match=text):
            call()
        assert read(instrument, "level", "adc1") == [0, 255]


def test_the_watchdog_of_the_firmware_drops_its_outputs(board: str, instrument: Text) -> None:
    instrument.close()
    driver = opened(serial=board, channels=INSTRUMENT, watchdog_set="WD {ms}", **AVR)
    out, level = driver.channel("out3"), driver.channel("level")
    driver.watchdog(0.3)
    driver.write(out, 1)
    assert read(driver, "out3") == [1]
    driver.close()
    quiet = opened(serial=board, channels=INSTRUMENT, boot_time=0.6, watchdog_set="WD {ms}", **AVR)  # no line meanwhile
    assert read(quiet, "out3") == [0]
    quiet.watchdog(0)
    quiet.write(level, 0)
    quiet.close()


# The sketch of the page ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sketched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The sketch of docs/driver-text.md, compiled with a small Arduino core, on the emulated board."""
    found = re.search(r"^```cpp\n(.*?)^```", PAGE, re.M | re.S)
    assert found is not None
    source = tmp_path_factory.mktemp("sketch") / "sketch.cpp"
    source.write_text(f'#include "Arduino.h"\n{found[1]}')
    try:
        with avr(built(source, "-Wall", "-std=c++11", f"-I{PEERS / 'text_avr'}")) as path:
            yield path
    except CannotRun as error:
        pytest.skip(str(error))


def test_the_sketch_of_the_page_works_with_the_wiring_of_the_page(sketched: str) -> None:
    found = re.search(r"^```toml[^\n]*\n(.*?)^```", PAGE, re.M | re.S)
    assert found is not None
    options = tomllib.loads(found[1])["drivers"]["board"]
    for key in ("type", "timeout", "watchdog"):
        del options[key]
    driver = opened(**options | {"serial": sketched, "quiet": 0.03})
    lamp = driver.channel("D8")
    driver.watchdog(0.5)
    driver.write(lamp, 1)
    assert read(driver, "D8", "D9", "A1") == [1, 0, pytest.approx(256, abs=2)]
    assert read(driver, "A0") == [pytest.approx(102, abs=2)]  # the board's: 500 mV for the output that is high
    for wrong in ("D7", "A6"):
        with pytest.raises(DriverError, match="ERR unknown"):
            read(driver, wrong)
    driver.close()
    later = opened(**options | {"serial": sketched, "boot_time": 1.0, "quiet": 0.03})  # its watchdog expires meanwhile
    assert read(later, "D8") == [0]
    later.close()
