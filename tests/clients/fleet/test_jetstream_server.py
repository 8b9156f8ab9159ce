"""How a JetStream is reached: its address, certificates, user, credentials; and what it is told of names."""

from __future__ import annotations

import asyncio
import base64
import binascii
import json
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")
pytest.importorskip("nats", reason="the extra fleet-jetstream is not installed")

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from helpers.jetstreams import NatsServer, needs_server
from umo.clients.fleet.fleet_certificates import Authority
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_settings import JetStreamTable
from umo.clients.fleet.jetstream_server import AWAY, STREAM, JetStreamServer, key_and_kind, load, matcher, subject
from umo.errors import OptionError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a fleet needs Linux")
USER, OPERATOR, ACCOUNT, SEED = 20 << 3, 14 << 3, 0, 18 << 3
"""Kinds of keys of a nats-server."""


def secret(file: Path, text: str) -> Path:
    file.write_text(text)
    file.chmod(0o600)
    return file


async def reached(server: JetStreamServer) -> int:
    async with server.connected() as (_, js):
        return int((await js.stream_info(STREAM)).state.last_seq)


def test_a_name_with_dots_is_one_word_of_a_subject() -> None:
    key = StationKey("plant.local", "press.1234")
    assert subject(*key, "delta") == "umo.plant~local.press~1234.delta"
    assert key_and_kind(subject(*key, "delta")) == (key, "delta")


def test_stations_are_matched_by_the_patterns_of_the_command() -> None:
    wanted = matcher(["cell7/*", "*/press*"])
    found = [wanted(StationKey(*each)) for each in (("cell7", "a"), ("c", "press.1"), ("c", "a"))]
    assert found == [True, True, False]


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("plant.local", "'plant.local' is not a JetStream; write nats://HOST:4222, or tls://HOST:4222"),
        ("http://plant:4222", "is not a JetStream"),
        ("nats://plant:port", "is not a JetStream"),
        ("nats://ann:secret@plant:4222", "a password on a command line"),
        ("http://ann:secret@plant:4222", "'http://...@plant:4222' is not a JetStream"),
        ("tls://plant:4222", "needs the folder of certificates"),
    ],
)
def test_a_wrong_address_is_told_without_its_password(url: str, told: str) -> None:
    with pytest.raises(OptionError) as error:
        load(url, None, JetStreamTable(), {})
    assert told in str(error.value)
    assert "secret" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (JetStreamTable(user="ann"), "both a user and a password"),
        (JetStreamTable("ann", "/none"), "/none cannot be read: No such file"),
        (JetStreamTable("ann", "/none", "/none"), "/none cannot be read: No such file"),
    ],
)
def test_a_mistake_in_the_settings_is_told(given: JetStreamTable, told: str) -> None:
    with pytest.raises(OptionError) as error:
        load("nats://127.0.0.1:4222", None, given, {})
    assert told in str(error.value)


def test_a_password_that_others_may_read_is_not_used(tmp_path: Path) -> None:
    file = secret(tmp_path / "password", "secret\n")
    file.chmod(0o644)
    with pytest.raises(OptionError, match="other users can read the file"):
        load("nats://127.0.0.1:4222", None, JetStreamTable("ann", str(file)), {})


def test_a_password_goes_to_another_computer_by_tls_only() -> None:
    environ = {"UMO_JETSTREAM_USER": "ann", "UMO_JETSTREAM_PASSWORD": "secret"}
    with pytest.raises(OptionError, match="write tls://"):
        load("nats://plant.local:4222", None, JetStreamTable(), environ)
    load("nats://127.0.0.1:4222", None, JetStreamTable(), environ)


@needs_server
@pytest.mark.full
def test_a_user_is_known_by_its_password(tmp_path: Path) -> None:
    server = NatsServer(tmp_path / "nats", 'authorization { user: "ann", password: "right" }')
    server.begin()
    try:
        file = secret(tmp_path / "password", "right\n")
        assert asyncio.run(reached(load(server.url, None, JetStreamTable("ann", str(file)), {}))) == 0
        environ = {"UMO_JETSTREAM_USER": "ann", "UMO_JETSTREAM_PASSWORD": "wrong"}
        for given in ({}, environ):
            with pytest.raises(AWAY):
                asyncio.run(reached(load(server.url, None, JetStreamTable(), given)))
    finally:
        server.kill()


@needs_server
@pytest.mark.full
def test_both_ends_are_known_by_the_certificates_of_the_fleet(tmp_path: Path) -> None:
    authority, other = Authority.create(tmp_path / "fleet"), Authority.create(tmp_path / "other")
    authority.issue("router", "plant", ["127.0.0.1"])
    authority.issue("site", "cell7")
    other.issue("site", "cell7")
    mine = tmp_path / "fleet/plant"
    server = NatsServer(
        tmp_path / "nats",
        f'tls {{ cert_file: "{mine}/certificate.pem", key_file: "{mine}/key.pem", ca_file: "{mine}/ca.pem", '
        "verify: true }",
    )
    server.begin()
    try:
        url = server.url.replace("nats:", "tls:")
        assert asyncio.run(reached(JetStreamServer(url, tmp_path / "fleet/cell7"))) == 0
        for wrong in (JetStreamServer(url, tmp_path / "other/cell7"), JetStreamServer(server.url)):
            with pytest.raises(AWAY):
                asyncio.run(reached(wrong))
    finally:
        server.kill()


@needs_server
@pytest.mark.full
def test_tls_does_not_become_plain_where_the_server_has_none(tmp_path: Path) -> None:
    authority = Authority.create(tmp_path / "fleet")
    authority.issue("site", "cell7")
    server = NatsServer(tmp_path / "nats", "trace: true, debug: true")
    server.begin()
    try:
        with pytest.raises(AWAY):
            asyncio.run(reached(JetStreamServer(server.url.replace("nats:", "tls:"), tmp_path / "fleet/cell7")))
        assert "umo connect" not in server.log  # the name that it tells, with its user
    finally:
        server.kill()


class Key:
    """A key of a nats-server, whose users are signed."""

    def __init__(self, kind: int) -> None:
        self._kind, self.private = kind, Ed25519PrivateKey.generate()

    @property
    def public(self) -> str:
        return self._text(bytes([self._kind]) + self.private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw))

    @property
    def seed(self) -> str:
        first = bytes([SEED | self._kind >> 5, (self._kind & 31) << 3])
        return self._text(first + self.private.private_bytes_raw())

    @staticmethod
    def _text(data: bytes) -> str:
        return base64.b32encode(data + binascii.crc_hqx(data, 0).to_bytes(2, "little")).decode().rstrip("=")

    def sign(self, name: str, subject: str, nats: dict[str, Any]) -> str:
        claims = {
            "jti": name,
            "iat": 1,
            "iss": self.public,
            "name": name,
            "sub": subject,
            "nats": nats | {"version": 2},
        }
        parts = [_base64(json.dumps(each).encode()) for each in ({"typ": "JWT", "alg": "ed25519-nkey"}, claims)]
        text = ".".join(parts)
        return f"{text}.{_base64(self.private.sign(text.encode()))}"


def _base64(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def credentials(token: str, seed: str) -> str:
    return (
        f"-----BEGIN NATS USER JWT-----\n{token}\n------END NATS USER JWT------\n\n"
        f"-----BEGIN USER NKEY SEED-----\n{seed}\n------END USER NKEY SEED------\n"
    )


@needs_server
@pytest.mark.full
def test_a_user_is_known_by_a_file_of_credentials(tmp_path: Path) -> None:
    operator, account, system, user, stranger = (Key(each) for each in (OPERATOR, ACCOUNT, ACCOUNT, USER, USER))
    unlimited = dict.fromkeys(("subs", "data", "payload", "imports", "exports", "conn", "leaf", "mem_storage",
                               "disk_storage", "streams", "consumer"), -1) | {"wildcards": True}  # fmt: skip
    limits = {"type": "account", "limits": unlimited}
    server = NatsServer(
        tmp_path / "nats",
        f"operator: {operator.sign('umo', operator.public, {'type': 'operator'})}\n"
        f"resolver: MEMORY\nsystem_account: {system.public}\n"
        f"resolver_preload: {{ {account.public}: {operator.sign('plant', account.public, limits)}, "
        f"{system.public}: {operator.sign('system', system.public, {'type': 'account'})} }}",
    )
    server.begin()
    try:
        token = account.sign("cell7", user.public, {"type": "user", "subs": -1, "data": -1, "payload": -1})
        mine = secret(tmp_path / "me.creds", credentials(token, user.seed))
        assert asyncio.run(reached(load(server.url, None, JetStreamTable(credentials=str(mine)), {}))) == 0
        forged = secret(tmp_path / "forged.creds", credentials(token, stranger.seed))
        with pytest.raises(AWAY):
            asyncio.run(reached(load(server.url, None, JetStreamTable(), {"UMO_JETSTREAM_CREDENTIALS": str(forged)})))
    finally:
        server.kill()


def test_a_damaged_file_of_credentials_is_told(tmp_path: Path) -> None:
    seed = Key(USER).seed
    damaged = seed[:20] + ("B" if seed[20] != "B" else "C") + seed[21:]
    for given, told in (("SUAAA", "is not a file of credentials"), (damaged, "is damaged")):
        file = secret(tmp_path / "me.creds", credentials("a.b.c", given))
        with pytest.raises(OptionError, match=told):
            load("nats://h:4222", None, JetStreamTable(credentials=str(file)), {})
