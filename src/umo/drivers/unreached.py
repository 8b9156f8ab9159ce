"""Errors which say that a device was not reached."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from umo.errors import DriverError

MAX_CHAIN = 5
"""Largest number of errors, each made from the next, that are looked at."""
UNREACHED = frozenset(
    (errno.EHOSTUNREACH, errno.EHOSTDOWN, errno.ENETUNREACH, errno.ENETDOWN, errno.ENOTCONN, errno.ENODEV)
)
"""Numbers of errors of the operating system for a device that was not reached, besides those of ConnectionError."""


class NotReached(Exception):
    """The device was not reached. The base of errors of a line to a device."""


@contextmanager
def reaching() -> Iterator[None]:
    """Return a context in which a DriverError also says that the device was not reached."""
    try:
        yield
    except DriverError as error:
        error.__cause__ = error.__cause__ or NotReached()
        raise


def is_unreached(error: BaseException | None) -> bool:
    """Return True if an error, or the error from which it was made, says that the device was not reached, such as a
    refused connection or an unplugged line."""
    for _ in range(MAX_CHAIN):
        if error is None:
            return False
        if isinstance(error, NotReached | ConnectionError) or getattr(error, "errno", None) in UNREACHED:
            return True
        error = error.__cause__ or error.__context__
    return False
