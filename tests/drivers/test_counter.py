"""The counter driver on plain files in place of sysfs. With the kernel's own: tests/kernel/test_counter.py."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from umo.drivers import counter
from umo.drivers.contract import Direction
from umo.drivers.counter import Counter
from umo.errors import ChannelError, DriverError, WiringError

ENCODER = {
    "count": "0",
    "ceiling": "65535",
    "preset": "0",
    "enable": "0",
    "direction": "forward",
    "function": "increase",
    "function_available": "increase\nquadrature x4",
}
Make = Callable[..., Path]


@pytest.fixture
def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes counters: `devices("counter0", count="7")`."""
    monkeypatch.setattr(counter, "DEVICES", tmp_path)

    def make(number: str = "counter0", name: str = "encoder", **files: str) -> Path:
        folder = tmp_path / number
        (folder / "count0").mkdir(parents=True)
        (folder / "name").write_text(f"{name}\n")
        (folder / "num_counts").write_text("1\n")
        for file, text in {**ENCODER, **files}.items():
            (folder / "count0" / file).write_text(f"{text}\n")
        return folder / "count0"

    return make


def opened(*texts: str, **options: object) -> Counter:
    """A driver with these channels initialised as sensors."""
    driver = Counter(**options)  # type: ignore[arg-type]
    channels = [driver.channel(text) for text in texts]
    driver.open()
    for channel in channels:
        driver.initialize(channel, None)
    return driver


def read(driver: Counter, text: str) -> int:
    return driver.read(driver.channel(text))


@pytest.mark.parametrize(
    ("text", "bits", "signed", "direction"),
    [
        ("count:0", 64, True, Direction.BOTH),
        ("preset:12", 64, True, Direction.BOTH),
        ("ceiling:0", 63, False, Direction.BOTH),
        ("floor:0", 63, False, Direction.BOTH),
        ("enable:0", 1, False, Direction.BOTH),
        ("direction:0", 1, False, Direction.INPUT),
    ],
)
def test_the_text_of_a_channel_names_a_file_of_a_count(
    text: str, bits: int, signed: bool, direction: Direction
) -> None:
    channel = Counter(bits=64, signed=True).channel(text)
    assert (channel.bits, channel.signed, channel.direction) == (bits, signed, direction)
    assert f"{channel.attribute}:{channel.count}" == text


@pytest.mark.parametrize("text", ["", "count", "count:", "count:00", "count:-1", "counts:0", "function:0", "count:0:x"])
def test_any_other_text_is_an_error_with_the_forms(text: str) -> None:
    with pytest.raises(ChannelError, match="the forms are: count:N, preset:N"):
        Counter().channel(text)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": 0}, "device must be the name or path of a counter, not 0"),
        ({"bits": 64}, "bits must be a whole number from 1 to 63, not 64"),
        ({"bits": 65, "signed": True}, "from 1 to 64"),
        ({"bits": True}, "bits must be"),
        ({"signed": 1}, "signed must be true or false"),
    ],
)
def test_a_wrong_option_names_the_valid_choice(options: dict[str, object], message: str) -> None:
    with pytest.raises(WiringError, match=message):
        Counter(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("bits", "signed", "text", "value"),
    [
        (16, False, "65535", 65535),
        (16, True, "65535", -1),
        (16, True, "32768", -32768),
        (16, True, "32767", 32767),
        (32, True, "18446744073709551615", -1),  # the driver has extended the sign
        (64, True, "18446744073709551615", -1),
        (63, False, "9223372036854775807", 2**63 - 1),
    ],
)
def test_a_count_is_read_with_its_width_and_sign(devices: Make, bits: int, signed: bool, text: str, value: int) -> None:
    devices(count=text)
    assert read(opened("count:0", bits=bits, signed=signed), "count:0") == value


@pytest.mark.parametrize(("bits", "signed", "text"), [(16, False, "65536"), (16, True, "65536"), (8, True, "1000000")])
def test_a_count_that_does_not_fit_its_width_is_an_error(devices: Make, bits: int, signed: bool, text: str) -> None:
    devices(count=text)
    with pytest.raises(DriverError, match=f"count:0 is {text}, more than {bits} bits"):
        read(opened("count:0", bits=bits, signed=signed), "count:0")


@pytest.mark.parametrize("text", ["", "many", "-5", "1.5"])
def test_a_count_that_is_not_a_number_is_an_error(devices: Make, text: str) -> None:
    devices(count=text)
    with pytest.raises(DriverError, match="not a number"):
        read(opened("count:0"), "count:0")


def test_a_written_value_is_checked_and_encoded_with_the_width(devices: Make) -> None:
    folder = devices()
    driver = opened("preset:0", bits=16, signed=True)
    preset = driver.channel("preset:0")
    driver.write(preset, -2)
    assert (folder / "preset").read_text().startswith("65534")
    with pytest.raises(DriverError, match="32768 does not fit preset:0: it takes -32768 to 32767"):
        driver.write(preset, 32768)
    with pytest.raises(DriverError, match="direction:0 is an input"):
        driver.write(driver.channel("direction:0"), 0)


@pytest.mark.parametrize(("text", "raw"), [("forward", 0), ("backward", 1)])
def test_the_direction_is_a_bit(devices: Make, text: str, raw: int) -> None:
    devices(direction=text)
    assert read(opened("direction:0"), "direction:0") == raw


def test_a_direction_of_another_word_is_an_error(devices: Make) -> None:
    devices(direction="sideways")
    with pytest.raises(DriverError, match="the direction of count 0 is 'sideways'"):
        read(opened("direction:0"), "direction:0")


def test_initialising_a_count_enables_it_and_keeps_its_value(devices: Make) -> None:
    folder = devices(count="77")
    driver = opened("count:0")
    assert (folder / "enable").read_text().strip() == "1"
    driver.reset(driver.channel("count:0"), None)
    driver.close()
    assert (folder / "count").read_text().strip() == "77"
    assert (folder / "enable").read_text().strip() == "1"


def test_a_wired_enable_decides_whether_it_counts(devices: Make) -> None:
    folder = devices()
    driver = opened("enable:0", "count:0")
    assert (folder / "enable").read_text().strip() == "0"
    driver.write(driver.channel("enable:0"), 1)
    assert (folder / "enable").read_text().startswith("1")


def test_a_count_without_a_function_or_enable_is_left_as_it_is(devices: Make) -> None:
    folder = devices()
    (folder / "enable").unlink()
    assert read(opened("count:0"), "count:0") == 0
    assert (folder / "function").read_text().strip() == "increase"


def test_the_function_is_set_and_an_unknown_one_names_those_of_the_device(devices: Make) -> None:
    folder = devices()
    opened("count:0", function="quadrature x4")
    assert (folder / "function").read_text().strip() == "quadrature x4"
    with pytest.raises(
        DriverError, match=r"'quadrature x2' \(did you mean 'quadrature x4'\?\); it has: increase, quad"
    ):
        opened("count:0", function="quadrature x2")


def test_a_counter_is_found_by_number_name_and_path_as_one_device(devices: Make, tmp_path: Path) -> None:
    devices("counter0", "left")
    devices("counter1", "right")
    for spelling in ("counter1", "right", str(tmp_path / "counter1"), str(tmp_path / "counter0" / ".." / "counter1")):
        assert list(Counter(device=spelling).devices()) == ["counter counter1"]
        opened(device=spelling).close()


def test_a_missing_counter_names_those_that_exist(devices: Make) -> None:
    devices("counter0", "left")
    devices("counter10", "right")
    for device, message in (
        (
            "lift",
            r"^there is no counter 'lift' \(did you mean 'left'\?\); "
            r"there are: counter0 \(left\), counter10 \(right\)$",
        ),
        ("/dev/null", "/dev/null is not a counter; there are: counter0"),
    ):
        driver = Counter(device=device)
        assert list(driver.devices()) == [f"counter {device}"]
        with pytest.raises(DriverError, match=message):
            driver.open()
        driver.close()


def test_two_counters_of_one_name_are_told_apart_by_number(devices: Make) -> None:
    devices("counter0")
    devices("counter1")
    with pytest.raises(
        DriverError, match=r"counter0 \(encoder\) and counter1 \(encoder\) both have the name 'encoder'"
    ):
        opened(device="encoder")


def test_without_any_counter_it_says_so(devices: Make) -> None:
    with pytest.raises(DriverError, match="no counter 'counter0'; this computer has no counter"):
        opened()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("floor:0", "has no floor; it has: count, preset, ceiling, enable"),
        ("count:3", "has no count 3; it has: count0"),
    ],
)
def test_a_file_or_count_that_the_device_does_not_have_is_an_error(devices: Make, text: str, message: str) -> None:
    devices()
    with pytest.raises(DriverError, match=message):
        opened(text)


def test_a_counter_that_returns_is_initialised_again_until_that_succeeds(devices: Make) -> None:
    folder = devices()
    driver = opened("count:0", function="quadrature x4")
    driver._disconnect()  # as after ENODEV
    (folder / "enable").write_text("0\n")
    (folder / "function_available").write_text("increase\n")
    for _ in range(2):
        with pytest.raises(DriverError, match="no function 'quadrature x4'"):
            read(driver, "count:0")
    (folder / "function_available").write_text("increase\nquadrature x4\n")
    assert read(driver, "count:0") == 0
    assert (folder / "enable").read_text() == "1"
    driver.close()


def test_closing_leaves_no_descriptor_and_it_opens_again(devices: Make) -> None:
    devices(count="5")
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for _ in range(3):
        driver = opened("count:0", "ceiling:0", "direction:0")
        driver.finalize(driver.channel("ceiling:0"))
        assert read(driver, "count:0") == 5
        driver.close()
        driver.close()
        with pytest.raises(DriverError, match="not open"):
            read(driver, "count:0")
    assert not before or len(os.listdir("/proc/self/fd")) == before
