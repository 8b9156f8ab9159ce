"""Controls the access to the page by the token, by the Host and Origin headers, and by headers that restrict the
browser.

The token comes with the address (`/?token=...`) or from the form; afterwards a cookie replaces it. There are two
tokens: one for this user, and an optional one for other visitors (`umo.clients.page.visitor`). Host must be a name of
this computer, a name in its certificate, or the name of the proxy. A name of another site that points to this computer
is refused. Origin must be that of the page. Another site may open the page, but may not send requests in the
background, so it cannot try tokens.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
import socket
import ssl
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from umo.clients.faces.endpoint import is_local
from umo.clients.page.visitor import PageToken, connection_of, visitor_of
from umo.system.folders import written

REFUSAL_TIME = 0.5
"""Time in s after which a wrong token is answered."""
MAX_JUDGED = 8
"""Number of tokens that are checked simultaneously. Further ones wait in a queue, even the right one, so that guessing
stays slow. The queue is short, because only few connections without the token are accepted
(`umo.clients.page.unauthenticated`), and no request in the queue is refused."""
MAX_FORM_BYTES = 4096
"""Largest number of bytes of a form."""
FORM_TIMEOUT = 5.0
"""Time in s within which a form must arrive."""
POLICY = (
    "default-src 'self'; script-src 'self' {scripts}; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
"""Content-Security-Policy: the page loads everything from this server."""
LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
NO_CHECK_TIME = 0x200000
"""OpenSSL's flag X509_V_FLAG_NO_CHECK_TIME, which Python does not name."""
NAME_KINDS = ("DNS", "IP Address", "commonName")


def new_token(file: Path) -> str:
    """Return the token of this user's pages. It is kept, until the computer restarts, in a file that only the user can
    read, so that an open page can reconnect after a restart of the server."""
    with suppress(OSError, ValueError):
        kept = file.read_text().strip()
        if len(kept) >= 32 and file.stat().st_mode & 0o077 == 0:
            return kept
    token = secrets.token_urlsafe(32)
    with suppress(OSError), written(file, 0o600) as stream:  # else it is for this server only
        stream.write(token.encode())
    return token


class AccessControl:
    """An ASGI application that wraps another one. Requests without the token do not reach it."""

    def __init__(
        self,
        app: ASGIApp,
        tokens: Sequence[PageToken],
        host: str,
        port: int,
        scripts: str,
        certified: frozenset[str] | None = None,
        proxy: str = "",
    ) -> None:
        """`certified`: the names in the certificate, or None if there is no certificate and therefore no TLS. `proxy`:
        the address (origin) at which a proxy serves the page, or "" if there is no proxy. With a proxy every request
        comes through it."""
        self._app = app
        self._tokens, self._proxy = tokens, proxy.lower()
        self._cookie = f"umo-{port}"  # cookies do not know ports
        self._secure = certified is not None or self._proxy.startswith("https:")
        self._certified = certified or frozenset()
        self._everywhere = not is_local(host)
        self._names = {*LOCAL_NAMES, host.lower(), *((socket.gethostname().lower(),) if self._everywhere else ())}
        if self._proxy:
            self._names.add(urlsplit(self._proxy).hostname or "")
        self._policy = POLICY.format(scripts=scripts)
        self._line = asyncio.Semaphore(MAX_JUDGED)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        answer = await self._refusal(scope, receive)
        if answer is None:
            if (visit := connection_of(scope)) is not None:
                visit.welcome()
            await self._app(scope, receive, self._with_headers(scope, send))
        elif scope["type"] == "websocket":
            await _refuse_page(answer.status_code, receive, send)
        else:
            await answer(scope, receive, self._with_headers(scope, send))

    async def _refusal(self, scope: Scope, receive: Receive) -> Response | None:
        """Return the refusal of a request, or None if it may pass."""
        headers = Headers(scope=scope)
        if not self._is_our_host(headers.get("host", "")):
            return PlainTextResponse("the Host header names another computer\n", 403)
        own = self._proxy or f"http{'s' if self._secure else ''}://{headers.get('host', '')}"
        if headers.get("origin", own).lower() != own.lower():
            return PlainTextResponse("the Origin header names another site\n", 403)
        if _is_behind_another_site(headers):
            return PlainTextResponse("the request comes from another site\n", 403)
        cookie = cookie_parser(headers.get("cookie", "")).get(self._cookie, "")
        shown = next((each for each in self._tokens if each.is_cookie(cookie)), None)
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token")
        if shown is not None and (given is None or shown.is_own or not self._is_own_token(given[0])):
            await self._admit(scope, shown)
            return None
        if scope["type"] == "http" and scope["path"] == "/login" and scope["method"] == "POST":
            return await self._login(scope, receive)
        if given is None:
            return self._ask(headers, again=False)
        token = await self._judge(scope, given[0])
        if token is None:
            return self._ask(headers, again=True)
        await self._admit(scope, token, is_new=scope["type"] == "http" and scope["path"] == "/")
        return None

    def _is_own_token(self, given: str) -> bool:
        """True if this is the token of this user. A page that was opened with the other token can present it later."""
        return any(each.is_own and each.is_token(given) for each in self._tokens)

    async def _admit(self, scope: Scope, token: PageToken, is_new: bool = False) -> None:
        """Store in `scope` the visitor, for the commands of a page, and the cookie that a new visitor gets."""
        noted: dict[str, Any] = {"cookie": token.session} if is_new else {}
        if scope["type"] == "websocket":
            noted["visitor"] = await visitor_of(scope, token, bool(self._proxy))
        scope["state"] = {**scope.get("state", {}), **noted}

    def _is_our_host(self, text: str) -> bool:
        """True if a Host header names this server, or is an IP address of it. No name of another site is an IP
        address."""
        name = text[1 : text.find("]")] if text.startswith("[") else text.partition(":")[0]
        name = name.lower().rstrip(".")
        if name in self._names or any(covers(known, name) for known in self._certified):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._everywhere or address.is_loopback

    async def _judge(self, scope: Scope, given: str) -> PageToken | None:
        """Return the token that was given. For a wrong token, return None after `REFUSAL_TIME` s. Until then it
        occupies one of the `MAX_JUDGED` places."""
        visit = connection_of(scope)
        async with self._line:
            if visit is not None and visit.over:  # it does not wait for the answer: then there is none
                return None
            found = [each for each in self._tokens if each.is_token(given)]
            if found:
                return found[0]
            await asyncio.sleep(REFUSAL_TIME)
        return None

    async def _login(self, scope: Scope, receive: Receive) -> Response:
        try:
            async with asyncio.timeout(FORM_TIMEOUT):
                form = await _body(receive)
        except TimeoutError:
            return PlainTextResponse("the form did not arrive in time\n", 408)
        given = parse_qs(form.decode("latin-1"), encoding="utf-8").get("token", [""])[0]
        token = await self._judge(scope, given)
        if token is None:
            return self._form(again=True)
        response = RedirectResponse("/", 303)
        response.headers["set-cookie"] = self._set_cookie(token.session)
        return response

    def _ask(self, headers: Headers, again: bool) -> Response:
        if "text/html" in headers.get("accept", ""):
            return self._form(again)
        return PlainTextResponse("open the address that `umo show page` printed: it contains the token\n", 401)

    @staticmethod
    def _form(again: bool) -> Response:
        return HTMLResponse(FORM.replace("{again}", "The token is wrong." if again else ""), 401)

    def _set_cookie(self, session: str) -> str:
        secure = "; Secure" if self._secure else ""
        return f"{self._cookie}={session}; HttpOnly; SameSite=Strict; Path=/{secure}"

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        async def wrapped(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["content-security-policy"] = self._policy
                headers["x-content-type-options"] = "nosniff"
                headers["referrer-policy"] = "no-referrer"
                headers["cross-origin-resource-policy"] = "same-origin"
                headers["cross-origin-opener-policy"] = "same-origin"
                headers.setdefault("cache-control", "no-cache")
                if (session := scope.get("state", {}).get("cookie")) is not None:
                    headers["set-cookie"] = self._set_cookie(session)
            await send(message)

        return wrapped


def _is_behind_another_site(headers: Headers) -> bool:
    """True if a page of another site makes the browser send this request in the background. Browsers report that in the
    headers of Fetch Metadata, if they use TLS or an address of this computer."""
    if headers.get("sec-fetch-site", "none") in ("none", "same-origin"):
        return False
    return (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) != ("navigate", "document")


async def _refuse_page(status: int, receive: Receive, send: Send) -> None:
    """Refuse the websocket of a page. With the status 401 it is accepted first, because a browser passes the code of
    the closing to the page only then. Other refusals send no code."""
    await receive()  # websocket.connect
    if status == 401:
        await send({"type": "websocket.accept"})
    await send({"type": "websocket.close", "code": 4000 + status})


async def _body(receive: Receive) -> bytes:
    """Return the beginning of a request's body, which contains a whole form."""
    body, more = b"", True
    while more and len(body) < MAX_FORM_BYTES:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
    return body


FORM = """<!doctype html><html lang="en"><meta charset="utf-8"><title>umo</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<h1>umo</h1><p>{again}</p>
<form method="post" action="/login"><label>Token or password: <input name="token" type="password" autofocus></label>
<button>Open</button></form>
<p>The address that <code>umo show page</code> printed contains the token.</p></html>
"""


def names_in(certificate: Path, key: Path | None = None) -> frozenset[str]:
    """Return the names and addresses in a certificate (PEM), in small letters. The `*` in `*.cell.example` stands for
    one label. The result is empty if the names cannot be read. Raises OSError or ssl.SSLError if the files are not a
    certificate and its key.

    Python decodes only certificates that the other end of a connection has presented. The certificate is therefore
    presented over a connection in memory.
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
    """Return the server's certificate as the client sees it."""
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
    """True if a name in a certificate covers a host. Both are in small letters."""
    if not name.startswith("*."):
        return name == host
    return host.partition(".")[2] == name[2:] and not host.startswith(".")
