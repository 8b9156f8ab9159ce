"""The authority of a fleet: a folder with its key, the rules, and a folder for each certificate that it has issued.

    fleet/authority/ca.pem, key.pem     whoever has this key can make any certificate: it stays on one computer
    fleet/rules.toml                    who may do what (`umo.clients.fleet.fleet_rules`)
    fleet/cell7/ca.pem, certificate.pem, key.pem     goes to the computer cell7

Keys are EC P-256. A certificate without a host cannot be a server: it cannot be used to impersonate a router.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from umo.clients.fleet.fleet_identity import CA_FILE, CERTIFICATE_FILE, KEY_FILE, Identity, issued, read_certificate
from umo.clients.fleet.fleet_rules import FILE, KINDS, FleetRules, checked_name, key_of, line_of
from umo.errors import OptionError
from umo.system.folders import replaced

AUTHORITY = "authority"
AUTHORITY_DAYS, DAYS = 20 * 365, 2 * 365
"""Days for which the authority and a certificate are valid."""
THIS_COMPUTER = ("localhost", "127.0.0.1")
"""Hosts in every certificate of a server, so that programs on the same computer reach the server, too."""
HEAD = (
    "# The rules of a fleet, one line for each certificate. Routers, and gateways that listen, read this file at "
    "their start.\n"
)


class Authority:
    """The authority in a folder. Raises OptionError if the folder has none. `now`: the clock for the validity of
    certificates."""

    def __init__(self, folder: Path, now: datetime | None = None) -> None:
        self.folder, self._now = folder, now or datetime.now(UTC)
        if not (folder / AUTHORITY / KEY_FILE).is_file():
            raise OptionError(f"{folder} has no authority; `umo connect certificate authority {folder}` makes it")

    @classmethod
    def create(cls, folder: Path, now: datetime | None = None) -> Authority:
        """Create the authority. Raises OptionError if there is one already."""
        own = folder / AUTHORITY
        if own.exists():
            raise OptionError(f"{own} exists: a new authority would make every certificate of the old one useless")
        now = now or datetime.now(UTC)
        certificate, key = _signed("umo fleet", None, now, AUTHORITY_DAYS)
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / FILE).exists():
            _write(folder / FILE, HEAD.encode())
        _write_folder(own, {CA_FILE: certificate, KEY_FILE: key})
        return cls(folder, now)

    def issue(
        self, kind: str, name: str, hosts: Sequence[str] = (), sites: Sequence[str] = (), days: int = DAYS
    ) -> Path:
        """Issue a certificate, and return its folder. The rule of the certificate is written first, so that no
        certificate is without a rule."""
        target = self.folder / checked_name(name)
        for site in sites:
            checked_name(site)
        if name == AUTHORITY or target.exists():
            raise OptionError(f"{target} exists: umo does not overwrite it; move it, or choose another name")
        if f"{kind}:{name}" in self.rules.withdrawn:
            raise OptionError(f"{kind}:{name} was withdrawn, and its certificate still exists: choose another name")
        hosts = [*dict.fromkeys((*hosts, *THIS_COMPUTER))] if hosts else []
        names = [_host(each) for each in hosts]
        authority = read_certificate(self.folder / AUTHORITY / CA_FILE), self._key()
        certificate, key = _signed(f"{kind}:{name}", authority, self._now, days, names)
        self._add_rule(kind, name, sites)
        ca = (self.folder / AUTHORITY / CA_FILE).read_bytes()
        _write_folder(target, {CA_FILE: ca, CERTIFICATE_FILE: certificate, KEY_FILE: key})
        self._share_rules()
        return target

    def withdraw(self, name: str) -> str:
        """Withdraw the certificate of a name, and return its owner, such as `user:ann`."""
        file = self.folder / FILE
        rules = self.rules
        found = [(kind, name) for kind in KINDS if rules.has(kind, name)]
        if not found:
            raise OptionError(
                f"{file} has no {name!r}; `umo connect certificate list` shows the certificates that were issued"
            )
        old = "|".join(re.escape(key_of(*each)) for each in found)
        kept = [line for line in file.read_text().splitlines(True) if not re.match(rf"\s*({old})\s*=", line)]
        text = "".join([*kept, *(line_of(*each, withdrawn=True) for each in found)])
        FleetRules.parse(text, file)  # one that was written in another form is not spoilt
        _write(file, text.encode())
        self._share_rules()
        return ", ".join(f"{kind}:{name}" for kind, name in found)

    @property
    def rules(self) -> FleetRules:
        return FleetRules.load(self.folder / FILE)

    def issued(self) -> list[tuple[Identity, Path]]:
        """Return every certificate with its folder, by kind and name."""
        found = [(issued(file), file.parent) for file in self.folder.glob(f"*/{CERTIFICATE_FILE}")]
        return sorted(((each, folder) for each, folder in found if each), key=lambda pair: str(pair[0]))

    def _add_rule(self, kind: str, name: str, sites: Sequence[str]) -> None:
        file = self.folder / FILE
        if self.rules.has(kind, name):
            return
        text = file.read_text().rstrip("\n") + "\n" + line_of(kind, name, sites)
        FleetRules.parse(text, file)
        _write(file, text.encode())

    def _share_rules(self) -> None:
        """Copy the rules to the folder of each certificate of a server, so that this folder contains everything that
        the server's computer needs."""
        rules = (self.folder / FILE).read_bytes()
        for identity, folder in self.issued():
            if identity.hosts:
                _write(folder / FILE, rules)

    def _key(self) -> Any:
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        file = self.folder / AUTHORITY / KEY_FILE
        try:
            return load_pem_private_key(file.read_bytes(), None)
        except (ValueError, TypeError):
            raise OptionError(f"{file} is not a key") from None


def _host(host: str) -> Any:
    from cryptography import x509

    try:
        return x509.IPAddress(ip_address(host.strip("[]")))
    except ValueError:
        pass
    try:
        if not host or any(char.isspace() or char in "/:@" for char in host):
            raise ValueError
        return x509.DNSName(host)
    except ValueError:
        raise OptionError(f"{host!r} is not the name or address of a computer") from None


def _signed(
    name: str, authority: tuple[Any, Any] | None, now: datetime, days: int, hosts: Sequence[Any] = ()
) -> tuple[bytes, bytes]:
    """Return a new certificate and its key, as PEM. `authority`: the certificate and the key of the authority, or None
    to make a new authority."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    by, signer = (authority[0].subject, authority[1]) if authority else (subject, key)
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])]
    extensions: list[tuple[Any, bool]] = [
        (x509.BasicConstraints(ca=authority is None, path_length=None if authority else 0), True),
        (x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False),
        (x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), False),
        *([(x509.ExtendedKeyUsage(usages), False)] if authority else []),
        *([(x509.SubjectAlternativeName(hosts), False)] if hosts else []),
    ]
    builder = x509.CertificateBuilder(by, subject, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=days))
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    pem = serialization.Encoding.PEM
    form, open_key = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    return builder.sign(signer, hashes.SHA256()).public_bytes(pem), key.private_bytes(pem, form, open_key)


def _write_folder(target: Path, files: dict[str, bytes]) -> None:
    """Write all files or none. Only the owner can read a key."""
    new = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    new.mkdir(mode=0o700)
    try:
        for name, data in files.items():
            mode = 0o600 if name == KEY_FILE else 0o644
            with open(os.open(new / name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode), "wb") as stream:
                stream.write(data)
        new.rename(target)
    except BaseException:
        shutil.rmtree(new, ignore_errors=True)
        raise


def _write(file: Path, data: bytes) -> None:
    """Write a file so that it always contains either all of the old data or all of the new data."""
    with replaced(file) as new:
        new.write_bytes(data)
