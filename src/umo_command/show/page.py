"""`umo show page`: serves the page of the running stations, or of recordings, from this process."""

from __future__ import annotations

import errno
import socket
import ssl
import webbrowser
from contextlib import ExitStack
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit

from umo.clients.fleet.fleet_keys import is_station_key
from umo.errors import FramesError
from umo.operation.commands.roles import PAGE, Caller, Roles, place
from umo.operation.commands.verb import Role
from umo.process.frames.frame_server import folder
from umo.process.frames.search import meant_by, several_runs, station_name
from umo.process.station import StationError, find, shipped
from umo.system.folders import written
from umo.system.packages import how_to_install
from umo.system.realtime import drop_realtime
from umo.system.streams import limit_waits
from umo.text import did_you_mean, printable
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.run.record_beside import SUFFIX, check_installed
from umo_command.show.stations import readers

if TYPE_CHECKING:
    from umo.clients.page.fleet_feed import FleetFeed
    from umo.clients.page.watched_recording import WatchedRecording

LIBRARIES = ("starlette", "uvicorn", "websockets")
DEFAULT_PORT = 8270
"""The default TCP port. If it is in use, any free port is taken."""
MIN_TOKEN_LENGTH = 8
"""Smallest number of characters of a token that the user gives."""


class PageError(FramesError, ValueError):
    """Raised if the page cannot be served with these options."""


@dataclass(frozen=True)
class ViewOptions:
    """Options of `umo show page`."""

    station: str | None = None
    host: str = "127.0.0.1"
    port: int | None = None
    token: str | None = None
    open: bool = False
    operate: bool = False
    certificate: Path | None = None
    key: Path | None = None
    proxy: str | None = None
    """The address at which a proxy serves the page."""
    fleet: bool = False
    second: Path | None = None
    """A recording that is drawn over the first one."""
    code: str | None = None
    """The station whose twin is drawn in a recording, by folder or name."""


def view(choice: ViewOptions) -> int:
    """Print the address of the page, and serve the page until Ctrl-C."""
    for library in LIBRARIES:
        if find_spec(library) is None:
            raise PageError(f"the page needs {library}: {how_to_install('page')}")
    from umo.clients.faces.endpoint import is_local
    from umo.clients.page.access_control import new_token
    from umo.clients.page.server import Options, serve
    from umo.clients.page.session import InitialStation

    local = is_local(choice.host) and choice.proxy is None
    _check(choice, local)
    file = _recording(choice)
    elsewhere = None if file else _elsewhere(choice)
    named = None if elsewhere or file else _station(choice)
    recorded = None if file is None else _recorded(file, choice.second, choice.code)
    listening = _listening(choice)
    port = listening.getsockname()[1]
    token = new_token(folder() / "page.token")
    operate = (local or choice.operate) and recorded is None
    first = None if named is None else InitialStation(*named)
    fleet = _fleet() if choice.fleet or elsewhere else None
    options = Options(
        choice.host, port, token, first, operate, choice.certificate, choice.key, fleet, recorded,
        choice.token, choice.proxy or "",
    )  # fmt: skip
    address = f"http{'s' if choice.certificate else ''}://{_shown_host(choice.host)}:{port}/"
    shown = f"#station={elsewhere}" if elsewhere else ""
    own = f"{address}?token={quote(token)}{shown}"

    def ready() -> None:
        public = f"{choice.proxy}/" if choice.proxy else address
        out.print(f"{public}{shown}" if choice.token else own, soft_wrap=True, highlight=False)
        if not local:
            _warn(choice, operate)
        if choice.token and operate:
            _tell_roles(None if choice.proxy else own)
        if choice.open:
            _open(own if choice.proxy is None else f"{public}{shown}")

    drop_realtime()
    limit_waits()
    try:
        serve(options, listening, ready)
    finally:
        if choice.open:
            _opening().unlink(missing_ok=True)
    say("the page has ended" if recorded else "the page has ended; running stations continue")
    return 0


def _recording(choice: ViewOptions) -> Path | None:
    """Return the named recording, or None for a station."""
    name = choice.station
    if name is not None and (name.endswith(SUFFIX) or Path(name).is_file()):
        return Path(name)
    if choice.second is not None:
        raise PageError(
            f"{choice.second}: a second file needs a recording ({SUFFIX}) as the first, and {name} is not a recording"
        )
    if choice.code is not None:
        raise PageError(
            f"--station can only be used with a recording ({SUFFIX}), and {name or 'a running station'} "
            f"is not a recording"
        )
    return None


def _recorded(file: Path, second: Path | None, code: str | None) -> WatchedRecording:
    """Return a recording that has been read, with a second recording drawn over it, if there is one. `code`: the
    station whose twin is drawn."""
    check_installed()
    station = None if code is None else find(code)
    from umo.clients.page.watched_recording import WatchedRecording
    from umo.recording.recording import Recording

    with ExitStack() as opened, OneLine(err) as line:
        first, *others = [opened.enter_context(Recording(each)) for each in (file, second) if each is not None]
        for each in (first, *others):
            if not each.chunks:
                raise FramesError(f"{each.path} has no periods")
        length = first.span[1]
        recorded = WatchedRecording(
            first,
            lambda share: line.show(share * length, f"reading {file.name}", share),
            next(iter(others), None),
            station,
        )
        opened.pop_all()
    return recorded


def _elsewhere(choice: ViewOptions) -> str | None:
    """Return the name of a station of a fleet (SITE/STATION), or None if no such name is given."""
    name = choice.station
    return name if name is not None and is_station_key(name) and not Path(name).is_dir() else None


def _fleet() -> FleetFeed:
    """Return the feed of the stations of other computers."""
    if find_spec("zenoh") is None:
        raise PageError(f"a fleet needs zenoh: {how_to_install('fleet')}")
    from umo.clients.page.fleet_feed import FleetFeed

    return FleetFeed()


def _check(choice: ViewOptions, local: bool) -> None:
    """Raise PageError for options that do not fit one another."""
    if choice.proxy is not None and not _is_origin(choice.proxy):
        raise PageError(f"--proxy {printable(choice.proxy)} is not an address such as https://cell.example")
    if not local and choice.token is None:
        what = f"a proxy at {choice.proxy}" if choice.proxy else f"listening at {choice.host}"
        raise PageError(
            f"{what} lets other computers in: give a token of at least {MIN_TOKEN_LENGTH} "
            "characters (the variable UMO_TOKEN, or --token)"
        )
    if choice.token is not None and len(choice.token) < MIN_TOKEN_LENGTH:
        raise PageError(f"the token has {len(choice.token)} characters; give a token of at least {MIN_TOKEN_LENGTH}")
    if (choice.certificate is None) != (choice.key is None):
        raise PageError("TLS needs both --certificate and --key")
    for file in filter(None, (choice.certificate, choice.key)):
        file.open("rb").close()  # OSError names it
    if choice.certificate is not None:
        try:
            ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(choice.certificate, choice.key)
        except ssl.SSLError as error:
            reason = error.reason or error
            raise PageError(
                f"{choice.certificate}, {choice.key}: these are not a certificate and its key (PEM): {reason}"
            ) from None


def _is_origin(text: str) -> bool:
    """True if a text is an address without a path, in the form that browsers send in the header Origin."""
    try:
        parts = urlsplit(text)
        return parts.scheme in ("http", "https") and text == f"{parts.scheme}://{parts.netloc}" and bool(parts.hostname)
    except ValueError:
        return False


def _station(choice: ViewOptions) -> tuple[str, str, int | None] | None:
    """Return name, folder and pid of the station to show first. The pid is None if the station does not run yet."""
    if choice.station is None:
        return None
    found = readers()
    if fitting := meant_by(choice.station, found):
        if len(fitting) > 1:
            raise FramesError(several_runs(choice.station, fitting))
        about = fitting[0].about
        return str(about["station"]), str(about["place"]), int(about["pid"])
    name, running = station_name(choice.station), [str(reader.about["station"]) for reader in found]
    try:
        station = find(choice.station)
    except StationError as error:
        if Path(choice.station).is_dir():
            raise
        near = did_you_mean(name, [*running, *shipped()])
        known = f"running: {', '.join(running) or 'none'}; others: {', '.join(shipped())}, or a folder"
        raise PageError(f"there is no station {printable(choice.station)!r}{near}; {known}") from error
    say(f"{name} is not running yet; the page waits for it")
    return station.name, str(station.path), None


def _listening(choice: ViewOptions) -> socket.socket:
    from umo.clients.page.server import listen

    try:
        return listen(choice.host, DEFAULT_PORT if choice.port is None else choice.port)
    except OSError as error:
        if choice.port is None and error.errno == errno.EADDRINUSE:
            return listen(choice.host, 0)
        reason = error.strerror or str(error)
        raise PageError(f"cannot listen at {choice.host}, port {choice.port or DEFAULT_PORT}: {reason}") from None


def _shown_host(host: str) -> str:
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host


def _warn(choice: ViewOptions, operate: bool) -> None:
    may = (
        "see the machine, and command it as roles.toml allows"
        if operate
        else ("see the machine (with --operate also command it)")
    )
    say(f"warning: everybody who can reach {choice.proxy or choice.host} and has the token can {may}")
    if choice.certificate is None and not str(choice.proxy).startswith("https:"):
        say("warning: without --certificate and --key the token can be read on the network")


def _tell_roles(own: str | None) -> None:
    """Print the rights of users who have the token, and how this user is identified (`own`, or None if not)."""
    roles = Roles.load()
    role = roles.of(Caller(PAGE, ""))
    if roles.mistake:
        say(f"warning: other users may only see the machine: {roles.mistake}")
    elif role is Role.SEE:
        say(
            f"users with the given token may only see the machine; {PAGE} in [unverified] of {place()} gives them "
            f"another role"
        )
    else:
        say(f"users with the given token have the role {role}")
    if own is not None:
        say(f"address with all rights, for your programs on this computer: {own}")


def _opening() -> Path:
    """Return the path of a file that leads the browser to the page. The file contains the token."""
    return folder() / "page.html"


def _open(address: str) -> None:
    """Open the user's browser with a file that only the user can read, because other users can see the arguments of
    processes."""
    file = _opening()
    url = escape(address)
    with written(file, 0o600) as stream:
        stream.write(f'<meta http-equiv="refresh" content="0; url={url}"><a href="{url}">umo</a>'.encode())
    webbrowser.open(file.as_uri())
