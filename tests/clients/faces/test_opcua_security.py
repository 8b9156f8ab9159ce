"""Who the face OPC UA lets in: certificates, users, other computers, hostile bytes; what is left when it is killed."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import socket
import struct
import sys
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, ClassVar

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from asyncua import Client, ua
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from helpers.faced import hosted
from helpers.opcua import OpcUaClient, QuickOpcUa, let_in, named
from umo.clients.faces import face_users
from umo.clients.faces.conformance import RefusedByFace, TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.opcua import OpcUa
from umo.clients.faces.opcua import ua_limits as limits
from umo.errors import OptionError, UmoError
from umo.operation.commands.client_commands import Mode

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]
DAY = timedelta(days=1)


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


def certified(folder: Path, name: str, days: int = 1) -> dict[str, str]:
    """A certificate with its key, as OPC UA wants it: the files, and its URI."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    subject, now, uri = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]), datetime.now(UTC), f"urn:umo:{name}"
    names = [x509.UniformResourceIdentifier(uri), x509.DNSName("localhost")]
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject).issuer_name(subject).public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - 3 * DAY).not_valid_after(now + days * DAY)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(
            x509.KeyUsage(
                digital_signature=True, content_commitment=True, key_encipherment=True, data_encipherment=True,
                key_agreement=False, key_cert_sign=False, crl_sign=False, encipher_only=False, decipher_only=False,
            ),
            critical=True,
        )
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]), critical=False
        )
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    public = certificate.public_bytes(Encoding.PEM)
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    files = {each: folder / f"{name}-{each}.pem" for each in ("certificate", "key", "both")}
    for each, data in zip(files, (public, private, public + private), strict=True):
        files[each].write_bytes(data)
    return {each: str(file) for each, file in files.items()} | {"uri": uri, "fingerprint": fingerprint(certificate)}


def fingerprint(certificate: x509.Certificate) -> str:
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()


def own_address() -> str:
    """An address of this computer at which it is another one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this computer has no address but that of the loopback")
        return str(asked.getsockname()[0])


Work = Callable[[TriedMachine, Any], Coroutine[Any, Any, None]]


def run(work: Work, mode: Mode = Mode.AUTOMATIC, **options: Any) -> None:
    async def whole() -> None:
        face = QuickOpcUa(port=0, **options)
        async with TriedMachine(mode) as machine, hosted(machine, face):
            await until(lambda: face._utc)
            await work(machine, face)

    asyncio.run(whole())


async def connected(url: str, user: Any, work: Callable[[OpcUaClient], Coroutine[Any, Any, None]], **more: Any) -> None:
    client = await OpcUaClient.connect(url, user, **more)
    try:
        await work(client)
    finally:
        await client.close()


async def tunes(client: OpcUaClient) -> None:
    await client.tune("cell.gain", 2.0)


# Certificates --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("policy", ["Basic256Sha256", "Aes256_Sha256_RsaPss"])
def test_another_computer_needs_a_certificate_that_is_known_and_a_user_with_a_role(
    tmp_path: Path, policy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.clients.faces.opcua.ua_session.is_own", lambda connection: False)
    server, known, other = (certified(tmp_path, name) for name in ("server", "known", "other"))
    old = certified(tmp_path, "old", days=-1)
    clients = tmp_path / "clients.pem"
    clients.write_text(Path(known["certificate"]).read_text() + Path(old["certificate"]).read_text())
    roles = tmp_path / "config" / "umo" / "roles.toml"

    async def work(machine: TriedMachine, face: Any) -> None:
        url = face.address
        secured = known | {"policy": policy}
        for security, user in (
            (None, named("ann")),  # not secured
            (other | {"policy": policy}, named("ann")),  # not known
            (old | {"policy": policy}, named("ann")),  # not valid any more
            (secured, None),  # nobody
            (secured, {"name": "ann", "password": "wrong"}),
        ):
            with pytest.raises(RefusedByFace):
                await OpcUaClient.connect(url, user, security=security)

        async def refused(client: OpcUaClient) -> None:
            assert (await client.read("cell.level")).value == 10.0
            with pytest.raises(RefusedByFace, match="needs the role tune"):
                await client.tune("cell.gain", 2.0)
            roles.write_text('[users]\nann = "tune"\n')
            await client.tune("cell.gain", 2.0)
            with pytest.raises(RefusedByFace, match="needs the role operate"):
                await client.mode("manual")

        await connected(url, named("ann"), refused, security=secured)
        clients.write_text(Path(old["certificate"]).read_text())
        with pytest.raises(RefusedByFace):  # taken out of the file while the face runs
            await OpcUaClient.connect(url, named("ann"), security=secured)
        assert any(each.who == "ann (quickopcua)" for each in machine.events)

    run(work, host=own_address(), certificate=server["both"], clients=str(clients))


def test_a_user_is_known_by_a_certificate(tmp_path: Path) -> None:
    server, program, carl, eve = (certified(tmp_path, name) for name in ("server", "program", "carl", "eve"))
    with face_users.place().open("a") as file:
        file.write(f'[certificates]\ncarl = "sha256 Fingerprint={carl["fingerprint"]}"\n')

    async def work(machine: TriedMachine, face: Any) -> None:
        user = {name: carl[name] for name in ("certificate", "key")}
        await connected(face.address, user, tunes, security=program)
        assert any(each.who == "carl (quickopcua)" for each in machine.events)
        for wrong in (
            {name: eve[name] for name in ("certificate", "key")},
            {"certificate": carl["certificate"], "key": eve["key"]},  # without carl's key
        ):
            with pytest.raises(RefusedByFace):
                await OpcUaClient.connect(face.address, wrong, security=program)

    run(work, certificate=server["both"])


def test_the_certificate_of_a_program_is_none_of_a_user(tmp_path: Path) -> None:
    """An anonymous session over a channel with carl's certificate is anonymous."""
    server, carl = (certified(tmp_path, name) for name in ("server", "carl"))
    with face_users.place().open("a") as file:
        file.write(f'[certificates]\ncarl = "{carl["fingerprint"]}"\n')

    async def anonymous(client: OpcUaClient) -> None:
        with pytest.raises(RefusedByFace, match="only reads"):
            await client.tune("cell.gain", 2.0)

    async def work(machine: TriedMachine, face: Any) -> None:
        await connected(face.address, None, anonymous, security=carl)

    run(work, certificate=server["both"])


def test_an_address_for_others_needs_certificates() -> None:
    with pytest.raises(OptionError, match="can be reached from other computers"):
        OpcUa(host="0.0.0.0")


@pytest.mark.parametrize("text", ["", "no certificate", "-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----"])
def test_a_file_without_a_certificate_is_told(tmp_path: Path, text: str) -> None:
    file = tmp_path / "file.pem"
    file.write_text(text)
    with pytest.raises(OptionError, match=r"file\.pem"):
        OpcUa(certificate=file)
    with pytest.raises(OptionError, match=r"missing\.pem"):
        OpcUa(certificate=tmp_path / "missing.pem")


def test_a_port_that_is_taken_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        face = QuickOpcUa(port=taken.getsockname()[1])
        with pytest.raises(UmoError, match=r"port \d+: Address already in use"):
            asyncio.run(face.open())


# Hostile bytes -------------------------------------------------------------------------------------------


def message(kind: bytes, body: bytes, size: int | None = None) -> bytes:
    return kind + struct.pack("<I", 8 + len(body) if size is None else size) + body


HELLO = message(b"HELF", struct.pack("<IIIII", 0, 65535, 65535, 0, 0) + struct.pack("<i", -1))
WITHOUT_CHANNEL = message(b"MSGF", struct.pack("<IIII", 0, 0, 1, 1) + b"\x01\x00\xac\x01" + bytes(60))


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\n\r\n" + bytes(100_000),
        message(b"HELF", bytes(100_000), 1 << 31),
        HELLO + message(b"MSGC", bytes(100_000), 1 << 31),
        HELLO + WITHOUT_CHANNEL,
    ],
    ids=["http", "endless", "endless_after_hello", "no_channel"],
)
def test_bytes_that_are_no_opc_ua_end_the_connection_and_nothing_else(sent: bytes) -> None:
    async def work(machine: TriedMachine, face: Any) -> None:
        host, _, port = face.address.rpartition("//")[2].rpartition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(sent)
        try:
            async with asyncio.timeout(15.0):
                while await reader.read(1 << 16):
                    pass
        except ConnectionError:
            pass
        writer.close()
        await connected(face.address, named("ann"), tunes)

    run(work)


# One client against another ------------------------------------------------------------------------------


class Heard:
    """What a client of asyncua hears of one item."""

    def __init__(self) -> None:
        self.values: list[Any] = []

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        self.values.append(value)


def test_a_client_can_change_no_subscription_of_another() -> None:
    async def work(machine: TriedMachine, face: Any) -> None:
        async with Client(face.address) as ann, Client(face.address) as eve:
            heard = Heard()
            mine = await ann.create_subscription(50, heard)
            node = ann.get_node(ua.NodeId("cell.level", await ann.get_namespace_index("urn:umo:plant")))
            item, number = await mine.subscribe_data_change(node), mine.subscription_id
            await until(lambda: heard.values)
            for several in (
                eve.uaclient.set_publishing_mode(ua.SetPublishingModeParameters(False, [number])),
                eve.uaclient.delete_subscriptions([number]),
            ):
                assert [each.name for each in await several] == ["BadSubscriptionIdInvalid"]
            for attack in (
                eve.uaclient.set_monitoring_mode(
                    ua.SetMonitoringModeParameters(number, ua.MonitoringMode.Disabled, [item])
                ),
                eve.nodes.server.call_method("0:GetMonitoredItems", ua.Variant(number, ua.VariantType.UInt32)),
            ):
                with pytest.raises(ua.UaStatusCodeError):
                    await attack
            machine.set("cell.level", 80)
            await until(lambda: heard.values[-1] == 40.0, 5.0)

    run(work)


def test_a_flood_of_refusals_is_few_events() -> None:
    """They would push alarms out of the queues of other clients."""

    class Events:
        told: ClassVar[list[str]] = []

        def event_notification(self, event: Any) -> None:
            self.told.append(event.Message.Text)

    async def work(machine: TriedMachine, face: Any) -> None:
        async with Client(face.address) as ann, Client(face.address) as eve:
            await (await ann.create_subscription(50, Events())).subscribe_events()
            node = eve.get_node(ua.NodeId("tunable:cell.gain", await eve.get_namespace_index("urn:umo:plant")))
            for _ in range(60):
                with pytest.raises(ua.UaStatusCodeError):
                    await node.write_value(2.0)
            machine.set("cell.level", 190)
            await until(lambda: any("too full" in each for each in Events.told))
            refusals = [each for each in Events.told if "only reads" in each]
            assert 1 <= len(refusals) < 30

    run(work)


def test_no_client_gets_a_queue_without_bound() -> None:
    async def work(machine: TriedMachine, face: Any) -> None:
        async with Client(face.address) as ann:
            mine = await ann.create_subscription(50, Heard())
            node = ann.get_node(ua.NodeId("cell.level", await ann.get_namespace_index("urn:umo:plant")))
            item = await mine.subscribe_data_change(node)
            for size, revised in ((0, 1), (1 << 30, limits.MAX_QUEUE)):
                given = ua.MonitoringParameters(QueueSize=size)
                change = ua.MonitoredItemModifyRequest(MonitoredItemId=item, RequestedParameters=given)
                asked = ua.ModifyMonitoredItemsParameters(SubscriptionId=mine.subscription_id, ItemsToModify=[change])
                assert (await ann.uaclient.modify_monitored_items(asked))[0].RevisedQueueSize == revised

    run(work)


def test_sessions_that_a_client_opens_again_and_again_are_not_kept() -> None:
    async def work(machine: TriedMachine, face: Any) -> None:
        client = Client(face.address)
        await client.connect_socket()
        await client.send_hello()
        await client.open_secure_channel()
        for _ in range(20):
            await client.create_session()
        assert len(face.server.iserver._external_sessions) == 1
        client.disconnect_socket()
        await until(lambda: not face.server.iserver._external_sessions, 5.0)

    run(work)


def test_wrong_passwords_leave_the_face_time_for_everybody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    monkeypatch.setattr(face_users, "by_password", lambda *given: order.append("password"))

    async def wrong(address: str) -> None:
        client = Client(address)
        client.set_user("ann")
        client.set_password("wrong")
        with pytest.raises(ua.UaStatusCodeError):
            await client.connect()

    async def work(machine: TriedMachine, face: Any) -> None:
        async def look() -> None:
            while len(order) < 30:
                await asyncio.sleep(limits.LOGIN_PAUSE / 2)
                order.append("look")

        looks = asyncio.create_task(look())
        await asyncio.gather(*(wrong(face.address) for _ in range(5)))
        await looks
        assert all("look" in order[place + 1 : place + 2] for place, each in enumerate(order) if each == "password")

    run(work)


# Kills ---------------------------------------------------------------------------------------------------

SERVE = """
import asyncio, sys
from umo.clients.faces.host import FaceHost
from umo.clients.faces.opcua import OpcUa
face = OpcUa(port=0)
def tell():
    print(face.address, flush=True)
asyncio.run(FaceHost("plant", [("opcua", face)], read_only=False, opened=tell, say=lambda text: None).run())
"""


def test_a_face_that_is_killed_lets_go_and_another_one_takes_its_place() -> None:
    async def started() -> tuple[Any, str]:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", SERVE, stdout=asyncio.subprocess.PIPE, env=dict(os.environ)
        )
        assert process.stdout is not None
        return process, (await process.stdout.readline()).decode().strip()

    async def told(address: str) -> OpcUaClient:
        """A client that sees the machine."""
        while True:
            client = await OpcUaClient.connect(address, named("ann"))
            if "urn:umo:plant" in client.namespaces and (await client.read("cell.level")).value == 10.0:
                return client
            await client.close()

    async def whole() -> None:
        async with TriedMachine(Mode.MANUAL) as machine:
            process, address = await started()
            assert re.fullmatch(r"opc\.tcp://127\.0\.0\.1:\d+", address)
            try:
                client = await told(address)
                await client.write("cell.valve", 5.0)
                await until(lambda: machine.m.cell.valve.read() == 5.0)
            finally:
                process.send_signal(signal.SIGKILL)
                await process.wait()
            await until(lambda: machine.m.cell.valve.read() == 0.0, 10.0)
            await until(lambda: not machine.holder, 10.0)
            with pytest.raises(RefusedByFace):
                await client.read("cell.level")
            await client.kill()
            process, address = await started()
            try:
                client = await told(address)
                await client.write("cell.valve", 5.0)
                await client.close()
            finally:
                process.terminate()
                await process.wait()

    asyncio.run(asyncio.wait_for(whole(), 150.0))
