"""Brokers with TLS, users and certificates: mosquitto, with which both faces connect, or say in one line why not."""

from __future__ import annotations

import asyncio
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cryptography", reason="certificates are made with cryptography: pip install cryptography")

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from helpers.faced import hosted
from helpers.mqtt import MOSQUITTO, Mosquitto
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.face import Face
from umo.clients.faces.mqtt import home_assistant, sparkplug
from umo.clients.faces.mqtt.broker import Broker
from umo.clients.faces.mqtt.home_assistant import HomeAssistant
from umo.clients.faces.mqtt.sparkplug import Sparkplug
from umo.errors import OptionError

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(MOSQUITTO is None, reason="Debian's package mosquitto is not installed"),
    pytest.mark.skipif(shutil.which("mosquitto_passwd") is None, reason="there is no mosquitto_passwd"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),  # paho leaves sockets to Python
]
DAY = timedelta(days=1)
FACES = {"sparkplug": Sparkplug, "homeassistant": HomeAssistant}


class Authority:
    """Makes certificates; `file` is its own."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._key = folder, ec.generate_private_key(ec.SECP256R1())
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        self.file = folder / f"{name}.pem"
        self.file.write_bytes(self._signed(self._name, self._key, 1, []).public_bytes(Encoding.PEM))

    def _signed(self, subject: x509.Name, key: Any, days: int, names: list[x509.GeneralName]) -> x509.Certificate:
        now = datetime.now(UTC)
        made = (
            x509.CertificateBuilder().subject_name(subject).issuer_name(self._name).public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - 3 * DAY).not_valid_after(now + days * DAY)
            .add_extension(x509.BasicConstraints(ca=not names, path_length=None), critical=True)
        )  # fmt: skip
        if names:
            made = made.add_extension(x509.SubjectAlternativeName(names), critical=False)
        return made.sign(self._key, hashes.SHA256())

    def certificate(self, name: str, days: int = 1, host: str = "localhost") -> Path:
        """A file of a certificate and its key."""
        key, subject = (
            ec.generate_private_key(ec.SECP256R1()),
            x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]),
        )
        signed = self._signed(subject, key, days, [x509.DNSName(host)])
        file = self._folder / f"{name}.pem"
        private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        file.write_bytes(signed.public_bytes(Encoding.PEM) + private)
        return file


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path, "authority")


@pytest.fixture
def brokers(tmp_path: Path) -> Iterator[list[Mosquitto]]:
    made: list[Mosquitto] = []
    yield made
    for each in made:
        each.kill()


def started(brokers: list[Mosquitto], folder: Path, certificate: Path, ca: Path, more: str = "") -> Mosquitto:
    """A broker with TLS that knows the user ann, whose password is right."""
    users = folder / "users"
    users.touch(0o600)
    subprocess.run(["mosquitto_passwd", "-b", str(users), "ann", "right"], check=True, capture_output=True)
    lines = f"allow_anonymous false\npassword_file {users}\nkeyfile {certificate}\ncertfile {certificate}\n"
    brokers.append(Mosquitto(folder, f"{lines}cafile {ca}\n{more}user {Path.home().owner()}\n"))
    return brokers[-1]


def secret(folder: Path, password: str) -> Path:
    file = folder / f"password-{password}"
    file.touch(0o600)
    file.write_text(f"{password}\n")
    return file


def said(face: Face, caplog: pytest.LogCaptureFixture) -> str:
    """What is told when it does not connect: "" if it does."""

    links: list[Broker] = []

    def begin(*given: Any, **more: Any) -> Broker:
        links.append(Broker(*given, **more))
        return links[-1]

    async def work() -> None:
        async with TriedMachine() as machine, hosted(machine, face):
            await until(lambda: caplog.messages or (links and links[-1].is_up))

    with pytest.MonkeyPatch.context() as patch:
        for module in (sparkplug, home_assistant):
            patch.setattr(module, "Broker", begin)
        asyncio.run(work())
    lines = caplog.messages
    assert len(lines) <= 1
    assert not any("\n" in each for each in lines)
    return "".join(lines)


@pytest.mark.parametrize("name", FACES)
def test_a_broker_with_tls_and_a_password(
    name: str, brokers: list[Mosquitto], tmp_path: Path, authority: Authority, caplog: pytest.LogCaptureFixture
) -> None:
    port = started(brokers, tmp_path, authority.certificate("broker"), authority.file).port
    given: dict[str, Any] = {"port": port, "host": "localhost", "ca": authority.file, "user": "ann"}
    make = FACES[name]
    assert said(make(**given, password_file=secret(tmp_path, "right")), caplog) == ""
    text = said(make(**given, password_file=secret(tmp_path, "wrong")), caplog)
    assert text == f"mqtts://localhost:{port} refuses the user ann: Not authorized; umo tries again"
    caplog.clear()
    assert "refuses clients without a user" in said(make(port=port, host="localhost", ca=authority.file), caplog)
    caplog.clear()
    other = Authority(tmp_path, "other").file
    text = said(make(**(given | {"ca": other}), password_file=secret(tmp_path, "right")), caplog)
    assert re.search("cannot be reached: (self-signed certificate|unable to get local issuer)", text), text
    caplog.clear()
    assert "`ca` or `certificate` may be missing" in said(make(port=port, host="localhost"), caplog)


def test_a_broker_with_another_name_or_an_expired_certificate_is_not_spoken_to(
    brokers: list[Mosquitto], tmp_path: Path, authority: Authority, caplog: pytest.LogCaptureFixture
) -> None:
    given: dict[str, Any] = {"host": "localhost", "ca": authority.file, "user": "ann"}
    given["password_file"] = secret(tmp_path, "right")
    for certificate, words in (
        (authority.certificate("elsewhere", host="elsewhere.example"), "Hostname mismatch"),
        (authority.certificate("expired", days=-1), "certificate has expired"),
    ):
        port = started(brokers, tmp_path, certificate, authority.file).port
        assert words in said(Sparkplug(port=port, **given), caplog)
        caplog.clear()


def test_a_broker_that_wants_certificates(
    brokers: list[Mosquitto], tmp_path: Path, authority: Authority, caplog: pytest.LogCaptureFixture
) -> None:
    more = "require_certificate true\n"
    port = started(brokers, tmp_path, authority.certificate("broker"), authority.file, more).port
    given: dict[str, Any] = {"port": port, "host": "localhost", "ca": authority.file, "user": "ann"}
    given["password_file"] = secret(tmp_path, "right")
    assert said(Sparkplug(**given, certificate=authority.certificate("plant")), caplog) == ""
    assert "`certificate` may be missing" in said(Sparkplug(**given), caplog)


def test_no_broker_is_told_once(caplog: pytest.LogCaptureFixture, brokers: list[Mosquitto], tmp_path: Path) -> None:
    brokers.append(Mosquitto(tmp_path))
    brokers[0].kill()
    assert "cannot be reached: Connection refused" in said(HomeAssistant(port=brokers[0].port), caplog)


def test_a_password_that_others_may_read_is_not_taken(tmp_path: Path) -> None:
    file = secret(tmp_path, "right")
    file.chmod(0o640)
    with pytest.raises(OptionError, match="other users can read the file: chmod 600"):
        asyncio.run(Sparkplug(user="ann", password_file=file).open())
    file.chmod(0o600)
    asyncio.run(Sparkplug(user="ann", password_file=file).open())
    file.write_text("\nright\n")
    with pytest.raises(OptionError, match="first line"):
        asyncio.run(Sparkplug(user="ann", password_file=file).open())


def test_files_that_are_no_certificates_are_told_in_a_line(tmp_path: Path, authority: Authority) -> None:
    nonsense = tmp_path / "nonsense.pem"
    nonsense.write_bytes(b"\x00nonsense")
    for given in ({"ca": nonsense}, {"ca": tmp_path / "none"}, {"ca": authority.file, "certificate": nonsense}):
        with pytest.raises(OptionError, match=r"(nonsense\.pem|none): these are not certificates") as told:
            asyncio.run(HomeAssistant(**given).open())  # type: ignore[arg-type]
        assert "\n" not in str(told.value)


def test_a_host_that_no_computer_can_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="not the name of a computer"):
        Sparkplug(host="a..b", ca=tmp_path)
