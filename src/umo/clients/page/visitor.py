"""Identifies the visitor of a page: by which token and from where the visitor came, and whether it is the user who
serves the page.

Two things together prove that the visitor is this user: the token that only this user can read, and a connection from a
process of this user on this computer, as the kernel reports (`umo.system.peer_account`). Through a proxy this is never
proved."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.types import Scope

from umo.clients.page.unauthenticated import HttpConnection
from umo.system.peer_account import is_own
from umo.text import printable

FORWARDED = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip", "via")
"""Headers by which a proxy shows that it forwards a request."""
MAX_ADDRESS = 39
"""Largest number of characters of an address that a proxy reports: the length of the longest IPv6 address."""


@dataclass(frozen=True)
class Visitor:
    """A visitor. `address`: the address of the visitor's computer, if known."""

    address: str
    is_owner: bool = False
    """True if it is proved that the visitor is the user who serves the page."""


class PageToken:
    """A token that opens the page. `is_own`: only this user can read it."""

    def __init__(self, text: str, is_own: bool) -> None:
        self.is_own = is_own
        self._text = text.encode()
        key = hashlib.scrypt(self._text, salt=b"umo page", n=2**14, r=8, p=1)
        self.session = hmac.new(key, b"session", "sha256").hexdigest()
        """The value of the cookie, which is valid as long as the token, also after a restart of the server."""

    def is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(errors="replace"), self._text)

    def is_cookie(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.session.encode())


def connection_of(scope: Scope) -> HttpConnection | None:
    """Return the connection of a request, or None if another server handles it."""
    visit = scope.get("state", {}).get("visit")
    return visit if isinstance(visit, HttpConnection) else None


async def visitor_of(scope: Scope, token: PageToken, is_proxied: bool) -> Visitor:
    """Return the visitor with this token. `is_proxied`: True if every request comes through a proxy that is trusted to
    report addresses."""
    headers, peer = Headers(scope=scope), str((scope.get("client") or ("unknown",))[0])
    if is_proxied:
        return Visitor(_told_address(headers) or f"a proxy at {peer}")
    if any(name in headers for name in FORWARDED):
        return Visitor(f"a proxy at {peer}")
    connection = connection_of(scope)
    if connection is None or not token.is_own:
        return Visitor(peer)
    return Visitor(peer, await asyncio.to_thread(is_own, connection.peer_socket))


def _told_address(headers: Headers) -> str:
    """Return the last address in the headers of proxies, which the nearest proxy has added. Return "" if there is no
    address. Return "" also if the two headers differ, because the visitor may have sent one of them."""
    elements = ",".join(headers.getlist("forwarded")).rpartition(",")[2].split(";")
    pairs = (element.partition("=") for element in elements)
    told = {
        ",".join(headers.getlist("x-forwarded-for")).rpartition(",")[2],
        next((value for name, _, value in pairs if name.strip().lower() == "for"), ""),
    }
    addresses = {address.strip().strip('"') for address in told} - {""}
    if len(addresses) != 1:
        return ""
    return printable(addresses.pop().encode("ascii", "replace").decode())[:MAX_ADDRESS]
