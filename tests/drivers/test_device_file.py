"""Errors of opening device files name the remedy."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from umo.drivers._device_file import explained, holders, opening, similar
from umo.errors import DriverError


def failing(number: int) -> OSError:
    return OSError(number, os.strerror(number))


def test_a_missing_device_names_those_that_exist(tmp_path: Path) -> None:
    for name in ("ttyUSB10", "ttyUSB2", "ttyACM0", "null"):
        (tmp_path / name).touch()
    path = str(tmp_path / "ttyUSB0")
    text = explained(path, failing(errno.ENOENT))
    assert text.startswith(f"there is no device {path}")
    assert text.endswith(f"there are: {tmp_path}/ttyUSB2, {tmp_path}/ttyUSB10")
    assert "ttyACM0" not in text


def test_a_missing_device_without_others_says_so(tmp_path: Path) -> None:
    assert explained(str(tmp_path / "gpiochip0"), failing(errno.ENODEV)).endswith("there is no device of this kind")
    assert similar(str(tmp_path / "nowhere" / "gpiochip0")) == []


def test_a_refused_device_names_the_group_to_join(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grp = pytest.importorskip("grp")
    path = tmp_path / "ttyUSB0"
    path.touch()
    path.chmod(0o660)
    monkeypatch.setattr(grp, "getgrgid", lambda _: grp.struct_group(("dialout", "x", 20, [])))
    monkeypatch.setattr("getpass.getuser", lambda: "ann")
    text = explained(str(path), failing(errno.EACCES))
    assert text == f"no permission to open {path}: join its group (sudo usermod -aG dialout ann) and log in again"


def test_a_refused_device_whose_group_has_no_rights_tells_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "spidev0.0"
    path.touch()
    path.chmod(0o600)
    assert "its permissions are 600" in explained(str(path), failing(errno.EPERM))


def test_a_busy_device_names_the_process_that_holds_it(tmp_path: Path) -> None:
    path = tmp_path / "ttyUSB0"
    path.touch()
    with path.open():
        assert holders(str(path)) == [f"pid {os.getpid()} ({Path('/proc/self/comm').read_text().strip()})"]
        assert f"{path} is in use by pid {os.getpid()} (" in explained(str(path), failing(errno.EBUSY))
    assert holders(str(path)) == []
    assert explained(str(path), failing(errno.EBUSY)) == f"{path} is in use"


def test_opening_maps_an_os_error_and_leaves_a_driver_error_alone(tmp_path: Path) -> None:
    path = str(tmp_path / "i2c-1")
    with pytest.raises(DriverError, match="no device"), opening(path):
        os.open(path, os.O_RDWR)
    with pytest.raises(DriverError, match=r"^another$"), opening(path):
        raise DriverError("another")
