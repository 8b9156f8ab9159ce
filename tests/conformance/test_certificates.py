"""Drivers of umo under the kit, and the page of their certificates. conftest.py compares the page with what is found
here."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from conformance.subjects import simulated
from umo.drivers.modbus import Modbus
from umo.drivers.timerfd import TimerFd
from umo.testing.conformance import Certificate, Input, Output, Subject, TcpTap, all_rules, conform

SOURCE = Path(__file__).parents[1] / "peers" / "modbus_peer.c"


@pytest.fixture
def cycles(request: pytest.FixtureRequest) -> int:
    """Few, unless certificates are asked for."""
    return 10_000 if request.config.getoption("--certificates", default=None) else 100


def test_the_simulated_circuit(cycles: int) -> None:
    certificate = conform(simulated(), cycles=cycles)
    assert certificate.passed, str(certificate)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="timerfd is a part of Linux")
def test_the_timer(cycles: int) -> None:
    subject = Subject("timerfd", make=TimerFd, inputs=(Input("tick", steady=False),), device="the clock of Linux")
    certificate = conform(subject, cycles=min(cycles, 1000))
    assert certificate.passed, str(certificate)


@pytest.fixture
def modbus_port(tmp_path: Path) -> Iterator[int]:
    """Of a server made with libmodbus."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or shutil.which("pkg-config") is None:
        pytest.skip("the libmodbus peer needs a C compiler and pkg-config")
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "libmodbus"], capture_output=True, text=True)
    if flags.returncode:
        pytest.skip("the libmodbus peer needs Debian's libmodbus-dev")
    program = tmp_path / "peer"
    subprocess.run([compiler, "-O1", "-o", program, SOURCE, *flags.stdout.split()], check=True)
    with subprocess.Popen([program, "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield _port(process)
        process.kill()


def _port(process: subprocess.Popen[str]) -> int:
    """It logs each request, which somebody has to read."""
    assert process.stdout is not None
    port = int(process.stdout.readline().split()[1])
    threading.Thread(target=deque, args=(process.stdout, 0), daemon=True).start()
    return port


def test_modbus_with_libmodbus(modbus_port: int, cycles: int) -> None:
    with TcpTap("127.0.0.1", modbus_port) as tap:
        subject = Subject(
            "modbus",
            make=lambda: Modbus(host=tap.host, port=tap.port),
            direct=lambda: Modbus(port=modbus_port),
            outputs=(
                Output("coil:3", 0, 0, 1),
                Output("coil:4", 1, 0, 1),
                Output("holding:10", 500, 0, 65535),
                Output("holding:20:int32", -5, -(2**31), 2**31 - 1),
            ),
            inputs=(Input("discrete:1"), Input("discrete:3"), Input("input:5"), Input("input:6:int16")),
            refused=("holding:600", "coil:5000"),
            line=tap,
            timeout=0.05,
            device="a server made with libmodbus, TCP",
        )
        certificate = conform(subject, cycles=cycles)
    assert certificate.passed, str(certificate)


# The page ---------------------------------------------------------------------------------------------


def test_the_page_states_the_rules_as_they_are(certify: Any) -> None:
    text = certify.PAGE.read_text("utf-8")
    for rule in all_rules():
        assert f"| {rule.id} | {rule.text} |" in text


def test_the_page_shows_whole_certificates_of_drivers_of_umo_alone(certify: Any, tmp_path: Path) -> None:
    whole = conform(simulated(), cycles=10)
    whole.save(tmp_path)
    conform(replace(simulated(), name="part"), only=["range"]).save(tmp_path)
    replace(whole, name="card", driver="card:Card").save(tmp_path)
    assert certify.read([tmp_path]).keys() == {"simulated"}


def test_the_page_has_a_verdict_on_every_rule_for_every_driver(certify: Any) -> None:
    shown = certify.verdicts(certify.PAGE.read_text("utf-8"))
    assert {"simulated", "timerfd", "modbus"} <= shown.keys()
    for name, marks in shown.items():
        assert marks.keys() == {rule.id for rule in all_rules()}, name
        assert set(marks.values()) <= {"passed", "-"}, name


def test_a_page_shows_what_failed_and_why_something_was_not_tried(certify: Any) -> None:
    certificate = conform(simulated(), cycles=10)
    text = certificate.to_json().replace('"passed"', '"failed"', 1)
    made = certify.page({"simulated": Certificate.from_json(text)})
    assert "| channels | **failed** |" in made
    assert "| late answer | - |" in made
    assert "- simulated: timeout, patience, " in made
    assert certify.verdicts(made)["simulated"]["channels"] == "**failed**"


def test_without_certificates_the_page_is_left_alone(certify: Any, tmp_path: Path, capsys: Any) -> None:
    before = certify.PAGE.read_text("utf-8")
    assert certify.main([str(tmp_path)]) == 2
    assert "there are no certificates" in capsys.readouterr().err
    assert certify.PAGE.read_text("utf-8") == before
