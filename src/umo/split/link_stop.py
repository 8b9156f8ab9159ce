"""Stopping a controller from a process that knows nothing of its part, such as a guardian: STOP needs no more than the
session that every greeting is offered."""

from __future__ import annotations

from collections.abc import Iterator
from os import getpid
from time import monotonic, sleep

from umo.drivers.streams import Lost, Stream, TimedOut
from umo.drivers.streams.stream import Dial
from umo.errors import DeviceTimeout, DriverError
from umo.split.link_bodies import (
    STATE,
    ControllerMode,
    FrameKind,
    HostRefused,
    check_refused,
    hello,
    request,
    welcome_of,
)
from umo.split.link_frames import FrameReader, framed

LONGEST = 1 << 16
"""Bytes of the longest body that is read: the part is not known."""


def stop_controller(dial: Dial, name: str, deadline: float, retry: float) -> None:
    """Bring the outputs of a controller to their defaults, whatever part it runs and whoever has started it. Each frame
    is sent again after `retry` s. DeviceTimeout, DriverError; HostRefused if it has
    another host for all that time."""
    stream: Stream | None = None
    try:
        while True:
            stream = dial(deadline)
            try:
                return _stop(stream, name, deadline, retry)
            except HostRefused:  # by its host, of which it has not noticed yet that it has died: it soon does
                if monotonic() + retry >= deadline:
                    raise
            stream.close()
            sleep(retry)
    except TimedOut:
        raise DeviceTimeout(f"no answer from the controller {name}: timed out") from None
    except Lost as error:
        raise DriverError(f"no answer from the controller {name}: {error}") from None
    finally:
        if stream is not None:
            stream.close()


def _stop(stream: Stream, name: str, deadline: float, retry: float) -> None:
    nonce, reader = (int(monotonic() * 1e6) ^ getpid() << 16) & 0xFFFFFFFF, FrameReader(LONGEST)
    session = 0
    while True:
        said = request(FrameKind.STOP, session, 1, ()) if session else hello(nonce)
        stream.send(framed(said), deadline)
        for body in _bodies(stream, reader, deadline, retry):
            check_refused(body, name)
            welcome = welcome_of(body)
            if welcome is not None and welcome.nonce == nonce and not session:
                session = welcome.session
                break
            if session and _rests(body, session):
                return


def _bodies(stream: Stream, reader: FrameReader, deadline: float, retry: float) -> Iterator[bytes]:
    """What comes within `retry` s. TimedOut after the deadline."""
    until = monotonic() + retry
    while True:
        try:
            yield from reader.take(stream.receive(min(deadline, until)))
        except TimedOut:
            if monotonic() >= deadline:
                raise
            return


def _rests(body: bytes, session: int) -> bool:
    if len(body) < STATE.size or body[0] != FrameKind.STATE:
        return False
    _, of, _, mode, *_ = STATE.unpack_from(body)
    return bool(of == session and mode == ControllerMode.RESTING)
