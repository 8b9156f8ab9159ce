"""Stops a controller from a process that does not know the controller's part, such as a guardian. STOP needs only the
session that the answer to a greeting offers."""

from __future__ import annotations

import os
from collections.abc import Iterator

from umo.drivers.streams import Lost, Stream, TimedOut
from umo.drivers.streams.stream import Dial
from umo.errors import DeviceTimeout, DriverError
from umo.generate.split.link_bodies import (
    STATE,
    ControllerMode,
    FrameKind,
    HostRefused,
    check_refused,
    hello,
    request,
    welcome_of,
)
from umo.generate.split.link_frames import FrameReader, framed
from umo.system import calls

LONGEST = 1 << 16
"""Largest number of bytes of a body that is read. The true length depends on the part, which is not known."""


def stop_controller(dial: Dial, name: str, deadline: float, retry: float) -> None:
    """Bring the outputs of a controller to their defaults, for any part, even if another host has started it. Each
    frame is sent again after `retry` s. Raises DeviceTimeout or DriverError. Raises HostRefused if the controller has
    another host all that time."""
    stream: Stream | None = None
    try:
        while True:
            stream = dial(deadline)
            try:
                return _stop(stream, name, deadline, retry)
            except HostRefused:  # by its host, of which it has not noticed yet that it has died: it soon does
                if calls.now() + retry >= deadline:
                    raise
            stream.close()
            calls.sleep(retry)
    except TimedOut:
        raise DeviceTimeout(f"no answer from the controller {name}: timed out") from None
    except Lost as error:
        raise DriverError(f"no answer from the controller {name}: {error}") from None
    finally:
        if stream is not None:
            stream.close()


def _stop(stream: Stream, name: str, deadline: float, retry: float) -> None:
    nonce, reader = (int(calls.now() * 1e6) ^ os.getpid() << 16) & 0xFFFFFFFF, FrameReader(LONGEST)
    session = number = 0
    while True:
        number += 1  # one that comes twice is not answered, and the answer may have been lost
        said = request(FrameKind.STOP, session, number, ()) if session else hello(nonce)
        stream.send(framed(said), deadline)
        for body in _bodies(stream, reader, deadline, retry):
            check_refused(body, name)
            welcome = welcome_of(body)
            if welcome is not None and welcome.nonce == nonce and not session:
                session = welcome.session
                break
            if session and _rests(body, session):
                return
        else:
            session = 0  # it may have been offered to another greeting since: greet again


def _bodies(stream: Stream, reader: FrameReader, deadline: float, retry: float) -> Iterator[bytes]:
    """Yield the bodies that arrive within `retry` s. Raises TimedOut after the deadline."""
    until = calls.now() + retry
    while True:
        try:
            yield from reader.take(stream.receive(min(deadline, until)))
        except TimedOut:
            if calls.now() >= deadline:
                raise
            return


def _rests(body: bytes, session: int) -> bool:
    if len(body) < STATE.size or body[0] != FrameKind.STATE:
        return False
    _, of, _, mode, *_ = STATE.unpack_from(body)
    return bool(of == session and mode == ControllerMode.RESTING)
