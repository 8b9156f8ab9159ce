"""The account at the other end of a connection: proved by the kernel, and unknown in all other cases."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from umo.system import peer_account
from umo.system.peer_account import account_of, is_own, peer_uid

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the kernel tells it on Linux only")


@contextmanager
def connected(host: str, client_host: str = "", family: int = socket.AF_INET) -> Iterator[tuple[socket.socket, ...]]:
    with socket.create_server((host, 0), family=family, dualstack_ipv6=host == "::") as server:
        address = (client_host or host, server.getsockname()[1])
        with socket.create_connection(address, 10) as client, server.accept()[0] as accepted:
            yield client, accepted


@pytest.mark.parametrize(
    ("host", "client_host", "family"),
    [("127.0.0.1", "", socket.AF_INET), ("::1", "", socket.AF_INET6), ("::", "127.0.0.1", socket.AF_INET6)],
)
def test_a_process_of_this_user_is_known(host: str, client_host: str, family: int) -> None:
    if family == socket.AF_INET6 and not Path("/proc/net/tcp6").exists():
        pytest.skip("this computer has no IPv6")
    with connected(host, client_host, family) as (client, accepted):
        peer, port = accepted.getpeername()[:2], accepted.getsockname()[1]
        assert peer_uid(peer, port) == os.getuid()
        assert is_own(accepted)
        assert peer_uid(peer, port + 1) is None
        assert peer_uid((peer[0], peer[1] + 1), port) is None
        client.close()
        accepted.recv(1)
        assert not is_own(accepted)  # nobody is there any more


@pytest.mark.parametrize("peer", [("10.1.2.3", 80), ("fe80::1%eth0", 80), ("nobody", 80), ("", 0)])
def test_other_computers_and_what_is_no_address_are_unknown(peer: tuple[str, int]) -> None:
    assert peer_uid(peer, 1) is None


def test_what_two_users_may_be_and_what_the_kernel_does_not_tell_is_unknown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    line = "  0: 0100007F:1F90 {}:0050 01 00000000:00000000 00:00000000 00000000 {} 0 1 1\n"
    monkeypatch.setattr(peer_account, "TABLES", tmp_path)
    assert peer_uid(("127.0.0.1", 8080), 80) is None
    (tmp_path / "tcp").write_text("head\n" + line.format("0100007F", 1000))
    assert peer_uid(("127.0.0.1", 8080), 80) == (1000 if sys.byteorder == "little" else None)
    (tmp_path / "tcp").write_text("head\n" + line.format("0100007F", 1000) + line.format("0200007F", 1001))
    assert peer_uid(("127.0.0.1", 8080), 80) is None


def test_a_connection_that_has_gone_is_not_own() -> None:
    assert not is_own(None)
    with socket.socket() as unconnected:
        assert not is_own(unconnected)


def test_an_account_without_a_name_has_its_number() -> None:
    assert account_of(0) == "root"
    assert account_of(4_000_000_000) == "4000000000"
