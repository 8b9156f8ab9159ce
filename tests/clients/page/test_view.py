"""`umo show page`: what it refuses, and that it prints an address that opens."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.tiers import first
from umo.clients.page.server import Options
from umo.clients.page.session import InitialStation

from .conftest import PATIENCE, eventually, running, viewing

ROOT = Path(__file__).parents[3]
Umo = Callable[..., Result]


def refused(result: Result) -> str:
    assert result.exit_code == 2
    text = " ".join(result.stderr.split())
    assert text.startswith("umo: ")
    assert "Traceback" not in text
    return text


def test_other_computers_are_let_in_only_with_a_token_that_is_given(umo: Umo) -> None:
    assert "give a token of at least 8 characters" in refused(umo("show", "page", "--host", "0.0.0.0"))


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
@pytest.mark.parametrize("token", ["", "a", "1234567"])
def test_a_short_token_is_refused_at_every_address(
    umo: Umo, host: str, token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.clients.page.server.serve", lambda *given: None)
    assert "give a token of at least 8" in refused(umo("show", "page", "--host", host, "--port", "0", "--token", token))


def test_a_certificate_needs_its_key(umo: Umo) -> None:
    assert "both --certificate and --key" in refused(umo("show", "page", "--certificate", "a.pem"))


def test_a_certificate_that_is_missing_is_named(umo: Umo) -> None:
    assert "a.pem: No such file" in refused(umo("show", "page", "--certificate", "a.pem", "--key", "a.key"))


def test_a_station_that_nobody_knows_is_refused_with_the_nearest(umo: Umo) -> None:
    assert "did you mean 'ztheta'?" in refused(umo("show", "page", "zteta"))


def test_the_run_that_is_named_is_shown_first_and_a_name_of_several_is_refused(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served: list[Options] = []

    def serve(options: Options, listening: socket.socket, ready: Callable[[], None]) -> None:
        listening.close()
        served.append(options)

    monkeypatch.setattr("umo.clients.page.server.serve", serve)
    monkeypatch.setattr("umo_command.show.page.drop_realtime", lambda: None)
    with running(place=tmp_path / "a"), running("press", place=tmp_path / "b"):
        umo("show", "page", str(tmp_path / "b"), "--port", "0")
        assert [each.first for each in served] == [InitialStation("press", str(tmp_path / "b"), os.getpid())]
        assert "2 runs of press are active; give the pid" in refused(umo("show", "page", "press", "--port", "0"))


def test_a_mistake_in_the_roles_is_told_when_other_computers_may_operate(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "umo").mkdir()
    (tmp_path / "umo" / "roles.toml").write_text('[users]\nann = "maintian"\n')
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))

    def serve(options: Options, listening: socket.socket, ready: Callable[[], None]) -> None:
        listening.close()
        ready()

    monkeypatch.setattr("umo.clients.page.server.serve", serve)
    monkeypatch.setattr("umo_command.show.page.drop_realtime", lambda: None)
    words = ("show", "page", "--host", "0.0.0.0", "--token", "long enough", "--port", "0")
    told = "other users may only see the machine: "
    result = umo(*words, "--operate")
    assert told in " ".join(result.stderr.split())
    assert "ann: there is no role 'maintian' (did you mean 'maintain'?)" in " ".join(result.stderr.split())
    assert told not in " ".join(umo(*words).stderr.split())


@pytest.mark.parametrize("address", ["cell.example", "https://cell.example/umo", "ftp://cell.example", "https://", "x"])
def test_a_proxy_is_named_by_its_address(umo: Umo, address: str) -> None:
    assert "is not an address such as" in refused(umo("show", "page", "--proxy", address, "--token", "long enough"))


def test_a_proxy_needs_a_token_that_is_given(umo: Umo) -> None:
    assert "lets other computers in: give a token" in refused(umo("show", "page", "--proxy", "https://cell.example"))


def test_an_address_of_another_computer_is_refused(umo: Umo) -> None:
    assert "cannot listen at 192.0.2.1" in refused(umo("show", "page", "--host", "192.0.2.1", "--token", "long enough"))


def test_without_its_libraries_it_says_what_to_install(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo_command.show.page.find_spec", lambda name: None if name == "uvicorn" else object())
    assert 'pip install ".[page]" in the clone of umo' in refused(umo("show", "page"))


def test_the_address_that_it_prints_opens_the_page_until_ctrl_c() -> None:
    with viewing() as (process, address):
        with urllib.request.urlopen(address, timeout=20) as response:
            assert b"<title>umo</title>" in response.read()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=20)
        assert error == "umo: the page has ended; running stations continue\n"
        assert process.returncode == 0


def test_its_help_names_the_clients(umo: Umo) -> None:
    text = " ".join(umo("show", "page", "--help").stdout.split())
    assert "tabs Scope, Machine, Twin and Operate" in text
    assert "With another address (--host) or a proxy (--proxy) you must give a token" in text


def test_the_examples_show_no_token_to_those_who_list_the_processes(umo: Umo) -> None:
    howto = (ROOT / "docs" / "howto-view-a-running-machine.md").read_text()
    for text in (howto, umo("show", "page", "--help").stdout):
        assert "UMO_TOKEN" in text
        assert re.search(r"umo\s+show\s+page --[^|`]*--(token|password)\b", text) is None


@pytest.mark.full
@pytest.mark.parametrize("number", first(1, [signal.SIGINT, signal.SIGTERM]))
def test_the_file_that_opens_the_browser_goes_when_the_server_ends(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path))
    monkeypatch.setenv("BROWSER", "true")  # the command that does nothing
    file = tmp_path / "page.html"
    with viewing("--open") as (process, address):
        eventually(lambda: file.exists() and address.partition("=")[2] in file.read_text())
        process.send_signal(number)
        _, error = process.communicate(timeout=PATIENCE)
    assert (process.returncode, "Traceback" in error, file.exists()) == (0, False, False)


@pytest.mark.full
def test_with_a_certificate_the_page_is_served_by_tls_only(tmp_path: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("a certificate for the test needs openssl")
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "1",
         "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    with viewing("--certificate", str(certificate), "--key", str(key)) as (_, address):
        assert address.startswith("https://127.0.0.1:")
        trust = ssl.create_default_context(cafile=str(certificate))
        with urllib.request.urlopen(address, timeout=20, context=trust) as response:
            assert b"<title>umo</title>" in response.read()
            assert "Secure" in response.headers["set-cookie"]
        with pytest.raises(OSError):
            urllib.request.urlopen(address.replace("https", "http"), timeout=20)


def test_a_file_that_is_not_a_certificate_is_refused(umo: Umo, tmp_path: Path) -> None:
    file = tmp_path / "a.pem"
    file.write_text("no certificate")
    assert "a.pem" in refused(umo("show", "page", "--port", "0", "--certificate", str(file), "--key", str(file)))


def test_a_station_that_is_none_is_answered_in_a_line_with_those_that_are(umo: Umo) -> None:
    result = umo("show", "page", "ztheat")
    known = "running: none; others: batch, conveyor, furnace, ztheta, or a folder"
    assert result.exit_code == 2
    assert result.stderr == f"umo: there is no station 'ztheat' (did you mean 'ztheta'?); {known}\n"
