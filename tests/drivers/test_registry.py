"""Drivers by name: entry points or module:Class, imported only when named, never silently replaced."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import types

import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.drivers import registry
from umo.drivers.simulated import Simulated
from umo.drivers.timerfd import TimerFd
from umo.errors import WiringError
from umo.testing import Scripted


def test_registered_names():
    assert {"simulated", "timerfd", "modbus", "ztheta"} <= set(registry.known())
    assert registry.find("simulated") is Simulated
    assert registry.find("timerfd") is TimerFd


def test_module_and_class():
    assert registry.find("umo.testing:Scripted") is Scripted


def test_an_unknown_name_is_an_error_with_the_nearest_and_all_that_are_known():
    with pytest.raises(WiringError, match=r"no driver 'simulatd' \(did you mean 'simulated'\?\); known: .*timerfd"):
        registry.find("simulatd")


@pytest.mark.parametrize(
    "name",
    ["no_such_module:Driver", "umo.testing:NoSuch", ":Driver", "umo.testing:", "..x:Y", ".:x", "a b:c", "x:y:z", ":"],
)
def test_what_cannot_be_imported_is_an_error(name):
    with pytest.raises(WiringError, match="cannot be imported"):
        registry.find(name)


@pytest.mark.parametrize("name", ["umo:connect", "umo:Compound", "umo.drivers:contract", "math:pi"])
def test_what_is_no_driver_is_an_error(name):
    with pytest.raises(WiringError, match="is not a umo driver"):
        registry.find(name)


def test_a_module_that_fails_in_any_way_when_imported_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "broken_driver.py").write_text("raise RuntimeError('half written')")
    (tmp_path / "mistyped_driver.py").write_text("class (")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(WiringError, match="half written"):
        registry.find("broken_driver:Driver")
    with pytest.raises(WiringError, match="cannot be imported"):
        registry.find("mistyped_driver:Driver")


def test_a_driver_is_imported_only_when_it_is_named():
    code = "import sys, umo, umo.drivers.registry as r; r.known(); sys.exit('umo.drivers.timerfd' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_registered_driver_that_cannot_be_imported_is_not_replaced(monkeypatch):
    point = types.SimpleNamespace(module="no_such_module", attr="Driver")
    monkeypatch.setattr(registry, "known", lambda: {"simulated": [point]})
    with pytest.raises(WiringError, match="driver 'simulated' cannot be imported"):
        registry.find("simulated")


def installed(folder, distribution, *drivers):
    """A distribution as pip leaves it, with these entry points."""
    metadata = folder / f"{distribution.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("\n".join([f"[{registry.GROUP}]", *drivers]))


def test_a_name_that_two_distributions_register_is_an_error_that_names_both(tmp_path, monkeypatch, umo):
    installed(tmp_path, "acme-drivers", "psu = umo.testing:Scripted", "same = umo.testing:Scripted")
    installed(tmp_path, "other-drivers", "psu = umo.drivers.simulated:Simulated", "same = umo.testing:Scripted")
    monkeypatch.syspath_prepend(tmp_path)
    registry.known.cache_clear()
    try:
        text = (
            "driver 'psu' is registered by other-drivers (umo.drivers.simulated:Simulated) and "
            "acme-drivers (umo.testing:Scripted); remove one, or name module:Class"
        )
        with pytest.raises(WiringError) as error:
            registry.find("psu")
        assert str(error.value) == text
        assert registry.find("same") is Scripted
        assert registry.find("simulated") is Simulated
        assert "driver 'psu' is registered by" in umo("device", "drivers").output
    finally:
        registry.known.cache_clear()


@given(st.text(max_size=20).filter(lambda text: ":" not in text))
def test_no_name_makes_anything_but_a_driver_or_a_wiring_error(name):
    with contextlib.suppress(WiringError):
        registry.find(name)
