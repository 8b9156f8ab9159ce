"""The names for which a certificate was made."""

from __future__ import annotations

import ssl
from pathlib import Path
from typing import Any

NO_CHECK_TIME = 0x200000
"""OpenSSL's flag X509_V_FLAG_NO_CHECK_TIME, which Python does not name."""
NAME_KINDS = ("DNS", "IP Address", "commonName")


def names_in(certificate: Path, key: Path | None = None) -> frozenset[str]:
    """The names and addresses in a certificate (PEM), in small letters; `*.cell.example` stands for one label. Empty
    where they cannot be read. OSError or ssl.SSLError if the files are no certificate and its key.

    Python decodes only certificates that another side has shown, so one is shown here, in memory.
    """
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(certificate, key)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.load_verify_locations(certificate)
    client.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN | NO_CHECK_TIME
    try:
        shown = _shown(server, client)
    except ssl.SSLError:
        return frozenset()
    pairs = [*shown.get("subjectAltName", ()), *(pair for part in shown.get("subject", ()) for pair in part)]
    return frozenset(name.lower() for kind, name in pairs if kind in NAME_KINDS)


def _shown(server: ssl.SSLContext, client: ssl.SSLContext) -> dict[str, Any]:
    """The server's certificate as the client sees it."""
    to_client, to_server = ssl.MemoryBIO(), ssl.MemoryBIO()
    sides = [
        client.wrap_bio(to_client, to_server, server_hostname=None),
        server.wrap_bio(to_server, to_client, server_side=True),
    ]
    for _ in range(3):  # a handshake takes two turns
        for side in sides:
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
    return sides[0].getpeercert() or {}


def covers(name: str, host: str) -> bool:
    """Whether a name of a certificate stands for a host, both in small letters."""
    if not name.startswith("*."):
        return name == host
    return host.partition(".")[2] == name[2:] and not host.startswith(".")
