"""The IIO driver on a tree of files as sysfs has them; tests/kernel/test_iio.py runs it on the kernel's IIO dummy."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo import Compound, DigitalActuator, DigitalSensor, check
from umo.drivers import ChannelError, ChannelsFailed, Direction, DriverError, WiringError
from umo.drivers.iio import Iio
from umo.drivers.iio import sysfs as kernels_files
from umo.drivers.iio.scan import BUFFER_LENGTH, ScanLayout, ScanType
from umo.drivers.optional import PhysicalScale

FILES = {
    "name": "adc",
    "in_voltage0_raw": "73\n",
    "in_voltage0_scale": "0.5",
    "in_voltage0_offset": "-8",
    "in_voltage1-voltage2_raw": "-33\n",
    "in_voltage-voltage_scale": "0.001",
    "in_accel_x_raw": "344\n",
    "in_temp_raw": "200\n",
    "in_temp_scale": "125",
    "in_steps_input": "47",
    "in_pressure_input": "101.325004500",
    "out_voltage0_raw": "0\n",
    "out_voltage_scale": "1",
    "buffer/enable": "0",
    "buffer/length": "0",
    "trigger/current_trigger": "\n",
    "scan_elements/in_voltage0_en": "0",
    "scan_elements/in_voltage0_index": "0",
    "scan_elements/in_voltage0_type": "be:u12/16>>4",
    "scan_elements/in_voltage1-voltage2_en": "0",
    "scan_elements/in_voltage1-voltage2_index": "2",
    "scan_elements/in_voltage1-voltage2_type": "le:s24/32>>0",
    "scan_elements/in_accel_x_en": "1",
    "scan_elements/in_accel_x_index": "1",
    "scan_elements/in_accel_x_type": "le:s8/8>>0",
}


@pytest.fixture
def sysfs(tmp_path, monkeypatch):
    """Two devices and a trigger; a FIFO stands for the character device of each."""
    folder = tmp_path / "sys"
    for number, files in enumerate([FILES, {"name": "other", "label": "spare", "in_temp_raw": "1"}]):
        for name, text in files.items():
            file = folder / f"iio:device{number}" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        os.mkfifo(tmp_path / f"iio:device{number}")
    (folder / "trigger0").mkdir()
    (folder / "trigger0" / "name").write_text("tick\n")
    (folder / "trigger0" / "sampling_frequency").write_text("100.0\n")
    monkeypatch.setattr(kernels_files, "SYSFS", folder)
    monkeypatch.setattr(kernels_files, "DEV", tmp_path)
    return folder / "iio:device0"


@pytest.fixture
def records(sysfs, tmp_path):
    """Puts records into the buffer."""
    fd = os.open(tmp_path / "iio:device0", os.O_RDWR | os.O_NONBLOCK)
    yield lambda *records: os.write(fd, b"".join(records))
    os.close(fd)


def opened(**options):
    driver = Iio(**{"device": "adc"} | options)
    driver.open()
    return driver


def many(driver, *names):
    out = np.zeros(len(names), np.int64)
    driver.read_many(tuple(map(driver.channel, names)), out)
    return out.tolist()


# Devices and channels -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": ""}, "device must be a name, a label or a number such as \"iio:device0\", not ''"),
        ({"device": 3}, "device must be a name.*, not 3"),
        ({"sampling_frequency": 0.0}, "sampling_frequency must be in Hz and above 0, not 0.0"),
        ({"sampling_frequency": float("nan")}, "sampling_frequency must be in Hz and above 0"),
        ({"sampling_frequency": "100"}, "sampling_frequency must be in Hz and above 0, not '100'"),
        ({"sampling_frequency": 100.0}, "sampling_frequency is the rate of scans, which need the option trigger"),
        ({"conditioned": ["voltage0"]}, "conditioned lists channels such as 'in_voltage0', not 'voltage0'"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(WiringError, match=message):
        Iio(**{"device": "adc"} | options)


def test_a_device_is_found_by_name_label_or_number(sysfs):
    assert Iio(device="adc").devices() == Iio(device="iio:device0").devices() == ["iio iio:device0"]
    assert Iio(device="spare").devices() == ["iio iio:device1"]


def test_a_device_that_is_not_there_is_named_with_those_that_are(sysfs):
    with pytest.raises(
        DriverError, match=r"no IIO device 'acd' \(did you mean 'adc'\?\); there are: iio:device0 \(adc"
    ):
        opened(device="acd")


def test_without_any_device_the_error_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(kernels_files, "SYSFS", tmp_path / "none")
    with pytest.raises(DriverError, match="no IIO device 'adc'; this computer has no IIO device"):
        opened()


def test_two_devices_of_one_name_are_told_apart_by_label_or_number(sysfs):
    (sysfs.with_name("iio:device1") / "name").write_text("adc")
    with pytest.raises(
        DriverError, match=r"iio:device0 \(adc\) and iio:device1 \(adc, spare\) both have the name 'adc'"
    ):
        opened()
    opened(device="spare").close()


def test_a_channel_has_the_kernels_name(sysfs):
    driver = Iio(device="adc")
    assert driver.channel("in_voltage0").direction is Direction.INPUT
    assert driver.channel("out_voltage0").direction is Direction.BOTH
    with pytest.raises(ChannelError, match=r"did you mean 'in_voltage0'\?.* in_accel_x, in_temp, in_voltage0, in_volt"):
        driver.channel("in_voltage")
    with pytest.raises(ChannelError):
        driver.channel("in_steps")


def test_without_the_device_a_channel_of_the_right_form_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(kernels_files, "SYSFS", tmp_path)
    driver = Iio(device="adc", trigger="tick")
    assert driver.channel("in_voltage1-voltage2").bits == 32
    for text in ("voltage0", "in_voltage0_raw ", "in_", "IN_VOLTAGE0", ""):
        with pytest.raises(ChannelError):
            driver.channel(text)
    assert driver.devices() == ["iio adc"]
    assert driver.physical_scale(driver.channel("in_voltage0")) is None


# Single values --------------------------------------------------------------------------------------


def test_raw_values_are_read_and_written(sysfs):
    driver = opened()
    assert many(driver, "in_voltage1-voltage2", "in_voltage0", "out_voltage0") == [-33, 73, 0]
    (sysfs / "in_voltage0_raw").write_text("12\n")
    assert driver.read(driver.channel("in_voltage0")) == 12
    driver.write(driver.channel("out_voltage0"), 4095)
    assert (sysfs / "out_voltage0_raw").read_text().startswith("4095")
    driver.close()


def test_a_channel_that_fails_leaves_the_others(sysfs):
    (sysfs / "in_temp_raw").write_text("warm\n")
    driver = opened()
    out = np.zeros(2, np.int64)
    with pytest.raises(ChannelsFailed) as failed:
        driver.read_many((driver.channel("in_temp"), driver.channel("in_voltage0")), out)
    assert failed.value.causes == {"in_temp": "its raw value is 'warm', not an integer"}
    assert out[1] == 73
    driver.close()


def test_a_channel_that_was_wired_without_the_device_may_be_missing(sysfs, tmp_path):
    channel = Iio(device="not there").channel("in_pressure")
    driver = opened()
    with pytest.raises(DriverError, match="adc has no such channel: in_accel_x, in_temp"):
        driver.read(channel)
    driver.close()


def test_an_input_is_not_written_nor_a_value_beyond_32_bits(sysfs):
    driver = opened()
    with pytest.raises(DriverError, match="in_voltage0 is an input"):
        driver.write(driver.channel("in_voltage0"), 1)
    with pytest.raises(DriverError, match="2147483648 does not fit out_voltage0"):
        driver.write(driver.channel("out_voltage0"), 1 << 31)
    driver.close()


# Scans ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "data", "value"),
    [
        ("le:s12/16>>4", "f0ff", -1),
        ("le:s12/16>>4", "1080", -2047),
        ("be:u12/16>>4", "fff0", 4095),
        ("le:u13/16>>0", "ffff", 0x1FFF),
        ("be:s24/32>>8", "80000000", -(1 << 23)),
        ("le:s64/64>>0", "ffffffffffffffff", -1),
    ],
)
def test_a_scan_element_is_parsed_from_its_type(text, data, value):
    assert ScanType.parse(text).decode(bytes.fromhex(data)) == value


@pytest.mark.parametrize("text", ["le:s16/16X4>>0", "le:s12/16>>8", "xe:s16/16>>0", "le:f32/32>>0", "", "le:u0/8>>0"])
def test_a_scan_element_that_is_not_one_integer_is_refused(text):
    with pytest.raises(DriverError, match="umo reads scan elements of one integer"):
        ScanType.parse(text)


@given(st.data())
def test_every_value_that_a_type_can_hold_is_decoded(data):
    storage = data.draw(st.sampled_from([8, 16, 32, 64]))
    bits = data.draw(st.integers(1, storage))
    shift = data.draw(st.integers(0, storage - bits))
    signed, order = data.draw(st.booleans()), data.draw(st.sampled_from(["big", "little"]))
    least = -(1 << bits - 1) if signed else 0
    value = data.draw(st.integers(least, least + (1 << bits) - 1))
    noise = data.draw(st.integers(0, (1 << storage) - 1)) & ~((1 << bits) - 1 << shift)
    stored = ((value & (1 << bits) - 1) << shift | noise).to_bytes(storage // 8, order)
    kind = ScanType.parse(f"{order[0]}e:{'s' if signed else 'u'}{bits}/{storage}>>{shift}")
    assert kind.decode(stored) == value


def test_elements_are_aligned_to_their_size_in_the_order_of_their_index():
    kinds = {"a": (0, "le:u16/16>>0"), "c": (5, "le:s64/64>>0"), "b": (1, "le:u8/8>>0")}
    layout = ScanLayout.of((name, index, ScanType.parse(text)) for name, (index, text) in kinds.items())
    assert {name: at for name, (at, _) in layout.places.items()} == {"a": 0, "b": 2, "c": 8}
    assert layout.size == 16


RECORD = bytes.fromhex("1230 ff 00 fdffff00")  # in_voltage0, in_accel_x, a gap, in_voltage1-voltage2
OTHER = bytes.fromhex("0010 02 00 03000000")
NAMES = ("in_voltage1-voltage2", "in_voltage0", "in_accel_x")


def started(records, **options):
    """A driver with its scan running."""
    driver = opened(trigger="tick", **options)
    for name in NAMES:
        driver.initialize(driver.channel(name), None)
    records(OTHER)
    many(driver, *NAMES)
    return driver


def test_a_scan_is_one_record(sysfs, records):
    driver = started(records)
    records(OTHER, RECORD)
    assert many(driver, *NAMES) == [-3, 0x123, -1]
    settings = {name: (sysfs / name).read_text() for name in FILES if "_en" in name or "/" in name}
    assert settings["buffer/enable"] == "1"
    assert settings["trigger/current_trigger"] == "tick"
    assert [name for name, text in settings.items() if name.endswith("_en") and text == "1"] == [
        "scan_elements/in_voltage0_en",
        "scan_elements/in_voltage1-voltage2_en",
        "scan_elements/in_accel_x_en",
    ]
    driver.close()
    assert (sysfs / "buffer/enable").read_text() == "0"


def test_the_newest_record_is_taken_again_while_it_is_not_too_old(sysfs, records):
    driver = started(records)
    records(RECORD)
    assert many(driver, *NAMES) == many(driver, *NAMES) == [-3, 0x123, -1]
    driver.close()


def test_records_of_a_full_buffer_are_not_the_newest(sysfs, records):
    """The kernel drops new records while its buffer is full."""
    driver = started(records)
    records(*[OTHER] * BUFFER_LENGTH)

    class Late:
        """The next record comes while the driver waits for it."""

        def poll(self, timeout):
            records(RECORD)
            return [1]

    driver._scan._waiting = Late()
    assert many(driver, *NAMES) == [-3, 0x123, -1]
    driver.close()


def test_half_a_record_is_an_error_and_the_scan_starts_anew(sysfs, records):
    driver = started(records)
    records(RECORD[:3])
    with pytest.raises(DriverError, match="a record of 3 bytes in place of 8"):
        many(driver, *NAMES)
    records(RECORD)
    assert many(driver, *NAMES) == [-3, 0x123, -1]
    driver.close()


@pytest.mark.parametrize(("hertz", "text"), [(250.0, "250"), (12345.678, "12345.678"), (1e7, "10000000")])
def test_the_frequency_of_the_trigger_is_set(sysfs, records, hertz, text):
    started(records, sampling_frequency=hertz).close()
    assert (sysfs.with_name("trigger0") / "sampling_frequency").read_text() == text


# The scale ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("channel", "scale"),
    [
        ("in_voltage0", PhysicalScale(0.5, -4.0, "mV")),
        ("in_voltage1-voltage2", PhysicalScale(0.001, 0.0, "mV")),
        ("in_temp", PhysicalScale(0.125, 0.0, "degC")),
        ("out_voltage0", PhysicalScale(1.0, 0.0, "mV")),
        ("in_accel_x", None),
    ],
)
def test_the_scale_is_that_of_the_kernel(sysfs, channel, scale):
    driver = Iio(device="adc")
    assert driver.physical_scale(driver.channel(channel)) == scale


def test_a_channel_behind_a_divider_has_no_scale_of_its_own(sysfs):
    driver = Iio(device="adc", conditioned=["in_voltage0"])
    assert driver.physical_scale(driver.channel("in_voltage0")) is None
    assert driver.physical_scale(driver.channel("in_temp")) is not None


class Bench(Compound):
    supply: DigitalSensor
    motor: DigitalActuator


def faults(units="V", resolution=0.0005, zero_offset=-0.004, motor=0.001, **options):
    supply = DigitalSensor(units, minimum=0.0, maximum=2.0, resolution=resolution, zero_offset=zero_offset)
    machine = Bench(supply=supply, motor=DigitalActuator("V", default=0.0, minimum=0.0, maximum=4.0, resolution=motor))
    wire = {
        "supply": {"driver": "adc", "channel": "in_voltage0"},
        "motor": {"driver": "adc", "channel": "out_voltage0"},
    }
    return check(machine, {"drivers": {"adc": {"type": "iio", "device": "adc", **options}}, "wire": wire})


def test_a_scale_that_agrees_with_the_kernels_is_no_fault(sysfs):
    assert faults() == []
    assert faults("mV", 0.5, -4.0) == []
    assert faults(resolution=0.00050005) == []  # 0.2 mV at 2 V: less than half a raw step


@pytest.mark.parametrize(
    "wrong", [{"resolution": 0.000501}, {"zero_offset": -0.0037}, {"motor": 0.00101}, {"motor": 0.1}]
)
def test_a_scale_that_differs_by_more_than_half_a_step_is_a_fault(sysfs, wrong):
    (fault,) = faults(**wrong)
    assert "away from the scale of the circuit" in fault.message
    own = "resolution = 0.001, zero_offset = 0" if "motor" in wrong else "resolution = 0.0005, zero_offset = -0.004"
    assert fault.message.endswith(own)


def test_a_scale_is_not_compared_with_other_dimensions_nor_behind_a_divider(sysfs):
    assert faults("bar", 0.1, 0.0) == []
    assert faults(resolution=0.0055, zero_offset=0.0, conditioned=["in_voltage0"]) == []


# Processed values -----------------------------------------------------------------------------------


def test_processed_values_are_read_by_their_scale(sysfs):
    driver = opened()
    names = ("in_steps_input", "in_pressure_input:0.001", "in_temp")
    assert many(driver, *names) == [47, 101325, 200]
    (sysfs / "in_pressure_input").write_text("-0.0015\n")  # half to even
    assert many(driver, "in_pressure_input:0.001", "in_pressure_input:1e-4") == [-2, -15]
    assert driver.channel("in_pressure_input:0.001").places == driver.channel("in_pressure_input").places
    driver.close()


def test_a_processed_value_has_the_kernel_s_unit(sysfs):
    driver = Iio(device="adc")
    assert driver.physical_scale(driver.channel("in_pressure_input:0.001")) == PhysicalScale(0.001, 0.0, "kPa")
    assert driver.physical_scale(driver.channel("in_steps_input")) is None


@pytest.mark.parametrize(
    "text", ["in_pressure_input:", "in_pressure_input:0", "in_pressure_input:-1", "in_pressure_input:x", "in_temp:0.1"]
)
def test_another_scale_of_a_processed_value_is_refused(sysfs, text):
    with pytest.raises(ChannelError, match="in_pressure_input"):
        Iio(device="adc").channel(text)


@pytest.mark.parametrize(("text", "message"), [("nan", "not a number"), ("", "not a number"), ("1e12", "does not fit")])
def test_a_processed_value_without_a_raw_integer_fails_for_its_channel(sysfs, text, message):
    driver = opened()
    (sysfs / "in_pressure_input").write_text(text)
    with pytest.raises(ChannelsFailed, match=message) as caught:
        many(driver, "in_pressure_input:0.001", "in_temp")
    assert list(caught.value.causes) == ["in_pressure_input:0.001"]
    driver.close()


def test_a_processed_value_is_no_part_of_a_scan(sysfs):
    with pytest.raises(WiringError, match="in_steps_input cannot be scanned by a trigger"):
        Iio(device="adc", trigger="tick").channel("in_steps_input")
