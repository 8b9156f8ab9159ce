"""The test kernel has what the tests of drivers need."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from .gpio_sim import Chip, fixed


def test_a_simulated_chip_has_its_lines_and_can_go_and_come(gpio_chip: Callable[..., Chip]) -> None:
    chip = gpio_chip(lines=4, names={1: "PUMP"})
    chip.line(2).pull(1)
    assert chip.levels() == [0, 0, 1, 0]
    assert Path(chip.path).is_char_device()
    chip.go()
    assert not Path("/dev/gpiochip1").exists()
    chip.come()
    assert Path(chip.path).is_char_device()


def test_the_devices_of_the_device_tree_are_there() -> None:
    assert {path.name for path in Path("/sys/bus/counter/devices").iterdir()} == {"counter0", "counter1"}
    assert Path("/dev/spidev0.0").is_char_device()
    fixed(4).pull(1)
    assert fixed(4).value == 1
    fixed(4).pull(0)


def test_i2c_stub_can_be_loaded() -> None:
    stub = Path(os.environ["UMO_KERNEL_MODULES"]) / "i2c-stub.ko"
    subprocess.run(["busybox", "insmod", stub, "chip_addr=0x50"], check=True)
    assert Path("/dev/i2c-0").is_char_device()
    subprocess.run(["busybox", "rmmod", "i2c_stub"], check=True)


@pytest.mark.parametrize("folder", ["iio/devices/dummy", "iio/triggers/hrtimer"])
def test_iio_devices_and_triggers_can_be_made(folder: str) -> None:
    made = Path("/sys/kernel/config") / folder / "kernel_test"
    made.mkdir()
    made.rmdir()


def test_the_writable_folders_are_writable_and_the_root_is_not(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="Read-only"):
        (Path(__file__).parent / "file").touch()
