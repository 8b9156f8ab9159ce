"""`umo view`: what it refuses, and that it prints an address that opens."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

Umo = Callable[..., Result]


def refused(result: Result) -> str:
    assert result.exit_code == 2
    text = " ".join(result.stderr.split())
    assert text.startswith("umo: ")
    assert "Traceback" not in text
    return text


@pytest.mark.parametrize("token", [(), ("--token", "short")])
def test_other_computers_are_let_in_only_with_a_token_that_is_given(umo: Umo, token: tuple[str, ...]) -> None:
    assert "give a token of at least 8 characters" in refused(umo("view", "--host", "0.0.0.0", *token))


def test_a_certificate_needs_its_key(umo: Umo) -> None:
    assert "both --certificate and --key" in refused(umo("view", "--certificate", "a.pem"))


def test_a_certificate_that_is_missing_is_named(umo: Umo) -> None:
    assert "a.pem: No such file" in refused(umo("view", "--certificate", "a.pem", "--key", "a.key"))


def test_a_station_that_nobody_knows_is_refused_with_the_nearest(umo: Umo) -> None:
    assert "did you mean 'ztheta'?" in refused(umo("view", "zteta"))


def test_a_wiring_without_a_station_is_refused(umo: Umo) -> None:
    assert "--wiring belongs to a station" in refused(umo("view", "-w", "modbus"))


def test_an_address_of_another_computer_is_refused(umo: Umo) -> None:
    assert "cannot listen at 192.0.2.1" in refused(umo("view", "--host", "192.0.2.1", "--token", "long enough"))


def test_without_its_libraries_it_says_what_to_install(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.cli.page.find_spec", lambda name: None if name == "uvicorn" else object())
    assert 'pip install "umo[page]"' in refused(umo("view"))


def test_the_address_that_it_prints_opens_the_page_until_ctrl_c(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from umo.cli import main; main()", "view", "--port", "0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            with urllib.request.urlopen(address, timeout=20) as response:
                assert b"<title>umo</title>" in response.read()
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=20)
            assert "Traceback" not in error
        finally:
            process.kill()
