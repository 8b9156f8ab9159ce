"""Finds the reason why an address of a fleet cannot be reached, and returns it as text. Zenoh itself only reports a
timeout."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path

from umo.clients.fleet.fleet_identity import CA_FILE, CERTIFICATE_FILE, KEY_FILE

TIME = 1.0
"""Time in s to wait for an answer."""
ALERT_TIME = 0.3
"""Time in s to wait for a server's refusal of the certificate."""


NOBODY_ANSWERS, SILENT = "nothing answers at this address", "the computer does not answer"
"""Reasons that may be temporary."""


def why_not(address: str, certificates: Path | None) -> str:
    """Return the reason why an address, such as `tls/plant.local:7447`, cannot be reached."""
    protocol, _, rest = address.partition("/")
    host, _, port = rest.rpartition(":")
    host = host.strip("[]")
    if protocol == "quic":
        return "the other side does not answer, or refuses the certificate"
    try:
        with socket.create_connection((host, int(port)), TIME) as connection:
            if protocol == "tls" and certificates is not None:
                return _greeted(connection, host, certificates)
            return "the peer does not speak plain tcp; a fleet with certificates uses tls/HOST:PORT"
    except ConnectionRefusedError:
        return NOBODY_ANSWERS
    except socket.gaierror:
        return f"there is no computer {host!r}"
    except TimeoutError:
        return SILENT
    except (OSError, ValueError, OverflowError) as error:
        return str(getattr(error, "strerror", None) or error)


def _greeted(connection: socket.socket, host: str, certificates: Path) -> str:
    """Return the result of a TLS greeting, as text."""
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(certificates / CA_FILE)
        context.load_cert_chain(certificates / CERTIFICATE_FILE, certificates / KEY_FILE)
        with context.wrap_socket(connection, server_hostname=host) as greeted:
            greeted.settimeout(ALERT_TIME)
            greeted.recv(1)
        return "the other side closes the connection"
    except ssl.SSLCertVerificationError as error:
        return f"the certificate of the other side is not accepted: {error.verify_message}"
    except TimeoutError:
        return "the other side answers, but too late"
    except ssl.SSLError as error:
        told = str(error.reason or error).lower().replace("_", " ")
        return f"the other side does not accept the certificate of this computer, or does not speak TLS: {told}"
