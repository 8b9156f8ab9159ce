"""The certificates of the OPC UA server and of the programs that may connect."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from asyncua import Server, ua
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key

from umo.clients.faces.endpoint import Endpoint, is_local
from umo.errors import OptionError

SECURED = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)
KEY = re.compile(rb"-----BEGIN (?:RSA )?PRIVATE KEY-----.+?-----END (?:RSA )?PRIVATE KEY-----", re.DOTALL)


class Security:
    """The certificates in the options of the face. Raises OptionError if a file has none.

    Other computers reach secured endpoints only. Programs of this computer may also connect without security, because
    nothing else can read what they send."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.only_secured = not is_local(endpoint.host)
        self._server = None if endpoint.certificate is None else _pair(endpoint.certificate)
        self._clients = endpoint.clients
        if self._clients is not None:
            _certificates(self._clients)

    def is_trusted(self, der: bytes) -> bool:
        """True if a program with this certificate may connect. The certificate must be in the present content of the
        file `clients`, and valid now. If the file cannot be read, no program may connect. Without `clients` any program
        of this computer may connect."""
        if self._clients is None:
            return True
        try:
            certificates = _certificates(self._clients)
        except OptionError:
            return False
        known = next((each for each in certificates if each.public_bytes(Encoding.DER) == der), None)
        return known is not None and known.not_valid_before_utc <= datetime.now(UTC) <= known.not_valid_after_utc

    def uri(self, station: str) -> str:
        """Return the ApplicationUri. OPC UA requires it to be the one in the certificate."""
        if self._server is not None:
            try:
                names = self._server[0].extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            except x509.ExtensionNotFound:
                return station
            return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), station)
        return station

    def apply(self, server: Server) -> None:
        policies = [] if self.only_secured else [ua.SecurityPolicyType.NoSecurity]
        if self._server is not None:
            server.iserver.certificate, server.iserver.private_key = self._server
            policies += SECURED
        server.set_security_policy(policies)
        tokens: list[type] = [ua.UserNameIdentityToken]
        if not self.only_secured:
            tokens.insert(0, ua.AnonymousIdentityToken)
        if self._server is not None:
            tokens.append(ua.X509IdentityToken)
        server.set_identity_tokens(tokens)


def _pair(file: Path) -> tuple[x509.Certificate, object]:
    """Return the certificate and the key in a PEM file."""
    try:
        data = file.read_bytes()
        found = KEY.search(data)
        if found is None:
            raise OptionError(f"{file}: the file has no private key; it must have the certificate and its key (PEM)")
        return x509.load_pem_x509_certificate(data), load_pem_private_key(found[0], None)
    except (OSError, ValueError, TypeError) as error:
        raise OptionError(f"{file}: the file is not a certificate with its key ({error})") from None


def _certificates(file: Path) -> list[x509.Certificate]:
    try:
        return x509.load_pem_x509_certificates(file.read_bytes())
    except (OSError, ValueError) as error:
        raise OptionError(f"{file}: these are not certificates ({error})") from None
