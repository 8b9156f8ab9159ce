"""Who may see the page: token, cookie, Host, Origin; what the browser is bound to."""

from __future__ import annotations

import select
import shutil
import socket
import ssl
import stat
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from umo.clients.page import access_control, server, unauthenticated
from umo.clients.page.access_control import new_token

from .conftest import PATIENCE, TOKEN, Served, eventually, opened, running, serving


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("UMO_FRAMES", str(tmp_path_factory.mktemp("frames")))
        patch.setenv("UMO_STATE", str(tmp_path_factory.mktemp("state")))
        patch.setattr(access_control, "REFUSAL_TIME", 0.01)
        with serving() as served:
            yield served


def ask(served: Served, path: str, method: str = "GET", body: str | None = None, **headers: str) -> Any:
    connection = HTTPConnection("127.0.0.1", served.port, timeout=20)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        response = connection.getresponse()
        response.text = response.read().decode(errors="replace")  # type: ignore[attr-defined]
        return response
    finally:
        connection.close()


PATHS = ("/", "/static/app.js", "/static/style.css", "/twin/ztheta", "/ws", "/static/../server.py")


@pytest.mark.parametrize("path", PATHS)
def test_nothing_is_served_without_the_token(served: Served, path: str) -> None:
    assert ask(served, path).status == 401


@pytest.mark.parametrize(
    "path", ["/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py", "/static/"]
)
def test_nothing_but_the_files_of_the_page_is_served(served: Served, path: str) -> None:
    assert ask(served, path, Cookie=cookie_of(served).partition(";")[0]).status == 404


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1], "\u00e4", "%ff"])
def test_a_wrong_token_is_refused(served: Served, token: str) -> None:
    assert ask(served, f"/?token={quote(token)}").status == 401


def cookie_of(served: Served) -> str:
    response = ask(served, served.url.removeprefix(served.origin))
    assert response.status == 200
    return str(response.getheader("set-cookie"))


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(served: Served) -> None:
    cookie = cookie_of(served)
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert TOKEN not in cookie
    assert ask(served, "/static/app.js", Cookie=cookie.partition(";")[0]).status == 200
    assert ask(served, "/static/app.js", Cookie=cookie.partition(";")[0][:-1]).status == 401


@pytest.mark.parametrize("other", ['prefs={"a":1}', "x=a b", "alone", "=", '"'])
def test_cookies_of_other_servers_of_this_computer_do_not_matter(served: Served, other: str) -> None:
    cookie = cookie_of(served).partition(";")[0]
    assert ask(served, "/", Cookie=f"{other}; {cookie}").status == 200
    assert ask(served, "/", Cookie=f"{cookie}; {other}").status == 200
    assert ask(served, "/", Cookie=other).status == 401


def test_the_form_gives_the_cookie_for_the_token(served: Served) -> None:
    body = f"token={TOKEN.replace(' ', '+')}"
    assert ask(served, "/login", "POST", "token=wrong").status == 401
    response = ask(served, "/login", "POST", body, Origin=served.origin)
    assert (response.status, response.getheader("location")) == (303, "/")
    assert "HttpOnly" in response.getheader("set-cookie")
    assert ask(served, "/login", "POST", body, Origin="http://evil.example").status == 403


def test_many_wrong_tokens_at_once_delay_the_right_one_and_do_not_lock_it_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_control, "REFUSAL_TIME", 0.05)
    with serving() as served, ExitStack() as open_ones:
        number = 6 * access_control.MAX_JUDGED
        asking = [HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE) for _ in range(number)]
        for connection in asking:
            open_ones.callback(connection.close)
            connection.request("GET", "/?token=wrong")
        assert ask(served, served.url.removeprefix(served.origin)).status == 200
        assert ask(served, "/login", "POST", f"token={quote(TOKEN)}").status == 303
        assert {connection.getresponse().status for connection in asking} == {401}


def test_guesses_are_judged_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_control, "REFUSAL_TIME", PATIENCE)
    with serving() as served, ExitStack() as open_ones:
        cookie = cookie_of(served).partition(";")[0]
        number = access_control.MAX_JUDGED + 1
        asking = [HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE) for _ in range(number)]
        for connection in asking[:-1]:
            open_ones.callback(connection.close)
            connection.request("GET", "/?token=wrong")
        assert ask(served, "/", Cookie=cookie).status == 200  # these have arrived before
        open_ones.callback(asking[-1].close)
        asking[-1].request("GET", served.url.removeprefix(served.origin))
        assert ask(served, "/", Cookie=cookie).status == 200  # whoever has the cookie does not wait in line
        assert select.select([asking[-1].sock], [], [], 0.0)[0] == []


def test_guesses_whose_asker_has_gone_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_control, "REFUSAL_TIME", 0.3)
    with serving() as served:
        for _ in range(100 * access_control.MAX_JUDGED):
            connection = HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE)
            connection.request("GET", "/?token=wrong")
            connection.close()
        eventually(
            lambda: ask(served, served.url.removeprefix(served.origin)).status == 200
        )  # not after 100 times 0.3 s


@pytest.mark.parametrize(("mode", "dest"), [("no-cors", "image"), ("cors", "empty"), ("navigate", "iframe")])
def test_another_site_cannot_try_tokens_in_the_background(served: Served, mode: str, dest: str) -> None:
    told = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": mode, "Sec_Fetch_Dest": dest}
    for path in (served.url.removeprefix(served.origin), "/?token=wrong"):
        assert ask(served, path, **told).status == 403
    followed = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "document"}
    assert ask(served, served.url.removeprefix(served.origin), **followed).status == 200  # a link to the page


def test_a_form_that_does_not_come_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_control, "FORM_TIMEOUT", 0.05)
    with serving() as served:
        assert ask(served, "/login", "POST", None, Content_Length="20").status == 408


def test_the_number_of_connections_that_have_the_token_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 3 - unauthenticated.MAX_STRANGERS)
    with serving() as served, ExitStack() as idle:
        for _ in range(3):
            idle.enter_context(socket.create_connection(("127.0.0.1", served.port), PATIENCE))
        eventually(lambda: ask(served, served.url.removeprefix(served.origin)).status == 503)


def halves(served: Served, count: int, all_of_them: ExitStack) -> list[socket.socket]:
    """Connections that begin a request, and do not go on."""
    made = []
    for _ in range(count):
        made.append(all_of_them.enter_context(socket.create_connection(("127.0.0.1", served.port), PATIENCE)))
        made[-1].sendall(b"GET / HTTP/1.1\r\nHost: local")
    return made


def test_half_requests_without_the_token_do_not_shut_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unauthenticated, "TOKEN_TIMEOUT", PATIENCE * 3)
    with running(), serving() as served, ExitStack() as open_ones:
        cookie = cookie_of(served).partition(";")[0]
        with opened(served.socket) as before:
            half = halves(served, 600, open_ones)
            assert ask(served, "/", Cookie=cookie).status == 200
            with opened(served.socket.partition("?")[0], additional_headers={"Cookie": cookie}) as again:
                again.get("description")
            before.get("state")
            with suppress(ConnectionResetError):
                assert half[0].recv(1) == b""  # the oldest was cut off
            half[-1].sendall(f"host\r\nCookie: {cookie}\r\n\r\n".encode())
            assert half[-1].recv(12) == b"HTTP/1.1 200"


def test_the_address_that_has_the_most_makes_room_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unauthenticated, "TOKEN_TIMEOUT", PATIENCE * 3)
    with serving() as served, ExitStack() as open_ones:
        other = socket.create_connection(("127.0.0.1", served.port), PATIENCE, ("127.0.0.2", 0))
        open_ones.enter_context(other).sendall(b"GET / HTTP/1.1\r\n")
        halves(served, 2 * unauthenticated.MAX_STRANGERS, open_ones)
        other.sendall(b"Host: localhost\r\n\r\n")
        assert other.recv(12) == b"HTTP/1.1 401"


@pytest.mark.parametrize(
    "begun", [b"", b"GET / HT", b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n"]
)
def test_a_connection_that_does_not_show_the_token_is_cut_off(monkeypatch: pytest.MonkeyPatch, begun: bytes) -> None:
    with running(), serving() as served, opened(served.socket) as page:
        monkeypatch.setattr(unauthenticated, "TOKEN_TIMEOUT", 0.2)
        with socket.create_connection(("127.0.0.1", served.port), PATIENCE) as half:
            half.sendall(begun)
            with suppress(ConnectionResetError):
                assert half.recv(100) == b""
        page.get("state")  # a page that has it stays


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "10.0.0.1", "[::2]"])
def test_a_name_that_another_site_lets_point_here_is_refused(served: Served, host: str) -> None:
    cookie = cookie_of(served).partition(";")[0]
    assert ask(served, "/", Host=host, Cookie=cookie).status == 403


@pytest.mark.parametrize("host", ["localhost:9000", "127.0.0.1", "[::1]:80"])
def test_a_forwarded_port_of_this_computer_is_let_in(served: Served, host: str) -> None:
    assert ask(served, "/", Host=host, Cookie=cookie_of(served).partition(";")[0]).status == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1"])
def test_another_site_cannot_open_the_websocket(served: Served, origin: str) -> None:
    with pytest.raises(InvalidStatus) as caught, opened(served.socket, origin=origin):
        pass
    assert caught.value.response.status_code == 403


def test_the_websocket_needs_the_token(served: Served) -> None:
    with pytest.raises(ConnectionClosed) as caught, opened(served.socket.partition("?")[0]) as client:
        client.get("server")
    assert caught.value.rcvd is not None
    assert caught.value.rcvd.code == 4401
    with opened(served.socket, origin=served.origin) as client:
        assert client.get("server")["operate"]


# By TLS -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate for a name and a family of names, not for addresses; and its key."""
    if shutil.which("openssl") is None:
        pytest.skip("a certificate for the test needs openssl")
    folder = tmp_path_factory.mktemp("certificate")
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "1",
         "-subj", "/CN=cell", "-addext", "subjectAltName=DNS:Cell.plant.example,DNS:*.line.example",
         "-addext", "basicConstraints=critical,CA:FALSE", "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    return certificate, key


@pytest.fixture(scope="module")
def secured(certificate: tuple[Path, Path]) -> Iterator[Served]:
    with serving(certificate=certificate[0], key=certificate[1]) as served:
        yield served


def ask_by_tls(served: Served, trust: Path, name: str, host: str) -> int:
    """The answer to the right token, from a server that proves this name."""
    context = ssl.create_default_context(cafile=str(trust))
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    with (
        socket.create_connection(("127.0.0.1", served.port), PATIENCE) as plain,
        context.wrap_socket(plain, server_hostname=name) as tls,
    ):
        path = served.url.removeprefix(served.origin)
        tls.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        return int(tls.recv(12).split()[1])


@pytest.mark.parametrize("name", ["cell.plant.example", "press.line.example"])
def test_the_page_is_served_by_the_names_of_its_certificate(
    secured: Served, certificate: tuple[Path, Path], name: str
) -> None:
    assert ask_by_tls(secured, certificate[0], name, name) == 200
    assert ask_by_tls(secured, certificate[0], name, f"{name.upper()}.:8270") == 200
    for other in ("line.example", "a.b.line.example", "xcell.plant.example", ".line.example"):
        assert ask_by_tls(secured, certificate[0], name, other) == 403


def test_half_handshakes_do_not_shut_the_page(
    secured: Served, certificate: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unauthenticated, "TOKEN_TIMEOUT", PATIENCE * 3)
    with ExitStack() as open_ones:
        half = [
            socket.create_connection(("127.0.0.1", secured.port), PATIENCE)
            for _ in range(2 * unauthenticated.MAX_STRANGERS)
        ]
        for connection in half:
            open_ones.enter_context(connection).sendall(b"\x16\x03\x01")
        assert ask_by_tls(secured, certificate[0], "cell.plant.example", "cell.plant.example") == 200
        with suppress(ConnectionResetError):
            assert half[0].recv(1) == b""


NOTE_CHANGES = """() => {
  const noted = window.noted = { refusals: 0, hidden: 0, toasts: 0 };
  const Socket = window.WebSocket;
  window.WebSocket = class extends Socket {
    constructor(url) {
      super(url);
      this.addEventListener("close", ({ code }) => { noted.refusals += code === 4401; });
    }
  };
  const notice = document.querySelector("#notice");
  new MutationObserver(() => { noted.hidden += notice.hidden; }).observe(notice, { attributes: true });
  new MutationObserver((all) => {
    for (const { addedNodes } of all) for (const { className } of addedNodes) noted.toasts += className === "toast";
  }).observe(document.body, { childList: true });
}"""


def test_a_page_says_that_the_server_refuses_it_and_what_to_do(page: Any) -> None:
    with running():
        with serving() as served:
            page.goto(served.url)
            page.locator(".legend").wait_for()
        page.evaluate(NOTE_CHANGES)
        with serving(served.port, token="another token"):
            page.get_by_text(
                "The server refuses this page. Open the address that `umo show page` has printed."
            ).wait_for()
            eventually(lambda: page.evaluate("noted.refusals") >= 2)  # it has tried again
            assert page.evaluate("[noted.hidden, noted.toasts]") == [0, 0]


def test_the_policy_binds_the_browser_to_this_server(served: Served) -> None:
    response = ask(served, served.url.removeprefix(served.origin))
    policy = response.getheader("content-security-policy")
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy
    assert response.getheader("x-content-type-options") == "nosniff"
    assert response.getheader("referrer-policy") == "no-referrer"


def test_the_token_of_the_user_is_kept_in_a_file_for_the_user_only(tmp_path: Path) -> None:
    file = tmp_path / "page.token"
    token = new_token(file)
    assert len(token) >= 32
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert new_token(file) == token
    file.chmod(0o644)
    assert new_token(file) != token


def test_a_page_that_came_with_the_given_token_becomes_this_users_by_the_printed_one(tmp_path: Path) -> None:
    with serving(shared="given to all") as served:
        given = ask(served, "/?token=given%20to%20all").getheader("set-cookie").partition(";")[0]
        printed = served.url.removeprefix(served.origin)
        own = ask(served, printed, Cookie=given).getheader("set-cookie").partition(";")[0]
        assert own == cookie_of(served).partition(";")[0] != given
        assert ask(served, "/?token=wrong", Cookie=given).status == 200  # a bookmark of an old token
        assert ask(served, "/?token=given%20to%20all", Cookie=own).getheader("set-cookie") is None


def test_behind_a_proxy_host_and_origin_are_those_of_the_proxy() -> None:
    with serving(proxy="https://cell.example", shared="given to all") as served:
        path = "/?token=given%20to%20all"
        for host in ("cell.example", "127.0.0.1"):
            assert ask(served, path, Host=host, Origin="https://cell.example").status == 200
            assert ask(served, path, Host=host, Origin="http://127.0.0.1").status == 403
        assert ask(served, path, Host="evil.example").status == 403
        assert "; Secure" in ask(served, path, Host="cell.example").getheader("set-cookie")
