"""The search for a device that has stopped answering, without waiting for it (`Looks.look`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import monotonic

from umo.drivers.streams.stream import Dial, Stream, TimedOut


def at_once(stream: Stream) -> bool:
    """Return True: the function for a device that takes requests as soon as it is connected."""
    return True


class Look:
    """A search that opens a stream, sends one request and checks for its answer, one step in each call of `found`.

        if not self._look.under_way:
            self._look.begin(request, has_answered, self.timeout)
        self._stream = self._look.found()
        return None if self._stream is None else True

    Call `stop` before the device is used in any other way, because the stream belongs to the look until the device is
    found.
    """

    def __init__(self, dial: Dial) -> None:
        self._dial = dial
        self._steps: Iterator[Stream | None] | None = None

    @property
    def under_way(self) -> bool:
        return self._steps is not None

    def begin(
        self,
        request: bytes,
        has_answered: Callable[[bytes], bool],
        seconds: float,
        is_ready: Callable[[Stream], bool] = at_once,
    ) -> None:
        """Begin a look that ends within `seconds`. The request is sent when the device `is_ready`; without a request
        (b"") the connection counts as its answer. `has_answered` returns whether the bytes received since the request
        are the whole answer, and raises Lost if they are anything else."""
        self.stop()
        self._steps = self._look(request, has_answered, monotonic() + seconds, is_ready)

    def found(self) -> Stream | None:
        """Return the stream on which the device has answered; None if this is not known yet. Raises Lost or DriverError
        if the device does not answer now."""
        if self._steps is None:
            return None
        try:
            stream = next(self._steps)
        except BaseException:
            self._steps = None
            raise
        if stream is not None:
            self._steps = None
        return stream

    def stop(self) -> None:
        """Give up the look."""
        self._steps = None  # a generator that is dropped closes what it has open

    def _look(
        self,
        request: bytes,
        has_answered: Callable[[bytes], bool],
        deadline: float,
        is_ready: Callable[[Stream], bool],
    ) -> Iterator[Stream | None]:
        stream: Stream | None = None
        try:
            for stream in self._dial.without_waiting(deadline):
                if stream is None:
                    yield None
            assert stream is not None
            while not is_ready(stream):
                _check(deadline)
                yield None
            if request:
                stream.send(request, 0.0)
                data = b""
                while not has_answered(data):
                    if stream.idle():
                        _check(deadline)
                        yield None
                    else:
                        data += stream.waiting()
            found, stream = stream, None
            yield found
        finally:
            if stream is not None:
                stream.close()


def _check(deadline: float) -> None:
    """Raise TimedOut if the time is over, because nothing more can be done now."""
    if monotonic() >= deadline:
        raise TimedOut("no answer")
